"""Rows of a run at which joints move, to recognise its motion, or its rows, in other logs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array, frozen
from steelyard.measurement.rows.clock import Scan
from steelyard.measurement.run import Run

MOST, LEAST = 600, 32
"""Rows that are kept of all runs together, and at least of each."""
MOST_ROWS = 500_000
"""Rows of a run that are looked at."""
SPEED_TIME = 0.1
"""Time over which a speed is taken to distinguish motion from rest [s]."""
DIGITS = 9
"""Significant digits that are kept."""


@dataclass(frozen=True, eq=False)
class Rows:
    """Clean rows of a run from first to last motion, as logged.

    Attributes:
        t: Time from the log's start, shape `(N,)` [s].
        q: Positions, shape `(N, n)` [rad; m].
        effort: Efforts, shape `(N, n)` [A, Nm or N].
        moving: Whether any joint moves, shape `(N,)`.
    """

    t: Array
    q: Array
    effort: Array
    moving: NDArray[np.bool_]

    def where(self, kept: NDArray[np.bool_]) -> "Rows":
        """Some of the rows, those where `kept`, shape `(N,)`."""
        return Rows(self.t[kept], self.q[kept], self.effort[kept], self.moving[kept])


@dataclass(frozen=True, eq=False)
class MotionSamples:
    """Rows of a run at which joints move.

    Attributes:
        run: The run's name.
        step: Time that one of them stands for [s].
        t: Time from the log's start, shape `(M,)` [s].
        q: Positions, shape `(M, n)` [rad; m].
        effort: Efforts as logged, shape `(M, n)` [A, Nm or N].
    """

    run: str
    step: float
    t: Array
    q: Array
    effort: Array

    def to_dict(self) -> dict[str, Any]:
        """As JSON values, with `DIGITS` significant digits."""
        return {
            "run": self.run,
            "step": self.step,
            "t": _short(self.t),
            "q": _short(self.q),
            "effort": _short(self.effort),
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> "MotionSamples":
        """The samples that `to_dict` wrote."""
        t = frozen(data["t"])
        q, effort = (frozen(data[name], (len(t), None)) for name in ("q", "effort"))
        return cls(data["run"], float(data["step"]), t, q, effort)


def _short(values: Array) -> Any:
    digits = np.vectorize(lambda x: float(f"{x:.{DIGITS}g}"), otypes=[np.float64])
    return digits(values).tolist() if values.size else values.tolist()


def rows_of(run: Run) -> Rows:
    """The rows of a run, the first `MOST_ROWS` of them."""
    c, (start, stop) = run.recording.channels, run.span
    parts, count = [], 0
    for piece in Scan(run.chain.clock, run.recording).pieces():
        inside = (piece.t >= start) & (piece.t <= stop)
        parts.append((piece.t[inside], piece.x[inside]))
        count += len(parts[-1][0])
        if count >= MOST_ROWS:
            break
    t = np.concatenate([t for t, _ in parts])
    x = np.concatenate([x for _, x in parts])
    q = x[:, c.q]
    return Rows(t, q, x[:, c.effort], _moving(t, q, run.rest_speed))


def _moving(t: Array, q: Array, rest_speed: Array) -> NDArray[np.bool_]:
    if len(t) < 3:
        return np.zeros(len(t), dtype=np.bool_)
    reach = max(1, round(0.5 * SPEED_TIME * (len(t) - 1) / max(t[-1] - t[0], 1e-9)))
    at = np.arange(len(t))
    early, late = np.maximum(at - reach, 0), np.minimum(at + reach, len(t) - 1)
    speed = np.abs(q[late] - q[early]) / np.maximum(t[late] - t[early], 1e-9)[:, None]
    found: NDArray[np.bool_] = (speed > 2.0 * rest_speed).any(axis=1)
    return found


def motion_samples(runs: Sequence[Run]) -> tuple[MotionSamples, ...]:
    """Evenly spread rows of each run at which joints move."""
    whole = max(sum(run.duration for run in runs), 1e-9)
    return tuple(_of_run(run, max(LEAST, round(MOST * run.duration / whole))) for run in runs)


def _of_run(run: Run, count: int) -> MotionSamples:
    return samples_of(run.name, rows_of(run), count)


def samples_of(name: str, rows: Rows, count: int = MOST) -> MotionSamples:
    """Evenly spread rows, about `count`, of those at which joints move."""
    at = np.unique(np.linspace(0, len(rows.t) - 1, count).round().astype(int))
    step = float(rows.t[-1] - rows.t[0]) / max(len(at) - 1, 1)
    at = at[rows.moving[at]]
    return MotionSamples(
        name, step, frozen(rows.t[at]), frozen(rows.q[at]), frozen(rows.effort[at])
    )
