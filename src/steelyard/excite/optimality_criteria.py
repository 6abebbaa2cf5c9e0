r"""Optimality criteria: functions of the information matrix of the chosen parameters.

The information matrix is $G = \sum_i w_i\,y_i y_i^T$ over all rows $y_i$ of the regressor (samples
times joints), with the weights of joints and noise: $G^{-1}$ is then the covariance of the
estimate [Swevers1997], [Pukelsheim2006].
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array, frozen

DEFINITE_EIGENVALUE = 1e-13  # least eigenvalue over the norm that is positive beyond rounding
FAINT_EIGENVALUE = 1e-9
"""With an eigenvalue below this part of the largest, the small ones are taken from the inverse:
where units of columns made them small, they are exact there. Above, the matrix is definite."""

Spectrum = tuple[Array, Array]  # eigenvalues, ascending, `(c,)`, and their vectors, `(c, c)`


def excited(gram: Array) -> bool:
    """Whether all is finite, and every column has information of its own."""
    return bool(np.all(np.diagonal(gram) > 0.0) and np.all(np.isfinite(gram)))


def definite(gram: Array) -> bool:
    """Whether a symmetric matrix `(c, c)` is positive definite beyond rounding.

    Judged with its diagonal scaled to one, so that units of columns play no part.
    """
    if not excited(gram):
        return False
    unit, _ = equilibrated(gram)
    np.fill_diagonal(unit, 1.0 - DEFINITE_EIGENVALUE * float(np.linalg.norm(unit)))
    try:
        np.linalg.cholesky(unit)
    except np.linalg.LinAlgError:
        return False
    return True


def scaled(matrix: Array, d: Array) -> Array:
    """Rows and columns multiplied with `d`."""
    return np.asarray(matrix * d[:, None] * d)


def equilibrated(gram: Array) -> tuple[Array, Array]:
    """With a diagonal of ones; and what its rows and columns were multiplied with, `(c,)`."""
    d = 1.0 / np.sqrt(np.diagonal(gram))
    return scaled(gram, d), d


def inverse(gram: Array) -> Array:
    """Of a definite matrix; its error grows with the condition of the equilibrated one only."""
    unit, d = equilibrated(gram)
    half = 0.5 * np.linalg.inv(unit)
    return scaled(half + half.T, d)


def spectra(gram: Array) -> tuple[Spectrum, Spectrum] | None:
    """Of a symmetric matrix, and of its inverse; `None` if it is not definite beyond rounding."""
    if not np.all(np.isfinite(gram)):
        return None
    values, vectors = np.linalg.eigh(gram)
    if values[0] > FAINT_EIGENVALUE * values[-1]:
        return (values, vectors), (1.0 / values[::-1], vectors[:, ::-1])
    if not definite(gram):
        return None
    spreads, axes = np.linalg.eigh(inverse(gram))
    return (values, vectors), (spreads, axes)


def soft_greatest(values: Array, sharpness: float) -> tuple[float, Array]:
    r"""$\frac1p \log \sum_i \lambda_i^p$ of eigenvalues in ascending order; its slope by them.

    Those that are rounding next to the largest count as that rounding. At an infinite sharpness it
    is the logarithm of the largest; its slope is not given then.
    """
    if math.isinf(sharpness):
        return math.log(values[-1]), np.zeros_like(values)
    logs = np.log(np.maximum(values / values[-1], np.finfo(np.float64).eps))
    weights = np.exp(sharpness * logs)
    total = float(np.sum(weights))
    value = math.log(values[-1]) + math.log(total) / sharpness
    return value, np.exp((sharpness - 1.0) * logs) / (total * values[-1])


def assembled(vectors: Array, values: Array) -> Array:
    r"""$V \mathrm{diag}(v) V^T$."""
    return np.asarray((vectors * values) @ vectors.T)


@dataclass(frozen=True, eq=False)
class Criterion:
    r"""A scalar of an information matrix; less is better. The name is for messages and reports.

    At a sharpness $p$ `smooth` gives a smooth approximation of the logarithm of the value, by the
    $p$-norm over eigenvalues, and its symmetric slope $\partial/\partial G$, `(c, c)`: a change
    $dG$ changes the value by $\sum_{ij} S_{ij}\,dG_{ij}$. With growing sharpness it falls to the
    logarithm of `value`: its distance is at most $\log(c)/p$ for $c$ columns. A matrix that is not
    positive definite beyond rounding, such as one with a column that nothing excites, has the value
    infinity, and zeros as slope. Columns that matter are `chosen`; all if `None`.
    """

    name: str
    smooth: Callable[[Array, float], tuple[float, Array]]
    chosen: tuple[int, ...] | None = None

    def value(self, gram: Array) -> float:
        """The value itself, from `smooth` at an infinite sharpness: the norm without softening."""
        return math.exp(self.smooth(gram, math.inf)[0])


def condition(gram: Array, sharpness: float) -> tuple[float, Array]:
    r"""Condition number of the regressor as it is, $\sqrt{\lambda_{max}/\lambda_{min}}$ of $G$.

    Smooth: $\frac{1}{2p}\left(\log\sum_i\lambda_i^p + \log\sum_i\lambda_i^{-p}\right)$.
    """
    both = spectra(gram)
    if both is None:
        return _unknown_criterion(gram)
    (values, vectors), (spreads, axes) = both
    high, rise = soft_greatest(values, sharpness)
    low, fall = soft_greatest(spreads, sharpness)
    slope = assembled(vectors, rise) - assembled(axes, fall * spreads**2)
    return 0.5 * (high + low), 0.5 * slope


def normalised_condition(gram: Array, sharpness: float) -> tuple[float, Array]:
    r"""Condition number once every column of the regressor has unit norm: free of units.

    That of $D G D$ with $D = \mathrm{diag}(G)^{-1/2}$; the slope goes through $D$ too.
    """
    if not excited(gram):
        return _unknown_criterion(gram)
    unit, d = equilibrated(gram)
    value, slope = condition(unit, sharpness)
    through = np.diag(np.sum(slope * unit, axis=1))
    return value, scaled(slope - through, d)


def d_optimal(gram: Array, sharpness: float) -> tuple[float, Array]:
    r"""Geometric mean of the variances along the axes of the covariance, $\det(G)^{-1/c}$.

    Smooth at any sharpness: $-\log\det(G)/c$. Column scales only add a constant to it.
    """
    if not definite(gram):
        return _unknown_criterion(gram)
    unit, d = equilibrated(gram)
    half = np.sum(np.log(np.diagonal(np.linalg.cholesky(unit)))) - np.sum(np.log(d))
    return -2.0 * float(half) / len(gram), inverse(gram) / -len(gram)


def a_optimal(gram: Array, sharpness: float) -> tuple[float, Array]:
    r"""Sum of the parameters' variances, $\mathrm{tr}\,G^{-1}$: give `measure` sizes with it.

    Smooth at any sharpness: $\log\mathrm{tr}\,G^{-1}$.
    """
    if not definite(gram):
        return _unknown_criterion(gram)
    covariance = inverse(gram)
    total = float(np.trace(covariance))
    return math.log(total), covariance @ covariance / -total


def e_optimal(gram: Array, sharpness: float) -> tuple[float, Array]:
    r"""Variance of the worst shown combination of parameters, $\lambda_{max}(G^{-1})$.

    Smooth: $\frac{1}{p}\log\sum_i\lambda_i^{-p}$.
    """
    both = spectra(gram)
    if both is None:
        return _unknown_criterion(gram)
    spreads, axes = both[1]
    value, fall = soft_greatest(spreads, sharpness)
    return value, assembled(axes, -fall * spreads**2)


def _unknown_criterion(gram: Array) -> tuple[float, Array]:
    return math.inf, np.zeros_like(gram)


CRITERIA: Mapping[str, Criterion] = {
    "condition": Criterion("condition number (raw)", condition),
    "normalised_condition": Criterion(
        "condition number (columns of unit norm)", normalised_condition
    ),
    "d_optimal": Criterion("D-optimality (geometric mean of variances)", d_optimal),
    "a_optimal": Criterion("A-optimality (sum of variances)", a_optimal),
    "e_optimal": Criterion("E-optimality (largest variance)", e_optimal),
}
"""By the name in a problem file; a new criterion is a function and a line here."""


def worst(
    cases: Sequence[tuple[Criterion, Array]], sharpness: float
) -> tuple[float, tuple[Array, ...]]:
    r"""Smooth maximum of criteria over cases such as payloads, $\frac1p\log\sum_k e^{p\,s_k}$.

    The order $p$ is the `sharpness`; at an infinite one it is the logarithm of the largest value,
    as people read it, and has no slope. Else also its slope by each information matrix.
    """
    values, slopes = zip(*(kind.smooth(gram, sharpness) for kind, gram in cases), strict=True)
    highest = max(values)
    if math.isinf(highest) or math.isinf(sharpness):
        return highest, tuple(np.zeros_like(gram) for _, gram in cases)
    shares = np.exp(sharpness * (np.array(values) - highest))
    total = float(np.sum(shares))
    weighted = tuple(share / total * slope for share, slope in zip(shares, slopes, strict=True))
    return highest + math.log(total) / sharpness, weighted


def measure(
    kind: Criterion,
    prior: Array | None = None,
    chosen: tuple[int, ...] | None = None,
    sizes: Array | None = None,
) -> Criterion:
    """A criterion of what a motion adds to earlier runs, of chosen parameters, in fitting units.

    In this order: $G + G_0$ with the `prior` information, positive semidefinite; then the Schur
    complement $G_{cc} - G_{cr} G_{rr}^{-1} G_{rc}$ of the chosen columns $c$, all if `None`, the
    inverse of their block of the covariance, for all others $r$ are estimated along with them
    [Pukelsheim2006]; then $D G D$ with $D$ the expected `sizes` of all parameters, positive. A
    column outside the choice that nothing excites is not definite either: leave it out of $G$, or
    give prior information of it.
    """
    known = None if prior is None else frozen(prior, (len(prior),) * 2)
    scales = None if sizes is None else frozen(sizes, (None,))
    parts = [kind.name]
    parts += [] if chosen is None else [f"of {len(chosen)} chosen parameters"]
    parts += [] if known is None else ["with earlier runs"]
    parts += [] if scales is None else ["relative to expected values"]

    def smooth(gram: Array, sharpness: float) -> tuple[float, Array]:
        total = gram if known is None else gram + known
        pull = np.eye(len(total))  # $M$, `(c, k)`, for slopes $M S M^T$
        if chosen is not None:
            if not definite(total):
                return _unknown_criterion(gram)
            total, pull = _complement(total, np.array(chosen, dtype=np.intp))
        if scales is not None:
            own = scales if chosen is None else scales[list(chosen)]
            total, pull = scaled(total, own), pull * own
        value, slope = kind.smooth(total, sharpness)
        return value, pull @ slope @ pull.T

    return Criterion(", ".join(parts), smooth, chosen)


def _complement(gram: Array, chosen: NDArray[np.intp]) -> tuple[Array, Array]:
    r"""Schur complement of the chosen columns, `(k, k)`, and $[I; -G_{rr}^{-1} G_{rc}]$, `(c, k)`.

    By Cholesky with the others first: the last block of its factor is that of the complement.
    """
    others = np.setdiff1d(np.arange(len(gram)), chosen)
    order, m = np.concatenate((others, chosen)), len(others)
    d = np.sqrt(np.diagonal(gram)[order])
    factor = np.linalg.cholesky(gram[np.ix_(order, order)] / d[:, None] / d)
    last = factor[m:, m:] * d[m:, None]
    pull = np.zeros((len(gram), len(chosen)))
    pull[chosen, np.arange(len(chosen))] = 1.0
    share = np.linalg.solve(factor[:m, :m].T, factor[m:, :m].T)
    pull[others] = -share / d[:m, None] * d[m:]
    return last @ last.T, pull
