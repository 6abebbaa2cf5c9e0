r"""Log-Cholesky coordinates of a body, the consistent estimate's criterion in them, its curvature.

A pseudo-inertia in the scale of its prior is $X = U U^T$ with a lower triangular $U$ whose diagonal
is $e^{a_i}$: every choice of the ten coordinates is a body, and zero is the prior.

Along the curves on which bodies go straight the data are linear and the priors convex, so that the
curvature is exact, and a step that is short enough always gains.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array
from steelyard.estimate.consistent.penalties import BASIS, ENTRIES, FAINT, ORDER
from steelyard.estimate.consistent.program import Program

_COLUMNS, _ROWS = np.array(ENTRIES).T
"""Of the coordinates in `U`: those of `ENTRIES`, transposed."""

_ON = _ROWS == _COLUMNS


def entries(coordinates: Array) -> tuple[Array, Array]:
    """Entries of `X`, as `ENTRIES` has them, shape `(10,)`, and their derivatives `(10, 10)`.

    Args:
        coordinates: Shape `(10,)`.
    """
    triangle = np.zeros((ORDER, ORDER))
    triangle[_ROWS, _COLUMNS] = np.where(_ON, np.exp(coordinates), coordinates)
    slopes = np.empty((len(ENTRIES), len(ENTRIES)))
    for k, (row, column) in enumerate(zip(_ROWS, _COLUMNS, strict=True)):
        change = np.zeros((ORDER, ORDER))
        change[row] = (triangle[row, row] if row == column else 1.0) * triangle[:, column]
        slopes[:, k] = (change + change.T)[_COLUMNS, _ROWS]
    return (triangle @ triangle.T)[_COLUMNS, _ROWS], slopes


Indices = NDArray[np.intp]

ONE = np.array([float(i == j) for i, j in ENTRIES])
"""Entries of the unit matrix."""


@dataclass(frozen=True, eq=False)
class Criterion:
    r"""The criterion over log-Cholesky coordinates, then other parameters.

    $\tfrac12\|A u - z\|^2 + \sum_i P_i(X_i) - \beta \log\det S_i$ with $X_i = \delta 1 + S_i$.

    Attributes:
        program: The convex program.
        gamma: Weight of the prior.
        barrier: $\beta$, which keeps coordinates from running off where the margin holds.
        free: Indices of the other unknowns that are not given.
        given: All unknowns with those that are given, the others zero.
        lower: Of the coordinates and of the free others.
        upper: The same.
    """

    program: Program
    gamma: float
    barrier: float
    free: Indices
    given: Array
    lower: Array
    upper: Array

    @classmethod
    def of(cls, program: Program, gamma: float) -> "Criterion":
        """The criterion with a weight of the prior, and no barrier."""
        known = program.unknowns
        bodies, ends = 10 * len(known.priors), bounds_of(program)
        free = np.flatnonzero(ends[0] < ends[1])
        given = np.zeros(len(known.weak))
        given[:bodies] = np.tile(program.form.margin * ONE, len(known.priors))
        fixed = np.flatnonzero(ends[0] >= ends[1])
        given[bodies + fixed] = ends[0][fixed]
        open_ended = np.full(bodies, np.inf)
        return cls(
            program,
            gamma,
            0.0,
            bodies + free,
            given,
            np.concatenate([-open_ended, ends[0][free]]),
            np.concatenate([open_ended, ends[1][free]]),
        )

    @property
    def start(self) -> Array:
        """The priors, and whatever bounds leave nearest to nothing."""
        return np.clip(np.zeros(len(self.lower)), self.lower, self.upper)

    @property
    def bodies(self) -> list[slice]:
        """Coordinates of every body, which are also the places of its unknowns."""
        return [slice(10 * k, 10 * k + 10) for k in range(len(self.program.unknowns.priors))]

    def unknowns_at(self, x: Array) -> tuple[Array, Array]:
        """The unknowns `(m,)`, and their derivatives by the coordinates `(m, len(x))`."""
        u, slopes = self.given.copy(), np.zeros((len(self.given), len(x)))
        for part in self.bodies:
            numbers, slopes[part, part] = entries(x[part])
            u[part] += numbers
        count = 10 * len(self.bodies)
        u[self.free] = x[count:]
        slopes[self.free, np.arange(count, len(x))] = 1.0
        return u, slopes

    def plain(self, x: Array) -> float:
        """The criterion without the barrier."""
        return self.program.cost(self.unknowns_at(x)[0], self.gamma)

    def cost(self, x: Array) -> float:
        """The criterion."""
        with np.errstate(over="ignore", invalid="ignore"):
            volume = sum(2.0 * float(x[part] @ ONE) for part in self.bodies)
            total = self.plain(x) - self.barrier * volume
        return total if np.isfinite(total) else np.inf

    def near(self, x: Array) -> tuple[Array, Array]:
        """Residuals with the slope and the curvature of the criterion along `moved`."""
        known = self.program.unknowns
        u, slopes = self.unknowns_at(x)
        weak = np.sqrt(known.weak)
        residuals = [known.matrix @ u - known.vector, weak * u]
        rows = [known.matrix @ slopes, weak[:, None] * slopes]
        for part, prior in zip(self.bodies, known.priors, strict=True):
            turned = _matrices(slopes[part, part].T)
            for weight, factor, value in self._parts(u[part], x[part], prior):
                inverse = np.linalg.inv(factor)
                each = np.sqrt(weight) * _numbers(inverse @ turned @ inverse.T).T
                block = np.zeros((len(each), len(x)))
                block[:, part] = each
                residuals.append(np.sqrt(weight) * _numbers(value))
                rows.append(block)
        return np.concatenate(residuals), np.vstack(rows)

    def _parts(self, numbers: Array, place: Array, prior: bool) -> list[tuple[float, Array, Array]]:
        r"""Penalties of a body to second order, $\tfrac w2\|F^{-1}\,dX\,F^{-T} + V\|^2$."""
        body, one = _matrices(numbers), np.eye(ORDER)
        parts = [(self.barrier, _triangle(place), -one)]
        if prior:
            outer = np.asarray(np.linalg.cholesky(body), dtype=np.float64)
            return [*parts, (self.gamma, outer, outer.T @ outer - one)]
        return [*parts, (FAINT, one, body)]

    def moved(self, x: Array, step: Array, part: float) -> Array | None:
        """The place to which the unknowns go straight: there the data are linear.

        `None` if a body on the way stops to exist.
        """
        there = x + part * step
        for place in self.bodies:
            numbers, slopes = entries(x[place])
            try:
                factor = np.linalg.cholesky(_matrices(numbers + part * slopes @ step[place]))
            except np.linalg.LinAlgError:
                return None
            there[place] = _coordinates(np.asarray(factor, dtype=np.float64))
        return there


def bounds_of(program: Program) -> Array:
    """Bounds of the unknowns that are no body's, shape `(2, terms)`.

    They are those of constraints on a single one of them; others are ignored.
    """
    constraints, first = program.constraints, 10 * len(program.unknowns.priors)
    ends = np.tile([[-np.inf], [np.inf]], len(program.unknowns.terms))
    for row, low, high in zip(
        constraints.matrix, constraints.lower, constraints.upper, strict=True
    ):
        seen = np.flatnonzero(row)
        if len(seen) == 1 and seen[0] >= first:
            k, size = seen[0] - first, row[seen[0]]
            edges = sorted((low / size, high / size))
            ends[:, k] = max(ends[0, k], edges[0]), min(ends[1, k], edges[1])
    return ends


def _matrices(numbers: Array) -> Array:
    """Symmetric matrices `(..., 4, 4)` with these entries `(..., 10)`."""
    return np.tensordot(numbers, BASIS, axes=1)


def _numbers(matrices: Array) -> Array:
    """Ten numbers `(..., 10)` whose squares sum up to a symmetric matrix's."""
    columns, rows = np.array(ENTRIES).T
    return np.asarray(np.where(rows == columns, 1.0, np.sqrt(2.0)) * matrices[..., columns, rows])


def _triangle(place: Array) -> Array:
    """The lower triangle with positive diagonal at log-Cholesky coordinates `(10,)`."""
    columns, rows = np.array(ENTRIES).T
    factor = np.zeros((ORDER, ORDER))
    on = rows == columns
    factor[rows, columns] = np.where(on, np.exp(np.where(on, place, 0.0)), place)
    return factor


def _coordinates(factor: Array) -> Array:
    """Log-Cholesky coordinates `(10,)` of a lower triangle with positive diagonal."""
    columns, rows = np.array(ENTRIES).T
    diagonal = np.log(np.diag(factor))
    return np.asarray(np.where(rows == columns, diagonal[rows], factor[rows, columns]))
