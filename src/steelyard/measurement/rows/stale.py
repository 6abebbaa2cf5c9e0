"""Stale rows: a row that repeats the positions of the one before while the robot moves."""

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.measurement.rows.outliers import without_long

MOVED = 3.0
"""Steps of the sensor that a joint must be expected to move from row to row."""
LONGEST_STALE = 4
"""Rows in a row that can be stale; more are a rest, or a gap that is not to be guessed across."""


def stale(q: Array, step: Array) -> NDArray[np.bool_]:
    """Whether each row repeats all positions of the row before though a joint moves, `(N,)`.

    Args:
        q: Positions, shape `(n, N)`.
        step: See `sensor_step`, shape `(n,)`.
    """
    marks = np.zeros(q.shape[1], dtype=np.bool_)
    same = (q[:, 1:] == q[:, :-1]).all(axis=0)
    rows = np.flatnonzero(same) + 1
    rows = rows[(rows >= LONGEST_STALE + 1) & (rows < q.shape[1] - LONGEST_STALE - 1)]
    if len(rows) == 0:
        return marks
    reach = LONGEST_STALE + 1
    ahead, behind = (np.abs(q[:, rows + side] - q[:, rows]) for side in (reach, -reach))
    pace = np.minimum(ahead, behind) / reach
    marks[rows[(pace > MOVED * step[:, None]).any(axis=0)]] = True
    kept: NDArray[np.bool_] = without_long(marks[None], LONGEST_STALE)[0]
    return kept
