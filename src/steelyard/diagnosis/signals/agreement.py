r"""Logged velocities compared with the derivative of the positions.

Both pass the same Gaussian low-pass, so what it takes from one it takes from the other. Of each
pair, $w(t) \approx s\,v(t - \delta)$ is fitted: the scale $s$ gives the unit and the sign, the lag
$\delta$ the controller's filter, and the correlation of every column with every joint the order.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.diagnosis.signal_overview import SHORTEST, SignalOverview
from steelyard.diagnosis.signals.slopes import moving, slope, smooth, width_of

LONGEST_LAG = 0.4
"""Lag up to which the two are compared with each other [s]."""
ALIKE = 0.9
"""Correlation from which on a column may belong to a joint."""
BETTER = 0.1
"""What another order must gain in correlation for each joint it moves."""


@dataclass(frozen=True, eq=False)
class Agreement:
    """What velocities have to do with positions, for each joint.

    Attributes:
        order: Number of the velocity column that fits each joint, shape `(n,)`.
        moving: Joints that move enough to compare, shape `(n,)`.
        scale: Logged velocity per derivative of the position, shape `(n,)`; NaN where not moving.
        lag: How much later the velocity is, shape `(n,)` [s].
        lag_std: Standard error of the lag, shape `(n,)` [s].
        correlation: At that lag, shape `(n,)`.
        t: Time from the first sample of the longest stretch, shape `(N,)` [s].
        derivative: Low-passed derivative of the positions there, shape `(n, N)`.
        logged: Low-passed velocities there, in the order of the columns, shape `(n, N)`.
    """

    order: NDArray[np.intp]
    moving: NDArray[np.bool_]
    scale: Array
    lag: Array
    lag_std: Array
    correlation: Array
    t: Array
    derivative: Array
    logged: Array

    @property
    def swapped(self) -> tuple[int, ...]:
        """Joints whose velocity is in another column."""
        return tuple(np.flatnonzero(self.order != np.arange(len(self.order))).tolist())

    def in_seconds(self, second: float) -> "Agreement":
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
            sure: NDArray[np.bool_] = self.moving & (np.abs(self.correlation) >= ALIKE)
        return sure


def agreement(overview: SignalOverview, velocity: Array, second: float = 1.0) -> Agreement | None:
    """Hold velocities against positions.

    Args:
        overview: The log.
        velocity: Velocities of the good rows, shape `(N, n)`.
        second: Seconds that a declared second really has.

    Returns:
        What was found; `None` if the log has no stretch that is long enough.
    """
    n = velocity.shape[1]
    even, rate = overview.even(np.concatenate((overview.q, velocity), axis=1), second)
    pairs = [(slope(x[:n], rate), smooth(x[n:], rate)) for x in even]
    pairs = [(v, w) for v, w in pairs if v.shape[1] >= SHORTEST // 2]
    if not pairs:
        return None
    move = moving(overview, np.concatenate([v for v, _ in pairs], axis=1))
    stride = max(1, int(rate * width_of(rate)))
    coarse = [(v[:, ::stride], w[:, ::stride]) for v, w in pairs]
    order, first = _order(coarse, move, max(1, round(LONGEST_LAG * rate / stride)))
    fits = np.full((4, n), np.nan)
    for joint in np.flatnonzero(move):
        signals = [(v[joint], w[order[joint]]) for v, w in pairs]
        fits[:, joint] = _fit(signals, rate, first[joint] * stride / rate)
    v, w = max(pairs, key=lambda pair: pair[0].shape[1])
    t = np.arange(v.shape[1]) / rate
    scale, lag, lag_std, correlation = fits
    return Agreement(order, move, scale, lag, lag_std, correlation, t, v, w)


def _order(
    pairs: list[tuple[Array, Array]], moving: NDArray[np.bool_], reach: int
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Column of each joint, and each pair's lag in samples."""
    from scipy.optimize import linear_sum_assignment

    lags = np.arange(-reach, reach + 1)
    table = np.abs(np.stack([_correlations(pairs, int(k)) for k in lags]))
    table[:, ~moving] = 0.0
    n = len(moving)
    own, at_once = np.arange(n), np.zeros(n, dtype=np.intp)
    together = np.trace(table, axis1=1, axis2=2)
    values = []
    for one in table:
        rows, columns = linear_sum_assignment(-one - 1e-6 * np.eye(n))
        values.append((one[rows, columns].sum(), columns))
    best = max(range(len(lags)), key=lambda k: values[k][0])
    chosen = values[best][1]
    moved = (chosen != own) & moving
    gain = values[best][0] - together.max()
    sure = table[best, own[moved], chosen[moved]] >= ALIKE
    order = own
    if moved.any() and sure.all() and gain >= BETTER * np.count_nonzero(moved):
        order = chosen
    for joint in np.flatnonzero(moving):
        at_once[joint] = lags[int(np.argmax(table[:, joint, order[joint]]))]
    return order, at_once


def _correlations(pairs: list[tuple[Array, Array]], lag: int) -> Array:
    """Correlation of every derivative with every velocity that much later, shape `(n, n)`."""
    n = len(pairs[0][0])
    product, left, right = np.zeros((n, n)), np.zeros(n), np.zeros(n)
    for v, w in pairs:
        length = v.shape[1] - abs(lag)
        if length <= 0:
            continue
        a = v[:, max(0, -lag) : max(0, -lag) + length]
        b = w[:, max(0, lag) : max(0, lag) + length]
        product += a @ b.T
        left += np.square(a).sum(axis=1)
        right += np.square(b).sum(axis=1)
    size = np.sqrt(left[:, None] * right[None])
    return np.divide(product, size, out=np.zeros((n, n)), where=size > 0.0)


def _fit(
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
