"""The verdict: how well the model predicts motions that were not fitted."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, ClassVar

from steelyard.report.content import ReportContent
from steelyard.report.html import fill
from steelyard.report.sections.section import Numbers
from steelyard.report.text.judgement import FAIR, GOOD, level_of, verdict
from steelyard.report.text.score_words import Figure, band, figures, relative
from steelyard.report.text.table import rows
from steelyard.report.text.words import percent, significant

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
            "runs": [_run(score) for score in content.scores if not score.repeats],
            "repeated": [_run(score) for score in content.scores if score.repeats],
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
    facts = [_fact(figure, content.scores, "") for figure in figures(content.scores)[1:]]
    if content.fitted:
        facts.append(_fact(figures(content.fitted)[0], content.fitted, "on the fitted runs: "))
    if content.identified is not None:
        table = rows(content.identified)
        sure = sum(row.grade == "sure" for row in table)
        condition = significant(content.identified.estimate.condition_normalised, 2)
        facts.append((f"{len(table)}", f"base parameters, {sure} of them well determined"))
        facts.append((condition, "normalised condition number"))
    return facts


def _fact(figure: Figure, scores: Sequence[RunScore], where: str) -> tuple[str, str]:
    """Value and label of an error."""
    return percent(figure.value), f"error {where}{figure.kind}, {band(scores)}"


def _run(score: RunScore) -> dict[str, Any]:
    return {
        "run": score.run,
        "repeats": score.repeats,
        "cutoff": score.cutoff,
        "figures": [figure.words for figure in figures([score])],
        "joints": [_joint(joint) for joint in score.joints],
    }


def _joint(joint: JointScore) -> dict[str, Any]:
    share = relative(joint)
    return vars(joint) | {
        "level": level_of(share),
        "bar": min(share, 100.0) if share is not None and share == share else 0.0,
    }
