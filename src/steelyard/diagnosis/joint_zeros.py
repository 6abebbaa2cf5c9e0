"""Do joints count their positions from where the model file says?"""

from typing import ClassVar

import numpy as np

from steelyard.diagnosis.case import Case
from steelyard.diagnosis.decision.decidable import UNKNOWN_GAINS
from steelyard.diagnosis.decision.ranking import known_of
from steelyard.diagnosis.finding import Finding, Severity
from steelyard.diagnosis.hypotheses.by_zero import CAUSE
from steelyard.diagnosis.identifiability import clean_runs, customary_model
from steelyard.diagnosis.ranked_causes import (
    Ranked,
    beginnings,
    can_be_ranked,
    ranked_causes,
    residuals,
)
from steelyard.diagnosis.turned_zeros import turned_zeros
from steelyard.diagnosis.zero_offset import (
    correction,
    estimated_offsets,
    far_offsets,
    numbers,
    without_effect,
)
from steelyard.errors import SteelyardError
from steelyard.estimation.fields.fields import information_from
from steelyard.estimation.least_squares.least_squares import WeightedLeastSquares
from steelyard.estimation.per_run import own_columns
from steelyard.estimation.zero_offset import ZeroOffsets
from steelyard.measurement.run import Run
from steelyard.model import Model
from steelyard.regression.regressor import base_regressor
from steelyard.robot.robot import Robot
from steelyard.validation.friction.mixes import remembers


class JointZeros:
    """Zero offsets that explain the residuals of a fit better than anything else."""

    name: ClassVar[str] = CAUSE
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
                says = UNKNOWN_GAINS[CAUSE]
                return (Finding(self.name, "", Severity.OK, says, "", answered=False),)
            return (_found(model, beginnings(runs)),)
        except SteelyardError as error:
            says = f"not estimated: {error.wrong}"
            return (Finding(self.name, "", Severity.OK, says, "", answered=False),)


def _found(model: Model, runs: tuple[Run, ...]) -> Finding:
    information_of = information_from(runs, rests=remembers(model.terms))
    estimate = WeightedLeastSquares(per_run=own_columns(model))(
        information_of(base_regressor(model))
    )
    ranked = ranked_causes(model, estimate, runs)
    found = _by_derivatives(model.robot, ranked, estimated_offsets(model, runs))
    if found.severity or not ranked.of_geometry:
        return found
    turned = turned_zeros(model, estimate.sigma, runs)
    if turned is None:
        return found
    figure = residuals(ranked.beside)
    return Finding(
        JointZeros.name,
        "",
        Severity.DOUBTFUL,
        turned.says,
        figure,
        joints=turned.joints,
        fix=turned.fix,
    )


def _by_derivatives(robot: Robot, ranked: Ranked, offsets: ZeroOffsets | None) -> Finding:
    """What offsets within reach of derivatives say."""
    if offsets is None:
        says = "not estimated: too few samples"
        return Finding(JointZeros.name, "", Severity.OK, says, "", answered=False)
    far, known = far_offsets(offsets), np.isfinite(offsets.std)
    if not known.any():
        says = "not identifiable from these data: the zero offset of every joint"
        return Finding(JointZeros.name, "", Severity.OK, says, "", answered=False)
    if not far.any():
        says = f"no significant zero offset{_of(offsets)}{_hidden(offsets)}"
        answered = bool(np.all(known | without_effect(robot)))
        says += "" if answered else "; a model from runs known to be correct (--model) tests more"
        return Finding(
            JointZeros.name, "", Severity.OK, says, _value_text(offsets), answered=answered
        )
    if not ranked.blamed or ranked.blamed[0].kind != "zero_offset":
        says = (
            f"{numbers(offsets, far)} is undecided: other model errors explain as much; compare "
            f"the zeros with the robot{_hidden(offsets)}"
        )
        return Finding(JointZeros.name, "", Severity.OK, says, _value_text(offsets), answered=False)
    return Finding(
        JointZeros.name,
        "",
        Severity.DOUBTFUL,
        f"{numbers(offsets, far)} explains the residuals of a fit best",
        f"{100.0 * ranked.blamed[0].chi2 / ranked.total:.2g} % of chi², {residuals(ranked.beside)}",
        joints=tuple(j for j, wrong in zip(offsets.joints, far, strict=True) if wrong),
        fix=correction(offsets, far),
    )


def _value_text(offsets: ZeroOffsets) -> str:
    """All offsets with their intervals, and those that these data do not identify."""
    return f"{numbers(offsets, np.isfinite(offsets.std))}{_hidden(offsets)}"


def _of(offsets: ZeroOffsets) -> str:
    """Of which joints this holds, if not of all."""
    known = np.isfinite(offsets.std)
    identified = [joint for joint, sure in zip(offsets.joints, known, strict=True) if sure]
    return "" if known.all() else f" of {', '.join(identified)}"


def _hidden(offsets: ZeroOffsets) -> str:
    """Joints whose offsets these data do not identify; empty if there are none."""
    known = np.isfinite(offsets.std)
    left = [joint for joint, sure in zip(offsets.joints, known, strict=True) if not sure]
    return f"; not identifiable: {', '.join(left)}" if left else ""
