"""Findings of the checks that share the ranking: one fault, one alarm."""

from collections.abc import Callable, Iterator

import numpy as np

from steelyard.check.case import Case, Evidence
from steelyard.check.decision.decidable import misfit_hides, undecided
from steelyard.check.decision.edits import confirmed, edits_of, velocity_edits
from steelyard.check.decision.gain_sources import unwritten_number_advice
from steelyard.check.decision.ranking import HOPELESS_MISFIT, known_of
from steelyard.check.decision.support import bodies_that_explain, friction_alone_explains
from steelyard.check.decision.verdict import CLEAN, ROUGH_MISFIT, LogVerdict, judge_log, last_winner
from steelyard.check.finding import ComparedHypothesis, Edit, Finding, Fix, Picture, Severity, Trace
from steelyard.check.hypotheses.bodies import consistent_bodies
from steelyard.check.hypotheses.friction_evidence import friction_alone
from steelyard.check.hypotheses.likelihood import Hypothesis
from steelyard.check.signals.overview import cached_per_log

EMPTY_MISFIT = 0.5
"""Typical misfit of an interpretation that predicts next to nothing."""
SHOWN_HYPOTHESES = 6
"""Hypotheses that are shown."""
PICTURE_POINTS = 1500
WHOLE_PERCENT_MISFIT = 100.0
"""Misfit from which on no decimals are printed [%]."""
LARGEST_PRINTED_MISFIT = 1000.0
"""Misfit beyond which the number says no more [%]."""
UNEXPLAINED_CHECK = "effort kind"
"""The check that says so where nothing explains the efforts."""
NO_HYPOTHESIS = (
    "no single hypothesis explains these efforts: check columns, kind, unit, gains, and locked "
    "joints with their positions, or the model file is of another robot; a model from runs "
    "known to be correct (--model) allows more conclusions"
)
OF_NOMINAL = (
    ", with the masses of the model file, which may be wrong: take the ratio from the data sheet, "
    "or give a model from runs known to be correct (--model)"
)
UNKNOWN_BODIES = "undecided: the robot's model gives no masses; give --model"


@cached_per_log
def edits(case: Case, evidence: Evidence) -> tuple[Edit, ...]:
    """All edits that correct the robot file for one log; none if they do not do so together."""
    decision = judge_log(case, evidence)
    if decision is None or not decision.written:
        return ()
    last = decision.written[-1].interpretation
    causes = dict.fromkeys(hypothesis.cause for hypothesis in decision.written)
    found = [e for c in causes for e in edits_of(c, decision.ranking.likelihood, last, case.loaded)]
    found += velocity_edits(evidence, decision.ranking.likelihood, last)
    whole = tuple({edit.path: edit for edit in found}.values())
    return whole if confirmed(case, evidence, whole, decision) else ()


def findings(
    case: Case, cause: str, fine: Callable[[LogVerdict], str], advice: str
) -> tuple[Finding, ...]:
    """One finding per log that can be tried; one for all if nothing is known of the robot.

    Args:
        case: What there is.
        cause: The check's name, and that of the hypotheses that are its own.
        fine: What to say where nothing is wrong.
        advice: What to do about a winner.
    """
    if known_of(case) is None:
        text = "no masses, no reference"
        return (Finding(cause, "", Severity.OK, UNKNOWN_BODIES, text, answered=False),)
    found: list[Finding] = []
    for evidence in case.logs:
        decision = judge_log(case, evidence)
        if decision is not None and not decision.alien:
            found += _of_log(case, evidence, decision, cause, fine, advice)
    return tuple(found)


def _of_log(
    case: Case,
    evidence: Evidence,
    decision: LogVerdict,
    cause: str,
    fine: Callable[[LogVerdict], str],
    advice: str,
) -> Iterator[Finding]:
    shown, nominal = (
        hypotheses(decision, cause),
        not decision.ranking.likelihood.knowledge.identified,
    )
    mine = [(number, w) for number, w in enumerate(decision.winners) if w[0].cause == cause]
    if not mine:
        unexplained = cause == UNEXPLAINED_CHECK and nothing_explains(decision)
        unclear = undecided(decision, cause) if has_finding(decision) else ""
        answered = has_finding(decision) and not unclear
        yield Finding(
            cause,
            evidence.name,
            Severity.DOUBTFUL if unexplained else Severity.OK,
            unclear or fine(decision),
            _worst(case, decision) if unexplained else value_text(decision, cause),
            fix=Fix(NO_HYPOTHESIS) if unexplained else None,
            hypotheses=shown,
            nominal=nominal,
            answered=answered,
            hidden=not answered and misfit_hides(decision),
        )
        return
    number, (hypothesis, severity) = mine[-1]
    before = decision.winners[number - 1][0] if number else decision.ranking.declared
    known, then, rise = _compared(decision, hypothesis, before)
    fix, severity = _fix(case, evidence, decision, hypothesis, severity, advice)
    yield Finding(
        cause,
        evidence.name,
        severity,
        f"{hypothesis.says}: misfit of {known} {_percent(hypothesis.percent)}, "
        f"{'without' if number and hypothesis.compared is None else 'as declared'} "
        f"{_percent(then)}",
        f"misfit {_percent(then)} falls to {_percent(hypothesis.percent)}{rise}",
        tuple(case.joints[j] for j in hypothesis.joints),
        fix,
        picture(decision, before, hypothesis),
        shown,
        nominal,
        answered=bool(severity),
    )


def _compared(
    decision: LogVerdict, hypothesis: Hypothesis, before: Hypothesis
) -> tuple[str, float, str]:
    """What a winner agrees with, the misfit before it [%], both of the same, and the gain."""
    if hypothesis.compared is not None:
        return *hypothesis.compared, ""
    score = decision.ranking.likelihood.score(before.interpretation)
    rise = hypothesis.log_likelihood - float(score.log_likelihood[0])
    percent = float(score.percent[0])
    return _known(decision), percent, f", log-likelihood rises by {rise:.0f}" * (rise > 0.0)


def _fix(
    case: Case,
    evidence: Evidence,
    decision: LogVerdict,
    hypothesis: Hypothesis,
    severity: Severity,
    advice: str,
) -> tuple[Fix | None, Severity]:
    """The advice with its edits, which the first finding of a log carries for the velocities."""
    if not severity:
        return None, severity
    if not hypothesis.fixed and np.any(hypothesis.interpretation.ratios != 1.0):
        return Fix(f"{hypothesis.says}{OF_NOMINAL}"), severity
    if not hypothesis.fixed:
        return unwritten_number_advice(case, hypothesis, sure=severity is Severity.WRONG), severity
    last, likelihood = decision.written[-1].interpretation, decision.ranking.likelihood
    wanted = edits_of(hypothesis.cause, likelihood, last, case.loaded)
    whole = edits(case, evidence)
    if wanted and not whole:
        says = f"{hypothesis.says}; no line of the robot file corrects it: examine the log"
        return Fix(says), Severity.DOUBTFUL
    paths = {edit.path for edit in wanted}
    if hypothesis.cause in ("joint order", "position sign"):
        paths |= {("signals", "velocity"), ("signals", "velocity_sign")}
    mine = tuple(edit for edit in whole if edit.path in paths)
    return Fix(f"{hypothesis.says}: {advice}", mine, bool(mine)), severity


def hypotheses(decision: LogVerdict, cause: str) -> tuple[ComparedHypothesis, ...]:
    """The likeliest hypotheses, with the declared interpretation and this cause's own best one."""
    ranked = decision.ranking
    hypotheses = ranked.rounds[0]
    mine = [r for r in hypotheses if r.cause == cause][:2]
    shown = {id(r): r for r in (*hypotheses[: SHOWN_HYPOTHESES - 2], ranked.declared, *mine)}
    ordered = sorted(shown.values(), key=lambda r: -r.log_likelihood)
    top = ordered[0].log_likelihood
    return tuple(
        ComparedHypothesis(r.says, r.percent, r.log_likelihood - top, r is ranked.declared)
        for r in ordered
    )


def _worst(case: Case, decision: LogVerdict) -> str:
    """The joint that disagrees most."""
    misfits = decision.ranking.declared.misfits
    joint = int(np.argmax(misfits))
    return (
        f"misfit of {case.joints[joint]} {_percent(100.0 * misfits[joint])}, at most 90 % allowed"
    )


def _percent(value: float) -> str:
    if value >= LARGEST_PRINTED_MISFIT:
        return f"more than {LARGEST_PRINTED_MISFIT:.0f} %"
    return f"{value:.1f} %" if value < WHOLE_PERCENT_MISFIT else f"{value:.0f} %"


def value_text(decision: LogVerdict, cause: str) -> str:
    """The misfit, and that of the next best explanation of this kind."""
    ranked = decision.ranking
    mine = [r for r in ranked.rounds[0] if r.cause == cause]
    text = f"misfit {ranked.declared.percent:.1f} %"
    return (
        f"{text}; best alternative of this check ({mine[0].says}): {mine[0].percent:.1f} %"
        if mine
        else text
    )


def picture(decision: LogVerdict, before: Hypothesis, after: Hypothesis) -> Picture:
    """Effort of the joint that gains most: measured, and as it should be."""
    likelihood = decision.ranking.likelihood
    joint = int(np.argmax(before.misfits / np.maximum(after.misfits, 1e-3)))
    t, e, wrong = likelihood.compared(before.interpretation, joint)
    _, corrected, right = likelihood.compared(after.interpretation, joint)
    step = max(1, len(t) // PICTURE_POINTS)
    name = likelihood.knowledge.robot.joint_names[joint]
    traces = [Trace("measured", t[::step], e[::step]), Trace(before.says, t[::step], wrong[::step])]
    if not np.allclose(corrected, e):
        traces.append(Trace("measured, corrected", t[::step], corrected[::step]))
    traces.append(Trace(after.says, t[::step], right[::step]))
    return Picture("time [s]", f"effort of '{name}'", tuple(traces))


def _unclear(decision: LogVerdict) -> str:
    """Why nothing explains a log."""
    likelihood, interpretation = (
        decision.ranking.likelihood,
        decision.ranking.declared.interpretation,
    )
    bodies = bodies_that_explain(likelihood, interpretation)
    if bodies is not None:
        return (
            "with other link inertias than the model file's the misfit is "
            f"{_percent(bodies.percent)}"
        )
    bodies = consistent_bodies(likelihood, interpretation)
    if bodies is None or not friction_alone_explains(likelihood, interpretation, bodies):
        return "no hypothesis is clearly better"
    alone = float(friction_alone(likelihood, interpretation).percent)
    return (
        f"the efforts contain hardly any rigid-body torque: the misfit is {_percent(alone)} with "
        f"friction alone, {_percent(bodies.percent)} with free link inertias"
    )


def _known(decision: LogVerdict) -> str:
    identified = decision.ranking.likelihood.knowledge.identified
    return "the reference" if identified else "the nominal model"


def has_finding(decision: LogVerdict) -> bool:
    """Whether there is a finding about a log."""
    close = (
        decision.ranking.likelihood.knowledge.identified
        or decision.ranking.declared.percent <= ROUGH_MISFIT
    )
    return bool(decision.winners) or (decision.explained and close)


def nothing_explains(decision: LogVerdict) -> bool:
    """Whether nothing that was tried explains the efforts, not even roughly."""
    likelihood, declared = decision.ranking.likelihood, decision.ranking.declared
    seen = declared.score.counts > 0.0
    worst = float(np.max(declared.misfits[seen], initial=0.0))
    if has_finding(decision) or (
        worst <= HOPELESS_MISFIT and declared.percent <= 100.0 * EMPTY_MISFIT
    ):
        return False
    return (
        likelihood.knowledge.identified
        or bodies_that_explain(likelihood, declared.interpretation) is None
    )


def agreement_sentence(decision: LogVerdict, what: str) -> str:
    """The sentence where nothing is wrong, or where nothing can be concluded."""
    ranked = decision.ranking
    if not has_finding(decision):
        much = _percent(ranked.declared.percent)
        why = f"undecided: {_known(decision)} has a misfit of {much} and "
        if ranked.likelihood.knowledge.identified:
            return f"{why}no hypothesis is clearly better"
        return f"{why}{_unclear(decision)}; give --model"
    percent = float(ranked.likelihood.score(last_winner(decision).interpretation).percent[0])
    once = ""
    if decision.winners:
        written = all(hypothesis.fixed for hypothesis, _ in decision.winners)
        once = ", once the rest is corrected" if written else ", if the rest is as stated"
    high = "" if percent <= CLEAN else "high "
    return f"{what} ({high}misfit of {_known(decision)}: {percent:.1f} %{once})"
