"""Broken rows: what no sensor can have measured is dropped and counted."""

from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.measurement.recording import Channels

ABSURD = 1e6
"""Largest value that any channel can have in SI units: memory garbage is far above."""
FASTEST = 60.0
"""Largest joint speed [rad/s; m/s]: a little more than the flange of a SCARA robot reaches."""
STEADY = 20.0
"""Largest joint speed over more than one step of the clock, where jitter matters less."""


class Verdict(IntEnum):
    """What became of a row."""

    KEPT = 0
    UNREADABLE = 1
    ABSURD = 2
    REPEATED = 3
    BACKWARD = 4
    JUMP = 5

    @property
    def reason(self) -> str:
        """Why the row was dropped, for reports."""
        return _REASONS[self]


_REASONS = {
    Verdict.KEPT: "kept",
    Verdict.UNREADABLE: "a cell that is missing or not a number",
    Verdict.ABSURD: "an implausible value",
    Verdict.REPEATED: "a repeated time stamp",
    Verdict.BACKWARD: "a time stamp before the previous one",
    Verdict.JUMP: "a single jump of time or position",
}


def broken(t: Array, x: Array, channels: Channels) -> NDArray[np.uint8]:
    """A verdict per row, judged by the row alone.

    Args:
        t: Time, shape `(N,)` [s].
        x: Channels in SI units, shape `(N, C)`.
        channels: Their order.

    Returns:
        Shape `(N,)`: `KEPT`, `UNREADABLE` or `ABSURD`.
    """
    verdict = np.zeros(len(t), dtype=np.uint8)
    with np.errstate(invalid="ignore"):
        absurd = ~np.isfinite(t) | (np.abs(x) > ABSURD).any(axis=1)
        if channels.velocities:
            absurd |= (np.abs(x[:, channels.dq]) > FASTEST).any(axis=1)
    verdict[absurd] = Verdict.ABSURD
    verdict[np.isnan(t) | np.isnan(x).any(axis=1)] = Verdict.UNREADABLE
    return verdict
