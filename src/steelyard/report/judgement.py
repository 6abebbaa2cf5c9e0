"""One sentence on what the validation shows, and no more than it shows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import isfinite
from statistics import fmean
from typing import TYPE_CHECKING, Literal

from steelyard.report.content import ReportContent
from steelyard.report.words import count, percent

if TYPE_CHECKING:
    from steelyard.diagnosis import Finding
    from steelyard.validation.score import JointScore, RunScore

Level = Literal["good", "fair", "poor", "none"]

GOOD = 10.0
"""Relative error [%] up to which a joint counts as well predicted."""

FAIR = 30.0
"""Relative error [%] up to which it counts as fairly predicted."""

SEVERITY: tuple[Level, ...] = ("good", "none", "fair", "poor")
"""Levels, the best first."""

LIMITED: dict[str, Level] = {"doubtful": "fair", "wrong": "poor"}
"""The best level that a limitation of this severity leaves."""

HOW_TO_VALIDATE = "steelyard identify ROBOT LOG... --validate OTHER_LOG"


@dataclass(frozen=True)
class Verdict:
    """A headline, the small print under it, how good it is, and what qualifies it.

    Attributes:
        headline: One sentence.
        detail: What it was computed from.
        level: No better than the worst limitation allows.
        limitations: Sentence and level of everything that was found against the model.
    """

    headline: str
    detail: str
    level: Level
    limitations: tuple[tuple[str, Level], ...] = ()


def level_of(relative_percent: float | None) -> Level:
    """How good a relative error [%] is; `none` if there is no number."""
    if relative_percent is None or relative_percent != relative_percent:
        return "none"
    return "good" if relative_percent <= GOOD else "fair" if relative_percent <= FAIR else "poor"


def told(joint: JointScore) -> float | None:
    """The error a joint is judged by: where it moves, or else over all samples [%]."""
    moving = joint.relative_percent_moving
    return joint.relative_percent if moving is None else moving


def verdict(content: ReportContent) -> Verdict:
    """The verdict of a report, no better than its limitations allow."""
    plain = _of_scores(content)
    found = tuple((_sentence(f), LIMITED[f.judgement.word]) for f in content.limitations)
    levels = (plain.level, *(level for _, level in found))
    return replace(plain, level=max(levels, key=SEVERITY.index), limitations=found)


def _sentence(finding: Finding) -> str:
    """What was found, where, and the evidence."""
    where = f"{finding.log}: " if finding.log else ""
    figure = f" ({finding.figure})" if finding.figure else ""
    advice = f". {finding.mend.says}" if finding.mend is not None else ""
    return f"{where}{finding.says}{figure}{advice}"


def _of_scores(content: ReportContent) -> Verdict:
    """The verdict of the scores alone."""
    if not content.scores:
        return _untested(content.fitted)
    moving = [run.mean_percent_moving for run in content.scores]
    known = [value for value in moving if value is not None]
    anywhere = fmean(run.mean_percent for run in content.scores)
    error = fmean(known) if known else anywhere
    detail = _detail(content.scores, bool(known), anywhere)
    if not isfinite(error):
        strange = [j.joint for run in content.scores for j in run.joints if not _finite(j)]
        return Verdict(
            "The error on unseen motion cannot be given as a percentage",
            f"No relative error of {', '.join(dict.fromkeys(strange))}: its measured effort is "
            f"zero or not a number. See the table. {detail}",
            "none",
        )
    if error >= 100.0:
        return Verdict(
            "Predicts unseen motion no better than predicting zero: the error is "
            f"{percent(error)} of the measured effort",
            detail,
            "poor",
        )
    return Verdict(
        f"Predicts unseen motion within {percent(error)} of the measured effort",
        detail,
        level_of(error),
    )


def _untested(fitted: Sequence[RunScore]) -> Verdict:
    """Without a run that was kept aside nothing is known about other motions."""
    fit = fmean(run.mean_percent for run in fitted) if fitted else None
    described = (
        ""
        if fit is None or not isfinite(fit)
        else f"The model describes {count(len(fitted), 'fitted run')} within {percent(fit)} of "
        "the measured effort, which says nothing yet about other motions. "
    )
    return Verdict(
        "Not tested on unseen motion",
        f"{described}To test it, log another motion and run: {HOW_TO_VALIDATE}",
        "none",
    )


def _detail(scores: Sequence[RunScore], moves: bool, anywhere: float) -> str:
    """Like `Mean over 6 joints, where they move; 16 % over the whole log. Run ptp, below 8 Hz.`."""
    joints = scores[0].joints
    moving = sum(
        any(run.joints[k].relative_percent_moving is not None for run in scores)
        for k in range(len(joints))
    )
    if moves:
        which = count(len(joints), "joint")
        if moving < len(joints):
            which = f"the {moving} of {len(joints)} joints that move"
        first = f"Mean over {which}, where they move; {percent(anywhere)} over the whole log."
    else:
        first = f"Mean over {count(len(joints), 'joint')}; no joint moves."
    one = len(scores) == 1
    runs = f"Run {scores[0].run}" if one else f"{len(scores)} runs"
    not_fitted = "not fitted" if one else "none of them fitted"
    cutoffs = sorted({run.cutoff for run in scores})
    below = " and ".join(f"{cutoff:g}" for cutoff in cutoffs)
    return f"{first} {runs}, {not_fitted}, compared below {below} Hz."


def _finite(joint: JointScore) -> bool:
    value = told(joint)
    return value is not None and isfinite(value)
