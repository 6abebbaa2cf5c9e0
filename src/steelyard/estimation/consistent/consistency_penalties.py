r"""How far bodies may go from their priors: penalties on $X$, the scaled pseudo-inertia.

Every form keeps $X \succeq \delta 1$: a body with margin.
"""

from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np

from steelyard.arrays import Array
from steelyard.estimation.consistent.conic import Block
from steelyard.estimation.consistent.unknowns import BASIS, ENTRIES, ORDER

_DIAGONAL = np.array([k for k, (i, j) in enumerate(ENTRIES) if i == j])
_TWICE = np.array([1.0 if i == j else 2.0 for i, j in ENTRIES])

FAINT = 1e-6
"""Weight that keeps bodies without prior bounded."""


@dataclass(frozen=True, eq=False)
class Part:
    """What one body adds to a program.

    Attributes:
        square: Quadratic cost of its ten unknowns, then of its helpers.
        linear: Linear cost of the same.
        blocks: Cones over the same; columns count from the body's first unknown, helpers from 10.
    """

    square: Array
    linear: Array
    blocks: tuple[Block, ...]


class Form(Protocol):
    """A penalty on a body's distance from its prior."""

    name: ClassVar[str]
    penalises: ClassVar[bool]

    @property
    def margin(self) -> float:
        """Least eigenvalue of `X`."""
        ...

    def part(self, gamma: float) -> Part:
        """Cost and cones of one body, the penalty times `gamma`."""
        ...

    def cost(self, x: Array) -> float:
        """The penalty of one `X`, shape `(4, 4)`; zero at the prior."""
        ...

    def slope(self, x: Array) -> Array:
        """Derivative of the penalty by the ten entries of `X`, shape `(10,)`."""
        ...

    def curvature(self, x: Array) -> Array:
        """Second derivative of the penalty by the ten entries of `X`, shape `(10, 10)`."""
        ...


@dataclass(frozen=True)
class Entropic:
    r"""$\mathrm{tr}\,X - \log\det X - 4$, the divergence of two mass distributions [Lee2020].

    In cones: $\log\det X \ge \sum_k t_k$ where $\begin{pmatrix} X & Z \\ Z^T & D
    \end{pmatrix} \succeq 0$, $Z$ lower triangular, $D$ its diagonal, $t_k \le \log D_{kk}$.
    """

    name: ClassVar[str] = "entropic"
    penalises: ClassVar[bool] = True
    margin: float = 1e-3

    def part(self, gamma: float) -> Part:
        """Ten entries of `Z` and four logarithms help."""
        linear = np.zeros(24)
        linear[_DIAGONAL] = gamma
        linear[20:] = -gamma
        return Part(np.zeros(24), linear, (_bordered(), *_logarithms(), _apart(self.margin)))

    def cost(self, x: Array) -> float:
        """The divergence."""
        return float(np.trace(x) - np.linalg.slogdet(x)[1] - ORDER)

    def slope(self, x: Array) -> Array:
        r"""$\mathrm{tr}((1 - X^{-1}) E_a)$."""
        return np.asarray(np.tensordot(BASIS, np.eye(ORDER) - np.linalg.inv(x), axes=2))

    def curvature(self, x: Array) -> Array:
        r"""$\mathrm{tr}(X^{-1} E_a X^{-1} E_b)$."""
        turned = np.linalg.solve(x, BASIS)
        return np.asarray(np.einsum("aij,bji->ab", turned, turned))


@dataclass(frozen=True)
class Pullback:
    r"""$\tfrac12 \|X - 1\|_F^2$: the divergence to second order, a quadratic [Lee2018]."""

    name: ClassVar[str] = "quadratic"
    penalises: ClassVar[bool] = True
    margin: float = 1e-3

    def part(self, gamma: float) -> Part:
        """A quadratic around the prior; no helpers."""
        linear = np.zeros(10)
        linear[_DIAGONAL] = -gamma
        return Part(gamma * _TWICE, linear, (_apart(self.margin),))

    def cost(self, x: Array) -> float:
        """Half the squared distance."""
        return 0.5 * float(np.square(x - np.eye(ORDER)).sum())

    def slope(self, x: Array) -> Array:
        r"""$\mathrm{tr}((X - 1) E_a)$."""
        return np.asarray(np.tensordot(BASIS, x - np.eye(ORDER), axes=2))

    def curvature(self, x: Array) -> Array:
        """The same everywhere."""
        return np.diag(_TWICE)


@dataclass(frozen=True)
class Free:
    """No penalty beyond physical consistency.

    What no data show is kept from growing without bound: 1000 times the prior costs one half.
    """

    name: ClassVar[str] = "free"
    penalises: ClassVar[bool] = False
    margin: float = 1e-3

    def part(self, gamma: float) -> Part:
        """The margin, and hardly more."""
        return Part(FAINT * _TWICE, np.zeros(10), (_apart(self.margin),))

    def cost(self, x: Array) -> float:
        """Next to nothing."""
        return 0.5 * FAINT * float(_TWICE @ np.square(x[tuple(zip(*ENTRIES, strict=True))]))

    def slope(self, x: Array) -> Array:
        """Next to nothing."""
        return FAINT * _TWICE * x[tuple(zip(*ENTRIES, strict=True))]

    def curvature(self, x: Array) -> Array:
        """Next to nothing."""
        return np.diag(FAINT * _TWICE)


def _triangle(order: int, entries: dict[tuple[int, int], list[int]], width: int) -> Array:
    """Rows of a matrix's upper triangle whose entry `(i, j)` is the sum of some unknowns."""
    rows = []
    for j in range(order):
        for i in range(j + 1):
            row = np.zeros(width)
            row[entries.get((i, j), [])] = 1.0 if i == j else np.sqrt(2.0)
            rows.append(row)
    return np.array(rows)


def _apart(margin: float) -> Block:
    """`X - margin` is positive semidefinite."""
    matrix = _triangle(ORDER, {place: [k] for k, place in enumerate(ENTRIES)}, 10)
    offset = -margin * np.array([float(i == j) for i, j in ENTRIES])
    return Block("semidefinite", np.arange(10), -matrix, offset, ORDER)


def _bordered() -> Block:
    """`X` bordered by `Z` and its diagonal is positive semidefinite."""
    entries = {place: [k] for k, place in enumerate(ENTRIES)}
    for k, (i, j) in enumerate(ENTRIES):
        # Z is lower triangular: its entry (j, i) is the upper triangle's (i, j)
        entries[j, ORDER + i] = [10 + k]
        if i == j:
            entries[ORDER + i, ORDER + i] = [10 + k]
    matrix = _triangle(2 * ORDER, entries, 20)
    return Block("semidefinite", np.arange(20), -matrix, np.zeros(len(matrix)), 2 * ORDER)


def _logarithms() -> tuple[Block, ...]:
    """Each of the last four helpers is at most the logarithm of an entry of `D`."""
    return tuple(
        Block(
            "exponential",
            np.array([20 + k, 10 + diagonal]),
            np.array([[-1.0, 0.0], [0.0, 0.0], [0.0, -1.0]]),
            np.array([0.0, 1.0, 0.0]),
        )
        for k, diagonal in enumerate(_DIAGONAL)
    )
