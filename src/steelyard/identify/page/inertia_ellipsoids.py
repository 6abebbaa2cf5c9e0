"""The robot in space, with its links as solid ellipsoids of the same inertia."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from steelyard.base.arrays import Array
from steelyard.identify.page.content_and_error_words import ReportContent, fitted_samples
from steelyard.identify.page.link_inertias import identified_links
from steelyard.report.figures import Figure, Group, Traced
from steelyard.report.page import FigureSection, Numbers, packed
from steelyard.report.words import significant
from steelyard.robot.inertia_and_placement import Inertia
from steelyard.robot.loop_closures import loop_equations
from steelyard.robot.robot import Robot, body_poses, sticks

AXES = "xyz"

MERIDIANS, RINGS = 16, 9  # of the surface of an ellipsoid
SPACE_MARGIN = 0.05  # space around the robot, relative to its greatest extent
POINTS_OF_CIRCLE = 25  # points of a circle around an ellipsoid

WORDS = (
    "Each ellipsoid is the solid of uniform density with the mass, the centre of mass and the "
    "inertia of a link. Surfaces: identified; wires: model file. Drag to turn, click an entry of "
    "the legend to hide it."
)

NOTE = (
    "Posture: the middle sample of the fitted runs; of a robot with closed loops, their reference "
    "configuration. A surface larger than its wires has more "
    "inertia per mass than in the model file. Links whose identified mass or inertia is not "
    "physically consistent are left out."
)


class EllipsoidsSection(FigureSection, name="ellipsoids", title="Links as inertia ellipsoids"):
    """One figure in space."""

    def numbers(self, content: ReportContent) -> Numbers | None:
        """The figure, if the estimate knows all standard parameters."""
        robot, links = content.identified.robot, list(identified_links(content.identified))
        joints = _posture(robot, content)
        rotations, origins = body_poses(robot, joints)
        place = {body.name: (rotations[k], origins[k]) for k, body in enumerate(robot.bodies)}
        solids = _placed([(link.name, link.inertia) for link in links], place)
        if not solids:
            return None
        known = {solid.name for solid in solids}
        file = [(x.name, x.nominal) for x in links if x.nominal is not None and x.name in known]
        figure = _figure(sticks(robot, joints), solids, _placed(file, place))
        return {"words": WORDS, "groups": [Group([figure], columns="one")], "note": NOTE}


def semi_axes(inertia: Inertia) -> tuple[Array, Array] | None:
    r"""Half-lengths and directions of the solid ellipsoid with a body's mass and inertia.

    With $\Sigma = \tfrac12\mathrm{tr}(I)\,1 - I$ about the centre of mass, the half-lengths are
    $\sqrt{5 \lambda_i(\Sigma) / m}$.

    Returns:
        Shape `(3,)` [m], and directions as columns, `(3, 3)`; `None` if no body can be so.
    """
    if not inertia.mass > 0.0:
        return None
    about = inertia.inertia_com
    values, vectors = np.linalg.eigh(0.5 * np.trace(about) * np.eye(3) - about)
    if values.min() < 0.0:
        return None
    return np.sqrt(5.0 * values / inertia.mass), vectors


def _posture(robot: Robot, content: ReportContent) -> Array:
    """Positions of joints: the middle sample, else zero; of loops the closed reference."""
    if robot.passive:
        return np.array(loop_equations(robot).assembly)
    samples = fitted_samples(content)
    return np.zeros(robot.n) if samples is None else samples[0].q[len(samples[0].q) // 2]


class Solid(NamedTuple):
    """An ellipsoid in the base's frame."""

    name: str
    mass: float  # [kg]
    centre: Array  # shape `(3,)` [m]
    axes: Array  # half-lengths and directions as columns, shape `(3, 3)` [m]

    def moved(self, unit: Array) -> Array:
        """Points of the unit sphere on the ellipsoid, shape `(k, 3)` [m]."""
        return np.asarray(unit @ self.axes.T + self.centre)


def _placed(
    bodies: Iterable[tuple[str, Inertia]], place: Mapping[str, tuple[Array, Array]]
) -> list[Solid]:
    """The ellipsoids of links by axes `(3, 3)` and origin `(3,)` [m] of each, if they have one."""
    found = []
    for name, inertia in bodies:
        rotation, origin = place[name]
        if (shape := semi_axes(inertia)) is not None:
            centre, axes = rotation @ inertia.com + origin, rotation @ (shape[1] * shape[0])
            found.append(Solid(name, inertia.mass, centre, axes))
    return found


def _figure(arm: Array, solids: Sequence[Solid], file: Sequence[Solid]) -> Figure:
    unit, faces = _sphere()
    points = np.concatenate([solid.moved(unit) for solid in solids])
    traces = [_arm(arm), _surfaces(points, faces, len(solids))]
    traces += [_centres("identified centres", solids, "--vermillion", "diamond")]
    if file:
        traces += [_wires(file), _centres("centres in the file", file, "--measured", "circle")]
    camera = {"eye": {"x": 1.15, "y": -1.25, "z": 0.6}, "center": {"x": 0.0, "y": 0.0, "z": -0.1}}
    layout = {
        "scene": {**_axes(np.concatenate([arm, points])), "camera": camera},
        "margin": {"l": 0, "r": 0, "t": 0, "b": 0},
        "legend": {"orientation": "h", "y": 1.0, "yanchor": "bottom"},
    }
    label = "The robot in space with an ellipsoid for each link, identified and in the model file"
    return Figure("", label, "", "", traces, layout, height=560)


def _axes(points: Array) -> dict[str, Any]:
    """Axes of equal scale, the longest of length 1: slender arms are in view as a whole."""
    low, high = np.nanmin(points, axis=0), np.nanmax(points, axis=0)
    margin = SPACE_MARGIN * float(np.max(high - low))
    extent = np.array([low - margin, high + margin])
    size = extent[1] - extent[0]
    found: dict[str, Any] = {"aspectmode": "manual"}
    found["aspectratio"] = dict(zip(AXES, (size / size.max()).tolist(), strict=True))
    for axis, bounds in zip(AXES, extent.T.tolist(), strict=True):
        title = {"text": f"{axis} [m]"}
        found[f"{axis}axis"] = {"title": title, "backgroundcolor": "--ground", "range": bounds}
    return found


def _space(name: str, points: Array, **more: Any) -> Traced:
    x, y, z = (packed(axis) for axis in points.T)
    return {"name": name, "kind": "line", "x": x, "y": y, "more": {"z": z, **more}}


def _surfaces(points: Array, faces: Array, count: int) -> Traced:
    every = np.concatenate([faces + k * (len(points) // count) for k in range(count)])
    i, j, k = every.T.tolist()
    style = {"color": "--vermillion", "opacity": 0.45, "hoverinfo": "skip", "showlegend": True}
    return _space("identified", points, type="mesh3d", i=i, j=j, k=k, **style)


def _wires(solids: Sequence[Solid]) -> Traced:
    angle = np.linspace(0.0, 2.0 * np.pi, POINTS_OF_CIRCLE)
    flat = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(POINTS_OF_CIRCLE)])
    gap = np.full((1, 3), np.nan)
    circles = np.concatenate([part for k in range(3) for part in (np.roll(flat, k, axis=1), gap)])
    points = np.concatenate([solid.moved(circles) for solid in solids])
    style = {"mode": "lines", "line": {"color": "--measured", "width": 3}, "hoverinfo": "skip"}
    return _space("model file", points, type="scatter3d", **style)


def _centres(name: str, solids: Sequence[Solid], colour: str, symbol: str) -> Traced:
    return _space(
        name,
        np.array([solid.centre for solid in solids]),
        type="scatter3d",
        mode="markers",
        marker={"color": colour, "symbol": symbol, "size": 5},
        text=[f"{solid.name}: {significant(solid.mass)} kg" for solid in solids],
        hovertemplate="%{text}<extra></extra>",
    )


def _arm(points: Array) -> Traced:
    style = {"line": {"color": "--arm", "width": 6}, "marker": {"color": "--arm", "size": 3}}
    return _space(
        "robot", points, type="scatter3d", mode="lines+markers", hoverinfo="skip", **style
    )


def _sphere() -> tuple[Array, Array]:
    """Corners `(V, 3)` of a sphere of radius 1, and its triangles `(F, 3)`."""
    polar = np.pi * np.arange(1, RINGS + 1) / (RINGS + 1)
    around = 2.0 * np.pi * np.arange(MERIDIANS) / MERIDIANS
    rings = [
        [np.sin(p) * np.cos(a), np.sin(p) * np.sin(a), np.cos(p)] for p in polar for a in around
    ]
    corners = np.array([*rings, [0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
    top, bottom = len(corners) - 2, len(corners) - 1
    faces = []
    for m in range(MERIDIANS):
        n = (m + 1) % MERIDIANS
        last = (RINGS - 1) * MERIDIANS
        faces += [(top, m, n), (bottom, last + n, last + m)]
        for ring in range(0, last, MERIDIANS):
            a, b, c, d = ring + m, ring + n, ring + MERIDIANS + m, ring + MERIDIANS + n
            faces += [(a, c, b), (b, c, d)]
    return corners, np.array(faces)
