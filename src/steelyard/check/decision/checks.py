"""The checks whose question a hypothesis about the robot file answers, as one table."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from steelyard.check.case import Case
from steelyard.check.decision.decidable import least_mass, zero_bounds
from steelyard.check.decision.findings import agreement_sentence, findings
from steelyard.check.decision.gain_sources import gains_left, gains_of_controller
from steelyard.check.decision.joint_zeros import quarter_turns
from steelyard.check.decision.ranking import known_of
from steelyard.check.decision.verdict import LogVerdict, judge_log, last_winner
from steelyard.check.finding import Finding, Fix, Severity
from steelyard.check.hypotheses.friction_evidence import friction_signs, residual_delay
from steelyard.check.hypotheses.likelihood import Hypothesis
from steelyard.check.hypotheses.position_columns import ZERO_CAUSE

Findings = tuple[Finding, ...]


@dataclass(frozen=True)
class HypothesisCheck:
    """A check by the hypotheses that have its name as their cause.

    Attributes:
        name: As users see it, and the cause of its hypotheses.
        question: The question in a few words.
        fine: What holds where nothing is wrong, or the whole sentence for a verdict.
        advice: What to do about a hypothesis that explains a log better.
        completed: The findings with those that this check makes by other means.
        quick: Whether `identify` runs it before the fit.
    """

    name: str
    question: str
    fine: str | Callable[[LogVerdict], str]
    advice: str
    completed: Callable[[Case, str, Findings], Findings] | None = None
    quick: bool = True

    def __call__(self, case: Case) -> Findings:
        """One finding per log that moves; one for all if nothing is known of the robot."""
        found = findings(case, self.name, self._fine, self.advice)
        return found if self.completed is None else self.completed(case, self.name, found)

    def _fine(self, decision: LogVerdict) -> str:
        return (
            agreement_sentence(decision, self.fine)
            if isinstance(self.fine, str)
            else self.fine(decision)
        )


def _signs_of_friction(case: Case, name: str, found: Findings) -> Findings:
    """Without masses, what friction determines."""
    return (friction_signs(case, name) if known_of(case) is None else ()) or found


def _gains_not_found(case: Case, name: str, found: Findings) -> Findings:
    """Where neither unit nor gain is wrong, what the controller and the logs say of gains."""
    judged = [(evidence.name, judge_log(case, evidence)) for evidence in case.logs]
    winners = [
        (log, decision, hypothesis)
        for log, decision in judged
        if decision is not None
        for hypothesis, _ in decision.winners
    ]
    if any(hypothesis.cause == EFFORT_UNIT.name for _, _, hypothesis in winners):
        return found
    controller = gains_of_controller(case, name)
    if controller and not any(f.severity for f in controller):
        mine = [winner for winner in winners if winner[2].cause == name]
        factors = [(log, _common_factor(decision, won)) for log, decision, won in mine]
        other = tuple(_other_links(name, log, x) for log, x in factors if x is not None)
        if other:
            return other
    if any(f.severity for f in found):
        return found
    if any(f.severity for f in controller):
        return controller
    return gains_left(case, name) or controller or found


def _common_factor(decision: LogVerdict, hypothesis: Hypothesis) -> float | None:
    """Efforts as declared over those of a hypothesis; `None` if it differs from joint to joint."""
    declared = decision.ranking.declared.interpretation.effort_scale
    factors = declared / hypothesis.interpretation.effort_scale
    return float(factors[0]) if np.allclose(factors, factors[0]) else None


def _other_links(name: str, log: str, factor: float) -> Finding:
    """Efforts that are not those of the model file's links, though the gains are confirmed."""
    return Finding(
        name,
        log,
        Severity.DOUBTFUL,
        f"the controller's targets confirm the gains, but efforts are {factor:.2g} times those of "
        "the links in the model file: it is of another robot, or the arm carries a payload",
        f"efforts over those of the model file: {factor:.3g}",
        fix=Fix(
            "compare the masses of the model file with the robot; if they are right, weigh the "
            "payload (steelyard payload)"
        ),
    )


def _short_delays(case: Case, name: str, found: Findings) -> Findings:
    """A delay in the residuals of a fit, unless one is known or another cause comes first."""
    judged = [judge_log(case, evidence) for evidence in case.logs]
    winners = [winner for decision in judged if decision is not None for winner in decision.winners]
    if any(hypothesis.cause == name or how is Severity.WRONG for hypothesis, how in winners):
        return found
    late = residual_delay(case, name)
    return found if late is None else (late, *(f for f in found if f.log))


def _of_reference(case: Case, name: str, found: Findings) -> Findings:
    """Zeros of an open chain that are not to be identified; quarter turns without a reference."""
    known = known_of(case)
    if known is None or not known.identified or known.robot.passive:
        return tuple(quarter_turns(case))
    open_ = [e.name for e in case.logs if any(e.recording.signals.unknown_offsets)]
    return tuple(finding for finding in found if finding.log not in open_)


def _fine_gains(decision: LogVerdict) -> str:
    if any(decision.ranking.likelihood.signals.unknown_gains):
        return "gains are identified, so they are not compared with the model file"
    return agreement_sentence(decision, "gains and gear ratios are right")


def _no_load(decision: LogVerdict) -> str:
    likelihood = decision.ranking.likelihood
    if likelihood.knowledge.identified:
        return agreement_sentence(decision, "the arm carries no payload")
    mass = least_mass(likelihood)
    return agreement_sentence(
        decision, f"no payload of {mass:.2g} kg or more, if the model file's masses are right"
    )


def _same_zeros(decision: LogVerdict) -> str:
    likelihood, same = decision.ranking.likelihood, "joint zeros are those of the reference"
    if likelihood.knowledge.identified:
        same += f", {zero_bounds(likelihood, last_winner(decision).interpretation)}"
    return agreement_sentence(decision, same)


JOINT_ORDER = HypothesisCheck(
    "joint order",
    "Does every column belong to its joint?",
    "every column belongs to its joint",
    "put the columns in the order of the joints",
)
POSITION_SIGN = HypothesisCheck(
    "position sign",
    "Do positions have the right sign?",
    "positions have the right sign",
    "state which position columns have the opposite sign",
)
EFFORT_SIGN = HypothesisCheck(
    "effort sign",
    "Do efforts have the right sign?",
    "efforts have the right sign",
    "change the sign of the gain",
    _signs_of_friction,
)
EFFORT_UNIT = HypothesisCheck(
    "effort unit",
    "Are efforts in the unit declared?",
    "efforts are in the unit declared",
    "declare the unit in which efforts are logged",
)
EFFORT_KIND = HypothesisCheck(
    "effort kind",
    "Are efforts of the declared kind?",
    "efforts are of the kind declared",
    "declare what the columns hold",
)
GAIN = HypothesisCheck(
    "gain",
    "Are gains and gear ratios right?",
    _fine_gains,
    "use this gain, or correct the gear ratio",
    _gains_not_found,
)
EFFORT_DELAY = HypothesisCheck(
    "effort delay",
    "Do all efforts have a common delay?",
    "efforts have no common delay",
    "compensate the delay",
    _short_delays,
)
JOINT_ZEROS = HypothesisCheck(
    ZERO_CAUSE,
    "Are the joint zeros those of the reference?",
    _same_zeros,
    "set it as position_offset, if the robot's zeros confirm it",
    _of_reference,
)
MOUNTING = HypothesisCheck(
    "mounting",
    "Is the direction of gravity that of the robot file?",
    "gravity has the direction of the robot file",
    "state the direction of gravity in the base frame as the log fits it best",
)
PAYLOAD = HypothesisCheck(
    "payload",
    "Does the arm carry no payload?",
    _no_load,
    "identify without this log, give it as --loaded, or identify the payload with steelyard "
    "payload",
)
