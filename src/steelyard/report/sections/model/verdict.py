"""The verdict: how well the model predicts motions that were not fitted."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, ClassVar

from steelyard.report.content import ReportContent
from steelyard.report.html import fill
from steelyard.report.sections.model.effort import band_text
from steelyard.report.sections.section import Numbers, Section
from steelyard.report.text.findings import finding_dict
from steelyard.report.text.score_words import (
    RelativeError,
    band,
    coverage_words,
    relative,
    relative_errors,
)
from steelyard.report.text.table import rows
from steelyard.report.text.verdict import COLOURS, FAIR, GOOD, level_of, verdict
from steelyard.report.text.words import percent, significant

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.table import Table

    from steelyard.validation.score import JointScore, RunScore

CAPTION = (
    "moving, all: relative error where the joint moves, and of the whole log; pooled: norms over "
    "all joints together; zero, nominal: RMSE of predicting zero, and of the nominal model"
)


class VerdictSection(Section):
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
            "good": GOOD,
            "fair": FAIR,
        }

    def show(self, numbers: Numbers) -> str:
        """The numbers as safe HTML."""
        return fill("verdict.html", numbers)

    def to_dict(self, content: ReportContent) -> dict[str, Any]:
        """Verdict, limitations, scores and notes."""
        return {
            "verdict": verdict(content).to_dict(),
            "validation": [score.to_dict() for score in content.scores],
            "identification": [score.to_dict() | {"motion": "fitted"} for score in content.fitted],
            "limitations": [finding_dict(finding) for finding in content.limitations],
            "notes": list(content.notes),
        }

    def printed(self, content: ReportContent) -> Iterable[RenderableType]:
        """The verdict with its limitations, and the scores of every joint."""
        from rich.console import Group
        from rich.text import Text

        judged = verdict(content)
        yield Group(
            Text(judged.line, style=f"bold {COLOURS[judged.level]}"),
            Text(judged.detail),
            *(Text(f"! {said}", style=COLOURS[level]) for said, level in judged.limitations),
        )
        for score in content.scores or content.fitted:
            table = _table(score, bool(content.scores))
            if score.coverage_percent is None:
                yield table
                continue
            inside = coverage_words(score.coverage_percent, bool(content.scores))
            bands = Text(f"95 % bands {band_text(content.identified)}; {inside}")
            yield Group(table, bands)


def _facts(content: ReportContent) -> list[tuple[str, str]]:
    """Values and labels of the key figures."""
    facts = [_fact(error, content.scores, "") for error in relative_errors(content.scores)[1:]]
    if content.fitted:
        facts.append(
            _fact(relative_errors(content.fitted)[0], content.fitted, "on the fitted runs: ")
        )
    if content.identified is not None:
        table = rows(content.identified)
        sure = sum(row.grade == "sure" for row in table)
        condition = significant(content.identified.estimate.condition_normalised, 2)
        facts.append((f"{len(table)}", f"base parameters, {sure} of them well identified"))
        facts.append((condition, "normalised condition number"))
    return facts


def _fact(error: RelativeError, scores: Sequence[RunScore], where: str) -> tuple[str, str]:
    """Value and label of an error."""
    return percent(error.value), f"error {where}{error.kind}, {band(scores)}"


def _run(score: RunScore) -> dict[str, Any]:
    return {
        "run": score.run,
        "repeats": score.repeats,
        "cutoff": score.cutoff,
        "figures": [error.words for error in relative_errors([score])],
        "joints": [_joint(joint) for joint in score.joints],
    }


def _joint(joint: JointScore) -> dict[str, Any]:
    share = relative(joint)
    return vars(joint) | {
        "level": level_of(share),
        "bar": min(share, 100.0) if share is not None and share == share else 0.0,
    }


def _table(score: RunScore, unseen: bool) -> Table:
    from rich.table import Table
    from rich.text import Text

    again = f"not fitted, repeats the motion of {score.repeats}" if score.repeats else "not fitted"
    kind = again if unseen else "fitted"
    table = Table(
        title=Text(f"{score.run} ({kind}, below {score.cutoff:g} Hz)"),
        title_justify="left",
        caption=CAPTION,
        caption_justify="left",
    )
    table.add_column("joint", overflow="fold")
    for heading in ("moving", "all", "RMSE", "zero", "nominal"):
        table.add_column(heading, justify="right")
    table.add_column("unit")
    for joint in score.joints:
        style = COLOURS[level_of(relative(joint))]
        table.add_row(
            Text(joint.joint),
            Text(percent(joint.relative_percent_moving), style=style),
            percent(joint.relative_percent),
            significant(joint.rmse),
            significant(joint.predict_zero),
            significant(joint.prior_rmse),
            Text(joint.unit),
        )
    table.add_section()
    if score.pooled_percent is not None:
        pooled = percent(score.pooled_percent_moving), percent(score.pooled_percent)
        table.add_row("pooled", *pooled)
    table.add_row("mean", percent(score.mean_percent_moving), percent(score.mean_percent))
    return table
