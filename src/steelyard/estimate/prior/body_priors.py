"""Knowledge of bodies before the data: priors of the model file, of `[prior]`, of solid shapes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.base.arrays import Array, by_key, frozen, places_of
from steelyard.base.errors import ModelError, advice
from steelyard.model.model import Model
from steelyard.robot.file.sections import LinkPriorSection, PriorSection
from steelyard.robot.file.signals_from_tables import Locate
from steelyard.robot.inertia_and_placement import INERTIAL_NAMES, Inertia, symmetric
from steelyard.robot.robot import Body, Robot


@dataclass(frozen=True)
class Row:
    r"""A linear constraint, $l \le \sum_k a_k \phi_k \le u$, over standard parameters."""

    label: str  # what was wished and where, for messages
    coefficients: Mapping[str, float]  # $a_k$ by name
    lower: float = -np.inf
    upper: float = np.inf


def in_words(interval: tuple[float, float], unit: str = "") -> str:
    """A bound as people say it: `at least 3 kg`, `between 3 and 5 kg`, `3 kg`."""
    low, high = interval
    if low == high:
        text = f"{low:g}"
    elif not np.isfinite(high):
        text = f"at least {low:g}"
    elif not np.isfinite(low):
        text = f"at most {high:g}"
    else:
        text = f"between {low:g} and {high:g}"
    return f"{text} {unit}".rstrip()


@dataclass(frozen=True, eq=False)
class Knowledge:
    """What is known before the data."""

    names: tuple[str, ...]
    bodies: tuple[str, ...]  # names of the bodies, in the model's order
    # per body the nominal mass properties, with a positive definite pseudo-inertia; `None` for a
    # body without prior
    priors: tuple[Inertia | None, ...]
    lower: Array  # lower bounds of the parameters, `(p,)`
    upper: Array  # upper bounds, `(p,)`
    rows: tuple[Row, ...] = ()
    curves: tuple[Row, ...] = ()  # rows that bound the friction along a coordinate as a whole
    # parameters in them whose own lower bounds these rows replace
    shaped: frozenset[str] = frozenset()
    # standard deviations from zero that some parameters have, by name
    deviations: Mapping[str, float] = field(default_factory=dict)
    # relative uncertainty of the priors; found from the data if `None`
    uncertainty: float | None = None
    notes: tuple[str, ...] = ()  # what was assumed, for people to read

    def __post_init__(self) -> None:
        for name in ("lower", "upper"):
            object.__setattr__(self, name, frozen(getattr(self, name), (len(self.names),)))

    @cached_property
    def of_bodies(self) -> NDArray[np.bool_]:
        """Whether each parameter is one of a body's ten, shape `(p,)`."""
        mine = [k for body in range(len(self.bodies)) for k in self.tens(body)]
        return np.isin(np.arange(len(self.names)), mine)

    def tens(self, body: int) -> list[int]:
        """Indices of a body's ten parameters among `names`."""
        return places_of((f"{kind}.{self.bodies[body]}" for kind in INERTIAL_NAMES), self.names)


DENSITY = 2000.0  # of a stand-in [kg/m³]: castings with motors, gears and air in them
STEEL = 8000.0  # density that no real body exceeds [kg/m³]


def of_spread(mass: float, com: ArrayLike, spread: ArrayLike) -> Inertia:
    r"""The body with the second moments $\Sigma_c = \int (x - c)(x - c)^T\,dm$ about its centre.

    Mass in kg, centre `(3,)` [m], and $\Sigma_c$ in link axes, `(3, 3)` [kg m²].
    """
    spread = np.asarray(spread, dtype=np.float64)
    return Inertia.about_com(mass, com, np.trace(spread) * np.eye(3) - spread)


def spread_of(inertia: Inertia) -> Array:
    r"""$\Sigma_c = \tfrac12 \mathrm{tr}(I_c)\,1 - I_c$, shape `(3, 3)` [kg m²]."""
    about_com = inertia.inertia_com
    return np.asarray(0.5 * np.trace(about_com) * np.eye(3) - about_com)


def box(mass: float, centre: ArrayLike, size: ArrayLike) -> Inertia:
    r"""A solid box along the link's axes: $\Sigma_c = \tfrac{m}{12}\,\mathrm{diag}(s^2)$.

    Its centre and the lengths $s$ of its edges are of shape `(3,)` [m].
    """
    edges = np.asarray(size, dtype=np.float64)
    return of_spread(mass, centre, mass / 12.0 * np.diag(edges**2))


def ball(mass: float, centre: ArrayLike, radius: float | None = None) -> Inertia:
    r"""A solid ball, $\Sigma_c = \tfrac{m}{5} r^2\,1$; of `DENSITY` if no radius is given."""
    radius = _ball_radius(mass, DENSITY) if radius is None else radius
    return of_spread(mass, centre, mass * radius**2 / 5.0 * np.eye(3))


def capsule(mass: float, start: ArrayLike, end: ArrayLike, radius: float | None = None) -> Inertia:
    """A solid rod with round ends, between the centres of its end balls, each `(3,)` [m].

    With $l$ the distance of the ends, $m_c$ and $m_b$ the masses of the cylinder and of both half
    balls: along the axis $m_c l^2/12 + m_b (r^2/5 + l^2/4 + 3 l r/8)$, across it
    $m_c r^2/4 + m_b r^2/5$. The radius [m] is that of a body of `DENSITY` if `None`.
    """
    first, last = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
    length = float(np.linalg.norm(last - first))
    if radius is None:  # the root of pi r^2 l + 4/3 pi r^3 = m / density
        roots = np.roots([4.0 / 3.0, length, 0.0, -mass / (np.pi * DENSITY)])
        radius = float(roots[np.isreal(roots) & (roots.real > 0.0)].real[0])
    if length < 1e-9:
        return ball(mass, first, radius)
    volumes = np.array([length, 4.0 / 3.0 * radius])
    cylinder, ends = mass * volumes / volumes.sum()
    along = cylinder * length**2 / 12.0
    along += ends * (radius**2 / 5.0 + length**2 / 4.0 + 0.375 * length * radius)
    across = cylinder * radius**2 / 4.0 + ends * radius**2 / 5.0
    axis = (last - first) / length
    spread = across * np.eye(3) + (along - across) * np.outer(axis, axis)
    return of_spread(mass, (first + last) / 2.0, spread)


def _ball_radius(mass: float, density: float) -> float:
    return float(np.cbrt(0.75 * mass / (np.pi * density)))


THINNEST = 1e-2
"""Least second moment about the centre of mass, relative to the greatest.

Links from CAD have 0.017 and more; lifting to this changes no moment of inertia by more than 2 %
of the greatest, much less than what a prior is taken for. Below it a prior pretends to know the
thin side of a link better than anyone does."""

UNKNOWN_MASS = 1.0  # of a link without mass where no link of the robot has one [kg]


@dataclass(frozen=True, eq=False)
class PriorBody:
    """A body that can be a prior: its pseudo-inertia is positive definite."""

    inertia: Inertia
    why: str | None = None  # why the one given could not be, and what was done; `None` if it could
    thin: bool = False  # whether it was only widened, being thinner than `THINNEST`


def default_knowledge(model: Model) -> Knowledge:
    """What the model file says: its bodies, corrected with notes, and bounds of the parameters."""
    return knowledge_with(
        model, {body.name: model_prior(model.robot, k) for k, body in rigid_bodies(model).items()}
    )


def knowledge_with(model: Model, priors: Mapping[str, PriorBody]) -> Knowledge:
    """Priors of the bodies named, with notes on them, and the bounds of the terms' parameters."""
    bodies = tuple(body.name for body in rigid_bodies(model).values())
    alike = by_key((one.why, f"'{name}'") for name, one in priors.items() if one.why)
    notes = [
        f"the prior of link{'s' * (len(names) > 1)} {', '.join(names)}: {why}"
        for why, names in alike.items()
    ]
    if thin := [f"'{name}'" for name, one in priors.items() if one.thin]:
        side = f"{np.sqrt(THINNEST):.0%}"
        notes.append(
            f"priors of links thinner than {side} of their length were widened: {', '.join(thin)}"
        )
    return Knowledge(
        names=model.names,
        bodies=bodies,
        priors=tuple(priors[name].inertia if name in priors else None for name in bodies),
        lower=np.array([p.lower for p in model.parameters]),
        upper=np.array([p.upper for p in model.parameters]),
        notes=tuple(notes),
    )


def rigid_bodies(model: Model) -> dict[int, Body]:
    """The bodies whose numbers are parameters of the model, by their index in the robot."""
    every = enumerate(model.robot.bodies if model.has_bodies else ())
    return {k: body for k, body in every if not body.massless}


def model_prior(robot: Robot, index: int) -> PriorBody:
    """The nominal mass properties of a body, or what stands in for them."""
    body, mass = robot.bodies[index], assumed_mass(robot)
    if not body.known:
        wrong = "the model file gives no mass properties"
    elif not np.isfinite(body.inertia.ten).all():
        wrong = "it is not physically consistent: a value is not finite"
    elif body.inertia.mass < 0.0:
        negative = f"its mass is negative ({body.inertia.mass:.4g} kg)"
        wrong = f"it is not physically consistent: {negative}"
    elif body.inertia.mass == 0.0:
        wrong = "its mass is zero"
    else:
        return corrected_body(body.inertia, noted=True)
    solid = corrected_body(assumed_body(robot, index, mass)).inertia
    return PriorBody(solid, f"{wrong}; a solid body of {mass:.3g} kg between its joints is assumed")


def corrected_body(given: Inertia, *, noted: bool = False) -> PriorBody:
    r"""The consistent body nearest to a given one, of the same mass, above zero, and centre.

    The second moments about the centre of mass, $\Sigma_c$, keep their principal axes; those below
    `THINNEST` of the greatest are lifted to it. Where even the greatest is less than that of a ball
    of steel, a ball of common density stands in. `noted` says that it is noted elsewhere why no
    body can have it, as the model file's notes do.
    """
    flaw = given.flaw()
    moments, axes = np.linalg.eigh(spread_of(given))
    if moments[-1] < given.mass * _ball_radius(given.mass, STEEL) ** 2 / 5.0:
        zero = np.abs(moments).max() <= given.rounding
        was = ("its moments of inertia are zero" if zero else flaw) or "it is denser than steel"
        return PriorBody(
            ball(given.mass, given.com),
            f"{was}; a solid sphere of {given.mass:.3g} kg about its centre of mass is assumed",
        )
    least = THINNEST * moments[-1]
    if moments[0] >= least:
        return PriorBody(given)
    raised = (axes * np.maximum(moments, least)) @ axes.T
    lifted = of_spread(given.mass, given.com, raised)
    if flaw is None:
        return PriorBody(lifted, thin=True)
    principal = ", ".join(f"{value:.3g}" for value in np.linalg.eigvalsh(lifted.inertia_com))
    why = "its moments of inertia are" if noted else f"it is not physically consistent: {flaw};"
    return PriorBody(lifted, f"{why} raised to {principal} kg m²")


def assumed_mass(robot: Robot) -> float:
    """The least mass that the model file gives to a link, for those without [kg]."""
    known = [b.inertia.mass for b in robot.bodies if b.known and b.inertia.mass > 0.0]
    return min(known, default=UNKNOWN_MASS)


def assumed_body(robot: Robot, index: int, mass: float) -> Inertia:
    """A solid body from a joint to what it carries: even capsules, or a ball at the origin."""
    ends = [end for end in _ends(robot, index) if np.linalg.norm(end) > 1e-3]
    if not ends:
        return ball(mass, np.zeros(3))
    parts = [capsule(mass / len(ends), np.zeros(3), end) for end in ends]
    return sum(parts, Inertia.zero())


def _ends(robot: Robot, index: int) -> Sequence[Array]:
    """Points of a body where others hang on it; of a last one the farthest frame."""
    ends = [b.position for b in robot.bodies if b.parent == index]
    for loop in robot.loops:
        ends += [p for b, p in zip(loop.bodies, loop.points, strict=True) if b == index]
    frames = [f.position for f in robot.frames if f.body == index]
    if ends or not frames:
        return ends
    return [max(frames, key=lambda position: float(np.linalg.norm(position)))]


def given_knowledge(model: Model, section: PriorSection, where: Locate) -> Knowledge:
    """What model file and section `[prior]` say: bodies, and bounds of the terms' parameters."""
    for name in section.links:
        body_index(model.robot, name, where("prior", "links", name))
    corrected = {
        body.name: one
        for k, body in rigid_bodies(model).items()
        if (one := _prior(model.robot, k, section, where)) is not None
    }
    return replace(knowledge_with(model, corrected), uncertainty=section.uncertainty)


def body_index(robot: Robot, name: str, where: str) -> int:
    """Which moving body a link's name means; a `ModelError` says which one carries a fixed link."""
    names = [body.name for body in robot.bodies]
    if name in names and not robot.bodies[names.index(name)].massless:
        return names.index(name)
    carrier = next((f.body for f in robot.frames if f.name == name), None)
    if name in names:
        wrong = f"link '{name}' is a frame between two joints of one body, and has no mass"
        fix = "name the body itself"
    elif carrier is None:
        wrong, fix = f"the robot has no moving link '{name}'", advice(name, names, "moving links")
    elif carrier < 0:
        wrong, fix = f"link '{name}' does not move", advice(name, names, "moving links")
    else:
        wrong = f"link '{name}' moves with link '{names[carrier]}', whose numbers include it"
        fix = f"name '{names[carrier]}', and give the properties of both together in its frame"
    raise ModelError(wrong, where=where, fix=fix)


def _prior(robot: Robot, index: int, section: PriorSection, where: Locate) -> PriorBody | None:
    body = robot.bodies[index]
    given = section.links.get(body.name, LinkPriorSection(source=section.source))
    _refuse_unclear(body.name, given, where("prior", "links", body.name))
    if given.source == "none":
        return None
    if given.model_fields_set <= {"source"}:
        return model_prior(robot, index)
    known = body.known and body.inertia.mass > 0.0
    guess = body.inertia.mass if known else assumed_mass(robot)
    mass = guess if given.mass is None else given.mass
    if given.box is not None:
        solid = box(mass, given.box.centre, given.box.size)
    elif given.capsule is not None:
        solid = capsule(mass, given.capsule.start, given.capsule.end, given.capsule.radius)
    else:  # what the table leaves out is the model's, scaled to the mass
        scaled = Inertia.from_ten(body.inertia.ten * (mass / guess)) if known else None
        model = assumed_body(robot, index, mass) if scaled is None else scaled
        com, six = model.com if given.com is None else given.com, given.inertia_com
        around = model.inertia_com if six is None else symmetric(six)
        solid = Inertia.about_com(mass, com, around)
    corrected = corrected_body(solid)
    if given.mass is not None or known:
        return corrected
    reason = f"its mass is not known; {mass:.3g} kg are assumed"
    return replace(corrected, why=f"{reason}; {corrected.why}" if corrected.why else reason)


def _refuse_unclear(name: str, given: LinkPriorSection, where: str) -> None:
    shapes = [key for key in ("box", "capsule") if getattr(given, key) is not None]
    points = [key for key in ("com", "inertia_com") if getattr(given, key) is not None]
    if not given.model_fields_set:
        wrong = ""
        fix = 'give mass = ..., a box, a capsule, or com and inertia_com; or source = "none"'
    elif given.source == "none" and len(given.model_fields_set) > 1:
        wrong = " is none, but properties are given"
        fix = 'leave out source = "none", or the other keys'
    elif len(shapes) == 2 or (shapes and points):
        one, other, *_ = (*shapes, *points)
        wrong = f" has {one} and {other} at once"
        fix = "keep one of them: a box, a capsule, or com and inertia_com"
    else:
        return
    raise ModelError(f"the prior of link '{name}'{wrong}", where=where, fix=fix)
