"""Masses, centres and moments of inertia of links, and the links as ellipsoids of the same."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import sqrt
from typing import Any, NamedTuple

import numpy as np

from steelyard.base.arrays import Z95, Array, places_of
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.estimate.prior.body_priors import model_prior, rigid_bodies, spread_of
from steelyard.identify.page.report_content_and_error_words import ReportContent, pooled_samples
from steelyard.report.page import FigureSection, Numbers, TableSection, rounded
from steelyard.report.page_figures import Figure, Group, Key, Traced, dots, figure_of_rows, in_space
from steelyard.report.tables import PlainTable, Row, table_of
from steelyard.report.words import NONE, fixed, share, significant, with_interval
from steelyard.robot.inertia_and_placement import INERTIAL_NAMES, Inertia
from steelyard.robot.loop_closures import loop_equations
from steelyard.robot.robot import bodies_along, sticks

BODIES_WORDS = (
    "Estimate of each link from data and prior, with 95 % intervals. The data alone determine only "
    "the base parameters above; the prior determines how their sums are distributed over links. "
    "Margin: distance from physical inconsistency, 1 being the prior of the model file and 0 "
    "the limit (smallest eigenvalue of the pseudo-inertia in the prior's scale)."
)


@dataclass(frozen=True, eq=False)
class IdentifiedLink:
    """One link."""

    name: str
    inertia: Inertia
    covariance: Array  # of the ten numbers, shape `(10, 10)`
    learned: float  # mean share of the ten numbers that comes from the data, 0 to 1
    nominal: Inertia | None  # mass properties in the model file; `None` if it has none
    margin: float  # smallest eigenvalue of the pseudo-inertia in the scale of the prior

    @property
    def mass_half_width(self) -> float:
        """Half-width of the 95 % interval of the mass [kg]."""
        return float(Z95 * np.sqrt(np.maximum(self.covariance[0, 0], 0.0)))

    @property
    def com_std(self) -> Array:
        """Standard deviation of the centre of mass, to first order, shape `(3,)` [m]."""
        if not self.inertia.mass:
            return np.full(3, np.nan)
        slope = np.column_stack([-self.inertia.com, np.eye(3)]) / self.inertia.mass
        variances = np.diag(slope @ self.covariance[:4, :4] @ slope.T)
        return np.asarray(np.sqrt(np.maximum(variances, 0.0)))


class BodiesSection(TableSection, name="bodies", title="Link inertial parameters"):
    """One row per link, and their sum."""

    def tables(self, content: ReportContent) -> list[PlainTable]:
        """The table, if the estimate knows all standard parameters."""
        identified = content.identified
        table = table_of(identified_links(identified), LINK_COLUMNS, words=BODIES_WORDS)
        standard = identified.estimate.standard
        if standard is None or not table.rows:
            return []
        bodies = rigid_bodies(identified.model).values()
        masses = [f"m.{body.name}" for body in bodies]
        variance = max(float(standard.covariance_of(masses).sum()), 0.0)
        nominal = sum(body.inertia.mass for body in bodies)
        mass = float(standard.parameters.named(masses).sum())
        file = significant(nominal) if all(body.known for body in bodies) else NONE
        cells = ("all links", with_interval(mass, Z95 * sqrt(variance)), file, *("",) * 4)
        return [replace(table, rows=(*table.rows, Row(cells, total=True)), text=(0, 3, 4))]


def identified_links(identified: IdentifiedModel) -> Iterator[IdentifiedLink]:
    """The links of an estimate that knows all standard parameters."""
    standard, robot = identified.estimate.standard, identified.model.robot
    if standard is None:
        return
    names = standard.parameters.names
    for number, body in rigid_bodies(identified.model).items():
        ten = places_of((f"{kind}.{body.name}" for kind in INERTIAL_NAMES), names)
        inertia = Inertia.from_ten(standard.parameters.values[ten])
        covariance, learned = standard.covariance[np.ix_(ten, ten)], standard.learned[ten].mean()
        nominal = body.inertia if body.known else None
        least = margin(inertia, model_prior(robot, number).inertia)
        yield IdentifiedLink(body.name, inertia, covariance, float(learned), nominal, least)


def whole_body_words(identified: IdentifiedModel) -> str:
    """Mass and centre of mass of a robot with a floating base; empty where they are not seen."""
    base = identified.signals.base
    if base is None or not base.wrench_known or not identified.motions:
        return ""
    posture = np.concatenate([samples.q for samples in identified.motions]).mean(axis=0)
    found = identified.mass_and_centre(posture)
    exact = "the scale of the efforts is exact"
    if base.touches:
        exact += ", and contacts touch where the robot file says"
    elif base.contacts:
        exact = "the scale of the contacts' forces is exact"
    axes = zip("xyz", found.centre, found.half_width, strict=True)
    centre = ", ".join(f"{name} {with_interval(c, h)}" for name, c, h in axes)
    return (
        f"whole robot: {with_interval(found.mass, found.mass_half_width)} kg, centre of mass in "
        f"the mean posture of the fitted logs {centre} m in the frame of the base, if {exact}"
    )


def margin(inertia: Inertia, prior: Inertia) -> float:
    """Smallest eigenvalue of the pseudo-inertia in the scale of a prior's; no unit."""
    factor = np.linalg.cholesky(prior.pseudo)
    half = np.linalg.solve(factor, inertia.pseudo)
    return float(np.linalg.eigvalsh(np.linalg.solve(factor, half.T)).min())


def _centre(link: IdentifiedLink) -> str:
    pairs = zip(link.inertia.com, link.com_std, strict=True)
    words = ", ".join(f"{fixed(c)} ± {fixed(Z95 * s)}" for c, s in pairs)
    return words if link.inertia.mass else NONE


LINK_COLUMNS: dict[str, Callable[[IdentifiedLink], str]] = {
    "Link": lambda x: x.name,
    "Mass ± [kg]": lambda x: with_interval(x.inertia.mass, x.mass_half_width),
    "In the file [kg]": lambda x: significant(None if x.nominal is None else x.nominal.mass),
    "Centre x, y, z ± [m]": _centre,
    "Principal moments [kg m²]": lambda x: ", ".join(
        map(significant, np.linalg.eigvalsh(x.inertia.inertia_com).tolist())
    ),
    "From data (mean of ten)": lambda x: share(100.0 * x.learned),
    "Margin": lambda x: (
        significant(x.margin, 2) + ("" if x.margin > 0.0 else ": not physically consistent")
    ),
}


MASSES_WORDS = (
    "Mass of each link in the model file and as identified from data and prior, and the shift of "
    "its centre of mass against the file, in the link's frame. Only sums of these numbers affect "
    "the torque, so the prior determines how they are divided among links: an estimate with a "
    "large share of the prior is near the file because it started there, not because the data "
    "confirm it."
)


class MassesSection(FigureSection, name="masses", title="Masses and centres, before and after"):
    """One figure of the masses, three of the centres."""

    def numbers(self, content: ReportContent) -> Numbers | None:
        """Masses and centres, if the estimate knows all standard parameters."""
        links = list(identified_links(content.identified))
        if not links:
            return None
        known = {} if content.truth is None else content.truth.as_dict()
        true = {
            link.name: Inertia.from_ten([known[f"{kind}.{link.name}"] for kind in INERTIAL_NAMES])
            for link in links
            if known
        }
        groups = [Group([_masses(links, true)], columns="one")]
        moved = [link for link in links if link.nominal is not None and link.inertia.mass]
        if moved:
            groups.append(Group([_shifts(moved, axis, true) for axis in range(3)], columns="three"))
        return {
            "words": MASSES_WORDS,
            "legend": [
                Key("--measured", "model file", "point"),
                Key("--predicted", "identified, with 95 % interval", "point"),
                *([Key("--green", "truth (simulated robot)", "point")] if true else []),
                Key("--arm", "share of the prior in the estimate", "area"),
            ],
            "groups": groups,
            "note": "Share of the prior: mean over the ten inertial parameters of a link.",
        }

    def to_dict(self, content: ReportContent) -> dict[str, Any]:
        """Masses and centres."""
        return {
            "bodies": [link_dict(link) for link in identified_links(content.identified)] or None
        }


def _masses(links: list[IdentifiedLink], true: dict[str, Inertia]) -> Figure:
    names = [link.name for link in links]
    file = {link.name: link.nominal.mass for link in links if link.nominal is not None}
    priors = [rounded(100.0 * (1.0 - link.learned)) for link in links]
    hover = "%{y}: %{x:.0f} % from the prior<extra></extra>"
    style = {"orientation": "h", "marker": {"color": "--arm"}, "hovertemplate": hover}
    more = {"type": "bar", "xaxis": "x2", **style}
    bars: Traced = {"name": "prior", "kind": "points", "x": priors, "y": names, "more": more}
    masses = [link.inertia.mass for link in links]
    half = [link.mass_half_width for link in links]
    crosses = {name: body.mass for name, body in true.items()}
    return figure_of_rows(
        "Masses of all links in the model file and as identified",
        "mass [kg]",
        names,
        [*_marks(file, names, masses, half, crosses, 9), bars],
        34,
        xaxis={"domain": [0.0, 0.68], "rangemode": "tozero"},
        xaxis2={
            "domain": [0.76, 1.0],
            "range": [0, 100],
            "title": {"text": "prior [%]", "standoff": 6},
        },
        bargap=0.5,
    )


def _shifts(links: list[IdentifiedLink], axis: int, true: dict[str, Inertia]) -> Figure:
    """Identified minus nominal centre along one axis of the link's frame [mm]."""
    names = [link.name for link in links]
    file = {x.name: np.zeros(3) if x.nominal is None else x.nominal.com for x in links}
    shift = [1e3 * (link.inertia.com - file[link.name])[axis] for link in links]
    half = [1e3 * Z95 * link.com_std[axis] for link in links]
    crosses = {n: 1e3 * (true[n].com - file[n])[axis] for n in names if n in true}
    marks = _marks(dict.fromkeys(names, 0.0), names, shift, half, crosses, 8)
    along = f"along {'xyz'[axis]}"
    label = f"Shift of the centres of mass {along}"
    return figure_of_rows(label, f"shift {along} [mm]", names, marks, 28)


def _marks(
    file: dict[str, float],
    names: list[str],
    values: list[float],
    half_widths: list[float],
    true: dict[str, float],
    size: int,
) -> list[Traced]:
    """Numbers of the model file, those identified, and crosses where the truth is known."""
    ring: dict[str, Any] = {"symbol": "circle-open", "size": 10}
    diamond: dict[str, Any] = {"symbol": "diamond", "size": size, "half_widths": half_widths}
    marks = [
        dots("model file", [*file.values()], list(file), "--measured", **ring),
        dots("identified", values, names, "--predicted", **diamond),
    ]
    if true:
        marks.append(dots("truth", [*true.values()], list(true), "--green", symbol="x", size=6))
    return marks


def link_dict(link: IdentifiedLink) -> dict[str, Any]:
    """As JSON values."""
    file = link.nominal
    return {
        "link": link.name,
        "mass": rounded(link.inertia.mass),
        "mass_half_width": rounded(link.mass_half_width),
        "mass_file": None if file is None else rounded(file.mass),
        "centre": list(map(rounded, link.inertia.com)),
        "centre_half_width": list(map(rounded, Z95 * link.com_std)),
        "centre_file": None if file is None else list(map(rounded, file.com)),
        "data_share": rounded(link.learned),
        "margin": float(significant(link.margin, 4)),
    }


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
    "configuration. A surface larger than its wires has more inertia per mass than in the model "
    "file. Links whose identified mass or inertia is not physically consistent are left out."
)


class EllipsoidsSection(FigureSection, name="ellipsoids", title="Links as inertia ellipsoids"):
    """One figure in space."""

    def numbers(self, content: ReportContent) -> Numbers | None:
        """The figure, if the estimate knows all standard parameters."""
        robot, links = content.identified.robot, list(identified_links(content.identified))
        samples = pooled_samples(content, "fitted")
        joints = np.zeros(robot.n) if samples is None else samples[0].q[len(samples[0].q) // 2]
        if robot.passive:
            joints = np.array(loop_equations(robot).assembly)
        rotations, origins = ([x[0] for x in xs[1:]] for xs in bodies_along(robot, joints[None]))
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
    values, vectors = np.linalg.eigh(spread_of(inertia))
    if values.min() < 0.0:
        return None
    return np.sqrt(5.0 * values / inertia.mass), vectors


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
    every = np.concatenate([faces + number * len(unit) for number in range(len(solids))])
    i, j, k = every.T.tolist()
    style = {"color": "--vermillion", "opacity": 0.45, "hoverinfo": "skip", "showlegend": True}
    surfaces = in_space("identified", points, type="mesh3d", i=i, j=j, k=k, **style)
    stick = {"line": {"color": "--arm", "width": 6}, "marker": {"color": "--arm", "size": 3}}
    traces = [
        in_space("robot", arm, mode="lines+markers", hoverinfo="skip", **stick),
        surfaces,
        _centres("identified centres", solids, "--vermillion", "diamond"),
    ]
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
    ratio = dict(zip("xyz", (size / size.max()).tolist(), strict=True))
    found: dict[str, Any] = {"aspectmode": "manual", "aspectratio": ratio}
    for axis, bounds in zip("xyz", extent.T.tolist(), strict=True):
        title = {"text": f"{axis} [m]"}
        found[f"{axis}axis"] = {"title": title, "backgroundcolor": "--ground", "range": bounds}
    return found


def _wires(solids: Sequence[Solid]) -> Traced:
    angle = np.linspace(0.0, 2.0 * np.pi, POINTS_OF_CIRCLE)
    flat = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(POINTS_OF_CIRCLE)])
    gap = np.full((1, 3), np.nan)
    circles = np.concatenate([part for k in range(3) for part in (np.roll(flat, k, axis=1), gap)])
    points = np.concatenate([solid.moved(circles) for solid in solids])
    style = {"mode": "lines", "line": {"color": "--measured", "width": 3}, "hoverinfo": "skip"}
    return in_space("model file", points, **style)


def _centres(name: str, solids: Sequence[Solid], colour: str, symbol: str) -> Traced:
    return in_space(
        name,
        np.array([solid.centre for solid in solids]),
        mode="markers",
        marker={"color": colour, "symbol": symbol, "size": 5},
        text=[f"{solid.name}: {significant(solid.mass)} kg" for solid in solids],
        hovertemplate="%{text}<extra></extra>",
    )


def _sphere() -> tuple[Array, Array]:
    """Corners `(V, 3)` of a sphere of radius 1, and its triangles `(F, 3)`."""
    polar = np.pi * np.arange(1, RINGS + 1) / (RINGS + 1)
    around = 2.0 * np.pi * np.arange(MERIDIANS) / MERIDIANS
    rings = [
        [np.sin(p) * np.cos(a), np.sin(p) * np.sin(a), np.cos(p)] for p in polar for a in around
    ]
    corners = np.array([*rings, [0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
    top, bottom, last = len(corners) - 2, len(corners) - 1, (RINGS - 1) * MERIDIANS
    faces = []
    for m in range(MERIDIANS):
        n = (m + 1) % MERIDIANS
        faces += [(top, m, n), (bottom, last + n, last + m)]
        for ring in range(0, last, MERIDIANS):
            a, b, c, d = ring + m, ring + n, ring + MERIDIANS + m, ring + MERIDIANS + n
            faces += [(a, c, b), (b, c, d)]
    return corners, np.array(faces)
