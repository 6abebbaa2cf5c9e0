"""The mix of friction laws that predicts best: `friction = "auto"`.

Laws are compared in stages, each beside what the stage before has chosen: how friction turns round
with the direction of motion, how it grows with speed, and whether it grows with the load. A mix is
judged by leaving one run out (one stretch of a single run); a simpler one is preferred when the
gain of a better one lies within the spread of its gain over the runs.

All candidates' columns are gathered in one wide pass; a mix is a selection of them.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import ModelError
from steelyard.estimation.estimate import Estimator
from steelyard.estimation.fields import said_by
from steelyard.estimation.reference import reference_of
from steelyard.measurement.run import Run
from steelyard.model import Model
from steelyard.progress import Progress, silent
from steelyard.regression.base import BaseMap, base_map
from steelyard.regression.information import Information
from steelyard.regression.regressor import Regressor, chosen_regressor
from steelyard.terms.dictionary import Dictionary
from steelyard.terms.load_dependent import LoadDependent
from steelyard.terms.term import Remembering, Term
from steelyard.validation.cross import folds_of, left_out_errors, longest_window, per_fold
from steelyard.validation.mixes import DIRECTION, LOAD, LOADED, SPEED, STAGES, mix_name, remembers

LEAST = 0.005
"""Gain that is worth another parameter, relative to the error."""


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
    *,
    threads: int = 1,
    progress: Progress = silent,
) -> FrictionChoice:
    """The mix of friction laws with the least error where it was not fitted.

    Args:
        model: The robot and its causes of torque without the friction that is to be chosen.
        runs: The runs to be fitted.
        estimator: How each mix is fitted.
        threads: Native threads.
        progress: Told about the passes.

    Raises:
        DataError: The runs are too short to leave one out.
    """
    refuse_listed(model)
    folds = folds_of(runs)
    considered = STAGES if runs[0].recording.signals.effort_kind in LOADED else STAGES[:-1]
    said = said_by(runs, threads=threads, progress=progress)
    plain = replace(model, terms=(*model.terms, *DIRECTION[0], *SPEED[0]))
    reference = reference_of(plain, said, estimator) if LOAD[-1] in considered[-1] else {}
    stages = tuple(
        tuple(tuple(_with_reference(term, reference) for term in mix) for mix in stage)
        for stage in considered
    )
    wide = _Wide.of(model, stages)

    def gathered(rests: bool) -> Information:
        window = longest_window(runs)
        parts = said_by(runs, rests=rests, longest=window, threads=threads, progress=progress)
        return per_fold(parts(wide.regressor), folds)

    moving, whole = gathered(False), gathered(True)
    sizes = np.array([whole.of([k]).effort_squares() for k in range(len(folds))])

    def errors(mix: tuple[Term, ...]) -> Array:
        names = wide.columns_of(mix)
        tested = whole.select(names)
        fitted = tested if remembers(mix) else moving.select(names)
        found = left_out_errors(fitted, tested, estimator)
        return _logarithms(found, sizes)

    return _staged(stages, errors, "run" if len(runs) > 1 else "stretch")


def refuse_listed(model: Model) -> None:
    """A friction law of the joints is listed or chosen, not both.

    Raises:
        ModelError: A parameter of the model is one of a candidate's.
    """
    for term in (term for stage in STAGES for mix in stage for term in mix):
        twice = [p.name for p in term.parameters(model.robot) if p.name in model.names]
        if twice:
            raise ModelError(
                f"friction is to be chosen, but '{term.law}' is listed ('{twice[0]}')",
                where=f"list of terms of robot '{model.robot.name}'",
                mend='leave friction laws of the joints out of `terms`, or friction = "auto"',
            )


def _logarithms(errors: Array, sizes: Array) -> Array:
    """One figure per fold: between the typical joint's error and that of all joints together.

    The former alone would let joints that carry next to nothing decide, the latter would leave
    all but the strongest out.

    Args:
        errors: Relative errors, shape `(folds, rows)`.
        sizes: Squares of the efforts, shape `(folds, rows)`.

    Returns:
        Logarithms of relative errors, shape `(folds,)`.
    """
    least = 1e-12
    typical = np.log(np.maximum(errors, least)).mean(axis=1)
    pooled = np.sqrt((np.square(errors) * sizes).sum(axis=1) / sizes.sum(axis=1))
    return np.asarray(0.5 * (typical + np.log(np.maximum(pooled, least))))


def _staged(
    stages: Sequence[Sequence[tuple[Term, ...]]],
    errors: Callable[[tuple[Term, ...]], Array],
    left_out: str,
) -> FrictionChoice:
    """Stage by stage the simplest mix within the spread of the best."""
    table: list[tuple[tuple[Term, ...], Array]] = []
    kept: tuple[Term, ...] = ()
    following = stages[1][0]
    for number, stage in enumerate(stages):
        # viscous friction is there from the start: direction alone would be judged by its lack
        extra = following if number == 0 else ()
        mixes = [(*kept, *laws, *extra) for laws in stage]
        found = [(mix, errors(mix)) for mix in mixes]
        table += [pair for pair in found if pair[0] not in [mix for mix, _ in table]]
        chosen = _simplest(found)
        kept = chosen[: len(chosen) - len(extra)] if number == 0 else chosen
    first = table[0][1]
    rows = (
        MixScore(
            mix_name(mix),
            mix,
            float(np.exp(error.mean())),
            100.0 * (1.0 - _ratio(error - first)),
            100.0 * _ratio(error - first) * _spread(error - first),
            mix == kept,
        )
        for mix, error in table
    )
    return FrictionChoice(kept, tuple(rows), left_out)


def _simplest(found: Sequence[tuple[tuple[Term, ...], Array]]) -> tuple[Term, ...]:
    """The first mix of a stage that is not worse than the best, nor than the simplest of all.

    A mix whose errors scatter is not told from the best; that alone does not speak for it.
    """
    best = min((error for _, error in found), key=lambda error: float(error.mean()))
    most = float(found[0][1].mean())
    return next(mix for mix, e in found if not _worse(e, best) and e.mean() <= most)


def _ratio(logarithms: Array) -> float:
    return float(np.exp(logarithms.mean()))


def _worse(error: Array, best: Array) -> bool:
    """Whether a mix loses more to the best than that loss spreads over the runs, and any worth."""
    return bool((error - best).mean() > max(_spread(error - best), LEAST))


def _spread(values: Array) -> float:
    return float(values.std(ddof=1) / np.sqrt(len(values))) if len(values) > 1 else 0.0


def _with_reference(term: Term, reference: Mapping[str, float]) -> Term:
    return term.with_reference(reference) if isinstance(term, LoadDependent) else term


@dataclass(frozen=True, eq=False)
class _Wide:
    """All candidates' columns beside those of the model without friction.

    Attributes:
        model: The model with one dictionary per law.
        base: Base parameters of the model without friction.
        candidates: Per law the terms in its dictionary.
    """

    model: Model
    base: BaseMap
    candidates: Mapping[str, tuple[Term, ...]]

    @classmethod
    def of(cls, model: Model, stages: Sequence[Sequence[tuple[Term, ...]]]) -> "_Wide":
        """One dictionary per law, with every term of the stages once."""
        by_law: dict[str, tuple[Term, ...]] = {}
        for term in (term for stage in stages for mix in stage for term in mix):
            known = by_law.setdefault(term.law, ())
            by_law[term.law] = known if term in known else (*known, term)
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
            number = self.candidates[term.law].index(term)
            names += [f"{p.name}@{number}" for p in term.parameters(self.model.robot)]
        return tuple(names)


def _warm_up(term: Term, model: Model) -> float:
    return float(term.warm_up(model.robot).max()) if isinstance(term, Remembering) else 0.0
