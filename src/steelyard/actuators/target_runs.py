"""Logs of targets and positions in memory, cut into windows; targets are held between rows."""

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from steelyard.base.arrays import Array, frozen

SIGHT = 1e-4  # over which a held target is averaged [s]


@dataclass(frozen=True, eq=False)
class TargetRun:
    """What was commanded and measured in one log, in the log's signs and zeros, SI units.

    Attributes:
        name: Of the log.
        t: Times `(N,)`, rising [s].
        target: Targets `(N, n)`, each held until the next row.
        q: Positions `(N, n)`.
        supply: Voltage that actuators are fed with, over the nominal one, `(N,)`; or empty: 1.
        effort: Logged efforts in their base units `(N, n)`, NaN where there are none; or empty.
    """

    name: str
    t: Array
    target: Array
    q: Array
    supply: Array = field(default_factory=lambda: frozen(np.zeros(0)))
    effort: Array = field(default_factory=lambda: frozen(np.zeros((0, 0))))

    def supplied(self, t: Array) -> Array:
        """The supply at times `(K,)`."""
        return np.interp(t, self.t, self.supply) if len(self.supply) else np.ones(len(t))

    @property
    def seconds(self) -> float:
        """Length [s]."""
        return float(self.t[-1] - self.t[0])

    def _integral(self) -> tuple[Array, Array]:
        """Knots and the integral of the target up to them, one step behind the last row."""
        last = float(np.median(np.diff(self.t)))
        knots = np.append(self.t, self.t[-1] + last)
        parts = self.target * np.diff(knots)[:, None]
        return knots, np.concatenate([np.zeros((1, self.q.shape[1])), np.cumsum(parts, axis=0)])

    def target_at(self, t: Array, delay: Array) -> Array:
        """Targets that are held just before times `(K,)`, seen late, `(K, n)`."""
        return self.mean_target(t - SIGHT, SIGHT, delay)[0]

    def mean_target(self, start: Array, h: float, delay: Array) -> tuple[Array, Array]:
        """Mean target over steps of `h` from `start` `(K,)`, seen late; and its slope by the delay.

        Both `(K, n)`. Before the first row and behind the last one the target is held.
        """
        knots, integral = self._integral()
        mean, slope = np.empty((2, len(start), self.q.shape[1]))
        for j, late in enumerate(delay):
            ends = []
            for t in (start - late, start + h - late):
                inside = np.clip(t, knots[0], knots[-1])
                before = np.minimum(t - knots[0], 0.0) * self.target[0, j]
                behind = np.maximum(t - knots[-1], 0.0) * self.target[-1, j]
                row = np.clip(np.searchsorted(self.t, t, side="right") - 1, 0, None)
                total = np.interp(inside, knots, integral[:, j]) + before + behind
                ends.append((total, self.target[row, j]))
            (first, from_), (last, to) = ends
            mean[:, j], slope[:, j] = (last - first) / h, (from_ - to) / h
        return mean, slope


@dataclass(frozen=True, eq=False)
class Window:
    """Rows `start:stop` of a run; a rollout begins at the first one.

    `position` and `velocity` are those that it begins with, `(n,)`.
    """

    run: TargetRun
    start: int
    stop: int
    position: Array
    velocity: Array

    @property
    def t(self) -> Array:
        """Times of its rows [s]."""
        return self.run.t[self.start : self.stop]

    @property
    def q(self) -> Array:
        """Its positions `(N, n)`."""
        return self.run.q[self.start : self.stop]


LEAST_ROWS = 10  # of a window


def windows_of(runs: Iterable[TargetRun], seconds: float | None) -> list[Window]:
    """Runs cut into windows of about these seconds each, or whole."""
    found = []
    for run in runs:
        count = 1 if seconds is None else max(1, round(run.seconds / seconds))
        edges = np.linspace(run.t[0], run.t[-1], count + 1)
        rows = np.searchsorted(run.t, edges)
        rows[-1] = len(run.t)
        for a, b in zip(rows[:-1].tolist(), rows[1:].tolist(), strict=True):
            if b - a >= LEAST_ROWS:
                found.append(Window(run, a, b, *_state(run, a)))
    return found


def _state(run: TargetRun, row: int, reach: int = 2) -> tuple[Array, Array]:
    """Position and velocity at a row, by a line through its neighbours.

    An encoder's steps and noise matter less so.
    """
    part = slice(max(0, row - reach), row + reach + 1)
    t = run.t[part] - run.t[part].mean()
    velocity = t @ run.q[part] / (t @ t)
    position = run.q[part].mean(axis=0) + velocity * (run.t[row] - run.t[part].mean())
    return frozen(position), frozen(velocity)
