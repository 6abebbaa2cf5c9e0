r"""Positions that are logged modulo a turn: found by their jumps, and made continuous again.

A joint that leaves $[a, a + 2\pi)$ comes in again at the other end. The jump is a turn, less what
the joint moves from row to row, from one end of all positions to the other; a joint that moves as
far in steps of its own never jumps so.
"""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array

TURN = 2.0 * np.pi
"""Of a joint [rad]."""
ROWS = 100_000
"""Rows of a log that are looked at."""
NEAR = 0.5
"""How far a row beside a jump may be from the end of the range [rad]: 25 rad/s at 50 Hz."""


def wrapped_middles(parts: Iterable[Array]) -> Array:
    """Middle of the unwrapped positions of each joint that is wrapped, NaN of others, `(n,)` [rad].

    The middle is less than half a turn from zero.

    Args:
        parts: Positions of consecutive rows, shape `(N, n)` [rad].
    """
    kept: list[Array] = []
    for part in parts:
        kept.append(part)
        if sum(len(p) for p in kept) >= ROWS:
            break
    q = np.concatenate(kept)[:ROWS] if kept else np.zeros((0, 0))
    return np.array([_middle(column[_usable(column)]) for column in q.T])


def _usable(q: Array) -> NDArray[np.bool_]:
    with np.errstate(invalid="ignore"):
        usable: NDArray[np.bool_] = np.abs(q) < 3.0 * TURN
    return usable


def _middle(q: Array) -> float:
    """Middle of a joint's unwrapped positions; NaN if it is not wrapped."""
    width = float(np.ptp(q)) if len(q) > 1 else 0.0
    if not TURN - 2.0 * NEAR < width < TURN + 1e-6:
        return np.nan
    jumps = np.abs(np.diff(q)) > TURN - 2.0 * NEAR
    before, after = q[:-1][jumps], q[1:][jumps]
    low = np.minimum(before, after) - q.min()
    high = q.max() - np.maximum(before, after)
    if not jumps.any() or max(low.max(), high.max()) > NEAR:
        return np.nan
    whole, _ = continuous(q, float(q[0]))
    middle = 0.5 * float(whole.min() + whole.max())
    return middle - TURN * round(middle / TURN)


def continuous(q: Array, near: float) -> tuple[Array, float]:
    """Positions without jumps of a turn, the first one the nearest to a value; and the last one.

    Rows that are no position are left as they are.

    Args:
        q: Wrapped positions, shape `(N,)` [rad].
        near: Where the first one is nearest to [rad].
    """
    usable = np.flatnonzero(_usable(q))
    if len(usable) == 0:
        return q, near
    found = q.copy()
    found[usable] -= TURN * np.cumsum(np.round(np.diff(q[usable], prepend=near) / TURN))
    return found, float(found[usable[-1]])
