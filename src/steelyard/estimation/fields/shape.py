"""The shape of the costs around the best choice: where between grid points, and how sure."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array
from steelyard.estimation.fields.search import Costs, Indices

RISE = 3.841458820694124
"""Rise of the costs, in variances, at the ends of a 95 % interval."""


@dataclass(frozen=True, eq=False)
class Shape:
    """A quadratic through the costs around a choice.

    Attributes:
        costs: Costs of choices.
        choice: The best one, shape `(unknowns,)`.
        grids: Coordinates of every unknown's grid points.
        place: Where the quadratic is least, shape `(unknowns,)`; at most one grid point away.
        gains: Fall of the costs on the way there along each unknown alone, `(unknowns,)`.
        spread: Inverse of the matrix of second derivatives; infinite on the diagonal for unknowns
            that lie at an end of their grid or whose costs do not curve upwards.
    """

    costs: Costs
    choice: Indices
    grids: tuple[Array, ...]
    place: Array
    gains: Array
    spread: Array

    @classmethod
    def of(cls, costs: Costs, choice: Indices, grids: Sequence[Array]) -> "Shape":
        """The quadratic through the neighbours on the grid, for all unknowns together."""
        count = len(grids)
        slopes, bends = np.zeros(count), np.zeros((count, count))
        place = np.array([grid[k] for grid, k in zip(grids, choice, strict=True)])
        inner = []
        for u, (grid, k) in enumerate(zip(grids, choice, strict=True)):
            if 0 < k < len(grid) - 1:
                slopes[u], bends[u, u] = _parabola(costs, choice, u, np.diff(grid[k - 1 : k + 2]))
                inner += [u] if bends[u, u] > 0.0 else []
        for k, u in enumerate(inner):
            for v in inner[:k]:
                bends[u, v] = bends[v, u] = _twist(costs, choice, grids, u, v)
        matrix, spread = bends[np.ix_(inner, inner)], np.diag(np.full(count, np.inf))
        if inner and np.linalg.eigvalsh(matrix)[0] <= 0.0:
            matrix = np.diag(np.diag(matrix))
        spread[np.ix_(inner, inner)] = np.linalg.inv(matrix)
        steps = -spread[np.ix_(inner, inner)] @ slopes[inner]
        gains = np.zeros(count)
        for u, step in zip(inner, steps, strict=True):
            k = choice[u]
            place[u] = np.clip(place[u] + step, grids[u][k - 1], grids[u][k + 1])
            gains[u] = 0.5 * slopes[u] ** 2 / bends[u, u]
        return cls(costs, choice, tuple(grids), place, gains, spread)

    def step(self, unknown: int) -> float:
        """Distance of the grid points around the best one."""
        grid, k = self.grids[unknown], self.choice[unknown]
        near = grid[max(k - 1, 0) : k + 2]
        return float((near[-1] - near[0]) / (len(near) - 1))

    def half(self, unknown: int) -> float:
        """Half the 95 % interval as the quadratic has it."""
        return float(np.sqrt(2.0 * RISE * self.spread[unknown, unknown]))

    def interval(self, unknown: int) -> tuple[float, float]:
        """Where the costs, least over all other unknowns, rise by `RISE`; the grid's end if never.

        Within one step of the grid from the quadratic, beyond it from the grid.
        """
        half = self.half(unknown)
        middle, grid = self.place[unknown], self.grids[unknown]
        if half <= self.step(unknown) and grid[0] < middle - half and middle + half < grid[-1]:
            return middle - half, middle + half
        roots = np.sqrt(np.maximum(self._profile(unknown), 0.0))
        below, above = grid < middle, grid > middle
        return (
            _crossing(middle, grid[below][::-1], roots[below][::-1]),
            _crossing(middle, grid[above], roots[above]),
        )

    def _profile(self, unknown: int) -> Array:
        """Rise of the costs, least over all other unknowns, along the unknown's grid."""
        least = float(self.costs(self.choice[None])[0]) - self.gains[unknown]
        result = np.empty(len(self.grids[unknown]))
        for k in range(len(result)):
            start = _moved(self.choice, {unknown: k - int(self.choice[unknown])})
            result[k] = self.costs.descended(start, fixed=unknown)[1] - least
        return result


def _crossing(middle: float, places: Array, roots: Array) -> float:
    """Outermost place where the root of the rise passes that of `RISE`; linear in between."""
    places, roots = np.append(middle, places), np.append(0.0, roots)
    last = int(np.flatnonzero(roots < np.sqrt(RISE))[-1])
    if last == len(places) - 1:
        return float(places[-1])
    share = (np.sqrt(RISE) - roots[last]) / (roots[last + 1] - roots[last])
    return float(places[last] + share * (places[last + 1] - places[last]))


def _parabola(costs: Costs, choice: Indices, u: int, steps: Array) -> tuple[float, float]:
    """Slope and second derivative along an unknown, `steps` below and above the choice."""
    trial = np.array([_moved(choice, {u: d}) for d in (-1, 0, 1)])
    low, middle, high = costs(trial)
    below, above = (low - middle) / steps[0], (high - middle) / steps[1]
    slope = (above * steps[0] - below * steps[1]) / steps.sum()
    return float(slope), float(2.0 * (above + below) / steps.sum())


def _twist(costs: Costs, choice: Indices, grids: Sequence[Array], u: int, v: int) -> float:
    """Mixed second derivative along two unknowns."""
    trial = np.array([_moved(choice, {u: a, v: b}) for a in (1, -1) for b in (1, -1)])
    f = costs(trial)
    spans = [grids[w][choice[w] + 1] - grids[w][choice[w] - 1] for w in (u, v)]
    return float((f[0] - f[1] - f[2] + f[3]) / (spans[0] * spans[1]))


def _moved(choice: Indices, by: dict[int, int]) -> Indices:
    result = choice.copy()
    for unknown, step in by.items():
        result[unknown] += step
    return result
