"""Errors of every joint and of the tool over time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

from steelyard.arrays import Array
from steelyard.report.content import ReportContent
from steelyard.report.figures import Figure, Group, line
from steelyard.report.sections.section import FigureSection, Numbers
from steelyard.report.sections.tracking.errors import UNITS
from steelyard.report.sections.tracking.path import colour, legend
from steelyard.report.thin import thin

if TYPE_CHECKING:
    from collections.abc import Sequence

    from steelyard.virtual.tracking import Tracking

POINTS = 1500
"""Most points of a line."""

BUDGET = 120_000
"""Points of all lines together."""


class ErrorsOverTimeSection(FigureSection):
    """The tool's deviation, and a picture per joint."""

    name: ClassVar[str] = "errors-over-time"
    title: ClassVar[str] = "Errors over time"

    def numbers(self, content: ReportContent) -> Numbers | None:
        """Errors, if a motion was tracked."""
        found = content.tracking
        if found is None:
            return None
        lines = (found.robot.n + 1) * len(found.runs)
        most = max(min(POINTS, BUDGET // lines), 50)
        tool = [1e3 * run.deviation for run in found.runs]
        figures = [_figure(found, f"tool ({found.frame.name})", "distance [mm]", tool, most)]
        for j, joint in enumerate(found.robot.coordinates):
            unit, factor = UNITS[joint.unit]
            errors = [factor * run.error[:, j] for run in found.runs]
            figures.append(_figure(found, joint.name, f"desired − true [{unit}]", errors, most))
        return {"groups": [Group(figures)], "legend": legend(found)[1:]}


def _figure(found: Tracking, name: str, y: str, errors: Sequence[Array], most: int) -> Figure:
    """One line per run."""
    traces: list[dict[str, Any]] = []
    for k, (run, error) in enumerate(zip(found.runs, errors, strict=True)):
        rows = thin(error, most)
        traces.append(line(run.name, found.t[rows], error[rows], colour(k), width=1.3))
    layout = {"showlegend": False}
    return Figure(name, f"Tracking error of {name} over time", "time [s]", y, traces, layout)
