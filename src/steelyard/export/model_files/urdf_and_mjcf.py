r"""A robot as URDF and as MJCF, ready to be simulated by MuJoCo; exact numbers of XML files.

The inertia of a link is given at its centre of mass, in the link's own axes. In MJCF rotor inertia
is *armature*, dry friction *frictionloss*, friction with powers of speed the polynomial of
*damping*, springs are *stiffness* with *springref*; what acts along a sum of joints is a fixed
tendon, a spring between links a spatial one. Mimic joints are joint equalities, pins of loops
`connect` equalities between sites. Each joint has a motor of its own. Positions are the robot's; a
model with loops starts where they are closed.
"""

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Sequence

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
from steelyard.model.equations.frame_and_point_kinematics import frame_of
from steelyard.model.terms.term import AxisPartKind
from steelyard.robot.inertia_and_placement import Inertia, rpy_of, six_numbers, turn
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
    if not robot.floating:
        ET.SubElement(root, "link", name=base)
    names = [base, *(body.name for body in robot.bodies)]
    for index, (body, inertia) in enumerate(zip(robot.bodies, content.inertias, strict=True)):
        ET.SubElement(root, "link", name=body.name).append(inertial_of(inertia))
        if body.kind == "floating":
            continue
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
        _joint(root, f"{frame.name}_fixed", "fixed", frame, names[frame.body + 1], frame.name)
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
    option = ET.SubElement(root, "option", timestep=number(TIMESTEP), integrator="implicitfast")
    option.set("gravity", numbers(robot.gravity))
    bodies = _bodies(content, ET.SubElement(root, "worldbody"))
    names = [body.get("name", WORLD) for body in bodies]
    for frame in frames_of(robot, names):
        _site(bodies[frame.body + 1], frame.name, frame.position, frame.rotation)
    _tendons(root, content, bodies)
    _equalities(root, robot, bodies)
    motors = ET.SubElement(root, "actuator")
    for joint in robot.coordinates[robot.n_base :]:
        motor = ET.SubElement(motors, "motor", name=joint.name, joint=joint.name)
        if np.isfinite(joint.limits.effort):
            motor.set("ctrlrange", numbers([-joint.limits.effort, joint.limits.effort]))
    _home(root, robot, bodies[0])
    return root


def _bodies(content: Content, world: ET.Element) -> list[ET.Element]:
    """The base's and all bodies' elements, each inside its parent's."""
    robot, base = content.robot, base_of(content.robot)
    carriers = carriers_of(robot)
    at_world = robot.floating or base == WORLD
    placed = [world if at_world else ET.SubElement(world, "body", name=base)]
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
        body_mass = ET.SubElement(element, "inertial", pos=numbers(com), mass=number(inertia.mass))
        body_mass.set("fullinertia", numbers([about[i, j] for i, j in FULL_INERTIA]))
        placed.append(element)
        if body.kind == "floating":
            ET.SubElement(element, "freejoint", name=body.joint)
            continue
        joint = ET.SubElement(element, "joint", name=body.joint, type=kind, axis=numbers(body.axis))
        if start:
            joint.set("ref", number(start))
        if carriers[body.coordinate] == index:
            limits = robot.joints[body.coordinate].limits
            if np.isfinite([limits.lower, limits.upper]).any():
                joint.set("range", f"{limit(limits.lower)} {limit(limits.upper)}")
            if np.isfinite(limits.effort):
                joint.set("actuatorfrcrange", numbers([-limits.effort, limits.effort]))
            _effects(joint, content.joints[body.coordinate], "springref")
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
        tendon = ET.SubElement(tendons, "spatial", name=pull.name, stiffness=number(pull.stiffness))
        tendon.set("springlength", number(pull.preload / pull.stiffness))
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
    carriers = carriers_of(robot)
    followers = [k for k, body in enumerate(robot.bodies) if carriers[body.coordinate] != k]
    if not followers and not robot.loops:
        return
    equalities = ET.SubElement(root, "equality")
    for index in followers:
        body = robot.bodies[index]
        master = robot.bodies[carriers[body.coordinate]].joint
        tie = ET.SubElement(equalities, "joint", joint1=body.joint, joint2=master)
        tie.attrib |= {"polycoef": f"0 {number(body.ratio)} 0 0 0", "solref": STIFF}
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
    free = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0] if robot.floating else []
    frames = ET.SubElement(root, "keyframe")
    qpos = numbers([*free, *(positions[name] for name in order)])
    ET.SubElement(frames, "key", name="home", qpos=qpos)
