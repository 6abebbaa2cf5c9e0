"""The mix of friction laws that predicts best: `friction = "auto"`.

Laws are compared in stages, each beside what the stage before has chosen: how friction turns round
with the direction of motion, how it grows with speed, and whether it grows with the load. A mix is
judged by leaving one run out (one stretch of a single run). The law of direction with the least
error is taken, if that is less than of plain Coulomb friction by more than chance explains over the
runs; what is added later must gain as surely.

All candidates' columns are gathered in one wide pass; a mix is a selection of them.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, cast

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import DataError, ModelError
from steelyard.estimation.consistent import Consistent
from steelyard.estimation.estimate import Estimator
from steelyard.estimation.fields import said_by
from steelyard.estimation.reference import reference_of
from steelyard.measurement.run import Run
from steelyard.model import Model
from steelyard.progress import Progress, silent, tell
from steelyard.regression.base import BaseMap, base_map
from steelyard.regression.information import Information
from steelyard.regression.regressor import Regressor, chosen_regressor
from steelyard.terms.dictionary import Dictionary
from steelyard.terms.load_dependent import LoadDependent
from steelyard.terms.presliding import Dahl
from steelyard.terms.term import Remembering, Term
from steelyard.validation.cross import (
    LEAST,
    folding,
    left_out_errors,
    logarithms,
    per_fold,
    standard_error,
    too_short,
    values_by,
)
from steelyard.validation.mixes import DIRECTION, LOAD, SPEED, mix_name, remembers, stages_of

SURE = 0.9
"""Probability with which a loss over the parts must be one, by Student's distribution."""

ConsistentOf = Callable[[Model, BaseMap], Consistent]
"""The consistent estimate for a model and its base parameters."""

PerJoint = Callable[[tuple[Term, ...]], list[tuple[tuple[Term, ...], Array]]]
"""Mixes whose fields are of each joint, beside the laws that follow, with their errors."""


@dataclass(frozen=True)
class MixScore:
    """How well a mix of friction laws predicts what it was not fitted to.

    Attributes:
        name: The laws, for people to read.
        terms: The laws.
        error: Relative error on what was left out, mean over runs: the geometric mean of a typical
            joint's and of all joints' together [%].
        gain: How much less that is than with the first mix of the table [% of it].
        spread: Standard error of that gain over the runs [%].
        chosen: Whether it is the mix that was chosen.
    """

    name: str
    terms: tuple[Term, ...]
    error: float
    gain: float
    spread: float
    chosen: bool = False


@dataclass(frozen=True)
class FrictionChoice:
    """The mix that was chosen, and the table it was chosen from.

    Attributes:
        terms: The friction laws.
        table: All mixes that were compared, in order.
        left_out: What was left out in turn: `run` or `stretch`.
    """

    terms: tuple[Term, ...]
    table: tuple[MixScore, ...]
    left_out: str

    @property
    def name(self) -> str:
        """The laws that were chosen."""
        return mix_name(self.terms)

    def to_dict(self) -> dict[str, Any]:
        """As JSON values."""
        return {
            "chosen": self.name,
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
        first, best = self.table[0], next(mix for mix in self.table if mix.chosen)
        return (
            f"friction chosen by leaving one {self.left_out} out: {self.name} "
            f"({best.error:.2f} %; {first.name}: {first.error:.2f} %)"
        )


def choose_friction(
    model: Model,
    runs: Sequence[Run],
    estimator: Estimator[Information],
    consistent: ConsistentOf | None = None,
    *,
    threads: int = 1,
    progress: Progress = silent,
) -> FrictionChoice:
    """The mix of friction laws with the least error where it was not fitted.

    Args:
        model: The robot and its causes of torque without the friction that is to be chosen.
        runs: The runs to be fitted.
        estimator: How each mix is fitted.
        consistent: The consistent estimate, if the model is to be given that: each mix is then
            fitted by it.
        threads: Native threads.
        progress: Told about the passes.

    Raises:
        DataError: The runs are too short to leave one out.
    """
    refuse_listed(model)
    divided = folding(runs)
    considered = stages_of(model, runs[0].recording.signals.effort_kind, divided.left_out)
    said = said_by(runs, threads=threads, progress=progress)
    plain = replace(model, terms=(*model.terms, *DIRECTION[0], *SPEED[0]))
    loaded = any(isinstance(t, LoadDependent) for stage in considered for mix in stage for t in mix)
    reference = reference_of(plain, said, estimator) if loaded else {}
    stages = tuple(
        tuple(tuple(_with_reference(term, reference) for term in mix) for mix in stage)
        for stage in considered
    )
    wide = _Wide.of(model, stages)

    def gathered(rests: bool) -> Information:
        parts = said_by(
            runs, rests=rests, longest=divided.longest, threads=threads, progress=progress
        )
        return parts(wide.regressor)

    moving, whole = gathered(False), gathered(True)
    folds = divided.parts(moving)
    moving, whole = per_fold(moving, folds), per_fold(whole, folds)
    count = sum(len(stage) for stage in stages)
    trials = _Trials(
        model, wide, moving, whole, estimator, consistent, progress=progress, count=count
    )
    return _staged(stages, trials.errors, divided.left_out, trials.per_joint)


@dataclass(frozen=True, eq=False)
class _Trials:
    """Errors of mixes on what was left out.

    Attributes:
        model: The model without friction.
        wide: All candidates' columns.
        moving: One window per fold, without rests.
        whole: The same with rests.
        estimator: How each mix is fitted.
        consistent: Fits them in its place, if it is there.
        known: Errors of the mixes that were tried, shape `(folds, rows)`.
        gammas: Weight of the prior, one for all mixes and parts: that of the first mix and all
            runs. One for each part would scatter by more than mixes differ.
        progress: Told about every fit.
        count: How many mixes there may be.
    """

    model: Model
    wide: "_Wide"
    moving: Information
    whole: Information
    estimator: Estimator[Information]
    consistent: ConsistentOf | None
    known: dict[tuple[Term, ...], Array] = field(default_factory=dict)
    gammas: list[float] = field(default_factory=list)
    progress: Progress = silent
    count: int = 1

    @cached_property
    def sizes(self) -> Array:
        """Squares of the efforts, shape `(folds, rows)`."""
        count = len(self.whole.windows)
        return np.array([self.whole.of([k]).effort_squares() for k in range(count)])

    def errors(self, mix: tuple[Term, ...]) -> Array | None:
        """One figure per fold; `None` of a mix that the data are too few for.

        Raises:
            DataError: They are too few for the first.
        """
        names = self.wide.columns_of(mix)
        tested = self.whole.select(names)
        fitted = tested if remembers(mix) else self.moving.select(names)
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
            self.gammas.append(estimator.values(_plain(everything))[1])

        def fitted(information: Information) -> Array:
            tell(self.progress, "choosing friction laws", len(self.known), self.count)
            return estimator.values(_plain(information), self.gammas[0])[0]

        return fitted

    def per_joint(self, following: tuple[Term, ...]) -> list[tuple[tuple[Term, ...], Array]]:
        """Dahl friction with the best length of each joint.

        The lengths are those of all folds; a fold is judged with those of the others.
        """
        tried = [mix for mix in self.known if isinstance(mix[0], Dahl) and mix[1:] == following]
        if len(self.whole.layout.rows) < 2 or len(tried) < 2:
            return []
        logs = np.log(np.maximum([self.known[mix] for mix in tried], 1e-12))
        logs = np.where(self.sizes > 0.0, logs, 0.0)
        best = self._with_lengths(tried, logs.sum(axis=1), following)
        if any(_same_lengths(best[0], mix[0], len(self.whole.layout.rows)) for mix in tried):
            return []
        count = len(self.whole.windows)
        found = []
        for fold in range(count):
            others = [k for k in range(count) if k != fold]
            mix = self._with_lengths(tried, logs[:, others].sum(axis=1), following)
            names = self.wide.columns_of(mix)
            some = self.whole.select(names)
            try:
                errors = left_out_errors(some, some, self.fitting(mix), only=(fold,))
            except DataError:
                return []
            found.append(errors[0])
        return [(best, logarithms(np.array(found), self.sizes))]

    def _with_lengths(
        self, tried: Sequence[tuple[Term, ...]], logs: Array, following: tuple[Term, ...]
    ) -> tuple[Term, ...]:
        best = np.argmin(logs, axis=0).tolist()
        lengths = tuple(_length(tried[k][0], joint) for joint, k in enumerate(best))
        return (Dahl(length=lengths), *following)


def _plain(information: Information) -> Information:
    """With the names that columns have in a model."""
    named = tuple(name.partition("@")[0] for name in information.layout.columns)
    return replace(information, layout=replace(information.layout, columns=named))


def refuse_listed(model: Model) -> None:
    """A friction law of the joints is listed or chosen, not both.

    Raises:
        ModelError: A parameter of the model is one of a candidate's.
    """
    laws = (term for stage in (DIRECTION, SPEED, LOAD) for mix in stage for term in mix)
    for term in laws:
        twice = [p.name for p in term.parameters(model.robot) if p.name in model.names]
        if twice:
            raise ModelError(
                f"friction is to be chosen, but '{term.law}' is listed ('{twice[0]}')",
                where=f"list of terms of robot '{model.robot.name}'",
                mend='leave friction laws of the joints out of `terms`, or friction = "auto"',
            )


def _staged(
    stages: Sequence[Sequence[tuple[Term, ...]]],
    errors: Callable[[tuple[Term, ...]], Array | None],
    left_out: str,
    per_joint: PerJoint = lambda following: [],
) -> FrictionChoice:
    """The best law of direction; then the simplest mix of each stage."""
    table: list[tuple[tuple[Term, ...], Array]] = []
    kept: tuple[Term, ...] = ()
    following = stages[1][0]
    for number, stage in enumerate(stages):
        # viscous friction is there from the start: direction alone would be judged by its lack
        extra = following if number == 0 else ()
        mixes = [(*kept, *laws, *extra) for laws in stage]
        found = [(mix, error) for mix in mixes if (error := errors(mix)) is not None]
        found += per_joint(extra) if number == 0 else []
        table += [pair for pair in found if pair[0] not in [mix for mix, _ in table]]
        chosen = _simplest(found) if number else _least(found)
        kept = chosen[: len(chosen) - len(extra)] if number == 0 else chosen
    first = table[0][1]
    rows = (
        MixScore(
            mix_name(mix),
            mix,
            float(np.exp(error.mean())),
            100.0 * (1.0 - _ratio(error - first)),
            100.0 * _ratio(error - first) * standard_error(error - first),
            mix == kept,
        )
        for mix, error in table
    )
    return FrictionChoice(kept, tuple(rows), left_out)


def _least(found: Sequence[tuple[tuple[Term, ...], Array]]) -> tuple[Term, ...]:
    """The mix of least error, or one before it that is next to as good.

    The first is preferred if chance explains its loss.
    """
    best = min((error for _, error in found), key=lambda error: float(error.mean()))
    if not _worse(found[0][1], best):
        return found[0][0]
    return next(mix for mix, error in found if (error - best).mean() <= LEAST)


def _simplest(found: Sequence[tuple[tuple[Term, ...], Array]]) -> tuple[Term, ...]:
    """The first mix of a stage that is not worse than the best, nor than the first of all.

    What is added to the first must gain more than chance explains.
    """
    best = min((error for _, error in found), key=lambda error: float(error.mean()))
    most = float(found[0][1].mean())
    return next(mix for mix, e in found if not _worse(e, best) and e.mean() <= most)


def _ratio(logarithms: Array) -> float:
    return float(np.exp(logarithms.mean()))


def _worse(error: Array, best: Array) -> bool:
    """Whether a mix loses more to the best than chance explains, and any worth."""
    from scipy.stats import t

    loss = error - best
    times = float(t.ppf(SURE, len(loss) - 1)) if len(loss) > 1 else 0.0
    return bool(loss.mean() > max(times * standard_error(loss), LEAST))


def _with_reference(term: Term, reference: Mapping[str, float]) -> Term:
    return term.with_reference(reference) if isinstance(term, LoadDependent) else term


@dataclass(frozen=True, eq=False)
class _Wide:
    """All candidates' columns beside those of the model without friction.

    Attributes:
        model: The model with one dictionary per law.
        base: Base parameters of the model without friction.
        candidates: Per law and coordinates the terms in their dictionary.
    """

    model: Model
    base: BaseMap
    candidates: Mapping[tuple[Any, ...], tuple[Term, ...]]

    @classmethod
    def of(cls, model: Model, stages: Sequence[Sequence[tuple[Term, ...]]]) -> "_Wide":
        """One dictionary per law, with every term of the stages once."""
        by_law: dict[tuple[Any, ...], tuple[Term, ...]] = {}
        for term in (term for stage in stages for mix in stage for term in mix):
            known = by_law.setdefault(_place(term), ())
            by_law[_place(term)] = known if term in known else (*known, term)
        dictionaries = (
            Dictionary.of(model.robot, terms, max(terms, key=lambda t: _warm_up(t, model)))
            for terms in by_law.values()
        )
        wide = Model(model.robot, (*model.terms, *dictionaries))
        return cls(wide, base_map(model), by_law)

    @cached_property
    def regressor(self) -> Regressor:
        """Base columns of the model without friction, and all candidates' columns as they are."""
        first = len(self.base.names)
        chosen = (*self.base.independent, *range(first, len(self.model.parameters)))
        return chosen_regressor(self.model, self.base, chosen)

    def columns_of(self, mix: Sequence[Term]) -> tuple[str, ...]:
        """Names of the columns of a mix."""
        names = list(self.base.base_names)
        for term in mix:
            known = self.candidates[_place(term)]
            for k, parameter in enumerate(term.parameters(self.model.robot)):
                number = known.index(term) if term in known else _with_length(known, term, k)
                names.append(f"{parameter.name}@{number}")
        return tuple(names)


def _with_length(known: Sequence[Term], term: Term, joint: int) -> int:
    """Number of the candidate whose length of a joint is that of a term with one for each."""
    wanted = cast(Any, term).length[joint]
    return next(k for k, one in enumerate(known) if _length(one, joint) == wanted)


def _length(term: Term, joint: int) -> float:
    length = cast(Any, term).length
    return float(length[joint] if isinstance(length, tuple) else length)


def _same_lengths(one: Term, other: Term, joints: int) -> bool:
    return all(_length(one, joint) == _length(other, joint) for joint in range(joints))


def _place(term: Term) -> tuple[Any, ...]:
    """What terms of one dictionary have in common."""
    return (term.law, *(getattr(term, name, None) for name in ("joints", "motors", "along")))


def _warm_up(term: Term, model: Model) -> float:
    return float(term.warm_up(model.robot).max()) if isinstance(term, Remembering) else 0.0
