"""What can be known of bodies: masses, centres, symmetries."""

from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from steelyard.arrays import Array
from steelyard.estimation.knowledge import Row
from steelyard.estimation.prior.prior_constraint import Bounded, ConstraintContext, in_words
from steelyard.robot.inertia import INERTIAL_NAMES

Vector = tuple[float, float, float]
Plane = Literal["xy", "xz", "yz"]
Axis = Literal["x", "y", "z"]


@dataclass(frozen=True, kw_only=True)
class Mass(Bounded):
    """The mass of a link [kg]."""

    kind: ClassVar[str] = "mass"
    link: str

    def rows(self, scope: ConstraintContext) -> list[Row]:
        r"""$l \le m \le u$."""
        link, interval = scope.body(self.link), self.interval(scope)
        label = f"the mass of link '{link}' is {in_words(interval, 'kg')}"
        return [scope.row(label, {f"m.{link}": 1.0}, interval)]


@dataclass(frozen=True, kw_only=True)
class TotalMass(Bounded):
    """The mass of several links together [kg].

    Attributes:
        links: Their names; all moving links if `None`.
    """

    kind: ClassVar[str] = "total_mass"
    links: tuple[str, ...] | None = None

    def rows(self, scope: ConstraintContext) -> list[Row]:
        r"""$l \le \sum m_i \le u$."""
        links = scope.bodies if self.links is None else self.links
        if not links:
            scope.refuse("a total mass is given, but no link", 'name links, or add "rigid_body"')
        if twice := [link for link in links if links.count(link) > 1]:
            scope.refuse(f"link '{twice[0]}' is named twice", "name it once")
        interval = self.interval(scope)
        of = "of all links" if self.links is None else "of " + ", ".join(f"'{x}'" for x in links)
        label = f"the total mass {of} is {in_words(interval, 'kg')}"
        return [scope.row(label, {f"m.{scope.body(x)}": 1.0 for x in links}, interval)]


@dataclass(frozen=True, kw_only=True)
class CentreInBox:
    """A centre of mass lies in a box along the axes of the link's frame.

    Attributes:
        link: The link.
        lower: The box's least coordinates [m].
        upper: Its greatest.
    """

    kind: ClassVar[str] = "centre_in_box"
    link: str
    lower: Vector
    upper: Vector

    def rows(self, scope: ConstraintContext) -> list[Row]:
        r"""$m\,l \le m c \le m\,u$ along every axis."""
        link = scope.body(self.link)
        label = f"the centre of mass of link '{link}' lies in a box"
        rows = []
        for axis, low, high in zip("xyz", self.lower, self.upper, strict=True):
            if low > high:
                scope.refuse(
                    f"the box's lower {axis} is {low:g}, its upper one {high:g}", "exchange them"
                )
            moment = f"m{axis}.{link}"
            rows += [
                scope.row(label, {moment: 1.0, f"m.{link}": -low}, (0.0, np.inf)),
                scope.row(label, {moment: 1.0, f"m.{link}": -high}, (-np.inf, 0.0)),
            ]
        return rows


@dataclass(frozen=True, kw_only=True)
class CentreInHull:
    """A centre of mass lies between points of the link, in its frame.

    Attributes:
        link: The link.
        points: Four or more, not in one plane [m].
    """

    kind: ClassVar[str] = "centre_in_hull"
    link: str
    points: tuple[Vector, ...]

    def rows(self, scope: ConstraintContext) -> list[Row]:
        r"""$n \cdot m c \le d\,m$ for every facet of the convex hull with normal $n$."""
        link = scope.body(self.link)
        label = f"the centre of mass of link '{link}' lies between the {len(self.points)} points"
        return [
            scope.row(
                label,
                {f"m{axis}.{link}": float(n) for axis, n in zip("xyz", normal, strict=True)}
                | {f"m.{link}": float(offset)},
                (-np.inf, 0.0),
            )
            for *normal, offset in self._facets(scope)
        ]

    def _facets(self, scope: ConstraintContext) -> Array:
        """Normals that point out and offsets, `n x + offset <= 0` inside, shape `(k, 4)`."""
        from scipy.spatial import ConvexHull, QhullError

        try:
            facets = ConvexHull(np.reshape(self.points, (-1, 3))).equations
        except (QhullError, ValueError):
            scope.refuse(
                f"the {len(self.points)} points of link '{self.link}' span no volume",
                "give four points or more that are not in one plane [m]",
            )
        kept = np.unique(facets.round(12), axis=0)
        return np.asarray(kept, dtype=np.float64)


@dataclass(frozen=True, kw_only=True)
class Equal:
    """Links with the same mass properties, each in its own frame.

    Attributes:
        links: Two or more.
    """

    kind: ClassVar[str] = "equal"
    links: tuple[str, ...]

    def rows(self, scope: ConstraintContext) -> list[Row]:
        """Ten equations per further link."""
        first, *others = _several(self.links, scope)
        label = "links " + ", ".join(f"'{x}'" for x in self.links) + " are equal"
        return [row for x in others for row in _alike(scope, label, first, x, np.ones(10))]


@dataclass(frozen=True, kw_only=True)
class Mirrored:
    """Two links that are mirror images, each in its own frame.

    Attributes:
        links: Both.
        plane: The plane of the frames that mirrors one to the other.
    """

    kind: ClassVar[str] = "mirrored"
    links: tuple[str, str]
    plane: Plane

    def rows(self, scope: ConstraintContext) -> list[Row]:
        """Ten equations: what is odd across the plane changes its sign."""
        one, other = _several(self.links, scope)
        label = f"links '{one}' and '{other}' mirror each other"
        return _alike(scope, label, one, other, reflected(self.plane))


@dataclass(frozen=True, kw_only=True)
class Symmetric:
    """A link that is its own mirror image, or looks the same all around an axis.

    Planes and axes are those through the origin of the link's frame.

    Attributes:
        link: The link.
        plane: The plane that mirrors it; or
        axis: the axis around which it may be turned.
    """

    kind: ClassVar[str] = "symmetric"
    link: str
    plane: Plane | None = None
    axis: Axis | None = None

    def rows(self, scope: ConstraintContext) -> list[Row]:
        """What is odd is zero; around an axis both moments across it are equal."""
        link = scope.body(self.link)
        if (self.plane is None) == (self.axis is None):
            scope.refuse(
                f"the symmetry of link '{link}' is about a plane or an axis",
                'give plane = "xz", or axis = "z"',
            )
        if self.axis is None:
            label = f"link '{link}' is symmetric about its {self.plane} plane"
            planes = [plane for plane in _SIGNS if plane == self.plane]
        else:
            label = f"link '{link}' is symmetric about its {self.axis} axis"
            planes = [plane for plane in _SIGNS if self.axis in plane]
        odd = np.min([reflected(plane) for plane in planes], axis=0) < 0.0
        rows = [
            scope.row(label, {f"{name}.{link}": 1.0}, 0.0)
            for name, is_odd in zip(INERTIAL_NAMES, odd, strict=True)
            if is_odd
        ]
        if self.axis is not None:
            one, other = (f"I{x}{x}.{link}" for x in "xyz" if x != self.axis)
            rows.append(scope.row(label, {one: 1.0, other: -1.0}, 0.0))
        return rows


_SIGNS: dict[Plane, Vector] = {
    "xy": (1.0, 1.0, -1.0),
    "xz": (1.0, -1.0, 1.0),
    "yz": (-1.0, 1.0, 1.0),
}


def reflected(plane: Plane) -> Array:
    """Signs of the ten numbers of a body's mirror image across a plane of its frame."""
    x, y, z = _SIGNS[plane]
    return np.array([1.0, x, y, z, 1.0, x * y, 1.0, x * z, y * z, 1.0])


def _several(links: tuple[str, ...], scope: ConstraintContext) -> tuple[str, ...]:
    if len(links) < 2 or len(set(links)) < len(links):
        scope.refuse(
            f"links to be compared are {', '.join(links) or 'none'}", "name two different links"
        )
    return tuple(scope.body(link) for link in links)


def _alike(scope: ConstraintContext, label: str, one: str, other: str, signs: Array) -> list[Row]:
    return [
        scope.row(label, {f"{name}.{other}": 1.0, f"{name}.{one}": -float(sign)}, 0.0)
        for name, sign in zip(INERTIAL_NAMES, signs, strict=True)
    ]
