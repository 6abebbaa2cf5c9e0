r"""Which questions a nominal model can answer where it finds nothing wrong.

Its misfit may come from wrong masses, or hide the fault. A question with a size (payload,
tilt of gravity) is answered if that size alone could not make the misfit: for the effort per unit
$c_j(t)$, and what is left of joint j's effort, $r_j(t)$, at most about

$$ \min_j \operatorname{rms}(r_j) / \operatorname{std}(c_j) $$

can be there, given the masses. A question with alternatives (signs, orders, units) is answered if
each of them agrees clearly worse.
"""

from collections.abc import Iterator
from itertools import combinations

import numpy as np

from steelyard.base.arrays import Z95, Array
from steelyard.check.decision.drive_gain_sources import CAUSES_THAT_SCALE
from steelyard.check.decision.judged_explanations import (
    CLEAN,
    FAIR_BODIES_MISFIT,
    HEAVIEST_FACTOR,
    LATE_MARGIN,
    LEAST_DELAY,
    least_mass,
)
from steelyard.check.decision.ranked_readings import DECISIVE_GAIN, LogVerdict
from steelyard.check.hypotheses.consistent_bodies_of_log import consistent_bodies
from steelyard.check.hypotheses.effort_hypotheses import poorly_identified
from steelyard.check.hypotheses.gravity_payload_and_delay import NEAR_AXIS_ANGLE, payload_fit
from steelyard.check.hypotheses.position_hypotheses import (
    ZERO_CAUSE,
    zero_offsets,
    zeros_without_effect,
)
from steelyard.check.hypotheses.readings_and_likelihood import Hypothesis, Reading, scored

SHOWN_ALTERNATIVES = 3  # alternatives that are named
NOTICED_ZERO_RISE = 8.0
"""Rise of the log-likelihood by a zero offset from which on zeros are not called those of the
reference: by chance less than once in a thousand logs, and on logs of a UR10e up to 4.4."""
UNKNOWN_GAINS = {
    "gain": 'undecided: unknown gains (gain = "identify") are not compared with the model file',
    "payload": 'undecided: unknown gains (gain = "identify") would have a similar effect',
    ZERO_CAUSE: 'not tested by a fit while gains are unknown (gain = "identify")',
}
"""Why a question has no answer where gains are unknown."""


def undecided(decision: LogVerdict, cause: str) -> str:
    """Why a nominal model cannot answer a question; empty if it can."""
    reading, signals = decision.last.reading, decision.likelihood.signals
    if reading.knowledge.identified:
        return _zeros(reading) if cause == ZERO_CAUSE else ""
    open_factor = [
        r.cause for r, _ in decision.winners if not r.fixed and r.cause in CAUSES_THAT_SCALE
    ]
    if open_factor and cause in (*CAUSES_THAT_SCALE, "payload"):
        return f"undecided until '{open_factor[-1]}' is decided"
    misfit = f"the nominal model with fitted friction has a misfit of {reading.percent:.1f} %"
    if cause in UNKNOWN_GAINS and any(signals.unknown_gains):
        return UNKNOWN_GAINS[cause]
    if cause in ("payload", "mounting"):
        size = _hidden_mass(reading) if cause == "payload" else _hidden_tilt(reading)
        return f"undecided: {misfit}, which {size} may cause" if size else ""
    if cause == "gain":
        return _gains(reading, misfit)
    if cause == "effort delay":
        near = _times(reading)
        misfit = "the declared interpretation fits with free link inertias"
    else:
        # alternatives that do not agree clearly worse
        least, seen = reading.log_likelihood - DECISIVE_GAIN, reading.score.counts > 0.0
        tried = scored([h for h in _alternatives(reading, cause) if np.any(seen[list(h.joints)])])
        near = [h.says for h in tried if h.log_likelihood > least]
    listed = ", ".join(near[:SHOWN_ALTERNATIVES]) + ", ..." * (len(near) > SHOWN_ALTERNATIVES)
    return f"undecided: {misfit}, but fits about as well with {listed}" if near else ""


def _zeros(reading: Reading) -> str:
    """Zeros that fit better though the misfit is small, or that other motion would identify."""
    zeros = zero_offsets(reading)
    moved = {z: reading.with_zero(z.joint, z.value) for z in zeros if z.identifiable}
    rises = {z: other.log_likelihood - reading.log_likelihood for z, other in moved.items()}
    best = max(rises, key=lambda zero: rises[zero], default=None)
    if best is not None and rises[best] >= NOTICED_ZERO_RISE:
        least = max(rises[best] - DECISIVE_GAIN, NOTICED_ZERO_RISE)
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


def zero_bounds(reading: Reading) -> str:
    """How far zeros may be off in spite of a log, like `elbow 0.012 rad`, and which are unknown."""
    zeros = zero_offsets(reading)
    bounds = [
        f"{zero.name} {abs(zero.value) + Z95 * zero.std:.2g} {zero.unit}"
        for zero in zeros
        if zero.identifiable
    ]
    left = [zero.name for zero in zeros if not zero.identifiable]
    says = [f"within (95 %): {', '.join(bounds)}"] if bounds else []
    return "; ".join([*says, f"not identifiable: {', '.join(left)}"] if left else says)


def misfit_hides(decision: LogVerdict) -> bool:
    """Whether the misfit is large, and not one of the model file's link inertias alone."""
    last = decision.last.reading
    if last.percent <= CLEAN:
        return False
    bodies = None if last.knowledge.identified else consistent_bodies(last)
    return bodies is None or float(bodies.percent) > FAIR_BODIES_MISFIT


def _hidden_mass(reading: Reading) -> str:
    """The payload that the arm may carry unseen, or carries by the best fit; empty if small."""
    columns = reading.knowledge.payload(*reading.motion(), reading.gravity)
    fitted = payload_fit(reading)
    mass = max(_size(reading, columns[0]), 0.0 if fitted is None else float(fitted.values[0]))
    return f"{mass:.2g} kg at the last link" if mass > least_mass(reading.knowledge) else ""


def _hidden_tilt(reading: Reading) -> str:
    """The tilt of gravity about the worst axis that may be there unseen; empty if small."""
    gravity, size, tilt = reading.gravity, float(np.linalg.norm(reading.gravity)), np.pi
    if size > 0.0:
        pulls = reading.knowledge.pulls(reading.motion()[0])
        across = np.linalg.svd(gravity[None])[2][1:]
        columns = size * np.einsum("ai,ijt->ajt", across, pulls)
        tilt = float(np.arctan(max(_size(reading, column) for column in columns)))
    return f"a tilt by {np.rad2deg(tilt):.0f}°" if tilt > NEAR_AXIS_ANGLE else ""


def _size(reading: Reading, column: Array) -> float:
    """What a number of joint efforts `(n, N)` per unit may be at most, by its best joint."""
    e, unit, score = reading.efforts(), reading.into_logged() @ column, reading.score
    moving = reading.columns()[1] > 0.0
    left, shown = np.full(len(e), np.inf), np.ones(len(e))
    for j in np.flatnonzero(score.counts > 0.0):
        left[j] = score.misfits[j] * np.sqrt(np.mean(np.square(e[j, moving[j]])))
        shown[j] = max(float(np.std(unit[j, moving[j]])), 1e-12)
    return float(np.min(left / shown))


def _gains(reading: Reading, misfit: str) -> str:
    weak, names = poorly_identified(reading), reading.likelihood.names
    if not weak:
        return ""
    listed, rest = (
        ", ".join(f"'{name}'" for name in names if (name in weak) == is_weak)
        for is_weak in (True, False)
    )
    if not rest:
        return f"undecided: {misfit} also with very different gains"
    return (
        f"undecided for {listed}: very different gains fit the nominal model as well; no error "
        f"in the gains of {rest}"
    )


def _times(reading: Reading) -> list[str]:
    """Delays that bodies of the log's own do not contradict."""
    size, now = LEAST_DELAY[False], consistent_bodies(reading)
    near = []
    for more, way in ((size, "late"), (-size, "early")):
        other = consistent_bodies(reading.changed(delay=reading.delay + more))
        if now is None or other is None or other.score.sharp > now.score.sharp - LATE_MARGIN:
            near.append(f"efforts {1e3 * size:.0f} ms {way}")
    return near


def _alternatives(reading: Reading, cause: str) -> Iterator[Hypothesis]:
    names, n = reading.likelihood.names, len(reading.effort)
    every = tuple(range(n))
    if cause == "position sign":
        for j, name in enumerate(names):
            says = f"'{name}' with the opposite sign"
            yield Hypothesis(cause, says, reading.with_turned([j]), 0.0, (j,))
    elif cause == "effort sign":
        signs = {f"the opposite sign of '{name}'": (j,) for j, name in enumerate(names)}
        for says, joints in {**signs, "the opposite sign of all": every}.items():
            turned = reading.with_factors(np.where(np.isin(every, joints), -1.0, 1.0))
            yield Hypothesis(cause, says, turned, 0.0, joints)
    elif cause in ("effort unit", "effort kind"):
        size = 1000.0 if cause == "effort unit" else HEAVIEST_FACTOR
        for factor in (size, 1.0 / size):
            changed = reading.with_factors(np.full(n, factor))
            yield Hypothesis(cause, f"efforts times {factor:.3g}", changed, 0.0, every)
    elif cause == "joint order":
        for a, b in combinations(range(n), 2):
            order = list(range(n))
            order[a], order[b] = b, a
            for what, positions, efforts in (
                ("positions of ", True, False),
                ("efforts of ", False, True),
                ("", True, True),
            ):
                says = f"{what}'{names[a]}' and '{names[b]}' exchanged"
                changed = reading.ordered(order, positions=positions, efforts=efforts)
                yield Hypothesis(cause, says, changed, 0.0, (a, b))
