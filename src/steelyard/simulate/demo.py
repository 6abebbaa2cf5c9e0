"""The demonstration: an arm of our own that is not quite what its model file says."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

import numpy as np

from steelyard.base.arrays import Parameters
from steelyard.base.files import whole_folder, write_json
from steelyard.base.motion import run
from steelyard.base.progress import Progress, silent
from steelyard.excite.collision.workspace_from_tables import workspace_of
from steelyard.excite.trajectories.fourier import FourierMotion, random_fourier, repeated
from steelyard.excite.trajectories.trajectory import ExactTrajectory
from steelyard.excite.trajectories.trajectory_files import write_motion
from steelyard.robot.file.model_reading_and_loaded_robot import LoadedRobot
from steelyard.robot.file.robot_file import load_robot
from steelyard.simulate.truth import Truth, random_truth
from steelyard.simulate.virtual_robot import VirtualRobot, customary_sensors

LARGEST_LIMIT_SHARE = 0.9  # of the limits that a random motion uses, where the table has room


@dataclass(frozen=True)
class DemoFiles:
    """What the demonstration works on; the truth is what the arm really is, JSON."""

    robot: Path
    identification: Path
    validation: Path
    truth: Path


def demo_runs(
    folder: Path,
    seed: int = 0,
    progress: Progress = silent,
    *,
    period: float = 10.0,
    design: Callable[[LoadedRobot], ExactTrajectory] | None = None,
) -> DemoFiles:
    """Simulate two runs of the demo arm and write all that identification needs.

    The folder appears whole, when all is done, or not at all. The motion to identify from is that
    of `design`, or a random one, run twice, whose period is `period` [s]; `seed` is that of the
    truth, the motions and the noise.
    """
    names = ("identification", "validation")
    with whole_folder(folder) as part:
        loaded = write_demo_arm(part)
        robot = loaded.robot
        designed = None if design is None else design(loaded)
        truth = random_truth(robot, seed)
        sensors = customary_sensors(robot, truth)
        rig = VirtualRobot(robot, truth, sensors, seed=seed, progress=progress)
        for number, name in enumerate(names):
            motion: ExactTrajectory = _above_table(loaded, 2 * seed + number, period)
            if name == "identification":
                motion = repeated(motion, 2) if designed is None else designed
            run(rig, motion, part / f"{name}.csv")
            write_motion(part / f"{name}_motion.json", motion, robot)
        write_json(part / "truth.json", truth.to_dict())
    identification, validation = (folder / f"{name}.csv" for name in names)
    return DemoFiles(folder / "demo_arm.toml", identification, validation, folder / "truth.json")


def true_parameters(runs: DemoFiles) -> Parameters:
    """All standard parameters of the simulated arm."""
    truth = json.loads(runs.truth.read_text(encoding="utf-8"))
    return Truth.from_dict(truth, load_robot(runs.robot).robot).values


def _above_table(loaded: LoadedRobot, seed: int, period: float) -> FourierMotion:
    """A random motion, as large as the limits and the table allow."""
    walls, _ = workspace_of(loaded, ())
    for share in np.linspace(LARGEST_LIMIT_SHARE, 0.1, 9):
        motion = random_fourier(loaded.robot, seed=seed, period=period, limits_fraction=share)
        if all(wall.proven(motion).min() >= 0.0 for wall in walls):
            break
    return motion


def write_demo_arm(folder: Path) -> LoadedRobot:
    """Write the demo arm's URDF and robot file to a folder; the robot they describe."""
    for name in ("demo_arm.urdf", "demo_arm.toml"):
        text = (files("steelyard.simulate") / name).read_text(encoding="utf-8")
        (folder / name).write_text(text, encoding="utf-8")
    return load_robot(folder / "demo_arm.toml")
