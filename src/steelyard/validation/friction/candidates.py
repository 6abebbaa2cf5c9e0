"""All candidates of friction laws in one wide pass: a mix is a selection of its columns."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, cast

from steelyard.model import Model
from steelyard.regression.base import BaseMap, base_parameters
from steelyard.regression.regressor import Regressor, chosen_regressor
from steelyard.terms.candidates import CandidateTerms
from steelyard.terms.term import StatefulTerm, Term


@dataclass(frozen=True, eq=False)
class Candidates:
    """All columns beside those of the model without friction.

    Attributes:
        model: The model with one dictionary per law.
        base: Base parameters of the model without friction.
        candidates: Per law and coordinates the terms in their dictionary.
    """

    model: Model
    base: BaseMap
    candidates: Mapping[tuple[Any, ...], tuple[Term, ...]]

    @classmethod
    def of(cls, model: Model, stages: Sequence[Sequence[tuple[Term, ...]]]) -> "Candidates":
        """One dictionary per law, with every term of the stages once."""
        by_law: dict[tuple[Any, ...], tuple[Term, ...]] = {}
        for term in (term for stage in stages for mix in stage for term in mix):
            known = by_law.setdefault(_place(term), ())
            by_law[_place(term)] = known if term in known else (*known, term)
        dictionaries = (
            CandidateTerms.of(model.robot, terms, max(terms, key=lambda t: _warm_up(t, model)))
            for terms in by_law.values()
        )
        wide = Model(model.robot, (*model.terms, *dictionaries))
        return cls(wide, base_parameters(model), by_law)

    @cached_property
    def regressor(self) -> Regressor:
        """Base columns of the model without friction, and all candidates' columns as they are."""
        first = len(self.base.names)
        chosen = (*self.base.independent, *range(first, len(self.model.parameters)))
        return chosen_regressor(self.model, self.base, chosen)

    def columns_of(self, mix: Sequence[Term]) -> tuple[str, ...]:
        """Names of the columns of a mix; a law of some joints has columns of that of all."""
        names = list(self.base.base_names)
        for term in mix:
            of_some = _place(term) not in self.candidates
            whole = replace(cast(Any, term), joints=None) if of_some else term
            known = self.candidates[_place(whole)]
            for k, parameter in enumerate(term.parameters(self.model.robot)):
                number = known.index(whole) if whole in known else _with_length(known, whole, k)
                names.append(f"{parameter.name}@{number}")
        return tuple(names)


def _with_length(known: Sequence[Term], term: Term, joint: int) -> int:
    """Number of the candidate whose length of a joint is that of a term with one for each."""
    wanted = cast(Any, term).length[joint]
    return next(k for k, one in enumerate(known) if length_of(one, joint) == wanted)


def length_of(term: Term, joint: int) -> float:
    """Length of a joint, of a term with one for each or for all."""
    length = cast(Any, term).length
    return float(length[joint] if isinstance(length, tuple) else length)


def same_lengths(one: Term, other: Term, joints: int) -> bool:
    """Whether two terms have the same length at each joint."""
    return all(length_of(one, joint) == length_of(other, joint) for joint in range(joints))


def _place(term: Term) -> tuple[Any, ...]:
    """What terms of one dictionary have in common."""
    return (term.law, *(getattr(term, name, None) for name in ("joints", "motors", "along")))


def _warm_up(term: Term, model: Model) -> float:
    return float(term.warm_up(model.robot).max()) if isinstance(term, StatefulTerm) else 0.0
