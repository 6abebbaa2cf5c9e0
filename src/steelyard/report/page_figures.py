"""Figures of Plotly, as a page draws them, and signals with fewer points for them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array
from steelyard.report.page import packed, rounded, script_json

Traced = dict[str, Any]  # one trace of a figure, as JSON values


@dataclass(frozen=True)
class Frames:
    """How the first traces of a figure in space move: times `(F,)` [s], points `(F, P, 3)` each."""

    t: Array
    points: Sequence[Array]


@dataclass(frozen=True)
class Figure:
    """One figure."""

    title: str  # its heading; empty for none
    label: str  # what it shows, for people who do not see it
    x: str
    y: str
    traces: Sequence[Traced]
    layout: Mapping[str, Any] = field(default_factory=dict)  # more of Plotly's layout
    caption: str = ""  # words beside the title
    height: int | None = None  # [px]; that of the style sheet if `None`
    frames: Frames | None = None  # a replay of traces in space

    @property
    def json(self) -> str:
        """The figure as safe JSON."""
        moving = {}
        if self.frames is not None:
            along = [packed(points.ravel()) for points in self.frames.points]
            moving = {"frames": {"t": packed(self.frames.t), "points": along}}
        shown = {"x": self.x, "y": self.y, "traces": self.traces, "layout": dict(self.layout)}
        return script_json(shown | moving)


@dataclass(frozen=True)
class Group:
    """Figures that stand beside each other, folded under a name if they have one."""

    figures: Sequence[Figure]
    name: str = ""  # what folds them; empty if they are always open
    caption: str = ""  # words beside the name
    columns: str = ""  # `three` for narrow figures, `one` for wide ones, else empty


@dataclass(frozen=True)
class Key:
    """An entry of a legend above figures; `colour` is a name in the style sheet."""

    colour: str
    words: str
    shape: Literal["line", "area", "point"] = "line"

    @property
    def style(self) -> str:
        """Of the mark, in CSS."""
        sizes = {"line": "", "area": "height: 14px;", "point": "height: 7px; width: 7px;"}
        return f"background: var({self.colour}); {sizes[self.shape]}"


def traced(kind: Literal["line", "points"], name: str, x: Any, y: Any, **more: Any) -> Traced:
    """A trace; beside its name and values, what Plotly's own trace has."""
    return {"name": name, "kind": kind, "x": x, "y": y, "more": more}


def line(name: str, x: Array, y: Array, colour: str, **more: Any) -> Traced:
    """A line; `dash` and `width` are those of the line, other arguments those of the trace."""
    style = {"color": colour, "width": more.pop("width", 2), "dash": more.pop("dash", "solid")}
    return traced("line", name, packed(x), packed(y), **{"mode": "lines", "line": style, **more})


def in_space(name: str, points: Array, **more: Any) -> Traced:
    """Points `(N, 3)` in space, joined by lines unless the trace's `type` or `mode` is another."""
    x, y, z = (packed(axis) for axis in points.T)
    return traced("line", name, x, y, **{"type": "scatter3d", "z": z, **more})


def space_layout(**scene: Any) -> dict[str, Any]:
    """Layout of a figure in space, all scales alike; `scene` has more of Plotly's scene."""
    colours = {"gridcolor": "--line", "zerolinecolor": "--zero"}
    axes = {f"{axis}axis": {"title": {"text": f"{axis} [m]"}, **colours} for axis in "xyz"}
    for axis in axes.keys() & scene.keys():
        axes[axis] |= scene.pop(axis)
    camera = {"eye": {"x": 1.3, "y": -1.4, "z": 0.7}, "center": {"x": 0.0, "y": 0.0, "z": -0.12}}
    found = {**axes, "aspectmode": "data", "camera": camera, **scene}
    return {"scene": found, "showlegend": False, "margin": {"l": 0, "r": 0, "t": 0, "b": 0}}


def points(name: str, x: Array, y: Array, colour: str, size: float = 3.5) -> Traced:
    """A cloud of points."""
    marker = {"color": colour, "size": size, "opacity": 0.55}
    return traced("points", name, packed(x), packed(y), marker=marker, hoverinfo="skip")


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
    return traced("points", name, [rounded(v) for v in x], y, **more)


def row_height(rows: int, each: int) -> int:
    """Height of a figure with named rows [px]."""
    return 70 + each * max(rows, 3)


def figure_of_rows(
    label: str, x: str, names: Sequence[str], traces: Sequence[Traced], each: int, **layout: Any
) -> Figure:
    """A figure with one row per name, `each` so many pixels high, the first above."""
    axis = {"type": "category", "categoryorder": "array", "categoryarray": names[::-1], "dtick": 1}
    given = {"showlegend": False, **layout, "yaxis": axis | layout.get("yaxis", {})}
    return Figure("", label, x, "", traces, given, height=row_height(len(names), each))


def area(
    name: str, x: Array, lower: Array, upper: Array, colour: str, opacity: float = 1.0
) -> Traced:
    """The area between two lines, without an outline."""
    around = (packed(np.concatenate(ends)) for ends in ([x, x[::-1]], [lower, upper[::-1]]))
    style = {"fill": "toself", "fillcolor": colour, "opacity": opacity}
    return traced("line", name, *around, mode="none", hoverinfo="skip", **style)


def evenly(count: int, most: int) -> slice:
    """Evenly spaced ones of `count` samples, at most so many."""
    return slice(None, None, max(1, -(-count // most)))


def thin(signal: Array, most: int) -> NDArray[np.intp]:
    """Indices of the samples of a signal `(N,)` to draw, in order; at most `most`, 4 or more.

    The first and last sample stay, and so do the lowest and the highest of each of about `most / 2`
    stretches of equal length. Values that are not finite are passed over where a stretch has
    others.
    """
    size = len(signal)
    if size <= most:
        return np.arange(size)
    length = -(-size // ((most - 2) // 2))
    padded = np.full(-(-size // length) * length, np.nan)
    padded[:size] = signal
    stretches = np.where(np.isfinite(padded), padded, np.nan).reshape(-1, length)
    starts = np.arange(len(stretches)) * length
    lowest = starts + np.where(np.isnan(stretches), np.inf, stretches).argmin(axis=1)
    highest = starts + np.where(np.isnan(stretches), -np.inf, stretches).argmax(axis=1)
    return np.unique(np.concatenate([[0], lowest, highest, [size - 1]]))


def gaps(t: Array, factor: float = 5.0) -> NDArray[np.intp]:
    """Indices of the samples after which time `t`, shape `(N,)`, jumps by many usual steps."""
    steps = np.diff(t)
    if not len(steps):
        return np.empty(0, dtype=np.intp)
    return np.flatnonzero(steps > factor * np.median(steps))


def from_origin(t: Array) -> tuple[Array, str]:
    """Time from its first sample where it is a date, and the title of its axis."""
    origin = float(t[0]) if len(t) and abs(t[-1]) > 1e5 else 0.0
    return t - origin, f"time from {origin:.3f} s [s]" if origin else "time [s]"


def drawn(t: Array, signal: Array, most: int) -> tuple[Array, Array]:
    """Points of a line `(N,)` that is broken where time [s] jumps; at most `most`, breaks included.

    A break has value NaN.
    """
    breaks = gaps(t)[: most // 4]
    chosen = thin(signal, most - len(breaks))
    after = np.searchsorted(breaks, chosen, side="left")
    places = np.flatnonzero(np.diff(after)) + 1
    values = np.where(np.isfinite(signal[chosen]), signal[chosen], np.nan)
    return np.insert(t[chosen], places, t[chosen[places - 1]]), np.insert(values, places, np.nan)


def outline(t: Array, lower: Array, upper: Array, most: int) -> tuple[Array, Array]:
    """Outline of an area between two lines `(N,)`, one closed piece between jumps of time [s].

    It has at most `most` points, NaN in both arrays between pieces.
    """
    breaks = gaps(t)[: max(most // 8, 1)]
    chosen = thin(upper, max((most - len(breaks)) // 2, 4))
    pieces_t: list[Array] = []
    pieces: list[Array] = []
    pause = np.array([np.nan])
    for part in np.split(chosen, np.searchsorted(chosen, breaks, side="right")):
        pieces_t += [t[part], t[part[::-1]], pause]
        pieces += [upper[part], lower[part[::-1]], pause]
    return np.concatenate(pieces_t)[:-1], np.concatenate(pieces)[:-1]
