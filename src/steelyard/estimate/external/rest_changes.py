r"""Changes of residuals while a robot rests: a push that friction at rest hides from a level.

At rest the friction of a joint lies anywhere in a dead zone, and stays where it is: not the
residual $r$ shows a push, but its change. Where all joints rest, the change is $r - s$ with a slow
mean $T\,\dot s = r - s$ that follows creep and settling drives.
"""

from collections import deque

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array
from steelyard.symbolic.native.compiled import recurrence

CREEP = 2.0  # time constant of the slow mean [s]
QUIET = 1.0  # changes count that long after the slow mean began [s]: stopped links swing

ONSET = 0.2
"""Changes that motion follows within that time [s] are not compared: efforts rise before a joint
breaks away."""


def low_passed(signals: Array, cutoff: float, rate: float) -> Array:
    """First-order low-pass along the last axis of finite signals, started from the first sample."""
    keep = np.exp(-2.0 * np.pi * cutoff / rate)
    decay, unbounded = (np.full((1, signals.shape[-1]), value) for value in (keep, np.inf))
    rows = signals.reshape(-1, 1, signals.shape[-1])
    slow = np.empty(rows.shape)
    for one, row in zip(slow, rows, strict=True):
        one[:] = recurrence(decay, (1.0 - keep) * row, unbounded, row[:, 0])[0]
    return slow.reshape(signals.shape)


def rests(t: Array, ranges: NDArray[np.intp], step: float) -> list[tuple[int, int]]:
    """First sample, and the one after the last, of every stretch in which all joints rest.

    A step of time of more than twice `step` ends a stretch; ranges are as of `ranges_of`.
    """
    calm = np.all(ranges == 0, axis=0)
    begins = calm & np.concatenate([[True], ~calm[:-1] | (np.diff(t) > 2.0 * step)])
    ends = calm & np.concatenate([~calm[1:] | (np.diff(t) > 2.0 * step), [True]])
    return list(zip(np.flatnonzero(begins), np.flatnonzero(ends) + 1, strict=True))


def changes_at_rest(t: Array, residual: Array, ranges: NDArray[np.intp], step: float) -> Array:
    """Change of the residual where all joints rest, NaN elsewhere, shape `(n, N)` [Nm; N]."""
    found = np.full(residual.shape, np.nan)
    if step > 0.5 * CREEP:
        return found  # too slow a log, or a wrong unit of time
    for start, stop in rests(t, ranges, step):
        some = residual[:, start:stop]
        change = some - _slow_mean(some, step)
        tested = slice(round(QUIET / step), max(0, stop - start - round(ONSET / step)))
        found[:, start:stop][:, tested] = change[:, tested]
    return found


def _slow_mean(signals: Array, step: float) -> Array:
    """Mean of the samples so far, shape `(n, N)`; from `CREEP` on it forgets."""
    first = min(signals.shape[1], round(CREEP / step))
    mean = np.cumsum(signals[:, :first], axis=1) / np.arange(1, first + 1)
    later = np.concatenate([mean[:, -1:], signals[:, first:]], axis=1)
    slow = low_passed(later, 1.0 / (2.0 * np.pi * CREEP), 1.0 / step)
    return np.concatenate([mean, slow[:, 1:]], axis=1)


class ChangeStepper:
    """Changes at rest sample by sample, each decided `ONSET` later.

    `change` is that of each joint, `(n,)` [Nm; N], at the `time` of the sample that was decided
    last [s]; NaN where none is tested.
    """

    def __init__(self, limits: Array) -> None:
        """Begin, with thresholds `(n,)` [Nm; N]; NaN where changes are not tested."""
        self._limits = limits
        self.begin()

    def begin(self) -> None:
        """Forget what was before, as after a gap."""
        self._start = self._t = np.inf
        self._count = 0
        self._later = deque[tuple[float, Array]]()
        self.time, self.change = np.nan, np.full(len(self._limits), np.nan)

    def step(self, t: float, resting: bool, residual: Array) -> NDArray[np.bool_]:
        """Whether the change of each joint exceeded its threshold `ONSET` ago, shape `(n,)`.

        `resting` says that all joints rest; residuals have the shape `(n,)` [Nm; N].
        """
        if not resting:
            self.begin()
            return np.zeros(len(self._limits), dtype=bool)
        if not self._count:
            self._start, self._slow = t, residual.copy()
        self._count += 1
        gain = max(1.0 / self._count, 1.0 - np.exp(-max(t - self._t, 0.0) / CREEP))
        self._slow += gain * (residual - self._slow)
        self._t = t
        if t - self._start >= QUIET:
            self._later.append((t, residual - self._slow))
            while self._later and t - self._later[0][0] >= ONSET:
                self.time, self.change = self._later.popleft()
        return np.asarray(np.abs(self.change) > self._limits)
