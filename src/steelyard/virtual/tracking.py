"""Tracking errors of a simulated robot under several controllers."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array, frozen
from steelyard.control.computed_torque import ComputedTorque
from steelyard.control.pd import PD
from steelyard.control.protocol import Control
from steelyard.control.register import control_of
from steelyard.model import Model, ValuedModel
from steelyard.motion import Trajectory
from steelyard.parameters import Parameters
from steelyard.progress import Progress, silent
from steelyard.robot.robot import Frame, Robot
from steelyard.virtual.drives import Drives
from steelyard.virtual.robot import VirtualRobot
from steelyard.virtual.truth import Truth

AFTER = 0.2
"""Time behind the end of the motion that counts too [s]."""


@dataclass(frozen=True, eq=False)
class TrackedRun:
    """One run under one controller.

    Attributes:
        name: The controller, and its model.
        error: Desired minus true positions, shape `(N, n)` [rad; m].
        tool: True positions of the tool, shape `(N, 3)` [m].
        deviation: Distance of the tool from where it should be, shape `(N,)` [m].
    """

    name: str
    error: Array
    tool: Array
    deviation: Array

    def __post_init__(self) -> None:
        for name in ("error", "tool", "deviation"):
            object.__setattr__(self, name, frozen(getattr(self, name)))

    @property
    def rms(self) -> Array:
        """Root mean square error of each joint, shape `(n,)`."""
        return np.asarray(np.sqrt(np.mean(self.error**2, axis=0)))

    @property
    def largest(self) -> Array:
        """Largest error of each joint, shape `(n,)`."""
        return np.asarray(np.abs(self.error).max(axis=0))

    @property
    def tool_rms(self) -> float:
        """Root mean square deviation of the tool [m]."""
        return float(np.sqrt(np.mean(self.deviation**2)))

    @property
    def tool_largest(self) -> float:
        """Largest deviation of the tool [m]."""
        return float(self.deviation.max())


@dataclass(frozen=True, eq=False)
class Tracking:
    """A motion run under several controllers.

    Attributes:
        robot: The robot.
        frame: Its tool.
        t: Time from the start of the motion, shape `(N,)` [s].
        desired: Desired positions of the tool, shape `(N, 3)` [m].
        runs: The runs; the first one without a model.
        random_truth: Whether the robot has random true parameters near the nominal ones.
    """

    robot: Robot
    frame: Frame
    t: Array
    desired: Array
    runs: tuple[TrackedRun, ...]
    random_truth: bool = False

    @property
    def reference(self) -> TrackedRun:
        """The run without a model."""
        return self.runs[0]

    def ratios(self, run: TrackedRun) -> Array:
        """Errors of the joints over those without a model, shape `(n,)`; NaN for no error."""
        own, other = run.rms, self.reference.rms
        return np.asarray(np.divide(own, other, out=np.full(own.shape, np.nan), where=other > 0.0))


def controllers_of(text: str, models: Sequence[tuple[str, ValuedModel]]) -> dict[str, Control]:
    """Controllers to compare, by name: without a model first, then with each.

    Args:
        text: As of `control_of`.
        models: Names and models.
    """
    name = text.partition(",")[0].replace("_", " ")
    tagged = len(models) > 1
    if not models:
        return {name: control_of(text)}
    found: dict[str, Control] = {}
    for label, model in models:
        control = control_of(text, model)
        ending = f", {label}" if tagged else ""
        if isinstance(control, ComputedTorque):
            found.setdefault("pd", PD(control.kp, control.kv))
            printed = ComputedTorque(model, control.kp, control.kv, friction=False)
            found[f"{name} without friction{ending}"] = printed
            if control.friction:
                found[f"{name}{ending}"] = control
        else:
            found.setdefault(name, control_of(text))
            found[f"{name} + feedforward{ending}"] = control
    return found


def tracking(
    robot: Robot,
    truth: Truth,
    trajectory: Trajectory,
    controllers: dict[str, Control],
    frame: Frame,
    drives: Drives,
    progress: Progress = silent,
) -> Tracking:
    """Run a motion under each controller.

    Args:
        robot: The robot.
        truth: What it really is.
        trajectory: The motion.
        controllers: By name, the one without a model first.
        frame: Its tool.
        drives: What lies between the controllers and the joints.
        progress: Receives events of progress; an exception from it stops the work.
    """
    runs: list[TrackedRun] = []
    kinematics = Model(robot, ()).at(Parameters((), (), ()))
    t = desired = np.zeros(0)
    for name, control in controllers.items():
        rig = VirtualRobot(robot, truth, control=control, drives=drives, progress=progress)
        run = rig.follow(trajectory)
        until = rig.rest + trajectory.duration + AFTER
        rows = (run.t >= rig.rest - 1e-9) & (run.t <= until + 1e-9)
        goal, q = run.commanded[0][rows], run.q[rows]
        if not runs:
            t = run.t[rows] - rig.rest
            desired = kinematics.pose(goal, frame)[0]
        tool = kinematics.pose(q, frame)[0]
        deviation = np.linalg.norm(tool - desired, axis=1)
        runs.append(TrackedRun(name, goal - q, tool, deviation))
    return Tracking(robot, frame, frozen(t), frozen(desired), tuple(runs))
