"""Whether a joint that carries load is predicted worse than by the nominal model.

A nominal model knows no friction of the day, so a fit that lacks nothing is better everywhere.
Where it is worse at a joint that carries load, the fit gave that joint's torque to something else.
"""

from typing import ClassVar

from steelyard.diagnosis.finding import Finding, Fix, Severity
from steelyard.diagnosis.fitted.fitted_case import FittedCase
from steelyard.diagnosis.fitted.rotors_at_zero import rotors_at_zero
from steelyard.diagnosis.gear_side import INSTEAD, SEPARABLE
from steelyard.validation.score import JointScore, RunScore

WORSE = 1.2
"""RMSE over the nominal model's from which on a joint is named."""

LOADED = 0.25
"""Effort of a joint over the largest of its unit, root mean square, from which on it has load."""


class BelowNominal:
    """Joints with load that the nominal model predicts better."""

    name: ClassVar[str] = "nominal model"

    def __call__(self, case: FittedCase) -> tuple[Finding, ...]:
        """One finding per run, of unseen runs where there are any."""
        fix = _advice(case)
        return tuple(
            _finding(score, worse, fix)
            for score in case.unseen_scores or case.fitted_scores
            if (worse := _worse(score))
        )


def _worse(score: RunScore) -> tuple[JointScore, ...]:
    """Joints with load whose RMSE is above that of the nominal model."""
    most: dict[str, float] = {}
    for joint in score.joints:
        most[joint.unit] = max(most.get(joint.unit, 0.0), joint.predict_zero)
    return tuple(
        joint
        for joint in score.joints
        if joint.prior_rmse is not None
        and joint.predict_zero >= LOADED * most[joint.unit]
        and joint.rmse > WORSE * joint.prior_rmse
    )


def _advice(case: FittedCase) -> Fix:
    """What to try first."""
    identified = case.identified
    zero, every = rotors_at_zero(identified.estimate, identified.signals.effort_kind)
    if zero:
        return Fix(
            f"{len(zero)} of {every} {SEPARABLE} are zero: torques may be those of sensors "
            f"on the link side; try {INSTEAD} first"
        )
    return Fix("Review the terms, and the check of this joint's effort")


def _finding(score: RunScore, worse: tuple[JointScore, ...], fix: Fix) -> Finding:
    words = ", ".join(
        f"{joint.joint} (RMSE {joint.rmse:.2g} {joint.unit}, nominal model {joint.prior_rmse:.2g})"
        for joint in worse
    )
    return Finding(
        BelowNominal.name,
        score.run,
        Severity.DOUBTFUL,
        f"larger prediction error than the nominal model of the robot file: {words}",
        "",
        tuple(joint.joint for joint in worse),
        fix,
        brief=f"worse than the nominal model: {words}. {fix.says}",
    )
