"""An identified model as code for controllers, on disk."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from steelyard.application.controller.c_code import CCode
from steelyard.application.controller.c_files import c_files
from steelyard.application.controller.fmu import write_fmu
from steelyard.application.controller.functions import Controller
from steelyard.application.controller.identifiers import identifier, identifiers
from steelyard.application.controller.prepare import absent, controller_of, origin_of
from steelyard.application.controller.python_code import python_code
from steelyard.application.controller.ros2 import FUNCTIONS as OF_ROS2
from steelyard.application.controller.ros2 import ros2_files
from steelyard.application.controller.simulink import simulink_files
from steelyard.arguments import checked
from steelyard.errors import OutputError
from steelyard.estimation.identified import IdentifiedModel, load_model
from steelyard.files import refuse_existing, whole_file, whole_folder
from steelyard.kernel.native.c99 import Precision

CodeFormat = Literal["c", "python", "fmu", "ros2", "simulink"]
NAMES: dict[CodeFormat, str] = {
    "c": "C",
    "python": "Python",
    "fmu": "an FMU",
    "ros2": "a ROS 2 package",
    "simulink": "Simulink",
}
FIXED: dict[CodeFormat, tuple[str, ...]] = {
    "fmu": ("torque",),
    "ros2": OF_ROS2,
    "simulink": ("torque",),
}
"""Functions of formats that leave no choice."""
FOLDERS: dict[CodeFormat, Callable[[CCode], dict[str, str]]] = {
    "c": c_files,
    "ros2": ros2_files,
    "simulink": simulink_files,
}
"""Formats of several files: their texts by name."""


@dataclass(frozen=True, eq=False)
class Written:
    """What was written.

    Attributes:
        controller: The model and what was wanted of it.
        files: Names of the files.
        renamed: Names of joints and the robot whose identifier differs from the name.
        absent: Functions that are wanted but need the memory of friction.
        stack: Bytes of local variables of the function with most of them; C only.
    """

    controller: Controller
    files: tuple[str, ...]
    renamed: dict[str, str]
    absent: tuple[str, ...]
    stack: int | None = None

    @property
    def functions(self) -> tuple[str, ...]:
        """Names of the functions in the code; `start` and `step` where friction has memory.

        The observer has several.
        """
        listed = self.controller.functions
        names = identifiers([function.name for function in listed], "function")
        public = (name for name, f in zip(names, listed, strict=True) if f.public)
        remembering = ("start", "step") if self.controller.n_memory else ()
        return (*public, *remembering, *observer_functions(self.controller))


def observer_functions(controller: Controller) -> tuple[str, ...]:
    """Names of the observer's functions, if it is wanted."""
    if controller.observer is None:
        return ()
    contact = () if controller.observer.thresholds is None else ("observer_contact",)
    return ("observer_start", "observer_step", *contact)


def write_code(
    identified: IdentifiedModel,
    path: Path,
    form: CodeFormat,
    precision: Precision = "double",
    functions: Sequence[str] = (),
    frames: Sequence[str] = (),
) -> Written:
    """Write a model as code.

    Args:
        identified: The model.
        path: File (Python, FMU) or folder (others) to make; it must not exist.
        form: The format.
        precision: Type of numbers in C.
        functions: Names of functions in C or Python; the usual ones if empty.
        frames: Names of frames whose pose and Jacobian are wanted there; those at the ends if
            empty.

    Raises:
        SteelyardError: The model is not of use to controllers, there is no such function or
            frame, or the files cannot be written.
    """
    _refuse_needless(form, precision, functions, frames)
    refuse_existing(path)
    controller, origin = controller_of(identified, functions, frames), origin_of(identified)
    if form in FIXED:
        controller = replace(controller, names=FIXED[form], frames=())
    renamed, lacking = _renamed(controller), absent(controller)
    if form == "python":
        with whole_file(path) as part:
            part.write_text(python_code(controller, origin), encoding="utf-8")
        return Written(controller, (path.name,), renamed, lacking)
    code = CCode(controller, precision, origin)
    if form == "fmu":
        with whole_file(path) as part:
            return Written(controller, write_fmu(code, part), renamed, (), code.stack)
    files = FOLDERS[form](code)
    with whole_folder(path) as part:
        for name, text in files.items():
            (part / name).parent.mkdir(exist_ok=True)
            (part / name).write_text(text, encoding="utf-8", newline="\n")
    # of formats without a choice nothing is absent: they step with memory
    return Written(controller, tuple(files), renamed, () if form in FIXED else lacking, code.stack)


def _refuse_needless(
    form: CodeFormat, precision: Precision, functions: Sequence[str], frames: Sequence[str]
) -> None:
    """Refuse what a format has no use for.

    Raises:
        OutputError: Something of it is given.
    """
    given = {
        "precision": form != "c" and precision != "double",
        "functions": form in FIXED and bool(functions),
        "frames": form in FIXED and bool(frames),
    }
    for what in (name for name, needless in given.items() if needless):
        raise OutputError(
            f"{what} cannot be chosen for {NAMES[form]}",
            where=f"export of code, {what}",
            fix="leave it out, or write C",
        )


def _renamed(controller: Controller) -> dict[str, str]:
    robot = controller.model.robot
    pairs = {robot.name: identifier(robot.name, "robot")}
    pairs |= dict(zip(robot.joint_names, identifiers(robot.joint_names, "joint"), strict=True))
    return {name: plain for name, plain in pairs.items() if name != plain}


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
    written = write_code(load_model(model), Path(path), to, precision, functions, frames)
    return written.functions
