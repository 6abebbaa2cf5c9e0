"""A simulated arm with a reference, and logs of it with faults."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from short_arm import without_wrist
from steelyard.base.arrays import Array
from steelyard.base.motion import Motion
from steelyard.check.all_checks import Check, Diagnosis, examine
from steelyard.check.cases_and_checks import Case, CheckedLog
from steelyard.check.decision.hypothesis_checks import (
    EFFORT_DELAY,
    EFFORT_KIND,
    EFFORT_SIGN,
    EFFORT_UNIT,
    GAIN,
    JOINT_ORDER,
    MOUNTING,
    PAYLOAD,
    POSITION_SIGN,
)
from steelyard.estimate.identified_model import Cutoffs, IdentifiedModel, Provenance
from steelyard.estimate.information.base_parameters_and_regressor import base_regressor
from steelyard.estimate.information.gather import gather
from steelyard.estimate.least_squares.weighted_robust_and_whitened import WeightedLeastSquares
from steelyard.excite.trajectories.fourier import random_fourier
from steelyard.model.model import Model
from steelyard.robot.file.robot_file import LoadedRobot, load_robot
from steelyard.robot.robot import Robot
from steelyard.runs.prepare import prepare
from steelyard.runs.processing_choices import Processing
from steelyard.runs.recording import LogInMemory, Recording
from steelyard.simulate.ground_truth import Truth, random_truth
from steelyard.simulate.simulate import write_demo_arm

MODEL_BASED: tuple[Check, ...] = (
    JOINT_ORDER,
    POSITION_SIGN,
    EFFORT_SIGN,
    EFFORT_UNIT,
    EFFORT_KIND,
    GAIN,
    EFFORT_DELAY,
    MOUNTING,
    PAYLOAD,
)


@dataclass(frozen=True, eq=False)
class Arm:
    """A simulated arm.

    Attributes:
        path: Its robot file.
        text: What that says.
        truth: What the arm really is.
        columns: Of its logs.
        table: A log that the reference does not know.
        motion: The motion of that log.
        reference: Identified from another log.
    """

    path: Path
    text: str
    truth: Truth
    columns: tuple[str, ...]
    table: Array
    motion: Motion
    reference: IdentifiedModel

    def case(self, table: Array, text: str | None = None, known: bool = True) -> Case:
        """A log to be checked, as a robot file of that text reads it."""
        text = self.text if text is None else text
        self.path.write_text(text)
        loaded = load_robot(self.path)
        assert loaded.signals is not None
        recording = Recording(LogInMemory(Path("log"), self.columns, table), loaded.signals)
        log = CheckedLog(recording, Processing(), "log")
        return Case(loaded, (log,), self.reference if known else None)

    def examined(self, table: Array, text: str | None = None, known: bool = True) -> Diagnosis:
        """What the model-based checks say."""
        return examine(self.case(table, text, known), checks=MODEL_BASED)

    def at(self, pattern: str) -> list[int]:
        """Places of the columns of all joints, such as those of `q{}_rad`."""
        return [self.columns.index(pattern.format(j + 1)) for j in range(self.motion.n_joints)]

    @property
    def robot(self) -> Robot:
        """As the robot file has it."""
        return self.reference.model.robot


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Arm:
    """The demo arm, its wrist fixed, with a log and a reference from another one."""
    return _made(tmp_path_factory.mktemp("short"), without_wrist)


@pytest.fixture(scope="session")
def made_six(tmp_path_factory: pytest.TempPathFactory) -> Arm:
    """The same with all six joints, for what three do not decide."""
    return _made(tmp_path_factory.mktemp("demo"), write_demo_arm)


def _made(folder: Path, write: Callable[[Path], LoadedRobot]) -> Arm:
    loaded = write(folder)
    path = folder / "demo_arm.toml"
    truth = random_truth(loaded.robot, 3)
    assert loaded.signals is not None
    columns = loaded.signals.columns
    logs = [_log(loaded.robot, truth, seed) for seed in range(2)]
    recording = Recording(LogInMemory(Path("clean"), columns, logs[0][0]), loaded.signals)
    run = prepare(recording, Processing())
    regressor = base_regressor(Model(loaded.robot))
    estimate = WeightedLeastSquares()(gather(regressor, run))
    cutoffs = Cutoffs(run.motion_cutoff, run.matched_cutoff, run.matched_cutoff)
    reference = IdentifiedModel(
        regressor.model,
        regressor.base,
        estimate,
        (),
        loaded.signals,
        cutoffs,
        Provenance("", {}, (), ()),
    )
    return Arm(path, path.read_text(), truth, columns, *logs[1], reference)


@pytest.fixture
def arm(made: Arm, tmp_path: Path) -> Arm:
    """The arm of three joints with a robot file of the test's own."""
    return _own(made, tmp_path)


@pytest.fixture
def six(made_six: Arm, tmp_path: Path) -> Arm:
    """The arm of six joints with a robot file of the test's own."""
    return _own(made_six, tmp_path)


def _own(made: Arm, tmp_path: Path) -> Arm:
    folder = made.path.parent
    (tmp_path / "demo_arm.urdf").write_text((folder / "demo_arm.urdf").read_text())
    path = tmp_path / "demo_arm.toml"
    path.write_text(made.text)
    return replace(made, path=path)


def _log(robot: Robot, truth: Truth, seed: int) -> tuple[Array, Motion]:
    """Time, positions, velocities and torques along a random motion."""
    rng = np.random.default_rng(seed)
    trajectory = random_fourier(robot, seed=seed, period=10.0, periods=2)
    t = np.arange(0.0, trajectory.duration, 0.005)
    motion = trajectory.sample(t)
    torque = truth.model.at(truth.values).torque(motion)
    torque = torque + 0.01 * torque.std(axis=0) * rng.standard_normal(torque.shape)
    return np.column_stack([t, motion.q, motion.dq, torque]), motion
