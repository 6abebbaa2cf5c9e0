"""What is fitted beside a reading: friction, offsets, and numbers all joints share; its score."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array
from steelyard.model.equations.inverse_dynamics import Scalar
from steelyard.symbolic.native.compiled_programs import Code, compiled
from steelyard.symbolic.program_and_softening import InputArray as Input
from steelyard.symbolic.program_and_softening import Program

FRICTION_DRIFT = (0.5, 1.8)  # range of a log's friction relative to the reference's
REST_SPEED = 0.03  # speed up to which a joint rests, relative to its fastest
NUISANCES, OFFSET_COLUMN = 4, 2  # tanh, speed, one, acceleration; which is one
COORDINATE_SWEEPS = 40
ROUNDING = 1e-9  # relative size of what rounding leaves, and of ridges that keep it harmless
REWEIGHTINGS = 4  # fits that weigh rows by what the fit before leaves


def fit_nuisances(
    yy: Array,
    ye: Array,
    ee: Array,
    scale: Array,
    lower: Array,
    upper: Array,
    sweeps: int = COORDINATE_SWEEPS,
) -> tuple[Array, Array]:
    r"""Least $\|s\,e - y_5 - Y\theta\|^2$ within bounds `(..., 4)`, by sweeps of coordinates.

    By products of the four nuisances and the prediction `(..., 5, 5)`, of these with the effort
    `(..., 5)`, its square and the scale $s$, each `(...)`. Squares that are left, shape `(...)`,
    and $\theta$, shape `(..., 4)`.
    """
    b = scale[..., None] * ye[..., :4] - yy[..., :4, 4]
    b = np.broadcast_to(b, np.broadcast_shapes(b.shape, lower.shape))
    h = np.broadcast_to(yy[..., :4, :4], (*b.shape, 4))
    vectors = (np.broadcast_to(x, b.shape).reshape(-1, NUISANCES).T for x in (b, lower, upper))
    theta = _coordinates(sweeps)([h.reshape(-1, NUISANCES**2).T, *vectors])
    theta = np.ascontiguousarray(theta.T).reshape(b.shape)
    constant = scale**2 * ee - 2.0 * scale * ye[..., 4] + yy[..., 4, 4]
    bent = np.sum((h @ theta[..., None])[..., 0] * theta, axis=-1)
    return np.maximum(constant - 2.0 * np.sum(b * theta, axis=-1) + bent, 0.0), theta


@cache
def _coordinates(sweeps: int) -> Code:
    r"""Sweeps to the least $\theta^T H\theta - 2 b^T\theta$: code of $H$, $b$, bounds; `theta`."""

    def build() -> tuple[Program, dict[str, Any]]:
        from steelyard.symbolic.symbols_and_tracing import symbolic

        def swept(
            h: Sequence[Scalar],
            b: Sequence[Scalar],
            lower: Sequence[Scalar],
            upper: Sequence[Scalar],
        ) -> Sequence[Scalar]:
            diagonal = [np.maximum(h[(NUISANCES + 1) * k], 1e-300) for k in range(NUISANCES)]
            theta = [np.minimum(np.maximum(0.0, x), y) for x, y in zip(lower, upper, strict=True)]
            for _ in range(sweeps):
                for k in range(NUISANCES):
                    one, *rest = (j for j in range(NUISANCES) if j != k)
                    others = h[NUISANCES * k + one] * theta[one]
                    for j in rest:
                        others = others + h[NUISANCES * k + j] * theta[j]
                    free = (b[k] - others) / diagonal[k]
                    theta[k] = np.minimum(np.maximum(free, lower[k]), upper[k])
            return theta

        sizes = {"h": NUISANCES**2} | dict.fromkeys(("b", "lower", "upper"), NUISANCES)
        return symbolic(swept, [Input(name, size) for name, size in sizes.items()]), {}

    return compiled(["friction within bounds", sweeps], build)


WIDE_STD = 1e6


def shared_fit(
    residual: Array,
    columns: Array,
    nuisances: Array,
    bounds: tuple[Array, Array],
    size: Array,
    worth: float,
    prior: Array,
) -> tuple[Array, Array]:
    r"""Weighted least squares of $r_j = C_j x + Y_j \theta_j$ over all joints: $x$, its covariance.

    Every joint weighs by its own residuals; bounds, each `(n, 4)`, are taken as a normal
    distribution of their width.

    Args:
        residual: Efforts less what is predicted without the columns, shape `(n, B)`, zero where a
            joint does not count.
        columns: Shape `(k, n, B)`.
        nuisances: Shape `(n, 4, B)`.
        bounds: Least and largest nuisances.
        size: Least standard deviation of each joint's residuals, shape `(n,)`.
        worth: Independent samples per sample.
        prior: Standard deviation of the numbers around zero, shape `(k,)`.
    """
    k, known = len(columns), np.isfinite(bounds).all(axis=0)
    low, high = (np.where(known, side, 0.0) for side in bounds)
    unit = np.maximum(size, 1e-12)[:, None]
    width = np.where(known, np.maximum(0.5 * (high - low), 1e-9 * unit), WIDE_STD * unit)
    middle = np.concatenate((np.zeros(k), 0.5 * (low + high).reshape(-1)))
    std = np.concatenate((prior, width.reshape(-1)))  # of all unknowns, which are in units of it
    x = np.zeros((len(residual), len(std), residual.shape[1]))
    x[:, :k] = np.moveaxis(columns, 0, 1) * (nuisances[:, 2:3] != 0.0)
    for j, own in enumerate(nuisances):
        x[j, k + NUISANCES * j : k + NUISANCES * (j + 1)] = own
    x *= std[:, None]
    squares, products = x @ x.swapaxes(1, 2), (x @ residual[..., None])[..., 0]
    count = np.maximum(np.count_nonzero(nuisances[:, 2], axis=1), 1)
    variance = np.maximum(np.mean(np.square(residual), axis=1), np.square(size))
    for _ in range(REWEIGHTINGS):
        weight = worth / variance
        covariance = np.linalg.inv(np.tensordot(weight, squares, 1) + np.eye(len(std)))
        values = covariance @ (np.tensordot(weight, products, 1) + middle / std)
        left = residual - values @ x
        variance = np.maximum(np.sum(np.square(left), axis=1) / count, np.square(size))
    return (std * values)[:k], (std[:, None] * covariance * std)[:k, :k]


SHARP_DELAY_FLOOR = 0.002  # floor of misfits where two delays of one model are compared
MISFIT_FLOOR = 0.03  # misfit that no model of a real robot is expected to stay below
MOST_SAMPLE_COUNT = 100.0
"""Most independent samples that a joint counts for: errors of a model are not noise."""
LEAST_SAMPLE_COUNT = 8.0  # least independent samples of a joint in motion for it to count
RESTING_SPEED_SHARE = 0.01  # speed up to which a joint rests, relative to the fastest joint
LEAST_SPAN = 0.02  # range of positions from which on a joint counts as moving [rad; m]
WORST_MISFIT = 1e3  # largest misfit that is distinguished from larger ones


@dataclass(frozen=True, eq=False)
class EffortProducts:
    """Products of samples of every joint in motion with every effort column; `h` readings."""

    yy: Array  # of tanh, speed, one, acceleration and prediction, shape `(h, n, 5, 5)`
    ye: Array  # of these with the effort columns, shape `(h, n, 5, n)`
    ee: Array  # squares of the effort columns, shape `(h, n, n)`
    count: Array  # independent samples in motion, shape `(h, n)`
    pushed: Array  # squares of what contacts and bodies of a floating base do, shape `(h, n)`

    def of(self, which: Sequence[int] | NDArray[np.intp]) -> "EffortProducts":
        """Those of some readings, by number; one may be there several times."""
        rows = np.asarray(which)
        every = self.yy, self.ye, self.ee, self.count, self.pushed
        return EffortProducts(*(products[rows] for products in every))


@dataclass(frozen=True, eq=False)
class LikelihoodScore:
    """How well readings agree with what is known; `...` readings."""

    misfits: Array  # of every joint, 1 for one that does not count, shape `(..., n)`
    counts: Array  # independent samples that every joint counts for, shape `(..., n)`
    nuisances: Array  # friction, offset and rotor inertia, shape `(..., n, 4)`

    @property
    def log_likelihood(self) -> Array:
        """Up to a constant of the log, shape `(...)`."""
        return self.log_likelihood_with(MISFIT_FLOOR, MOST_SAMPLE_COUNT)

    def log_likelihood_with(self, floor: float, most: float) -> Array:
        """With a given floor and most samples per joint."""
        logs = np.log(np.square(self.misfits) + floor**2)
        return np.asarray(-0.5 * np.sum(np.minimum(self.counts, most) * logs, axis=-1))

    @property
    def sharp(self) -> float:
        """That of one reading where two delays of one model are compared."""
        return float(self.log_likelihood_with(SHARP_DELAY_FLOOR, np.inf))

    @property
    def percent(self) -> Array:
        """Typical misfit [%], shape `(...)`."""
        counts = np.minimum(self.counts, MOST_SAMPLE_COUNT)
        shares = counts / np.maximum(counts.sum(axis=-1, keepdims=True), 1e-12)
        mean = np.sum(shares * np.log(np.maximum(self.misfits, 1e-6)), axis=-1)
        return np.asarray(100.0 * np.exp(mean))

    def one(self, index: int) -> "LikelihoodScore":
        """That of one of several readings."""
        return LikelihoodScore(self.misfits[index], self.counts[index], self.nuisances[index])


def regressors(q: Array, u: Array, du: Array, predicted: Array) -> tuple[Array, Array]:
    """Columns `(n, h, 5, B)`, zero where a joint rests, and where it moves, `(n, h, B)`."""
    fastest = np.quantile(np.abs(u), 0.98, axis=-1)
    low, high = np.quantile(q, (0.02, 0.98), axis=-1)
    rest = np.maximum(REST_SPEED * fastest, RESTING_SPEED_SHARE * fastest.max(axis=0))
    rest = np.maximum(rest, 1e-12)[..., None]
    moving = (np.abs(u) > rest) & (high - low > LEAST_SPAN)[..., None] & np.isfinite(predicted)
    y = np.stack((np.tanh(u / rest), u, np.ones_like(u), du, np.nan_to_num(predicted)), axis=2)
    return y * moving[:, :, None], moving.astype(np.float64)


def score_of(squares: Array, whole: Array, counts: Array, nuisances: Array) -> LikelihoodScore:
    """Misfits from squares of what is left and of the whole."""
    seen = counts >= LEAST_SAMPLE_COUNT
    misfits = np.sqrt(squares / np.maximum(whole, 1e-30))
    misfits = np.where(seen, np.minimum(misfits, WORST_MISFIT), 1.0)
    return LikelihoodScore(misfits, np.where(seen, counts, 0.0), nuisances)
