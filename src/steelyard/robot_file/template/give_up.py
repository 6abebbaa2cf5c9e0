"""What is printed where columns cannot be assigned, and names of columns in words."""

import re
from collections.abc import Sequence
from typing import NoReturn

import numpy as np
from numpy.typing import ArrayLike

from steelyard.arrays import Array
from steelyard.errors import LogError
from steelyard.robot_file.column_names import Column

IN_FILE = (
    'set it in a robot file: [signals] time = "...", position = ["...", ...] and '
    "[signals.effort] columns = [...], kind = ..., unit = ... (`steelyard init` writes one)"
)


OF_MOTORS = (
    "the gears between motors and joints are needed: in a robot file (`steelyard init` writes one) "
    'set [signals] coordinates = "motor" and [robot.transmission] ratios = [turns of each motor '
    "per turn of its joint], with coupling = [...] where a motor turns with a second joint; and "
    "[signals.effort] columns = [...], kind = ..., side, unit = ..."
)

UNNAMED = re.compile(r"column_\d+")
"""Names that columns without a name have."""
LISTED = 3
"""Columns of a group that are all named."""


def give_up(wrong: str, columns: Sequence[str], fix: str = IN_FILE) -> NoReturn:
    """Refuse columns, with all their names.

    Raises:
        LogError: Always.
    """
    if all(map(UNNAMED.fullmatch, columns)):
        raise LogError(
            "the log's columns have no names: the file seems to have no header line",
            where=f"columns {columns[0]} to {columns[-1]}",
            fix=f"put a line of names before the numbers, such as time,q1,q2; or {fix}",
        )
    raise LogError(
        f"the log's columns cannot be assigned: {wrong}",
        where=f"columns {', '.join(columns)}",
        fix=fix,
    )


def finite(values: ArrayLike) -> Array:
    """The finite values of a column, shape `(N,)`."""
    array = np.asarray(values, dtype=np.float64)
    return array[np.isfinite(array)]


def listed(columns: Sequence[Column]) -> str:
    """Names of columns in words; of many, the first and the last."""
    if len(columns) > LISTED:
        return f"{columns[0].name} to {columns[-1].name} ({len(columns)} columns)"
    return ", ".join(c.name for c in columns)
