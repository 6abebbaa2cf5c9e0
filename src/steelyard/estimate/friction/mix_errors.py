"""Candidates of friction laws in one wide pass, and errors of their mixes on left-out data."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, cast

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import DataError
from steelyard.base.progress import Progress, report_progress, silent
from steelyard.estimate.consistent.consistent import Consistent
from steelyard.estimate.estimate import Estimator
from steelyard.estimate.friction.mixes import has_memory
from steelyard.estimate.information.base_parameters import BaseMap, base_parameters
from steelyard.estimate.information.information import Information
from steelyard.estimate.information.regressor import Regressor, chosen_regressor
from steelyard.estimate.scores.cross_validation import (
    left_out_errors,
    logarithms,
    too_short,
    values_by,
)
from steelyard.model.laws.load_dependent import PLAUSIBLE, LoadDependent
from steelyard.model.laws.presliding import Dahl
from steelyard.model.model import Model
from steelyard.model.terms.term import CandidateTerms, StatefulTerm, Term


@dataclass(frozen=True, eq=False)
class Candidates:
    """All columns beside those of the model without friction."""

    model: Model  # the model with one dictionary per law
    base: BaseMap  # base parameters of the model without friction
    # per law and coordinates the terms in their dictionary
    candidates: Mapping[tuple[Any, ...], tuple[Term, ...]]

    @classmethod
    def of(cls, model: Model, stages: Sequence[Sequence[tuple[Term, ...]]]) -> "Candidates":
        """One dictionary per law, with every term of the stages once."""
        by_law: dict[tuple[Any, ...], tuple[Term, ...]] = {}
        for term in (term for stage in stages for mix in stage for term in mix):
            known = by_law.setdefault(_place(term), ())
            by_law[_place(term)] = known if term in known else (*known, term)

        def warm_up(term: Term) -> float:
            if not isinstance(term, StatefulTerm):
                return 0.0
            return float(term.warm_up(model.robot).max())

        dictionaries = (
            CandidateTerms.of(model.robot, terms, max(terms, key=warm_up))
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
                if whole in known:
                    number = known.index(whole)
                else:  # a length for each joint
                    number = [length_of(one, k) for one in known].index(length_of(whole, k))
                names.append(f"{parameter.name}@{number}")
        return tuple(names)


def length_of(term: Term, joint: int) -> float:
    """Length of a joint, of a term with one for each or for all."""
    length = cast(Any, term).length
    return float(length[joint] if isinstance(length, tuple) else length)


def _place(term: Term) -> tuple[Any, ...]:
    """What terms of one dictionary have in common."""
    return (term.law, *(getattr(term, name, None) for name in ("joints", "motors", "along")))


ConsistentOf = Callable[[Model, BaseMap], Consistent]  # for a model and its base parameters


@dataclass(frozen=True, eq=False)
class FrictionMixErrors:
    """Errors of mixes on what was left out."""

    model: Model  # the model without friction
    wide: Candidates
    moving: Information  # one window per fold, without rests; `whole` has them
    whole: Information
    estimator: Estimator[Information]
    consistent: ConsistentOf | None  # fits them in its place, if it is there
    # errors of the mixes that were tried, `(folds, rows)`
    known: dict[tuple[Term, ...], Array] = field(default_factory=dict)
    # weight of the prior, one for all mixes and parts: that of the first mix and all runs. One for
    # each part would scatter by more than mixes differ
    gammas: list[float] = field(default_factory=list)
    progress: Progress = silent
    count: int = 1  # how many mixes there may be

    @cached_property
    def sizes(self) -> Array:
        """Squares of the efforts, shape `(folds, rows)`."""
        count = len(self.whole.windows)
        return np.array([self.whole.of([k]).effort_squares() for k in range(count)])

    def errors(self, mix: tuple[Term, ...]) -> Array | None:
        """One figure per fold; `None` if the data are too few for a mix, not the first."""
        names = self.wide.columns_of(mix)
        tested = self.whole.select(names)
        fitted = tested if has_memory(mix) else self.moving.select(names)
        try:
            self.known[mix] = left_out_errors(fitted, tested, self.fitting(mix))
        except DataError as error:
            if self.known:
                return None
            raise too_short(self.whole) from error
        return logarithms(self.known[mix], self.sizes)

    def fitting(self, mix: tuple[Term, ...]) -> Callable[[Information], Array]:
        """How the columns of a mix get their values."""
        if self.consistent is None:
            return values_by(self.estimator)
        whole = replace(self.model, terms=(*self.model.terms, *mix))
        added = whole.parameters[len(self.model.parameters) :]
        base = self.wide.base.beside([p.name for p in added], [p.unit for p in added])
        estimator = self.consistent(whole, base)
        if not self.gammas:
            everything = self.moving.select(self.wide.columns_of(mix))
            self.gammas.append(estimator.values(_plain(everything)).gamma)
        near: list[Array] = []

        def fitted(information: Information) -> Array:
            report_progress(self.progress, "choosing friction laws", len(self.known), self.count)
            found = estimator.values(_plain(information), self.gammas[0], *near)
            near[:] = [found.standard]
            return found.values

        return fitted

    def plausible(self, kept: tuple[Term, ...], laws: tuple[Term, ...]) -> tuple[Term, ...]:
        """Laws beside those kept; load-dependent friction where a fit to all runs is plausible."""
        law = next((term for term in laws if isinstance(term, LoadDependent)), None)
        if law is None:
            return laws
        names = self.wide.columns_of((*kept, *laws))
        try:
            values = self.fitting((*kept, *laws))(self.whole.select(names))
        except DataError:
            return laws
        found = dict(zip(names, values.tolist(), strict=True))
        axes = law.axes(self.model.robot)
        columns = self.wide.columns_of((law,))[-len(axes) :]
        plausible = [found[column] <= PLAUSIBLE for column in columns]
        if all(plausible):
            return laws
        joints = tuple(axis.name for axis, ok in zip(axes, plausible, strict=True) if ok)
        rest = tuple(term for term in laws if term is not law)
        return (*rest, replace(law, joints=joints)) if joints else rest

    def per_joint(self, following: tuple[Term, ...]) -> list[tuple[tuple[Term, ...], Array]]:
        """Dahl friction with each joint's best length; folds are judged with that of the others."""
        tried = [mix for mix in self.known if isinstance(mix[0], Dahl) and mix[1:] == following]
        if len(self.whole.layout.rows) < 2 or len(tried) < 2:
            return []
        logs = np.log(np.maximum([self.known[mix] for mix in tried], 1e-12))
        logs = np.where(self.sizes > 0.0, logs, 0.0)

        def with_lengths(errors: Array) -> tuple[Term, ...]:
            best = np.argmin(errors, axis=0).tolist()
            lengths = tuple(length_of(tried[k][0], joint) for joint, k in enumerate(best))
            return (Dahl(length=lengths), *following)

        best, joints = with_lengths(logs.sum(axis=1)), range(len(self.whole.layout.rows))
        lengths = [[length_of(mix[0], joint) for joint in joints] for mix in (best, *tried)]
        if lengths[0] in lengths[1:]:
            return []
        count, found = len(self.whole.windows), []
        for fold in range(count):
            mix = with_lengths(np.delete(logs, fold, axis=1).sum(axis=1))
            some = self.whole.select(self.wide.columns_of(mix))
            try:
                errors = left_out_errors(some, some, self.fitting(mix), only=(fold,))
            except DataError:
                return []
            found.append(errors[0])
        return [(best, logarithms(np.array(found), self.sizes))]


def _plain(information: Information) -> Information:
    """With the names that columns have in a model."""
    named = tuple(name.partition("@")[0] for name in information.layout.columns)
    return replace(information, layout=replace(information.layout, columns=named))
