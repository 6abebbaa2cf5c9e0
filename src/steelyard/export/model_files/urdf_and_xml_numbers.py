r"""A robot as URDF, and the exact numbers and comments of XML model files.

The inertia of a link is given at its centre of mass, in the link's own axes.
"""

import xml.etree.ElementTree as ET
from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike

from steelyard.base.arrays import Array, frozen
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.export.model_files.representable_content import (
    FORMAT_NAMES,
    Content,
    Effects,
    Format,
    base_of,
    carriers_of,
)
from steelyard.robot.inertia_and_placement import Inertia, six_numbers
from steelyard.robot.robot import Body, Frame, Limits, Robot

SOLVER_ROUNDING = 1e-14  # what a solver leaves of zero, relative to the body it is of
UNLIMITED = 1e9  # written where a format wants a limit and none is known


def number(value: float) -> str:
    """The shortest text that reads back as the same number."""
    return repr(float(value) + 0.0)


def numbers(values: ArrayLike) -> str:
    """Numbers with blanks between."""
    return " ".join(number(value) for value in frozen(values).ravel())


def snapped(values: ArrayLike, size: float) -> Array:
    """Numbers with zeros where they are the rounding of a number of some size."""
    known = frozen(values)
    return np.where(np.abs(known) <= SOLVER_ROUNDING * size, 0.0, known)


def limit(value: float) -> str:
    """A limit; a large one for infinity."""
    return number(min(max(value, -UNLIMITED), UNLIMITED))


def document(root: ET.Element, head: str) -> str:
    """A whole file."""
    ET.indent(root)
    text = ET.tostring(root, encoding="unicode")
    return f'<?xml version="1.0" encoding="utf-8"?>\n{head}\n{text}\n'


def head_of(
    identified: IdentifiedModel, content: Content, form: Format, more: Iterable[str] = ()
) -> str:
    """The comment at a file's head: where the numbers come from, and what the file lacks."""
    origin = identified.provenance
    lines = [
        f"{content.robot.name}: identified with steelyard {origin.version} from logs.",
        f"Estimate: {identified.estimate.estimator}.",
        f"Runs: {', '.join(origin.runs) or 'unknown'}.",
        "Inputs, SHA-256:",
        *(f"  {role}: {value}" for role, value in origin.inputs.items()),
        "Inertias of moving links include all links that are fixed to them.",
        *more,
        f"{FORMAT_NAMES[form]} cannot represent these parts of the identified model:",
        *(f"  - {sentence}" for sentence in content.unsupported or ("nothing",)),
    ]
    return comment("\n".join(lines))


def comment(text: str) -> str:
    """An XML comment; two hyphens in a row would end it."""
    safe = text.replace("--", "- -").replace("--", "- -")
    return "<!--\n" + "\n".join(f"  {line}" for line in safe.splitlines()) + "\n-->"


INERTIA_ATTRIBUTES = ("ixx", "ixy", "iyy", "ixz", "iyz", "izz")


def urdf_of(content: Content) -> ET.Element:
    """The `<robot>` of a robot's bodies."""
    robot = content.robot
    carriers = carriers_of(robot)
    root, base = ET.Element("robot", name=robot.name), base_of(robot)
    ET.SubElement(root, "link", name=base)
    names = [base, *(body.name for body in robot.bodies)]
    for index, (body, inertia) in enumerate(zip(robot.bodies, content.inertias, strict=True)):
        ET.SubElement(root, "link", name=body.name).append(inertial_of(inertia))
        kind = "prismatic" if body.kind == "prismatic" else "revolute"
        joint = _joint(root, body.joint, kind, body, names[body.parent + 1], body.name)
        ET.SubElement(joint, "axis", xyz=numbers(body.axis))
        if carriers[body.coordinate] == index:
            _limit(joint, body, robot.joints[body.coordinate].limits)
            joint.extend(dynamics_of(content.joints[body.coordinate]))
            continue
        _limit(joint, body, Limits())
        master = robot.bodies[carriers[body.coordinate]].joint
        ratio, offset = number(body.ratio), number(body.offset)
        ET.SubElement(joint, "mimic", joint=master, multiplier=ratio, offset=offset)
    for frame in frames_of(robot, names):
        ET.SubElement(root, "link", name=frame.name)
        parent = names[frame.body + 1]
        _joint(root, f"{frame.name}_fixed", "fixed", frame, parent, frame.name)
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
    ET.SubElement(inertial, "inertia", dict(zip(INERTIA_ATTRIBUTES, map(number, six), strict=True)))
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


def _joint(
    root: ET.Element, name: str, kind: str, place: Body | Frame, parent: str, child: str
) -> ET.Element:
    """A joint between two links, without axis and limits."""
    joint = ET.SubElement(root, "joint", name=name, type=kind)
    joint.append(origin_of(place.rotation, place.position))
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)
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
