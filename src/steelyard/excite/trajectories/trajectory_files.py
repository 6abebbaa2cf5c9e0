"""Motions from files: our own JSON, or a table of postures."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.checked_arguments import checked
from steelyard.base.errors import DataError, LogError, advice
from steelyard.base.files import read_json, write_json
from steelyard.excite.trajectories.exact_trajectories import (
    ChainedMotion,
    ExactTrajectory,
    PiecewiseMotion,
    SampledMotion,
    SlowedMotion,
    end_speeds,
)
from steelyard.excite.trajectories.fourier import FourierMotion
from steelyard.logs.formats import open_log
from steelyard.logs.log_and_errors import Log
from steelyard.robot.file.model_reading_and_loaded_robot import LoadedRobot
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.robot import Robot

UNITS = ("rad", "m", "s")  # that names of columns end in
_AT_REST = 1e-9  # speeds up to this are rounding [rad/s; m/s]


@dataclass(frozen=True, eq=False)
class MotionTable:
    """A table of times and postures; `start` is the time of its first row [s], zero of the motion.

    The motion rests at its ends unless the table states speeds of all joints there.
    """

    start: float
    motion: SampledMotion
    states_speeds: bool

    @property
    def unstopped(self) -> SampledMotion:
        """The motion with `end_speeds` where the table states no speeds."""
        t, q = self.motion.t, self.motion.q
        return self.motion if self.states_speeds else SampledMotion(t, q, end_speeds(t, q))


KINDS: dict[str, Callable[[Mapping[str, Any]], ExactTrajectory]] = {
    "fourier": FourierMotion.from_dict,
    "sampled": lambda v: SampledMotion(v["time_s"], v["q"], v.get("ends")),
    "piecewise": lambda v: PiecewiseMotion(v["breaks_s"], v["coefficients"]),
    "chained": lambda v: ChainedMotion(
        [trajectory_from_dict(part) for part in v["parts"]], int(v["times"])
    ),
    "trended": lambda v: replace(
        FourierMotion.from_dict(v["series"]),
        trend=PiecewiseMotion(v["trend"]["breaks_s"], v["trend"]["coefficients"]),
    ),
    "windowed": lambda v: FourierMotion.from_dict(v["series"]).ramped(
        v["posture"], float(v["ramp_s"])
    ),
    "slowed": lambda v: SlowedMotion(trajectory_from_dict(v["motion"]), float(v["factor"])),
}


def trajectory_from_dict(values: Mapping[str, Any]) -> ExactTrajectory:
    """The trajectory that `to_dict` described; `KeyError` or `ValueError` if it did not."""
    kind = values["kind"]
    if kind not in KINDS:
        raise ValueError(f"its kind is {kind!r}, and the known ones are {', '.join(KINDS)}")
    return KINDS[kind](values)


def read_motion(path: Path, robot: Robot) -> ExactTrajectory:
    """The motion in a file, `trajectory.json` or a `.csv` or `.parquet` table.

    A table has a column of times (`time_s`, `time` or `t`) and one of positions per joint: `q1_rad`
    (`q1_m`), `q1`, `q_NAME` or `NAME`. Where it has speeds of all joints too (`dq1_rad_s`, `dq1` or
    `dq_NAME`), it starts and ends with those of its first and last row, else at rest.
    """
    if not path.is_file():
        raise _refused(path, "the file does not exist", "check its name and folder")
    motion: ExactTrajectory
    if path.suffix == ".json":
        motion, names = read_named(path)
        if names is not None and names != list(robot.joint_names):
            raise _refused(
                path,
                f"the motion is for the joints {names}, the robot '{robot.name}' has "
                f"{list(robot.joint_names)}",
                "give a motion of this robot; to run it anyway, remove 'joints' from the file",
            )
    else:
        motion = read_table(path, robot).motion
    joints = motion.sample([0.0]).n_joints
    if joints != robot.n:
        raise _refused(
            path,
            f"the motion is one of {joints} joints, the robot has {robot.n}",
            "give a motion of this robot's joints",
        )
    return motion


def write_motion(path: Path, motion: ExactTrajectory, robot: Robot) -> None:
    """Write a motion as `trajectory.json`, with the names of the joints that it is for."""
    write_json(path, {"joints": list(robot.joint_names), **motion.to_dict()})


def read_named(path: Path) -> tuple[ExactTrajectory, list[str] | None]:
    """The motion in a `trajectory.json`, and the names of its joints if it has them."""
    return read_json(
        path,
        lambda values: (trajectory_from_dict(values), values.get("joints")),
        what="the motion",
        damaged="the file is not a steelyard motion",
        fix="give a trajectory.json that steelyard wrote, or a .csv or .parquet table",
        error=DataError,
    )


def read_table(path: Path, robot: Robot) -> MotionTable:
    """The table of a motion; columns and errors as of `read_motion`."""
    if not path.is_file():
        raise _refused(path, "the file does not exist", "check its name and folder")
    try:
        table = open_log(path)
    except LogError as error:
        raise _refused(
            path,
            f"the file is not a table: {error.wrong}",
            "give a .csv or .parquet file with a row of column names",
        ) from error
    names = {column.lower(): column for column in table.columns}
    wanted = [("time", ["time_s", "time", "t"])]
    for j, c in enumerate(robot.coordinates, start=1):
        # numbers of columns do not say whether they count the base
        numbered = [] if robot.floating else [f"q{j}_{c.unit}", f"q{j}"]
        wanted.append((f"joint '{c.name}'", [*numbered, f"q_{c.name}", c.name]))
    columns = [_numbers(table, _find(path, what, choices, names)) for what, choices in wanted]
    ends = _ends(table, names, robot)
    moving = None if ends is None or np.abs(ends).max() <= _AT_REST else ends
    try:
        motion = SampledMotion(columns[0], np.column_stack(columns[1:]), moving)
    except ValueError as error:
        raise _refused(path, str(error), "sort the rows by time and drop repeated ones") from error
    return MotionTable(float(columns[0][0]), motion, ends is not None)


def _ends(table: Log, names: Mapping[str, str], robot: Robot) -> Array | None:
    """Speeds in the first and the last row, shape `(2, n)`; `None` if not given."""
    found = []
    for j, joint in enumerate(robot.coordinates):
        choices = [f"dq{j + 1}_{joint.unit}_s", f"dq{j + 1}", f"dq_{joint.name.lower()}"]
        found += [names[choice] for choice in choices if choice in names][:1]
    if len(found) < robot.n:
        return None
    rows = _rows(table, found)
    ends = rows[[0, -1]] if len(rows) else np.zeros((2, robot.n))
    return ends if np.isfinite(ends).all() else None


def _rows(table: Log, columns: Sequence[str]) -> Array:
    """Columns of all rows, shape `(N, len(columns))`."""
    return np.concatenate([np.zeros((0, len(columns))), *table.parts(columns)])


def _find(path: Path, what: str, choices: Sequence[str], names: Mapping[str, str]) -> str:
    for choice in choices:
        if choice.lower() in names:
            return names[choice.lower()]
    stem, _, unit = choices[0].rpartition("_")
    inside = f" in {unit}" if stem and unit in UNITS else ""
    converted = f"a column '{choices[0]}'{inside}"
    raise _refused(
        path,
        f"no column for {what}",
        f"the table needs {converted}; convert other units; "
        + advice(choices[0], names.values(), "columns"),
    )


def _numbers(table: Log, name: str) -> Array:
    values = _rows(table, [name])[:, 0]
    good = np.isfinite(values)
    if not good.all():
        row = int(np.argmin(good)) + 1
        raise _refused(
            table.path,
            f"column '{name}' holds something other than a finite number in row {row}",
            "correct or drop that row",
        )
    return values


def _refused(path: Path, wrong: str, fix: str) -> DataError:
    return DataError(wrong, where=str(path), fix=fix)


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
