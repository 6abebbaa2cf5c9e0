r"""When a payload changes: a likelihood ratio over its ten columns on a sliding window.

What the model does not explain is a payload's ten columns times its numbers, friction of the day,
and noise. At every instant the payloads of the windows before and after, $\hat\phi_1$ and
$\hat\phi_2$ with covariances $C_1$ and $C_2$, give

$$ D = (\hat\phi_1 - \hat\phi_2)^T (C_1 + C_2)^{-1} (\hat\phi_1 - \hat\phi_2) , $$

twice the logarithm of the ratio of likelihoods of two payloads and of one. Residuals of a model are
correlated and heavier than normal ones: $D$ counts relative to its own quantiles along the log,
most of which contains no change.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Z95, Array

CHANGE_STEP = 0.1  # length of the windows that are added up [s]
CHANGE_SPAN = 3.0  # length of the sliding window on each side [s], of samples that count
FALSE_EVENTS_PER_HOUR = 0.1  # false events per hour that the threshold allows

FIRST, LEVELS = (0.1, 0.25), (0.5, 0.9, 0.99)
"""Quantiles of the statistic that are compared with those of normal, white residuals: of the whole
log, and of what is left of it beside the changes that this gives beyond doubt."""

DOUBTLESS_CHANGE = 3.0  # squares over the threshold from which on no residual makes a change

Places = NDArray[np.integer[Any]]

LEAST_WINDOWS_OF_LOG = 3  # windows of the span that a log must have for a change to be sought
OUTLYING_WINDOW = 5.0  # squares left in a window over their median from which on it weighs less
LEAST_TIME_OF_CHANGES = 0.5  # least time between two changes [s], of samples that count
IMPROVING_PASSES = 5  # passes in which times of changes are improved with those of their neighbours


@dataclass(frozen=True, eq=False)
class SlidingMass:
    """A payload's mass in a window of `CHANGE_SPAN` around each time, friction of the day apart."""

    t: Array  # middle of the windows, shape `(w,)` [s]
    mass: Array  # likewise [kg]
    # half-width of the 95 % interval, residuals as they are along the log, likewise; that of a
    # single window, without the errors of model and gains
    half_width: Array


@dataclass(frozen=True, eq=False)
class PayloadWindows:
    """What short windows of a run say about a payload, friction of the day taken out."""

    starts: Array  # of the windows that have samples, shape `(w,)` [s]
    stops: Array  # likewise
    matrix: Array  # information about the payload's ten numbers, shape `(w, 10, 10)`
    vector: Array  # shape `(w, 10)`
    square: Array  # squares of the efforts less the model's, shape `(w,)`
    prior: Array  # weak information about any payload, shape `(10, 10)`

    def damped(self) -> "PayloadWindows":
        """The same with single windows that no payload around them explains weighing less."""
        size = len(self.starts)
        count = min(round(CHANGE_SPAN / CHANGE_STEP), size)
        first = np.clip(np.arange(size) - count // 2, 0, size - count)
        matrix, vector = self.between(first, first + count)
        mean = np.linalg.solve(matrix + self.prior, vector[..., None])[..., 0]
        left = self.square - 2.0 * np.sum(self.vector * mean, axis=1)
        left = np.maximum(left + np.einsum("wi,wij,wj->w", mean, self.matrix, mean), 1e-300)
        weight = np.minimum(1.0, OUTLYING_WINDOW * np.median(left) / left)
        matrix, vector = self.matrix * weight[:, None, None], self.vector * weight[:, None]
        return replace(self, matrix=matrix, vector=vector, square=self.square * weight)

    def gain(self, first: Places, last: Places) -> Array:
        """Squares that a payload of its own explains in windows `first` to `last`, excluded."""
        matrix, vector = self.between(first, last)
        solved = np.linalg.solve(matrix + self.prior, vector[..., None])[..., 0]
        return np.asarray(np.sum(vector * solved, axis=-1))

    def sliding_mass(self, inflation: float) -> SlidingMass:
        """The mass over time."""
        count = min(round(CHANGE_SPAN / CHANGE_STEP), len(self.starts))
        first = np.arange(len(self.starts) - count + 1)
        matrix, vector = self.between(first, first + count)
        covariance = np.linalg.inv(matrix + self.prior)
        mass = np.einsum("wj,wj->w", covariance[:, 0], vector)
        middle = 0.5 * (self.starts[first] + self.stops[first + count - 1])
        return SlidingMass(middle, mass, Z95 * np.sqrt(inflation * covariance[:, 0, 0]))

    @cached_property
    def _sums(self) -> tuple[Array, Array]:
        """Sums of matrices and vectors up to each window, of none first."""
        both = (np.cumsum(x, axis=0) for x in (self.matrix, self.vector))
        matrix, vector = (np.insert(x, 0, 0.0, axis=0) for x in both)
        return matrix, vector

    def between(self, first: Places, last: Places) -> tuple[Array, Array]:
        """Matrices and vectors of windows `first` to `last`, excluded."""
        matrix, vector = self._sums
        return matrix[last] - matrix[first], vector[last] - vector[first]

    def statistic(self) -> tuple[Array, Array, Array]:
        """`D` at the start of every window, what it is expected to be by white noise, `(w,)`.

        Both are zero and one where a side has less than the span. The third is what a change by 1
        kg at the frame's origin adds to `D`, zero there likewise.
        """
        count = round(CHANGE_SPAN / CHANGE_STEP)
        values, expected = np.zeros(len(self.starts)), np.ones(len(self.starts))
        of_mass = np.zeros(len(self.starts))
        if len(self.starts) < 2 * count:
            return values, expected, of_mass
        at = np.arange(count, len(self.starts) - count + 1)
        sides = []
        for first, last in ((at - count, at), (at, at + count)):
            matrix, vector = self.between(first, last)
            covariance = np.linalg.inv(matrix + self.prior)
            mean = np.einsum("wij,wj->wi", covariance, vector)
            sides.append((covariance, mean, covariance @ matrix @ covariance))
        (before, one, noise), (after, other, more) = sides
        inverse = np.linalg.inv(before + after)
        change = one - other
        at = at[at < len(self.starts)]
        kept = slice(len(at))
        values[at] = np.einsum("wi,wij,wj->w", change, inverse, change)[kept]
        expected[at] = np.trace(inverse @ (noise + more), axis1=1, axis2=2)[kept]
        of_mass[at] = inverse[kept, 0, 0]
        return values, expected, of_mass


@dataclass(frozen=True)
class PayloadChange:
    """A change of the payload."""

    time: float  # when [s]
    earliest: float  # start of the 95 % interval of the time [s]
    latest: float
    ratio: float  # squares that it explains over the threshold


@dataclass(frozen=True, eq=False)
class PayloadChanges:
    """All changes of a run."""

    changes: tuple[PayloadChange, ...]
    # change by a mass at the frame's origin that half of the places of the log show; infinite if
    # none does [kg]
    least_mass: float
    inflation: float  # how many times larger the statistic is than by normal, white residuals
    threshold: float  # squares that a change has to explain
    sliding: SlidingMass


def payload_windows(
    starts: Array, stops: Array, grams: Array, drift: Array, size: float
) -> PayloadWindows:
    """Windows about the payload alone: friction's deviations are the same in all of them.

    They have `starts` and `stops`, shape `(w,)` [s]. `grams` are sums of products over the variance
    of the residuals, shape `(w, d + 11, d + 11)`: of friction's deviations, whose standard
    deviations are `drift`, shape `(d,)`, the payload's ten columns, and efforts less those of the
    model. A payload may have the mass `size` [kg].
    """
    n, prior = len(drift), np.diag(size**-2.0 * np.repeat([1.0, 0.3, 0.1], [1, 3, 6]) ** -2)
    group = np.arange(len(grams)) // round(CHANGE_SPAN / CHANGE_STEP)
    blocks = np.array([grams[group == k].sum(axis=0) for k in range(group[-1] + 1)])
    # deviations, whatever payload each block of time carries
    cross, inner = blocks[:, :n, n:-1], blocks[:, n:-1, n:-1] + prior
    through = cross @ np.linalg.inv(inner)
    matrix = blocks[:, :n, :n] - through @ cross.swapaxes(1, 2)
    vector = blocks[:, :n, -1] - np.einsum("kij,kj->ki", through, blocks[:, n:-1, -1])
    scale = np.maximum(drift, 1e-12)
    total = matrix.sum(axis=0) * scale[:, None] * scale + np.eye(n)
    deviations = scale * np.linalg.solve(total, scale * vector.sum(axis=0))
    turn, outer = np.append(-deviations, 1.0), [*range(n), n + 10]
    efforts = grams[:, :, outer] @ turn
    inner, vector = grams[:, n:-1, n:-1], efforts[:, n:-1]
    return PayloadWindows(starts, stops, inner, vector, efforts[:, outer] @ turn, prior)


def changes_of(windows: PayloadWindows) -> PayloadChanges:
    """Where the payload changes.

    Candidates are peaks of the statistic above the threshold, at least a span apart. Their times
    are those of the greatest likelihood between their neighbours; those that explain no more than
    the threshold are left out again.
    """
    from scipy.special import chdtri

    windows = windows.damped()
    values, expected, of_mass = windows.statistic()
    tested = values > 0.0
    freedom = float(np.median(expected[tested])) if tested.any() else 10.0
    surprise = float(chdtri(freedom, FALSE_EVENTS_PER_HOUR * CHANGE_STEP / 3600.0))
    ratios, beside, places = values / expected, tested, []
    for levels in (FIRST, LEVELS):
        inflation = _inflation(ratios[beside], levels, freedom)
        threshold = inflation * surprise
        places = _peaks(ratios * freedom, threshold, round(CHANGE_SPAN / CHANGE_STEP))
        places = _needed(windows, places, threshold)
        explained = _explained(windows, places)
        sure = np.array(places, dtype=float)[np.array(explained) > DOUBTLESS_CHANGE * threshold]
        near = np.abs(np.arange(len(values))[:, None] - sure[None])
        apart = round((CHANGE_SPAN + LEAST_TIME_OF_CHANGES) / CHANGE_STEP)
        beside = tested & np.all(near > apart, axis=1)
    changes = []
    for k, place in enumerate(places):
        low, high = _neighbours(windows, places, k)
        at, gains = _profile(windows, low, high)
        inside = at[gains >= gains[at == place] - 3.84 * inflation]
        near = inside[np.abs(inside - place) <= round(CHANGE_SPAN / CHANGE_STEP)]
        time = 0.5 * float(windows.stops[place - 1] + windows.starts[place])
        earliest = float(windows.stops[near[0] - 1]) - CHANGE_STEP
        latest = float(windows.starts[near[-1]]) + CHANGE_STEP
        changes.append(PayloadChange(time, earliest, latest, explained[k] / threshold))
    shown = of_mass[tested] * freedom / expected[tested] / threshold
    least_mass = float(np.median(shown)) ** -0.5 if tested.any() else np.inf
    sliding = windows.sliding_mass(inflation)
    return PayloadChanges(tuple(changes), least_mass, inflation, threshold, sliding)


def _peaks(values: Array, threshold: float, apart: int) -> list[int]:
    """Numbers of the greatest values above a threshold, none within `apart` of a greater one."""
    left, places = values.copy(), []
    while left.max(initial=0.0) > threshold:
        place = int(np.argmax(left))
        places.append(place)
        left[max(0, place - apart) : place + apart] = 0.0
    return sorted(places)


def _improved(windows: PayloadWindows, places: list[int], numbers: range) -> list[int]:
    """Some changes where the likelihood of the payloads beside them is greatest."""
    places = list(places)
    for _ in range(IMPROVING_PASSES):
        before = list(places)
        for k in numbers:
            low, high = _neighbours(windows, places, k)
            at, gains = _profile(windows, low, high)
            places[k] = int(at[np.argmax(gains)])
        if places == before:
            break
    return places


def _inflation(ratios: Array, levels: Sequence[float], freedom: float) -> float:
    """How many times larger the statistic is than by normal, white residuals, at least one."""
    from scipy.special import gammaincinv

    if not len(ratios):
        return 1.0
    expected = 2.0 * gammaincinv(0.5 * freedom, levels) / freedom
    return max(1.0, float(np.max(np.quantile(ratios, levels) / expected)))


def _needed(windows: PayloadWindows, places: list[int], least: float) -> list[int]:
    """Changes at their best times, without those that explain less than some squares."""
    places = _improved(windows, places, range(len(places)))
    while places:
        explained = _explained(windows, places)
        weakest = int(np.argmin(explained))
        if explained[weakest] > least:
            break
        del places[weakest]
        beside = range(max(0, weakest - 1), min(len(places), weakest + 1))
        places = _improved(windows, places, beside)
    return places


def _explained(windows: PayloadWindows, places: list[int]) -> list[float]:
    """Squares that each change explains: two payloads more than one."""
    found = []
    for k, place in enumerate(places):
        low, high = _neighbours(windows, places, k)
        one, other, both = windows.gain(np.array([low, place, low]), np.array([place, high, high]))
        found.append(float(one + other - both))
    return found


def _neighbours(windows: PayloadWindows, places: list[int], k: int) -> tuple[int, int]:
    """Windows at which the payloads beside a change begin and end."""
    ends = [0, *places, len(windows.starts)]
    return ends[k], ends[k + 2]


def _profile(windows: PayloadWindows, low: int, high: int) -> tuple[Places, Array]:
    """Squares explained by two payloads that change at each window between two."""
    apart = round(LEAST_TIME_OF_CHANGES / CHANGE_STEP)
    at = np.arange(low + apart, high - apart + 1)
    return at, windows.gain(np.full(len(at), low), at) + windows.gain(at, np.full(len(at), high))
