"""Predicted standard deviations of a designed motion against those of 50 simulated repetitions.

A first log of the demo arm gives the noise; the design predicts from it; the virtual robot runs the
designed motion 50 times with other noise, and each run is identified by weighted least squares, and
by the estimate with prior that is the default.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from claims import Claim, main_of

from steelyard.cli.river import model_of, wanted_by
from steelyard.estimation.consistent import Consistent
from steelyard.estimation.least_squares import WeightedLeastSquares
from steelyard.estimation.prior import default_knowledge
from steelyard.excitation.files import read_motion
from steelyard.formats import open_log
from steelyard.measurement import Recording, prepare
from steelyard.motion import run
from steelyard.regression.gather import gather
from steelyard.regression.regressor import base_regressor
from steelyard.robot.robot_file import load_robot
from steelyard.virtual.demo import demo_runs
from steelyard.virtual.invent import random_truth
from steelyard.virtual.robot import VirtualRobot
from steelyard.virtual.simulate import customary_sensors

REPETITIONS = 50
SEEDS = (0, 1, 2)


def steelyard(*arguments: object) -> dict:
    """A command's results."""
    command = [str(Path(sys.executable).with_name("steelyard")), *map(str, arguments), "--json"]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        sys.exit(done.stderr)
    return json.loads(done.stdout)


def ratios(seed: int, folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """Predicted over actual standard deviation, by least squares and with prior."""
    files = demo_runs(folder / "robot", seed)
    steelyard("identify", files.robot, files.identification, "-o", folder / "earlier")
    earlier = folder / "earlier" / "model.json"
    told = steelyard(
        "excite", files.robot, "--earlier", earlier, "--seed", seed, "-o", folder / "motion"
    )
    loaded = load_robot(files.robot)
    motion = read_motion(folder / "motion" / "trajectory.json", loaded.robot)
    truth = random_truth(loaded.robot, seed)
    model = model_of(loaded)
    regressor, knowledge = base_regressor(model), default_knowledge(model)
    plain, informed = [], []
    for repetition in range(REPETITIONS):
        log = folder / f"run{repetition}.parquet"
        sensors = customary_sensors(loaded.robot, truth)
        run(VirtualRobot(loaded.robot, truth, sensors, seed=1000 + repetition), motion, log)
        prepared = prepare(Recording(open_log(log), loaded.signals), wanted_by(loaded))
        information = gather(regressor, prepared)
        for found, estimator in (
            (plain, WeightedLeastSquares()),
            (informed, Consistent(regressor.base, knowledge)),
        ):
            found.append(estimator(information).parameters.as_dict())
    predicted = told["predicted_std"]
    return tuple(
        np.array([predicted[name] / np.std([x[name] for x in runs], ddof=1) for name in predicted])
        for runs in (plain, informed)
    )


def main() -> list[Claim]:
    """Median ratio over all parameters, per truth."""
    claims = []
    for seed in SEEDS:
        with tempfile.TemporaryDirectory() as place:
            plain, informed = ratios(seed, Path(place))
        middle = float(np.median(plain))
        low, high = np.quantile(plain, [0.1, 0.9])
        claims += [
            Claim(
                f"predicted over actual std, truth {seed}, {len(plain)} parameters",
                f"{middle:.2f} (80 % of them {low:.2f} to {high:.2f})",
                "0.8 to 1.25",
                0.8 <= middle <= 1.25,
            ),
            Claim(
                f"the same, estimates with prior, truth {seed}",
                f"{np.median(informed):.2f}",
                "told",
                True,
            ),
        ]
    return claims


if __name__ == "__main__":
    main_of(main)
