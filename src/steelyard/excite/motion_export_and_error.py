r"""Formats of motions by name, and how far a controller may leave the motion between points.

With points a step $h$ apart, straight lines stay within $h^2 \max|\ddot q| / 8$, and lines whose
corners are rounded from half step to half step within $h^2 \max|\ddot q| / 4$. The error of a cubic
spline is taken at times $\delta$ apart; between them it is greater by at most
$\delta^2 \max|\ddot s - \ddot q| / 8$, and $\ddot s$ is greatest at a point.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import inf
from pathlib import Path

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import OutputError, advice
from steelyard.base.files import whole_file
from steelyard.excite.collision.workspace_from_tables import WALL_RESERVE
from steelyard.excite.constraints.constraint import Gap
from steelyard.excite.design_from_tables import Designed
from steelyard.excite.motion_file_formats import (
    csv_of,
    even_times,
    joint_trajectory_of,
    keyframes_of,
    krl_of,
    rapid_of,
    urscript_of,
)
from steelyard.excite.trajectories.trajectory import ExactTrajectory
from steelyard.robot.robot import Robot


@dataclass(frozen=True)
class Export:
    """A format of motions: the text of its file, and points a second if none are requested.

    What a controller does `between` points, see `error_between`; `None` if the file is for none.
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


def exported(
    trajectory: ExactTrajectory, robot: Robot, form: str, rate: float | None = None
) -> str:
    """A motion as the text of a file in a format of `EXPORTS`, with `rate` points a second."""
    export = _format_of_name(form)
    rate = export.rate if rate is None else rate
    if not 0.0 < rate < inf:
        raise OutputError(
            f"{rate:g} points per second are not a valid rate",
            where="rate of the export",
            fix="give a number of points per second above 0",
        )
    return export.text(trajectory, robot, rate)


def write_export(
    trajectory: ExactTrajectory, robot: Robot, form: str, folder: Path, rate: float | None = None
) -> Path:
    """Write a motion to a folder, under the format's file name; the file."""
    path = folder / _format_of_name(form).file
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


def _format_of_name(form: str) -> Export:
    if form not in EXPORTS:
        raise OutputError(
            f"there is no format '{form}' for motions",
            where="format of the export",
            fix=advice(form, EXPORTS, "formats"),
        )
    return EXPORTS[form]


_SAMPLES_PER_STEP = 64
_RATE_FACTOR = 1.15
_MOST_ADVISED_RATE = 2000.0
_SPLINE_ERROR = 1e-6


def error_between(trajectory: ExactTrajectory, between: str, rate: float) -> Array:
    """Bound of what a controller leaves a motion by between points, shape `(n,)` [rad; m].

    Between them it does `lines`, `rounded lines`, `cubic spline` or `quintic splines`, of which
    there are as many as they need.
    """
    if between == "quintic splines":
        return np.full(len(trajectory.extremes(0)[0]), _SPLINE_ERROR)
    steepest = np.maximum(*(np.abs(x) for x in trajectory.extremes(2)))
    if between != "cubic spline":
        return np.asarray(steepest / rate**2 / (4.0 if between == "rounded lines" else 8.0))
    from scipy.interpolate import CubicSpline

    times = even_times(trajectory.duration, rate)
    spline = CubicSpline(times, trajectory.derivative(times, 0), bc_type="clamped")
    fine = np.linspace(0.0, trajectory.duration, _SAMPLES_PER_STEP * (len(times) - 1) + 1)
    seen = np.abs(spline(fine) - trajectory.derivative(fine, 0)).max(axis=0)
    bend = np.abs(spline(times, 2)).max(axis=0) + steepest
    return np.asarray(seen + bend * fine[1] ** 2 / 8.0)


def gaps_of_files(designed: Designed, forms: Sequence[str], rate: float | None) -> list[Gap]:
    """What is not proven of files for controllers, one sentence each.

    None of a motion whose certificate does not hold.
    """
    if not designed.certificate.holds:
        return []
    return [
        Gap(text)
        for export in (EXPORTS[form] for form in forms)
        if export.between is not None
        for text in _gap_of_file(designed, export, export.between, rate or export.rate)
    ]


def _gap_of_file(designed: Designed, export: Export, between: str, rate: float) -> list[str]:
    """What the way between the points of one file lacks, none or one sentence."""
    trajectory = designed.trajectory
    error = error_between(trajectory, between, rate)
    lower, upper = trajectory.extremes(0)
    labels, margins, rates = list[str](), list[float](), [np.zeros((0, designed.robot.n))]
    for constraint, proof in zip(designed.constraints, designed.certificate.proofs, strict=True):
        reaches = constraint.reaches(lower - error, upper + error)
        if reaches is not None:
            labels, margins = [*labels, *proof.labels], [*margins, *proof.proven]
            rates.append(reaches)

    def lack(error: Array) -> tuple[float, int]:
        """How much the margin that lacks most lacks [m], and its number."""
        left = np.array(margins) - np.concatenate(rates) @ error
        k = int(np.argmin(left)) if len(left) else -1
        return (-float(left[k]), k) if k >= 0 else (0.0, k)

    most, number = lack(error)
    if not most > WALL_RESERVE:
        return []
    enough = rate
    while enough <= _MOST_ADVISED_RATE and lack(error)[0] > WALL_RESERVE:
        enough = float(np.ceil(_RATE_FACTOR * enough))
        error = error_between(trajectory, between, enough)
    millimetres = 1e3 * most
    words = f"{millimetres:.0f}" if millimetres >= 10.0 else f"{millimetres:.2g}"
    fix = f"; --rate {enough:g} is enough" if enough <= _MOST_ADVISED_RATE else ""
    return [
        f"{export.file} has {rate:g} points per second; between them ({between}) a controller may "
        f"violate a constraint by up to {words} mm: {labels[number]}{fix}"
    ]
