"""What the data of a log support by themselves, where nothing but a nominal model is known.

That links are heavier or lighter than a model file says is always a hypothesis. So an explanation
is beyond doubt only if physically consistent bodies, whatever they weigh, fit the log clearly
better under it than as declared. That happens for orders, signs and directions; never for a factor
on all efforts, as bodies of as many times the mass have the same effect.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from steelyard.base.arrays import Array
from steelyard.check.finding import Severity
from steelyard.check.hypotheses.bodies import (
    ConsistentBodies,
    consistent_bodies,
    link_hypotheses,
    with_mirror,
)
from steelyard.check.hypotheses.effort_columns import combined_hypotheses, unit_hypotheses
from steelyard.check.hypotheses.friction_evidence import friction_alone
from steelyard.check.hypotheses.likelihood import (
    CLOSE_HYPOTHESES,
    FITTED_NUMBER_COST,
    Hypothesis,
    Likelihood,
    Reading,
)
from steelyard.check.hypotheses.nuisance import MISFIT_FLOOR
from steelyard.check.hypotheses.surroundings import axis_near, mounting_hypotheses

SUPPORT_MARGIN, SUPPORT_FALL = 60.0, 2.0
"""Log-likelihood that bodies of the log's own must gain, and the factor by which the misfit of some
joint must fall, for the data to contradict what is declared."""
LATE_MARGIN = 12.0  # the same for a delay, with a sharper likelihood
LATE_FALL = 1.2
"""The same, as a factor: friction that only the robot file's own terms describe looks like a little
delay, and what bodies of the log's own leave hardly falls with it."""
HEAVIEST_FACTOR = 6.0
"""Factor by which all efforts may be off a nominal model's before its links are no excuse."""
POOR_BODIES_MISFIT, ROUGH_BODIES_MISFIT = 10.0, 25.0
"""Misfit of bodies of the log's own [%] from which on other orders and signs are tried, and up to
which they are proposed."""
FAIR_BODIES_MISFIT = 5.0  # the same from which on other directions of gravity are tried
UNCONCERNED_CHANGE = 0.1
"""Relative change of a joint's misfit up to which a direction of gravity does not concern it."""
THOUSAND_TOLERANCE = 2.5
"""Factor up to which links may differ from a model file's, and gains from the declared ones, for
efforts to be in a unit that is a thousand times the declared one, or a thousandth of it."""


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


def supported(
    likelihood: Likelihood, winners: Sequence[tuple[Hypothesis, Severity]]
) -> tuple[tuple[Hypothesis, Severity], ...]:
    """What holds of a log, from what a nominal model suggests and what the data support."""
    kept: list[tuple[Hypothesis, Severity]] = []
    reading, rescaled = likelihood.declared, False
    for hypothesis, severity in winners:
        thousand = _as_thousand(reading, hypothesis)
        if thousand is not None:
            kept.append((thousand, severity))
            reading = thousand.reading
            break
        if hypothesis.cause == "payload" or contradicted(reading, hypothesis):
            fixed = hypothesis.fixed and not _fitted(reading, hypothesis)
            kept.append((replace(hypothesis, fixed=fixed), severity))
        elif _only_factor(reading, hypothesis):
            rescaled = rescaled or not _of_unit(reading, hypothesis)
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
    kept = [(with_mirror(r), severity) for r, severity in _unrivalled(kept)]
    scale = _scale(reading, rescaled)
    return (*kept, scale) if scale is not None else tuple(kept)


def _unrivalled(kept: list[tuple[Hypothesis, Severity]]) -> list[tuple[Hypothesis, Severity]]:
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


def _mirror(before: Reading, after: Reading) -> Reading:
    """The same pairs of positions and efforts, as an order of the others."""
    n = range(len(after.position))
    if after.effort == before.effort:
        effort = tuple(before.effort[after.position.index(before.position[j])] for j in n)
        return after.changed(position=before.position, effort=effort)
    position = tuple(before.position[after.effort.index(before.effort[j])] for j in n)
    return after.changed(position=position, effort=before.effort)


def _order_of(reading: Reading) -> str:
    """The order of the columns in a few words."""
    if reading.position == reading.likelihood.declared.position:
        return f"efforts in the order {', '.join(str(k + 1) for k in reading.effort)}"
    names = reading.likelihood.names
    listed = ", ".join(f"'{names[reading.position.index(k)]}'" for k in range(len(names)))
    if reading.effort == reading.position:
        return f"the columns are in the order {listed}"
    return f"the columns of positions are those of {listed}"


def _worst_joint_misfit(bodies: ConsistentBodies, before: ConsistentBodies | None = None) -> float:
    """Misfit of the joint that bodies of the log's own fit least [%].

    Of the joints whose misfit differs from the one before, if there is one.
    """
    seen = bodies.score.counts > 0.0
    if before is not None:
        change = np.abs(bodies.score.misfits - before.score.misfits)
        seen &= change > UNCONCERNED_CHANGE * before.score.misfits
    return 100.0 * float(np.max(bodies.score.misfits[seen], initial=0.0))


def _only_factor(reading: Reading, hypothesis: Hypothesis) -> bool:
    """Whether an explanation does nothing but multiply efforts by positive factors."""
    after = hypothesis.reading
    factors = after.effort_scale / reading.effort_scale
    return bool(
        np.all(factors > 0.0)
        and (after.position, after.effort) == (reading.position, reading.effort)
        and np.array_equal(after.gravity, reading.gravity)
        and np.array_equal(after.position_scale, reading.position_scale)
        and (after.delay, after.time) == (reading.delay, reading.time)
        and np.array_equal(after.ratios, reading.ratios)
    )


def _fitted(reading: Reading, hypothesis: Hypothesis) -> bool:
    """Whether an explanation's gains or ratios are those at which a nominal model agrees best."""
    ratios = not np.array_equal(hypothesis.reading.ratios, reading.ratios)
    return hypothesis.cost >= FITTED_NUMBER_COST and (ratios or _only_factor(reading, hypothesis))


def _of_unit(reading: Reading, hypothesis: Hypothesis) -> bool:
    """Whether a known factor, not a fitted one, brings bodies from absurd masses to likely ones."""
    if _fitted(reading, hypothesis):
        return False
    then, now = consistent_bodies(reading), consistent_bodies(hypothesis.reading)
    return then is not None and now is not None and _far(then) and not _far(now)


def _as_thousand(reading: Reading, hypothesis: Hypothesis) -> Hypothesis | None:
    """The unit that a fitted factor is near, if it leaves likely masses; `None` otherwise."""
    if not _fitted(reading, hypothesis):
        return None
    unit = _thousand(reading, hypothesis.reading.effort_scale / reading.effort_scale)
    return unit if unit and _of_unit(reading, unit) else None


def _thousand(reading: Reading, factors: Array) -> Hypothesis | None:
    """Efforts in the unit that factors on them are near; `None` if there is none.

    Torques are a thousand times the declared ones. Currents are in A or mA: for all joints one,
    though fitted gains of some joints may be far from it.
    """
    wanted, fitted = 1e3, factors
    if "A" in reading.likelihood.signals.effort_units and np.any(factors != 1.0):
        wanted = 1e3 if np.max(np.abs(reading.effort_scale)) < 1.0 else 1e-3
        fitted = np.array([np.median(factors[factors != 1.0])])
    if not np.all((fitted > wanted / THOUSAND_TOLERANCE) & (fitted < wanted * THOUSAND_TOLERANCE)):
        return None
    scale = wanted * reading.effort_scale
    return next(r for r in unit_hypotheses(reading) if np.allclose(r.reading.effort_scale, scale))


def _far(found: ConsistentBodies) -> bool:
    return max(found.scale, 1.0 / found.scale) > HEAVIEST_FACTOR


def _combined(reading: Reading) -> tuple[tuple[Hypothesis, Severity], ...]:
    """Order and signs of all columns, or gravity, if the data speak for another than is declared.

    So much is changed at once that the misfit must fall in the typical joint, or be small in all.
    Orders and signs are searched from the declared reading, gravity from the given one.
    """
    likelihood = reading.likelihood
    now, own = consistent_bodies(reading), consistent_bodies(likelihood.declared)
    if now is None or own is None:
        return ()
    poor = now.percent > POOR_BODIES_MISFIT or _worst_joint_misfit(now) > ROUGH_BODIES_MISFIT
    found = combined_hypotheses(likelihood) if poor else []
    fair = now.percent > FAIR_BODIES_MISFIT or _worst_joint_misfit(now) > POOR_BODIES_MISFIT
    found += mounting_hypotheses(reading) if fair else []
    if not found:
        return ()
    found.sort(key=lambda pair: -pair[0].log_likelihood)
    best, bodies = found[0]
    if not fits_clearly_better(bodies, now, best.cost):
        return ()
    worst = _worst_joint_misfit(bodies)
    if best.cause and best.reading.log_likelihood - reading.log_likelihood > SUPPORT_MARGIN:
        worst = _worst_joint_misfit(bodies, now)
    if bodies.percent > ROUGH_BODIES_MISFIT or (
        SUPPORT_FALL * bodies.percent > now.percent and worst > POOR_BODIES_MISFIT
    ):
        return ()
    near = [r for r, _ in found[1:] if r.log_likelihood > best.log_likelihood - CLOSE_HYPOTHESES]
    sure = not near and bodies.percent <= _enough(best)
    severity = Severity.WRONG if sure else Severity.DOUBTFUL
    compared = "free link inertias", (now if best.cause else own).percent
    return tuple((replace(r, fixed=sure, compared=compared), severity) for r in _parts(best))


def _enough(hypothesis: Hypothesis) -> float:
    """Misfit [%] up to which an explanation may be sure.

    A direction of gravity that lies along no axis may as well be a force from outside.
    """
    if hypothesis.cause != "mounting":
        return ROUGH_BODIES_MISFIT
    gravity = hypothesis.reading.gravity
    alone = axis_near(gravity / np.linalg.norm(gravity)) is None
    return FAIR_BODIES_MISFIT if alone else POOR_BODIES_MISFIT


def _parts(best: Hypothesis) -> Iterator[Hypothesis]:
    """One explanation per cause, all of the same reading."""
    names, before, after = (
        best.reading.likelihood.names,
        best.reading.likelihood.declared,
        best.reading,
    )
    if best.cause:
        yield best
        return
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


def bodies_that_explain(reading: Reading) -> ConsistentBodies | None:
    """Bodies of the log's own that explain a log; `None` where they do not, or hardly show."""
    found = consistent_bodies(reading)
    if (
        found is None
        or found.percent > POOR_BODIES_MISFIT
        or _worst_joint_misfit(found) > ROUGH_BODIES_MISFIT
    ):
        return None
    return None if friction_alone_explains(reading, found) else found


def friction_alone_explains(reading: Reading, found: ConsistentBodies) -> bool:
    """Whether friction alone fits a log about as well as with bodies: their size is open then."""
    alone = ConsistentBodies(friction_alone(reading), 0.0)
    return not fits_clearly_better(found, alone, 0.0)


def _scale(reading: Reading, rescaled: bool) -> tuple[Hypothesis, Severity] | None:
    """A factor on all efforts, or bodies lighter or heavier than the nominal ones.

    Beyond `HEAVIEST_FACTOR` something is wrong with the efforts, if the factor makes the nominal
    model agree clearly better; below, only where the nominal model calls for it. There is no
    finding where friction alone fits as well as bodies.
    """
    found = consistent_bodies(reading)
    if found is None or not (rescaled or (_far(found) and found.percent <= ROUGH_BODIES_MISFIT)):
        return None
    if friction_alone_explains(reading, found):
        return None
    factor, far = 1.0 / found.scale, _far(found)
    lighter = "lighter" if factor > 1.0 else "heavier"
    says = (
        f"either efforts are off by a factor of about {_short(factor)}, or the links are "
        f"{_short(max(factor, found.scale))} times {lighter} than in the model file"
    )
    if found.percent > FAIR_BODIES_MISFIT:
        says += (
            ", or lengths and axes differ from the model file: with free link inertias the "
            f"misfit is {found.percent:.0f} %"
        )
    signals = reading.likelihood.signals
    changed = reading.with_factors(np.full(signals.n, factor))
    cause = "gain" if "A" in signals.effort_units else "effort kind"
    if not rescaled and changed.percent * SUPPORT_FALL > reading.percent:
        return None
    unit = _thousand(reading, np.array([factor])) if far else None
    if unit is not None:
        return unit, Severity.WRONG
    cost, joints = FITTED_NUMBER_COST, tuple(range(signals.n))
    hypothesis = Hypothesis(cause, says, changed, cost, joints, changed.score, fixed=False)
    if far:
        return hypothesis, Severity.WRONG
    link = next(link_hypotheses(reading), None)
    if link is None or link.log_likelihood < hypothesis.log_likelihood - SUPPORT_MARGIN:
        return hypothesis, Severity.DOUBTFUL
    says = f"either efforts are off by a factor of about {_short(factor)}, or {link.says}"
    return replace(hypothesis, says=says), Severity.OK


def _short(factor: float) -> str:
    """A factor with two digits: `620`, not `6.2e+02`."""
    return f"{float(f'{factor:.2g}'):g}"
