"""Priors of links from section `[prior]` of a robot file."""

from dataclasses import replace

from steelyard.base.errors import ModelError, advice
from steelyard.estimate.prior.body_priors import (
    Knowledge,
    PriorBody,
    assumed_body,
    assumed_mass,
    box,
    capsule,
    corrected_body,
    knowledge_with,
    model_prior,
    rigid_bodies,
)
from steelyard.model.model import Model
from steelyard.robot.file.sections import LinkPriorSection, PriorSection
from steelyard.robot.file.signals_from_tables import Locate
from steelyard.robot.inertia_and_placement import Inertia, symmetric
from steelyard.robot.robot import Robot


def given_knowledge(model: Model, section: PriorSection, where: Locate) -> Knowledge:
    """What model file and section `[prior]` say: bodies, and bounds of the terms' parameters."""
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
