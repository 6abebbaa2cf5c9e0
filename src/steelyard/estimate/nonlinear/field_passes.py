"""Passes over the data with candidates for fields side by side, finer from pass to pass."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.progress import Progress, report_progress
from steelyard.estimate.information.base_parameters import BaseMap, base_parameters
from steelyard.estimate.information.information import Information
from steelyard.estimate.information.regressor import Regressor, chosen_regressor
from steelyard.estimate.nonlinear.field_search import CostShape, Indices, Problem, Slots
from steelyard.model.model import Model
from steelyard.model.terms.axes import Find, finds_of
from steelyard.model.terms.term import CandidateTerms, Term

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
            information = information_of(regressor)
            choice, costs, _ = self._problem(information).solved(choices)
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
