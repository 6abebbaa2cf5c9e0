"""Which questions a nominal model leaves undecided, and why.

A question is answered if the evidence of every other answer, each as one change of the best
explanation, is clearly less: whatever bodies weigh that can exist.
"""

from itertools import chain

import numpy as np

from steelyard.check.decision.ranked_readings import LogVerdict
from steelyard.check.decision.search_with_unknown_bodies import (
    COPIED,
    FACTOR_CAUSES,
    Explanation,
    Search,
    alike,
    least_mass,
)
from steelyard.check.decision.verdict_of_log import CLEAN, HEAVIEST_FACTOR, friction_alone_explains
from steelyard.check.finding import MOST_NAMED
from steelyard.check.hypotheses.evidence_with_unknown_bodies import WIDTHS
from steelyard.check.hypotheses.hypotheses_and_their_scores import LIKELY, SURE
from steelyard.check.hypotheses.position_and_effort_hypotheses import (
    ZERO_CAUSE,
    zero_offsets,
    zeros_without_effect,
)
from steelyard.check.hypotheses.readings_and_likelihood import Reading
from steelyard.estimate.payload.runs_with_payload import carrier

ANSWERED = 10.0  # log odds by which all alternatives must be behind for a question to be answered
FAIR_BODIES_MISFIT = 5.0  # misfit [%] up to which nothing is hidden by it
TRIED_FACTORS = {"effort kind": HEAVIEST_FACTOR, "effort unit": 1000.0}
"""Factors on all efforts that must fit clearly worse."""
OTHER_GAIN = 1.5
"""Factor on one joint's effort that must fit clearly worse, and of all links over the nominal ones:
model files are off by less as a whole."""
UNTIL_OTHER = "undecided until"  # another question is decided
UNKNOWN_GAINS = {
    "gain": 'undecided: unknown gains (gain = "identify") are not compared with the model file',
    "payload": 'undecided: unknown gains (gain = "identify") would have a similar effect',
    ZERO_CAUSE: 'not tested by a fit while gains are unknown (gain = "identify")',
}
"""Why a question has no answer where gains are unknown."""


def undecided(decision: LogVerdict, cause: str) -> str:
    """Why a nominal model cannot answer a question; empty if it can."""
    reading, signals, search = decision.last.reading, decision.likelihood.signals, decision.search
    if search is None:
        return _zeros(reading) if cause == ZERO_CAUSE else ""
    best, declared = search.best, search.declared.reading
    open_factor = [r.cause for r, _ in decision.winners if not r.fixed and r.cause in FACTOR_CAUSES]
    if not any(r.cause in FACTOR_CAUSES for r, _ in decision.winners):
        changed = [c.cause for c in best.changes if c.cause in FACTOR_CAUSES]
        open_factor += [c for c in changed if not alike(c, best.reading, declared)]
    if open_factor and cause in (*FACTOR_CAUSES, "payload") and cause != open_factor[-1]:
        return f"{UNTIL_OTHER} '{open_factor[-1]}' is decided"
    if cause in UNKNOWN_GAINS and any(signals.unknown_gains):
        return UNKNOWN_GAINS[cause]
    misfit = f"the log has a misfit of {search.best.evidence.percent:.1f} % with free link inertias"
    if cause == "payload" and (size := hidden_mass(search)):
        return f"undecided: {misfit}, and {size}"
    if cause in COPIED and not alike(cause, best.reading, declared):
        own = (change.says for change in best.changes if change.cause == cause)
        says = next(chain(own, (winner.says for winner, _ in decision.winners)), "")
        return f"undecided: {misfit}, with or without this: {says}" if says else ""
    if cause == "gain":
        return _gains(search, misfit)
    near = [h.says for h, odds in search.alternatives(cause) if odds > -ANSWERED]
    if cause in TRIED_FACTORS and not any(signals.unknown_gains):
        sizes = (TRIED_FACTORS[cause], 1.0 / TRIED_FACTORS[cause])
        odds = search.odds_of_factors([np.full(signals.n, x) for x in sizes])
        near += [
            f"efforts times {x:.3g}" for x, o in zip(sizes, odds, strict=True) if o > -ANSWERED
        ]
    listed = ", ".join(near[:MOST_NAMED]) + ", ..." * (len(near) > MOST_NAMED)
    others = f"; other readings fit about as well: {listed}" * bool(near)
    known = not any(signals.unknown_gains)
    if cause == "effort kind" and known and (far := other_size(best)):
        return f"undecided: {far}{others}"
    return f"undecided: {misfit}{others}" if near else ""


def other_size(best: Explanation) -> str:
    """That the links that fit best are far larger or smaller than the nominal ones, or nothing.

    Efforts that are all off by one factor have the same effect.
    """
    scale = best.evidence.scale
    if abs(np.log(scale)) < np.log(OTHER_GAIN):
        return ""
    if friction_alone_explains(best.reading, best.evidence.score):
        return ""
    return (
        f"the links that fit best are {scale:.2g} times as heavy as those of the model file: "
        "its masses, or all efforts, are off by about that"
    )


def hidden_mass(search: Search) -> str:
    """What the last link may weigh beside what the model file says; empty if that is little."""
    best, knowledge = search.best, search.best.reading.knowledge
    body = knowledge.robot.bodies[carrier(knowledge.robot).body]
    more = float(best.carried[0])
    width = best.evidence.width
    # the likeliest where nominal bodies are right
    most = abs(more) + 2.0 * width * abs(body.inertia.mass) * (width > min(WIDTHS))
    if most <= least_mass(knowledge):
        return ""
    mass = body.inertia.mass
    less = f", or up to {most:.2g} kg less" if most < mass else ", or less"
    return f"'{body.name}' may weigh up to {most:.2g} kg more than its {mass:.2g} kg{less}"


def _gains(search: Search, misfit: str) -> str:
    """Joints whose gain may be another one, at equal evidence."""
    names = search.best.reading.likelihood.names
    seen = search.best.evidence.counts > 0.0
    seen[: search.best.reading.likelihood.joints.start] = False  # a base has no motors
    one = np.eye(len(names))[seen]
    factors = [*OTHER_GAIN**one, *OTHER_GAIN**-one]
    odds = np.array(search.odds_of_factors(factors)).reshape(2, -1)
    answered = seen.copy()
    answered[seen] = odds.max(axis=0, initial=-np.inf) <= -ANSWERED
    joints = search.best.reading.likelihood.joints
    weak = [names[j] for j in joints if not answered[j]]
    if not weak:
        return ""
    names = names[joints.start :]
    rest = ", ".join(f"'{name}'" for name in names if name not in weak)
    if not rest:
        return f"undecided: {misfit} also with very different gains"
    listed = ", ".join(f"'{name}'" for name in weak)
    return (
        f"undecided for {listed}: very different gains fit about as well; no error in the gains of "
        f"{rest}"
    )


def _zeros(reading: Reading) -> str:
    """Zeros that fit better though the misfit is small, or that other motion would identify."""
    zeros = zero_offsets(reading)
    moved = {z: reading.with_zero(z.joint, z.value) for z in zeros if z.identifiable}
    rises = {z: other.log_likelihood - reading.log_likelihood for z, other in moved.items()}
    best = max(rises, key=lambda zero: rises[zero], default=None)
    if best is not None and rises[best] >= LIKELY:
        least = max(rises[best] - SURE, LIKELY)
        alike = [z.words for z, r in rises.items() if z is not best and r > least]
        others = f" (or of {', '.join(alike)})" if alike else ""
        return (
            f"undecided: with a zero offset of {best.words}{others} the misfit falls from "
            f"{reading.percent:.2g} to {moved[best].percent:.2g} %; compare the zeros with the "
            "robot"
        )
    never = zeros_without_effect(reading.knowledge.robot)
    left = [z.name for z in zeros if not z.identifiable and not never[z.joint]]
    if not left:
        return ""
    rest = ", ".join(zero.name for zero in zeros if zero.identifiable)
    says = f"undecided: not identifiable from these data: {', '.join(left)}"
    return f"{says}; no significant zero offset of {rest}" if rest else says


def misfit_hides(decision: LogVerdict) -> bool:
    """Whether the misfit is large, and not one of the model file's link inertias alone."""
    if decision.search is None:
        return decision.last.reading.percent > CLEAN
    return decision.search.best.evidence.percent > FAIR_BODIES_MISFIT
