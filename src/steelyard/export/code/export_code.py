"""An identified model as code for controllers, on disk."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from steelyard.base.checked_arguments import checked
from steelyard.base.errors import DataError, ModelError, OutputError, refuse_unknown
from steelyard.base.files import refuse_existing, whole_file, whole_folder
from steelyard.estimate.external.contact_thresholds import FEWEST
from steelyard.estimate.identified_model import IdentifiedModel, load_model
from steelyard.estimate.scores.residual_traces_and_band_calibration import thresholds_of
from steelyard.export.code.c_code import CCode, c_files, identifier, identifiers, named_functions
from steelyard.export.code.controller_functions import (
    FUNCTIONS,
    OBSERVER,
    OF_ALL_TERMS,
    USUAL_FUNCTIONS,
    Controller,
    ObserverNumbers,
)
from steelyard.export.code.fmu_ros2_simulink import ROS2_FUNCTIONS as OF_ROS2
from steelyard.export.code.fmu_ros2_simulink import ros2_files, simulink_files, write_fmu
from steelyard.export.code.python_code import python_code
from steelyard.model.equations.frame_and_point_kinematics import frame_of
from steelyard.robot.robot import Robot, refuse_floating
from steelyard.symbolic.source_code import Precision
from steelyard.uses.control.feedforward import refuse_unknown_gains


def controller_of(
    identified: IdentifiedModel, functions: Sequence[str] = (), frames: Sequence[str] = ()
) -> Controller:
    """The model with what is wanted of it.

    Functions are names of `FUNCTIONS`, or `OBSERVER`, the usual ones if empty; frames those whose
    pose and Jacobian are wanted, if empty the last frame on every link that carries no other.
    """
    robot = identified.model.robot
    refuse_floating(robot, "code for controllers")
    refuse_unknown_gains(identified)
    if identified.signals.effort_kind == "gravity_compensated_torque":
        raise ModelError(
            "the model lacks the weight: it was identified from gravity-compensated efforts",
            where=f"model of '{robot.name}', [signals.effort] kind",
            fix="identify from efforts that include the weight, such as motor currents or "
            "measured joint torques",
        )
    known = (*FUNCTIONS, OBSERVER)
    for name in functions:
        wrong = f"there is no function '{name}'"
        refuse_unknown(name, known, wrong, "--function", "functions", DataError)
    for frame in frames:
        frame_of(robot, frame)
    wanted = tuple(name for name in dict.fromkeys(functions) if name != OBSERVER)
    names = wanted or (() if functions else USUAL_FUNCTIONS)
    ends = tuple(dict.fromkeys(frames)) or end_frames(robot)
    observer = observer_of(identified) if OBSERVER in functions else None
    return Controller(identified.model, identified.valued.values, names, ends, observer)


def observer_of(identified: IdentifiedModel) -> ObserverNumbers:
    """The usual bandwidth, and thresholds from left-out motion if the model has enough of it.

    They are those of 1 false alarm per hour, or as few as that motion supports.
    """
    calibration = identified.calibration
    peaks = None if calibration is None else calibration.peaks
    if peaks is None or not (peaks.visits >= FEWEST).any():
        return ObserverNumbers(identified.cutoffs.score, None)
    return ObserverNumbers(peaks.cutoff, thresholds_of(identified, peaks, None))


def end_frames(robot: Robot) -> tuple[str, ...]:
    """Per link that carries no other its last frame, or its own."""
    parents = {body.parent for body in robot.bodies}
    ends = [k for k in range(len(robot.bodies)) if k not in parents]
    last = {frame.body: frame.name for frame in robot.frames}
    return tuple(last.get(k, robot.bodies[k].name) for k in ends)


def origin_of(identified: IdentifiedModel) -> tuple[str, ...]:
    """Where the numbers come from, for heads of files."""
    origin, kind = identified.provenance, identified.signals.effort_kind
    lines = [
        f"Identified with steelyard {origin.version}, estimate: {identified.estimate.estimator}.",
        f"Runs: {', '.join(origin.runs) or 'unknown'}.",
        *(f"  {role}: sha256 {value}" for role, value in origin.inputs.items()),
    ]
    if kind == "link_torque":
        lines += [
            "Efforts are those on the link side, where they were measured: the controller has to",
            "add the friction of motors and gears.",
        ]
    else:
        lines.append("Efforts are those at the joints that move the robot, friction included.")
    if identified.effort_scales is not None:
        factors = identified.effort_scales.words
        lines.append(f"Logged efforts are {factors} times as large (estimated effort scales).")
    return tuple(lines)


CodeFormat = Literal["c", "python", "fmu", "ros2", "simulink"]
CODE_NAMES: dict[CodeFormat, str] = {
    "c": "C",
    "python": "Python",
    "fmu": "an FMU",
    "ros2": "a ROS 2 package",
    "simulink": "Simulink",
}
FIXED_FUNCTIONS: dict[CodeFormat, tuple[str, ...]] = {
    "fmu": ("torque",),
    "ros2": OF_ROS2,
    "simulink": ("torque",),
}
"""Functions of formats that leave no choice."""
FOLDER_FORMATS: dict[CodeFormat, Callable[[CCode], dict[str, str]]] = {
    "c": c_files,
    "ros2": ros2_files,
    "simulink": simulink_files,
}
"""Formats of several files: their texts by name."""


@dataclass(frozen=True, eq=False)
class WrittenCode:
    """What was written."""

    controller: Controller
    files: tuple[str, ...]
    renamed: dict[str, str]  # names of joints and the robot whose identifier differs from the name
    absent: tuple[str, ...]  # functions that are wanted but need the memory of friction
    stack: int | None = None  # bytes of local variables of the function with most of them; C only

    @property
    def functions(self) -> tuple[str, ...]:
        """Names of the functions in the code; `start` and `step` where friction has memory.

        The observer has several.
        """
        numbers = self.controller.observer
        names = [name for name, f in named_functions(self.controller).items() if f.public]
        names += ("start", "step") if self.controller.n_memory else ()
        names += () if numbers is None else ("observer_start", "observer_step")
        names += () if numbers is None or numbers.thresholds is None else ("observer_contact",)
        return tuple(names)


def write_code(
    identified: IdentifiedModel,
    path: Path,
    form: CodeFormat,
    precision: Precision = "double",
    functions: Sequence[str] = (),
    frames: Sequence[str] = (),
) -> WrittenCode:
    """Write a model as code; the arguments and errors are those of `export_code`."""
    _refuse_needless(form, precision, functions, frames)
    refuse_existing(path)
    controller, origin = controller_of(identified, functions, frames), origin_of(identified)
    if form in FIXED_FUNCTIONS:
        controller = replace(controller, names=FIXED_FUNCTIONS[form], frames=())
    robot = controller.model.robot
    names = {robot.name: identifier(robot.name, "robot")}
    names |= dict(zip(robot.joint_names, identifiers(robot.joint_names, "joint"), strict=True))
    renamed = {name: plain for name, plain in names.items() if name != plain}
    # of formats without a choice nothing is absent: they step with memory
    needs_memory = OF_ALL_TERMS if controller.n_memory and form not in FIXED_FUNCTIONS else ()
    lacking = tuple(name for name in controller.names if name in needs_memory)
    if form == "python":
        with whole_file(path) as part:
            part.write_text(python_code(controller, origin), encoding="utf-8")
        return WrittenCode(controller, (path.name,), renamed, lacking)
    code = CCode(controller, precision, origin)
    if form == "fmu":
        with whole_file(path) as part:
            return WrittenCode(controller, write_fmu(code, part), renamed, lacking, code.stack)
    files = FOLDER_FORMATS[form](code)
    with whole_folder(path) as part:
        for name, text in files.items():
            (part / name).parent.mkdir(exist_ok=True)
            (part / name).write_text(text, encoding="utf-8", newline="\n")
    return WrittenCode(controller, tuple(files), renamed, lacking, code.stack)


def _refuse_needless(
    form: CodeFormat, precision: Precision, functions: Sequence[str], frames: Sequence[str]
) -> None:
    """Refuse what a format has no use for."""
    given = {
        "precision": form != "c" and precision != "double",
        "functions": form in FIXED_FUNCTIONS and bool(functions),
        "frames": form in FIXED_FUNCTIONS and bool(frames),
    }
    for what in (name for name, needless in given.items() if needless):
        raise OutputError(
            f"{what} cannot be chosen for {CODE_NAMES[form]}",
            where=f"export of code, {what}",
            fix="leave it out, or write C",
        )


@checked()
def export_code(
    model: str | Path | IdentifiedModel,
    path: str | Path,
    to: CodeFormat = "c",
    *,
    precision: Precision = "double",
    functions: Sequence[str] = (),
    frames: Sequence[str] = (),
) -> tuple[str, ...]:
    """Write an identified model as code for controllers.

    Args:
        model: The model, its `model.json`, or the folder that holds it.
        path: File (Python, FMU) or folder (others) to make; it must not exist.
        to: `c`; `python`, a file that needs NumPy alone; `fmu`, co-simulation by FMI 2.0; `ros2`,
            a package with a plugin of `inverse_dynamics_solver`; or `simulink`, an S-function.
        precision: Type of numbers in C.
        functions: Names of functions, such as `torque` and `mass`; the usual ones if empty.
        frames: Names of frames whose pose and Jacobian are wanted; those at the ends if empty.

    Returns:
        Names of the functions.

    Raises:
        SteelyardError: Drive gains are unknown, the model lacks the weight, there is no such
            function or frame, or the path exists.

    Example:
        >>> export_code(load_model("arm-model"), "arm-c", functions=["torque"])
        ('torque', 'pose', 'jacobian')
    """
    return write_code(load_model(model), Path(path), to, precision, functions, frames).functions
