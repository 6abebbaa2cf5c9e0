"""Priors as a robot file gives them: from the model, from CAD, from boxes and capsules."""

from dataclasses import replace

from steelyard.errors import ModelError
from steelyard.estimation.knowledge import Knowledge
from steelyard.estimation.prior.prior import (
    PriorBody,
    corrected_body,
    knowledge_with,
    model_prior,
    rigid_bodies,
    stand_in_body,
    stand_in_mass,
)
from steelyard.estimation.prior.prior_shapes import box, capsule
from steelyard.model import Model
from steelyard.robot.inertia import Inertia, symmetric
from steelyard.robot.robot import Robot
from steelyard.robot_file.efforts import Locate
from steelyard.robot_file.sections import LinkPriorSection, PriorSection
from steelyard.suggest import advice


def given_knowledge(model: Model, section: PriorSection, where: Locate) -> Knowledge:
    """What model file and the section `[prior]` say: bodies, and bounds of the terms' parameters.

    Args:
        model: The model.
        section: What the robot file says of priors.
        where: Places in the robot file.

    Raises:
        ModelError: The section names a link that is not there, or contradicts itself.
    """
    bodies = rigid_bodies(model)
    for name in section.links:
        body_index(model.robot, name, where("prior", "links", name))
    corrected = {
        body.name: one
        for k, body in bodies.items()
        if (one := _prior(model.robot, k, section, where)) is not None
    }
    return replace(knowledge_with(model, corrected), uncertainty=section.uncertainty)


def body_index(robot: Robot, name: str, where: str) -> int:
    """Which moving body a link's name means.

    Raises:
        ModelError: No body is called so; the message says which one carries a fixed link.
    """
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
    name = robot.bodies[index].name
    given = section.links.get(name, LinkPriorSection(source=section.source))
    _refuse_unclear(name, given, where("prior", "links", name))
    if given.source == "none":
        return None
    if given.model_fields_set <= {"source"}:
        return model_prior(robot, index)
    mass, guessed = _mass(robot, index, given)
    corrected = corrected_body(_solid(robot, index, given, mass))
    if not guessed:
        return corrected
    reason = f"its mass is not known; {mass:.3g} kg are assumed"
    return replace(corrected, why=f"{reason}; {corrected.why}" if corrected.why else reason)


def _refuse_unclear(name: str, given: LinkPriorSection, where: str) -> None:
    shapes = [key for key in ("box", "capsule") if getattr(given, key) is not None]
    points = [key for key in ("com", "inertia_com") if getattr(given, key) is not None]
    if not given.model_fields_set:
        raise ModelError(
            f"the prior of link '{name}'",
            where=where,
            fix='give mass = ..., a box, a capsule, or com and inertia_com; or source = "none"',
        )
    if given.source == "none" and len(given.model_fields_set) > 1:
        raise ModelError(
            f"the prior of link '{name}' is none, but properties are given",
            where=where,
            fix='leave out source = "none", or the other keys',
        )
    if len(shapes) == 2 or (shapes and points):
        both = (*shapes, *points)[:2]
        raise ModelError(
            f"the prior of link '{name}' has {both[0]} and {both[1]} at once",
            where=where,
            fix="keep one of them: a box, a capsule, or com and inertia_com",
        )


def _mass(robot: Robot, index: int, given: LinkPriorSection) -> tuple[float, bool]:
    """The mass, and whether it is a guess."""
    if given.mass is not None:
        return given.mass, False
    body = robot.bodies[index]
    if body.known and body.inertia.mass > 0.0:
        return body.inertia.mass, False
    return stand_in_mass(robot), True


def _solid(robot: Robot, index: int, given: LinkPriorSection, mass: float) -> Inertia:
    """The body that a table describes; what it leaves out is the model's, scaled to the mass."""
    if given.box is not None:
        return box(mass, given.box.centre, given.box.size)
    if given.capsule is not None:
        shape = given.capsule
        return capsule(mass, shape.start, shape.end, shape.radius)
    body = robot.bodies[index]
    if body.known and body.inertia.mass > 0.0:
        model = Inertia.from_ten(body.inertia.ten * (mass / body.inertia.mass))
    else:
        model = stand_in_body(robot, index, mass)
    com = model.com if given.com is None else given.com
    six = given.inertia_com
    return Inertia.about_com(mass, com, model.inertia_com if six is None else symmetric(six))
