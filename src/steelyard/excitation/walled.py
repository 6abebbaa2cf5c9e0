"""Constraints from the `[excitation]` tables."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from itertools import combinations

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import ModelError
from steelyard.excitation.collision import self_clearance
from steelyard.excitation.constraint import Constraint
from steelyard.excitation.earlier import Earlier
from steelyard.excitation.families import per_joint
from steelyard.excitation.keep_out import keep_out
from steelyard.excitation.markers import Marker
from steelyard.excitation.model_shapes import robot_shapes, world_shapes
from steelyard.excitation.shapes import Shape
from steelyard.excitation.torque import EffortLimit, power_limit, torque_limit
from steelyard.excitation.torque import loaded as loaded_with
from steelyard.excitation.workspace import planes, tool_box
from steelyard.kernel.kinematics import frame_of, last_frame
from steelyard.model import Model, ValuedModel
from steelyard.parameters import Parameters
from steelyard.robot.excitation_schema import (
    BoxSpans,
    CollisionSection,
    ExcitationSection,
    WorkspaceSection,
)
from steelyard.robot.inertia import INERTIAL_NAMES, Inertia
from steelyard.robot.model_source import beside
from steelyard.robot.robot import Robot
from steelyard.robot.robot_file import LoadedRobot
from steelyard.terms.rigid_body import RigidBody
from steelyard.terms.term import Remembering

_AXES = "xyz"

_LEAST = 1e-12
"""Length of a normal that has no direction, and is refused."""


def constraints_of(
    loaded: LoadedRobot, model: Model, earlier: Earlier | None
) -> tuple[tuple[Constraint, ...], tuple[str, ...]]:
    """All that must hold at all times beside the limits of the joints, and what was assumed.

    Args:
        loaded: The robot and its tables.
        model: Its terms, with memory or without.
        earlier: What an earlier identification of the robot knows.

    Raises:
        ModelError: A frame or a shape is missing, or what must hold cannot be proven.
    """
    section = loaded.excitation
    found, notes = list[Constraint](), list[str]()
    if section.workspace is not None:
        found += workspace_of(section.workspace, loaded.robot)
        if section.workspace.radius > 0.0 and not found:
            notes.append("the tool's radius changes nothing: it has no box, plane or keep_out")
    for part, said in (
        efforts_of(loaded, model, earlier),
        clearance_of(section.collision, loaded),
    ):
        found += part
        notes += said
    if section.loads and not (
        section.criterion.relative or any(isinstance(c, EffortLimit) for c in found)
    ):
        notes.append("loads change nothing: torque is not limited, and the criterion not relative")
    if section.loads and any(not isinstance(c, EffortLimit) for c in found):
        notes.append("loads have no shape: clearance and the workspace do not see them")
    return tuple(found), tuple(notes)


Walled = tuple[list[Constraint], list[str]]
"""Constraints, and what was assumed."""


def efforts_of(loaded: LoadedRobot, model: Model, earlier: Earlier | None) -> Walled:
    """Torque and power of the prior model, without and with every load.

    Raises:
        ModelError: Limits are asked for, but torque is not known beforehand.
    """
    section = loaded.excitation
    wanted, robot = section.limits, model.robot
    own = np.array([joint.limits.effort for joint in robot.coordinates])
    given = own if wanted.effort in ("robot", "any") else None
    efforts = per_joint(None if given is not None else wanted.effort, robot, "effort", own)
    efforts = wanted.share * efforts
    powers = per_joint(wanted.power, robot, "power", np.full(robot.n, np.inf))
    asked = given is None or wanted.power is not None or wanted.total_power is not None
    limited = wanted.effort != "any" and bool(np.isfinite(efforts).any())
    free = ["torque is not limited, as asked"]
    notes = free if wanted.effort == "any" else _unlimited(robot, efforts)
    if not (limited or asked):
        return [], notes
    why = _unknown_efforts(loaded, model, earlier)
    if why is not None:
        if asked:
            raise ModelError(
                f"torque cannot be limited: {why}",
                where="[excitation.limits]",
                mend='leave out effort and power, or say effort = "any"',
            )
        return [], [f"torque is not limited: {why}"]
    cases = _cases(section, _memoryless(model), earlier)
    found: list[Constraint] = []
    if limited:
        found.append(torque_limit(cases, efforts))
    if wanted.power is not None or wanted.total_power is not None:
        total = np.inf if wanted.total_power is None else wanted.total_power
        found.append(power_limit(cases, powers, total))
    source = (
        "the earlier model's" if earlier is not None else "those of the model file, no friction"
    )
    return found, [f"torques are limited by a prior model, whose values are {source}", *notes]


def _unlimited(robot: Robot, efforts: Array) -> list[str]:
    """A note that names the joints without a limit of effort, if there are any."""
    joints = zip(robot.joint_names, efforts, strict=True)
    free = ", ".join(f"'{name}'" for name, most in joints if not np.isfinite(most))
    return [f"torque is not limited where the model file gives no limit: {free}"] if free else []


def _memoryless(model: Model) -> Model:
    kept = tuple(term for term in model.terms if not isinstance(term, Remembering))
    return Model(model.robot, kept)


def _unknown_efforts(loaded: LoadedRobot, model: Model, earlier: Earlier | None) -> str | None:
    """Why torques are not known beforehand, if they are not.

    Without an earlier model no friction is known, so laws with memory then lack like all others.
    """
    if loaded.signals is not None and loaded.signals.effort_kind == "gravity_compensated_torque":
        return "the robot file's efforts are without gravity"
    if earlier is not None:
        for term in model.terms:
            if isinstance(term, Remembering):
                return f"'{term.law}' depends on the motion before"
    if model.robot.passive:
        return "the robot has closed chains"
    if not any(isinstance(term, RigidBody) for term in model.terms):
        return "the model has no rigid bodies"
    if not any(body.known for body in model.robot.bodies):
        return "the model file gives no masses"
    return None


def _cases(
    section: ExcitationSection, model: Model, earlier: Earlier | None
) -> dict[str, ValuedModel]:
    """The prior model, without and with every load; an earlier model replaces it wholly.

    What that one does not hold is zero: its values may be base parameters, which stand for others.
    """
    nominal: Mapping[str, float] = {
        f"{name}.{body.name}": float(value)
        for body in model.robot.bodies
        for name, value in zip(INERTIAL_NAMES, body.inertia.ten, strict=True)
    }
    known = nominal if earlier is None else earlier.standard
    names = [name for name in model.names if name in known]
    units = [model.units[model.names.index(name)] for name in names]
    arm = model.at(Parameters(names, units, [known[name] for name in names]))
    cases = {"without load": arm}
    for number, load in enumerate(section.loads, start=1):
        frame = load.frame or last_frame(model.robot)
        mass = Inertia.about_com(load.mass, load.com, np.zeros((3, 3)))
        with _written("loads] frame"):
            cases[f"with load {number}, {load.mass:g} kg"] = loaded_with(arm, frame, mass)
    return cases


def clearance_of(section: CollisionSection | None, loaded: LoadedRobot) -> Walled:
    """That bodies do not touch each other or the world, where shapes say what they are."""
    if section is None:
        try:
            found = self_clearance(loaded)
        except ModelError as error:
            why = error.wrong[:1].lower() + error.wrong[1:]
            return [], [f"collisions of the robot with itself are not looked at: {why}"]
        return [found], list(found.notes)
    others: tuple[Shape, ...] = ()
    if section.world is not None:
        where = "[excitation.collision] world"
        others = world_shapes(beside(loaded.sources[0].path, section.world, where))
    if not section.bodies and not others:
        return [], ["collisions are not looked at, as asked"]
    ignore = list(section.ignore)
    if not section.bodies:
        own = robot_shapes(loaded.robot, loaded.sources[-1].path, section.without).shapes
        ignore += combinations(sorted({shape.name for shape in own}), 2)
    found = self_clearance(
        loaded, skip=section.without, margin=section.margin, others=others, ignore=ignore
    )
    return [found], list(found.notes)


def tool_of(section: WorkspaceSection | None, robot: Robot) -> Marker:
    """The tool: the named frame, or the last one of the robot."""
    section = WorkspaceSection() if section is None else section
    with _written("workspace] frame"):
        frame = frame_of(robot, section.frame or last_frame(robot))
    return Marker(frame.name, section.point, section.radius)


def workspace_of(section: WorkspaceSection, robot: Robot) -> list[Constraint]:
    """Box, planes and forbidden boxes."""
    tool, found = [tool_of(section, robot)], list[Constraint]()
    lower, upper = _sides(section.box)
    if any(x is not None for x in (*lower, *upper)):
        with _written("workspace] box"):
            found.append(tool_box(robot, tool, lower, upper))
    if section.planes:
        normals = [plane.normal for plane in section.planes]
        sizes = np.maximum(np.linalg.norm(normals, axis=1), _LEAST)
        levels = np.array([plane.above for plane in section.planes]) / sizes
        with _written("workspace] planes"):
            found.append(planes(robot, tool, normals, levels))
    if section.keep_out:
        boxes = [_sides(box) for box in section.keep_out]
        if any(None in low or None in high for low, high in boxes):
            raise ModelError(
                "a box to keep out of is open",
                where="[excitation.workspace] keep_out",
                mend="give x, y and z of each, with two numbers each",
            )
        low, high = zip(*boxes, strict=True)
        with _written("workspace] keep_out"):
            found.append(keep_out(robot, tool, np.array(low), np.array(high)))
    return found


@contextmanager
def _written(key: str) -> Iterator[None]:
    """Errors inside say which key of the tables they are about."""
    try:
        yield
    except ModelError as error:
        where = f"[excitation.{key}"
        raise ModelError(error.wrong, where=where, mend=error.mend) from None


def _sides(box: BoxSpans) -> tuple[list[float | None], list[float | None]]:
    spans = [getattr(box, axis) for axis in _AXES]
    return [s and s[0] for s in spans], [s and s[1] for s in spans]
