r"""Which candidates for fields fit best, and the shape of the costs around the best choice.

With a weight $1/\sigma_j^2$ per effort row, the columns that all candidates share are eliminated
once; what a choice of candidates costs is then a system as small as the number of chosen columns.
The weights follow the residuals: a choice that is cheaper under the weights of the choice before
lowers the criterion $\sum_j n_j \log \sigma_j^2$, as the logarithm is concave.

Passes over the data have candidates for fields side by side, finer from pass to pass.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array
from steelyard.base.progress import Progress, report_progress
from steelyard.estimate.information.base_parameters_and_regressor import (
    BaseMap,
    Regressor,
    base_parameters,
    chosen_regressor,
)
from steelyard.estimate.information.information import Information
from steelyard.estimate.least_squares.normal_equations import lengths_of
from steelyard.model.model import Model
from steelyard.model.terms.axes_and_fields import Find, finds_of
from steelyard.model.terms.stateful_terms import CandidateTerms
from steelyard.model.terms.term import Term

Indices = NDArray[np.intp]

SEEN = 1e-10  # squared sine of the angle to shared columns that identifies a candidate
RIDGE = 1e-11  # of normalised chosen columns: two of them may be alike
EXACT = 1e-13  # least residual variance over that of the effort; less is rounding
ROUNDS = 20  # most changes of the weights from one start
TOLERANCE = 1e-4  # relative change of the weights at which they have converged


@dataclass(frozen=True, eq=False)
class Slots:
    """How a choice of grid points selects columns; a choice has one index per unknown."""

    sizes: tuple[int, ...]  # grid points per unknown
    strides: Indices  # `(slots, unknowns)`; times the choice they are the candidate of a slot
    columns: Indices  # of each slot's candidates, `(slots, candidates)`

    def of(self, choices: Indices) -> Indices:
        """Columns that choices `(B, unknowns)` select, shape `(B, slots)`."""
        candidates = choices @ self.strides.T
        return np.asarray(self.columns[np.arange(len(self.columns)), candidates])


@dataclass(frozen=True, eq=False)
class Costs:
    """Weighted squares of the residuals of any choice, for fixed weights."""

    slots: Slots  # what choices select
    shared: Indices  # indices of the shared columns
    rest: float  # weighted squares that the shared columns leave
    gram: Array  # of all columns' parts that shared ones do not explain, unit length, `(p, p)`
    vector: Array  # their products with the effort, `(p,)`
    lengths: Array  # of all columns; infinite where zero, `(p,)`
    parts: Array  # share of each column's length that shared ones do not explain, likewise
    roots: Array  # root of the inverse of the shared columns' Gram matrix, `(shared, rank)`
    onto: Array  # all columns and the effort, seen by the shared ones, `(rank, p + 1)`

    @classmethod
    def of(cls, information: Information, shared: Indices, slots: Slots, weights: Array) -> "Costs":
        """Eliminate the shared columns, under weights `(rows,)`."""
        matrix, vector, square = information.normal(weights)
        lengths = lengths_of(np.diag(matrix))
        unit, right = matrix / lengths[:, None] / lengths, vector / lengths
        values, vectors = np.linalg.eigh(unit[np.ix_(shared, shared)])
        kept = values > SEEN
        roots = vectors[:, kept] / np.sqrt(values[kept])
        onto = roots.T @ np.column_stack([unit[shared], right[shared]])
        gram = unit - onto[:, :-1].T @ onto[:, :-1]
        left = np.diag(gram)
        parts = np.sqrt(np.where(left > SEEN, left, np.inf))
        gram = gram / parts[:, None] / parts
        np.fill_diagonal(gram, 1.0)
        return cls(
            slots=slots,
            shared=shared,
            rest=square - float(onto[:, -1] @ onto[:, -1]),
            gram=gram,
            vector=(right - onto[:, :-1].T @ onto[:, -1]) / parts,
            lengths=lengths,
            parts=parts,
            roots=roots,
            onto=onto,
        )

    def __call__(self, choices: Indices) -> Array:
        """Costs of choices `(B, unknowns)`, shape `(B,)`."""
        columns = self.slots.of(choices)
        values = self._chosen(columns)
        return np.asarray(self.rest - np.sum(values * self.vector[columns], axis=1))

    def values(self, choice: Indices) -> Array:
        """Parameters of all columns for one choice, shape `(p,)`; not chosen ones are zero."""
        columns = self.slots.of(choice[None])
        result = np.zeros(len(self.vector))
        result[columns[0]] = self._chosen(columns)[0] / self.parts[columns[0]]
        result[self.shared] = self.roots @ (self.onto[:, -1] - self.onto[:, :-1] @ result)
        return result / self.lengths

    def _chosen(self, columns: Indices) -> Array:
        grams = self.gram[columns[:, :, None], columns[:, None, :]]
        grams = grams + RIDGE * np.eye(columns.shape[1])
        return np.asarray(np.linalg.solve(grams, self.vector[columns][:, :, None])[:, :, 0])

    def descended(self, choice: Indices, fixed: int | None = None) -> tuple[Indices, float]:
        """Coordinate descent from a choice, one unknown after another; one may stay fixed."""
        best = float(self(choice[None])[0])
        while True:
            before = best
            for unknown, size in enumerate(self.slots.sizes):
                if unknown == fixed:
                    continue
                trial = np.repeat(choice[None], size, axis=0)
                trial[:, unknown] = np.arange(size)
                costs = self(trial)
                least = int(np.argmin(costs))
                if costs[least] < best:
                    choice, best = trial[least], float(costs[least])
            if not best < before:
                return choice, best


@dataclass(frozen=True, eq=False)
class Problem:
    """Choose grid points so that least squares fits best."""

    information: Information
    shared: Indices  # columns that are there whatever is chosen
    slots: Slots

    def solved(self, starts: Indices) -> tuple[Indices, Costs, float]:
        """The best of descents from `(starts, unknowns)`, its costs and its criterion."""
        one_window = [range(len(self.information.windows))]
        whole = replace(self, information=self.information.grouped(one_window))
        found = [whole._from(start) for start in starts]
        return min(found, key=lambda result: result[2])

    def _from(self, choice: Indices) -> tuple[Indices, Costs, float]:
        counts, layout = self.information.n_samples, self.information.layout
        energy = self.information.effort_squares() / np.maximum(counts, 1.0)
        first = variances = np.where(energy > 0.0, energy, 1.0)
        sees = np.zeros((len(layout.rows), len(layout.columns)))
        for row, seen in enumerate(layout.sees):
            sees[row, list(seen)] = 1.0
        costs = Costs.of(self.information, self.shared, self.slots, 1.0 / variances)
        for _ in range(ROUNDS):
            choice, _ = costs.descended(choice)
            squares, before = self.information.residual_squares(costs.values(choice)), variances
            # a parameter counts in equal parts in all rows that see it
            present = sees[:, np.concatenate([self.shared, self.slots.of(choice[None])[0]])]
            used = np.sum(present / np.maximum(present.sum(axis=0), 1.0), axis=1)
            variances = np.maximum(squares / np.maximum(counts - used, 1.0), EXACT * first)
            costs = Costs.of(self.information, self.shared, self.slots, 1.0 / variances)
            if np.abs(variances / before - 1.0).max() < TOLERANCE:
                break
        return choice, costs, float(counts @ np.log(variances))


RISE = 3.841458820694124  # rise of the costs, in variances, at the ends of a 95 % interval


@dataclass(frozen=True, eq=False)
class CostShape:
    """A quadratic through the costs around a choice."""

    costs: Costs
    choice: Indices  # the best one, `(unknowns,)`
    grids: tuple[Array, ...]  # coordinates of every unknown's grid points
    place: Array  # where the quadratic is least, `(unknowns,)`; at most one grid point away
    gains: Array  # fall of the costs on the way there along each unknown alone, `(unknowns,)`
    # inverse of the matrix of second derivatives; infinite on the diagonal for unknowns that lie at
    # an end of their grid or whose costs do not curve upwards
    spread: Array

    @classmethod
    def of(cls, costs: Costs, choice: Indices, grids: Sequence[Array]) -> "CostShape":
        """The quadratic through the neighbours on the grid, for all unknowns together."""
        count = len(grids)
        slopes, bends = np.zeros(count), np.zeros((count, count))
        place = np.array([grid[k] for grid, k in zip(grids, choice, strict=True)])
        inner = []
        for u, (grid, k) in enumerate(zip(grids, choice, strict=True)):
            if 0 < k < len(grid) - 1:  # slope and second derivative along the unknown
                steps = np.diff(grid[k - 1 : k + 2])
                low, middle, high = costs(np.array([_moved(choice, {u: d}) for d in (-1, 0, 1)]))
                below, above = (low - middle) / steps[0], (high - middle) / steps[1]
                slopes[u] = (above * steps[0] - below * steps[1]) / steps.sum()
                bends[u, u] = 2.0 * (above + below) / steps.sum()
                inner += [u] if bends[u, u] > 0.0 else []
        for k, u in enumerate(inner):
            for v in inner[:k]:  # mixed second derivative
                trial = [_moved(choice, {u: a, v: b}) for a in (1, -1) for b in (1, -1)]
                spans = [grids[w][choice[w] + 1] - grids[w][choice[w] - 1] for w in (u, v)]
                f = costs(np.array(trial))
                bends[u, v] = bends[v, u] = (f[0] - f[1] - f[2] + f[3]) / (spans[0] * spans[1])
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
        """Where the costs, least over other unknowns, rise by `RISE`; else the end of the grid."""
        half = self.half(unknown)
        middle, grid = self.place[unknown], self.grids[unknown]
        if half <= self.step(unknown) and grid[0] < middle - half and middle + half < grid[-1]:
            return middle - half, middle + half
        # rise of the costs, least over all other unknowns, along the unknown's grid
        least = float(self.costs(self.choice[None])[0]) - self.gains[unknown]
        rises = np.empty(len(grid))
        for k in range(len(grid)):
            start = _moved(self.choice, {unknown: k - int(self.choice[unknown])})
            rises[k] = self.costs.descended(start, fixed=unknown)[1] - least
        roots = np.sqrt(np.maximum(rises, 0.0))
        below, above = grid < middle, grid > middle
        return (
            _crossing(middle, grid[below][::-1], roots[below][::-1]),
            _crossing(middle, grid[above], roots[above]),
        )


def _crossing(middle: float, places: Array, roots: Array) -> float:
    """Outermost place where the root of the rise passes that of `RISE`; linear in between."""
    places, roots = np.append(middle, places), np.append(0.0, roots)
    last = int(np.flatnonzero(roots < np.sqrt(RISE))[-1])
    if last == len(places) - 1:
        return float(places[-1])
    share = (np.sqrt(RISE) - roots[last]) / (roots[last + 1] - roots[last])
    return float(places[last] + share * (places[last + 1] - places[last]))


def _moved(choice: Indices, by: dict[int, int]) -> Indices:
    result = choice.copy()
    for unknown, step in by.items():
        result[unknown] += step
    return result


POINTS = 12  # grid points per field
FEWEST = 4  # least number of grid points of each of several fields of one term
WIDEST = 400  # candidates' columns of one pass; beyond it terms are searched one after another
FINE = 0.04  # step of the logarithmic grid at which a quadratic is true to about 1e-3
FINEST = 0.004  # step at which it is true to about 1e-5; finer ones serve nobody
LARGEST_SQUARED_STEP = 0.3  # square of the step, the quadratic's error, over half the interval
FINER = 4.0  # how much finer the grid gets around the best choice from pass to pass
SETTLING = 30  # iterations for the scale of a grid that is fine in the middle
MOST_FIELD_PASSES = 8  # most passes over the data per search
InformationOf = Callable[[Regressor], Information]  # what all runs say about its columns

_EMPTY = BaseMap((), (), (), (), (), np.zeros((0, 0)))


@dataclass(frozen=True)
class Unknown:
    """A field of a term by its number in the model, for one coordinate or for all (`None`)."""

    term: int
    field: str
    axis: str | None
    find: Find


def unknowns_of(model: Model) -> tuple[Unknown, ...]:
    """Everything that is to be found in a model; fields that data cannot show are refused."""
    return tuple(
        Unknown(t, field, axis, find)
        for t, term in enumerate(model.terms)
        for field, find in finds_of(term).items()
        for axis in ([None] if find.shared else _axes(model, term))
    )


def with_fields(model: Model, term: int, logs: Mapping[Unknown, float]) -> Term:
    """A term of a model with values for its fields, from their logarithms."""
    given = model.terms[term]
    values: dict[str, Any] = {}
    for field, find in finds_of(given).items():
        axes = [None] if find.shared else _axes(model, given)
        found = [value_of(u, logs[u]) for u in (Unknown(term, field, a, find) for a in axes)]
        values[field] = found[0] if find.shared else tuple(found)
    return cast(Term, replace(cast(Any, given), **values))


@dataclass(frozen=True, eq=False)
class Search:
    """The search of some terms' fields; all other fields of the model are numbers."""

    model: Model
    terms: tuple[int, ...]
    unknowns: tuple[Unknown, ...]

    def __call__(
        self,
        information_of: InformationOf,
        starts: int,
        random: np.random.Generator,
        progress: Progress,
    ) -> CostShape:
        """The costs around the best choice, on a fine grid."""
        grids = [np.linspace(*bounds_of(u), points_of(self.model, u.term)) for u in self.unknowns]
        sizes = [len(grid) for grid in grids]
        choices: Indices = random.integers(0, sizes, (starts, len(sizes)))
        regressor: Regressor | None = None
        for number in range(MOST_FIELD_PASSES):
            report_progress(progress, "estimating nonlinear parameters", number, MOST_FIELD_PASSES)
            regressor = self._regressor(grids, regressor)
            choice, costs, _ = self._problem(information_of(regressor)).solved(choices)
            shape = CostShape.of(costs, choice, grids)
            steps = [shape.step(k) for k in range(len(grids))]
            # the quadratic's error is small, also against half the interval
            if all(
                step <= FINE
                and (step <= FINEST or step * step <= LARGEST_SQUARED_STEP * shape.half(k))
                for k, step in enumerate(steps)
            ):
                break
            grids = [
                _finer(u, place, step / FINER, len(grid))
                for u, place, step, grid in zip(
                    self.unknowns, shape.place, steps, grids, strict=True
                )
            ]
            nearest = [np.argmin(np.abs(g - x)) for g, x in zip(grids, shape.place, strict=True)]
            choices = np.array([nearest])
        report_progress(
            progress, "estimating nonlinear parameters", MOST_FIELD_PASSES, MOST_FIELD_PASSES
        )
        return shape

    def _regressor(self, grids: Sequence[Array], before: Regressor | None) -> Regressor:
        """Other terms' base columns and all candidates' columns; one program for all grids."""
        robot = self.model.robot
        kept = (t for k, t in enumerate(self.model.terms) if k not in self.terms)
        others = Model(robot, tuple(kept))
        wide = Model(robot, (*others.terms, *(self._dictionary(t, grids) for t in self.terms)))
        if before is not None:
            return replace(before, model=wide)
        base = base_parameters(others) if others.parameters else _EMPTY
        columns = (*base.independent, *range(len(others.parameters), len(wide.parameters)))
        return chosen_regressor(wide, base, columns)

    def _dictionary(self, term: int, grids: Sequence[Array]) -> CandidateTerms:
        """Every combination of the grid points of the term's fields, the last one fastest."""
        fields = list(finds_of(self.model.terms[term]))
        points = points_of(self.model, term)
        mine = [(u, g) for u, g in zip(self.unknowns, grids, strict=True) if u.term == term]
        candidates = [
            with_fields(
                self.model, term, {u: float(g[index[fields.index(u.field)]]) for u, g in mine}
            )
            for index in np.ndindex(*(points for _ in fields))
        ]
        longest = with_fields(self.model, term, {u: bounds_of(u)[1] for u, _ in mine})
        return CandidateTerms.of(self.model.robot, candidates, longest)

    def _problem(self, information: Information) -> Problem:
        place = {name: k for k, name in enumerate(information.layout.columns)}
        strides, columns = [], []
        for term in self.terms:
            fields, points = list(finds_of(self.model.terms[term])), points_of(self.model, term)
            for parameter in self.model.terms[term].parameters(self.model.robot):
                axis = parameter.name.partition(".")[2]
                strides.append(
                    [
                        points ** (len(fields) - 1 - fields.index(u.field))
                        if u.term == term and u.axis in (None, axis)
                        else 0
                        for u in self.unknowns
                    ]
                )
                count = points ** len(fields)
                columns.append([place[f"{parameter.name}@{c}"] for c in range(count)])
        widest = max(len(c) for c in columns)
        candidates = {k for of_slot in columns for k in of_slot}
        return Problem(
            information,
            np.array([k for k in place.values() if k not in candidates], dtype=np.intp),
            Slots(
                tuple(points_of(self.model, u.term) for u in self.unknowns),
                np.array(strides, dtype=np.intp),
                np.array([c + c[:1] * (widest - len(c)) for c in columns], dtype=np.intp),
            ),
        )


def points_of(model: Model, term: int) -> int:
    """Grid points per field of a term: fewer if it has several fields."""
    given = model.terms[term]
    count, width = len(finds_of(given)), len(given.parameters(model.robot))
    return min(POINTS, max(FEWEST, int((WIDEST / width) ** (1.0 / count) + 1e-9)))


def _axes(model: Model, term: Term) -> list[str]:
    """Names of the coordinates a term acts along, as its parameters have them."""
    return list(dict.fromkeys(p.name.partition(".")[2] for p in term.parameters(model.robot)))


def bounds_of(unknown: Unknown) -> tuple[float, float]:
    """Logarithms of the bounds."""
    return float(np.log(unknown.find.lower)), float(np.log(unknown.find.upper))


def value_of(unknown: Unknown, log: float) -> float:
    """The field's value of its logarithm; a bound is the bound to the bit."""
    low, high = bounds_of(unknown)
    if low < log < high:
        return float(np.exp(log))
    return unknown.find.lower if log <= low else unknown.find.upper


def _finer(unknown: Unknown, place: float, step: float, points: int) -> Array:
    """As many points from bound to bound, about `step` apart around `place`, wide elsewhere."""
    scale = step
    for _ in range(SETTLING):
        low, high = (float(np.arcsinh((end - place) / scale)) for end in bounds_of(unknown))
        scale = step / float(np.sinh((high - low) / (points - 1)))
    grid = place + scale * np.sinh(np.linspace(low, high, points))
    grid[[0, -1]] = bounds_of(unknown)
    return np.asarray(grid)
