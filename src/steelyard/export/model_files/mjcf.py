r"""A robot as MJCF, ready to be simulated by MuJoCo.

Rotor inertia is *armature*, dry friction *frictionloss*, friction with powers of speed the
polynomial of *damping*, springs are *stiffness* with *springref*; what acts along a sum of joints
is a fixed tendon, a spring between links a spatial one. Mimic joints are joint equalities, pins of
loops `connect` equalities between sites. Each joint has a motor of its own. Positions are the
robot's; a model with loops starts where they are closed.
"""

import xml.etree.ElementTree as ET
from collections.abc import Sequence

import numpy as np

from steelyard.base.arrays import Array
from steelyard.export.model_files.representable_content import (
    Content,
    Effects,
    base_of,
    carriers_of,
)
from steelyard.export.model_files.urdf_and_xml_numbers import (
    frames_of,
    limit,
    number,
    numbers,
    rounded,
)
from steelyard.model.equations.frame_kinematics import frame_of
from steelyard.model.terms.terms_in_model_files import AxisPartKind
from steelyard.robot.inertia_and_placement import turn
from steelyard.robot.robot import Robot

TIMESTEP = 1e-3  # step of the integration [s]
STIFF = "0.005 1"  # time constant [s] and damping ratio with which equalities pull together

PLAIN_ATTRIBUTES: dict[AxisPartKind, str] = {"rotor": "armature", "dry": "frictionloss"}
POLYNOMIAL: tuple[AxisPartKind, ...] = ("viscous", "quadratic", "cubic")  # numbers of `damping`

WORLD = "world"
FULL_INERTIA = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


def mjcf_of(content: Content) -> ET.Element:
    """The `<mujoco>` of a robot's bodies."""
    robot = content.robot
    root = ET.Element("mujoco", model=robot.name)
    ET.SubElement(root, "compiler", angle="radian", autolimits="true")
    ET.SubElement(
        root,
        "option",
        timestep=number(TIMESTEP),
        integrator="implicitfast",
        gravity=numbers(robot.gravity),
    )
    bodies = _bodies(content, ET.SubElement(root, "worldbody"))
    names = [body.get("name", WORLD) for body in bodies]
    for frame in frames_of(robot, names):
        _site(bodies[frame.body + 1], frame.name, frame.position, frame.rotation)
    _tendons(root, content, bodies)
    _equalities(root, robot, bodies)
    motors = ET.SubElement(root, "actuator")
    for joint in robot.coordinates:
        motor = ET.SubElement(motors, "motor", name=joint.name, joint=joint.name)
        if np.isfinite(joint.limits.effort):
            motor.set("ctrlrange", numbers([-joint.limits.effort, joint.limits.effort]))
    _home(root, robot, bodies[0])
    return root


def _bodies(content: Content, world: ET.Element) -> list[ET.Element]:
    """The base's and all bodies' elements, each inside its parent's."""
    robot, base = content.robot, base_of(content.robot)
    carriers = carriers_of(robot)
    placed = [world if base == WORLD else ET.SubElement(world, "body", name=base)]
    for index, (body, inertia) in enumerate(zip(robot.bodies, content.inertias, strict=True)):
        start = body.ratio * robot.assembly[body.coordinate] + body.offset
        element = ET.SubElement(placed[body.parent + 1], "body", name=body.name)
        rotation, position, kind = body.rotation, body.position, "hinge"
        if body.kind == "prismatic":
            position, kind = position + rotation @ body.axis * start, "slide"
        elif start:
            rotation = rotation @ turn(body.axis, start)
        _pose(element, position, rotation)
        com, about = rounded(inertia)
        ET.SubElement(
            element,
            "inertial",
            pos=numbers(com),
            mass=number(inertia.mass),
            fullinertia=numbers([about[i, j] for i, j in FULL_INERTIA]),
        )
        axis = numbers(body.axis)
        joint = ET.SubElement(element, "joint", name=body.joint, type=kind, axis=axis)
        if start:
            joint.set("ref", number(start))
        if carriers[body.coordinate] == index:
            limits = robot.joints[body.coordinate].limits
            if np.isfinite([limits.lower, limits.upper]).any():
                joint.set("range", f"{limit(limits.lower)} {limit(limits.upper)}")
            if np.isfinite(limits.effort):
                joint.set("actuatorfrcrange", numbers([-limits.effort, limits.effort]))
            _effects(joint, content.joints[body.coordinate], "springref")
        placed.append(element)
    return placed


def _pose(element: ET.Element, position: Array, rotation: Array) -> None:
    if np.any(position):
        element.set("pos", numbers(position))
    if not np.array_equal(rotation, np.eye(3)):
        from scipy.spatial.transform import Rotation

        turned = Rotation.from_matrix(rotation)
        element.set("quat", numbers(turned.as_quat(canonical=True, scalar_first=True)))


def _effects(element: ET.Element, effects: Effects, free: str) -> None:
    """What acts along a joint or a tendon; `free` is the attribute of a spring's free position."""
    for kind, name in PLAIN_ATTRIBUTES.items():
        if kind in effects:
            element.set(name, number(effects[kind]))
    damping = [effects.get(kind, 0.0) for kind in POLYNOMIAL]
    if any(damping):
        element.set("damping", numbers(damping if any(damping[1:]) else damping[:1]))
    if "stiffness" in effects:
        rest = effects.get("preload", 0.0) / effects["stiffness"]
        element.set("stiffness", number(effects["stiffness"]))
        element.set(free, number(rest))


def _tendons(root: ET.Element, content: Content, bodies: Sequence[ET.Element]) -> None:
    """Tendons as long as sums of joint positions, and springs between points of two links."""
    if not content.sums and not content.pulls:
        return
    tendons, robot = ET.SubElement(root, "tendon"), content.robot
    for total in content.sums:
        tendon = ET.SubElement(tendons, "fixed", name=total.axis.name)
        _effects(tendon, total.effects, "springlength")
        # a spring length of exactly -1 means another thing to MuJoCo: the next number to it
        if tendon.get("springlength") == "-1.0":
            tendon.set("springlength", number(np.nextafter(-1.0, 0.0)))
        for joint, coefficient in zip(robot.joints, total.axis.row, strict=True):
            if coefficient:
                ET.SubElement(tendon, "joint", joint=joint.name, coef=number(coefficient))
    for pull in content.pulls:
        tendon = ET.SubElement(
            tendons,
            "spatial",
            name=pull.name,
            stiffness=number(pull.stiffness),
            springlength=number(pull.preload / pull.stiffness),
        )
        for end, (link, point) in enumerate(zip(pull.links, pull.points, strict=True), start=1):
            frame = frame_of(robot, link)
            name = f"{pull.name} end {end}"
            _site(bodies[frame.body + 1], name, frame.rotation @ point + frame.position)
            ET.SubElement(tendon, "site", site=name)


def _site(body: ET.Element, name: str, position: Array, rotation: Array | None = None) -> None:
    site = ET.Element("site", name=name)
    _pose(site, position, np.eye(3) if rotation is None else rotation)
    body.insert(sum(child.tag != "body" for child in body), site)


def _equalities(root: ET.Element, robot: Robot, bodies: Sequence[ET.Element]) -> None:
    """Mimic joints and pins."""
    carriers = carriers_of(robot)
    followers = [k for k, body in enumerate(robot.bodies) if carriers[body.coordinate] != k]
    if not followers and not robot.loops:
        return
    equalities = ET.SubElement(root, "equality")
    for index in followers:
        body = robot.bodies[index]
        ET.SubElement(
            equalities,
            "joint",
            joint1=body.joint,
            joint2=robot.bodies[carriers[body.coordinate]].joint,
            polycoef=f"0 {number(body.ratio)} 0 0 0",
            solref=STIFF,
        )
    for loop in robot.loops:
        pin = ET.SubElement(equalities, "connect", name=loop.name)
        for end, carrier, point in zip((1, 2), loop.bodies, loop.points, strict=True):
            name = f"{loop.name} end {end}"
            _site(bodies[carrier + 1], name, point)
            pin.set(f"site{end}", name)
        pin.set("solref", STIFF)


def _home(root: ET.Element, robot: Robot, world: ET.Element) -> None:
    """A keyframe within the limits, where zero is beyond them."""
    if robot.loops:
        return
    home = np.array([np.clip(0.0, c.limits.lower, c.limits.upper) for c in robot.joints])
    if not home.any():
        return
    positions = {b.joint: b.ratio * home[b.coordinate] + b.offset for b in robot.bodies}
    order = [str(joint.get("name")) for joint in world.iter("joint")]
    frames = ET.SubElement(root, "keyframe")
    ET.SubElement(frames, "key", name="home", qpos=numbers([positions[name] for name in order]))
