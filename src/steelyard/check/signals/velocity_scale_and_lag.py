r"""Logged velocities compared with the derivatives of the positions, and the rate they show.

Both pass the same Gaussian low-pass, so what it takes from one it takes from the other. Of each
pair, $w(t) \approx s\,v(t - \delta)$ is fitted: the scale $s$ gives the unit and the sign, the lag
$\delta$ the controller's filter, and the correlation of every column with every joint the order.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array
from steelyard.check.signals.usable_rows import (
    SHORTEST_STRETCH,
    SLOW_SHARE,
    SignalOverview,
    gaussian_slope,
    gaussian_smoothed,
    width_of,
)
from steelyard.robot.file.signals import ROW, VELOCITY_UNITS, Signals
from steelyard.robot.init.column_names import Column

LONGEST_LAG = 0.4  # lag up to which the two are compared with each other [s]
AGREEING_CORRELATION = 0.9  # correlation from which on a column may belong to a joint
BETTER_ORDER_GAIN = 0.1  # what another order must gain in correlation for each joint it moves


@dataclass(frozen=True, eq=False)
class VelocityAgreement:
    """What velocities have to do with positions, for each joint."""

    order: NDArray[np.intp]  # number of the velocity column that fits each joint, shape `(n,)`
    moving: NDArray[np.bool_]  # joints that move enough to compare, shape `(n,)`
    scale: Array  # logged velocity per derivative of the position, `(n,)`; NaN where not moving
    lag: Array  # how much later the velocity is, shape `(n,)` [s]
    lag_std: Array  # standard error of the lag, shape `(n,)` [s]
    correlation: Array  # at that lag, shape `(n,)`
    t: Array  # time from the first sample of the longest stretch, shape `(N,)` [s]
    derivative: Array  # low-passed derivative of the positions there, shape `(n, N)`
    logged: Array  # low-passed velocities there, in the order of the columns, shape `(n, N)`

    def in_seconds(self, second: float) -> "VelocityAgreement":
        """The same with time in other units, of which each is so many of those here."""
        return replace(
            self,
            scale=self.scale * second,
            lag=self.lag * second,
            lag_std=self.lag_std * second,
            t=self.t * second,
            derivative=self.derivative / second,
        )

    @property
    def reliable_joints(self) -> NDArray[np.bool_]:
        """Joints whose scale and lag can be believed."""
        with np.errstate(invalid="ignore"):
            return np.asarray(self.moving & (np.abs(self.correlation) >= AGREEING_CORRELATION))


def velocity_agreement(
    overview: SignalOverview, velocity: Array, second: float = 1.0
) -> VelocityAgreement | None:
    """Hold velocities of the good rows `(N, n)` against positions, with seconds of that length.

    `None` if the log has no stretch that is long enough.
    """
    n = velocity.shape[1]
    even, rate = overview.even(np.concatenate((overview.q, velocity), axis=1), second)
    pairs = [(gaussian_slope(x[:n], rate), gaussian_smoothed(x[n:], rate)) for x in even]
    pairs = [(v, w) for v, w in pairs if v.shape[1] >= SHORTEST_STRETCH // 2]
    if not pairs:
        return None
    move = overview.moving(np.concatenate([v for v, _ in pairs], axis=1))
    stride = max(1, int(rate * width_of(rate)))
    coarse = [(v[:, ::stride], w[:, ::stride]) for v, w in pairs]
    order, first = _velocity_order(coarse, move, max(1, round(LONGEST_LAG * rate / stride)))
    fits = np.full((4, n), np.nan)
    for joint in np.flatnonzero(move):
        signals = [(v[joint], w[order[joint]]) for v, w in pairs]
        fits[:, joint] = _velocity_fit(signals, rate, first[joint] * stride / rate)
    v, w = max(pairs, key=lambda pair: pair[0].shape[1])
    t = np.arange(v.shape[1]) / rate
    scale, lag, lag_std, correlation = fits
    return VelocityAgreement(order, move, scale, lag, lag_std, correlation, t, v, w)


def _velocity_order(
    pairs: list[tuple[Array, Array]], moving: NDArray[np.bool_], reach: int
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Column of each joint, and each pair's lag in samples."""
    from scipy.optimize import linear_sum_assignment

    lags = np.arange(-reach, reach + 1)
    table = np.abs(np.stack([_correlations(pairs, int(k)) for k in lags]))
    table[:, ~moving] = 0.0
    n = len(moving)
    own = np.arange(n)
    together = np.trace(table, axis1=1, axis2=2)
    values = []
    for one in table:
        rows, columns = linear_sum_assignment(-one - 1e-6 * np.eye(n))
        values.append((one[rows, columns].sum(), columns))
    best = max(range(len(lags)), key=lambda k: values[k][0])
    chosen = values[best][1]
    moved = (chosen != own) & moving
    gain = values[best][0] - together.max()
    sure = table[best, own[moved], chosen[moved]] >= AGREEING_CORRELATION
    order = own
    if moved.any() and sure.all() and gain >= BETTER_ORDER_GAIN * np.count_nonzero(moved):
        order = chosen
    at_once = lags[np.argmax(table[:, own, order], axis=0)]
    return order, np.where(moving, at_once, 0)


def _correlations(pairs: list[tuple[Array, Array]], lag: int) -> Array:
    """Correlation of every derivative with every velocity that much later, shape `(n, n)`."""
    n = len(pairs[0][0])
    both, left, right = np.zeros((n, n)), np.zeros(n), np.zeros(n)
    for v, w in pairs:
        length = v.shape[1] - abs(lag)
        if length <= 0:
            continue
        a = v[:, max(0, -lag) : max(0, -lag) + length]
        b = w[:, max(0, lag) : max(0, lag) + length]
        both += a @ b.T
        left += np.square(a).sum(axis=1)
        right += np.square(b).sum(axis=1)
    size = np.sqrt(left[:, None] * right[None])
    return np.divide(both, size, out=np.zeros((n, n)), where=size > 0.0)


def _velocity_fit(
    signals: list[tuple[Array, Array]], rate: float, lag: float
) -> tuple[float, float, float, float]:
    """Scale, lag, its standard error and the correlation there, by Gauss-Newton steps."""
    scale = std = correlation = 0.0
    for _ in range(5):
        rows, values = _shifted(signals, rate, lag)
        gram = rows.T @ rows
        if len(rows) < 3 or np.linalg.cond(gram) > 1e14:
            break
        found = np.linalg.solve(gram, rows.T @ values)
        scale = float(found[0])
        rest = values - rows @ found
        samples = max(len(rows) / (rate * width_of(rate) * 3.5) - 3.0, 1.0)
        spread = float(rest @ rest) / samples * np.linalg.inv(gram)[1, 1]
        std = float(np.sqrt(spread)) / max(abs(scale), 1e-300)
        size = float(np.sqrt(gram[0, 0] * (values @ values)))
        correlation = float(rows[:, 0] @ values) / size if size > 0.0 else 0.0
        change = float(-found[1] / found[0]) if found[0] else 0.0
        lag += float(np.clip(change, -0.05, 0.05))
        if abs(change) < 1e-6:
            break
    return scale, lag, std, correlation


def _shifted(signals: list[tuple[Array, Array]], rate: float, lag: float) -> tuple[Array, Array]:
    """Rows `[v, dv/dt, 1]` at the lag, and the velocities."""
    rows, values = [], []
    for v, w in signals:
        at = np.arange(len(v)) - lag * rate
        inside = (at >= 0.0) & (at <= len(v) - 1.0)
        place = np.arange(len(v), dtype=np.float64)
        late = np.interp(at, place, v)
        slope = np.interp(at, place, np.gradient(v) * rate if len(v) > 1 else np.zeros(1))
        rows.append(np.stack((late, slope, np.ones(len(v))), axis=1)[inside])
        values.append(w[inside])
    return np.concatenate(rows), np.concatenate(values)


RATE_TOLERANCE, UNEVEN_RATE, MOST_OFF = 0.02, 0.005, 0.13
"""Distance of velocities over d(q)/dt from 1 that is a clock's, if joints differ by no more; from
the last on it is a wrong unit. Real robots' are off by 1 %, or differ by 1.5 % and more."""
LOST_ROWS = 0.05
"""The same difference between joints where a rate is farther off: rows that are lost cause it."""
FEWEST_RATE_JOINTS = 2  # joints that must move
_SCALES = [*VELOCITY_UNITS["revolute"].values()]
VELOCITY_UNIT_RATIOS = tuple(a / b for a in _SCALES for b in _SCALES if a != b)
"""Ratios of velocities in one unit to those in another."""


def rate_by_velocities(
    signals: Signals, overview: SignalOverview, logged: tuple[Sequence[str], Array] | None
) -> float | None:
    """The rate at which logged velocities `(N, n)` are the derivative of the positions [Hz].

    Velocities that are a multiple of the derivative, the same in all joints, show the rate, unless
    the multiple is the ratio of two units. `None` if there is a column of time, the declared rate
    is right, or nothing moves.
    """
    if logged is None or signals.time != ROW:
        return None
    agreed = velocity_agreement(overview, logged[1])
    if agreed is None:
        return None
    scales = agreed.scale[agreed.reliable_joints]
    if len(scales) < FEWEST_RATE_JOINTS or not (scales > 0.0).all():
        return None
    scale = float(np.median(scales))
    spread, off = float(np.ptp(scales)) / scale, abs(scale - 1.0)
    if off < RATE_TOLERANCE or spread > (LOST_ROWS if off > MOST_OFF else UNEVEN_RATE):
        return None
    stated = all(Column(name).unit_words for name in logged[0])
    near = 0.5 * RATE_TOLERANCE if stated else max(RATE_TOLERANCE, spread)
    if any(abs(scale / ratio - 1.0) < near for ratio in VELOCITY_UNIT_RATIOS):
        return None
    rate = scale / signals.time_scale  # with the fewest digits that is as near as it is determined
    rates = (float(f"{rate:.{digits}g}") for digits in (1, 2, 3, 4))
    return next(x for x in rates if abs(x / rate - 1.0) < 0.5 * RATE_TOLERANCE)


SAME_DIFFERENCE = 0.1
"""Distance from a difference, over the noise that the difference has from its positions, below
which a velocity is that difference: a velocity that was measured does not have this noise."""
DIFFERENCE_STEP_RANGE = (-0.05, 0.05)
"""How far the step that differences were divided by may be off the clock's."""
DIFFERENCE_ROUNDING = 1e-6  # the same over the velocities, where positions have no noise


def one_sided_differences(t: Array, q: Array, dq: Array) -> NDArray[np.bool_]:
    """Whether each velocity is the difference of its row's position and a neighbour's, `(n,)`.

    Increasing times `(N,)` [s]; positions and, in their unit per second, velocities `(N, n)`.
    """
    if len(t) < SHORTEST_STRETCH:
        return np.zeros(q.shape[1], dtype=np.bool_)
    steps, change = np.diff(t)[:, None], np.diff(q, axis=0)
    slopes = (change / steps, change / np.median(steps))
    return np.array([_is_one([x[:, j] for x in slopes], dq[:, j]) for j in range(q.shape[1])])


def _is_one(slopes: Sequence[Array], dq: Array) -> bool:
    """Whether a velocity, shape `(N,)`, is a slope of its rows, `(N - 1,)`, where it moves."""
    fast = np.abs(slopes[0]) > SLOW_SHARE * np.quantile(np.abs(slopes[0]), 0.98)
    fast &= slopes[1] != 0.0
    if np.count_nonzero(fast) < SHORTEST_STRETCH:
        return False
    noise = min(float(np.median(np.square(np.diff(x, n=2))[fast[1:-1]])) for x in slopes)
    size = float(np.sqrt(np.mean(np.square(dq))))
    bound = max(SAME_DIFFERENCE * np.sqrt(noise / 6.0), DIFFERENCE_ROUNDING * size)
    for logged, slope in product((dq[1:][fast], dq[:-1][fast]), (x[fast] for x in slopes)):
        # up to a factor near one for the step that was divided by, in nine rows of ten
        off = np.clip(np.median(logged / slope) - 1.0, *DIFFERENCE_STEP_RANGE)
        if np.quantile(np.abs(logged - (1.0 + off) * slope), 0.9) <= bound:
            return True
    return False
