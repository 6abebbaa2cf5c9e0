"""A simulated robot under control with and without a model: what `steelyard track` does."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from steelyard.base.arrays import Array, Parameters, frozen, set_fields
from steelyard.base.checked_arguments import checked
from steelyard.base.motion import Trajectory
from steelyard.base.progress import Progress, silent
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.excite.trajectories.trajectory_files import read_motion
from steelyard.identify.comparison.compare import named_models
from steelyard.model.equations.frame_and_point_kinematics import frame_of, last_frame
from steelyard.model.model import Model, ValuedModel
from steelyard.robot.file.model_reading_and_loaded_robot import LoadedRobot
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.robot import Frame, Robot, refuse_floating
from steelyard.simulate.drives_sensors_and_loads import Drives, customary_drives
from steelyard.simulate.ground_truth import Truth
from steelyard.simulate.simulate import true_robot
from steelyard.simulate.tracking_page import TrackingComparison
from steelyard.simulate.virtual_robot import VirtualRobot
from steelyard.uses.control.feedforward import (
    refuse_other_robot,
    refuse_unknown_gains,
    remarks_on_torques,
)
from steelyard.uses.control.joint_controllers import PD, ComputedTorque, Control, control_of

SECONDS_AFTER = 0.2  # time behind the end of the motion that counts too [s]


@dataclass(frozen=True, eq=False)
class TrackedRun:
    """One run under one controller."""

    name: str
    error: Array  # desired minus true positions, shape `(N, n)` [rad; m]
    tool: Array  # true positions of the tool, shape `(N, 3)` [m]
    deviation: Array  # distance of the tool from where it should be, shape `(N,)` [m]

    def __post_init__(self) -> None:
        tool, deviation = frozen(self.tool), frozen(self.deviation)
        set_fields(self, error=frozen(self.error), tool=tool, deviation=deviation)

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
    """A motion run under several controllers."""

    robot: Robot
    frame: Frame
    t: Array  # time from the start of the motion, shape `(N,)` [s]
    desired: Array  # desired positions of the tool, shape `(N, 3)` [m]
    runs: tuple[TrackedRun, ...]
    random_truth: bool = False  # whether the robot has random true parameters near the nominal ones

    @property
    def reference(self) -> TrackedRun:
        """The run without a model."""
        return self.runs[0]

    def ratios(self, run: TrackedRun) -> Array:
        """Errors of the joints over those without a model, shape `(n,)`; NaN for no error."""
        own, other = run.rms, self.reference.rms
        return np.asarray(np.divide(own, other, out=np.full(own.shape, np.nan), where=other > 0.0))


def controllers_of(text: str, models: Sequence[tuple[str, ValuedModel]]) -> dict[str, Control]:
    """Controllers to compare, by name: without a model first, then with each; see `control_of`."""
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
    """Run a motion under each controller, the one without a model first."""
    runs: list[TrackedRun] = []
    kinematics = Model(robot, ()).at(Parameters((), (), ()))
    t = desired = np.zeros(0)
    for name, control in controllers.items():
        rig = VirtualRobot(robot, truth, control=control, drives=drives, progress=progress)
        run = rig.follow(trajectory)
        until = rig.rest + trajectory.duration + SECONDS_AFTER
        rows = (run.t >= rig.rest - 1e-9) & (run.t <= until + 1e-9)
        goal, q = run.commanded[0][rows], run.q[rows]
        if not runs:
            t = run.t[rows] - rig.rest
            desired = kinematics.pose(goal, frame)[0]
        tool = kinematics.pose(q, frame)[0]
        runs.append(TrackedRun(name, goal - q, tool, np.linalg.norm(tool - desired, axis=1)))
    return Tracking(robot, frame, frozen(t), frozen(desired), tuple(runs))


@checked(friction_drift=0, lag=0, seed=0)
def track(
    robot: str | Path | LoadedRobot,
    motion: str | Path,
    model: str | Path | IdentifiedModel | Sequence[str | Path | IdentifiedModel] = (),
    *,
    control: str = "cascade",
    truth: str | Path | None = None,
    friction_drift: float = 1.0,
    lag: float = 0.002,
    tool: str | None = None,
    fixed_base: str | None = None,
    seed: int = 0,
    progress: Progress = silent,
) -> TrackingComparison:
    """Simulate a robot under control along a motion, without and with each model.

    Args:
        robot: Robot file (TOML), URDF, xacro or MJCF, or what `load_robot` made of it.
        motion: `trajectory.json`, or a table of times and positions.
        model: Identified model: model.json, or the folder that contains it; or several.
        control: `pd`, `pid`, `cascade` or `computed_torque`; gains follow:
            `computed_torque,kp=100,kv=5`.
        truth: `truth.json` of a simulation; if `None`, random true parameters near the nominal
            ones.
        friction_drift: Factor on the true friction, such as 1.2.
        lag: Time constant of the drives' torque [s].
        tool: Frame whose path is compared; that of the last link if `None`.
        fixed_base: Link to fix to the world, for a model file; `None` for its root.
        seed: Seed of random true parameters.
        progress: Receives events of progress; an exception from it stops the work.

    Raises:
        SteelyardError: A file cannot be used, the model is one of another robot, or its mass matrix
            does not allow computed torque.

    Example:
        >>> found = track("arm.toml", "fit/trajectory.json", "arm-model", truth="fit/truth.json")
        >>> [run.name for run in found.tracking.runs]
        ['cascade', 'cascade + feedforward']
    """
    loaded = load_robot(robot, base=fixed_base)
    refuse_floating(loaded.robot, "a simulation")
    models = [model] if isinstance(model, str | Path | IdentifiedModel) else list(model)
    named = named_models(models)
    for each in named.values():
        refuse_unknown_gains(each)
        refuse_other_robot(each, loaded.robot)
    frame = frame_of(loaded.robot, last_frame(loaded.robot) if tool is None else tool)
    trajectory = read_motion(Path(motion), loaded.robot)
    real, _ = true_robot(loaded, truth, friction_drift, seed)
    controllers = controllers_of(control, [(label, each.valued) for label, each in named.items()])
    drives = customary_drives(loaded.robot, lag)
    found = tracking(loaded.robot, real, trajectory, controllers, frame, drives, progress)
    found = replace(found, random_truth=truth is None)
    settings = (
        ("control", control),
        ("motion", str(motion)),
        ("models", ", ".join(named) or "none"),
        ("true robot", f"seed {seed}" if truth is None else str(truth)),
        ("factor on true friction", f"{friction_drift:g}"),
        ("lag of the drives' torque", f"{1e3 * lag:g} ms"),
    )
    remarks = (note for each in named.values() for note in remarks_on_torques(each))
    notes = tuple(dict.fromkeys((*loaded.notes, *remarks)))
    return TrackingComparison(loaded.robot.name, found, settings, notes)
