"""What a criterion is computed of: chosen parameters, after earlier runs, in fitting units."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array, frozen
from steelyard.excitation.criteria.algebra import definite
from steelyard.excitation.criteria.criteria import Criterion


@dataclass(frozen=True, eq=False)
class Measure:
    r"""A criterion of what a motion adds to earlier runs, of chosen parameters, in fitting units.

    In this order: $G + G_0$; then the Schur complement
    $G_{cc} - G_{cr} G_{rr}^{-1} G_{rc}$ of the chosen columns $c$, the inverse of their block of
    the covariance, for all others $r$ are estimated along with them [Pukelsheim2006]; then
    $D G D$ with $D$ the sizes. A column outside the choice that nothing excites is not definite
    either: leave it out of $G$, or give prior information of it.

    Attributes:
        kind: The criterion.
        prior: Information $G_0$ of earlier runs in the same columns and weights, shape `(c, c)`,
            positive semidefinite; it need not be definite.
        chosen: Indices of the columns that matter; all, if `None`.
        sizes: Expected sizes of all parameters, shape `(c,)`, positive: the criterion then sees
            the information on the parameters in these units.
    """

    kind: Criterion
    prior: Array | None = None
    chosen: tuple[int, ...] | None = None
    sizes: Array | None = None

    def __post_init__(self) -> None:
        """Own what is kept.

        Raises:
            ValueError: Shapes do not fit, a size is not positive, or a column is chosen twice.
        """
        if self.prior is not None:
            object.__setattr__(self, "prior", frozen(self.prior, (len(self.prior),) * 2))
        if self.sizes is not None:
            object.__setattr__(self, "sizes", frozen(self.sizes, (None,)))
            if not np.all(self.sizes > 0.0):
                raise ValueError("sizes of parameters must be positive")
        if self.chosen is not None and (
            not self.chosen or min(self.chosen) < 0 or len(set(self.chosen)) < len(self.chosen)
        ):
            raise ValueError("chosen columns must be some, from 0 on, and each one once")

    @property
    def name(self) -> str:
        """The criterion's, and what it is computed of."""
        parts = [self.kind.name]
        parts += [] if self.chosen is None else [f"of {len(self.chosen)} chosen parameters"]
        parts += [] if self.prior is None else ["with earlier runs"]
        parts += [] if self.sizes is None else ["relative to expected values"]
        return ", ".join(parts)

    def smooth(self, gram: Array, sharpness: float) -> tuple[float, Array]:
        """See `Criterion`."""
        seen = self._seen(gram)
        if seen is None:
            return math.inf, np.zeros_like(gram)
        of_interest, pull = seen
        value, slope = self.kind.smooth(of_interest, sharpness)
        return value, slope if pull is None else pull @ slope @ pull.T

    def value(self, gram: Array) -> float:
        """See `Criterion`."""
        seen = self._seen(gram)
        return math.inf if seen is None else self.kind.value(seen[0])

    def _seen(self, gram: Array) -> tuple[Array, Array | None] | None:
        """What the criterion is given, `(k, k)`, and $M$ `(c, k)` for slopes $M S M^T$.

        `None` in place of both says that nothing is definite; in place of $M$, that $M = I$.
        """
        total = gram if self.prior is None else gram + self.prior
        pull: Array | None = None
        if self.chosen is not None:
            if not definite(total):
                return None
            total, pull = _complement(total, np.array(self.chosen, dtype=np.intp))
        if self.sizes is not None:
            sizes = self.sizes if self.chosen is None else self.sizes[list(self.chosen)]
            total = total * sizes[:, None] * sizes
            pull = np.diag(sizes) if pull is None else pull * sizes
        return total, pull


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
