"""Small pictures as SVG: panels with lines or points on axes."""

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from math import ceil, floor, log10

import numpy as np
from numpy.typing import ArrayLike

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#7f3fbf", "#6b7280", "#b8860b", "#c2185b")
"""Told apart with impaired colour vision as well."""

WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM = 460, 250, 62, 12, 30, 42
"""Of a panel, and its margins [px]."""

POINTS = 200
"""Most points of a line."""


@dataclass(frozen=True, eq=False)
class Curve:
    """Values over an axis.

    Attributes:
        name: In the legend; empty for none.
        x: Shape `(N,)`.
        y: Shape `(N,)`.
        points: Dots instead of a line.
        colour: Number in `COLOURS`; the place among the panel's curves if `None`.
    """

    name: str
    x: ArrayLike
    y: ArrayLike
    points: bool = False
    colour: int | None = None


@dataclass(frozen=True)
class Panel:
    """Curves on one pair of axes.

    Attributes:
        title: Above the axes.
        x: Label with unit.
        y: Label with unit.
        curves: What is drawn.
        log: Whether the vertical axis is logarithmic.
        ticks: Names at 0, 1, 2 ... of the horizontal axis, instead of numbers.
        square: Whether a unit is as long on both axes.
    """

    title: str
    x: str
    y: str
    curves: tuple[Curve, ...]
    log: bool = False
    ticks: tuple[str, ...] = ()
    square: bool = False


@dataclass(frozen=True)
class Picture:
    """Panels beside and below each other, with a caption.

    Attributes:
        name: Of the file, without what stands before and behind.
        caption: What is seen.
        panels: In reading order.
        columns: Panels in a row.
    """

    name: str
    caption: str
    panels: tuple[Panel, ...]
    columns: int = 2

    def svg(self) -> str:
        """The picture."""
        columns = min(self.columns, len(self.panels))
        rows = ceil(len(self.panels) / columns)
        drawn = "".join(
            f'<g transform="translate({WIDTH * (k % columns)},{HEIGHT * (k // columns)})">'
            f"{_panel(panel)}</g>"
            for k, panel in enumerate(self.panels)
        )
        size = f'viewBox="0 0 {WIDTH * columns} {HEIGHT * rows}"'
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" {size} font-family="sans-serif" '
            f'style="max-width:{1.3 * WIDTH * columns:.0f}px" '
            f'font-size="12" role="img" aria-label="{escape(self.caption)}">'
            f'<rect width="100%" height="100%" fill="#fff"/>{drawn}</svg>\n'
        )


@dataclass(frozen=True)
class _Axis:
    """From values to pixels."""

    low: float
    high: float
    start: float
    end: float

    def at(self, value: float) -> float:
        share = (value - self.low) / (self.high - self.low)
        return round(self.start + share * (self.end - self.start), 1)


def _panel(panel: Panel) -> str:
    data = [_reduced(curve) for curve in panel.curves]
    xs, ys = (np.concatenate([one[k] for one in data]) for k in (0, 1))
    ys = np.log10(ys) if panel.log else ys
    x_range = (-0.5, len(panel.ticks) - 0.5) if panel.ticks else _range(xs, 0.0)
    y_range = _range(ys, 0.06)
    if panel.square:
        x_range, y_range = _squared(_range(xs, 0.06), y_range)
    across = _Axis(*x_range, LEFT, WIDTH - RIGHT)
    up = _Axis(*y_range, HEIGHT - BOTTOM, TOP)
    drawn = "".join(
        _curve(curve, x, np.log10(y) if panel.log else y, across, up, k)
        for k, (curve, (x, y)) in enumerate(zip(panel.curves, data, strict=True))
    )
    return _frame(panel, across, up) + drawn + _legend(panel.curves)


def _reduced(curve: Curve) -> tuple[np.ndarray, np.ndarray]:
    x, y = np.asarray(curve.x, dtype=float), np.asarray(curve.y, dtype=float)
    step = 1 if curve.points else max(1, ceil(len(x) / POINTS))
    return x[::step], y[::step]


def _range(values: np.ndarray, margin: float) -> tuple[float, float]:
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    room = margin * (high - low) if high > low else max(abs(low), 1.0) * 0.1
    return low - room, high + room


def _squared(
    x: tuple[float, float], y: tuple[float, float]
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Both ranges widened to the same scale."""
    wide, high = WIDTH - LEFT - RIGHT, HEIGHT - TOP - BOTTOM
    scale = max((x[1] - x[0]) / wide, (y[1] - y[0]) / high)
    middle, centre = 0.5 * sum(x), 0.5 * sum(y)
    return (
        (middle - 0.5 * scale * wide, middle + 0.5 * scale * wide),
        (centre - 0.5 * scale * high, centre + 0.5 * scale * high),
    )


def _ticks(low: float, high: float) -> list[float]:
    """Round numbers, four to eight of them."""
    rough = (high - low) / 5.0
    size = 10.0 ** floor(log10(rough))
    step = min((k * size for k in (1.0, 2.0, 5.0, 10.0)), key=lambda s: abs(s - rough))
    return [k * step for k in range(ceil(low / step - 1e-9), floor(high / step + 1e-9) + 1)]


def _frame(panel: Panel, across: _Axis, up: _Axis) -> str:
    below = HEIGHT - BOTTOM
    marks = [f'<text x="{LEFT}" y="16" font-weight="600">{escape(panel.title)}</text>']
    named = [(float(k), name) for k, name in enumerate(panel.ticks)]
    for value, name in named or [(v, f"{v:g}") for v in _ticks(across.low, across.high)]:
        x = across.at(value)
        marks.append(f'<text x="{x}" y="{below + 15}" text-anchor="middle">{escape(name)}</text>')
    for value in _levels(up, panel.log):
        y = up.at(value)
        label = f"{10.0**value:g}" if panel.log else f"{value:.6g}"
        marks.append(f'<path d="M{LEFT} {y}H{WIDTH - RIGHT}" stroke="#e3e7ec"/>')
        marks.append(f'<text x="{LEFT - 5}" y="{y + 4}" text-anchor="end">{label}</text>')
    middle, centre = 0.5 * (LEFT + WIDTH - RIGHT), 0.5 * (TOP + below)
    marks.append(
        f'<text x="{middle}" y="{HEIGHT - 8}" text-anchor="middle">{escape(panel.x)}</text>'
        f'<text transform="translate(13,{centre})rotate(-90)" text-anchor="middle">'
        f"{escape(panel.y)}</text>"
        f'<path d="M{LEFT} {TOP}V{below}H{WIDTH - RIGHT}" fill="none" stroke="#8a929c"/>'
    )
    return "".join(marks)


def _levels(up: _Axis, log: bool) -> list[float]:
    if not log or up.high - up.low < 1.0:
        return [
            float(np.log10(v)) if log else v
            for v in (_ticks(10.0**up.low, 10.0**up.high) if log else _ticks(up.low, up.high))
            if v > 0.0 or not log
        ]
    return [float(k) for k in range(ceil(up.low), floor(up.high) + 1)]


def _curve(
    curve: Curve, x: np.ndarray, y: np.ndarray, across: _Axis, up: _Axis, number: int
) -> str:
    colour = _colour(curve, number)
    places = [(across.at(a), up.at(b)) for a, b in zip(x.tolist(), y.tolist(), strict=True)]
    if curve.points:
        dots = "".join(f'<circle cx="{a}" cy="{b}" r="3"/>' for a, b in places)
        return f'<g fill="{colour}" fill-opacity="0.75">{dots}</g>'
    path = " ".join(f"{a:g},{b:g}" for a, b in places)
    return f'<polyline points="{path}" fill="none" stroke="{colour}" stroke-width="1.5"/>'


def _legend(curves: Sequence[Curve]) -> str:
    marks, x = [], float(WIDTH - RIGHT)
    for number, curve in reversed(list(enumerate(curves))):
        if curve.name:
            marks.append(
                f'<text x="{x}" y="16" text-anchor="end" fill="{_colour(curve, number)}">'
                f"{escape(curve.name)}</text>"
            )
            x -= 6.6 * len(curve.name) + 12.0
    return "".join(marks)


def _colour(curve: Curve, number: int) -> str:
    return COLOURS[(number if curve.colour is None else curve.colour) % len(COLOURS)]
