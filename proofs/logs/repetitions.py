"""Repetitions: are they found, and do the predicted standard deviations of their mean come true?

Found: in 100 random process logs, in which one to all but one joint stands and carries only noise,
and in none of 100 in which every cycle has places of its own.

Predicted: fifty repetitions on the virtual robot.

The robot runs 52 periods under its controller, the first and the last are dropped. Torque noise is
white and grows fourfold from rest to full speed, so the weights have something to tell; encoders
have steps and noise. The same motion is logged anew, with noise of its own, in every draw. Friction
is smooth, in the truth as in the model, so that what is left of the torque is noise.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
from proofs.estimation.recovery import robots
from proofs.support.claims import Claim, main_of
from proofs.support.process_logs import process_log

from steelyard.base.arrays import Array
from steelyard.base.errors import LogError
from steelyard.estimate.information.base_parameters_and_regressor import Regressor, base_regressor
from steelyard.estimate.information.gather import gather
from steelyard.estimate.least_squares.weighted_robust_and_whitened import WeightedLeastSquares
from steelyard.excite.trajectories.fourier import random_fourier
from steelyard.model.laws.friction_over_speed import Coulomb
from steelyard.model.model import DEFAULT_TERMS
from steelyard.robot.file.signals import Signals
from steelyard.runs.mean_over_repetitions import mean_of_periods
from steelyard.runs.prepare import prepare_mean
from steelyard.runs.recording import LogInMemory, Recording
from steelyard.runs.run import Run
from steelyard.runs.spectrum_and_period import Repetitions
from steelyard.simulate.drives_sensors_and_loads import TrueRun
from steelyard.simulate.ground_truth import Truth, random_truth
from steelyard.simulate.virtual_robot import VirtualRobot

DRAWS, PERIOD, REPETITIONS = 40, 3.0, 52
EVERY = 4
"""Ticks of the controller per row of the log."""
NOISE, GROWTH = 0.05, 3.0
"""Torque noise over the mean torque at rest, and what speed adds to it."""
ENCODER = 1e-5
PROCESSES, SAME_PERIOD = 100, 2e-3  # process logs of each kind; relative error of a period


def recording(name: str, t: Array, q: Array, tau: Array, units: tuple[str, ...]) -> Recording:
    """A log of positions and torques, shape `(N, n)`."""
    n = q.shape[1]
    names = [f"{kind}{j}" for kind in "qe" for j in range(n)]
    signals = Signals(
        time="t",
        time_scale=1.0,
        position=tuple(names[:n]),
        position_scale=np.ones(n),
        velocity=None,
        velocity_scale=None,
        effort=tuple(names[n:]),
        effort_scale=np.ones(n),
        effort_kind="joint_torque",
        effort_units=units,
        gains=np.ones(n),
    )
    return Recording(LogInMemory(Path(name), ("t", *names), np.column_stack([t, q, tau])), signals)


def found_in(seed: int, repeated: bool) -> bool:
    """Whether period and number of repetitions are found in a process log, or none without."""
    log = process_log(seed, repeated=repeated)
    n, count = log.q.shape
    torque = np.random.default_rng(seed).standard_normal((count, n))
    name = f"{'repeated' if repeated else 'single'}{seed}"
    whole = recording(name, np.arange(count) / log.rate, log.q.T, torque, ("Nm",) * n)
    try:
        starts = mean_of_periods(whole, Repetitions(drop_first=0, drop_last=0)).averaged.starts
    except LogError as error:
        return not repeated and "no period was found" in error.wrong
    period = float(np.diff(starts).mean()) / log.rate
    same = abs(period / log.period - 1.0) < SAME_PERIOD
    return repeated and same and len(starts) == log.repetitions


def driven() -> tuple[Truth, TrueRun]:
    """What the robot is and what it did."""
    robot = robots()[1]
    smooth = [Coulomb(smoothing=0.05) if isinstance(x, Coulomb) else x for x in DEFAULT_TERMS]
    truth = random_truth(robot, 1, terms=smooth)
    motion = random_fourier(robot, seed=1, period=PERIOD, periods=REPETITIONS)
    return truth, VirtualRobot(robot, truth).follow(motion)


def logged(truth: Truth, run: TrueRun, seed: int) -> Recording:
    """The log of one draw."""
    rng, robot = np.random.default_rng(seed), truth.robot
    t, q, dq, tau = (x[::EVERY] for x in (run.t, run.q, run.dq, run.tau))
    growth = 1.0 + GROWTH * np.abs(dq) / np.abs(dq).max(axis=0)
    noise = NOISE * np.abs(tau).mean(axis=0) * growth * rng.standard_normal(tau.shape)
    steps = np.round(q / ENCODER + rng.standard_normal(q.shape)) * ENCODER
    return recording(f"draw{seed}", t, steps, tau + noise, robot.effort_units)


def fitted(regressor: Regressor, run: Run) -> tuple[np.ndarray, np.ndarray]:
    """Parameters and their standard deviations."""
    estimate = WeightedLeastSquares()(gather(regressor, run))
    return estimate.parameters.values, estimate.std


def main() -> list[Claim]:
    """Repetitions found; weighted and unweighted over all draws."""
    truth, true = driven()
    regressor = base_regressor(truth.model)
    results: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {"weighted": [], "equal": []}
    count = 0
    for seed in range(DRAWS):
        mean = mean_of_periods(logged(truth, true, seed), Repetitions(drop_first=1, drop_last=1))
        run, count = prepare_mean(mean, f"draw{seed}"), len(mean.averaged.starts)
        results["weighted"].append(fitted(regressor, run))
        results["equal"].append(fitted(regressor, replace(run, importance=None)))
    spread = {k: np.std([v for v, _ in x], axis=0, ddof=1) for k, x in results.items()}
    stated = {k: np.sqrt(np.mean([s**2 for _, s in x], axis=0)) for k, x in results.items()}
    ratio = {k: stated[k] / spread[k] for k in results}
    middle = float(np.median(ratio["weighted"]))
    gain = float(np.median(spread["weighted"] / spread["equal"]))
    right = {k: sum(found_in(seed, k) for seed in range(PROCESSES)) for k in (True, False)}
    ends = f"{ratio['weighted'].min():.2f} to {ratio['weighted'].max():.2f}"
    return [
        Claim(
            "process logs with standing joints in which period and number of cycles are found",
            f"{right[True]} of {PROCESSES}",
            "all",
            right[True] == PROCESSES,
        ),
        Claim(
            "process logs without repetitions in which none is found",
            f"{right[False]} of {PROCESSES}",
            "all",
            right[False] == PROCESSES,
        ),
        Claim("repetitions averaged", f"{count}", "50", count == 50),
        Claim(
            f"predicted over empirical std, median of {len(ratio['weighted'])} parameters",
            f"{middle:.2f} (from {ends})",
            "0.8 to 1.2",
            0.8 <= middle <= 1.2,
        ),
        Claim("the same without weights", f"{np.median(ratio['equal']):.2f}", "reported", True),
        Claim("empirical std, weighted over equal weights", f"{gain:.2f}", "< 1", gain < 1.0),
    ]


if __name__ == "__main__":
    main_of(main)
