"""The mix of friction laws that predicts best: `friction = "auto"`.

Laws are compared in stages, each beside what the stage before has chosen: how friction turns round
with the direction of motion, how it grows with speed, and whether it grows with the load. A mix is
judged by leaving one run out (one stretch of a single run). The law of direction with the least
error is taken, if one has less than plain Coulomb friction by more than chance explains over the
runs; what is added later must gain as surely.

All candidates' columns are gathered in one wide pass; a mix is a selection of them.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, cast

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import DataError, ModelError
from steelyard.base.progress import Progress, report_progress, silent
from steelyard.estimate.consistent.convex_estimator import Consistent
from steelyard.estimate.estimate import Estimator
from steelyard.estimate.friction.friction_mixes_and_curves import (
    DIRECTION,
    LOAD,
    PLAIN,
    SPEED,
    Mix,
    mix_name,
    stages_of,
)
from steelyard.estimate.information.base_parameters_and_regressor import (
    BaseMap,
    Regressor,
    base_parameters,
    chosen_regressor,
)
from steelyard.estimate.information.information import Information
from steelyard.estimate.nonlinear.nonlinear_parameters import information_from, reference_of
from steelyard.estimate.scores.cross_validation import (
    LEAST_GAIN_PER_PARAMETER,
    chance_of,
    folding,
    left_out_errors,
    logarithms,
    per_fold,
    standard_error,
    too_short,
    values_by,
)
from steelyard.model.laws.friction_with_memory import PLAUSIBLE, Dahl, LoadDependent
from steelyard.model.model import Model
from steelyard.model.terms.stateful_terms import CandidateTerms
from steelyard.model.terms.term import StatefulTerm, Term, has_memory
from steelyard.runs.run import Run

LOSS_PROBABILITY, DIRECTION_LOSS_PROBABILITY = 0.9, 0.95
"""Probability with which a loss over the parts must be one, by Student's distribution; and that to
any of the many laws of direction."""


@dataclass(frozen=True)
class MixScore:
    """How well a mix of friction laws predicts what it was not fitted to."""

    name: str  # the laws, for people to read
    terms: Mix  # the laws
    # relative error on what was left out, mean over runs: the geometric mean of a typical joint's
    # and of all joints' together [%]
    error: float
    gain: float  # how much less that is than with the first mix of the table [% of it]
    spread: float  # standard error of that gain over the runs [%]
    chosen: bool = False  # whether it is the mix that was chosen


@dataclass(frozen=True)
class FrictionChoice:
    """The mix that was chosen, and the table it was chosen from."""

    table: tuple[MixScore, ...]  # all mixes that were compared, in order; one was chosen
    left_out: str  # what was left out in turn: `run` or `stretch`

    @property
    def best(self) -> MixScore:
        """The one that was chosen."""
        return next(mix for mix in self.table if mix.chosen)

    @property
    def without_memory(self) -> MixScore | None:
        """The best mix without memory, where the chosen one has some."""
        others = [mix for mix in self.table if not has_memory(mix.terms)]
        if not has_memory(self.best.terms) or not others:
            return None
        return min(others, key=lambda mix: mix.error)

    def to_dict(self) -> dict[str, Any]:
        """As JSON values."""
        other = self.without_memory
        return {
            "chosen": self.best.name,
            "without_memory": None if other is None else other.name,
            "left_out": self.left_out,
            "table": [
                {
                    "mix": mix.name,
                    "error_percent": mix.error,
                    "gain_percent": mix.gain,
                    "spread_percent": mix.spread,
                    "chosen": mix.chosen,
                }
                for mix in self.table
            ],
        }

    @property
    def note(self) -> str:
        """One sentence for the user."""
        first, best = self.table[0], self.best
        return (
            f"friction chosen by cross-validation, leaving one {self.left_out} out: {best.name} "
            f"({best.error:.2f} %; {first.name}: {first.error:.2f} %)"
        )


ConsistentOf = Callable[[Model, BaseMap], Consistent]  # for a model and its base parameters


@dataclass(frozen=True, eq=False)
class Candidates:
    """All columns beside those of the model without friction."""

    model: Model  # the model with one dictionary per law
    base: BaseMap  # base parameters of the model without friction
    # per law and coordinates the terms in their dictionary
    candidates: Mapping[tuple[Any, ...], Mix]

    @classmethod
    def of(cls, model: Model, stages: Sequence[Sequence[Mix]]) -> "Candidates":
        """One dictionary per law, with every term of the stages once."""
        by_law: dict[tuple[Any, ...], Mix] = {}
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
        chosen = (*self.base.independent, *range(len(self.base.names), len(self.model.parameters)))
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
    known: dict[Mix, Array] = field(default_factory=dict)
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

    def errors(self, mix: Mix) -> Array | None:
        """One figure per fold; `None` if the data are too few for a mix, not the first."""
        names = self.wide.columns_of(mix)
        tested = self.whole.select(names)
        fitted = tested if has_memory(mix) else self.moving.select(names)
        try:
            self.known[mix] = left_out_errors(fitted, tested, self.fitting(mix))
        except DataError as error:
            if self.known:
                return None
            raise too_short(self.whole.runs) from error
        return logarithms(self.known[mix], self.sizes)

    def fitting(self, mix: Mix) -> Callable[[Information], Array]:
        """How the columns of a mix get their values."""
        if self.consistent is None:
            return values_by(self.estimator)
        whole = replace(self.model, terms=(*self.model.terms, *mix))
        added = whole.parameters[len(self.model.parameters) :]
        base = self.wide.base.beside([p.name for p in added], [p.unit for p in added])
        estimator = self.consistent(whole, base)
        if not self.gammas:
            everything = self.moving.select(self.wide.columns_of(mix))
            self.gammas.append(estimator.values(_plain(everything))[1])
        near: list[Array] = []

        def fitted(information: Information) -> Array:
            report_progress(self.progress, "choosing friction laws", len(self.known), self.count)
            values, _, standard = estimator.values(_plain(information), self.gammas[0], *near)
            near[:] = [standard]
            return values

        return fitted

    def plausible(self, kept: Mix, laws: Mix) -> Mix:
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

    def per_joint(self, following: Mix) -> list[tuple[Mix, Array]]:
        """Dahl friction with each joint's best length; folds are judged with that of the others."""
        tried = [mix for mix in self.known if isinstance(mix[0], Dahl) and mix[1:] == following]
        if len(self.whole.layout.rows) < 2 or len(tried) < 2:
            return []
        logs = np.log(np.maximum([self.known[mix] for mix in tried], 1e-12))
        logs = np.where(self.sizes > 0.0, logs, 0.0)

        def with_lengths(errors: Array) -> Mix:
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
    named = tuple(name.partition("@")[0] for name in information.layout.columns)
    return replace(information, layout=replace(information.layout, columns=named))


def choose_friction(
    model: Model,
    runs: Sequence[Run],
    estimator: Estimator[Information],
    consistent: ConsistentOf | None = None,
    *,
    memory: bool = True,
    threads: int = 1,
    progress: Progress = silent,
) -> FrictionChoice:
    """The mix of friction laws with the least error where it was not fitted.

    The model has no friction yet. Each mix is fitted by `estimator`, or by the consistent estimate
    where the model is to be given that. Without `memory` laws with a state, of memory or of the
    load of the links, are no candidates. A `DataError` says that the runs are too short to leave
    one out.
    """
    refuse_listed(model)
    divided = folding(runs)
    considered = [
        [mix for mix in stage if memory or not has_memory(mix)]
        for stage in stages_of(model, runs[0].recording.signals.effort_kind, divided.left_out)
    ]
    information_of = information_from(runs, threads=threads, progress=progress)
    plain = replace(model, terms=(*model.terms, *PLAIN))
    loaded = any(t.needs_reference for stage in considered for mix in stage for t in mix)
    reference = reference_of(plain, information_of, estimator) if loaded else {}
    stages = [
        [tuple(term.with_reference(reference) for term in mix) for mix in stage]
        for stage in considered
    ]
    wide = Candidates.of(model, stages)
    moving, whole = (
        information_from(
            runs, rests=rests, longest=divided.longest, threads=threads, progress=progress
        )(wide.regressor)
        for rests in (False, True)
    )
    folds = divided.parts(moving)
    judge = FrictionMixErrors(
        model,
        wide,
        per_fold(moving, folds),
        per_fold(whole, folds),
        estimator,
        consistent,
        progress=progress,
        count=sum(len(stage) for stage in stages),
    )
    return _staged(stages, judge, divided.left_out)


def refuse_listed(model: Model) -> None:
    """A friction law of the joints is listed or chosen, not both."""
    laws = (term for stage in (DIRECTION, SPEED, LOAD) for mix in stage for term in mix)
    for term in laws:
        twice = [p.name for p in term.parameters(model.robot) if p.name in model.names]
        if twice:
            wrong = f"friction is to be chosen, but '{term.law}' is listed ('{twice[0]}')"
            fix = 'leave friction laws of the joints out of `terms`, or friction = "auto"'
            raise ModelError(wrong, where=f"list of terms of robot '{model.robot.name}'", fix=fix)


def _staged(
    stages: Sequence[Sequence[Mix]], judge: FrictionMixErrors, left_out: str
) -> FrictionChoice:
    """The best law of direction; then the simplest mix of each stage."""
    table: list[tuple[Mix, Array]] = []
    kept: Mix = ()
    following = stages[1][0]
    for number, stage in enumerate(stages):
        # viscous friction is there from the start: direction alone would be judged by its lack
        extra = following if number == 0 else ()
        mixes = [(*kept, *judge.plausible(kept, laws), *extra) for laws in stage]
        found = [(mix, error) for mix in mixes if (error := judge.errors(mix)) is not None]
        found += judge.per_joint(extra) if number == 0 else []
        table += [pair for pair in found if pair[0] not in [mix for mix, _ in table]]
        if number == 0:
            chosen = _least(found)
            kept = chosen[: len(chosen) - len(extra)]
        else:  # the first not worse than the best; what is added must gain beyond chance
            best = min((error for _, error in found), key=lambda error: float(error.mean()))
            most = float(found[0][1].mean())
            kept = next(mix for mix, e in found if not worse(e, best) and e.mean() <= most)
    rows = []
    for mix, error in table:
        against = error - table[0][1]
        ratio, mean = (float(np.exp(x.mean())) for x in (against, error))
        gain, spread = 100.0 * (1.0 - ratio), 100.0 * ratio * standard_error(against)
        rows.append(MixScore(mix_name(mix), mix, mean, gain, spread, mix == kept))
    return FrictionChoice(tuple(rows), left_out)


def _least(found: Sequence[tuple[Mix, Array]]) -> Mix:
    """The mix of least error, or the first if chance explains what it loses to each other."""
    first, best = found[0], min((error for _, error in found), key=lambda e: float(e.mean()))
    if not any(worse(first[1], error, DIRECTION_LOSS_PROBABILITY) for _, error in found):
        return first[0]
    return next(mix for mix, error in found if (error - best).mean() <= LEAST_GAIN_PER_PARAMETER)


def worse(error: Array, best: Array, sure: float = LOSS_PROBABILITY) -> bool:
    """Whether a mix loses more to the best than chance explains, and any worth."""
    loss = error - best
    return bool(loss.mean() > max(chance_of(loss, sure), LEAST_GAIN_PER_PARAMETER))
