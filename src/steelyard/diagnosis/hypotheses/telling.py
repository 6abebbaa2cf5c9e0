"""Findings of the suspicions that share the ranking: one fault, one alarm."""

from collections.abc import Callable, Iterator

import numpy as np

from steelyard.diagnosis.case import Case, Evidence
from steelyard.diagnosis.finding import Edit, Finding, Hypothesis, Judgement, Mend, Picture, Trace
from steelyard.diagnosis.hypotheses.confirm import confirmed
from steelyard.diagnosis.hypotheses.decided import undecided
from steelyard.diagnosis.hypotheses.mends import edits_of
from steelyard.diagnosis.hypotheses.possible import possible
from steelyard.diagnosis.hypotheses.ranking import HOPELESS, known_of
from steelyard.diagnosis.hypotheses.rival import Rival
from steelyard.diagnosis.hypotheses.rivals_friction import friction_alone
from steelyard.diagnosis.hypotheses.support import no_bodies, other_bodies
from steelyard.diagnosis.hypotheses.velocities import velocity_edits
from steelyard.diagnosis.hypotheses.verdict import CLEAN, ROUGH, Verdict, last_of, verdict
from steelyard.diagnosis.hypotheses.ways import ways
from steelyard.diagnosis.signal_overview import once

HALF = 0.5
"""Typical misfit of a reading that predicts next to nothing."""
SHOWN = 6
"""Rivals that are shown."""
POINTS = 1500
WHOLE = 100.0
"""Misfit from which on no decimals are printed [%]."""
MUCH = 1000.0
"""Misfit beyond which the number says no more [%]."""
UNEXPLAINED = "effort kind"
"""The suspicion that says so where nothing explains the efforts."""
LOST = (
    "no single hypothesis explains these efforts: check columns, kind, unit and gains, and which "
    "joints are locked where; a model from clean runs (--model) tells more"
)
OF_NOMINAL = (
    ", with the masses of the model file, which may be wrong: take the ratio from the data sheet, "
    "or give a model from clean runs (--model)"
)
UNKNOWN = "undecided: the robot's model gives no masses; give --model"


@once
def edits(case: Case, evidence: Evidence) -> tuple[Edit, ...]:
    """All edits that mend the robot file for one log; none if they do not do what they should."""
    held = verdict(case, evidence)
    if held is None or not held.written:
        return ()
    last = held.written[-1].reading
    causes = dict.fromkeys(rival.cause for rival in held.written)
    found = [e for c in causes for e in edits_of(c, held.ranking.trial, last, case.loaded)]
    found += velocity_edits(evidence, held.ranking.trial, last)
    whole = tuple({edit.path: edit for edit in found}.values())
    return whole if confirmed(case, evidence, whole, held) else ()


def findings(
    case: Case, cause: str, fine: Callable[[Verdict], str], advice: str
) -> tuple[Finding, ...]:
    """One finding per log that can be tried; one for all if nothing is known of the robot.

    Args:
        case: What there is.
        cause: The suspicion's name, and that of the rivals that are its own.
        fine: What to say where nothing is wrong.
        advice: What to do about a winner.
    """
    if known_of(case) is None:
        figure_of = "no masses, no reference"
        return (Finding(cause, "", Judgement.OK, UNKNOWN, figure_of, answered=False),)
    found: list[Finding] = []
    for evidence in case.logs:
        held = verdict(case, evidence)
        if held is not None and not held.alien:
            found += _of_log(case, evidence, held, cause, fine, advice)
    return tuple(found)


def _of_log(
    case: Case,
    evidence: Evidence,
    held: Verdict,
    cause: str,
    fine: Callable[[Verdict], str],
    advice: str,
) -> Iterator[Finding]:
    shown, nominal = hypotheses(held, cause), not held.ranking.trial.knowledge.identified
    mine = [(number, w) for number, w in enumerate(held.winners) if w[0].cause == cause]
    if not mine:
        lost = cause == UNEXPLAINED and hopeless(held)
        unclear = undecided(held, cause) if told(held) else ""
        yield Finding(
            cause,
            evidence.name,
            Judgement.DOUBTFUL if lost else Judgement.OK,
            unclear or fine(held),
            _worst(case, held) if lost else figure(held, cause),
            mend=Mend(LOST) if lost else None,
            hypotheses=shown,
            nominal=nominal,
            answered=told(held) and not unclear,
        )
        return
    number, (rival, judgement) = mine[-1]
    before = held.winners[number - 1][0] if number else held.ranking.declared
    known, then, rise = _compared(held, rival, before)
    mend, judgement = _mend(case, evidence, held, rival, judgement, advice)
    yield Finding(
        cause,
        evidence.name,
        judgement,
        f"{rival.says}: agrees with {known} to {_percent(rival.percent)}, "
        f"{'without' if number and rival.compared is None else 'as declared'} {_percent(then)}",
        f"misfit {_percent(then)} falls to {_percent(rival.percent)}{rise}",
        tuple(case.joints[j] for j in rival.joints),
        mend,
        picture(held, before, rival),
        shown,
        nominal,
        answered=bool(judgement),
    )


def _compared(held: Verdict, rival: Rival, before: Rival) -> tuple[str, float, str]:
    """What a winner agrees with, the misfit before it [%], both of the same, and the gain."""
    if rival.compared is not None:
        return *rival.compared, ""
    score = held.ranking.trial.score(before.reading)
    rise = rival.log_likelihood - float(score.log_likelihood[0])
    percent = float(score.percent[0])
    return _known(held), percent, f", log-likelihood rises by {rise:.0f}" * (rise > 0.0)


def _mend(
    case: Case,
    evidence: Evidence,
    held: Verdict,
    rival: Rival,
    judgement: Judgement,
    advice: str,
) -> tuple[Mend | None, Judgement]:
    """The advice with its edits, which the first finding of a log carries for the velocities."""
    if not judgement:
        return None, judgement
    if not rival.fixed and np.any(rival.reading.ratios != 1.0):
        return Mend(f"{rival.says}{OF_NOMINAL}"), judgement
    if not rival.fixed:
        return ways(case, rival, sure=judgement is Judgement.WRONG), judgement
    last, trial = held.written[-1].reading, held.ranking.trial
    wanted = edits_of(rival.cause, trial, last, case.loaded)
    whole = edits(case, evidence)
    if wanted and not whole:
        says = f"{rival.says}; no line of the robot file corrects it: examine the log"
        return Mend(says), Judgement.DOUBTFUL
    paths = {edit.path for edit in wanted}
    if rival.cause in ("joint order", "position sign"):
        paths |= {("signals", "velocity"), ("signals", "velocity_sign")}
    mine = tuple(edit for edit in whole if edit.path in paths)
    return Mend(f"{rival.says}: {advice}", mine, bool(mine)), judgement


def hypotheses(held: Verdict, cause: str) -> tuple[Hypothesis, ...]:
    """The likeliest rivals, with the declared reading and this cause's own best one."""
    ranked = held.ranking
    rivals = ranked.rounds[0]
    mine = [r for r in rivals if r.cause == cause][:2]
    shown = {id(r): r for r in (*rivals[: SHOWN - 2], ranked.declared, *mine)}
    ordered = sorted(shown.values(), key=lambda r: -r.log_likelihood)
    top = ordered[0].log_likelihood
    return tuple(
        Hypothesis(r.says, r.percent, r.log_likelihood - top, r is ranked.declared) for r in ordered
    )


def _worst(case: Case, held: Verdict) -> str:
    """The joint that disagrees most."""
    misfits = held.ranking.declared.misfits
    joint = int(np.argmax(misfits))
    return f"misfit of {case.joints[joint]} {_percent(100.0 * misfits[joint])}, bound 90 %"


def _percent(value: float) -> str:
    if value >= MUCH:
        return f"more than {MUCH:.0f} %"
    return f"{value:.1f} %" if value < WHOLE else f"{value:.0f} %"


def figure(held: Verdict, cause: str) -> str:
    """The misfit, and that of the next best explanation of this kind."""
    ranked = held.ranking
    mine = [r for r in ranked.rounds[0] if r.cause == cause]
    text = f"misfit {ranked.declared.percent:.1f} %"
    return f"{text}, {mine[0].says}: {mine[0].percent:.1f} %" if mine else text


def picture(held: Verdict, before: Rival, after: Rival) -> Picture:
    """Effort of the joint that gains most: measured, and as it should be."""
    trial = held.ranking.trial
    joint = int(np.argmax(before.misfits / np.maximum(after.misfits, 1e-3)))
    t, e, wrong = trial.compared(before.reading, joint)
    _, mended, right = trial.compared(after.reading, joint)
    step = max(1, len(t) // POINTS)
    name = trial.knowledge.robot.joint_names[joint]
    traces = [Trace("measured", t[::step], e[::step]), Trace(before.says, t[::step], wrong[::step])]
    if not np.allclose(mended, e):
        traces.append(Trace("measured, corrected", t[::step], mended[::step]))
    traces.append(Trace(after.says, t[::step], right[::step]))
    return Picture("time [s]", f"effort of '{name}'", tuple(traces))


def _unclear(held: Verdict) -> str:
    """Why nothing explains a log."""
    trial, reading = held.ranking.trial, held.ranking.declared.reading
    bodies = other_bodies(trial, reading)
    if bodies is not None:
        return f"bodies that are not the model file's agree to {_percent(bodies.percent)}"
    bodies = possible(trial, reading)
    if bodies is None or not no_bodies(trial, reading, bodies):
        return "no hypothesis is clearly better"
    alone = float(friction_alone(trial, reading).percent)
    return (
        f"the efforts contain hardly any rigid-body torque: friction alone leaves "
        f"{_percent(alone)}, with bodies of any mass {_percent(bodies.percent)}"
    )


def _known(held: Verdict) -> str:
    identified = held.ranking.trial.knowledge.identified
    return "the reference" if identified else "the nominal model"


def told(held: Verdict) -> bool:
    """Whether anything can be said of a log."""
    close = held.ranking.trial.knowledge.identified or held.ranking.declared.percent <= ROUGH
    return bool(held.winners) or (held.explained and close)


def hopeless(held: Verdict) -> bool:
    """Whether nothing that was tried explains the efforts, not even roughly."""
    trial, declared = held.ranking.trial, held.ranking.declared
    seen = declared.score.counts > 0.0
    worst = float(np.max(declared.misfits[seen], initial=0.0))
    if told(held) or (worst <= HOPELESS and declared.percent <= 100.0 * HALF):
        return False
    return trial.knowledge.identified or other_bodies(trial, declared.reading) is None


def agrees(held: Verdict, what: str) -> str:
    """What to say where nothing is wrong, or where nothing can be said."""
    ranked = held.ranking
    if not told(held):
        much = _percent(ranked.declared.percent)
        why = f"undecided: {_known(held)} disagrees by {much} and "
        if ranked.trial.knowledge.identified:
            return f"{why}no hypothesis is clearly better"
        return f"{why}{_unclear(held)}; give --model"
    percent = float(ranked.trial.score(last_of(held).reading).percent[0])
    once = ""
    if held.winners:
        written = all(rival.fixed for rival, _ in held.winners)
        once = ", once the rest is corrected" if written else ", if the rest is as stated"
    close = "" if percent <= CLEAN else "only "
    return f"{what} ({_known(held)} agrees {close}to {percent:.1f} %{once})"
