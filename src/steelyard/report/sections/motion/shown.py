"""Which parameters the motion will show, and how well."""

from __future__ import annotations

from math import isfinite
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from steelyard.estimation.status import WELL
from steelyard.report.content import ReportContent
from steelyard.report.html import fill, rounded, script_json
from steelyard.report.sections.section import Numbers, Section
from steelyard.report.text.design_words import Expected, capital, expected
from steelyard.report.text.words import significant

if TYPE_CHECKING:
    from steelyard.excitation.result import Designed

OPEN = 12
"""Rows of the table that are seen at once."""

FULL = 50.0
"""Relative standard deviation [%] of a full bar."""

FLOOR = 1e-8
"""Singular values below this share of the greatest are drawn there."""


class DesignShownSection(Section):
    """Predicted standard deviations, what they assume, and singular values."""

    name: ClassVar[str] = "design-shown"
    title: ClassVar[str] = "Predicted accuracy"

    def numbers(self, content: ReportContent) -> Numbers | None:
        """All base parameters, the worst shown first."""
        designed = content.design
        if designed is None:
            return None
        rows = [_row(one) for one in expected(designed)]
        return {
            "rows": rows[:OPEN],
            "more": rows[OPEN:],
            "values": any(row["value"] is not None for row in rows),
            "unseen": sum(row["grade"] == "poor" for row in rows),
            "well": WELL,
            "noise": _noise(designed),
            "noise_from": capital(designed.noise_from),
            "prior": designed.prior is not None,
            "picture": script_json(_figure(designed)),
            "raw": designed.shown.raw,
            "normalised": designed.shown.normalised,
        }

    def show(self, numbers: Numbers) -> str:
        """The numbers as safe HTML."""
        return fill("design_shown.html", numbers)


def _row(one: Expected) -> dict[str, Any]:
    """A row with what its template shows."""
    share = one.relative_percent
    if not isfinite(one.std):
        grade, bar = "poor", 100.0
    elif share is None:
        grade, bar = "none", 0.0
    else:
        grade, bar = ("fair" if share > WELL else "good"), min(100.0 * share / FULL, 100.0)
    return {**vars(one), "grade": grade, "bar": bar}


def _noise(designed: Designed) -> list[tuple[str, str]]:
    """Joints and their noise."""
    joints = zip(designed.robot.coordinates, designed.noise, strict=True)
    return [(joint.name, f"{significant(float(x), 2)} {joint.effort_unit}") for joint, x in joints]


def _figure(designed: Designed) -> dict[str, Any]:
    """Singular values over the greatest, falling, on a logarithmic axis."""
    singular = designed.shown.singular
    top = float(singular.max(initial=0.0)) or 1.0
    share = np.maximum(singular / top, FLOOR)
    return {
        "x": "number",
        "y": "singular value over the greatest",
        "traces": [
            {
                "name": "singular values",
                "kind": "points",
                "x": list(range(1, len(share) + 1)),
                "y": [rounded(float(x)) for x in share],
                "more": {
                    "mode": "lines+markers",
                    "line": {"color": "--pale", "width": 1.2},
                    "marker": {"color": "--blue", "size": 6},
                    "hovertemplate": "%{x}: %{y:.3g}<extra></extra>",
                },
            }
        ],
        "layout": {
            "showlegend": False,
            "xaxis": {"range": [0.0, len(share) + 1.0]},
            "yaxis": {"type": "log", "dtick": 1, "range": _decades(share)},
        },
    }


def _decades(share: Any) -> list[float]:
    """Ends of the axis, a bit beyond the values, and a decade at least."""
    return [min(float(np.log10(share.min())) - 0.15, -1.15), 0.15]
