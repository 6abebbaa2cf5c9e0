"""A simulated robot under control with and without a model: what `steelyard track` does."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from rich.console import Console

from steelyard.arguments import checked
from steelyard.control.usable import refuse_other_robot, refuse_unknown_gains, remarks
from steelyard.estimation.identified import IdentifiedModel
from steelyard.excitation.trajectories.files import read_motion
from steelyard.identification.job_result import Result
from steelyard.identification.motion.simulate import true_robot
from steelyard.identification.named_models import named_models
from steelyard.kernel.quantities.kinematics import frame_of, last_frame
from steelyard.progress import Progress, silent
from steelyard.report import ReportContent
from steelyard.report.track_page import SECTIONS, render_tracking
from steelyard.robot_file.file import load_robot
from steelyard.robot_file.loaded import LoadedRobot
from steelyard.virtual.drives import customary_drives
from steelyard.virtual.tracking import Tracking, controllers_of, tracking


@dataclass(frozen=True, eq=False, repr=False)
class TrackingComparison(Result):
    """A motion run under control with and without a model.

    Attributes:
        content: What the page shows.
        tracking: Errors of the joints and of the tool.
    """

    content: ReportContent
    tracking: Tracking

    def report(self) -> str:
        """The report as one self-contained HTML page."""
        return render_tracking(self.content)

    def write(self, folder: Path) -> None:
        """Write `tracking.html` and `tracking.json`."""
        (folder / "tracking.html").write_text(self.report(), encoding="utf-8")
        text = json.dumps(self.to_dict(), indent=1, allow_nan=False)
        (folder / "tracking.json").write_text(f"{text}\n", encoding="utf-8")

    def to_dict(self) -> dict[str, Any]:
        """The numbers as JSON values, as `steelyard track --json` prints them."""
        found = {"robot": self.content.robot, "settings": dict(self.content.settings)}
        for section in SECTIONS:
            found |= section.to_dict(self.content)
        return {**found, "notes": list(self.content.notes)}

    def show(self, console: Console) -> None:
        """Print the errors."""
        for section in SECTIONS:
            for part in section.printed(self.content):
                console.print(part)
                console.print()
        for note in self.content.notes:
            console.print(f"note: {note}", markup=False)


@checked(friction_drift=0.0, lag=0.0, seed=0)
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
        model: The identified model, or several to compare.
        control: `pd`, `pid`, `cascade` or `computed_torque`, with gains as in
            `computed_torque,kp=100,kv=5`.
        truth: `truth.json` of a simulation, the robot's true parameters; random ones near the
            nominal ones if `None`.
        friction_drift: Factor on the true friction.
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
    models = [model] if isinstance(model, str | Path | IdentifiedModel) else list(model)
    named = named_models(models)
    for each in named.values():
        refuse_unknown_gains(each)
        refuse_other_robot(each, loaded.robot)
    frame = frame_of(loaded.robot, last_frame(loaded.robot) if tool is None else tool)
    trajectory = read_motion(Path(motion), loaded.robot)
    real, _ = true_robot(loaded, truth, friction_drift, seed)
    valued = [(label, each.valued) for label, each in named.items()]
    found = tracking(
        loaded.robot,
        real,
        trajectory,
        controllers_of(control, valued),
        frame,
        customary_drives(loaded.robot, lag),
        progress,
    )
    found = replace(found, random_truth=truth is None)
    settings = (
        ("control", control),
        ("motion", str(motion)),
        ("models", ", ".join(named) or "none"),
        ("true robot", f"seed {seed}" if truth is None else str(truth)),
        ("factor on true friction", f"{friction_drift:g}"),
        ("lag of the drives' torque", f"{1e3 * lag:g} ms"),
    )
    notes = tuple(dict.fromkeys(note for each in named.values() for note in remarks(each)))
    content = ReportContent(
        title=f"Tracking of {loaded.robot.name}",
        robot=loaded.robot.name,
        tracking=found,
        notes=(*loaded.notes, *notes),
        settings=settings,
    )
    return TrackingComparison(content, found)
