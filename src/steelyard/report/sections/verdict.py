"""The verdict: how well the model predicts motions that were not fitted."""

from __future__ import annotations

from statistics import fmean
from typing import TYPE_CHECKING, Any, ClassVar

from steelyard.report.content import ReportContent
from steelyard.report.html import fill
from steelyard.report.judgement import FAIR, GOOD, level_of, told, verdict
from steelyard.report.sections.section import Numbers
from steelyard.report.table import rows
from steelyard.report.words import percent, significant

if TYPE_CHECKING:
    from steelyard.validation.score import JointScore, RunScore


class VerdictSection:
    """Headline, key figures, and one table of joints per run."""

    name: ClassVar[str] = "verdict"
    title: ClassVar[str] = "Verdict"

    def numbers(self, content: ReportContent) -> Numbers:
        """Verdict, key figures and scores."""
        return {
            "verdict": verdict(content),
            "facts": _facts(content),
            "runs": [_run(score) for score in content.scores],
            "fitted": [_run(score) for score in content.fitted],
            "notes": content.notes,
            "good": GOOD,
            "fair": FAIR,
        }

    def show(self, numbers: Numbers) -> str:
        """The numbers as safe HTML."""
        return fill("verdict.html", numbers)


def _facts(content: ReportContent) -> list[tuple[str, str]]:
    """Values and labels of the key figures."""
    facts = []
    if content.scores:
        whole = percent(fmean(s.mean_percent for s in content.scores))
        facts.append((whole, "mean error over whole logs, rests included"))
        pooled = [s.pooled_percent for s in content.scores if s.pooled_percent is not None]
        if len(pooled) == len(content.scores):
            facts.append((percent(fmean(pooled)), "the same, norms over all joints together"))
    if content.fitted:
        fit = percent(fmean(s.mean_percent for s in content.fitted))
        facts.append((fit, "mean error over the fitted runs, rests included"))
    if content.identified is not None:
        table = rows(content.identified)
        sure = sum(row.grade == "sure" for row in table)
        condition = significant(content.identified.estimate.condition_normalised, 2)
        facts.append((f"{len(table)}", f"base parameters, {sure} of them well determined"))
        facts.append((condition, "normalised condition number"))
    return facts


def _run(score: RunScore) -> dict[str, Any]:
    return {
        "run": score.run,
        "cutoff": score.cutoff,
        "mean": score.mean_percent,
        "mean_moving": score.mean_percent_moving,
        "joints": [_joint(joint) for joint in score.joints],
    }


def _joint(joint: JointScore) -> dict[str, Any]:
    share = told(joint)
    return vars(joint) | {
        "level": level_of(share),
        "bar": min(share, 100.0) if share is not None and share == share else 0.0,
    }
