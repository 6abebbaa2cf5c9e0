"""Stretches of a recording that are left out: where they are, whose they are, and why."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array

FROZEN = "an encoder is frozen: its position stops within one row while others move"
DEAD = "they keep one value while the joint moves: they are not measured there"


@dataclass(frozen=True)
class LeftOut:
    """A stretch of a recording that does not count.

    Attributes:
        start: Its first time, from the log's start [s].
        stop: Its last time [s].
        reason: What is wrong there, in a few words.
        joints: Numbers of the joints whose efforts do not count; empty if positions are wrong, so
            that no row of the stretch is used.
    """

    start: float
    stop: float
    reason: str
    joints: tuple[int, ...] = ()

    def words(self, names: Sequence[str]) -> str:
        """What is left out and why, by the names of all joints."""
        when = f"{self.start:.4g} to {self.stop:.4g} s"
        if not self.joints:
            return f"{when} left out: {self.reason}"
        every = len(self.joints) == len(names) > 1
        whose = "all joints" if every else ", ".join(names[j] for j in self.joints)
        return f"efforts of {whose} from {when} left out: {self.reason}"


def rows_left_out(t: Array, stretches: Iterable[LeftOut]) -> NDArray[np.bool_]:
    """Whether no joint of a row at each time `(N,)` counts."""
    whole = [s for s in stretches if not s.joints]
    return np.asarray(sum((t >= s.start) & (t <= s.stop) for s in whole) > np.zeros(len(t)))


def efforts_left_out(
    t: Array, joints: int, stretches: Iterable[LeftOut], spread: float
) -> NDArray[np.bool_] | None:
    """Whether the effort of each joint does not count at times `(N,)`, shape `(n, N)`.

    The `spread` around a stretch, which filters mix with it, does not count either [s]. `None`
    where all count.
    """
    found = [
        s for s in stretches if s.joints and t[0] <= s.stop + spread and t[-1] >= s.start - spread
    ]
    if not found:
        return None
    marks = np.zeros((joints, len(t)), dtype=np.bool_)
    for s in found:
        marks[list(s.joints)] |= (t >= s.start - spread) & (t <= s.stop + spread)
    return marks
