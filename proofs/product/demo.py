"""`steelyard demo`: its time, and what its designed motion is worth.

The designed motion against one sine a joint within the same limits and of the same length, at
three frequencies, of which the best counts: errors of the base parameters by weighted least
squares, which knows nothing beforehand, over truths and noise of their own.
"""

import json
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from proofs.support.claims import Claim, main_of

from steelyard.base.motion import run
from steelyard.estimate.information.base_parameters_and_regressor import base_regressor
from steelyard.estimate.information.gather import gather
from steelyard.estimate.least_squares.weighted_robust_and_whitened import WeightedLeastSquares
from steelyard.excite.design_problem_from_tables import build
from steelyard.excite.search.feasibility import nearest_free
from steelyard.excite.search.repair_until_proven import finished
from steelyard.excite.trajectories.exact_trajectories import ExactTrajectory
from steelyard.excite.trajectories.motion_families import blended_fourier
from steelyard.excite.trajectories.trajectory_files import read_motion
from steelyard.logs.formats import open_log
from steelyard.model.model import model_with_open_friction
from steelyard.robot.file.robot_file import LoadedRobot, load_robot
from steelyard.runs.prepare import prepare
from steelyard.runs.recording import Recording
from steelyard.runs.runs_of_named_logs import processing_of_robot
from steelyard.simulate.ground_truth import random_truth
from steelyard.simulate.virtual_robot import VirtualRobot, customary_sensors

TIMED = True  # nothing else may run beside it

SEEDS = range(10)
FREQUENCIES = (0.1, 0.25, 0.5)
BLEND = 2.0
LARGE = 10.0
"""Amplitude [rad] that is shrunk into the limits."""


def sines(loaded: LoadedRobot, frequency: float, seconds: float) -> ExactTrajectory:
    """One sine a joint about the middle of its range, as large as all limits allow.

    Phases are spread over the joints: with one phase for all, many parameters do not show at all.
    Quintic blends lead in and out.
    """
    problem = build(loaded, model_with_open_friction(loaded))
    n, limits = loaded.robot.n, problem.limits
    periods = round((seconds - 2.0 * BLEND) * frequency)
    basis = blended_fourier(n, (seconds - 2.0 * BLEND) / periods, 1, periods, BLEND)
    phase = np.linspace(0.0, np.pi, n, endpoint=False)
    middle = nearest_free(limits, problem.constraints, 0.5 * (limits.lower + limits.upper))
    x = np.column_stack([LARGE * np.cos(phase), LARGE * np.sin(phase), middle])
    return finished(replace(problem, basis=basis), [x], deadline=0.0).trajectory


def errors(loaded: LoadedRobot, motion: ExactTrajectory, seed: int, folder: Path) -> np.ndarray:
    """Errors of the base parameters that a run of the motion shows, over their sizes."""
    truth = random_truth(loaded.robot, seed)
    sensors = customary_sensors(loaded.robot, truth)
    log = folder / f"{seed}_{id(motion)}.parquet"
    run(VirtualRobot(loaded.robot, truth, sensors, seed=seed), motion, log)
    prepared = prepare(Recording(open_log(log), loaded.signals), processing_of_robot(loaded))
    regressor = base_regressor(model_with_open_friction(loaded))
    known = WeightedLeastSquares()(gather(regressor, prepared)).parameters.as_dict()
    found = np.array([known.get(name, 0.0) for name in regressor.base.base_names])
    return (found - true_values(loaded, seed)) / sizes(loaded)


def true_values(loaded: LoadedRobot, seed: int) -> np.ndarray:
    """The base parameters that a seed invents."""
    regressor = base_regressor(model_with_open_friction(loaded))
    known = random_truth(loaded.robot, seed).values.as_dict()
    return regressor.base.base_values([known.get(n, 0.0) for n in regressor.model.names])


def sizes(loaded: LoadedRobot) -> np.ndarray:
    """Root mean square of each base parameter over the truths: one alone may be near zero."""
    return np.sqrt(np.mean([true_values(loaded, seed) ** 2 for seed in SEEDS], axis=0))


def spread(errors: list[np.ndarray]) -> np.ndarray:
    """Root mean square over truths, per parameter."""
    return np.sqrt(np.mean(np.square(errors), axis=0))


def rms(errors: list[np.ndarray]) -> float:
    """Root mean square over truths and parameters."""
    return float(np.sqrt(np.mean(np.square(errors))))


def demo(folder: Path) -> tuple[float, dict]:
    """The command's time and results."""
    start = time.perf_counter()
    command = [str(Path(sys.executable).with_name("steelyard")), "demo", "-o", str(folder)]
    done = subprocess.run([*command, "--json"], capture_output=True, text=True)
    if done.returncode:
        sys.exit(done.stderr)
    return time.perf_counter() - start, json.loads(done.stdout)


def predicted_deviations(robot: Path, folder: Path) -> Claim:
    """Predicted deviations over the parameters' sizes, RMS, of designs by three criteria."""
    loaded = load_robot(robot)
    names = base_regressor(model_with_open_friction(loaded)).base.base_names
    ratios = []
    for kind in ("d_optimal", "condition", "normalised_condition"):
        command = [str(Path(sys.executable).with_name("steelyard")), "excite", str(robot)]
        command += ["--criterion", kind, "-o", str(folder / kind), "--json"]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode not in (0, 3):  # 3: no search came to an end
            sys.exit(done.stderr)
        std = json.loads(done.stdout)["predicted_std"]
        relative = np.array([std[name] for name in names]) / sizes(loaded)
        ratios.append(f"{kind} {np.sqrt(np.mean(np.square(relative))):.2f}")
    return Claim(
        "relative predicted deviations, RMS, by criterion", ", ".join(ratios), "reported", True
    )


def main() -> list[Claim]:
    """Time, and errors."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        seconds, results = demo(folder / "demo")
        loaded = load_robot(folder / "demo" / "robot" / "demo_arm.toml")
        path = folder / "demo" / "motion" / "trajectory.json"
        designed = read_motion(path, loaded.robot)
        others = [sines(loaded, f, designed.duration) for f in FREQUENCIES]
        by_criterion = predicted_deviations(folder / "demo" / "robot" / "demo_arm.toml", folder)
        ours = [errors(loaded, designed, seed, folder) for seed in SEEDS]
        theirs = [[errors(loaded, m, seed, folder) for seed in SEEDS] for m in others]
    ratios = [rms(es) / rms(ours) for es in theirs]
    middles = [float(np.median(spread(es) / spread(ours))) for es in theirs]
    best = int(np.argmin(ratios))
    each = ", ".join(f"{r:.1f} at {f:g} Hz" for r, f in zip(ratios, FREQUENCIES, strict=True))
    middle = min(middles)
    every = ", ".join(f"{m:.1f}" for m in middles)
    motion = results["motion"]
    return [
        Claim("demo in all", f"{seconds:.1f} s", "<= 60 s", seconds <= 60.0),
        Claim(
            "its design, certified, of 2 finished searches",
            f"{motion['seconds']:.1f} s",
            "<= 10 s",
            motion["certified"] and motion["searches"] == 2 and motion["seconds"] <= 10.0,
        ),
        Claim(
            "errors over sizes, one sine a joint against the design, RMS over parameters",
            f"{ratios[best]:.1f} ({each})",
            ">= 3",
            ratios[best] >= 3.0,
        ),
        Claim("the same, median over parameters", f"{middle:.1f} ({every})", "reported", True),
        by_criterion,
    ]


if __name__ == "__main__":
    main_of(main)
