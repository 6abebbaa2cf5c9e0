"""Identified actuators as OpenUSD text: rigid bodies and joints, and Newton's actuator schemas.

Bodies and joints have the schemas of UsdPhysics; rotor inertia, dry friction and back-EMF those of
Newton's joints; controllers, delays and torque limits are `NewtonActuator` prims. Joints turn about
the x axes of their frames, in degrees, as UsdPhysics has it; actuators are in radians.
"""

import re
from collections.abc import Callable, Iterator, Sequence
from math import degrees, pi
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from steelyard.actuators.actuator_model import ActuatorModel
from steelyard.actuators.actuator_parameters import UNLIMITED
from steelyard.base.arrays import Array, distinct_texts
from steelyard.base.errors import ModelError
from steelyard.base.templates import templates_of
from steelyard.export.model_files.actuators_mjcf import (
    ActuatorFile,
    at_standstill,
    head_lines,
    refuse_beyond_limits,
    unsupported,
)
from steelyard.export.model_files.representable_content import carriers_of
from steelyard.robot.inertia_and_placement import turn
from steelyard.robot.robot import Body, Robot, bodies_along

RATE = 1000  # steps of the scene a second, in which delays are counted
X = np.array([1.0, 0.0, 0.0])


def actuators_usd(model: ActuatorModel, units: Sequence[str] = ()) -> ActuatorFile:
    """The arm as the text of a `.usda` file; `units` are lines about other robots, for its head.

    Raises:
        ModelError: The fitted motion is outside the limits of the joints, a body has no mass, or a
            joint follows one of the other kind.
    """
    refuse_beyond_limits(model)
    robot, lacks = (
        model.identified_robot,
        unsupported(
            model, ("integral", "stribeck", "load_friction", "dead_band"), "newton:friction"
        ),
    )
    for body in robot.bodies:
        if body.inertia.mass <= 0.0 or np.linalg.eigvalsh(body.inertia.inertia_com)[0] <= 0.0:
            raise ModelError(
                f"link '{body.name}' has no mass or no inertia, which USD takes for unknown",
                where=f"model of '{robot.name}'",
                fix="export to MJCF; or give the link a mass and an inertia in the model file",
            )
    count = len(robot.bodies)
    names = [*(b.name for b in robot.bodies), *(b.joint for b in robot.bodies)]
    prims = _prims(["scene", *names, *(f"actuator_{joint}" for joint in model.joints)])
    bodies, joints = prims[1 : 1 + count], prims[1 + count : 1 + 2 * count]
    motors = prims[1 + 2 * count :]
    root = _prims([robot.name])[0]
    more = (
        f"Delays are counted in steps of 1/{RATE} s."
        if np.any(model.values["delay"] > 0.0)
        else "No delay was identified.",
        "The damping is that of the joint's own speed: send no target velocities. Shapes, frames",
        "and speed limits of the model file are not written; the base is the world.",
    )
    head = head_lines(model, lacks, units, "USD", *more)
    gravity = float(np.linalg.norm(robot.gravity))
    text = (
        templates_of(Path(__file__).parent / "templates")
        .get_template("arm.usda")
        .render(
            root=root,
            robot=robot.name,
            head=[_printable(line) for part in head for line in part.splitlines()],
            gravity=robot.gravity / gravity if gravity else -np.eye(3)[2],
            magnitude=gravity,
            rate=RATE,
            bodies=list(_bodies(robot, bodies)),
            joints=list(_joints(model, bodies, joints)),
            motors=list(_motors(model, joints, motors)),
            quoted=_quoted,
            triple=_triple,
        )
    )
    return ActuatorFile(text, lacks)


def _prims(names: Sequence[str]) -> list[str]:
    """Distinct names of prims: letters, digits and underscores."""
    plain = (re.sub(r"[^A-Za-z0-9_]", "_", name) or "_" for name in names)
    return distinct_texts(f"_{name}" if name[0].isdigit() else name for name in plain)


def _printable(text: str) -> str:
    return "".join(c if c.isprintable() else " " for c in text)


def _quoted(text: str) -> str:
    """A string of USD."""
    escaped = _printable(text).replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'


def _triple(values: Any) -> str:
    return "(" + ", ".join(repr(float(x) + 0.0) for x in values) + ")"


def _quaternion(rotation: Array) -> Array:
    """Real part first."""
    return np.asarray(Rotation.from_matrix(rotation).as_quat(canonical=True, scalar_first=True))


def _bodies(robot: Robot, prims: Sequence[str]) -> Iterator[dict[str, Any]]:
    """Every body where it is with all joints at zero."""
    rotations, origins = bodies_along(robot, np.zeros((1, robot.n_joints)))
    for k, (body, prim) in enumerate(zip(robot.bodies, prims, strict=True)):
        inertia, axes = np.linalg.eigh(body.inertia.inertia_com)
        axes[:, 2] *= np.sign(np.linalg.det(axes))
        yield {
            "prim": prim,
            "name": body.name,
            "origin": origins[k + 1][0],
            "orientation": _quaternion(rotations[k + 1][0]),
            "mass": repr(float(body.inertia.mass)),
            "com": body.inertia.com,
            "inertia": inertia,
            "axes": _quaternion(axes),
        }


def _joints(
    model: ActuatorModel, bodies: Sequence[str], joints: Sequence[str]
) -> Iterator[dict[str, Any]]:
    robot, values = model.identified_robot, model.values
    carriers = carriers_of(robot)
    friction = at_standstill(values)
    for k, body in enumerate(robot.bodies):
        j, turns = body.coordinate, body.kind == "revolute"
        scale: Callable[[float], float] = degrees if turns else float
        inner = _to_axis(body.axis)
        outer = body.rotation @ (turn(body.axis, body.offset) if turns else np.eye(3)) @ inner
        slide = np.zeros(3) if turns else body.rotation @ body.axis * body.offset
        own = {
            "physics:lowerLimit": scale(robot.joints[j].limits.lower),
            "physics:upperLimit": scale(robot.joints[j].limits.upper),
            "newton:armature": float(values["armature"][j]),
            "newton:friction": float(friction[j]),
            "newton:damping": float(values["back_emf"][j]) * (pi / 180.0 if turns else 1.0),
        }
        leads = carriers[j] == k
        yield {
            "prim": joints[k],
            "name": body.joint,
            "type": "PhysicsRevoluteJoint" if turns else "PhysicsPrismaticJoint",
            "parent": bodies[body.parent] if body.parent >= 0 else "",
            "child": bodies[k],
            "position": body.position + slide,
            "outer": _quaternion(outer),
            "inner": _quaternion(inner),
            "numbers": {name: repr(x) for name, x in own.items()} if leads else {},
            "leader": "" if leads else _leader(robot, body, joints, carriers[j]),
            "ratio": body.ratio,
        }


def _leader(robot: Robot, body: Body, joints: Sequence[str], leader: int) -> str:
    """The joint that another one follows."""
    if robot.bodies[leader].kind != body.kind:
        raise ModelError(
            f"joint '{body.joint}' follows one of another kind, which USD cannot represent",
            where=f"model of '{robot.name}'",
            fix="export to MJCF",
        )
    return joints[leader]


def _motors(
    model: ActuatorModel, joints: Sequence[str], prims: Sequence[str]
) -> Iterator[dict[str, Any]]:
    values, carriers = model.values, carriers_of(model.robot)
    for j in range(model.robot.n):
        given = {"newton:kp": values["stiffness"][j], "newton:kd": values["damping"][j]}
        schemas = ["NewtonPDControlAPI"]
        delay = round(float(values["delay"][j]) * RATE)
        if delay:
            schemas.append("NewtonActuatorDelayAPI")
        if (limit := float(values["torque_limit"][j])) < UNLIMITED:
            schemas.append("NewtonMaxEffortClampingAPI")
            given["newton:maxEffort"] = limit
        yield {
            "prim": prims[j],
            "joint": joints[carriers[j]],
            "schemas": ", ".join(map(_quoted, schemas)),
            "numbers": {name: repr(float(x)) for name, x in given.items()},
            "delay": delay,
        }


def _to_axis(axis: Array) -> Array:
    """A rotation that takes the x axis to another."""
    if np.allclose(axis, -X):
        return np.diag([-1.0, -1.0, 1.0])
    return np.asarray(Rotation.align_vectors(axis[None], X[None])[0].as_matrix())
