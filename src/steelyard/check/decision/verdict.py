"""What a ranking says: which explanations are beyond doubt, and the findings that report them."""

from dataclasses import dataclass, replace

import numpy as np

from steelyard.check.case import Case, Evidence, Knowledge
from steelyard.check.decision.ranking import (
    CAUSES_OF_OTHER_CHECKS,
    Ranking,
    disagrees,
    has_bad_joint,
    ranking,
)
from steelyard.check.decision.support import LATE_MARGIN, supported
from steelyard.check.finding import Severity
from steelyard.check.hypotheses.bodies import mirrors, of_link
from steelyard.check.hypotheses.effort_columns import OWN_GAIN_COST
from steelyard.check.hypotheses.friction_evidence import presliding_score
from steelyard.check.hypotheses.likelihood import CLOSE_HYPOTHESES, Hypothesis, Reading
from steelyard.check.hypotheses.surroundings import delay_hypotheses
from steelyard.check.signals.overview import cached_per_log

VERDICT_MARGIN = {True: 20.0, False: 60.0}
"""Log-likelihood by which an explanation must beat the declared reading, with and without a
reference."""
VERDICT_FALL = {True: 2.0, False: 2.5}
"""Factor by which some joint's misfit must fall with a reference; without, the typical one."""
ROUGH_MISFIT = 25.0  # typical misfit [%] that an explanation by a nominal model may leave
OF_JOINTS = ("effort sign", "position sign")
"""Causes that show in the joints they are about, however well the others agree."""
HUGE_GAIN = 20.0  # factor on one joint's effort beyond which a rough model is no excuse either
STRIKING, CLEAN = 200.0, 12.0
"""Log-likelihood gained, and misfit left [%], of an explanation by a nominal model that counts
although the declared reading is not bad in itself."""
LEAST_MASS, LEAST_SHARE, SURE_MASS = 0.3, 0.02, 6.0
"""Least payload [kg], relative to the arm's mass, and over its standard deviation."""
LEAST_DELAY = {True: 0.004, False: 0.04}  # least delay [s], with and without a reference
DELAY_ROWS = 1.5  # the same in rows of the log


@dataclass(frozen=True, eq=False)
class LogVerdict(Ranking):
    """What holds of one log, with all explanations."""

    # what is wrong, in the order in which it was found, with how sure that is; ok where the model
    # file alone is wrong, which leaves a question open
    winners: tuple[tuple[Hypothesis, Severity], ...]
    explained: bool  # whether the last winner agrees with what is known

    @property
    def last(self) -> Hypothesis:
        """The last winner, or the declared reading."""
        return self.winners[-1][0] if self.winners else self.declared

    @property
    def written(self) -> tuple[Hypothesis, ...]:
        """Those of the winners that the robot file may be changed to say."""
        return tuple(hypothesis for hypothesis, _ in self.winners if hypothesis.fixed)

    @property
    def of_other_check(self) -> bool:
        """Whether another check's cause is the first to be corrected."""
        return any(hypothesis.cause in CAUSES_OF_OTHER_CHECKS for hypothesis, _ in self.winners)


@cached_per_log
def judge_log(case: Case, evidence: Evidence) -> LogVerdict | None:
    """What holds of a log; `None` if it cannot be tried."""
    found = ranking(case, evidence)
    if found is None:
        return None
    winners: list[tuple[Hypothesis, Severity]] = []
    before = found.declared
    for hypotheses, winner in zip(found.rounds, found.chain, strict=False):
        severity = _judged(before, winner, hypotheses)
        if severity is Severity.OK:
            link = _link(before, winner, hypotheses)
            if link is None:
                break
            winner = link
        winners.append((winner, severity))
        before = winner
    if all(w.cause != "effort delay" for w, _ in winners):
        late = _delay(found, len(winners), before)
        if late is not None and _late(before, late):
            winners.append((late, Severity.WRONG))
    explained = not has_bad_joint(before)
    verdict = LogVerdict(found.declared, found.rounds, tuple(winners), explained)
    if found.likelihood.knowledge.identified or verdict.of_other_check:
        return verdict
    kept = supported(found.likelihood, winners)
    explained = not has_bad_joint(kept[-1][0]) if kept else explained
    return replace(verdict, winners=kept, explained=explained)


def positions_at_fault(case: Case, evidence: Evidence) -> bool:
    """Whether it is sure that positions, not velocities, have another order or sign."""
    decision = judge_log(case, evidence)
    return decision is not None and any(
        hypothesis.cause in ("joint order", "position sign")
        and severity is Severity.WRONG
        and _moves_positions(decision.declared.reading, hypothesis.reading)
        for hypothesis, severity in decision.winners
    )


def _moves_positions(before: Reading, after: Reading) -> bool:
    turned = np.sign(before.position_scale) != np.sign(after.position_scale)
    return before.position != after.position or bool(np.any(turned))


def _delay(found: Ranking, judged: int, before: Hypothesis) -> Hypothesis | None:
    """The delay beside what was found so far."""
    if judged < len(found.rounds):
        return next((r for r in found.rounds[judged] if r.cause == "effort delay"), None)
    return next(delay_hypotheses(before.reading), None)


def _judged(before: Hypothesis, winner: Hypothesis, hypotheses: tuple[Hypothesis, ...]) -> Severity:
    """How sure a winner is."""
    sure = winner.reading.knowledge.identified
    gain = winner.log_likelihood - before.log_likelihood
    if gain < VERDICT_MARGIN[sure]:
        return Severity.OK
    if winner.cause == "payload":
        rough = not sure and not has_bad_joint(before)
        return Severity.OK if rough or not _heavy(winner) else _when(sure)
    if winner.cause == "effort delay":
        return Severity.WRONG if _late(before, winner) else Severity.OK
    if sure:
        fall = float(np.max(before.misfits / np.maximum(winner.misfits, 1e-3)))
    elif not has_bad_joint(before) and not _striking(winner, gain):
        return Severity.OK
    else:
        fall = before.percent / max(winner.percent, 1e-3)
        if winner.cause in OF_JOINTS or _huge(before, winner):
            fall = max(fall, _fall_of_joints(before, winner))
        if winner.percent > ROUGH_MISFIT:
            return Severity.OK
    if fall < VERDICT_FALL[sure]:
        return Severity.OK
    least = winner.log_likelihood - CLOSE_HYPOTHESES
    return _when(
        not any(
            (r.cause != winner.cause or r.joints != winner.joints)
            and not mirrors(before.reading, winner, r)
            for r in hypotheses[1:]
            if r.log_likelihood > least
        )
    )


def _link(
    before: Hypothesis, winner: Hypothesis, hypotheses: tuple[Hypothesis, ...]
) -> Hypothesis | None:
    """That the last link differs from a model file: it explains the log, and nothing is wrong.

    `None` where it does not, or where another explanation does as well.
    """
    link = next((hypothesis for hypothesis in hypotheses if of_link(hypothesis)), None)
    if link is None or winner.cause != link.cause:
        return None
    near = link.log_likelihood - CLOSE_HYPOTHESES
    if any(r.cause != link.cause and r.log_likelihood > near for r in hypotheses):
        return None
    gain = link.log_likelihood - before.log_likelihood
    falls = before.percent >= VERDICT_FALL[False] * link.percent
    return link if gain >= VERDICT_MARGIN[False] and falls else None


def _striking(winner: Hypothesis, gain: float) -> bool:
    """Whether a few numbers explain very much, and leave next to nothing."""
    return gain >= STRIKING and winner.percent <= CLEAN and winner.cost <= OWN_GAIN_COST


def _huge(before: Hypothesis, winner: Hypothesis) -> bool:
    """Whether the gain of a joint is off by orders of magnitude."""
    factor = np.abs(winner.reading.effort_scale / before.reading.effort_scale)
    far = np.max(np.abs(np.log(factor)))
    return winner.cause == "gain" and bool(far > np.log(HUGE_GAIN))


def _fall_of_joints(before: Hypothesis, winner: Hypothesis) -> float:
    """Factor by which the misfit of the joints that an explanation is about falls."""
    joints = list(winner.joints)
    worst = float(np.max(winner.misfits[joints], initial=0.0))
    if not joints or worst > 0.01 * ROUGH_MISFIT:
        return 1.0
    return float(np.min(before.misfits[joints])) / max(worst, 1e-3)


def _when(sure: bool) -> Severity:
    return Severity.WRONG if sure else Severity.DOUBTFUL


def least_mass(knowledge: Knowledge) -> float:
    """Payload from which on one matters [kg]."""
    arm = sum(body.inertia.mass for body in knowledge.robot.bodies)
    return max(LEAST_MASS, LEAST_SHARE * arm)


def _heavy(hypothesis: Hypothesis) -> bool:
    """Whether a payload is heavy enough to be one."""
    ten = hypothesis.reading.payload
    if ten is None:
        return False
    return float(ten[0]) > max(
        least_mass(hypothesis.reading.knowledge), SURE_MASS * hypothesis.spread
    )


def _late(before: Hypothesis, hypothesis: Hypothesis) -> bool:
    """Whether a delay is long enough, and certain enough, to matter.

    Of a nominal model, friction that gives way must not explain as much.
    """
    reading = hypothesis.reading
    sure, x = reading.knowledge.identified, reading.likelihood.excerpt
    least = max(LEAST_DELAY[sure], DELAY_ROWS / x.log_rate)
    if not sure and hypothesis.log_likelihood - before.log_likelihood < LATE_MARGIN:
        return False
    if abs(reading.delay - before.reading.delay) < least or disagrees(hypothesis):
        return False
    others = [before.score] if sure else [before.score, presliding_score(before.reading)]
    return all(hypothesis.score.sharp - other.sharp > LATE_MARGIN for other in others)
