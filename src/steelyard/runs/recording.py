r"""A recording: a log, what its columns hold, its window, what is left out; unwrapped positions.

A joint that leaves $[a, a + 2\pi)$ comes in again at the other end. The jump is a turn, less what
the joint moves from row to row, from one end of all positions to the other; a joint that moves as
far in steps of its own never jumps so.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array, frozen
from steelyard.base.errors import LogError
from steelyard.logs.log_and_errors import ROWS_OF_PART, Cut, Log, RowRange, require_columns
from steelyard.robot.file.signals import Signals
from steelyard.runs.contact_projection import channels_of_touches, touch_channels
from steelyard.runs.floating_base import base_channels, contact_efforts
from steelyard.runs.rows.resampling import put_together

TURN = 2.0 * np.pi  # of a joint [rad]
WRAP_TESTED_ROWS = 100_000  # rows of a log that are looked at
NEAR_END_OF_RANGE = 0.5
"""How far a row beside a jump may be from the end of the range [rad]: 25 rad/s at 50 Hz."""


def wrapped_middles(parts: Iterable[Array]) -> Array:
    """Middle of the unwrapped positions of each joint that is wrapped, NaN of others, `(n,)` [rad].

    It is less than half a turn from zero. The parts are consecutive rows, `(N, n)` [rad].
    """
    q = np.concatenate(list(parts) or [np.zeros((0, 0))])
    return np.array([_middle(column[_usable(column)]) for column in q.T])


def _usable(q: Array) -> NDArray[np.bool_]:
    with np.errstate(invalid="ignore"):
        return np.asarray(np.abs(q) < 3.0 * TURN)


def _middle(q: Array) -> float:
    """Middle of a joint's unwrapped positions; NaN if it is not wrapped."""
    width = float(np.ptp(q)) if len(q) > 1 else 0.0
    if not TURN - 2.0 * NEAR_END_OF_RANGE < width < TURN + 1e-6:
        return np.nan
    jumps = np.abs(np.diff(q)) > TURN - 2.0 * NEAR_END_OF_RANGE
    before, after = q[:-1][jumps], q[1:][jumps]
    low = np.minimum(before, after) - q.min()
    high = q.max() - np.maximum(before, after)
    if not jumps.any() or max(low.max(), high.max()) > NEAR_END_OF_RANGE:
        return np.nan
    whole, _ = continuous(q, float(q[0]))
    middle = 0.5 * float(whole.min() + whole.max())
    return middle - TURN * round(middle / TURN)


def continuous(q: Array, near: float) -> tuple[Array, float]:
    """Positions `(N,)` [rad] without jumps of a turn, the first nearest to a value; and the last.

    Rows that are no position are left as they are.
    """
    usable = np.flatnonzero(_usable(q))
    if len(usable) == 0:
        return q, near
    found = q.copy()
    found[usable] -= TURN * np.cumsum(np.round(np.diff(q[usable], prepend=near) / TURN))
    return found, float(found[usable[-1]])


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


@dataclass(frozen=True)
class Channels:
    """Order of the channels beside time: positions, velocities if logged, efforts, contacts.

    Coordinates of a floating `base` come first; `contacts` are what these add to the efforts;
    `touches` channels say where there are others, see `steelyard.runs.contact_projection`.
    """

    joints: int
    velocities: bool
    base: int = 0
    contacts: bool = False
    touches: int = 0

    @property
    def count(self) -> int:
        """Number of channels, 2n to 4n, and those that say where contacts are."""
        return (2 + self.velocities + self.contacts) * self.joints + self.touches

    @property
    def q(self) -> slice:
        """Positions."""
        return slice(0, self.joints)

    @property
    def encoders(self) -> slice:
        """Positions without those of the base."""
        return slice(self.base, self.joints)

    @property
    def dq(self) -> slice:
        """Velocities; empty if they are not logged."""
        return slice(self.joints, self.effort.start)

    @property
    def effort(self) -> slice:
        """Efforts."""
        start = (1 + self.velocities) * self.joints
        return slice(start, start + self.joints)

    @property
    def pushed(self) -> slice:
        """What contacts add to the efforts; empty if none is logged."""
        return slice(self.effort.stop, self.count - self.touches)

    @property
    def touched(self) -> slice:
        """Where contacts are whose force is unknown; empty if there is none."""
        return slice(self.count - self.touches, self.count)


@dataclass(frozen=True, eq=False)
class LoggedSamples:
    """Rows in SI units: time `(N,)`; `q`, `dq` (`None` if not logged) and `effort`, `(N, n)`."""

    t: Array
    q: Array
    dq: Array | None
    effort: Array

    @classmethod
    def of(cls, t: Array, x: Array, c: Channels) -> "LoggedSamples":
        """From channels `(N, C)`."""
        return cls(t, x[:, c.q], x[:, c.dq] if c.velocities else None, x[:, c.effort])


@dataclass(frozen=True, eq=False)
class Recording:
    """What was measured in one run of a robot: a log, what its columns hold, its window.

    `middles` are those of the positions of each joint that is logged modulo a turn, NaN of others,
    shape `(n,)` [rad]; see `unwrapped`. What is `left_out` does not count.
    """

    log: Log
    signals: Signals
    cut: Cut = field(default_factory=Cut)
    middles: Array | None = None
    left_out: tuple[LeftOut, ...] = ()

    def __post_init__(self) -> None:
        require_columns(self.log.path, self.log.columns, self.signals.columns)

    def unwrapped(self) -> "Recording":
        """The same, with positions that jump by a turn made continuous."""
        if self.signals.position_map is not None:
            return self
        first = replace(self, middles=None).raw((0, WRAP_TESTED_ROWS))
        middles = wrapped_middles(x[:, self.channels.q] for _, x in first)
        middles[: self.channels.base] = np.nan
        return replace(self, middles=None if np.isnan(middles).all() else frozen(middles))

    @property
    def wrapped(self) -> tuple[str, ...]:
        """Columns of the positions that are made continuous."""
        if self.middles is None:
            return ()
        return tuple(self.signals.position[j] for j in np.flatnonzero(~np.isnan(self.middles)))

    @property
    def name(self) -> str:
        """The file's name without suffix, with the cut as written on the command line."""
        return self.log.path.stem + self.cut.text

    @property
    def where(self) -> str:
        """The file and the cut, for messages."""
        return f"{self.log.path}{self.cut.text}"

    @property
    def channels(self) -> Channels:
        """Order of the channels in `raw`."""
        s = self.signals
        contacts = s.base is not None and bool(s.base.contacts)
        touches = 0 if s.base is None else channels_of_touches(s.base)
        return Channels(s.n, s.velocity is not None, s.n_base, contacts, touches)

    def raw(self, rows: RowRange, size: int = ROWS_OF_PART) -> Iterator[tuple[Array, Array]]:
        """Time `(N,)` [s] and channels `(N, C)` in SI units of any rows, whatever the cut."""
        s = self.signals
        scales = (s.position_scale, s.velocity_scale, s.effort_scale)
        scale = np.concatenate([one for one in scales if one is not None])
        last = np.full(s.n, np.nan) if self.middles is None else self.middles.copy()
        if s.base is not None and not s.base.angular_velocity:
            last[3 : s.n_base] = 0.0  # angles of the base
        absent = [self.channels.effort.start + j - k for k, j in enumerate(s.unactuated)]
        for part in self.log.parts(s.columns, rows, size):
            with np.errstate(over="ignore", invalid="ignore"):
                t, logged = part[:, 0] * s.time_scale, put_together(part[:, 0], part[:, 1:])
                logged, pushes, flags, axes = self._of_base(logged)
                x = self._of_joints(np.insert(logged, absent, 0.0, axis=1) * scale)
                for j in np.flatnonzero(~np.isnan(last)):
                    x[:, j], last[j] = continuous(x[:, j], float(last[j]))
                if s.base is not None and s.base.contacts:
                    pushed = contact_efforts(s.base, x[:, self.channels.q], pushes, axes)
                    x = np.hstack([x, pushed / s.gains])
                if s.base is not None and s.base.touches:
                    x = np.hstack([x, touch_channels(s.base, flags, axes)])
            yield t, x

    def _of_base(self, logged: Array) -> tuple[Array, Array, Array, Array | None]:
        """Columns with those of a floating base first; forces and flags; axes of the base."""
        base = self.signals.base
        if base is None:
            return logged, logged[:, :0], logged[:, :0], None
        sizes = len(base.motion), len(base.pushes), len(base.flags)
        first = logged.shape[1] - sum(sizes)
        own, motion, pushes, flags = np.split(logged, np.cumsum([first, *sizes[:2]]), axis=1)
        channels, axes = base_channels(base, motion, str(self.log.path))
        return np.hstack([channels, own]), pushes, flags, axes

    def _of_joints(self, logged: Array) -> Array:
        """Channels of the joints from those logged at motors, or from another zero."""
        c, s = self.channels, self.signals
        if s.position_map is not None:
            logged[:, c.q] = logged[:, c.q] @ s.position_map.T
            if c.velocities:
                logged[:, c.dq] = logged[:, c.dq] @ s.position_map.T
        if s.position_offset is not None:
            logged[:, c.q] += s.position_offset
        if s.effort_map is not None:
            logged[:, c.effort] = logged[:, c.effort] @ s.effort_map.T
        return logged

    def in_memory(self, limit: int = ROWS_OF_PART) -> "Recording":
        """The same with its log in memory if it has fewer than `limit` rows, else unchanged."""
        parts = list(self.log.parts(self.signals.columns, (0, limit), limit))
        if not parts:
            raise LogError(
                "the log has no rows", where=str(self.log.path), fix="record or copy it again"
            )
        if sum(len(part) for part in parts) == limit:
            return self
        table = np.concatenate(parts)
        return replace(self, log=LogInMemory(self.log.path, self.signals.columns, table))


@dataclass(frozen=True, eq=False)
class LogInMemory:
    """A log in memory, so that several passes read the file once; table `(N, len(columns))`."""

    path: Path
    columns: tuple[str, ...]
    table: Array

    def parts(
        self, columns: Sequence[str], rows: RowRange = (0, None), size: int = ROWS_OF_PART
    ) -> Iterator[Array]:
        """The requested rows, in parts; see `Log`."""
        require_columns(self.path, self.columns, columns)
        table = self.table[slice(*rows)]
        if tuple(columns) != self.columns:
            table = table[:, [self.columns.index(c) for c in columns]]
        for i in range(0, len(table), size):
            yield table[i : i + size]
