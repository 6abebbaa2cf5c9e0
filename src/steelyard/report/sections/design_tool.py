"""The path of the tool, in space and from three sides, with the walls of its room."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from steelyard.arrays import Array
from steelyard.report.content import ReportContent
from steelyard.report.html import fill, packed, rounded, script_json
from steelyard.report.sections.section import Numbers
from steelyard.report.skeleton import skeleton, way_of
from steelyard.report.words import significant

if TYPE_CHECKING:
    from steelyard.robot.excitation_schema import BoxSpans, WorkspaceSection

POINTS = 1500
"""Points of the path."""

VIEWS = (("from above", 0, 1), ("from the side", 0, 2), ("from the front", 1, 2))
AXES = "xyz"
PATH, ARM, PALE, START = "#0068a8", "#7488a0", "#c3ccd6", "#00694b"
WALL, FORBIDDEN = "#a8261d", "#f3c9c5"


class DesignToolSection:
    """A picture in space, and one from each side."""

    name: ClassVar[str] = "design-tool"
    title: ClassVar[str] = "Path of the tool"

    def numbers(self, content: ReportContent) -> Numbers | None:
        """Path and walls; none for robots whose closed chains say where the tool is."""
        designed = content.design
        if designed is None or designed.robot.loops:
            return None
        t = np.linspace(0.0, designed.trajectory.duration, POINTS)
        q = designed.trajectory.derivative(t, 0)
        path = way_of(designed.robot, designed.tool, q)
        arm = skeleton(designed.robot, designed.tool, q[:1])[:, 0]
        walls = _walls(content.workspace)
        return {
            "tool": designed.tool.title,
            "spans": _spans(path),
            "length": significant(float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())),
            "walls": bool(walls),
            "space": script_json(_space(t, path, arm, walls)),
            "views": [(words, script_json(_view(path, arm, walls, a, b))) for words, a, b in VIEWS],
        }

    def show(self, numbers: Numbers) -> str:
        """The numbers as safe HTML."""
        return fill("design_tool.html", numbers)


def _spans(path: Array) -> str:
    low, high = path.min(axis=0), path.max(axis=0)
    ends = zip(AXES, low, high, strict=True)
    return ", ".join(f"{axis} from {a:.3f} to {b:.3f} m" for axis, a, b in ends)


def _walls(workspace: WorkspaceSection | None) -> list[tuple[bool, BoxSpans]]:
    """Boxes, and whether it is forbidden to be inside."""
    if workspace is None:
        return []
    spans = [getattr(workspace.box, axis) for axis in AXES]
    inside = [(False, workspace.box)] if any(spans) else []
    return inside + [(True, box) for box in workspace.keep_out]


def _space(t: Array, path: Array, arm: Array, walls: Sequence[tuple[bool, Any]]) -> dict[str, Any]:
    """Path and arm in space, coloured by time."""
    x, y, z = (packed(axis) for axis in path.T)
    way = {
        "name": "tool",
        "kind": "line",
        "x": x,
        "y": y,
        "more": {
            "type": "scatter3d",
            "z": z,
            "line": {
                "width": 4,
                "color": packed(t),
                "colorscale": "Viridis",
                "showscale": True,
                "colorbar": {"title": {"text": "time [s]"}, "thickness": 10, "len": 0.7},
            },
            "hovertemplate": "%{x:.3f}, %{y:.3f}, %{z:.3f} m<extra></extra>",
        },
    }
    body = {
        "name": "arm at the start",
        "kind": "line",
        "x": packed(arm[:, 0]),
        "y": packed(arm[:, 1]),
        "more": {
            "type": "scatter3d",
            "mode": "lines+markers",
            "z": packed(arm[:, 2]),
            "line": {"color": ARM, "width": 7},
            "marker": {"color": ARM, "size": 3},
            "hoverinfo": "skip",
        },
    }
    edges = [_edges(box, path, arm, forbidden=bad) for bad, box in walls]
    axes = {
        f"{axis}axis": {"title": {"text": f"{axis} [m]"}, "backgroundcolor": "#f7f8fa"}
        for axis in AXES
    }
    camera = {"eye": {"x": 1.3, "y": -1.4, "z": 0.7}, "center": {"x": 0.0, "y": 0.0, "z": -0.12}}
    scene = {**axes, "aspectmode": "data", "camera": camera}
    layout = {"scene": scene, "showlegend": False, "margin": {"l": 0, "r": 0, "t": 0, "b": 0}}
    return {"x": "", "y": "", "traces": [way, body, *edges], "layout": layout}


def _edges(box: BoxSpans, path: Array, arm: Array, *, forbidden: bool) -> dict[str, Any]:
    """The twelve edges of a box as one broken line; open sides end with what is drawn."""
    low, high = _corners(box, path, arm)
    line: list[list[float]] = []
    for axis in range(3):
        u, v = (k for k in range(3) if k != axis)
        for p in (low, high):
            for r in (low, high):
                ends = [np.zeros(3), np.zeros(3)]
                for point, end in zip(ends, (low, high), strict=True):
                    point[[axis, u, v]] = end[axis], p[u], r[v]
                line += [*(end.tolist() for end in ends), [float("nan")] * 3]
    points = np.array(line)
    colour = WALL if forbidden else ARM
    return {
        "name": "box to keep out of" if forbidden else "box",
        "kind": "line",
        "x": packed(points[:, 0]),
        "y": packed(points[:, 1]),
        "more": {
            "type": "scatter3d",
            "mode": "lines",
            "z": packed(points[:, 2]),
            "line": {"color": colour, "width": 2},
            "hoverinfo": "skip",
        },
    }


def _corners(box: BoxSpans, path: Array, arm: Array) -> tuple[Array, Array]:
    """Least and greatest corner; where the box is open, that of all that is drawn."""
    seen = np.concatenate([path, arm])
    low, high = seen.min(axis=0), seen.max(axis=0)
    for k, axis in enumerate(AXES):
        span = getattr(box, axis)
        if span is not None:
            low[k], high[k] = span
    return low, high


def _view(
    path: Array, arm: Array, walls: Sequence[tuple[bool, Any]], a: int, b: int
) -> dict[str, Any]:
    """What is seen along one axis, both scales alike."""

    def line(name: str, points: Array, colour: str, width: float, **more: Any) -> dict[str, Any]:
        own = {"line": {"color": colour, "width": width}, **more}
        x, y = packed(points[:, a]), packed(points[:, b])
        return {"name": name, "kind": "line", "x": x, "y": y, "more": own}

    joints = {"mode": "lines+markers", "marker": {"color": ARM, "size": 6}, "hoverinfo": "skip"}
    traces = [
        line("arm at the start", arm, PALE, 4.0, **joints),
        line("tool", path, PATH, 1.3, hovertemplate="%{x:.3f}, %{y:.3f} m<extra></extra>"),
        line("start", path[:1], START, 1.0, mode="markers", marker={"color": START, "size": 8}),
    ]
    shapes = []
    for bad, box in walls:
        low, high = _corners(box, path, arm)
        fill = {"fillcolor": FORBIDDEN, "layer": "below"} if bad else {}
        shapes.append(
            {
                "type": "rect",
                **{"x0": rounded(low[a]), "x1": rounded(high[a])},
                **{"y0": rounded(low[b]), "y1": rounded(high[b])},
                "line": {"color": WALL, "width": 1.2, "dash": "dot"},
                **fill,
            }
        )
    return {
        "x": f"{AXES[a]} [m]",
        "y": f"{AXES[b]} [m]",
        "traces": traces,
        "layout": {
            "yaxis": {"scaleanchor": "x", "constrain": "domain"},
            "xaxis": {"constrain": "domain"},
            "shapes": shapes,
            "showlegend": False,
        },
    }
