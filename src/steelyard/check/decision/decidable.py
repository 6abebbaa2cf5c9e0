r"""Which questions a nominal model can answer where it finds nothing wrong.

Its misfit may come from wrong masses, or hide the fault. A question with a size (payload,
tilt of gravity) is answered if that size alone could not make the misfit: for the effort per unit
$c_j(t)$, and what is left of joint j's effort, $r_j(t)$, at most about

$$ \min_j \operatorname{rms}(r_j) / \operatorname{std}(c_j) $$

can be there, given the masses. A question with alternatives (signs, orders, units) is answered if
each of them agrees clearly worse.
"""

from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array
from steelyard.check.decision.gain_sources import CAUSES_THAT_SCALE
from steelyard.check.decision.ranking import DECISIVE_GAIN
from steelyard.check.decision.support import FAIR_BODIES_MISFIT, HEAVIEST_FACTOR, LATE_MARGIN
from steelyard.check.decision.verdict import (
    CLEAN,
    LEAST_DELAY,
    LEAST_MASS,
    LEAST_SHARE,
    LogVerdict,
    last_winner,
)
from steelyard.check.fitted.zero_offsets import zeros_without_effect
from steelyard.check.hypotheses.bodies import ConsistentBodies, consistent_bodies
from steelyard.check.hypotheses.effort_columns import poorly_identified
from steelyard.check.hypotheses.excerpt import Interpretation
from steelyard.check.hypotheses.likelihood import Likelihood, LikelihoodScore, regressors
from steelyard.check.hypotheses.position_columns import (
    ZERO_CAUSE,
    Draft,
    JointZero,
    scored_drafts,
    with_moved_zero,
    zero_offsets,
)
from steelyard.check.hypotheses.surroundings import NEAR_AXIS_ANGLE, SHARP_DELAY_FLOOR, payload_fit
from steelyard.estimate.estimate import Z95

SHOWN_ALTERNATIVES = 3
"""Alternatives that are named."""

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
    """Why a nominal model cannot answer a question; empty if it can.

    Args:
        decision: What holds of the log; nothing that is of this cause.
        cause: The check.
    """
    likelihood, last = decision.ranking.likelihood, last_winner(decision)
    if likelihood.knowledge.identified:
        return _zeros(likelihood, last.interpretation) if cause == ZERO_CAUSE else ""
    open_factor = [
        r.cause for r, _ in decision.winners if not r.fixed and r.cause in CAUSES_THAT_SCALE
    ]
    if open_factor and cause in (*CAUSES_THAT_SCALE, "payload"):
        return f"undecided until '{open_factor[-1]}' is decided"
    score = likelihood.score(last.interpretation)
    percent = float(score.percent[0])
    misfit = f"the nominal model with fitted friction has a misfit of {percent:.1f} %"
    if cause in UNKNOWN_GAINS and any(likelihood.signals.unknown_gains):
        return UNKNOWN_GAINS[cause]
    if cause in ("payload", "mounting"):
        return _hidden(likelihood, last.interpretation, score, cause, misfit)
    if cause == "gain":
        return _gains(likelihood, last.interpretation, misfit)
    if cause == "effort delay":
        near = _times(likelihood, last.interpretation)
        misfit = "the declared interpretation fits with free link inertias"
    else:
        near = _near(likelihood, last.interpretation, score, cause)
    listed = ", ".join(near[:SHOWN_ALTERNATIVES]) + ", ..." * (len(near) > SHOWN_ALTERNATIVES)
    return f"undecided: {misfit}, but fits about as well with {listed}" if near else ""


def _zeros(likelihood: Likelihood, interpretation: Interpretation) -> str:
    """That zeros of some joints are not identifiable, though other motion would identify them."""
    zeros = zero_offsets(likelihood, interpretation)
    if moved_zeros := _moved_zeros(likelihood, interpretation, zeros):
        return moved_zeros
    never = zeros_without_effect(likelihood.knowledge.robot)
    left = [z.name for z in zeros if not z.identifiable and not never[z.joint]]
    if not left:
        return ""
    rest = ", ".join(zero.name for zero in zeros if zero.identifiable)
    says = f"undecided: not identifiable from these data: {', '.join(left)}"
    return f"{says}; no significant zero offset of {rest}" if rest else says


def _moved_zeros(
    likelihood: Likelihood, interpretation: Interpretation, zeros: Sequence[JointZero]
) -> str:
    """Zero offsets that fit better, though the misfit without them is small."""
    scores = {
        zero: likelihood.score(with_moved_zero(interpretation, zero.joint, zero.value))
        for zero in zeros
        if zero.identifiable
    }
    before = likelihood.score(interpretation)
    rises = {z: float((s.log_likelihood - before.log_likelihood)[0]) for z, s in scores.items()}
    best = max(rises, key=lambda zero: rises[zero], default=None)
    if best is None or rises[best] < NOTICED_ZERO_RISE:
        return ""
    least = max(rises[best] - DECISIVE_GAIN, NOTICED_ZERO_RISE)
    alike = [z.words for z, r in rises.items() if z is not best and r > least]
    others = f" (or of {', '.join(alike)})" if alike else ""
    return (
        f"undecided: with a zero offset of {best.words}{others} the misfit falls from "
        f"{float(before.percent[0]):.2g} to {float(scores[best].percent[0]):.2g} %; compare the "
        "zeros with the robot"
    )


def zero_bounds(likelihood: Likelihood, interpretation: Interpretation) -> str:
    """How far zeros may be off in spite of a log, like `elbow 0.012 rad`, and which are unknown."""
    zeros = zero_offsets(likelihood, interpretation)
    bounds = [
        f"{zero.name} {abs(zero.value) + Z95 * zero.std:.2g} {zero.unit}"
        for zero in zeros
        if zero.identifiable
    ]
    left = [zero.name for zero in zeros if not zero.identifiable]
    says = f"within (95 %): {', '.join(bounds)}" if bounds else ""
    return "; ".join(x for x in (says, f"not identifiable: {', '.join(left)}" if left else "") if x)


def misfit_hides(decision: LogVerdict) -> bool:
    """Whether the misfit is large, and not one of the model file's link inertias alone."""
    likelihood, last = decision.ranking.likelihood, last_winner(decision).interpretation
    if float(likelihood.score(last).percent[0]) <= CLEAN:
        return False
    bodies = None if likelihood.knowledge.identified else consistent_bodies(likelihood, last)
    return bodies is None or float(bodies.percent) > FAIR_BODIES_MISFIT


def _hidden(
    likelihood: Likelihood,
    interpretation: Interpretation,
    score: LikelihoodScore,
    cause: str,
    misfit: str,
) -> str:
    """The same where the misfit could hide a payload or a tilt."""
    if cause == "payload":
        mass = detectable_mass(likelihood, interpretation, score)
        hidden = mass > least_mass(likelihood)
        size = f"{mass:.2g} kg at the last link"
    else:
        tilt = detectable_tilt(likelihood, interpretation, score)
        hidden = tilt > NEAR_AXIS_ANGLE
        size = f"a tilt by {np.rad2deg(tilt):.0f}°"
    return f"undecided: {misfit}, which {size} may cause" if hidden else ""


def least_mass(likelihood: Likelihood) -> float:
    """Payload from which on one matters [kg]."""
    arm = sum(body.inertia.mass for body in likelihood.knowledge.robot.bodies)
    return max(LEAST_MASS, LEAST_SHARE * arm)


def detectable_mass(
    likelihood: Likelihood, interpretation: Interpretation, score: LikelihoodScore
) -> float:
    """Most that the arm may carry unseen, or carries by the best fit [kg]."""
    q, dq, ddq = likelihood.motion(interpretation)
    columns = likelihood.knowledge.payload(q, dq, ddq, interpretation.gravity)[:1]
    bound = _size(likelihood, interpretation, score, columns)
    fitted = payload_fit(likelihood, interpretation)
    return max(bound, 0.0 if fitted is None else float(fitted.values[0]))


def detectable_tilt(
    likelihood: Likelihood, interpretation: Interpretation, score: LikelihoodScore
) -> float:
    """Largest tilt of gravity that may be there unseen, about the worst axis [rad]."""
    gravity, size = interpretation.gravity, float(np.linalg.norm(interpretation.gravity))
    if size == 0.0:
        return float(np.pi)
    pulls = likelihood.knowledge.pulls(likelihood.motion(interpretation)[0])
    across = np.linalg.svd(gravity[None])[2][1:]
    columns = size * np.einsum("ai,ijt->ajt", across, pulls)
    return float(np.arctan(max(_size(likelihood, interpretation, score, c[None]) for c in columns)))


def _size(
    likelihood: Likelihood, interpretation: Interpretation, score: LikelihoodScore, columns: Array
) -> float:
    """What one number comes to if it makes all that is left, of the joint that shows it best.

    Args:
        likelihood: The log.
        interpretation: How it is read.
        score: Of that interpretation.
        columns: Joint efforts per unit, shape `(1, n, N)`.
    """
    moving = _moving(likelihood, interpretation)
    e = likelihood.excerpt.later([interpretation.delay])[0, list(interpretation.effort)]
    e = e * interpretation.effort_scale[:, None]
    unit = likelihood.into_logged(interpretation) @ columns[0]
    left, shown = np.full(len(e), np.inf), np.ones(len(e))
    for j in np.flatnonzero(score.counts[0] > 0.0):
        left[j] = score.misfits[0, j] * np.sqrt(np.mean(np.square(e[j, moving[j]])))
        shown[j] = max(float(np.std(unit[j, moving[j]])), 1e-12)
    return float(np.min(left / shown))


def _moving(likelihood: Likelihood, interpretation: Interpretation) -> NDArray[np.bool_]:
    q, dq, ddq = likelihood.motion(interpretation)
    u, du = likelihood.driven(dq), likelihood.driven(ddq)
    arrays = (x[:, None] for x in (q, u, du, np.zeros_like(q)))
    moving: NDArray[np.bool_] = regressors(*arrays)[1][:, 0] > 0.0
    return moving


def _gains(likelihood: Likelihood, interpretation: Interpretation, misfit: str) -> str:
    weak = poorly_identified(likelihood, interpretation)
    if not weak:
        return ""
    listed = ", ".join(f"'{name}'" for name in weak)
    names = likelihood.knowledge.robot.joint_names
    rest = [f"'{name}'" for name in names if name not in weak]
    if not rest:
        return f"undecided: {misfit} also with very different gains"
    return (
        f"undecided for {listed}: very different gains fit the nominal model as well; no error "
        f"in the gains of {', '.join(rest)}"
    )


def _near(
    likelihood: Likelihood, interpretation: Interpretation, score: LikelihoodScore, cause: str
) -> list[str]:
    """Alternatives that do not agree clearly worse than an interpretation."""
    least = float(score.log_likelihood[0]) - DECISIVE_GAIN
    seen = score.counts[0] > 0.0
    drafts = [d for d in _drafts(likelihood, interpretation, cause) if np.any(seen[list(d.joints)])]
    return [
        r.says for r in scored_drafts(likelihood, drafts) if float(r.score.log_likelihood) > least
    ]


def _times(likelihood: Likelihood, interpretation: Interpretation) -> list[str]:
    """Delays that bodies of the log's own do not contradict."""
    size, now = LEAST_DELAY[False], consistent_bodies(likelihood, interpretation)
    near = []
    for more, way in ((size, "late"), (-size, "early")):
        other = consistent_bodies(
            likelihood, interpretation.changed(delay=interpretation.delay + more)
        )
        if now is None or other is None or _sharp(other) > _sharp(now) - LATE_MARGIN:
            near.append(f"efforts {1e3 * size:.0f} ms {way}")
    return near


def _sharp(bodies: ConsistentBodies) -> float:
    return float(bodies.score.log_likelihood_with(SHARP_DELAY_FLOOR, np.inf))


def _drafts(likelihood: Likelihood, interpretation: Interpretation, cause: str) -> Iterator[Draft]:
    """The alternatives of a question."""
    names, n = likelihood.knowledge.robot.joint_names, likelihood.signals.n
    every = tuple(range(n))
    if cause == "position sign":
        for j, name in enumerate(names):
            changed = interpretation.changed(
                position_scale=_turned(n, j) * interpretation.position_scale
            )
            yield Draft(cause, f"'{name}' with the opposite sign", changed, 0.0, (j,))
    elif cause == "effort sign":
        for j, name in enumerate(names):
            changed = interpretation.with_factors(_turned(n, j))
            yield Draft(cause, f"the opposite sign of '{name}'", changed, 0.0, (j,))
        changed = interpretation.with_factors(-np.ones(n))
        yield Draft(cause, "the opposite sign of all", changed, 0.0, every)
    elif cause in ("effort unit", "effort kind"):
        size = 1000.0 if cause == "effort unit" else HEAVIEST_FACTOR
        for factor in (size, 1.0 / size):
            changed = interpretation.with_factors(np.full(n, factor))
            yield Draft(cause, f"efforts times {factor:.3g}", changed, 0.0, every)
    elif cause == "joint order":
        yield from _swaps(interpretation, names)


def _swaps(interpretation: Interpretation, names: tuple[str, ...]) -> Iterator[Draft]:
    for a, b in combinations(range(len(names)), 2):
        order = list(range(len(names)))
        order[a], order[b] = b, a
        position = tuple(interpretation.position[k] for k in order)
        effort = tuple(interpretation.effort[k] for k in order)
        pair = f"'{names[a]}' and '{names[b]}' exchanged"
        for what, changed in (
            ("positions of ", interpretation.changed(position=position)),
            ("efforts of ", interpretation.changed(effort=effort)),
            ("", interpretation.changed(position=position, effort=effort)),
        ):
            yield Draft("joint order", what + pair, changed, 0.0, (a, b))


def _turned(n: int, joint: int) -> Array:
    return np.where(np.arange(n) == joint, -1.0, 1.0)
