"""Predicted standard deviations of a designed motion against those of 50 simulated repetitions.

An earlier log of a random motion gives the noise; the design predicts from it; then the designed
motion is run 50 times, with other noise each time, and every run is identified by weighted least
squares. Torques are those of the model itself with white noise, positions are quantised.

On the virtual robot, whose friction gives way near standstill as no law of the model does, the
earlier residuals hold that too. It repeats from run to run: the prediction is then above the
scatter of repetitions, and nearer to the whole error, which is reported beside it.
"""

import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from proofs.estimation.recovery import log_of
from proofs.support.claims import Claim, main_of

from steelyard.base.motion import run
from steelyard.estimate.information.base_parameters_and_regressor import Regressor, base_regressor
from steelyard.estimate.information.gather import gather
from steelyard.estimate.least_squares.weighted_robust_and_whitened import WeightedLeastSquares
from steelyard.excite.design_problem_and_information import Earlier
from steelyard.excite.search.parallel_search import SearchBudget
from steelyard.excite.searched_or_planned_motion import design
from steelyard.excite.trajectories.exact_trajectories import ExactTrajectory
from steelyard.excite.trajectories.fourier import random_fourier
from steelyard.logs.formats import open_log
from steelyard.model.model import model_with_open_friction
from steelyard.robot.file.robot_file import LoadedRobot
from steelyard.runs.prepare import prepare
from steelyard.runs.recording import Recording
from steelyard.runs.runs_of_named_logs import processing_of_robot
from steelyard.simulate.ground_truth import Truth, random_truth
from steelyard.simulate.simulate import write_demo_arm
from steelyard.simulate.virtual_robot import VirtualRobot, customary_sensors

REPETITIONS = 50
SEEDS = (0, 1, 2)
SECONDS = 6.0

Log = Callable[[Truth, ExactTrajectory, int], Recording]


def compared(loaded: LoadedRobot, seed: int, log: Log) -> tuple[np.ndarray, np.ndarray]:
    """Predicted std over that of the repetitions, and over their whole error, by parameter."""
    truth, model = random_truth(loaded.robot, seed), model_with_open_friction(loaded)
    regressor = base_regressor(model)
    first = prepare(
        log(truth, random_fourier(loaded.robot, seed=seed, periods=2), seed),
        processing_of_robot(loaded),
    )
    learnt = WeightedLeastSquares()(gather(regressor, first))
    names, values = learnt.parameters.names, learnt.parameters.values
    earlier = Earlier(
        learnt.sigma,
        first.matched_cutoff,
        names,
        values,
        learnt.covariance,
        learnt.values.as_dict(),
    )
    effort = SearchBudget(SECONDS, processes=2, seed=seed)
    designed = design((loaded, model, earlier), effort)
    runs = []
    for repetition in range(REPETITIONS):
        recording = log(truth, designed.trajectory, 1000 + repetition)
        information = gather(regressor, prepare(recording, processing_of_robot(loaded)))
        known = WeightedLeastSquares()(information).parameters.as_dict()
        runs.append([known[name] for name in designed.shown.names])
    found = np.array(runs)
    predicted = designed.shown.std()
    error = found - true_values(regressor, truth)
    whole = np.sqrt(np.mean(error**2, axis=0))
    return predicted / np.std(found, axis=0, ddof=1), predicted / whole


def true_values(regressor: Regressor, truth: Truth) -> np.ndarray:
    """The true base parameters."""
    known = truth.values.as_dict()
    return regressor.base.base_values([known.get(name, 0.0) for name in regressor.model.names])


def main() -> list[Claim]:
    """Median ratio over all parameters, per truth."""
    claims = []
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        loaded = write_demo_arm(folder)

        def exact(truth: Truth, motion: ExactTrajectory, seed: int) -> Recording:
            return log_of(loaded.robot, truth, seed, trajectory=motion)

        def virtual(truth: Truth, motion: ExactTrajectory, seed: int) -> Recording:
            path = folder / f"run{seed}.parquet"
            sensors = customary_sensors(loaded.robot, truth)
            run(VirtualRobot(loaded.robot, truth, sensors, seed=seed), motion, path)
            recording = Recording(open_log(path), loaded.signals)
            return recording

        for seed in SEEDS:
            scatter, _ = compared(loaded, seed, exact)
            middle = float(np.median(scatter))
            low, high = np.quantile(scatter, [0.1, 0.9])
            ratios = f"{middle:.2f} (80 % of them {low:.2f} to {high:.2f})"
            name = f"predicted over actual std, truth {seed}, {len(scatter)} parameters"
            claims.append(Claim(name, ratios, "0.8 to 1.25", 0.8 <= middle <= 1.25))
        scatter, whole = compared(loaded, SEEDS[0], virtual)
    ratios = f"{np.median(scatter):.2f} of the scatter, {np.median(whole):.2f} of the whole error"
    return [
        *claims,
        Claim("the same on the virtual robot, whose friction differs", ratios, "reported", True),
    ]


if __name__ == "__main__":
    main_of(main)
