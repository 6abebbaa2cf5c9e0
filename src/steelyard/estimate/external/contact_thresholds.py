r"""Maxima of the residuals of free motion, their Pareto tail, and contact thresholds from them.

A joint's speed is divided into ranges: rest, turning, slow, medium, fast. Of every visit to a
range the largest residual $\max |r|$ is kept: residuals of neighbouring samples are alike, those of
visits much less. A threshold $x$ of a range is exceeded $\zeta\,P(\max |r| > x)$ times per hour in
that range, with $\zeta$ visits per hour. Above a base $u$, which $k$ of $n$ maxima exceed, $P$
follows a generalised Pareto law [Coles2001],

$$ P(\max|r| > x) = \frac{k}{n} \left(1 + \xi \frac{x - u}{s}\right)^{-1/\xi} , $$

whose shape $\xi$ and scale $s$ are uncertain. Laws are weighted by how they explain the maxima,
$p(\xi, s \mid \text{maxima})$; the threshold suffices for `RATE_CONFIDENCE` of them, so that few
maxima raise it. All joints share the shape of a range, each has a scale of its own.

At rest the friction of a joint lies anywhere in a dead zone, and stays where it is: not the
residual $r$ shows a push, but its change. Where all joints rest, the change is $r - s$ with a slow
mean $T\,\dot s = r - s$ that follows creep and settling drives. Changes have maxima and thresholds
of their own; both tests at rest share the false alarms allowed there.
"""

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array, finite_json, frozen, of_json_values
from steelyard.symbolic.native.compiled_programs import recurrence

SHAPE = (0.1, 0.2)  # mean and standard deviation of the tail's shape before the data
_SHAPES = np.linspace(-0.5, 0.9, 36)[:, None] + 1e-9  # shapes of Pareto laws that are compared

LOG_PRIOR = -0.5 * np.square((_SHAPES[:, 0] - SHAPE[0]) / SHAPE[1])
"""Logarithm of what is known of the shape before the data."""
CREEP = 2.0  # time constant of the slow mean [s]
QUIET = 1.0  # changes count that long after the slow mean began [s]: stopped links swing

ONSET = 0.2
"""Changes that motion follows within that time [s] are not compared: efforts rise before a joint
breaks away."""


@dataclass(frozen=True, eq=False)
class Tail:
    """Maxima above a base: a generalised Pareto law whose shape and scale are uncertain."""

    base: float  # [Nm; N]
    excesses: Array  # what the maxima exceed it by, positive, `(k,)` [Nm; N]

    @classmethod
    def of(cls, maxima: Array, visits: float) -> "Tail":
        """That of the largest maxima of some visits, which fall."""
        count = int(min(max(FEWEST, TAIL_SIZE * np.sqrt(visits)), len(maxima) - 1))
        base, least = float(maxima[count]), 1e-9 * max(float(maxima[0]), 1e-300)
        return cls(base, frozen(np.maximum(maxima[:count] - base, least)))

    @cached_property
    def _scales(self) -> Array:
        return np.asarray(np.mean(self.excesses) * np.geomspace(0.1, 10.0, 60)[None])

    @cached_property
    def _log_likelihood(self) -> Array:
        """Of shapes and scales."""
        inside = 1.0 + _SHAPES[..., None] * self.excesses / self._scales[..., None]
        logs = np.log(np.maximum(inside, 1e-300)).sum(axis=-1)
        found = -len(self.excesses) * np.log(self._scales) - (1.0 / _SHAPES + 1.0) * logs
        return np.where((inside > 0.0).all(axis=-1), found, -np.inf)

    @cached_property
    def log_shape(self) -> Array:
        """Logarithm of the likelihood of every shape, over all scales."""
        highest = self._log_likelihood.max()
        return np.asarray(np.log(np.exp(self._log_likelihood - highest).sum(axis=1) + 1e-300))

    def size(self, probability: float, log_shape: Array) -> float:
        """The size that a maximum above the base exceeds with a probability; the base from 1 on.

        It holds for `RATE_CONFIDENCE` of the laws, weighted by how they explain the maxima and by
        `log_shape`, the logarithm of what is known otherwise of every shape.
        """
        if probability >= 1.0:
            return self.base
        logs = self._log_likelihood + log_shape[:, None]
        weights = np.exp(logs - logs.max()).ravel()
        excesses = (self._scales * (probability**-_SHAPES - 1.0) / _SHAPES).ravel()
        order = np.argsort(excesses)
        share = np.cumsum(weights[order]) / weights.sum()
        return self.base + float(excesses[order][np.searchsorted(share, RATE_CONFIDENCE)])


RATE_CONFIDENCE = 0.975
"""Share of the tail's laws, by how they explain the maxima, for which a threshold suffices. With
0.95 thresholds were 2 to 3 % lower after 50 minutes of free motion, 15 % after four, and simulated
arms had as many alarms as stated: a rate is to be an upper bound (`proofs.uses.contact_rates`)."""

RANGES = ("rest", "turning", "slow", "medium", "fast")
"""Ranges of a joint's speed; it is turning where it starts, stops or reverses."""

CHANGE = len(RANGES)  # column of the maxima of changes at rest, after those of the ranges
TESTS = np.array([0.5, 1.0, 1.0, 1.0, 1.0, 0.5])  # false alarms per column: two test rest
LONGEST_VISIT = 1.0  # longest visit in motion [s]; longer stays count several times

HOLD = 0.15
"""A faster range begins that long after the last sample in a slower one [s]: the residual's filter
and the friction of a joint that starts to move remember."""

MOST_KEPT = 200  # maxima kept per joint and range
TAIL_SIZE = 3.0  # maxima in the tail of a range over the root of its visits
SETTLED = 0.5  # rest begins that long after the last motion [s]: an abrupt stop makes robots swing
FEWEST = 10  # maxima that the tail of a range needs
EXTRAPOLATION = 10.0  # most times between false alarms over the length of the calibration


@dataclass(frozen=True, eq=False)
class ResidualPeaks:
    """Largest residuals of visits to ranges of speed, in motion without contact; last, at rest."""

    # speeds at which ranges meet, rest and turning at the first, `(n, 3)` [rad/s; m/s]
    edges: Array
    cutoff: float  # of the low-pass behind which the residuals were taken [Hz]
    # per joint and range the largest maxima, falling, at most `MOST_KEPT` [Nm; N]
    maxima: tuple[tuple[Array, ...], ...]
    visits: Array  # visits, `(n, 6)`
    seconds: Array  # time spent, `(n, 6)` [s]

    def __add__(self, other: "ResidualPeaks") -> "ResidualPeaks":
        """Visits of both; the ranges and the cut-off must be the same."""
        maxima = tuple(
            tuple(_largest(np.concatenate(pair)) for pair in zip(*rows, strict=True))
            for rows in zip(self.maxima, other.maxima, strict=True)
        )
        return ResidualPeaks(
            self.edges,
            self.cutoff,
            maxima,
            frozen(self.visits + other.visits),
            frozen(self.seconds + other.seconds),
        )

    @property
    def duration(self) -> float:
        """Time that the residuals were taken from [s]."""
        return float(self.seconds[:, :CHANGE].sum(axis=1).max(initial=0.0))

    @property
    def lowest_rate(self) -> float:
        """Least false alarms per hour that this much motion supports."""
        return 3600.0 / (EXTRAPOLATION * self.duration) if self.duration else np.inf

    def thresholds(self, rate: float, friction: Array | float = 0.0) -> "ContactThresholds":
        """Thresholds that free motion exceeds at a rate per hour, of all joints together.

        Every joint may cause its share of the false alarms. A range that was visited less than
        `FEWEST` times takes the largest threshold of its joint, increased by friction [Nm; N];
        changes at rest are then not tested.
        """
        limits = np.full(self.visits.shape, np.nan)
        for k, test in enumerate(TESTS):
            joints = [int(j) for j in np.flatnonzero(self.visits[:, k] >= FEWEST)]
            tails = [Tail.of(self.maxima[j][k], float(self.visits[j, k])) for j in joints]
            shape = sum((tail.log_shape for tail in tails), start=LOG_PRIOR)
            for j, tail in zip(joints, tails, strict=True):
                per_hour = 3600.0 * (len(tail.excesses) + 0.5) / float(self.seconds[j, k])
                limits[j, k] = tail.size(
                    test * rate / len(limits) / per_hour, shape - tail.log_shape
                )
        limits, changes = limits[:, :CHANGE], limits[:, CHANGE]
        own = np.isfinite(limits)
        known = own.any(axis=1)
        greatest = np.max(limits, axis=1, where=own, initial=-np.inf) + friction
        limits = np.where(own, limits, np.where(known, greatest, np.nan)[:, None])
        return ContactThresholds(
            self.edges,
            self.cutoff,
            rate,
            self.duration,
            frozen(limits),
            tuple(map(tuple, own.tolist())),
            frozen(changes),
        )

    def to_dict(self) -> dict[str, Any]:
        """As JSON values; maxima with six digits."""
        return {
            "speed_edges": self.edges.tolist(),
            "cutoff_hz": self.cutoff,
            "maxima": [[[float(f"{x:.6g}") for x in row] for row in rows] for rows in self.maxima],
            "visits": self.visits.tolist(),
            "seconds": self.seconds.tolist(),
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> "ResidualPeaks":
        """The peaks that `to_dict` wrote."""
        found = of_json_values(
            cls, {**data, "edges": data["speed_edges"], "cutoff": data["cutoff_hz"]}
        )
        for numbers in (found.visits, found.seconds):
            frozen(numbers, (len(found.edges), len(TESTS)))
        return found


@dataclass(frozen=True, eq=False)
class ContactThresholds:
    """Residual that a contact must exceed, per joint and range of its speed."""

    # speeds at which ranges meet, rest and turning at the first, `(n, 3)` [rad/s; m/s]
    edges: Array
    cutoff: float  # of the first-order low-pass of the residuals that they are for [Hz]
    rate: float  # false alarms per hour of all joints together that they are for
    duration: float  # length of the free motion that they rest on [s]
    limits: Array  # `(n, 5)`; NaN of a joint that no free motion could test [Nm; N]
    # whether the range of the joint was visited often enough for a threshold of its own, `(n, 5)`;
    # others take the largest of the joint and its friction
    own: tuple[tuple[bool, ...], ...]
    changes: Array  # of changes at rest, `(n,)`; NaN where they are not tested [Nm; N]

    def at(self, ranges: NDArray[np.intp]) -> Array:
        """Thresholds of ranges `(n, B)`, its shape [Nm; N]."""
        return np.take_along_axis(self.limits, ranges, axis=1)

    def start(self) -> "ThresholdStepper":
        """Begin to evaluate sample by sample."""
        return ThresholdStepper(self)

    def to_dict(self) -> dict[str, Any]:
        """As JSON values; `None` for a threshold that is not known."""
        return {
            "false_alarms_per_hour": self.rate,
            "free_motion_s": self.duration,
            "cutoff_hz": self.cutoff,
            "ranges": list(RANGES),
            "speed_edges": self.edges.tolist(),
            "thresholds": finite_json(self.limits),
            "own": [list(row) for row in self.own],
            "changes_at_rest": finite_json(self.changes),
        }


class ThresholdStepper:
    """Thresholds sample by sample; `resting`: whether all joints were at rest at the last one.

    A joint is in the slowest range of the last `HOLD` seconds, at rest only `SETTLED` seconds after
    its last motion.
    """

    def __init__(self, thresholds: ContactThresholds) -> None:
        self._edges = thresholds.edges
        self._limits = thresholds.limits
        self._last = np.full((len(self._edges), 1 + self._edges.shape[1]), -np.inf)
        self._moved = np.full(len(thresholds.limits), -np.inf)
        self._joints = np.arange(len(self._edges))
        self.resting = False

    def step(self, t: float, speed: Array | Sequence[float]) -> Array:
        """Thresholds at a time, which does not fall, and velocities, shape `(n,)` [Nm; N]."""
        now = np.sum(np.abs(speed)[:, None] > self._edges, axis=1)
        self._last[self._joints, now] = t
        self._moved[now > 0] = t
        held = np.argmax(self._last >= t - HOLD, axis=1)
        held = held + ((held > 0) | (t - self._moved <= SETTLED))
        self.resting = not held.any()
        return np.asarray(self._limits[self._joints, held])


def ranges_of(slowest: Array, fastest: Array, edges: Array) -> NDArray[np.intp]:
    """Range of every sample, shape `(n, B)`.

    From the least speed of each joint in the last `HOLD` seconds, and the greatest in the last
    `SETTLED` seconds, of the same shape; edges are `(n, 3)`.
    """
    found = np.sum(slowest[:, None] > edges[:, :, None], axis=1)
    return np.asarray(found + ((found > 0) | (fastest > edges[:, :1])), dtype=np.intp)


def peaks_of(
    t: Array, residual: Array, ranges: NDArray[np.intp], step: float, edges: Array, cutoff: float
) -> ResidualPeaks:
    """Largest residual of every visit to a range, in stretches without contact.

    Residuals and ranges have the shape `(n, N)`; a joint with NaN is left out. A step of time of
    more than twice `step` ends all visits.
    """
    change = np.abs(changes_at_rest(t, residual, ranges, step))
    tested = np.isfinite(change).any(axis=0)
    cut = np.ones(int(tested.sum()), dtype=np.intp)  # as visits to a range in which joints move
    found = [
        [*_visits(np.abs(r), k, t, step), _visits(x, cut, t[tested], step)[1]]
        for r, k, x in zip(residual, ranges, change[:, tested], strict=True)
    ]
    maxima = tuple(tuple(_largest(m) for m in row) for row in found)
    visits = frozen([[len(m) for m in row] for row in found])
    known = np.asarray(np.isfinite(residual).all(axis=1))
    spent = [[*np.bincount(k, minlength=len(RANGES)), len(cut)] for k in ranges]
    seconds = known[:, None] * np.array(spent, dtype=np.float64) * step
    return ResidualPeaks(edges, cutoff, maxima, visits, frozen(seconds))


def _visits(size: Array, ranges: NDArray[np.intp], t: Array, step: float) -> list[Array]:
    """Maxima of one joint's visits, per range."""
    if not len(size) or not np.isfinite(size).all():
        return [np.empty(0)] * len(RANGES)
    gaps = np.diff(t) > 2.0 * step
    starts = np.flatnonzero(np.concatenate(([True], (np.diff(ranges) != 0) | gaps)))
    ends = np.append(starts[1:], len(size))
    most = max(1, round(LONGEST_VISIT / step))
    cuts = [
        np.arange(a, b, most) if ranges[a] else np.array([a])
        for a, b in zip(starts, ends, strict=True)
    ]
    begins = np.concatenate(cuts)
    maxima = np.maximum.reduceat(size, begins)
    return [maxima[ranges[begins] == k] for k in range(len(RANGES))]


def _largest(maxima: Array) -> Array:
    return frozen(np.sort(maxima)[::-1][:MOST_KEPT])


def low_passed(signals: Array, cutoff: float, rate: float) -> Array:
    """First-order low-pass along the last axis of finite signals, started from the first sample."""
    keep = np.exp(-2.0 * np.pi * cutoff / rate)
    decay, unbounded = (np.full((1, signals.shape[-1]), value) for value in (keep, np.inf))
    rows = signals.reshape(-1, 1, signals.shape[-1])
    slow = np.empty(rows.shape)
    for one, row in zip(slow, rows, strict=True):
        one[:] = recurrence(decay, (1.0 - keep) * row, unbounded, row[:, 0])[0]
    return slow.reshape(signals.shape)


def changes_at_rest(t: Array, residual: Array, ranges: NDArray[np.intp], step: float) -> Array:
    """Change of the residual where all joints rest, NaN elsewhere, shape `(n, N)` [Nm; N].

    A step of time of more than twice `step` ends a rest; ranges are as of `ranges_of`.
    """
    found = np.full(residual.shape, np.nan)
    if step > 0.5 * CREEP:
        return found  # too slow a log, or a wrong unit of time
    calm, gaps = np.all(ranges == 0, axis=0), np.diff(t) > 2.0 * step
    begins = np.flatnonzero(calm & np.concatenate([[True], ~calm[:-1] | gaps]))
    ends = np.flatnonzero(calm & np.concatenate([~calm[1:] | gaps, [True]])) + 1
    for start, stop in zip(begins, ends, strict=True):
        some = residual[:, start:stop]
        # the mean of the samples so far; from `CREEP` on it forgets
        first = min(some.shape[1], round(CREEP / step))
        mean = np.cumsum(some[:, :first], axis=1) / np.arange(1, first + 1)
        later = np.concatenate([mean[:, -1:], some[:, first:]], axis=1)
        slow = low_passed(later, 1.0 / (2.0 * np.pi * CREEP), 1.0 / step)
        change = some - np.concatenate([mean, slow[:, 1:]], axis=1)
        tested = slice(round(QUIET / step), max(0, stop - start - round(ONSET / step)))
        found[:, start:stop][:, tested] = change[:, tested]
    return found


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
        """Whether each joint's change `ONSET` ago exceeded its threshold, `(n,)`, if all rest."""
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
