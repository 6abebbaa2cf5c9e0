"""One sentence on what the validation shows, and no more than it shows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import isfinite
from typing import TYPE_CHECKING, Literal

from steelyard.report.content import ReportContent
from steelyard.report.text.score_words import (
    RelativeError,
    band,
    band_origin,
    poorly_predicted,
    relative,
    relative_errors,
)
from steelyard.report.text.words import count, percent

if TYPE_CHECKING:
    from steelyard.diagnosis import Finding
    from steelyard.validation.score import RunScore

Level = Literal["good", "fair", "poor", "none"]

GOOD = 10.0
"""Relative error [%] up to which a joint counts as well predicted."""

FAIR = 30.0
"""Relative error [%] up to which it counts as fairly predicted."""

SEVERITY: tuple[Level, ...] = ("good", "none", "fair", "poor")
"""Levels, the best first."""

COLOURS: dict[Level, str] = {"good": "green", "fair": "yellow", "poor": "red", "none": "default"}
"""Colours of levels in a terminal."""

LIMITED: dict[str, Level] = {"ok": "none", "doubtful": "fair", "wrong": "poor"}
"""The best level that a limitation of this severity leaves; one that is ok leaves every level."""

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

    @property
    def line(self) -> str:
        """The headline behind its level in capitals; alone where there is nothing to judge by."""
        return self.headline if self.level == "none" else f"{self.level.upper()}: {self.headline}"

    def to_dict(self) -> dict[str, str]:
        """As JSON values, without the limitations."""
        return {"level": self.level, "headline": self.headline, "detail": self.detail}


def level_of(relative_percent: float | None) -> Level:
    """How good a relative error [%] is; `none` if there is no number."""
    if relative_percent is None or relative_percent != relative_percent:
        return "none"
    return "good" if relative_percent <= GOOD else "fair" if relative_percent <= FAIR else "poor"


def verdict(content: ReportContent) -> Verdict:
    """The verdict of a report, no better than its limitations allow."""
    plain = _of_scores(content)
    found = tuple((_sentence(f), LIMITED[f.severity.word]) for f in content.limitations)
    levels = (plain.level, *(LIMITED[f.severity.word] for f in content.limitations if f.severity))
    return replace(plain, level=max(levels, key=SEVERITY.index), limitations=found)


def exit_code(content: ReportContent) -> int:
    """Of a command that did its work: 1 if the verdict is poor, so that scripts stop there."""
    return int(verdict(content).level == "poor")


def _sentence(finding: Finding) -> str:
    """What was found, where, and the evidence."""
    where = f"{finding.log}: " if finding.log else ""
    figure = f" ({finding.figure})" if finding.figure else ""
    advice = f". {finding.fix.says}" if finding.fix is not None else ""
    return f"{where}{finding.says}{figure}{advice}"


def _of_scores(content: ReportContent) -> Verdict:
    """The verdict of the scores alone."""
    if not content.scores:
        return _untested(content)
    scores = [run for run in content.scores if not run.repeats] or list(content.scores)
    motion = "repeated motion" if scores[0].repeats else "unseen motion"
    first, *others = relative_errors(scores)
    detail = _detail(content, scores, others)
    if not isfinite(first.value):
        strange = [j.joint for run in scores for j in run.joints if not isfinite(relative(j))]
        return Verdict(
            f"The error on {motion} cannot be given as a percentage",
            f"No relative error of {', '.join(dict.fromkeys(strange))}: its measured effort is "
            f"zero or not a number. See the table. {detail}",
            "none",
        )
    error = f"{percent(first.value)} of the measured effort (RMS {band(scores)}, {first.kind})"
    if first.value >= 100.0:
        return Verdict(
            f"Predicts {motion} no better than predicting zero: the error is {error}",
            detail,
            "poor",
        )
    level = level_of(first.value)
    if scores[0].repeats:
        level = max(level, "none", key=SEVERITY.index)
    return Verdict(f"Predicts {motion} with an error of {error}", detail, level)


def _untested(content: ReportContent) -> Verdict:
    """Without a run that was kept aside nothing is known about other motions."""
    fitted = content.fitted
    fit = relative_errors(fitted)[0] if fitted else None
    described = (
        ""
        if fit is None or not isfinite(fit.value)
        else f"The model describes {count(len(fitted), 'fitted run')} with an error of "
        f"{percent(fit.value)} of the measured effort (RMS {band(fitted)}, {fit.kind}), which is "
        "no evidence for other motions. "
    )
    return Verdict(
        "Not validated on unseen motion",
        f"{described}To validate it, log another motion and run: {HOW_TO_VALIDATE}",
        "none",
    )


def _repeated(scores: Sequence[RunScore]) -> str:
    """Which fitted motions these runs repeat; empty if their motions are others."""
    again = ", ".join(dict.fromkeys(run.repeats for run in scores if run.repeats))
    return (
        f"It repeats the motion of the fitted run {again}: no validation on other motions"
        if again
        else ""
    )


def _detail(
    content: ReportContent, scores: Sequence[RunScore], others: Sequence[RelativeError]
) -> str:
    """The other errors, the joints that are predicted poorly, the runs, where the band is from."""
    one = len(scores) == 1
    runs = f"Run {scores[0].run}, not fitted" if one else f"{len(scores)} runs, none of them fitted"
    poor = poorly_predicted(scores, FAIR)
    sentences = (
        "; ".join(error.words for error in others),
        f"Poorly predicted joints: {poor}" if poor else "",
        runs,
        _repeated(scores),
        band_origin(content.identified),
    )
    return " ".join(f"{sentence}." for sentence in sentences if sentence)
