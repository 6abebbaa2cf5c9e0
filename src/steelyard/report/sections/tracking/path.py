"""The path of the tool as desired and as run, deviations enlarged."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from steelyard.report.content import ReportContent
from steelyard.report.figures import Figure, Group, Key, evenly, line
from steelyard.report.sections.section import FigureSection, Numbers

if TYPE_CHECKING:
    from steelyard.virtual.tracking import Tracking

DESIRED = "--ink"
COLOURS = ("--vermillion", "--blue", "--green", "--purple")
"""Of the runs, the one without a model first."""

POINTS = 4000
"""Points of a path."""

ENLARGED = 0.05
"""Share of the path's width that the largest deviation is drawn with."""


class ToolPathSection(FigureSection):
    """Two pictures in the plane in which the path is widest."""

    name: ClassVar[str] = "tool-path"
    title: ClassVar[str] = "Path of the tool"

    def numbers(self, content: ReportContent) -> Numbers | None:
        """Paths, if a motion was tracked."""
        found = content.tracking
        if found is None:
            return None
        a, b = plane(found)
        factor = magnification(found)
        words = f"deviations {factor:g} times as large"
        figures = [
            _figure(found, (a, b), 1.0, "as run", "zoom in to see the deviations"),
            _figure(found, (a, b), factor, "enlarged", words),
        ]
        return {"groups": [Group(figures)], "legend": legend(found)}


def legend(found: Tracking) -> list[Key]:
    """Colours of the runs."""
    keys = [Key(DESIRED, "desired")]
    return keys + [Key(colour(k), run.name) for k, run in enumerate(found.runs)]


def colour(number: int) -> str:
    """Name in the style sheet of a run's colour."""
    return COLOURS[min(number, len(COLOURS) - 1)]


def plane(found: Tracking) -> tuple[int, int]:
    """The two axes along which the path is widest, in their order."""
    first, second = sorted(np.argsort(-np.ptp(found.desired, axis=0), kind="stable")[:2].tolist())
    return first, second


def magnification(found: Tracking) -> float:
    """Factor 1, 2 or 5 times a power of ten by which deviations are drawn larger."""
    largest = max(run.tool_largest for run in found.runs)
    width = float(np.ptp(found.desired, axis=0).max())
    if largest == 0.0 or width == 0.0:
        return 1.0
    wanted = max(ENLARGED * width / largest, 1.0)
    decade = 10.0 ** np.floor(np.log10(wanted))
    return float(decade * max(step for step in (1.0, 2.0, 5.0) if step * decade <= wanted))


def _figure(
    found: Tracking, axes: tuple[int, int], factor: float, title: str, caption: str
) -> Figure:
    """Desired path and all runs, both scales alike."""
    a, b = axes
    rows = evenly(len(found.t), POINTS)
    desired = found.desired[rows]
    traces: list[dict[str, Any]] = [
        line("desired", desired[:, a], desired[:, b], DESIRED, width=1, hoverinfo="skip")
    ]
    for k, run in enumerate(found.runs):
        tool = desired + factor * (run.tool[rows] - desired)
        traces.append(line(run.name, tool[:, a], tool[:, b], colour(k), width=1.5))
    layout = {
        "yaxis": {"scaleanchor": "x", "constrain": "domain"},
        "xaxis": {"constrain": "domain"},
        "showlegend": False,
    }
    label = f"Path of the tool, {title}: desired and {len(found.runs)} runs"
    names = [f"{'xyz'[axis]} [m]" for axis in axes]
    return Figure(title, label, names[0], names[1], traces, layout, caption, 460)
