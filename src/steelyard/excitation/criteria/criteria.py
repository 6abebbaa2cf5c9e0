r"""How well a motion shows the parameters: functions of its information matrix, with exact slopes.

The information matrix is $G = \sum_i w_i\,y_i y_i^T$ over all rows $y_i$ of the regressor (samples
times joints), with the weights of joints and noise: $G^{-1}$ is then the covariance of the
estimate [Swevers1997], [Pukelsheim2006].
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Protocol

import numpy as np

from steelyard.arrays import Array
from steelyard.excitation.criteria.algebra import (
    assembled,
    definite,
    equilibrated,
    excited,
    inverse,
    scaled,
    soft_greatest,
    spectra,
)


class Criterion(Protocol):
    r"""A scalar of an information matrix; less is better.

    With growing sharpness, `smooth` falls to the logarithm of `value`: its distance is at most
    $\log(c)/p$ for $c$ columns and sharpness $p$. A matrix that is not positive definite beyond
    rounding, such as one with a column that nothing excites, has the value infinity.

    Attributes:
        name: For messages and reports, such as `condition number (raw)`.
    """

    @property
    def name(self) -> str:
        """For messages and reports."""
        ...

    def smooth(self, gram: Array, sharpness: float) -> tuple[float, Array]:
        r"""A smooth approximation of the logarithm of the value, to be minimised.

        Args:
            gram: Information $G$, symmetric, shape `(c, c)`.
            sharpness: The order $p > 0$ of the norm over eigenvalues.

        Returns:
            The value, and its symmetric slope $\partial/\partial G$, shape `(c, c)`: a change
            $dG$ changes the value by $\sum_{ij} S_{ij}\,dG_{ij}$; zeros where it is infinite.
        """
        ...

    def value(self, gram: Array) -> float:
        """The value itself."""
        ...


@dataclass(frozen=True)
class Condition:
    r"""Condition number of the regressor as it is, $\sqrt{\lambda_{max}/\lambda_{min}}$ of $G$.

    Smooth: $\frac{1}{2p}\left(\log\sum_i\lambda_i^p + \log\sum_i\lambda_i^{-p}\right)$.
    """

    name: str = "condition number (raw)"

    def smooth(self, gram: Array, sharpness: float) -> tuple[float, Array]:
        """See `Criterion`."""
        both = spectra(gram)
        if both is None:
            return _unknown(gram)
        (values, vectors), (spreads, axes) = both
        high, rise = soft_greatest(values, sharpness)
        low, fall = soft_greatest(spreads, sharpness)
        slope = assembled(vectors, rise) - assembled(axes, fall * spreads**2)
        return 0.5 * (high + low), 0.5 * slope

    def value(self, gram: Array) -> float:
        """See `Criterion`."""
        both = spectra(gram)
        return math.inf if both is None else math.sqrt(both[0][0][-1] * both[1][0][-1])


@dataclass(frozen=True)
class NormalisedCondition:
    r"""Condition number once every column of the regressor has unit norm: free of units.

    That of $D G D$ with $D = \mathrm{diag}(G)^{-1/2}$; the slope goes through $D$ too.
    """

    name: str = "condition number (columns of unit norm)"

    def smooth(self, gram: Array, sharpness: float) -> tuple[float, Array]:
        """See `Criterion`."""
        if not excited(gram):
            return _unknown(gram)
        unit, d = equilibrated(gram)
        value, slope = Condition().smooth(unit, sharpness)
        through = np.diag(np.sum(slope * unit, axis=1))
        return value, scaled(slope - through, d)

    def value(self, gram: Array) -> float:
        """See `Criterion`."""
        return Condition().value(equilibrated(gram)[0]) if excited(gram) else math.inf


@dataclass(frozen=True)
class DOptimal:
    r"""Geometric mean of the variances along the axes of the covariance, $\det(G)^{-1/c}$.

    Smooth at any sharpness: $-\log\det(G)/c$. Column scales only add a constant to it.
    """

    name: str = "D-optimality (geometric mean of variances)"

    def smooth(self, gram: Array, sharpness: float) -> tuple[float, Array]:
        """See `Criterion`; the sharpness plays no part."""
        if not definite(gram):
            return _unknown(gram)
        unit, d = equilibrated(gram)
        half = np.sum(np.log(np.diagonal(np.linalg.cholesky(unit)))) - np.sum(np.log(d))
        return -2.0 * float(half) / len(gram), inverse(gram) / -len(gram)

    def value(self, gram: Array) -> float:
        """See `Criterion`."""
        return math.exp(self.smooth(gram, 1.0)[0])


@dataclass(frozen=True)
class AOptimal:
    r"""Sum of the parameters' variances, $\mathrm{tr}\,G^{-1}$: give `Measure.sizes` with it.

    Smooth at any sharpness: $\log\mathrm{tr}\,G^{-1}$.
    """

    name: str = "A-optimality (sum of variances)"

    def smooth(self, gram: Array, sharpness: float) -> tuple[float, Array]:
        """See `Criterion`; the sharpness plays no part."""
        if not definite(gram):
            return _unknown(gram)
        covariance = inverse(gram)
        total = float(np.trace(covariance))
        return math.log(total), covariance @ covariance / -total

    def value(self, gram: Array) -> float:
        """See `Criterion`."""
        return math.exp(self.smooth(gram, 1.0)[0])


@dataclass(frozen=True)
class EOptimal:
    r"""Variance of the worst shown combination of parameters, $\lambda_{max}(G^{-1})$.

    Smooth: $\frac{1}{p}\log\sum_i\lambda_i^{-p}$.
    """

    name: str = "E-optimality (largest variance)"

    def smooth(self, gram: Array, sharpness: float) -> tuple[float, Array]:
        """See `Criterion`."""
        both = spectra(gram)
        if both is None:
            return _unknown(gram)
        spreads, axes = both[1]
        value, fall = soft_greatest(spreads, sharpness)
        return value, assembled(axes, -fall * spreads**2)

    def value(self, gram: Array) -> float:
        """See `Criterion`."""
        both = spectra(gram)
        return math.inf if both is None else float(both[1][0][-1])


KINDS: Mapping[str, Criterion] = MappingProxyType(
    {
        "condition": Condition(),
        "normalised_condition": NormalisedCondition(),
        "d_optimal": DOptimal(),
        "a_optimal": AOptimal(),
        "e_optimal": EOptimal(),
    }
)
"""By the name in a problem file; a new criterion is a class and a line here."""


def worst(
    cases: Sequence[tuple[Criterion, Array]], sharpness: float
) -> tuple[float, tuple[Array, ...]]:
    r"""Smooth maximum of criteria over cases such as payloads, $\frac1p\log\sum_k e^{p\,s_k}$.

    Args:
        cases: Criteria, and the information matrix of each.
        sharpness: The order $p$, of the criteria too.

    Returns:
        The value, and its slope by each information matrix.
    """
    values, slopes = zip(*(kind.smooth(gram, sharpness) for kind, gram in cases), strict=True)
    highest = max(values)
    if math.isinf(highest):
        return math.inf, tuple(np.zeros_like(gram) for _, gram in cases)
    shares = np.exp(sharpness * (np.array(values) - highest))
    total = float(np.sum(shares))
    weighted = tuple(share / total * slope for share, slope in zip(shares, slopes, strict=True))
    return highest + math.log(total) / sharpness, weighted


def worst_value(cases: Sequence[tuple[Criterion, Array]]) -> float:
    """The largest value over cases, as people read it."""
    return max(kind.value(gram) for kind, gram in cases)


def _unknown(gram: Array) -> tuple[float, Array]:
    return math.inf, np.zeros_like(gram)
