"""Single steps of an identification, for programs that put them together themselves."""

import os
from collections.abc import Iterable, Sequence
from pathlib import Path

from steelyard.application.controller.export import CodeFormat, write_code
from steelyard.application.export.export import exported, refuse_changed
from steelyard.arguments import checked
from steelyard.errors import DataError, OutputError
from steelyard.estimation.fields.fields import information_from
from steelyard.estimation.identified import IdentifiedModel, load_model
from steelyard.excitation.trajectories.exact import ExactTrajectory
from steelyard.excitation.trajectories.files import read_motion
from steelyard.files import whole_file
from steelyard.identification.logs import log_files, runs_of, signals_of, with_friction
from steelyard.identification.logs import model_of as model_with_open_friction
from steelyard.identification.result import paths_of
from steelyard.kernel.native.c99 import Precision
from steelyard.measurement import Run
from steelyard.model import Model
from steelyard.progress import Progress, silent
from steelyard.regression.information import Information
from steelyard.regression.regressor import base_regressor
from steelyard.robot_file.file import load_robot
from steelyard.robot_file.loaded import LoadedRobot
from steelyard.validation.friction.mixes import remembers


@checked()
def model_of(robot: str | Path | LoadedRobot) -> Model:
    """The model that a robot file describes.

    Its terms are those of the file, or rigid bodies, rotors, Coulomb and viscous friction and
    offsets where it names none.

    Args:
        robot: Robot file (TOML), URDF, xacro or MJCF, or what `load_robot` made of it.

    Raises:
        SteelyardError: The file cannot be used.

    Example:
        >>> model_of("arm.toml").robot.n
        2
    """
    loaded = load_robot(robot)
    return with_friction(model_with_open_friction(loaded), loaded)


@checked()
def load_runs(
    robot: str | Path | LoadedRobot,
    logs: str | Path | Iterable[str | Path],
    *,
    progress: Progress = silent,
) -> tuple[Run, ...]:
    """Logs as runs: motion and effort on a uniform clock, in SI units and joint order.

    Args:
        robot: Robot file (TOML), URDF, xacro or MJCF, or what `load_robot` made of it.
        logs: The logs; `run.csv@5:20` is a window in seconds.
        progress: Receives events of progress; an exception from it stops the work.

    Raises:
        SteelyardError: A file cannot be used.

    Example:
        >>> (run,) = load_runs("arm.toml", "fit.csv")
        >>> run.whole().motion.n_joints
        2
    """
    loaded = load_robot(robot)
    files = log_files(paths_of(logs, least=1))
    return runs_of(loaded, signals_of(loaded, files[0])[0], files, (), progress)[0]


@checked(threads=1)
def information(
    model: Model,
    runs: Sequence[Run],
    *,
    threads: int | None = None,
    progress: Progress = silent,
) -> Information:
    """What runs say about the base parameters of a model, in one pass over their samples.

    Args:
        model: The model.
        runs: The runs.
        threads: Native threads; as many as the machine has cores if `None`.
        progress: Receives events of progress; an exception from it stops the work.

    Example:
        >>> info = information(model_of("arm.toml"), load_runs("arm.toml", "fit.csv"))
        >>> info.normal()[0].shape == (len(info.layout.columns),) * 2
        True
    """
    if not runs:
        raise DataError(
            "there is no run", where="list of runs", fix="give those that load_runs returns"
        )
    cores = threads or os.cpu_count() or 1
    information_of = information_from(
        runs, rests=remembers(model.terms), threads=cores, progress=progress
    )
    return information_of(base_regressor(model))


@checked()
def read_trajectory(path: str | Path, robot: str | Path | LoadedRobot) -> ExactTrajectory:
    """The motion in a file.

    Args:
        path: `trajectory.json` of `excite` or `simulate`, or a CSV or Parquet table of postures.
        robot: The robot that it is for.

    Raises:
        SteelyardError: The file is no motion of this robot.

    Example:
        >>> read_trajectory("fit/trajectory.json", "arm.toml").duration > 5.0
        True
    """
    return read_motion(Path(path), load_robot(robot).robot)


@checked()
def export(
    model: str | Path | IdentifiedModel, path: str | Path, original: str | Path | None = None
) -> tuple[str, ...]:
    """Write an identified model as URDF (`.urdf`) or MJCF (`.xml`).

    Args:
        model: The model, its `model.json`, or the folder that holds it.
        path: File to make; it must not exist.
        original: The robot's own URDF, to put the numbers into; a file of the moving bodies alone
            is made if `None`.

    Returns:
        What the format cannot represent, one sentence each.

    Raises:
        SteelyardError: The file exists, its name ends otherwise, or the model lacks parameters.

    Example:
        >>> lost = export(load_model("arm-model"), "identified.urdf")
        >>> print(lost[0].split(":")[0])
        rotor inertia
    """
    target = Path(path)
    form = {".urdf": "urdf", ".xml": "mjcf"}.get(target.suffix.lower())
    if form is None or target.exists():
        raise OutputError(
            "the file exists already" if form else f"no format of files '{target.suffix}' is known",
            where=str(target),
            fix="give the name of a new file that ends in .urdf or .xml",
        )
    made = exported(load_model(model), "urdf" if form == "urdf" else "mjcf", original)
    with whole_file(target) as part:
        part.write_text(made.text, encoding="utf-8", newline="")
        refuse_changed(part, made)
    return tuple(made.unsupported)


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
