"""Correlations between the errors of the estimated parameters, as a map."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from steelyard.arrays import Array
from steelyard.report.content import ReportContent
from steelyard.report.figures import Figure, Group, row_height
from steelyard.report.html import packed
from steelyard.report.sections.section import FigureSection, Numbers

if TYPE_CHECKING:
    from steelyard.estimation.estimate import Estimate

MOST = 80
"""Most parameters of a map."""

BAR = {
    **{"orientation": "h", "x": 0.5, "y": 1.0, "yanchor": "bottom", "len": 0.9, "thickness": 10},
    **{"title": {"text": "correlation [%]", "side": "top"}, "tickvals": [-100, -50, 0, 50, 100]},
}
"""The scale of colours, above the map."""

WORDS = (
    "Correlation of the estimates of every two base parameters. Two that are strongly correlated "
    "are known as a sum or difference only: errors of one are compensated by the other. Motions in "
    "which they act differently separate them, such as those of steelyard excite."
)


class CorrelationsSection(FigureSection):
    """One map."""

    name: ClassVar[str] = "correlations"
    title: ClassVar[str] = "Correlation of the parameters"

    def numbers(self, content: ReportContent) -> Numbers | None:
        """The map of the most correlated parameters."""
        if content.identified is None:
            return None
        names, matrix, left_out = correlations(content.identified.estimate)
        if not names:
            return None
        note = "Parameters that a bound fixes are not in the map."
        if left_out:
            note += (
                f" To limit its size, it shows the {MOST} parameters with the strongest "
                f"correlations; {left_out} others are left out."
            )
        groups = [Group([_figure(names, matrix)], columns="one")]
        return {"words": WORDS, "groups": groups, "note": note}


def correlations(estimate: Estimate, most: int = MOST) -> tuple[tuple[str, ...], Array, int]:
    """Correlations of the parameters that have an error.

    Args:
        estimate: The estimate.
        most: Largest number of parameters; those with the strongest correlations stay.

    Returns:
        Names, correlations `(k, k)`, and how many parameters are left out for size.
    """
    std, covariance = estimate.std, estimate.covariance
    known = np.isfinite(covariance).all(axis=0) & (std > 0.0)
    known &= ~np.isin(estimate.parameters.names, estimate.at_bound)
    at = np.flatnonzero(known)
    matrix = covariance[np.ix_(at, at)] / std[at][:, None] / std[at]
    strongest = np.abs(matrix - np.eye(len(at))).max(axis=1, initial=0.0)
    kept = np.sort(np.argsort(-strongest, kind="stable")[:most])
    names = tuple(estimate.parameters.names[k] for k in at[kept])
    return names, matrix[np.ix_(kept, kept)], len(at) - len(kept)


def _figure(names: tuple[str, ...], matrix: Array) -> Figure:
    """In percent, a byte each."""
    percent = packed(np.rint(100.0 * matrix), "i1")
    trace: dict[str, Any] = {
        "name": "correlation",
        "kind": "points",
        "x": list(names),
        "y": list(names),
        "more": {
            "type": "heatmap",
            "z": {**percent, "shape": f"{len(names)}, {len(names)}"},
            **{"zmin": -100, "zmax": 100},
            "colorscale": [[0.0, "--blue"], [0.5, "--card"], [1.0, "--vermillion"]],
            "colorbar": BAR,
            "hovertemplate": "%{y}, %{x}: %{z} %<extra></extra>",
        },
    }
    layout = {
        "xaxis": {"showticklabels": False, "showgrid": False, "ticks": ""},
        "yaxis": {
            "autorange": "reversed",
            "tickfont": {"size": 9},
            "dtick": 1,
            "showgrid": False,
            "zeroline": False,
        },
    }
    label = "Map of the correlations between all pairs of parameters, both ways in the same order"
    return Figure("", label, "", "", [trace], layout, height=row_height(len(names), 12))
