"""Postures along a straight line of the tool, one continuous branch of them."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import DataError
from steelyard.excitation.planned.inverse_kinematics import InverseKinematics

_STEP = 0.05
"""Steps along a line are this long at most [m]."""
_CHANGE = 0.3
"""From step to step no joint changes by more than this [rad; m]; else the step is halved."""
_END = 1.0 - 1e-9
"""A share of the line that is its end, but for rounding."""
_SHORTEST = 2.0**-12
"""A step this share of the line that still changes a posture too much is a jump."""


class Astray(DataError):
    """A way that cannot be followed, and how far it could.

    Attributes:
        progress: Moves that were followed, the last one as a fraction.
    """

    progress: float = 0.0


@dataclass(frozen=True, eq=False)
class Followed:
    """Postures along a line from one place to another.

    Attributes:
        solver: Of the inverse kinematics.
        ends: The two places, shape `(2, 3)` [m].
        shares: Shares of the line where postures are known, ascending from 0 to 1, shape `(k,)`.
        q: The postures there, shape `(k, n)` [rad; m].
    """

    solver: InverseKinematics
    ends: Array
    shares: Array
    q: Array

    def postures(self, shares: Array) -> Array | None:
        """Postures at shares `(N,)` of the line, `(N, n)`; `None` where they leave the branch."""
        targets = self.ends[0] + shares[:, None] * (self.ends[1] - self.ends[0])
        near = np.asarray(self._between(shares))
        found = self.solver.solve(targets, near, near=True)
        good = found.reached.all() and np.abs(found.q - near).max() < _CHANGE
        return found.q if good else None

    @cached_property
    def _between(self) -> Any:
        """A smooth guess between the known postures."""
        from scipy.interpolate import make_interp_spline

        return make_interp_spline(self.shares, self.q, k=3)


def follow(
    solver: InverseKinematics,
    ends: Array,
    start: Array,
    rest: Array,
    names: Sequence[str],
    *,
    to: Array | None = None,
    where: str,
) -> Followed:
    """Follow a straight line from a posture.

    Args:
        solver: Of the inverse kinematics.
        ends: The two places, shape `(2, 3)` [m].
        start: Posture at the first, shape `(n,)` [rad; m].
        rest: Posture that spare joints are drawn to, shape `(n,)`.
        names: Of the joints, for messages.
        to: Posture to arrive in, shape `(n,)`; any by default.
        where: The move, for messages.

    Raises:
        Astray: The line leaves what the joints can do, needs a jump, or arrives in another posture.
    """
    most = 1.0 / max(4, int(np.ceil(np.linalg.norm(ends[1] - ends[0]) / _STEP)))
    shares, postures, step = [0.0], [start], most
    while shares[-1] < 1.0:
        share = shares[-1] + step if shares[-1] + step < _END else 1.0
        target = ends[0] + share * (ends[1] - ends[0])
        found = solver.solve(target[None], postures[-1][None], near=True)
        change = found.q[0] - postures[-1]
        if found.reached[0] and np.abs(change).max() < _CHANGE:
            shares.append(share)
            postures.append(solver.drawn(target, found.q[0], rest))
            step = min(most, 2.0 * step)
        elif step > _SHORTEST:
            step *= 0.5
        else:
            raise _stuck(solver, found.q[0], change, bool(found.reached[0]), share, names, where)
    followed = Followed(solver, ends, np.array(shares), np.array(postures))
    return followed if to is None else _arriving(followed, to, names, where)


def _arriving(followed: Followed, to: Array, names: Sequence[str], where: str) -> Followed:
    """The same line, its spare joints led to a given posture at the end."""
    off = to - followed.q[-1]
    if followed.solver.spare <= 0:
        if np.abs(off).max() > 1e-6:
            raise _other_posture(off, names, where)
        return followed
    s = followed.shares
    blend = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    line = followed.ends[0] + s[:, None] * (followed.ends[1] - followed.ends[0])
    found = followed.solver.solve(line, followed.q + blend[:, None] * off, near=True)
    far = np.abs(found.q[-1] - to).max() > 1e-6
    if far or not found.reached.all() or np.abs(np.diff(found.q, axis=0)).max() > 2.0 * _CHANGE:
        raise _other_posture(off, names, where)
    return Followed(followed.solver, followed.ends, s, found.q)


def _stuck(
    solver: InverseKinematics,
    q: Array,
    change: Array,
    reached: bool,
    share: float,
    names: Sequence[str],
    where: str,
) -> Astray:
    """What stops a line: the end of a joint's range, or a posture that would have to jump."""
    at = f"after {100.0 * share:.0f} % of its way"
    ended = [
        f"'{name}' at its {end} limit"
        for name, low, high in zip(names, q <= solver.lower, q >= solver.upper, strict=True)
        for end, there in (("lower", low), ("upper", high))
        if there
    ]
    j = int(np.argmax(np.abs(change)))
    if ended:
        wrong = f"the straight line ends {at}: joint {', joint '.join(ended)}"
    elif not reached:
        wrong = f"the straight line leaves the reachable workspace {at}"
    else:
        wrong = f"joint '{names[j]}' would have to jump by {change[j]:.2f} {at} of a straight line"
    return astray(wrong, where, share)


def _other_posture(off: Array, names: Sequence[str], where: str) -> Astray:
    j = int(np.argmax(np.abs(off)))
    return astray(
        f"the posture at the end of the straight line differs from that of the motion: joint "
        f"'{names[j]}' is off by {abs(off[j]):.2f}",
        where,
        1.0,
    )


def astray(wrong: str, where: str, share: float) -> Astray:
    """The error, with what helps against it."""
    error = Astray(
        wrong,
        where=where,
        fix="use path = 'joint' or another start posture, leave the tool's orientation free, or "
        "move the points away from the limit of the reach and from the base",
    )
    error.progress = share
    return error
