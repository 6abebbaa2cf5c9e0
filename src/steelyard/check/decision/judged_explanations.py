"""What holds of a log: which explanations are beyond doubt, and how sure that is.

With a reference an explanation must agree clearly better than what is declared. Where nothing but a
nominal model is known, that links are heavier or lighter than a model file says is always a
hypothesis as well. So an explanation is then beyond doubt only if physically consistent bodies,
whatever they weigh, fit the log clearly better under it than as declared. That happens for orders,
signs and directions; never for a factor on all efforts, as bodies of as many times the mass have
the same effect.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from steelyard.check.case_and_evidence import Case, Evidence, Knowledge
from steelyard.check.decision.drive_gain_sources import LARGEST_GEAR_RATIO, LEAST_GEAR_RATIO
from steelyard.check.decision.ranked_readings import (
    Judged,
    LogVerdict,
    disagrees,
    has_bad_joint,
    ranking,
)
from steelyard.check.finding import Severity
from steelyard.check.hypotheses.consistent_bodies_of_log import (
    ConsistentBodies,
    consistent_bodies,
    link_hypotheses,
    mirrors,
    of_link,
    with_mirror,
)
from steelyard.check.hypotheses.effort_hypotheses import (
    OWN_GAIN_COST,
    combined_hypotheses,
    factor_intervals,
    holds_factors,
    unit_hypotheses,
)
from steelyard.check.hypotheses.friction_signs_and_delay import friction_alone, presliding_score
from steelyard.check.hypotheses.gravity_payload_and_delay import (
    axis_near,
    delay_hypotheses,
    mounting_hypotheses,
)
from steelyard.check.hypotheses.nuisance_fit_and_score import MISFIT_FLOOR
from steelyard.check.hypotheses.readings_and_likelihood import (
    CLOSE_HYPOTHESES,
    FITTED_NUMBER_COST,
    Hypothesis,
    Likelihood,
    Reading,
)
from steelyard.check.signals.good_rows_and_derivatives import remembered

SUPPORT_MARGIN, SUPPORT_FALL = 60.0, 2.0
"""Log-likelihood that bodies of the log's own must gain, and the factor by which the misfit of some
joint must fall, for the data to contradict what is declared."""
VERDICT_MARGIN = {True: 20.0, False: SUPPORT_MARGIN}  # to gain, with a reference and without
VERDICT_FALL = {True: 2.0, False: 2.5}  # fall of some joint's misfit, without of the typical one
ROUGH_MISFIT = 25.0  # misfit [%] that a nominal model, or the log's own bodies, may leave
POOR_BODIES_MISFIT = 10.0  # misfit of own bodies [%] from which on orders and signs are tried
FAIR_BODIES_MISFIT = 5.0  # the same from which on other directions of gravity are tried
OF_JOINTS = ("effort sign", "position sign")  # causes that show in their joints alone
HUGE_GAIN = 20.0  # factor on one joint's effort beyond which a rough model is no excuse either
HEAVIEST_FACTOR = 6.0  # on all efforts, before the links of a nominal model are no excuse
STRIKING, CLEAN = 200.0, 12.0
"""Log-likelihood gained, and misfit left [%], of an explanation by a nominal model that counts
although the declared reading is not bad in itself."""
LEAST_MASS, LEAST_SHARE, SURE_MASS = 0.3, 0.02, 6.0
"""Least payload [kg], relative to the arm's mass, and over its standard deviation."""
LEAST_DELAY = {True: 0.004, False: 0.04}  # least delay [s], with and without a reference
DELAY_ROWS = 1.5  # the same in rows of the log
LATE_MARGIN = 12.0  # sharper log-likelihood that a delay must gain
LATE_FALL = 1.2
"""The fall that it needs: friction that only the robot file's own terms describe looks like a
little delay, and what bodies of the log's own leave hardly falls with it."""
UNCONCERNED_CHANGE = 0.1  # relative, of a joint's misfit that gravity does not concern


@remembered
def judge_log(case: Case, evidence: Evidence) -> LogVerdict | None:
    """What holds of a log; `None` if it cannot be tried."""
    found = ranking(case, evidence)
    if found is None:
        return None
    winners: list[Judged] = []
    before = found.declared
    chain = dict.fromkeys(hypotheses[0] for hypotheses in found.rounds if hypotheses[0].cause)
    for hypotheses, winner in zip(found.rounds, chain, strict=False):
        severity = _judged(before, winner, hypotheses)
        if severity is Severity.OK:
            link = _link(before, winner, hypotheses)
            if link is None:
                break
            winner = link
        winners.append((winner, severity))
        before = winner
    if all(w.cause != "effort delay" for w, _ in winners):
        judged = len(winners)
        rest = found.rounds[judged] if judged < len(found.rounds) else None
        for late in delay_hypotheses(before.reading) if rest is None else rest:
            if late.cause == "effort delay":
                winners += [(late, Severity.WRONG)] * _late(before, late)
                break
    verdict = replace(found, winners=tuple(winners), explained=not has_bad_joint(before))
    if found.likelihood.knowledge.identified or verdict.of_other_check:
        return verdict
    kept = supported(found.likelihood, winners)
    explained = not has_bad_joint(kept[-1][0]) if kept else verdict.explained
    return replace(verdict, winners=kept, explained=explained)


def positions_at_fault(case: Case, evidence: Evidence) -> bool:
    """Whether it is sure that positions, not velocities, have another order or sign."""
    decision = judge_log(case, evidence)
    if decision is None:
        return False
    before = decision.declared.reading
    return any(
        hypothesis.cause in ("joint order", "position sign")
        and severity is Severity.WRONG
        and (
            before.position != hypothesis.reading.position
            or np.any(np.sign(before.position_scale) != np.sign(hypothesis.reading.position_scale))
        )
        for hypothesis, severity in decision.winners
    )


def _judged(before: Hypothesis, winner: Hypothesis, hypotheses: Sequence[Hypothesis]) -> Severity:
    """How sure a winner is, by what is known of the robot."""
    sure = winner.reading.knowledge.identified
    gain = winner.log_likelihood - before.log_likelihood
    if gain < VERDICT_MARGIN[sure]:
        return Severity.OK
    if winner.cause == "payload":
        knowledge, ten = winner.reading.knowledge, winner.reading.payload
        least = max(least_mass(knowledge), SURE_MASS * winner.spread)
        # less than a model file says is a lighter link
        heavy = ten is not None and (abs(ten[0]) if knowledge.identified else ten[0]) > least
        return _when(sure) if heavy and (sure or has_bad_joint(before)) else Severity.OK
    if winner.cause == "effort delay":
        return Severity.WRONG if _late(before, winner) else Severity.OK
    if sure:
        fall = float(np.max(before.misfits / np.maximum(winner.misfits, 1e-3)))
    else:
        # few numbers that explain very much, and leave next to nothing, count anyway
        striking = gain >= STRIKING and winner.cost <= OWN_GAIN_COST and winner.percent <= CLEAN
        if winner.percent > ROUGH_MISFIT or not (striking or has_bad_joint(before)):
            return Severity.OK
        fall = before.percent / max(winner.percent, 1e-3)
        factor = np.abs(winner.reading.effort_scale / before.reading.effort_scale)
        huge = winner.cause == "gain" and np.max(np.abs(np.log(factor))) > np.log(HUGE_GAIN)
        if winner.cause in OF_JOINTS or huge:
            fall = max(fall, _fall_of_joints(before, winner))
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


def _when(sure: bool) -> Severity:
    return Severity.WRONG if sure else Severity.DOUBTFUL


def _link(
    before: Hypothesis, winner: Hypothesis, hypotheses: Sequence[Hypothesis]
) -> Hypothesis | None:
    """That the last link is not the model file's, where this explains a log as nothing else."""
    link = next((hypothesis for hypothesis in hypotheses if of_link(hypothesis)), None)
    if link is None or winner.cause != link.cause:
        return None
    near = link.log_likelihood - CLOSE_HYPOTHESES
    if any(r.cause != link.cause and r.log_likelihood > near for r in hypotheses):
        return None
    gain = link.log_likelihood - before.log_likelihood
    falls = before.percent >= VERDICT_FALL[False] * link.percent
    return link if gain >= VERDICT_MARGIN[False] and falls else None


def _fall_of_joints(before: Hypothesis, winner: Hypothesis) -> float:
    joints = list(winner.joints)
    worst = float(np.max(winner.misfits[joints], initial=0.0))
    if not joints or worst > 0.01 * ROUGH_MISFIT:
        return 1.0
    return float(np.min(before.misfits[joints])) / max(worst, 1e-3)


def least_mass(knowledge: Knowledge) -> float:
    """Payload from which on one matters [kg]."""
    arm = sum(body.inertia.mass for body in knowledge.robot.bodies)
    return max(LEAST_MASS, LEAST_SHARE * arm)


def _late(before: Hypothesis, hypothesis: Hypothesis) -> bool:
    """Whether a delay matters for certain; by a nominal model, more than friction that yields."""
    reading = hypothesis.reading
    sure, x = reading.knowledge.identified, reading.likelihood.excerpt
    least = max(LEAST_DELAY[sure], DELAY_ROWS / x.log_rate)
    if not sure and hypothesis.log_likelihood - before.log_likelihood < LATE_MARGIN:
        return False
    if abs(reading.delay - before.reading.delay) < least or disagrees(hypothesis):
        return False
    others = [before.score] if sure else [before.score, presliding_score(before.reading)]
    return all(hypothesis.score.sharp - other.sharp > LATE_MARGIN for other in others)


def contradicted(before: Reading, winner: Hypothesis) -> bool:
    """Whether the data, whatever the bodies weigh, speak for an explanation."""
    then, now = consistent_bodies(before), consistent_bodies(winner.reading)
    if then is None or now is None:
        return False
    if winner.cause == "effort delay":
        return now.score.sharp - then.score.sharp > LATE_MARGIN and _fall(now, then) >= LATE_FALL
    return fits_clearly_better(now, then, winner.cost)


def fits_clearly_better(now: ConsistentBodies, then: ConsistentBodies, cost: float) -> bool:
    """Whether one reading fits bodies of the log's own clearly better than another."""
    gain = float(now.score.log_likelihood - then.score.log_likelihood) - cost
    return gain >= SUPPORT_MARGIN and _fall(now, then) >= SUPPORT_FALL


def _fall(now: ConsistentBodies, then: ConsistentBodies) -> float:
    """The factor by which the misfit of that joint falls whose misfit falls most."""
    return float(np.max(then.score.misfits / np.maximum(now.score.misfits, MISFIT_FLOOR)))


def supported(likelihood: Likelihood, winners: Sequence[Judged]) -> tuple[Judged, ...]:
    """What holds of a log, from what a nominal model suggests and what the data support."""
    kept: list[Judged] = []
    reading, rescaled = likelihood.declared, False
    for hypothesis, severity in winners:
        fitted, factor = _fitted(reading, hypothesis), _only_factor(reading, hypothesis)
        unit = _unit(reading) if fitted and factor else None
        if unit is not None and _of_unit(reading, unit):
            kept.append((unit, severity))
            reading = unit.reading
            break
        factors = hypothesis.reading.effort_scale / reading.effort_scale
        shown = hypothesis.cause != "effort unit" or holds_factors(reading, factors)
        if hypothesis.cause == "payload" or (shown and contradicted(reading, hypothesis)):
            if fitted and factor and hypothesis.cause == "effort kind":
                hypothesis = replace(hypothesis, says=_factor_words(reading))
            kept.append((replace(hypothesis, fixed=hypothesis.fixed and not fitted), severity))
        elif factor:
            rescaled = rescaled or fitted or not _of_unit(reading, hypothesis)
            if rescaled:
                break
            kept.append((hypothesis, severity))
        else:
            kept.append((replace(hypothesis, fixed=False), Severity.DOUBTFUL))
            break
        reading = hypothesis.reading
    whole = _combined(reading)
    if whole:
        kept = [*(kept if whole[0][0].cause == "mounting" else ()), *whole]
        reading = whole[-1][0].reading
    kept = [_with_other_sign(*one) for one in _unrivalled(kept)]
    kept = [(with_mirror(r), severity) for r, severity in kept]
    scale = _scale(reading, rescaled)
    return (*kept, scale) if scale is not None else tuple(kept)


def _only_factor(reading: Reading, hypothesis: Hypothesis) -> bool:
    """Whether an explanation does nothing but multiply efforts by positive factors."""
    after = hypothesis.reading
    return (
        (after.of_motion, after.effort, after.delay)
        == (reading.of_motion, reading.effort, reading.delay)
        and np.array_equal(after.gravity, reading.gravity)
        and bool(np.all(after.effort_scale / reading.effort_scale > 0.0))
    )


def _fitted(reading: Reading, hypothesis: Hypothesis) -> bool:
    """Whether an explanation's gains or ratios are those at which a nominal model agrees best."""
    ratios = not np.array_equal(hypothesis.reading.ratios, reading.ratios)
    return hypothesis.cost >= FITTED_NUMBER_COST and (ratios or _only_factor(reading, hypothesis))


def _of_unit(reading: Reading, hypothesis: Hypothesis) -> bool:
    """Whether known factors are those that a log shows, and bring absurd masses to likely ones."""
    if not holds_factors(reading, hypothesis.reading.effort_scale / reading.effort_scale):
        return False
    then, now = consistent_bodies(reading), consistent_bodies(hypothesis.reading)
    return then is not None and now is not None and _far(then) and not _far(now)


def _far(found: ConsistentBodies) -> bool:
    return max(found.scale, 1.0 / found.scale) > HEAVIEST_FACTOR


def _unit(reading: Reading) -> Hypothesis | None:
    """Efforts in another unit, if its factor is within the interval of every joint's."""
    scale = reading.effort_scale
    units = unit_hypotheses(reading)
    return next((r for r in units if holds_factors(reading, r.reading.effort_scale / scale)), None)


def _combined(reading: Reading) -> tuple[Judged, ...]:
    """Order and signs of all columns, or gravity, if the data speak for another than is declared.

    So much is changed at once that the misfit must fall in the typical joint, or be small in all.
    Orders and signs are searched from the declared reading, gravity from the given one.
    """
    likelihood = reading.likelihood
    now, own = consistent_bodies(reading), consistent_bodies(likelihood.declared)
    if now is None or own is None:
        return ()
    fair = now.percent > FAIR_BODIES_MISFIT or _worst_joint_misfit(now) > POOR_BODIES_MISFIT
    found = combined_hypotheses(likelihood) if _poor(now) else []
    found += mounting_hypotheses(reading) if fair else []
    if not found:
        return ()
    found.sort(key=lambda pair: -pair[0].log_likelihood)
    best, bodies = found[0]
    if not fits_clearly_better(bodies, now, best.cost):
        return ()
    unconcerned = best.cause and (
        best.reading.log_likelihood - reading.log_likelihood > SUPPORT_MARGIN
    )
    worst = _worst_joint_misfit(bodies, now if unconcerned else None)
    if bodies.percent > ROUGH_MISFIT or (
        SUPPORT_FALL * bodies.percent > now.percent and worst > POOR_BODIES_MISFIT
    ):
        return ()
    near = [r for r, _ in found[1:] if r.log_likelihood > best.log_likelihood - CLOSE_HYPOTHESES]
    enough = ROUGH_MISFIT
    if best.cause == "mounting":
        # a direction of gravity that lies along no axis may as well be a force from outside
        gravity = best.reading.gravity
        along = axis_near(gravity / np.linalg.norm(gravity)) is not None
        enough = POOR_BODIES_MISFIT if along else FAIR_BODIES_MISFIT
    sure = not near and bodies.percent <= enough
    compared = "free link inertias", (now if best.cause else own).percent
    return tuple((replace(r, fixed=sure, compared=compared), _when(sure)) for r in _parts(best))


def _poor(bodies: ConsistentBodies) -> bool:
    return bodies.percent > POOR_BODIES_MISFIT or _worst_joint_misfit(bodies) > ROUGH_MISFIT


def _worst_joint_misfit(bodies: ConsistentBodies, before: ConsistentBodies | None = None) -> float:
    """Largest misfit of a joint [%]; of those that differ from the one `before`, if given."""
    seen = bodies.score.counts > 0.0
    if before is not None:
        change = np.abs(bodies.score.misfits - before.score.misfits)
        seen &= change > UNCONCERNED_CHANGE * before.score.misfits
    return 100.0 * float(np.max(bodies.score.misfits[seen], initial=0.0))


def _parts(best: Hypothesis) -> Iterator[Hypothesis]:
    """One explanation per cause, all of the same reading."""
    if best.cause:
        yield best
        return
    after, before = best.reading, best.reading.likelihood.declared
    names = after.likelihood.names
    if (after.position, after.effort) != (before.position, before.effort):
        yield replace(best, cause="joint order", says=_order_of(after))
    for what in ("position", "effort"):
        then, now = (np.sign(getattr(reading, f"{what}_scale")) for reading in (before, after))
        joints = tuple(np.flatnonzero(then != now).tolist())
        if joints:
            who = ", ".join(f"'{names[j]}'" for j in joints)
            who = "all joints" if len(joints) == len(names) > 1 else who
            says = f"{what} of {who} has the opposite sign"
            yield replace(best, cause=f"{what} sign", says=says, joints=joints)


def _order_of(reading: Reading) -> str:
    if reading.position == reading.likelihood.declared.position:
        return f"efforts in the order {', '.join(str(k + 1) for k in reading.effort)}"
    names = reading.likelihood.names
    listed = ", ".join(f"'{names[reading.position.index(k)]}'" for k in range(len(names)))
    if reading.effort == reading.position:
        return f"the columns are in the order {listed}"
    return f"the columns of positions are those of {listed}"


def _unrivalled(kept: list[Judged]) -> list[Judged]:
    """Nothing is written where positions in another order do as well as efforts, or the reverse."""
    for number, (hypothesis, _) in enumerate(kept):
        before, after = hypothesis.reading.likelihood.declared, hypothesis.reading
        alone = (after.position == before.position) != (after.effort == before.effort)
        if hypothesis.cause != "joint order" or not hypothesis.fixed or not alone:
            continue
        mirror = _mirror(before, after)
        mine, other = consistent_bodies(after), consistent_bodies(mirror)
        if mine is None or other is None:
            continue
        if float(mine.score.log_likelihood - other.score.log_likelihood) < SUPPORT_MARGIN:
            says = f"{hypothesis.says}, or {_order_of(mirror)}: this log alone cannot decide"
            kept[number] = replace(hypothesis, says=says), Severity.DOUBTFUL
            return [(replace(r, fixed=False), Severity.DOUBTFUL) for r, _ in kept]
    return kept


def _with_other_sign(hypothesis: Hypothesis, severity: Severity) -> Judged:
    """Nothing is written where the sign of a joint's effort does as well as that of its position.

    Or the reverse: signs of several joints are found together, of one kind.
    """
    before, after = hypothesis.reading.likelihood.declared, hypothesis.reading
    if not hypothesis.cause.endswith(" sign") or len(hypothesis.joints) < 2 or not hypothesis.fixed:
        return hypothesis, severity
    positions = hypothesis.cause == "position sign"
    turned = np.sign(before.position_scale) != np.sign(after.position_scale)
    turned ^= np.sign(before.effort_scale) != np.sign(after.effort_scale)
    rivals = {}
    for joint in np.flatnonzero(turned).tolist():
        signs = np.where(np.arange(len(turned)) == joint, -1.0, 1.0)
        other = after.with_turned([joint]).with_factors(signs)
        if other.log_likelihood > after.log_likelihood - CLOSE_HYPOTHESES:
            rivals[joint] = other
    if not rivals or len(rivals) == len(hypothesis.joints) == len(turned):
        return hypothesis, severity  # all joints at once: `with_mirror`
    who = ", ".join(f"'{after.likelihood.names[j]}'" for j in rivals)
    words = ("efforts", "positions") if positions else ("positions", "efforts")
    best = max(rivals.values(), key=lambda rival: rival.log_likelihood)
    says = (
        f"{hypothesis.says}; but with the {words[0]} of {who} turned in place of the {words[1]} "
        f"the misfit is {best.percent:.1f} % at best: compare each with the robot"
    )
    return replace(hypothesis, says=says, fixed=False), Severity.DOUBTFUL


def _mirror(before: Reading, after: Reading) -> Reading:
    """The same pairs of positions and efforts, as an order of the others."""
    n = range(len(after.position))
    if after.effort == before.effort:
        effort = tuple(before.effort[after.position.index(before.position[j])] for j in n)
        return after.changed(position=before.position, effort=effort)
    position = tuple(before.position[after.effort.index(before.effort[j])] for j in n)
    return after.changed(position=position, effort=before.effort)


def bodies_that_explain(reading: Reading) -> ConsistentBodies | None:
    """Bodies of the log's own that explain a log; `None` where they do not, or hardly show."""
    found = consistent_bodies(reading)
    if found is None or _poor(found) or friction_alone_explains(reading, found):
        return None
    return found


def friction_alone_explains(reading: Reading, found: ConsistentBodies) -> bool:
    """Whether friction alone fits a log about as well as with bodies: their size is open then."""
    alone = ConsistentBodies(friction_alone(reading), 0.0)
    return not fits_clearly_better(found, alone, 0.0)


def _scale(reading: Reading, rescaled: bool) -> Judged | None:
    """A factor on all efforts, or bodies lighter or heavier than the nominal ones.

    Beyond `HEAVIEST_FACTOR` something is wrong with the efforts, if the factor makes the nominal
    model agree clearly better; below, only where the nominal model calls for it. There is no
    finding where friction alone fits as well as bodies.
    """
    found = consistent_bodies(reading)
    if found is None or not (rescaled or (_far(found) and found.percent <= ROUGH_MISFIT)):
        return None
    signals, factor, far = reading.likelihood.signals, 1.0 / found.scale, _far(found)
    changed = reading.with_factors(np.full(signals.n, factor))
    if friction_alone_explains(reading, found):
        return None
    if not rescaled and changed.percent * SUPPORT_FALL > reading.percent:
        return None
    unit = _unit(reading) if far else None
    if unit is not None:
        return unit, Severity.WRONG
    off = f"either efforts are off by a factor of about {_short(factor)}, or"
    lighter = "lighter" if factor > 1.0 else "heavier"
    says = (
        f"{off} the links are {_short(max(factor, found.scale))} times {lighter} than in the model "
        "file"
    )
    if found.percent > FAIR_BODIES_MISFIT:
        says += (
            ", or lengths and axes differ from the model file: with free link inertias the "
            f"misfit is {found.percent:.0f} %"
        )
    if far and "A" not in signals.effort_units:
        says = f"{_factor_words(reading)}; {says}"
    cause = "gain" if "A" in signals.effort_units else "effort kind"
    cost, joints = FITTED_NUMBER_COST, tuple(range(signals.n))
    hypothesis = Hypothesis(cause, says, changed, cost, joints, changed.score, fixed=False)
    if far:
        return hypothesis, Severity.WRONG
    link = next(link_hypotheses(reading), None)
    if link is None or link.log_likelihood < hypothesis.log_likelihood - SUPPORT_MARGIN:
        return hypothesis, Severity.DOUBTFUL
    return replace(hypothesis, says=f"{off} {link.says}"), Severity.OK


def _factor_words(reading: Reading) -> str:
    """The factor on each joint's effort, with its interval: gear ratios where it may be one."""
    best, low, high = factor_intervals(reading)
    known, names = (low > 0.0) & np.isfinite(high), reading.likelihood.names
    ratios = np.all((best[known] > LEAST_GEAR_RATIO) & (best[known] < LARGEST_GEAR_RATIO))
    listed = ", ".join(
        f"{names[j]} {_short(best[j])} ({_short(low[j])} to {_short(high[j])})"
        for j in np.flatnonzero(known)
    )
    left = ", ".join(names[j] for j in np.flatnonzero(~known))
    return (
        "torques seem to be those of motors, whose gear ratios are unknown"
        if ratios
        else "efforts are off by unknown factors"
    ) + (
        f": by the masses of the model file {listed or 'none is identifiable'}"
        + f" (95 %); not identifiable: {left}" * bool(listed and left)
    )


def _short(factor: float) -> str:
    """A factor with two digits: `620`, not `6.2e+02`."""
    return f"{float(f'{factor:.2g}'):g}"
