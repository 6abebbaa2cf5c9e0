"""The path of the tool, in space and from three sides, with the walls of its room."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from steelyard.base.arrays import Array
from steelyard.excite.page.design_words import DesignContent
from steelyard.excite.page.robot_in_space import (
    SPACE_AXES,
    Face,
    all_lines,
    box_corners,
    face_segment,
    faces_of,
    skeleton,
    tool_path,
)
from steelyard.report.page import Numbers, Section, packed, rounded, script_json
from steelyard.report.words import significant
from steelyard.robot.loop_closures import all_joints

if TYPE_CHECKING:
    from steelyard.robot.file.excitation_sections import WorkspaceSection


TOOL_PATH_POINTS = 1500
"""Points of the path."""

VIEWS = (("from above", 0, 1), ("from the side", 0, 2), ("from the front", 1, 2))
PATH, ARM, PALE, START = "--blue", "--arm", "--pale", "--green"
TIME_COLOURS = [[0.0, "--blue"], [0.5, "--purple"], [1.0, "--amber"]]
"""Colours of time along the path, from its start to its end."""

WALL, FORBIDDEN = "--poor", "--forbidden"


class DesignToolSection(
    Section, name="design-tool", title="Path of the tool", template="design_tool.html"
):
    """A picture in space, and one from each side."""

    def numbers(self, content: DesignContent) -> Numbers | None:
        """Path, arm and walls."""
        designed = content.design
        robot, tool = designed.robot, designed.tool
        t = np.linspace(0.0, designed.trajectory.duration, TOOL_PATH_POINTS)
        joints = all_joints(robot, designed.trajectory.derivative(t, 0))
        path = tool_path(robot, tool, joints)
        arm = skeleton(robot, tool, joints[0])
        drawn = np.concatenate([path, arm])
        faces = faces_of(content.workspace, robot, drawn)
        boxes = _forbidden(content.workspace, drawn)
        return {
            "tool": tool.title,
            "radius": f"{1e3 * tool.radius:.3g} mm" if tool.radius > 0.0 else "",
            "spans": _spans(path),
            "length": significant(float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())),
            "walls": list(dict.fromkeys(face.name for face in faces if not face.forbidden)),
            "forbidden": bool(boxes),
            "space": script_json(_space(t, path, arm, faces)),
            "views": [
                (words, script_json(_view(path, arm, faces, boxes, (a, b))))
                for words, a, b in VIEWS
            ],
        }


def _spans(path: Array) -> str:
    low, high = path.min(axis=0), path.max(axis=0)
    ends = zip(SPACE_AXES, low, high, strict=True)
    return ", ".join(f"{axis} from {a:.3f} to {b:.3f} m" for axis, a, b in ends)


def _space(t: Array, path: Array, arm: Array, faces: Sequence[Face]) -> dict[str, Any]:
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
                "colorscale": TIME_COLOURS,
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
    walls = [
        _walls([face for face in faces if face.name == name])
        for name in dict.fromkeys(face.name for face in faces)
    ]
    axes = {
        f"{axis}axis": {
            "title": {"text": f"{axis} [m]"},
            **{"gridcolor": "--line", "zerolinecolor": "--zero"},
        }
        for axis in SPACE_AXES
    }
    camera = {"eye": {"x": 1.3, "y": -1.4, "z": 0.7}, "center": {"x": 0.0, "y": 0.0, "z": -0.12}}
    scene = {**axes, "aspectmode": "data", "camera": camera}
    layout = {"scene": scene, "showlegend": False, "margin": {"l": 0, "r": 0, "t": 0, "b": 0}}
    return {"x": "", "y": "", "traces": [way, body, *walls], "layout": layout}


def _forbidden(workspace: WorkspaceSection | None, seen: Array) -> list[tuple[Array, Array]]:
    """Corners of the boxes to keep out of [m]."""
    return [] if workspace is None else [box_corners(box, seen) for box in workspace.keep_out]


def _walls(faces: Sequence[Face]) -> dict[str, Any]:
    """Faces of one name as one broken line."""
    first = faces[0]
    lines = all_lines(faces)
    points = np.concatenate([lines, np.full((len(lines), 1, 3), np.nan)], axis=1).reshape(-1, 3)
    return {
        "name": first.name,
        "kind": "line",
        "x": packed(points[:, 0]),
        "y": packed(points[:, 1]),
        "more": {
            "type": "scatter3d",
            "mode": "lines",
            "z": packed(points[:, 2]),
            "opacity": 1.0 if first.forbidden else 0.4,
            "line": {"color": WALL, "width": 2},
            "hovertemplate": f"{first.name}<extra></extra>",
        },
    }


def _view(
    path: Array,
    arm: Array,
    faces: Sequence[Face],
    boxes: Sequence[tuple[Array, Array]],
    axes: tuple[int, int],
) -> dict[str, Any]:
    """What is seen along one axis, both scales alike."""
    a, b = axes

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
    shapes = [_rectangle(low[[a, b]], high[[a, b]]) for low, high in boxes]
    seen = [face_segment(face, a, b) for face in faces if not face.forbidden]
    shapes += [_line(ends) for ends in seen if ends is not None]
    return {
        "x": f"{SPACE_AXES[a]} [m]",
        "y": f"{SPACE_AXES[b]} [m]",
        "traces": traces,
        "layout": {
            "yaxis": {"scaleanchor": "x", "constrain": "domain"},
            "xaxis": {"constrain": "domain"},
            "shapes": shapes,
            "showlegend": False,
        },
    }


def _rectangle(low: Array, high: Array) -> dict[str, Any]:
    """A forbidden box, from its corners `(2,)` [m]."""
    return _line(np.stack([low, high])) | {
        "type": "rect",
        "fillcolor": FORBIDDEN,
        "layer": "below",
    }


def _line(ends: Array) -> dict[str, Any]:
    """A wall from end to end, shape `(2, 2)` [m]."""
    return {
        "type": "line",
        **{"x0": rounded(ends[0, 0]), "x1": rounded(ends[1, 0])},
        **{"y0": rounded(ends[0, 1]), "y1": rounded(ends[1, 1])},
        "line": {"color": WALL, "width": 1.2, "dash": "dot"},
    }
