"""Figures as the page draws them; colours are names of the style sheet, such as `--measured`."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from steelyard.arrays import Array
from steelyard.report.html import packed, rounded, script_json

Traced = dict[str, Any]
"""One trace of a figure, as JSON values."""


@dataclass(frozen=True)
class Figure:
    """One figure.

    Attributes:
        title: Its heading; empty for none.
        label: What it shows, for people who do not see it.
        x: Title of the first axis.
        y: Title of the second axis.
        traces: What is drawn.
        layout: More of Plotly's layout.
        caption: Words beside the title.
        height: [px]; that of the style sheet if `None`.
    """

    title: str
    label: str
    x: str
    y: str
    traces: Sequence[Traced]
    layout: Mapping[str, Any] = field(default_factory=dict)
    caption: str = ""
    height: int | None = None

    @property
    def json(self) -> str:
        """The figure as safe JSON."""
        return script_json(
            {"x": self.x, "y": self.y, "traces": self.traces, "layout": dict(self.layout)}
        )


@dataclass(frozen=True)
class Group:
    """Figures that stand beside each other, folded under a name if they have one.

    Attributes:
        figures: The figures.
        name: What folds them; empty if they are always open.
        caption: Words beside the name.
        columns: `three` for narrow figures, `one` for wide ones, else empty.
    """

    figures: Sequence[Figure]
    name: str = ""
    caption: str = ""
    columns: str = ""


@dataclass(frozen=True)
class Key:
    """An entry of a legend above figures.

    Attributes:
        colour: Name in the style sheet.
        words: What has this colour.
        shape: How it is drawn.
    """

    colour: str
    words: str
    shape: Literal["line", "area", "point"] = "line"

    @property
    def style(self) -> str:
        """Of the mark, in CSS."""
        sizes = {"line": "", "area": "height: 14px;", "point": "height: 7px; width: 7px;"}
        return f"background: var({self.colour}); {sizes[self.shape]}"


def line(name: str, x: Array, y: Array, colour: str, **more: Any) -> Traced:
    """A line; `dash` and `width` are those of the line, other arguments those of the trace."""
    style = {"color": colour, "width": more.pop("width", 2), "dash": more.pop("dash", "solid")}
    given = {"mode": "lines", "line": style, **more}
    return {"name": name, "kind": "line", "x": packed(x), "y": packed(y), "more": given}


def points(name: str, x: Array, y: Array, colour: str, size: float = 3.5) -> Traced:
    """A cloud of points."""
    more = {"marker": {"color": colour, "size": size, "opacity": 0.55}, "hoverinfo": "skip"}
    return {"name": name, "kind": "points", "x": packed(x), "y": packed(y), "more": more}


def dots(
    name: str,
    x: Sequence[float],
    y: Sequence[str],
    colour: str,
    *,
    symbol: str = "circle",
    size: float = 7,
    half_widths: Sequence[float] | None = None,
) -> Traced:
    """One mark per named row, with an interval if half-widths are given."""
    outline = {"color": colour, "width": 2}
    marker = {"color": colour, "symbol": symbol, "size": size, "line": outline}
    more: Traced = {"marker": marker, "hovertemplate": "%{y}: %{x:.3g}<extra>" + name + "</extra>"}
    if half_widths is not None:
        array = [rounded(half) for half in half_widths]
        more["error_x"] = {"type": "data", "array": array, "color": colour, "width": 4}
    return {"name": name, "kind": "points", "x": [rounded(v) for v in x], "y": y, "more": more}


def row_height(rows: int, each: int) -> int:
    """Height of a figure with named rows [px]."""
    return 70 + each * max(rows, 3)


def area(
    name: str, x: Array, lower: Array, upper: Array, colour: str, opacity: float = 1.0
) -> Traced:
    """The area between two lines, without an outline."""
    style = {"fill": "toself", "fillcolor": colour, "opacity": opacity}
    return {
        "name": name,
        "kind": "line",
        "x": packed(np.concatenate([x, x[::-1]])),
        "y": packed(np.concatenate([lower, upper[::-1]])),
        "more": {"mode": "none", "hoverinfo": "skip", **style},
    }


def evenly(count: int, most: int) -> slice:
    """Evenly spaced ones of `count` samples, at most so many."""
    return slice(None, None, max(1, -(-count // most)))
