"""Whether a joint that carries load is predicted worse than by the nominal model.

A nominal model knows no friction of the day, so a fit that lacks nothing is better everywhere.
Where it is worse at a joint that carries load, the fit gave that joint's torque to something else.
"""

from typing import ClassVar

from steelyard.diagnosis.finding import Finding, Fix, Severity
from steelyard.diagnosis.fitted.fitted_case import FittedCase
from steelyard.terms.laws.rotor_inertia import RotorInertia
from steelyard.terms.register import law_of
from steelyard.validation.score import JointScore, RunScore

WORSE = 1.2
"""RMSE over the nominal model's from which on a joint is named."""

LOADED = 0.25
"""Effort of a joint over the largest of its unit, root mean square, from which on it has load."""

FEW = 0.5
"""Share of rotor inertias that a bound holds, from which on the side of the gears is doubtful."""


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
    names = [n for n in identified.estimate.parameters.names if law_of(n) is RotorInertia]
    at_bound = [name for name in identified.estimate.at_bound if name in names]
    at_joints = identified.signals.effort_kind == "joint_torque"
    if at_joints and names and len(at_bound) >= FEW * len(names):
        return Fix(
            f"{len(at_bound)} of {len(names)} rotor inertias are zero: torques may be from sensors "
            'on the link side; try kind = "link_torque" without rotor_inertia first'
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
    )
