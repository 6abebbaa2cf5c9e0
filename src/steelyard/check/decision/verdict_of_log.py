"""What holds of a log: which explanations are beyond doubt, and how sure that is.

With a reference an explanation must agree clearly better than what is declared. Where nothing but a
nominal model is known, that links are heavier or lighter than a model file says is always a
hypothesis as well: readings are then compared by their evidence, in which bodies are averaged.
A cause is wrong, or doubtful, by the odds of the best explanation to the best one that does not say
the same of it; wrong only if no other log that needs a correction excludes it, and then of all logs
that do not deny it. A factor that is estimated by the masses of a model file is never written.

Odds are natural logarithms: where bodies are not known, of the evidence, which counts a joint for a
limited number of samples and never leaves less than a floor; else of the misfits by the reference.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from steelyard.check.cases_and_checks import Case, CheckedLog, remembered
from steelyard.check.decision.drive_gains_and_what_init_learns import (
    LARGEST_GEAR_RATIO,
    LEAST_GEAR_RATIO,
)
from steelyard.check.decision.ranked_readings import (
    Judged,
    LogVerdict,
    disagrees,
    has_bad_joint,
    rankings,
)
from steelyard.check.decision.search_with_unknown_bodies import (
    COPIED,
    FACTOR_CAUSES,
    Explanation,
    Search,
    alike,
    least_mass,
    mirror,
    says_the_same,
    undone,
)
from steelyard.check.finding import MOST_NAMED, SURE_DEVIATIONS, Severity
from steelyard.check.hypotheses.gravity_payload_and_delay import axis_near, delay_hypotheses
from steelyard.check.hypotheses.hypotheses_and_their_scores import (
    CLOSE_HYPOTHESES,
    FITTED_NUMBER_COST,
    LIKELY,
    SURE,
    Hypothesis,
)
from steelyard.check.hypotheses.nuisance_fit_and_score import MISFIT_FLOOR, LikelihoodScore
from steelyard.check.hypotheses.position_and_effort_hypotheses import (
    factor_intervals,
    holds_factors,
)
from steelyard.check.hypotheses.readings_and_likelihood import Reading
from steelyard.check.hypotheses.sensors_contacts_and_limbs import (
    CONTACTS,
    OF_BASE,
    SENSOR_MOUNTING,
)
from steelyard.check.hypotheses.signs_and_delay_by_friction import no_common_delay
from steelyard.estimate.payload.runs_with_payload import carrier

ROUGH_MISFIT = 25.0  # misfit [%] that a reading may leave in the typical joint to be one
HEAVIEST_FACTOR = 6.0  # on all efforts, before the links of a nominal model are no excuse
NOTICED_FACTOR = 2.0  # on all efforts, from which on bodies of another size are mentioned
LEAST_FALL = 2.0  # fall of some joint's misfit that a reading needs against a reference
LEAST_DELAY = {True: 0.004, False: 0.04}  # least delay [s], with and without a reference
DELAY_ROWS = 1.5  # the same in rows of the log
EXPLAINED_BY_FRICTION = 60.0  # log-likelihood that bodies must gain beside friction alone
MIRROR_FALL = 1.5
"""Misfit of mirrored bodies, over that of the best ones, up to which both fit: no log tells the two
apart but by the nominal bodies, which may be wrong."""
STRIKING, CLEAN = 200.0, 12.0
"""Log-likelihood gained, and misfit left [%], of an explanation by a nominal model that counts
although the declared reading is not bad in itself."""
SIMPLER_FIT = 1.1  # misfit over the best one's up to which a simpler explanation fits as well
FREE_INERTIAS = "free link inertias"
NUMBERS = ("gain", "mounting", "effort delay")  # not written where a log does not show them
MIRRORED = "all {} have the opposite sign"
ORDER_AND_SIGNS = ("joint order", "position sign", "effort sign")
BOTH_MIRRORS_FIT = ": both fit with free link inertias, and this log cannot distinguish them"


@remembered
def judge_log(case: Case, evidence: CheckedLog) -> LogVerdict | None:
    """What holds of a log, with what others show that it supports; `None` if it cannot be tried."""
    found = _alone(case, evidence)
    if found is None or found.search is None:
        return found
    verdicts = {log.name: x for log in case.logs if (x := _alone(case, log)) is not None}
    return _shared(found, found.search, verdicts)


@remembered
def _alone(case: Case, evidence: CheckedLog) -> LogVerdict | None:
    """What a log says by itself, with one delay no longer sure that joints or slow motion deny."""
    ranked = rankings(case)
    found = ranked.get(evidence)
    if found is None:
        return None
    if found.search is None:
        return _by_reference(found)
    others = {e.name: x.search for e, x in ranked.items() if e is not evidence and x.search}
    found = _by_evidence(found, found.search, others)
    # with another cause beside it the log as it is read says nothing of the delay
    if [(w.cause, severity) for w, severity in found.winners] == [("effort delay", Severity.WRONG)]:
        ((one, _),) = found.winners
        more = one.reading.delay - found.declared.reading.delay
        if against := no_common_delay(case, evidence, more):
            one = replace(one, says=f"{one.says}, but {against}", fixed=False)
            return replace(found, winners=((one, Severity.DOUBTFUL),))
    return found


def _by_reference(found: LogVerdict) -> LogVerdict:
    """Explanations one after another, as long as each agrees clearly better with the reference."""
    winners: list[Judged] = []
    before = found.declared
    chain = dict.fromkeys(hypotheses[0] for hypotheses in found.rounds if hypotheses[0].cause)
    for hypotheses, winner in zip(found.rounds, chain, strict=False):
        severity = _judged(before, winner, hypotheses)
        if severity is Severity.OK:
            break
        winners.append((winner, severity))
        before = winner
    floats = before.reading.base is not None
    if not floats and all(w.cause != "effort delay" for w, _ in winners):
        judged = len(winners)
        rest = found.rounds[judged] if judged < len(found.rounds) else None
        for late in delay_hypotheses(before.reading) if rest is None else rest:
            if late.cause == "effort delay":
                winners += [(late, Severity.WRONG)] * _late(before.reading, late)
                break
    return replace(found, winners=tuple(winners), explained=not has_bad_joint(before))


def _judged(before: Hypothesis, winner: Hypothesis, hypotheses: Sequence[Hypothesis]) -> Severity:
    """How sure a winner is by a reference."""
    if winner.log_likelihood - before.log_likelihood < SURE:
        return Severity.OK
    if winner.cause == "payload":
        knowledge, ten = winner.reading.knowledge, winner.reading.payload
        least = max(least_mass(knowledge), SURE_DEVIATIONS * winner.spread)
        heavy = ten is not None and abs(ten[0]) > least
        return Severity.WRONG if heavy else Severity.OK
    if winner.cause == "effort delay":
        return Severity.WRONG if _late(before.reading, winner) else Severity.OK
    if float(np.max(before.misfits / np.maximum(winner.misfits, 1e-3))) < LEAST_FALL:
        return Severity.OK
    least = winner.log_likelihood - CLOSE_HYPOTHESES
    near = any(
        (r.cause != winner.cause or r.joints != winner.joints)
        for r in hypotheses[1:]
        if r.log_likelihood > least
    )
    return Severity.DOUBTFUL if near else Severity.WRONG


def _late(before: Reading, hypothesis: Hypothesis) -> bool:
    """Whether a delay matters for certain."""
    reading = hypothesis.reading
    sure, least = reading.knowledge.identified, least_delay(reading)
    if abs(reading.delay - before.delay) < least or (sure and disagrees(hypothesis)):
        return False
    return reading.score.sharp - before.score.sharp > LIKELY


def least_delay(reading: Reading) -> float:
    """Least delay that is told from friction and model errors [s]."""
    least, log = LEAST_DELAY[reading.knowledge.identified], reading.likelihood.excerpt
    return float(max(least, DELAY_ROWS / log.log_rate))


def positions_at_fault(case: Case, evidence: CheckedLog) -> bool:
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


def _by_evidence(found: LogVerdict, search: Search, others: Mapping[str, Search]) -> LogVerdict:
    """What the best explanation says of every cause, each by its own odds and other logs."""
    for cause in _causes(search):
        search.without(cause)  # may do better
    best = search.best
    winners: list[Judged] = []
    for cause in _causes(search):
        odds = search.without(cause)
        hypothesis = _part(search, cause)
        # numbers that are fitted to the nominal bodies also fit what friction and they lack
        fitted = cause in FACTOR_CAUSES and hypothesis is not None and not hypothesis.fixed
        if hypothesis is not None and odds >= (SURE if fitted else LIKELY):
            # removed weight with free bodies fits other mistakes too: nothing is sure by it
            explained = best.evidence.percent <= ROUGH_MISFIT and not best.reading.held
            if cause in ORDER_AND_SIGNS and explained and _contested(search, cause):
                continue  # `one_of_several` says what the explanations are
            sure = odds >= SURE and explained and (hypothesis.fixed or cause in OF_BASE)
            hypothesis = replace(hypothesis, odds=odds)
            one, severity = _judged_part(search, hypothesis, odds, sure)
            # a log that is as declared may have been recorded otherwise; its edits are its own
            excluding = (
                log
                for log, other in others.items()
                if other.best is not other.declared
                and other.loss(COPIED[cause](other.best.reading, search.best.reading)) > LIKELY
            )
            if severity is Severity.WRONG and (log := next(excluding, "")):
                says = f"{one.says} (not by {log}, which is not as declared either)"
                one, severity = replace(one, says=says, fixed=False), Severity.DOUBTFUL
            winners.append((one, severity))
    reading = _written(best.reading, search.declared.reading, winners)
    winners = [(replace(w, reading=reading) if w.fixed else w, s) for w, s in winners]
    winners += one_of_several(search, winners)
    winners += _scale(search, winners)
    return replace(found, winners=tuple(winners), explained=best.evidence.percent <= ROUGH_MISFIT)


def _as_good(one: Explanation, best: Explanation) -> bool:
    """Whether an explanation is about as likely as the best, or a simpler one that fits as well.

    Where the model file is far off, its errors decide between fits that are alike.
    """
    costs = [sum(change.cost for change in x.changes) for x in (one, best)]
    alike_fit = one.evidence.percent <= SIMPLER_FIT * best.evidence.percent
    return one.log > best.log - LIKELY or (costs[0] < costs[1] and alike_fit)


def _contested(search: Search, cause: str) -> bool:
    """Whether an explanation that is as good says something else of a cause.

    Nearer ones count in the odds, and mirrors of all joints are named with the others.
    """
    best = search.best
    return any(
        _as_good(one, best) and not says_the_same(cause, one.reading, best.reading)
        for one in search.found.values()
        if one.log <= best.log - LIKELY
    )


def _shared(found: LogVerdict, search: Search, verdicts: Mapping[str, LogVerdict]) -> LogVerdict:
    """A verdict with what is sure in some logs and not denied by this one, as all say it best."""
    winners, best, declared = found.winners, search.best, search.declared
    last = (found.written or (found.declared,))[-1].reading
    searches = [x.search for x in verdicts.values() if x.search is not None]
    wrong = [(log, w) for log, x in verdicts.items() for w, s in x.winners if s == Severity.WRONG]
    for cause, copied in COPIED.items():
        sure = {log: w for log, w in wrong if w.cause == cause and w.fixed}
        causes = FACTOR_CAUSES if cause in FACTOR_CAUSES else (cause,)
        if not sure or (len(causes) > 1 and any(found.likelihood.signals.unknown_gains)):
            continue
        common = min(
            sure.values(),
            key=lambda w: sum(x.loss(copied(x.best.reading, w.reading)) for x in searches),
        )
        own = next((w for w, _ in winners if w.cause in causes), None)
        if own is not None and own.fixed and own.says == common.says:
            continue
        reading = copied(best.reading, common.reading)
        (fitted,), loss = search.of.of([reading]), search.loss(reading)
        odds = search.loss(undone(best.reading, declared.reading, cause)) - loss
        if (
            fitted is None
            or loss > SURE
            or odds < (CLOSE_HYPOTHESES if cause in NUMBERS else -CLOSE_HYPOTHESES)
        ):
            continue
        alone = "does not decide" if odds > CLOSE_HYPOTHESES else "cannot show"
        note = f"; known from {', '.join(sure)}"
        note += f", this log alone {alone} it" if odds < SURE else ", for this log as well"
        scored = replace(common, score=fitted.score, evidence=fitted.log, odds=odds, note=note)
        one = replace(scored, compared=(FREE_INERTIAS, declared.evidence.percent))
        severity = Severity.WRONG if odds >= SURE else Severity.DOUBTFUL
        winners = ((one, severity), *(x for x in winners if x[0] is not own))
        last = copied(last, common.reading)
    written = ((replace(w, reading=last) if w.fixed else w, s) for w, s in winners)
    return replace(found, winners=tuple(written))


def _causes(search: Search) -> list[str]:
    """Causes of which the best explanation says something else than is declared."""
    best, declared = search.best, search.declared.reading
    factors = [c.cause for c in best.changes if c.cause in FACTOR_CAUSES][-1:]
    listed = ("joint order", "position sign", "effort sign", *factors, "mounting")
    others = ("effort delay", "payload", *OF_BASE)
    causes = [c for c in (*listed, *others) if not alike(c, best.reading, declared)]
    if not best.reading.gravity.any():  # efforts are gravity compensated
        causes = [c for c in causes if c != "mounting"]
    return causes


def one_of_several(search: Search, winners: Sequence[Judged]) -> Iterator[Judged]:
    """That order or signs are not as declared, where several others explain a log about as well."""
    best, own = search.best, search.best.reading
    if best.evidence.percent > ROUGH_MISFIT:
        return
    for cause in ORDER_AND_SIGNS:
        own = undone(own, search.declared.reading, cause)
    if own.key == best.reading.key or any(w.cause in ORDER_AND_SIGNS for w, _ in winners):
        return
    search.compare([(own, tuple(c for c in best.changes if c.cause not in (*ORDER_AND_SIGNS, "")))])
    said: dict[str, Hypothesis] = {}
    with_mirrors, as_declared = list[Reading](), -np.inf
    for one in search.ordered():
        others = [x for x in ORDER_AND_SIGNS if not alike(x, one.reading, own)]
        near = _as_good(one, best)
        parts = [part for x in others if near and (part := _part(search, x, one)) is not None]
        if parts:
            every = [part.says for part in parts]
            words = " and ".join(every)
            if BOTH_MIRRORS_FIT in words:
                pair = "({})" if len(every) > 1 else "{}"
                every = [
                    pair.format(x.replace(BOTH_MIRRORS_FIT, "")) if BOTH_MIRRORS_FIT in x else x
                    for x in every
                ]
                flipped = mirror(one.reading)
                if any(all(alike(x, flipped, y) for x in ORDER_AND_SIGNS) for y in with_mirrors):
                    continue
                with_mirrors.append(one.reading)
            said.setdefault(" and ".join(every), parts[0])
        elif near or not others:
            as_declared = max(as_declared, one.log)
    odds = best.log - as_declared
    if odds >= LIKELY:
        listed = list(said)[:MOST_NAMED]
        says = "either " * (len(listed) > 1) + ", or ".join(listed)
        says += ", or others" * (len(said) > len(listed))
        first = said[listed[0]]
        yield replace(first, says=says, odds=odds, fixed=False, joints=()), Severity.DOUBTFUL


def _part(search: Search, cause: str, said_by: Explanation | None = None) -> Hypothesis | None:
    """What an explanation, the best if `None`, says of one cause; `None` where of no account."""
    best = search.best if said_by is None else said_by
    own = [c for c in best.changes if c.cause == cause]
    compared = FREE_INERTIAS, search.declared.evidence.percent
    one = best.as_hypothesis(cause=cause, joints=own[-1].joints if own else (), compared=compared)
    if own:
        one = replace(one, says=own[-1].says)
    declared = search.declared.reading
    if cause == "joint order" and len(own) != 1:
        moved = [j for j, c in enumerate(best.reading.position) if c != declared.position[j]]
        return replace(one, says=order_of(best.reading), joints=tuple(moved))
    if cause in ("position sign", "effort sign"):
        return _sign_part(search, best, one)
    if cause == "mounting":
        # a direction of gravity that lies along no axis may as well be a force from outside
        gravity = best.reading.gravity
        along = axis_near(gravity / np.linalg.norm(gravity)) is not None if gravity.any() else False
        return replace(one, fixed=(along or not best.poor) and not best.reading.held)
    if cause in FACTOR_CAUSES:
        factors = np.abs(best.reading.effort_scale / declared.effort_scale)
        fitted = any(
            c.cost >= FITTED_NUMBER_COST and c.cause in FACTOR_CAUSES for c in best.changes
        )
        if fitted and np.any(factors != 1.0) and cause == "effort kind":
            one = replace(one, says=factor_words(undone(best.reading, declared, cause)))
        return replace(one, fixed=not fitted)
    if cause == SENSOR_MOUNTING:  # a turn that is fitted to the nominal bodies is not exact
        return replace(one, fixed=all(c.cost < FITTED_NUMBER_COST for c in own))
    if cause == CONTACTS and best.reading.base is not None and declared.base is not None:
        # no line of a robot file changes sizes or signs of forces
        return replace(one, fixed=np.array_equal(best.reading.base.factors, declared.base.factors))
    if cause == "effort delay":
        return one if _late(undone(best.reading, declared, cause), one) else None
    if cause == "payload":
        return _payload_part(best, one)
    return one


def _sign_part(search: Search, best: Explanation, one: Hypothesis) -> Hypothesis | None:
    """The joints whose sign is another one, and the mirror that fits as well."""
    before, after, what = search.declared.reading, one.reading, one.cause.partition(" ")[0]
    names = after.likelihood.names
    # an effort's sign belongs to its column
    order = list(after.effort)
    then, now = (np.sign(getattr(r, f"{what}_scale")) for r in (before, after))
    turned = (then[order] if what == "effort" else then) != now
    if what == "effort" and (unknown := after.likelihood.signals.unknown_gains):
        turned &= ~np.asarray(unknown)  # the sign is one of the gain that is identified
    if not turned.any():
        return None
    joints = tuple(np.flatnonzero(turned).tolist())
    who = ", ".join(f"'{names[j]}'" for j in joints)
    if len(joints) == len(names) > 1:
        says = MIRRORED.format(f"{what}s")
        found = search.of.of([mirror(after)])[0]
        if found is not None and found.percent < MIRROR_FALL * best.evidence.percent:
            other_words = MIRRORED.format("efforts" if what == "position" else "positions")
            says = f"{says}, or {other_words}{BOTH_MIRRORS_FIT}"
        return replace(one, says=says, joints=joints)
    return replace(one, says=f"{what} of {who} has the opposite sign", joints=joints)


def _payload_part(best: Explanation, one: Hypothesis) -> Hypothesis | None:
    """What the last link carries, by the most likely bodies."""
    robot, ten = best.reading.knowledge.robot, best.carried
    mass, body = float(ten[0]), robot.bodies[carrier(robot).body]
    if abs(mass) < least_mass(best.reading.knowledge):
        return None
    if_right = "if the model file's masses are right"
    says = f"the arm carries a payload of about {mass:.2g} kg ({if_right})"
    if mass < 0.0:
        says = (
            f"'{body.name}' is about {-mass:.2g} kg lighter than the {body.inertia.mass:.2g} kg of "
            "the model file"
        )
    reading = best.reading.changed(payload=ten)
    return replace(one, says=says, reading=reading, joints=(), fixed=False)


def _judged_part(search: Search, one: Hypothesis, odds: float, sure: bool) -> Judged:
    """A part with its severity; what is written must be within what every joint shows."""
    if one.cause == "payload":
        ten = one.reading.payload  # of model files masses are often too large
        return one, Severity.DOUBTFUL if ten is not None and ten[0] > 0.0 else Severity.OK
    factor = one.cause in FACTOR_CAUSES and one.reading.kind != "gravity_compensated_torque"
    if factor:
        before = undone(one.reading, search.declared.reading, one.cause)
        held = holds_factors(before, np.abs(one.reading.effort_scale / before.effort_scale))
        one = replace(one, fixed=sure and held)
        _, low, high = factor_intervals(before)
        # unknown factors are wrong only where most intervals, or one by far, exclude the declared
        most = np.mean((low > 1.0) | (high < 1.0)) > 0.5
        far = (low > HEAVIEST_FACTOR) & np.isfinite(high) | (high < 1 / HEAVIEST_FACTOR) & (low > 0)
        sure = odds >= SURE and not one.reading.held and (one.fixed or bool(most or far.any()))
        return one, Severity.WRONG if sure else Severity.DOUBTFUL
    return replace(one, fixed=sure and one.fixed), Severity.WRONG if sure else Severity.DOUBTFUL


def _written(best: Reading, declared: Reading, winners: Sequence[Judged]) -> Reading:
    """The best reading with what is not written as it is declared."""
    reading = best
    written = {hypothesis.cause for hypothesis, _ in winners if hypothesis.fixed}
    order_and_signs = ("joint order", "position sign", "effort sign")
    for cause in (*order_and_signs, "mounting", "effort delay", *OF_BASE):
        if cause not in written and not (cause == "mounting" and not best.gravity.any()):
            reading = undone(reading, declared, cause)
    if not written & set(FACTOR_CAUSES):
        reading = undone(reading, declared, "gain")
    return reading


def order_of(reading: Reading) -> str:
    """The order of columns in words."""
    first = reading.likelihood.joints.start
    if reading.position == reading.likelihood.declared.position:
        own = reading.effort[first:]
        return f"efforts in the order {', '.join(str(k + 1 - first) for k in own)}"
    names = reading.likelihood.names
    listed = ", ".join(f"'{names[reading.position.index(k)]}'" for k in range(first, len(names)))
    if reading.effort == reading.position:
        return f"the columns are in the order {listed}"
    return f"the columns of positions are those of {listed}"


def friction_alone_explains(reading: Reading, score: LikelihoodScore) -> bool:
    """Whether friction alone fits a log about as well as with bodies: their size is open then."""
    alone = reading.friction_alone
    score = replace(score, counts=alone.counts)
    gain = float(score.log_likelihood - alone.log_likelihood)
    fall = float(np.max(alone.misfits / np.maximum(score.misfits, MISFIT_FLOOR)))
    return gain < EXPLAINED_BY_FRICTION or fall < LEAST_FALL


def _scale(search: Search, winners: Sequence[Judged]) -> Iterator[Judged]:
    """A factor on all efforts, or bodies lighter or heavier than the nominal ones.

    Beyond `HEAVIEST_FACTOR` something is wrong with the efforts. There is no finding where friction
    alone fits as well as bodies.
    """
    if any(w.cause in FACTOR_CAUSES for w, _ in winners):
        return
    declared = search.declared.reading
    best = next(  # by what is declared: factors that are no finding have the same effect
        (x for x in search.ordered() if all(alike(c, x.reading, declared) for c in FACTOR_CAUSES)),
        search.best,
    )
    found = best.evidence
    factor, far = 1.0 / found.scale, abs(np.log(found.scale)) > np.log(HEAVIEST_FACTOR)
    if abs(np.log(factor)) < np.log(NOTICED_FACTOR) or (far and found.sized < SURE):
        return
    if found.percent > ROUGH_MISFIT:
        return
    reading, signals = best.reading, best.reading.likelihood.signals
    if friction_alone_explains(reading, found.score):
        return
    changed = reading.with_factors(np.full(signals.n, factor))
    if any(signals.unknown_gains) or changed.percent * LEAST_FALL > reading.percent:
        return
    says = (
        f"either efforts are off by a factor of about {_short(factor)}, or the links are "
        f"{_short(max(factor, found.scale))} times {'lighter' if factor > 1.0 else 'heavier'} than "
        "in the model file"
    )
    if far and "A" not in signals.effort_units:
        says = f"{factor_words(reading)}; {says}"
    cause = "gain" if "A" in signals.effort_units else "effort kind"
    joints, compared = tuple(range(signals.n)), (FREE_INERTIAS, search.declared.evidence.percent)
    own = {"cause": cause, "says": says, "reading": changed, "joints": joints, "fixed": False}
    own |= {"cost": FITTED_NUMBER_COST, "compared": compared, "odds": found.sized}
    yield best.as_hypothesis(**own), Severity.WRONG if far else Severity.DOUBTFUL


def factor_words(reading: Reading) -> str:
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
