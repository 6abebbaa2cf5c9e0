"""The mix of friction laws that predicts best: `friction = "auto"`.

Laws are compared in stages, each beside what the stage before has chosen: how friction turns round
with the direction of motion, how it grows with speed, and whether it grows with the load. A mix is
judged by leaving one run out (one stretch of a single run). The law of direction with the least
error is taken, if one has less than plain Coulomb friction by more than chance explains over the
runs; what is added later must gain as surely.

All candidates' columns are gathered in one wide pass; a mix is a selection of them.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import ModelError
from steelyard.base.progress import Progress, silent
from steelyard.estimate.estimate import Estimator
from steelyard.estimate.friction.mix_errors import Candidates, ConsistentOf, FrictionMixErrors
from steelyard.estimate.friction.mixes import (
    DIRECTION,
    LOAD,
    PLAIN,
    SPEED,
    has_memory,
    mix_name,
    stages_of,
)
from steelyard.estimate.information.information import Information
from steelyard.estimate.nonlinear.fields import information_from, reference_of
from steelyard.estimate.scores.cross_validation import (
    LEAST_GAIN_PER_PARAMETER,
    folding,
    per_fold,
    standard_error,
)
from steelyard.model.model import Model
from steelyard.model.terms.term import Term
from steelyard.runs.run import Run

LOSS_PROBABILITY, DIRECTION_LOSS_PROBABILITY = 0.9, 0.95
"""Probability with which a loss over the parts must be one, by Student's distribution; and that to
any of the many laws of direction."""

Mix = tuple[Term, ...]  # friction laws that act together


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

    terms: Mix  # the friction laws
    table: tuple[MixScore, ...]  # all mixes that were compared, in order
    left_out: str  # what was left out in turn: `run` or `stretch`

    @property
    def name(self) -> str:
        """The laws that were chosen."""
        return mix_name(self.terms)

    @property
    def without_memory(self) -> MixScore | None:
        """The best mix without memory, where the chosen one has some."""
        others = [mix for mix in self.table if not has_memory(mix.terms)]
        if not has_memory(self.terms) or not others:
            return None
        return min(others, key=lambda mix: mix.error)

    def to_dict(self) -> dict[str, Any]:
        """As JSON values."""
        other = self.without_memory
        return {
            "chosen": self.name,
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
        first, best = self.table[0], next(mix for mix in self.table if mix.chosen)
        return (
            f"friction chosen by cross-validation, leaving one {self.left_out} out: {self.name} "
            f"({best.error:.2f} %; {first.name}: {first.error:.2f} %)"
        )


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
    mix_errors = FrictionMixErrors(
        model,
        wide,
        per_fold(moving, folds),
        per_fold(whole, folds),
        estimator,
        consistent,
        progress=progress,
        count=sum(len(stage) for stage in stages),
    )
    return _staged(
        stages, mix_errors.errors, divided.left_out, mix_errors.per_joint, mix_errors.plausible
    )


def refuse_listed(model: Model) -> None:
    """A friction law of the joints is listed or chosen, not both."""
    laws = (term for stage in (DIRECTION, SPEED, LOAD) for mix in stage for term in mix)
    for term in laws:
        twice = [p.name for p in term.parameters(model.robot) if p.name in model.names]
        if twice:
            raise ModelError(
                f"friction is to be chosen, but '{term.law}' is listed ('{twice[0]}')",
                where=f"list of terms of robot '{model.robot.name}'",
                fix='leave friction laws of the joints out of `terms`, or friction = "auto"',
            )


def _staged(
    stages: Sequence[Sequence[Mix]],
    errors: Callable[[Mix], Array | None],
    left_out: str,
    per_joint: Callable[[Mix], list[tuple[Mix, Array]]] = lambda following: [],
    plausible: Callable[[Mix, Mix], Mix] = lambda kept, laws: laws,
) -> FrictionChoice:
    """The best law of direction; then the simplest mix of each stage.

    `per_joint` gives mixes whose fields are of each joint, beside the laws that follow, with their
    errors; `plausible` the laws beside those kept, of the joints that they are plausible of.
    """
    table: list[tuple[Mix, Array]] = []
    kept: Mix = ()
    following = stages[1][0]
    for number, stage in enumerate(stages):
        # viscous friction is there from the start: direction alone would be judged by its lack
        extra = following if number == 0 else ()
        mixes = [(*kept, *plausible(kept, laws), *extra) for laws in stage]
        found = [(mix, error) for mix in mixes if (error := errors(mix)) is not None]
        found += per_joint(extra) if number == 0 else []
        table += [pair for pair in found if pair[0] not in [mix for mix, _ in table]]
        chosen = _simplest(found) if number else _least(found)
        kept = chosen[: len(chosen) - len(extra)] if number == 0 else chosen
    rows = []
    for mix, error in table:
        against = error - table[0][1]
        ratio, mean = (float(np.exp(x.mean())) for x in (against, error))
        gain, spread = 100.0 * (1.0 - ratio), 100.0 * ratio * standard_error(against)
        rows.append(MixScore(mix_name(mix), mix, mean, gain, spread, mix == kept))
    return FrictionChoice(kept, tuple(rows), left_out)


def _least(found: Sequence[tuple[Mix, Array]]) -> Mix:
    """The mix of least error, or one before it that is next to as good.

    The first is preferred if chance explains what it loses to each of the others.
    """
    first, best = found[0], min((error for _, error in found), key=lambda e: float(e.mean()))
    if not any(worse(first[1], error, DIRECTION_LOSS_PROBABILITY) for _, error in found):
        return first[0]
    return next(mix for mix, error in found if (error - best).mean() <= LEAST_GAIN_PER_PARAMETER)


def _simplest(found: Sequence[tuple[Mix, Array]]) -> Mix:
    """The first mix of a stage that is not worse than the best, nor than the first of all.

    What is added to the first must gain more than chance explains.
    """
    best = min((error for _, error in found), key=lambda error: float(error.mean()))
    most = float(found[0][1].mean())
    return next(mix for mix, e in found if not worse(e, best) and e.mean() <= most)


def worse(error: Array, best: Array, sure: float = LOSS_PROBABILITY) -> bool:
    """Whether a mix loses more to the best than chance explains, and any worth."""
    from scipy.special import stdtrit

    loss = error - best
    times = float(stdtrit(len(loss) - 1, sure)) if len(loss) > 1 else 0.0
    return bool(loss.mean() > max(times * standard_error(loss), LEAST_GAIN_PER_PARAMETER))
