"""Joint zeros 90° or 180° away, found by the masses of a model file.

A fit cannot always tell which of two joints is turned, as parameters of the links change with it:
the nominal masses can. They are asked only where they agree badly with a log as declared, and no
other hypothesis explains it.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from steelyard.arrays import Array
from steelyard.diagnosis.case import Case, Evidence
from steelyard.diagnosis.decision.ranking import DECISIVE, known_of
from steelyard.diagnosis.decision.verdict import CLEAN, STRIKING, Verdict, last_of, verdict
from steelyard.diagnosis.finding import ComparedHypothesis, Edit, Finding, Fix, Severity
from steelyard.diagnosis.hypotheses.by_zero import CAUSE, moved
from steelyard.diagnosis.likelihood.likelihood import Score
from steelyard.diagnosis.turned_zeros import IF_CONFIRMED, Turned, turns

FALL = 2.0
"""Factor by which the misfit must fall: on logs of five sound robots it falls by 1.02."""


def quarter_turns(case: Case) -> Iterator[Finding]:
    """A doubtful finding per log that the nominal model explains with turned zeros alone."""
    known = known_of(case)
    if known is None or known.identified or known.robot.passive:
        return
    for evidence in case.logs:
        decision = verdict(case, evidence)
        if decision is None or decision.alien or decision.winners:
            continue
        if not any(evidence.recording.signals.unknown_offsets):
            yield from _found(case, evidence, decision)


def turned_joints(findings: Sequence[Finding]) -> tuple[Finding, ...]:
    """What limits a fit: zeros that the check before found to be turned, once for all logs."""
    found = [f for f in findings if f.check == CAUSE and f.severity and f.hypotheses]
    return tuple(replace(f, log="", figure="") for f in found[:1])


def _found(case: Case, evidence: Evidence, decision: Verdict) -> Iterator[Finding]:
    now, scores = _scores(decision)
    if not scores:
        return
    near = _best_ones(scores)
    best = near[0]
    before, after = float(now.percent[0]), float(scores[best].percent[0])
    rise = _likely(scores[best]) - _likely(now)
    if rise < STRIKING or after > min(CLEAN, before / FALL):
        return
    words = " or ".join(_words(case, turned) for turned in near)
    yield Finding(
        CAUSE,
        evidence.name,
        Severity.DOUBTFUL,
        f"joint zeros other than those of the model file: {words}: misfit of the nominal model "
        f"{after:.1f} %, as declared {before:.1f} %",
        f"misfit {before:.1f} % falls to {after:.1f} %, log-likelihood {rise:+.0f}",
        tuple(case.joints[k] for k, _ in best),
        _fix(evidence, best, alone=len(near) == 1),
        hypotheses=(
            ComparedHypothesis(_words(case, best), after, 0.0),
            ComparedHypothesis("as declared", before, -rise, declared=True),
        ),
        nominal=True,
    )


def _scores(decision: Verdict) -> tuple[Score, dict[Turned, Score]]:
    """The score as declared, and those of turned zeros of one joint or of neighbours."""
    likelihood, declared = decision.ranking.likelihood, last_of(decision).interpretation
    units = [coordinate.unit for coordinate in likelihood.knowledge.robot.coordinates]
    turning = [k for k, unit in enumerate(units) if unit == "rad"]
    found = {}
    for turned in (x for joints in (1, 2) for x in turns(turning, joints)):
        other = declared
        for joint, turn in turned:
            other = moved(other, joint, turn)
        found[turned] = likelihood.score(other)
    return likelihood.score(declared), found


def _best_ones(scores: dict[Turned, Score]) -> list[Turned]:
    """Turns that fit about as well as any, the best first; none with a joint more than it needs."""
    least = max(map(_likely, scores.values())) - DECISIVE
    near = sorted(
        (x for x in scores if _likely(scores[x]) > least), key=lambda x: -_likely(scores[x])
    )
    return [x for x in near if not any(set(y) < set(x) for y in near)]


def _likely(score: Score) -> float:
    return float(score.log_likelihood[0])


def _words(case: Case, turned: Turned) -> str:
    return ", ".join(f"{case.joints[k]} {np.rad2deg(turn):+.0f}°" for k, turn in turned)


def _fix(evidence: Evidence, turned: Turned, *, alone: bool) -> Fix:
    """The line of the robot file, where no other one explains the log about as well."""
    given = evidence.recording.signals.position_offset
    offsets: Array = np.zeros(evidence.recording.signals.n) if given is None else given.copy()
    for joint, turn in turned:
        offsets[joint] += turn
    values = [round(value, 4) + 0.0 for value in offsets.tolist()]
    line = (Edit(("signals", "position_offset"), values),) if alone else ()
    return Fix(f"Set position_offset in [signals], {IF_CONFIRMED}", line)
