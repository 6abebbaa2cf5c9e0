"""The course of the search: the best figure over time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

from steelyard.report.content import ReportContent
from steelyard.report.html import fill, rounded, script_json
from steelyard.report.sections.section import Numbers, Section
from steelyard.report.text.design_words import figure_of, searches
from steelyard.report.text.words import count, significant

if TYPE_CHECKING:
    from steelyard.excitation.result import Designed


class DesignSearchSection(Section):
    """A picture of all improvements, and whether more time would pay."""

    name: ClassVar[str] = "design-search"
    title: ClassVar[str] = "The search"

    def numbers(self, content: ReportContent) -> Numbers | None:
        """Improvements, if the motion was searched for."""
        designed = content.design
        if designed is None or not designed.course:
            return None
        last = designed.course[-1]
        return {
            "searches": searches(designed),
            "seconds": f"{designed.seconds:.3g} s",
            "improved": count(len(designed.course), "time"),
            "last": f"{last[0]:.3g} s",
            "best": significant(last[1]),
            "final": figure_of(designed),
            "stopped": designed.stopped,
            "picture": script_json(_figure(designed)),
        }

    def show(self, numbers: Numbers) -> str:
        """The numbers as safe HTML."""
        return fill("design_search.html", numbers)


def _figure(designed: Designed) -> dict[str, Any]:
    """Steps down, and the end after scaling and proof as a point."""
    times, figures = zip(*designed.course, strict=True)
    end = max(designed.seconds, times[-1])
    return {
        "x": "time [s]",
        "y": designed.criterion,
        "traces": [
            {
                "name": "best found",
                "kind": "line",
                "x": [rounded(x) for x in (*times, end)],
                "y": [rounded(y) for y in (*figures, figures[-1])],
                "more": {
                    "mode": "lines+markers",
                    "line": {"shape": "hv", "color": "--blue", "width": 2},
                    "marker": {"color": "--blue", "size": [7] * len(times) + [0]},
                    "hovertemplate": "%{x:.3g} s: %{y:.4g}<extra></extra>",
                },
            },
            {
                "name": "refined, scaled exactly and proven",
                "kind": "points",
                "x": [rounded(end)],
                "y": [rounded(designed.shown.criterion_value)],
                "more": {
                    "marker": {"color": "--green", "size": 11, "symbol": "diamond"},
                    "hovertemplate": "%{x:.3g} s: %{y:.4g}<extra></extra>",
                    "cliponaxis": False,
                },
            },
        ],
        "layout": {"xaxis": {"range": [0.0, rounded(1.03 * end)]}},
    }
