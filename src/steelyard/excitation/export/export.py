"""Motions as files that robots and simulators follow."""

from collections.abc import Callable
from dataclasses import dataclass
from math import inf
from pathlib import Path

from steelyard.errors import OutputError
from steelyard.excitation.export.controllers import krl_of, rapid_of, urscript_of
from steelyard.excitation.export.ros import joint_trajectory_of
from steelyard.excitation.export.tables import csv_of, keyframes_of
from steelyard.excitation.trajectories.exact import ExactTrajectory
from steelyard.files import whole_file
from steelyard.robot.robot import Robot
from steelyard.suggest import advice


@dataclass(frozen=True)
class Export:
    """A format of motions.

    Attributes:
        title: What it is.
        file: Name of the file.
        text: The file's content, from a motion, its robot and points a second.
        rate: Points a second, if none is requested.
        between: What a controller does between points, see `between_points`; `None` if the file
            is for none.
    """

    title: str
    file: str
    text: Callable[[ExactTrajectory, Robot, float], str]
    rate: float
    between: str | None = None


EXPORTS: dict[str, Export] = {
    "csv": Export("CSV table", "trajectory.csv", csv_of, 500.0, "lines"),
    "ros2": Export(
        "ROS 2 JointTrajectory", "trajectory.yaml", joint_trajectory_of, 20.0, "quintic splines"
    ),
    "urscript": Export("URScript", "trajectory.script", urscript_of, 500.0, "lines"),
    "krl": Export("KUKA KRL", "trajectory.src", krl_of, 10.0, "cubic spline"),
    "rapid": Export("ABB RAPID", "trajectory.mod", rapid_of, 10.0, "rounded lines"),
    "mujoco": Export("MuJoCo keyframes", "trajectory.xml", keyframes_of, 50.0),
}
"""Formats by the name that requests them."""


def exported(
    trajectory: ExactTrajectory, robot: Robot, form: str, rate: float | None = None
) -> str:
    """A motion as the text of a file.

    Args:
        trajectory: The motion.
        robot: Its robot: names, kinds and order of the joints.
        form: One of `EXPORTS`.
        rate: Points a second; the format's own if `None`.

    Raises:
        OutputError: There is no such format, or it cannot hold this motion of this robot.
    """
    export = _format(form)
    rate = export.rate if rate is None else rate
    if not 0.0 < rate < inf:
        raise OutputError(
            f"{rate:g} points per second are not a valid rate",
            where="rate of the export",
            fix="give a number of points per second above 0",
        )
    return export.text(trajectory, robot, rate)


def write_export(
    trajectory: ExactTrajectory,
    robot: Robot,
    form: str,
    folder: Path,
    rate: float | None = None,
) -> Path:
    """Write a motion to a folder, under the format's file name; the file.

    Raises:
        OutputError: As `exported`, or the file exists already or cannot be written.
    """
    path = folder / _format(form).file
    if path.exists():
        raise OutputError(
            "the file exists already",
            where=str(path),
            fix="name another folder, or remove the file",
        )
    text = exported(trajectory, robot, form, rate)
    with whole_file(path) as part:
        part.write_text(text, encoding="utf-8", newline="\n")
    return path


def _format(form: str) -> Export:
    if form not in EXPORTS:
        raise OutputError(
            f"there is no format '{form}' for motions",
            where="format of the export",
            fix=advice(form, EXPORTS, "formats"),
        )
    return EXPORTS[form]
