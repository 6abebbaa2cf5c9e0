"""The estimator table of the field: what noise of positions and filters do to every estimator.

As in the benchmark BIRDy [Leboutet2021]: the demo arm, six joints with Coulomb and viscous
friction, simulated in closed loop at 1 kHz. Its controller feels the noisy positions that are
logged; torques have white noise of 1 % of the typical torque. Motion of 10 s, another one and other
noise per seed, judged on a motion without noise.

Filters are zero-phase Butterworth low-passes before differentiation, at 10 and 50 Hz; `none` are
central differences of the raw positions. Regressor and torque then go through one parallel
low-pass, as is the custom, of 20 Hz, or the filter's cut-off if that is lower. Coulomb friction
turns smoothly over 0.02 rad/s, in the truth and in the model, so that what is measured is noise,
not a model error. Estimators that simulate know controller and wanted motion. All are run on all
seeds and behind all filters.

An estimator is compared with the best of all twice: behind 50 Hz, and each behind the filter that
suits it best.
"""

import sys
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import files
from pathlib import Path
from time import perf_counter

import numpy as np
from proofs.support.claims import Claim, main_of

from steelyard.base.arrays import Array
from steelyard.base.errors import DataError
from steelyard.estimate.closed_loop.simulated_experiment import Experiment, RunController
from steelyard.estimate.estimate import Estimate
from steelyard.estimate.estimator_register import ESTIMATORS, Context
from steelyard.estimate.information.base_parameters_and_regressor import base_regressor
from steelyard.estimate.information.kept_filtered_samples import gather_samples
from steelyard.estimate.prior.body_priors import default_knowledge
from steelyard.excite.trajectories.fourier import random_fourier
from steelyard.model.laws.friction_over_speed import Coulomb
from steelyard.model.laws.register import DEFAULT_TERMS
from steelyard.model.model import Model
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.file.signals import Signals
from steelyard.runs.prepare import prepare
from steelyard.runs.processing_choices import Processing
from steelyard.runs.recording import LogInMemory, Recording
from steelyard.runs.run import Run
from steelyard.runs.smoothing.spline_and_finite_windows import SavitzkyGolay
from steelyard.simulate.ground_truth import Truth, random_truth
from steelyard.simulate.mujoco_model import build
from steelyard.simulate.typical_torques_and_masses import typical_torque
from steelyard.simulate.virtual_robot import VirtualRobot

NOISES = (1e-5, 1e-4, 5e-4)
FILTERS: tuple[float | None, ...] = (10.0, 50.0, None)
SEEDS = 3
PERIOD, PARALLEL, TORQUE_NOISE, SMOOTHING = 10.0, 20.0, 0.01, 0.02

Cell = tuple[float, float | None, str]
"""Noise, filter and estimator."""


@dataclass(frozen=True)
class Score:
    """One fit: errors of validation and parameters [%] and time [s], or why there is none."""

    validation: float = np.nan
    parameters: float = np.nan
    seconds: float = np.nan
    reason: str = ""


class Bench:
    """The arm, its truth, and what is common to all fits."""

    def __init__(self) -> None:
        path = Path(str(files("steelyard.simulate") / "demo_arm.urdf"))
        self.robot = load_robot(path).robot
        terms = tuple(
            Coulomb(smoothing=SMOOTHING) if isinstance(term, Coulomb) else term
            for term in DEFAULT_TERMS
        )
        self.truth: Truth = random_truth(self.robot, 0, terms=terms)
        self.model = Model(self.robot, terms)
        self.regressor = base_regressor(self.model)
        self.context = Context(self.regressor, default_knowledge(self.model))
        self.rig = VirtualRobot(self.robot, self.truth)
        plant = build(self.robot, self.truth.inertial, self.truth.rotors)
        self.noise = TORQUE_NOISE * typical_torque(self.robot, plant)
        t = np.arange(0.0, PERIOD, 0.004)
        motion = random_fourier(self.robot, seed=77, period=PERIOD).sample(t)
        self.seen = self.regressor.dense(motion.q.T, motion.dq.T, motion.ddq.T)
        self.values = self.regressor.base.base_values(self.truth.values.values)

    def recording(self, noise: float, seed: int) -> Recording:
        """A log at 1 kHz; the controller feels the positions that it shows."""
        rng = np.random.default_rng([seed, round(noise * 1e6)])
        motion = random_fourier(self.robot, seed=seed, period=PERIOD)
        felt = noise * rng.standard_normal((self.rig.ticks(motion), self.robot.n))
        run = self.rig.follow(motion, felt)
        tau = run.tau + self.noise * rng.standard_normal(run.tau.shape)
        names = [f"{kind}{j}" for kind in "qe" for j in range(self.robot.n)]
        ones = np.ones(self.robot.n)
        signals = Signals(
            time="t",
            time_scale=1.0,
            position=tuple(names[: self.robot.n]),
            position_scale=ones,
            velocity=None,
            velocity_scale=None,
            effort=tuple(names[self.robot.n :]),
            effort_scale=ones,
            effort_kind="joint_torque",
            effort_units=self.robot.effort_units,
            gains=ones,
        )
        table = np.column_stack((run.t, run.q + felt, tau))
        return Recording(LogInMemory(Path(f"seed{seed}"), ("t", *names), table), signals)

    def score(self, estimate: Estimate, seconds: float) -> Score:
        """Errors against the truth."""
        known = estimate.parameters.as_dict()
        values = np.array([known.get(name, 0.0) for name in self.regressor.layout.columns])
        if estimate.standard is not None:
            values = self.regressor.base.base_values(estimate.standard.parameters.values)
        wanted, missed = self.seen @ self.values, self.seen @ (values - self.values)
        error = np.linalg.norm(missed, axis=1) / np.linalg.norm(wanted, axis=1)
        away = np.linalg.norm(values - self.values) / np.linalg.norm(self.values)
        return Score(100.0 * float(error.mean()), 100.0 * float(away), seconds)


@cache
def bench() -> Bench:
    """Made once."""
    return Bench()


def prepared(recording: Recording, cutoff: float | None) -> Run:
    """The run behind a filter."""
    if cutoff is None:
        motion = SavitzkyGolay(window=3, degree=2)
        return prepare(
            recording,
            Processing(motion=motion, matched_cutoff=PARALLEL, rest_speed=1e-3, outliers=None),
        )
    return prepare(
        recording,
        Processing(
            motion_cutoff=cutoff,
            matched_cutoff=min(cutoff, PARALLEL),
            rest_speed=1e-3,
            outliers=None,
        ),
    )


def scores(
    noise: float, cutoff: float | None, seed: int, recording: Recording
) -> Iterator[tuple[str, Score]]:
    """All estimators on one log."""
    here = bench()
    run, motion = prepared(recording, cutoff), random_fourier(here.robot, seed=seed, period=PERIOD)

    def wanted(t: Array) -> tuple[Array, Array]:
        goal = here.rig.wanted(motion, t)
        return goal.q, goal.dq

    loop = RunController(here.rig.tuned, wanted)
    found = Experiment.of_runs(here.regressor, [run])
    experiment = replace(found, loops=(loop,) * len(found.runs), notes=())
    data = {
        "information": experiment.information,
        "samples": gather_samples(here.regressor, run),
        "experiment": experiment,
    }
    for offer in ESTIMATORS:
        start = perf_counter()
        try:
            estimate = offer.make(here.context)(data[offer.needs])
            yield offer.name, here.score(estimate, perf_counter() - start)
        except DataError as error:
            yield offer.name, Score(reason=error.wrong)


def table_of(found: dict[Cell, list[Score]]) -> str:
    """Per estimator and filter, validation error / parameter error [%] and time of each noise."""
    lines = [f"{'':<13}{'filter':>7}" + "".join(f"{noise:>26g} rad" for noise in NOISES)]
    reasons = []
    for offer in ESTIMATORS:
        for cutoff in FILTERS:
            row = f"{offer.name:<13}{'none' if cutoff is None else f'{cutoff:g} Hz':>7}"
            for noise in NOISES:
                each = found.get((noise, cutoff, offer.name), [])
                good = [score for score in each if not score.reason]
                mark = (
                    f"{len(each) - len(good)} of {len(each)} failed"
                    if len(good) < len(each)
                    else ""
                )
                if good:
                    v, p, s = (
                        np.mean([getattr(x, n) for x in good])
                        for n in ("validation", "parameters", "seconds")
                    )
                    mark = f"{v:8.3f} % {p:8.3f} % {s:5.1f} s" + ("*" if mark else " ")
                row += f"{mark or '-':>30}"
                reasons += [
                    f"  {offer.name}, {noise:g} rad, filter {cutoff}: {x.reason}"
                    for x in each
                    if x.reason
                ]
            lines.append(row)
    return "\n".join([*lines, "* and failures:", *dict.fromkeys(reasons)])


def mean_of(found: dict[Cell, list[Score]], noise: float, cutoff: float | None, name: str) -> float:
    """Mean validation error; infinite if a fit failed or there were not all seeds."""
    each = found.get((noise, cutoff, name), [])
    if len(each) < SEEDS or any(score.reason for score in each):
        return np.inf
    return float(np.mean([score.validation for score in each]))


def best_of(
    found: dict[Cell, list[Score]], noise: float, filters: Sequence[float | None]
) -> tuple[float, str]:
    """The least mean validation error of all estimators behind some filters, and whose it is."""
    return min(
        (mean_of(found, noise, cutoff, offer.name), offer.name)
        for offer in ESTIMATORS
        for cutoff in filters
    )


def beside_the_best(found: dict[Cell, list[Score]], noise: float, name: str) -> list[Claim]:
    """One estimator against the best, behind 50 Hz and each behind its best filter."""
    bound, claims = (1.1 if noise == NOISES[2] else 1.15), []
    for behind, filters in (("50 Hz", (50.0,)), ("its best filter", FILTERS)):
        best, whose = best_of(found, noise, filters)
        own = min(mean_of(found, noise, cutoff, name) for cutoff in filters)
        claims.append(
            Claim(
                f"{name} over the best ({whose}), {noise:g} rad, behind {behind}",
                f"{own:.3f} / {best:.3f} % = {own / best:.2f}",
                f"<= {bound:g}",
                own <= bound * best,
            )
        )
    return claims


def measured() -> dict[Cell, list[Score]]:
    """All fits."""
    found: dict[Cell, list[Score]] = defaultdict(list)
    for noise in NOISES:
        for seed in range(SEEDS):
            recording = bench().recording(noise, seed)
            for cutoff in FILTERS:
                for name, score in scores(noise, cutoff, seed, recording):
                    found[noise, cutoff, name].append(score)
    return found


def main() -> list[Claim]:
    """The table to stderr, and what it shows."""
    found = measured()
    print(table_of(found), file=sys.stderr)
    claims = []
    plain, instrumental = (mean_of(found, 1e-4, 50.0, name) for name in ("WLS", "IV"))
    gain = plain / instrumental
    claims.append(
        Claim(
            "WLS over IV, 1e-4 rad, 50 Hz",
            f"{plain:.3f} / {instrumental:.3f} % = {gain:.1f}",
            ">= 3",
            gain >= 3.0,
        )
    )
    for noise, name in ((1e-4, "EKF"), (1e-4, "DIDIM"), (5e-4, "EKF")):
        claims += beside_the_best(found, noise, name)
    failed = [
        score for each in found.values() for score in each if not np.isfinite(score.validation)
    ]
    explained = sum(bool(score.reason) for score in failed)
    claims.append(
        Claim(
            "failures with a reason",
            f"{explained} of {len(failed)}",
            "all",
            explained == len(failed),
        )
    )
    return claims


if __name__ == "__main__":
    main_of(main)
