r"""A robot as URDF: every moving body a link, every other named frame a link without mass.

The inertia of a link is given at its centre of mass, in the link's own axes.
"""

import xml.etree.ElementTree as ET
from collections.abc import Iterable

import numpy as np

from steelyard.application.export.content import Content, Effects, base_of, carriers_of
from steelyard.application.export.xml import UNLIMITED, limit, number, numbers, snapped
from steelyard.arrays import Array
from steelyard.robot.inertia import Inertia, six_numbers
from steelyard.robot.robot import Body, Frame, Limits, Robot

SIX = ("ixx", "ixy", "iyy", "ixz", "iyz", "izz")


def urdf_of(content: Content) -> ET.Element:
    """The `<robot>` of a robot's bodies."""
    robot = content.robot
    carriers = carriers_of(robot)
    root, base = ET.Element("robot", name=robot.name), base_of(robot)
    ET.SubElement(root, "link", name=base)
    names = [base, *(body.name for body in robot.bodies)]
    for index, (body, inertia) in enumerate(zip(robot.bodies, content.inertias, strict=True)):
        ET.SubElement(root, "link", name=body.name).append(inertial_of(inertia))
        joint = _joint(root, body, names[body.parent + 1])
        if carriers[body.coordinate] == index:
            _limit(joint, body, robot.joints[body.coordinate].limits)
            joint.extend(dynamics_of(content.joints[body.coordinate]))
            continue
        _limit(joint, body, Limits())
        master = robot.bodies[carriers[body.coordinate]].joint
        ratio, offset = number(body.ratio), number(body.offset)
        ET.SubElement(joint, "mimic", joint=master, multiplier=ratio, offset=offset)
    for frame in frames_of(robot, names):
        _fixed(root, frame, names[frame.body + 1])
    return root


def frames_of(robot: Robot, names: Iterable[str]) -> list[Frame]:
    """Named frames that are no links of their own."""
    taken = set(names)
    return [frame for frame in robot.frames if frame.name not in taken]


def inertial_of(inertia: Inertia) -> ET.Element:
    """Mass, centre and the inertia about it, in the link's axes."""
    inertial = ET.Element("inertial")
    com, about = rounded(inertia)
    ET.SubElement(inertial, "origin", xyz=numbers(com), rpy="0 0 0")
    ET.SubElement(inertial, "mass", value=number(inertia.mass))
    six = six_numbers(about)
    ET.SubElement(inertial, "inertia", dict(zip(SIX, map(number, six), strict=True)))
    return inertial


def rounded(inertia: Inertia) -> tuple[Array, Array]:
    """Centre and inertia about it, without what is rounding beside the body's size."""
    com, about = inertia.com, inertia.inertia_com
    radius = np.sqrt(np.trace(inertia.inertia_origin) / inertia.mass)
    return snapped(com, float(radius)), snapped(about, float(np.trace(about)))


def dynamics_of(effects: Effects) -> list[ET.Element]:
    """Friction of a joint, if it has any."""
    if not effects:
        return []
    damping, friction = (number(effects.get(kind, 0.0)) for kind in ("viscous", "dry"))
    return [ET.Element("dynamics", damping=damping, friction=friction)]


def origin_of(rotation: Array, position: Array) -> ET.Element:
    """Where a frame is in its parent's."""
    return ET.Element("origin", xyz=numbers(position), rpy=numbers(rpy_of(rotation)))


def rpy_of(rotation: Array) -> Array:
    r"""Angles of $R_z(y) R_y(p) R_x(r)$, in the order `r, p, y`, shape `(3,)` [rad].

    The yaw is taken off first, so that the others are exact where yaw and roll turn alike.
    """
    yaw = np.arctan2(rotation[1, 0], rotation[0, 0])
    c, s = np.cos(yaw), np.sin(yaw)
    rest = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) @ rotation
    pitch = np.arctan2(-rest[2, 0], rest[0, 0])
    return np.array([np.arctan2(-rest[1, 2], rest[1, 1]), pitch, yaw])


def _joint(root: ET.Element, body: Body, parent: str) -> ET.Element:
    """The joint of a body, without limits."""
    limits = "prismatic" if body.kind == "prismatic" else "revolute"
    joint = ET.SubElement(root, "joint", name=body.joint, type=limits)
    joint.append(origin_of(body.rotation, body.position))
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=body.name)
    ET.SubElement(joint, "axis", xyz=numbers(body.axis))
    return joint


def _limit(joint: ET.Element, body: Body, limits: Limits) -> None:
    """Limits; a joint that turns without end is continuous."""
    given = {"effort": limit(limits.effort), "velocity": limit(limits.velocity)}
    if body.kind == "revolute" and np.isinf([limits.lower, limits.upper]).all():
        joint.set("type", "continuous")
        if given != dict.fromkeys(given, number(UNLIMITED)):
            ET.SubElement(joint, "limit", given)
        return
    ends = {"lower": limit(limits.lower), "upper": limit(limits.upper)}
    ET.SubElement(joint, "limit", ends | given)


def _fixed(root: ET.Element, frame: Frame, parent: str) -> None:
    """A link without mass, fixed to another."""
    ET.SubElement(root, "link", name=frame.name)
    joint = ET.SubElement(root, "joint", name=f"{frame.name}_fixed", type="fixed")
    joint.append(origin_of(frame.rotation, frame.position))
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=frame.name)
