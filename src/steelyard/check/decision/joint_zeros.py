"""Do joints count their positions from where the model file says, or quarter turns away?

A fit cannot always tell which of two joints is turned, as parameters of the links change with it:
the nominal masses can. They are asked only where they agree badly with a log as declared, and no
other hypothesis explains it.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import ClassVar

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import SteelyardError
from steelyard.check.case import Case, Evidence
from steelyard.check.decision.decidable import UNKNOWN_GAINS
from steelyard.check.decision.ranking import DECISIVE_GAIN, known_of
from steelyard.check.decision.verdict import CLEAN, STRIKING, LogVerdict, judge_log, last_winner
from steelyard.check.finding import ComparedHypothesis, Edit, Finding, Fix, Severity
from steelyard.check.fitted.fitted_case import (
    RankedCauses,
    can_be_ranked,
    first_parts_of_runs,
    ranked_causes,
    worst_residual_words,
)
from steelyard.check.fitted.zero_offsets import (
    IF_CONFIRMED,
    TurnedJoints,
    estimated_offsets,
    far_offsets,
    offset_line,
    offset_words,
    quarter_turns_of_joints,
    turned_zeros,
    zeros_without_effect,
)
from steelyard.check.hypotheses.likelihood import LikelihoodScore
from steelyard.check.hypotheses.position_columns import ZERO_CAUSE, with_moved_zero
from steelyard.check.identifiability import clean_runs, customary_model
from steelyard.estimate.friction.mixes import has_memory
from steelyard.estimate.information.regressor import base_regressor
from steelyard.estimate.least_squares.least_squares import WeightedLeastSquares
from steelyard.estimate.least_squares.normal_equations import own_columns
from steelyard.estimate.nonlinear.fields import information_from
from steelyard.estimate.nonlinear.zero_offset import ZeroOffsets
from steelyard.model.model import Model
from steelyard.robot.robot import Robot
from steelyard.runs.run import Run


class JointZeros:
    """Zero offsets that explain the residuals of a fit better than anything else."""

    name: ClassVar[str] = ZERO_CAUSE
    question: ClassVar[str] = "Are the joint zeros those of the model file?"
    quick: ClassVar[bool] = False

    def __call__(self, case: Case) -> tuple[Finding, ...]:
        """One finding for all logs together; none where no run or no open chain is there.

        None with a reference either, where the hypothesis check of this name decides.
        """
        signals = case.logs[0].recording.signals if case.logs else None
        if signals is None or any(signals.unknown_offsets):
            return ()
        known = known_of(case)
        if known is not None and known.identified:
            return ()
        try:
            runs, model = clean_runs(case), customary_model(case)
            if not runs or not can_be_ranked(model):
                return ()
            if any(signals.unknown_gains):
                says = UNKNOWN_GAINS[ZERO_CAUSE]
                return (Finding(self.name, "", Severity.OK, says, "", answered=False),)
            return (_zeros_found(model, first_parts_of_runs(runs)),)
        except SteelyardError as error:
            says = f"not estimated: {error.wrong}"
            return (Finding(self.name, "", Severity.OK, says, "", answered=False),)


def _zeros_found(model: Model, runs: tuple[Run, ...]) -> Finding:
    information_of = information_from(runs, rests=has_memory(model.terms))
    estimate = WeightedLeastSquares(per_run=own_columns(model))(
        information_of(base_regressor(model))
    )
    ranked = ranked_causes(model, estimate, runs)
    found = _zeros_by_derivatives(model.robot, ranked, estimated_offsets(model, runs))
    if found.severity or not ranked.of_geometry:
        return found
    turned = turned_zeros(model, estimate.sigma, runs)
    if turned is None:
        return found
    figure = worst_residual_words(ranked.beside)
    return Finding(
        JointZeros.name,
        "",
        Severity.DOUBTFUL,
        turned.says,
        figure,
        joints=turned.joints,
        fix=turned.fix,
    )


def _zeros_by_derivatives(
    robot: Robot, ranked: RankedCauses, offsets: ZeroOffsets | None
) -> Finding:
    """What offsets within reach of derivatives say."""
    if offsets is None:
        says = "not estimated: too few samples"
        return Finding(JointZeros.name, "", Severity.OK, says, "", answered=False)
    far, known = far_offsets(offsets), np.isfinite(offsets.std)
    if not known.any():
        says = "not identifiable from these data: the zero offset of every joint"
        return Finding(JointZeros.name, "", Severity.OK, says, "", answered=False)
    if not far.any():
        says = f"no significant zero offset{_of(offsets)}{_hidden_zeros(offsets)}"
        answered = bool(np.all(known | zeros_without_effect(robot)))
        says += "" if answered else "; a model from runs known to be correct (--model) tests more"
        return Finding(
            JointZeros.name, "", Severity.OK, says, _value_text(offsets), answered=answered
        )
    if not ranked.blamed or ranked.blamed[0].kind != "zero_offset":
        says = (
            f"{offset_words(offsets, far)} is undecided: other model errors explain as much; "
            "compare "
            f"the zeros with the robot{_hidden_zeros(offsets)}"
        )
        return Finding(JointZeros.name, "", Severity.OK, says, _value_text(offsets), answered=False)
    return Finding(
        JointZeros.name,
        "",
        Severity.DOUBTFUL,
        f"{offset_words(offsets, far)} explains the residuals of a fit best",
        f"{100.0 * ranked.blamed[0].chi2 / ranked.total:.2g} % of chi², "
        f"{worst_residual_words(ranked.beside)}",
        joints=tuple(j for j, wrong in zip(offsets.joints, far, strict=True) if wrong),
        fix=offset_line(offsets, far),
    )


def _value_text(offsets: ZeroOffsets) -> str:
    """All offsets with their intervals, and those that these data do not identify."""
    return f"{offset_words(offsets, np.isfinite(offsets.std))}{_hidden_zeros(offsets)}"


def _of(offsets: ZeroOffsets) -> str:
    """Of which joints this holds, if not of all."""
    known = np.isfinite(offsets.std)
    identified = [joint for joint, sure in zip(offsets.joints, known, strict=True) if sure]
    return "" if known.all() else f" of {', '.join(identified)}"


def _hidden_zeros(offsets: ZeroOffsets) -> str:
    """Joints whose offsets these data do not identify; empty if there are none."""
    known = np.isfinite(offsets.std)
    left = [joint for joint, sure in zip(offsets.joints, known, strict=True) if not sure]
    return f"; not identifiable: {', '.join(left)}" if left else ""


TURNED_MISFIT_FALL = 2.0
"""Factor by which the misfit must fall: on logs of five sound robots it falls by 1.02."""


def quarter_turns(case: Case) -> Iterator[Finding]:
    """A doubtful finding per log that the nominal model explains with turned zeros alone."""
    known = known_of(case)
    if known is None or known.identified or known.robot.passive:
        return
    for evidence in case.logs:
        decision = judge_log(case, evidence)
        if decision is None or decision.alien or decision.winners:
            continue
        if not any(evidence.recording.signals.unknown_offsets):
            yield from _quarter_turn_found(case, evidence, decision)


def turned_joints(findings: Sequence[Finding]) -> tuple[Finding, ...]:
    """What limits a fit: zeros that the check before found to be turned, once for all logs."""
    found = [f for f in findings if f.check == ZERO_CAUSE and f.severity and f.hypotheses]
    return tuple(replace(f, log="", figure="") for f in found[:1])


def _quarter_turn_found(case: Case, evidence: Evidence, decision: LogVerdict) -> Iterator[Finding]:
    now, scores = _turned_scores(decision)
    if not scores:
        return
    near = _best_turns(scores)
    best = near[0]
    before, after = float(now.percent[0]), float(scores[best].percent[0])
    rise = _likely_turns(scores[best]) - _likely_turns(now)
    if rise < STRIKING or after > min(CLEAN, before / TURNED_MISFIT_FALL):
        return
    words = " or ".join(_turn_words(case, turned) for turned in near)
    yield Finding(
        ZERO_CAUSE,
        evidence.name,
        Severity.DOUBTFUL,
        f"joint zeros other than those of the model file: {words}: misfit of the nominal model "
        f"{after:.1f} %, as declared {before:.1f} %",
        f"misfit {before:.1f} % falls to {after:.1f} %, log-likelihood {rise:+.0f}",
        tuple(case.joints[k] for k, _ in best),
        _turn_fix(evidence, best, alone=len(near) == 1),
        hypotheses=(
            ComparedHypothesis(_turn_words(case, best), after, 0.0),
            ComparedHypothesis("as declared", before, -rise, declared=True),
        ),
        nominal=True,
    )


def _turned_scores(
    decision: LogVerdict,
) -> tuple[LikelihoodScore, dict[TurnedJoints, LikelihoodScore]]:
    """The score as declared, and those of turned zeros of one joint or of neighbours."""
    likelihood, declared = decision.ranking.likelihood, last_winner(decision).interpretation
    units = [coordinate.unit for coordinate in likelihood.knowledge.robot.coordinates]
    turning = [k for k, unit in enumerate(units) if unit == "rad"]
    found = {}
    for turned in (x for joints in (1, 2) for x in quarter_turns_of_joints(turning, joints)):
        other = declared
        for joint, turn in turned:
            other = with_moved_zero(other, joint, turn)
        found[turned] = likelihood.score(other)
    return likelihood.score(declared), found


def _best_turns(scores: dict[TurnedJoints, LikelihoodScore]) -> list[TurnedJoints]:
    """Turns that fit about as well as any, the best first; none with a joint more than it needs."""
    least = max(map(_likely_turns, scores.values())) - DECISIVE_GAIN
    near = sorted(
        (x for x in scores if _likely_turns(scores[x]) > least),
        key=lambda x: -_likely_turns(scores[x]),
    )
    return [x for x in near if not any(set(y) < set(x) for y in near)]


def _likely_turns(score: LikelihoodScore) -> float:
    return float(score.log_likelihood[0])


def _turn_words(case: Case, turned: TurnedJoints) -> str:
    return ", ".join(f"{case.joints[k]} {np.rad2deg(turn):+.0f}°" for k, turn in turned)


def _turn_fix(evidence: Evidence, turned: TurnedJoints, *, alone: bool) -> Fix:
    """The line of the robot file, where no other one explains the log about as well."""
    given = evidence.recording.signals.position_offset
    offsets: Array = np.zeros(evidence.recording.signals.n) if given is None else given.copy()
    for joint, turn in turned:
        offsets[joint] += turn
    values = [round(value, 4) + 0.0 for value in offsets.tolist()]
    line = (Edit(("signals", "position_offset"), values),) if alone else ()
    return Fix(f"Set position_offset in [signals], {IF_CONFIRMED}", line)
