"""An outside wrench on a frame of the virtual robot, over time."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from steelyard.arrays import Array, frozen
from steelyard.errors import DataError, LogError
from steelyard.formats import open_log

COLUMNS = ("fx_N", "fy_N", "fz_N", "tx_Nm", "ty_Nm", "tz_Nm")
"""Force and torque, in files and in logs."""

Axes = Literal["base", "frame"]


@dataclass(frozen=True, eq=False)
class AppliedWrench:
    """Forces and torques that act on a robot at the origin of a frame.

    Attributes:
        frame: Name of a frame or link.
        t: Times from the start of the log, increasing, shape `(K,)` [s].
        values: Force and torque from each time until the next one, shape `(K, 6)` [N, Nm]; zero
            before the first time, the last row stays.
        axes: Whether they are along the axes of the base or of the frame.
    """

    frame: str
    t: Array
    values: Array
    axes: Axes = "base"

    def __post_init__(self) -> None:
        object.__setattr__(self, "t", frozen(self.t, (None,)))
        object.__setattr__(self, "values", frozen(self.values, (len(self.t), 6)))
        finite = np.isfinite(self.t).all() and np.isfinite(self.values).all()
        if not len(self.t) or not finite or not np.all(np.diff(self.t) > 0.0):
            raise DataError(
                "times do not increase, or a value is no finite number",
                where=f"wrench on '{self.frame}'",
                fix="give rows with increasing times and six finite numbers each",
            )

    def at(self, t: Array) -> Array:
        """Force and torque at times `t`, shape `(N,)`: shape `(N, 6)`."""
        rows = np.searchsorted(self.t, t, side="right")
        return np.concatenate([np.zeros((1, 6)), self.values])[rows]


def read_wrench(path: Path, frame: str, axes: Axes = "base") -> AppliedWrench:
    """The wrench in a table with the columns `time_s`, `fx_N` to `fz_N`, `tx_Nm` to `tz_Nm`.

    Raises:
        DataError: The file cannot be read, or a column is missing.
    """
    names = ("time_s", *COLUMNS)
    try:
        table = open_log(path)
        missing = [name for name in names if name not in table.columns]
        rows = None if missing else np.concatenate([np.zeros((0, 7)), *table.parts(names)])
    except LogError as error:
        raise DataError(error.wrong, where=error.where, fix=error.fix) from error
    if rows is None:
        raise DataError(
            f"the wrench has no column '{missing[0]}'",
            where=str(path),
            fix=f"give the columns {', '.join(names)}",
        )
    return AppliedWrench(frame, rows[:, 0], rows[:, 1:], axes)
