"""Passes over the data that show how columns change with the fields of their terms."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from steelyard.arrays import frozen
from steelyard.estimation.consistent.log_cholesky import LogCholesky
from steelyard.estimation.fields.passes import Said, Unknown, bounds_of, settled
from steelyard.model import Model
from steelyard.regression.base import BaseMap, base_parameters
from steelyard.regression.information import Information
from steelyard.regression.regressor import Regressor, chosen_regressor
from steelyard.terms.candidates import Dictionary
from steelyard.terms.open_fields import finds_of

STEP = 1e-3
"""Of the central differences, in the logarithm of a field."""


@dataclass(frozen=True, eq=False)
class Joint:
    """A model whose fields move, and how its data are seen.

    Attributes:
        model: The model.
        unknowns: Its fields.
        said: What the data say.
        base: Its base parameters, whatever the values of the fields.
        regressor: Columns of the other terms, and candidates for those with fields.
    """

    model: Model
    unknowns: tuple[Unknown, ...]
    said: Said
    base: BaseMap
    regressor: Regressor

    @classmethod
    def of(cls, model: Model, unknowns: tuple[Unknown, ...], said: Said) -> "Joint":
        """A model, its fields, and what the data say of it."""
        middle = {u: float(np.mean(bounds_of(u))) for u in unknowns}
        base = base_parameters(with_fields(model, unknowns, middle))
        wide = _wide(model, unknowns, middle)
        chosen = [k for k, name in enumerate(wide.names) if "@" in name or name in base.base_names]
        return cls(model, unknowns, said, base, chosen_regressor(wide, base, chosen))

    def pass_at(self, here: Mapping[Unknown, float]) -> Information:
        """One pass over the data with these logarithms of the fields, and ones beside them."""
        return self.said(replace(self.regressor, model=_wide(self.model, self.unknowns, here)))

    def mapped(self, information: Information, values: Mapping[str, float]) -> Information:
        """Base columns, and for values of the parameters one column per field."""
        names, units = list(self.base.base_names), list(self.base.base_units)
        fields = self.unknowns if values else ()
        place = {name: k for k, name in enumerate(names)}
        transform = np.zeros((len(information.layout.columns), len(names) + len(fields)))
        for row, column in enumerate(information.layout.columns):
            name, _, candidate = column.partition("@")
            if candidate in ("", "0"):
                if name in place:
                    transform[row, place[name]] = 1.0
                continue
            field, sign = divmod(int(candidate) - 1, 2)
            for k, unknown in enumerate(fields):
                if self._moves(unknown, name, field):
                    size = (1.0 - 2.0 * sign) / (2.0 * STEP)
                    transform[row, len(names) + k] = size * values.get(name, 0.0)
        return information.map(
            transform, [*names, *(self.name(u) for u in fields)], [*units, *("" for _ in fields)]
        )

    def _moves(self, unknown: Unknown, parameter: str, field: int) -> bool:
        """Whether an unknown is what differs in the candidates of a field of a term."""
        term = self.model.terms[unknown.term]
        mine = parameter in {p.name for p in term.parameters(self.model.robot)}
        axis = parameter.partition(".")[2]
        place = list(finds_of(term)).index(unknown.field)
        return mine and place == field and unknown.axis in (None, axis)

    def name(self, unknown: Unknown) -> str:
        """The name of a field among parameters."""
        law = self.model.terms[unknown.term].law
        return f"log {law} {unknown.field}.{unknown.axis or 'all'}"

    def extended(
        self, solver: LogCholesky, here: Mapping[Unknown, float], farthest: float
    ) -> LogCholesky:
        """The estimator for base columns and fields; these move within bounds and one step."""
        base, known = self.base, solver.knowledge
        names = tuple(self.name(u) for u in self.unknowns)
        count, added = len(base.names), len(names)
        ends = np.array([bounds_of(u) for u in self.unknowns]).reshape(-1, 2).T
        reach = ends - np.array([here[u] for u in self.unknowns])
        wider = BaseMap(
            base.names + names,
            base.units + ("",) * added,
            (*base.independent, *range(count, count + added)),
            base.dependent,
            base.unseen,
            frozen(np.vstack([base.coefficients, np.zeros((added, len(base.dependent)))])),
        )
        knowledge = replace(
            known,
            names=known.names + names,
            lower=np.append(known.lower, np.clip(reach[0], -farthest, 0.0)),
            upper=np.append(known.upper, np.clip(reach[1], 0.0, farthest)),
        )
        return replace(solver, base=wider, knowledge=knowledge)


def with_fields(model: Model, unknowns: Sequence[Unknown], here: Mapping[Unknown, float]) -> Model:
    """The model with values for all fields."""
    searched = {u.term for u in unknowns}
    return Model(
        model.robot,
        tuple(
            settled(model, k, here) if k in searched else term for k, term in enumerate(model.terms)
        ),
    )


def _wide(model: Model, unknowns: Sequence[Unknown], here: Mapping[Unknown, float]) -> Model:
    """Every term with fields as a dictionary: as it is, then a bit more and less per field."""
    searched = sorted({u.term for u in unknowns})
    kept = [term for k, term in enumerate(model.terms) if k not in searched]
    dictionaries = []
    for term in searched:
        candidates = [settled(model, term, here)]
        for field in finds_of(model.terms[term]):
            for step in (STEP, -STEP):
                moved = {u: x + step * (u.field == field) for u, x in here.items()}
                candidates.append(settled(model, term, moved))
        longest = settled(model, term, {u: bounds_of(u)[1] for u in here})
        dictionaries.append(Dictionary.of(model.robot, candidates, longest))
    return Model(model.robot, (*kept, *dictionaries))
