"""What a ranking says: which explanations are beyond doubt, and the findings that tell them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from steelyard.diagnosis.case import Case, Evidence
from steelyard.diagnosis.finding import Judgement
from steelyard.diagnosis.hypotheses.mirrored import mirrors
from steelyard.diagnosis.hypotheses.ranking import ALIEN, Ranking, bad, disagrees, ranking
from steelyard.diagnosis.hypotheses.rival import Rival
from steelyard.diagnosis.hypotheses.rivals_effort import OWN
from steelyard.diagnosis.hypotheses.rivals_friction import giving_way
from steelyard.diagnosis.hypotheses.rivals_link import of_link
from steelyard.diagnosis.hypotheses.rivals_world import SHARP, delay_rivals
from steelyard.diagnosis.hypotheses.support import supported
from steelyard.diagnosis.signal_overview import once

MARGIN = {True: 20.0, False: 60.0}
"""Log-likelihood by which an explanation must beat the declared reading, with and without a
reference."""
FALL = {True: 2.0, False: 2.5}
"""Factor by which some joint's misfit must fall with a reference; without, the typical one."""
CLOSE = 3.0
"""Log-likelihood within which two explanations cannot be told apart."""
ROUGH = 25.0
"""Typical misfit [%] that an explanation by a nominal model may leave."""
OF_JOINTS = ("effort sign", "position sign")
"""Causes that show in the joints they are about, however well the others agree."""
HUGE = 20.0
"""Factor on one joint's effort beyond which a rough model is no excuse either."""
STRIKING, CLEAN = 200.0, 12.0
"""Log-likelihood gained, and misfit left [%], of an explanation by a nominal model that counts
although the declared reading is not bad in itself."""
LEAST_MASS, LEAST_SHARE, SURE_MASS = 0.3, 0.02, 6.0
"""Least payload [kg], relative to the arm's mass, and over its standard deviation."""
LEAST_DELAY = {True: 0.004, False: 0.04}
"""Least delay [s], with and without a reference."""
DELAY_ROWS, DELAY_MARGIN = 1.5, 12.0


@dataclass(frozen=True, eq=False)
class Verdict:
    """What holds of one log.

    Attributes:
        ranking: All explanations.
        winners: What is wrong, in the order in which it was found, with how sure that is; ok
            where the model file alone is wrong, which leaves a question open.
        explained: Whether the last winner agrees with what is known.
    """

    ranking: Ranking
    winners: tuple[tuple[Rival, Judgement], ...]
    explained: bool

    @property
    def written(self) -> tuple[Rival, ...]:
        """Those of the winners that the robot file may be changed to say."""
        return tuple(rival for rival, _ in self.winners if rival.fixed)

    @property
    def alien(self) -> bool:
        """Whether another suspicion's cause is the first to be mended."""
        return alien(self.winners)


@once
def verdict(case: Case, evidence: Evidence) -> Verdict | None:
    """What holds of a log; `None` if it cannot be tried."""
    found = ranking(case, evidence)
    if found is None:
        return None
    winners: list[tuple[Rival, Judgement]] = []
    before = found.declared
    for rivals, winner in zip(found.rounds, found.chain, strict=False):
        judgement = _judged(found, before, winner, rivals)
        if judgement is Judgement.OK:
            link = _link(before, winner, rivals)
            if link is None:
                break
            winner = link
        winners.append((winner, judgement))
        before = winner
    if all(w.cause != "effort delay" for w, _ in winners):
        late = _delay(found, len(winners), before)
        if late is not None and _late(found, before, late):
            winners.append((late, Judgement.WRONG))
    if found.trial.knowledge.identified or alien(winners):
        return Verdict(found, tuple(winners), not bad(found.trial, before))
    held = supported(found.trial, winners)
    return Verdict(found, held, not bad(found.trial, held[-1][0] if held else before))


def last_of(held: Verdict) -> Rival:
    """The last winner, or the declared reading."""
    return held.winners[-1][0] if held.winners else held.ranking.declared


def alien(winners: Sequence[tuple[Rival, Judgement]]) -> bool:
    """Whether another suspicion's cause is the first to be mended."""
    return any(rival.cause in ALIEN for rival, _ in winners)


def positions_at_fault(case: Case, evidence: Evidence) -> bool:
    """Whether it is sure that positions, not velocities, have another order or sign."""
    held = verdict(case, evidence)
    return held is not None and any(
        rival.cause in ("joint order", "position sign")
        and judgement is Judgement.WRONG
        and _moves_positions(held.ranking, rival)
        for rival, judgement in held.winners
    )


def _moves_positions(found: Ranking, rival: Rival) -> bool:
    before, after = found.trial.declared, rival.reading
    turned = np.sign(before.position_scale) != np.sign(after.position_scale)
    return before.position != after.position or bool(np.any(turned))


def _delay(found: Ranking, judged: int, before: Rival) -> Rival | None:
    """The delay beside what was found so far."""
    if judged < len(found.rounds):
        return next((r for r in found.rounds[judged] if r.cause == "effort delay"), None)
    return next(delay_rivals(found.trial, before.reading), None)


def _judged(found: Ranking, before: Rival, winner: Rival, rivals: tuple[Rival, ...]) -> Judgement:
    """How sure a winner is."""
    trial, sure = found.trial, found.trial.knowledge.identified
    gain = winner.log_likelihood - before.log_likelihood
    if gain < MARGIN[sure]:
        return Judgement.OK
    if winner.cause == "payload":
        heavy = _heavy(found, winner)
        rough = not sure and not bad(trial, before)
        return Judgement.OK if rough or not heavy else _when(sure)
    if winner.cause == "effort delay":
        return Judgement.WRONG if _late(found, before, winner) else Judgement.OK
    if sure:
        fall = float(np.max(before.misfits / np.maximum(winner.misfits, 1e-3)))
    elif not bad(trial, before) and not _striking(winner, gain):
        return Judgement.OK
    else:
        fall = before.percent / max(winner.percent, 1e-3)
        if winner.cause in OF_JOINTS or _huge(before, winner):
            fall = max(fall, _fall_of_joints(before, winner))
        if winner.percent > ROUGH:
            return Judgement.OK
    if fall < FALL[sure]:
        return Judgement.OK
    near = [r for r in rivals[1:] if r.log_likelihood > winner.log_likelihood - CLOSE]
    apart = [
        r
        for r in near
        if (r.cause != winner.cause or r.joints != winner.joints)
        and not mirrors(before.reading, winner, r)
    ]
    return _when(not apart)


def _link(before: Rival, winner: Rival, rivals: tuple[Rival, ...]) -> Rival | None:
    """That the last link differs from a model file: it explains the log, and nothing is wrong.

    `None` where it does not, or where another explanation does as well.
    """
    link = next((rival for rival in rivals if of_link(rival)), None)
    if link is None or winner.cause != link.cause:
        return None
    near = link.log_likelihood - CLOSE
    if any(r.cause != link.cause and r.log_likelihood > near for r in rivals):
        return None
    gain = link.log_likelihood - before.log_likelihood
    falls = before.percent >= FALL[False] * link.percent
    return link if gain >= MARGIN[False] and falls else None


def _striking(winner: Rival, gain: float) -> bool:
    """Whether a few numbers explain very much, and leave next to nothing."""
    return gain >= STRIKING and winner.percent <= CLEAN and winner.cost <= OWN


def _huge(before: Rival, winner: Rival) -> bool:
    """Whether the gain of a joint is off by orders of magnitude."""
    factor = np.abs(winner.reading.effort_scale / before.reading.effort_scale)
    far = np.max(np.abs(np.log(factor)))
    return winner.cause == "gain" and bool(far > np.log(HUGE))


def _fall_of_joints(before: Rival, winner: Rival) -> float:
    """Factor by which the misfit of the joints that an explanation is about falls."""
    joints = list(winner.joints)
    worst = float(np.max(winner.misfits[joints], initial=0.0))
    if not joints or worst > 0.01 * ROUGH:
        return 1.0
    return float(np.min(before.misfits[joints])) / max(worst, 1e-3)


def _when(sure: bool) -> Judgement:
    return Judgement.WRONG if sure else Judgement.DOUBTFUL


def _heavy(found: Ranking, rival: Rival) -> bool:
    """Whether a payload is heavy enough to be one."""
    mass, std = payload_mass(rival)
    arm = sum(body.inertia.mass for body in found.trial.knowledge.robot.bodies)
    return mass > max(LEAST_MASS, LEAST_SHARE * arm, SURE_MASS * std)


def payload_mass(rival: Rival) -> tuple[float, float]:
    """Mass and its standard deviation [kg]."""
    ten = rival.reading.payload
    return (0.0, 0.0) if ten is None else (float(ten[0]), rival.spread)


def _late(found: Ranking, before: Rival, rival: Rival) -> bool:
    """Whether a delay is long enough, and certain enough, to matter.

    Of a nominal model, friction that gives way must not explain as much.
    """
    sure, x = found.trial.knowledge.identified, found.trial.excerpt
    delay = abs(rival.reading.delay - before.reading.delay)
    least = max(LEAST_DELAY[sure], DELAY_ROWS / x.log_rate)
    if not sure and rival.log_likelihood - before.log_likelihood < DELAY_MARGIN:
        return False
    if delay < least or disagrees(found.trial, rival):
        return False
    others = [before.score]
    if not sure:
        others.append(giving_way(found.trial, before.reading))
    late = float(rival.score.likelihood(SHARP, np.inf))
    return all(late - float(x.likelihood(SHARP, np.inf)) > DELAY_MARGIN for x in others)
