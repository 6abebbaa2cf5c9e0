"""Kinds of prior constraints on bodies and parameters, by their names in robot files; their use."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from typing import Any, ClassVar, Literal, NoReturn

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import ModelError, advice
from steelyard.estimate.consistent.prior_weight_and_contradictions import refuse_contradictions
from steelyard.estimate.prior.body_priors import (
    Knowledge,
    Row,
    body_index,
    given_knowledge,
    in_words,
    rigid_bodies,
)
from steelyard.estimate.prior.dissipative_friction import dissipation_rows, shaped
from steelyard.estimate.prior.mirrored_limbs import NORMALS, Plane, image_rows, symmetry_rows
from steelyard.model.laws.register import TERMS
from steelyard.model.model import Model
from steelyard.robot.file.model_reading_and_loaded_robot import LoadedRobot
from steelyard.robot.file.tables_by_kind import Kinds
from steelyard.robot.inertia_and_placement import INERTIAL_NAMES


@dataclass(frozen=True, eq=False)
class ConstraintContext:
    """A model's parameters and a constraint's place; what is not there is a `ModelError`."""

    model: Model
    where: str

    def body(self, name: str) -> str:
        """The name, if a moving link with parameters has it."""
        body_index(self.model.robot, name, self.where)
        if not rigid_bodies(self.model):
            self.refuse(
                f"the model has no mass properties of link '{name}'",
                'add "rigid_body" to the terms, or remove the constraint',
            )
        return name

    @property
    def bodies(self) -> tuple[str, ...]:
        """Names of all moving links."""
        return tuple(body.name for body in rigid_bodies(self.model).values())

    def parameters(self, pattern: str) -> tuple[str, ...]:
        """Parameters that a name means; `*` in it stands for anything."""
        found = tuple(n for n in self.model.names if n == pattern or fnmatchcase(n, pattern))
        if not found:
            fix = advice(pattern, self.model.names, "parameters")
            self.refuse(f"the model has no parameter '{pattern}'", fix)
        return found

    def parameter(self, name: str) -> str:
        """The name, if a parameter has it."""
        if name not in self.model.names:
            fix = advice(name, self.model.names, "parameters")
            self.refuse(f"the model has no parameter '{name}'", fix)
        return name

    def refuse(self, wrong: str, fix: str) -> NoReturn:
        """Refuse this constraint."""
        raise ModelError(wrong, where=self.where, fix=fix)

    def row(
        self, label: str, coefficients: Mapping[str, float], interval: "Interval | float"
    ) -> Row:
        """A row with the constraint in words, and its place in the file."""
        low, high = (interval, interval) if isinstance(interval, float) else interval
        return Row(f"{label} ({self.where})", coefficients, low, high)


Interval = tuple[float, float]  # lower and upper bound


@dataclass(frozen=True, kw_only=True)
class Bounded:
    """A quantity that is known, or lies between bounds.

    Attributes:
        lower: Least value; none if `None`.
        upper: Greatest value; none if `None`.
        value: The value itself, instead of bounds.
    """

    lower: float | None = None
    upper: float | None = None
    value: float | None = None

    def interval(self, scope: ConstraintContext) -> Interval:
        """Lower and upper bound, in this order; or one value, not beside bounds."""
        bounds = self.lower is not None or self.upper is not None
        if bounds == (self.value is not None):
            scope.refuse(
                "a value and bounds are given" if bounds else "neither value nor bounds are given",
                "give value = ..., or lower = ... and upper = ..., or one of these",
            )
        if self.value is not None:
            return self.value, self.value
        low = -np.inf if self.lower is None else self.lower
        high = np.inf if self.upper is None else self.upper
        if low > high:
            scope.refuse(
                f"the lower bound {low:g} is above the upper bound {high:g}", "exchange them"
            )
        return low, high


@dataclass(frozen=True, kw_only=True)
class Known(Bounded):
    """Parameters that are known, or lie between bounds.

    Attributes:
        parameter: Name; `*` stands for anything, so that `viscous.*` is that of every joint.
    """

    kind: ClassVar[str] = "parameter"
    parameter: str

    def rows(self, scope: ConstraintContext) -> list[Row]:
        r"""$l \le \phi \le u$ for each."""
        interval = self.interval(scope)
        units = dict(zip(scope.model.names, scope.model.units, strict=True))
        return [
            scope.row(f"'{name}' is {in_words(interval, units[name])}", {name: 1.0}, interval)
            for name in scope.parameters(self.parameter)
        ]


@dataclass(frozen=True, kw_only=True)
class Tied:
    """A parameter that is a multiple of another.

    Attributes:
        parameter: Its name.
        to: The other one.
        factor: How many times the other one it is.
    """

    kind: ClassVar[str] = "tied"
    parameter: str
    to: str
    factor: float = 1.0

    def rows(self, scope: ConstraintContext) -> list[Row]:
        r"""$\phi_1 - k\,\phi_2 = 0$."""
        one, other = scope.parameter(self.parameter), scope.parameter(self.to)
        if one == other:
            scope.refuse(f"'{one}' is tied to itself", "name another parameter under `to`")
        label = f"'{one}' is {self.factor:g} times '{other}'"
        return [scope.row(label, {one: 1.0, other: -self.factor}, 0.0)]


Vector = tuple[float, float, float]
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
        from scipy.spatial import ConvexHull, QhullError

        link, count = scope.body(self.link), len(self.points)
        label = f"the centre of mass of link '{link}' lies between the {count} points"
        try:
            # normals that point out and offsets, `n x + offset <= 0` inside
            facets = ConvexHull(np.reshape(self.points, (-1, 3))).equations
        except (QhullError, ValueError):
            scope.refuse(
                f"the {count} points of link '{self.link}' span no volume",
                "give four points or more that are not in one plane [m]",
            )
        names = (*(f"m{axis}.{link}" for axis in "xyz"), f"m.{link}")
        return [
            scope.row(label, dict(zip(names, facet, strict=True)), (-np.inf, 0.0))
            for facet in np.unique(facets.round(12), axis=0).tolist()
        ]


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
        each = ", ".join(f"'{x}'" for x in self.links)
        label = f"links {each} are equal ({scope.where})"
        return [row for x in others for row in image_rows(label, first, x, np.eye(10))]


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
        label = f"links '{one}' and '{other}' mirror each other ({scope.where})"
        return image_rows(label, one, other, np.diag(reflected(self.plane)))


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
        else:
            label = f"link '{link}' is symmetric about its {self.axis} axis"
        planes = (plane for plane in NORMALS if plane == self.plane or (self.axis or "-") in plane)
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


def reflected(plane: Plane) -> Array:
    """Signs of the ten numbers of a body's mirror image across a plane of its frame."""
    x, y, z = (-1.0 if axis == NORMALS[plane] else 1.0 for axis in range(3))
    return np.array([1.0, x, y, z, 1.0, x * y, 1.0, x * z, y * z, 1.0])


def _several(links: tuple[str, ...], scope: ConstraintContext) -> tuple[str, ...]:
    if len(links) < 2 or len(set(links)) < len(links):
        scope.refuse(
            f"links to be compared are {', '.join(links) or 'none'}", "name two different links"
        )
    return tuple(scope.body(link) for link in links)


CONSTRAINTS: dict[str, type[Any]] = {
    constraint.kind: constraint
    for constraint in (
        Mass,
        TotalMass,
        CentreInBox,
        CentreInHull,
        Known,
        Tied,
        Equal,
        Mirrored,
        Symmetric,
    )
}
"""Every kind of knowledge: `rows` gives it over a model's standard parameters, if that has them."""

KINDS = Kinds(CONSTRAINTS, "kind", "kind of knowledge", "knowledge of kind")


def knowledge_of(model: Model, loaded: LoadedRobot, fastest: Array | None = None) -> Knowledge:
    """All that model and robot file say before the data.

    Constraints on friction that was chosen from the data, or is still to be, and is not in the
    model, are passed over with a note. Up to the greatest speed of each joint in the data [rad/s;
    m/s] and beyond, friction is bounded as a whole; without it, coefficient by coefficient.

    Raises:
        ModelError: A constraint is none, names what is not there, or contradicts itself.
        DataError: Constraints contradict each other.
    """
    known = given_knowledge(model, loaded.prior, loaded.where)
    rows: list[Row] = []
    notes = list(known.notes)
    for number, table in enumerate(loaded.knowledge):
        where = loaded.where("knowledge", number)
        constraint: Any = KINDS.built(table, where)
        if loaded.friction and (absent := _of_absent_law(constraint, model)):
            notes.append(f"the model has no '{absent}': prior constraints on it are ignored")
            continue
        mine = constraint.rows(ConstraintContext(model, where))
        acted_on = {name for row in mine for name in row.coefficients}
        if own := [name for name in model.per_run_names if name in acted_on]:
            wrong = f"every run has a '{own[0]}' of its own, which no prior constraint can act on"
            fix = "remove the constraint, or remove per_run from the term"
            raise ModelError(wrong, where=where, fix=fix)
        rows += mine
    if loaded.prior.symmetry is not None:
        rows += symmetry_rows(model, loaded.prior.symmetry, loaded.where("prior", "symmetry"))
    lower, loosened = _loosened(known, rows)
    notes += [f"'{name}' may be below zero, as the robot file allows" for name in loosened]
    known = replace(known, lower=lower, rows=tuple(rows), notes=tuple(notes))
    refuse_contradictions(known)
    if fastest is None:
        return known
    # friction is bounded as a whole where the user has not set a bound lower
    curves = tuple(
        row for row in dissipation_rows(model, fastest) if not set(loosened) & set(row.coefficients)
    )
    return replace(known, curves=curves, shaped=shaped(model, curves))


def _of_absent_law(constraint: Any, model: Model) -> str | None:
    """The parameter of a friction law that the model lacks, if a constraint names one."""
    if not isinstance(constraint, Known | Tied):
        return None
    names = [constraint.parameter]
    if isinstance(constraint, Tied):
        names.append(constraint.to)
    absent = tuple(set(TERMS) - {term.law for term in model.terms})
    return next((name for name in names if name.startswith(absent)), None)


def _loosened(known: Knowledge, rows: list[Row]) -> tuple[Array, list[str]]:
    """Lower bounds with those of laws that the user sets lower, and the names of these."""
    lower, place = np.array(known.lower), {name: k for k, name in enumerate(known.names)}
    loosened = []
    for row in rows:
        if len(row.coefficients) != 1 or not np.isfinite(row.lower):
            continue
        name = next(iter(row.coefficients))
        k = place[name]
        if not known.of_bodies[k] and row.lower < lower[k]:
            lower[k] = row.lower
            loosened.append(name)
    return lower, loosened
