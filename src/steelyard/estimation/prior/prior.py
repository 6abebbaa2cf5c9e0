"""What the model file says of the bodies, made possible: the prior of an estimate."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array
from steelyard.estimation.knowledge import Knowledge
from steelyard.estimation.prior.prior_shapes import ball, capsule, densest, of_spread, spread_of
from steelyard.model import Model
from steelyard.robot.inertia import Inertia
from steelyard.robot.robot import Body, Robot

THINNEST = 1e-2
"""Least second moment about the centre of mass, relative to the greatest.

Links from CAD have 0.017 and more; lifting to this changes no moment of inertia by more than 2 %
of the greatest, much less than what a prior is taken for. Below it a prior pretends to know the
thin side of a link better than anyone does."""

UNKNOWN_MASS = 1.0
"""Of a link without mass where no link of the robot has one [kg]."""


@dataclass(frozen=True, eq=False)
class PriorBody:
    """A body that can be a prior.

    Attributes:
        inertia: Its pseudo-inertia is positive definite.
        why: Why the one given could not be, and what was done; `None` if it could.
        thin: Whether it was only widened, being thinner than `THINNEST`.
    """

    inertia: Inertia
    why: str | None = None
    thin: bool = False


def default_knowledge(model: Model) -> Knowledge:
    """What the model file says: its bodies, and the bounds of the terms' parameters.

    Bodies that cannot be are repaired, thin ones widened, unknown ones replaced by simple shapes;
    the notes say so.
    """
    bodies = rigid_bodies(model)
    return knowledge_with(
        model, {body.name: model_prior(model.robot, k) for k, body in bodies.items()}
    )


def knowledge_with(model: Model, priors: Mapping[str, PriorBody]) -> Knowledge:
    """Priors of the bodies named, and the bounds of the terms' parameters."""
    bodies = tuple(body.name for body in rigid_bodies(model).values())
    return Knowledge(
        names=model.names,
        bodies=bodies,
        priors=tuple(priors[name].inertia if name in priors else None for name in bodies),
        lower=np.array([p.lower for p in model.parameters]),
        upper=np.array([p.upper for p in model.parameters]),
        notes=notes_on(priors),
    )


def rigid_bodies(model: Model) -> dict[int, Body]:
    """The bodies whose numbers are parameters of the model, by their index in the robot."""
    every = enumerate(model.robot.bodies if model.has_bodies else ())
    return {k: body for k, body in every if not body.massless}


def model_prior(robot: Robot, index: int) -> PriorBody:
    """The nominal mass properties of a body, or what stands in for them."""
    body = robot.bodies[index]
    if body.known and body.inertia.mass > 0.0 and np.isfinite(body.inertia.ten).all():
        return corrected_body(body.inertia, noted=True)
    return _stand_in(robot, index)


def notes_on(corrected: Mapping[str, PriorBody]) -> tuple[str, ...]:
    """What was corrected, by the names of the links."""
    alike: dict[str, list[str]] = {}
    for name, one in corrected.items():
        if one.why:
            alike.setdefault(one.why, []).append(f"'{name}'")
    notes = [
        f"the prior of link{'s' * (len(names) > 1)} {', '.join(names)}: {why}"
        for why, names in alike.items()
    ]
    if thin := [f"'{name}'" for name, one in corrected.items() if one.thin]:
        side = f"{np.sqrt(THINNEST):.0%}"
        notes.append(
            f"priors of links thinner than {side} of their length were widened: {', '.join(thin)}"
        )
    return tuple(notes)


def corrected_body(given: Inertia, *, noted: bool = False) -> PriorBody:
    r"""The consistent body nearest to a given one, of the same mass and centre.

    The second moments about the centre of mass, $\Sigma_c$, keep their principal axes; those below
    `THINNEST` of the greatest are lifted to it. Where even the greatest is less than that of a ball
    of steel, a ball of common density stands in.

    Args:
        given: Its mass is above zero.
        noted: Whether it is noted elsewhere why no body can have it, as the model file's notes do.
    """
    flaw = given.flaw()
    moments, axes = np.linalg.eigh(spread_of(given))
    if moments[-1] < densest(given.mass):
        zero = np.abs(moments).max() <= given.rounding
        was = "its moments of inertia are zero" if zero else flaw
        was = was or "it is denser than steel"
        return PriorBody(
            ball(given.mass, given.com),
            f"{was}; a solid sphere of {given.mass:.3g} kg about its centre of mass is assumed",
        )
    least = THINNEST * moments[-1]
    if moments[0] >= least:
        return PriorBody(given)
    lifted = of_spread(given.mass, given.com, _with_moments(axes, np.maximum(moments, least)))
    if flaw is None:
        return PriorBody(lifted, thin=True)
    lifted_to = _listed(np.linalg.eigvalsh(lifted.inertia_com), "kg m²")
    why = "its moments of inertia are" if noted else f"it is not physically consistent: {flaw};"
    return PriorBody(lifted, f"{why} raised to {lifted_to}")


def stand_in_mass(robot: Robot) -> float:
    """The least mass that the model file gives to a link, for those without [kg]."""
    known = [b.inertia.mass for b in robot.bodies if b.known and b.inertia.mass > 0.0]
    return min(known, default=UNKNOWN_MASS)


def stand_in_body(robot: Robot, index: int, mass: float) -> Inertia:
    """A solid body from a joint's origin to what it carries: capsules, or a ball at the origin.

    Args:
        robot: The robot.
        index: Index of the body.
        mass: [kg]; several capsules share it evenly.
    """
    ends = [end for end in _ends(robot, index) if np.linalg.norm(end) > 1e-3]
    if not ends:
        return ball(mass, np.zeros(3))
    parts = [capsule(mass / len(ends), np.zeros(3), end) for end in ends]
    return sum(parts, Inertia.zero())


def _stand_in(robot: Robot, index: int) -> PriorBody:
    body, mass = robot.bodies[index], stand_in_mass(robot)
    if not body.known:
        wrong = "the model file gives no mass properties"
    elif not np.isfinite(body.inertia.ten).all():
        wrong = "it is not physically consistent: a value is not finite"
    elif body.inertia.mass < 0.0:
        wrong = (
            f"it is not physically consistent: its mass is negative ({body.inertia.mass:.4g} kg)"
        )
    else:
        wrong = "its mass is zero"
    solid = corrected_body(stand_in_body(robot, index, mass)).inertia
    return PriorBody(solid, f"{wrong}; a solid body of {mass:.3g} kg between its joints is assumed")


def _ends(robot: Robot, index: int) -> Sequence[Array]:
    """Points of a body where others hang on it; of a last one the farthest frame."""
    ends = [b.position for b in robot.bodies if b.parent == index]
    for loop in robot.loops:
        ends += [p for b, p in zip(loop.bodies, loop.points, strict=True) if b == index]
    frames = [f.position for f in robot.frames if f.body == index]
    if ends or not frames:
        return ends
    return [max(frames, key=lambda position: float(np.linalg.norm(position)))]


def _with_moments(axes: Array, moments: Array) -> Array:
    return (axes * moments) @ axes.T


def _listed(values: Iterable[float], unit: str) -> str:
    return ", ".join(f"{value:.3g}" for value in values) + f" {unit}"
