"""Tracking errors of every joint and of the tool, with and without a model."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from steelyard.report.content import ReportContent
from steelyard.report.html import fill
from steelyard.report.sections.section import Numbers, Section
from steelyard.report.sections.tables import PlainTable, Row, text_table
from steelyard.report.text.words import NONE, significant

if TYPE_CHECKING:
    from rich.console import RenderableType

    from steelyard.arrays import Array
    from steelyard.robot.robot import Coordinate
    from steelyard.virtual.tracking import TrackedRun, Tracking

UNITS = {"rad": ("°", 180.0 / np.pi), "m": ("mm", 1e3)}
"""Units of joint errors for people, by that of the joint, and their factors."""


class TrackingErrorsSection(Section):
    """Headline, and tables of root mean square and largest errors."""

    name: ClassVar[str] = "tracking"
    title: ClassVar[str] = "Tracking errors"

    def numbers(self, content: ReportContent) -> Numbers | None:
        """The tables, if a motion was tracked."""
        found = content.tracking
        if found is None:
            return None
        return {"headline": headline(found), "tables": tables(found), "title": self.title}

    def show(self, numbers: Numbers) -> str:
        """The numbers as safe HTML."""
        return fill("tracking.html", numbers)

    def to_dict(self, content: ReportContent) -> dict[str, Any]:
        """The headline, and errors per controller, SI units."""
        found = content.tracking
        if found is None:
            return {"controllers": None}
        joints = found.robot.coordinates
        return {
            "headline": headline(found),
            "random_truth": found.random_truth,
            "controllers": [_run(found, run, joints) for run in found.runs],
        }

    def printed(self, content: ReportContent) -> Iterable[RenderableType]:
        """The headline and the tables."""
        from rich.text import Text

        if content.tracking is not None:
            yield Text(headline(content.tracking), style="bold")
            yield from (text_table(table, self.title) for table in tables(content.tracking))


def headline(found: Tracking) -> str:
    """The mean error of the joints of the last run over that without a model, and the truth."""
    last = found.runs[-1]
    if last is found.reference:
        return f"Tool: RMS {_mm(last.tool_rms)} mm under {last.name}{_random(found)}"
    ratios = found.ratios(last)
    mean = float(np.nanmean(ratios)) if np.isfinite(ratios).any() else float("nan")
    return (
        f"{last.name}: RMS error of the joints {significant(100.0 * mean)} % of that without a "
        f"model (mean), tool {_mm(last.tool_rms)} instead of {_mm(found.reference.tool_rms)} mm"
        f"{_random(found)}"
    )


def _random(found: Tracking) -> str:
    """That the simulated robot is not the one of the logs; empty if its truth is given."""
    if not found.random_truth:
        return ""
    robot = ". The simulated robot has random true parameters near the nominal ones"
    if len(found.runs) == 1:
        return f"{robot}; give the true ones with --truth"
    return (
        f"{robot}, the model was identified from other logs: this does not judge the model; "
        "give the true parameters with --truth"
    )


def tables(found: Tracking) -> list[PlainTable]:
    """Root mean square and largest errors, a row per joint and one for the tool."""
    names = [run.name for run in found.runs]
    made = []
    for caption, joint_values, tool_values in (
        ("RMS error", [run.rms for run in found.runs], [run.tool_rms for run in found.runs]),
        (
            "Largest error",
            [run.largest for run in found.runs],
            [run.tool_largest for run in found.runs],
        ),
    ):
        rows = []
        for j, joint in enumerate(found.robot.coordinates):
            unit, factor = UNITS[joint.unit]
            rows.append(_row(joint.name, unit, [factor * float(x[j]) for x in joint_values]))
        tool = [1e3 * x for x in tool_values]
        rows.append(_row(f"tool ({found.frame.name})", "mm", tool, total=True))
        headings = ("Joint", *names, "Unit")
        words = f"In brackets: divided by that under {names[0]}." if len(names) > 1 else ""
        text = (0, len(names) + 1)
        made.append(PlainTable(caption, words, headings, rows, text, words))
    return made


def _row(name: str, unit: str, values: Sequence[float], *, total: bool = False) -> Row:
    first = values[0]
    ratios = [NONE if first == 0.0 else f"{value / first:.2f}" for value in values[1:]]
    rest = [f"{significant(x)} ({ratio})" for x, ratio in zip(values[1:], ratios, strict=True)]
    return Row((name, significant(first), *rest, unit), total=total)


def _run(found: Tracking, run: TrackedRun, joints: Sequence[Coordinate]) -> dict[str, Any]:
    """One controller as JSON values."""
    ratios: Array = found.ratios(run)
    return {
        "name": run.name,
        "joints": [
            {
                "name": joint.name,
                "unit": joint.unit,
                "rms": rms,
                "largest": largest,
                "ratio": ratio if np.isfinite(ratio) else None,
            }
            for joint, rms, largest, ratio in zip(
                joints, run.rms.tolist(), run.largest.tolist(), ratios.tolist(), strict=True
            )
        ],
        "tool": {
            "frame": found.frame.name,
            "unit": "m",
            "rms": run.tool_rms,
            "largest": run.tool_largest,
        },
    }


def _mm(metres: float) -> str:
    return significant(1e3 * metres)
