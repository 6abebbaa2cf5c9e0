r"""Shapes of all that a robot moves; capsules are assumed for links that a model gives none.

A link reaches from its joint to the joints and frames that it carries and, where its mass is known,
to twice its centre of mass, as an even rod does. The radius is that of the even cylinder with the
link's least moment of inertia, $r = \sqrt{2 I / m}$, or a share of the robot's reach.
"""

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import ModelError
from steelyard.excite.collision.robot_and_cell_shapes_from_files import check_links, readable_shapes
from steelyard.excite.collision.solids_and_shapes import (
    Ball,
    Capsule,
    Origin,
    Shape,
    axes_along,
    placed,
)
from steelyard.excite.constraints.constraint_and_limits import Declined, Gap
from steelyard.excite.constraints.tool_workspace import Marker
from steelyard.model.equations.frame_and_point_kinematics import frame_of
from steelyard.robot.file.model_reading_and_loaded_robot import LoadedRobot, read_mechanism
from steelyard.robot.inertia_and_placement import Inertia
from steelyard.robot.robot import Frame, Robot

SLENDER_RADIUS_SHARE = 0.05  # radius of a link of unknown mass, over the robot's length
WIDEST_RADIUS_FACTOR = 3.0  # radii from inertias stay within this factor of that, either way
SHORT_REACH = 1e-3  # reaches below this [m] are those of frames in one place


Links = tuple[Mapping[str, Frame], Mapping[str, str], Mapping[str, Inertia]]
"""The links of a robot, whether they move or are merged into others: their frames, the parents that
carry all but the root, and inertias of links whose mass is known, in their own frames."""


def assumed_shapes(
    robot: Robot, links: Links, shaped: Collection[str], ends: Mapping[str, Sequence[Array]]
) -> tuple[Shape, ...]:
    """Capsules and balls for moving links that are not `shaped` but must have a shape.

    Those are links with a mass, and links that carry a joint, a real link, or one of `ends`: frames
    that something real is fixed to, such as the tool's, and where on their bodies, each of shape
    `(3,)` [m]; a link that is more than a frame reaches there.
    """
    frames, parents, inertias = links
    real = set[str]()  # links with something real, links that joints move, and all that carry them
    for name in (*shaped, *inertias, *ends, *(body.name for body in robot.bodies)):
        link: str | None = name
        while link is not None and link not in real:
            real.add(link)
            link = parents.get(link)
    bodies, found = {body.name for body in robot.bodies}, list[Shape]()
    for name, frame in frames.items():
        if frame.body >= 0 and name in real and name not in shaped:
            more = ends.get(name, ()) if name in bodies else ()
            found += _link_shapes(robot, links, name, real, more)
    return tuple(found)


def reach(robot: Robot) -> float:
    """Greatest length from the base over joint after joint to an end, slides at their longest."""
    lengths = np.zeros(len(robot.bodies) + 1)
    for k, body in enumerate(robot.bodies):
        span = max(float(np.linalg.norm(end)) for end in _origins(robot, k))
        lengths[k + 1] = lengths[body.parent + 1] + span
    tips = [lengths[f.body + 1] + float(np.linalg.norm(f.position)) for f in robot.frames]
    return float(max([*lengths, *tips]))


def _origins(robot: Robot, number: int) -> list[Array]:
    """Where a body's origin may be in its parent's frame: once, or at both ends of a slide."""
    body = robot.bodies[number]
    if body.kind == "revolute":
        return [body.position]
    limits = robot.joints[body.coordinate].limits
    ends = [body.ratio * x + body.offset for x in (limits.lower, limits.upper) if np.isfinite(x)]
    return [body.position + body.rotation @ body.axis * x for x in ends or [0.0]]


def _link_shapes(
    robot: Robot, links: Links, name: str, real: Collection[str], more: Sequence[Array]
) -> list[Shape]:
    """A capsule to every end of a link; a ball at its origin if it has a mass and no end."""
    frames, parents, inertias = links
    frame, inertia = frames[name], inertias.get(name)
    radius = usual = SLENDER_RADIUS_SHARE * reach(robot)
    origins = {body.name: _origins(robot, k) for k, body in enumerate(robot.bodies)}
    ends = list(more)
    for child, parent in parents.items():
        if parent == name and child in real and child in frames:
            ends += origins.get(child, [frames[child].position])
    if inertia is not None:
        least = float(np.linalg.eigvalsh(inertia.inertia_com)[0])
        even = np.sqrt(2.0 * max(least, 0.0) / inertia.mass)
        radius = float(np.clip(even, usual / WIDEST_RADIUS_FACTOR, usual * WIDEST_RADIUS_FACTOR))
        ends.append(frame.position + frame.rotation @ (2.0 * inertia.com))
    own = [
        rod(name, frame, end, radius)
        for end in ends
        if np.linalg.norm(end - frame.position) > SHORT_REACH
    ]
    if own or inertia is None:
        return own
    return [Shape(name, frame.body, np.eye(3), frame.position, Ball(radius))]


def rod(name: str, frame: Frame, end: Array, radius: float, origin: Origin = "link") -> Shape:
    """A capsule from a frame's origin to a place, both in the frame of the body."""
    way = end - frame.position
    length = float(np.linalg.norm(way))
    middle, turned = 0.5 * (frame.position + end), axes_along(way)
    return Shape(name, frame.body, turned, middle, Capsule(radius, length), origin)


POINT_TOOL_RADIUS = 1e-4  # radius of the ball that stands for a tool that is a point [m]


WholeRobot = tuple[list[Shape], list[Shape], tuple[str, ...]]
"""Shapes of all links, balls of tool and loads that move, and notes on where shapes come from."""


def whole_robot(loaded: LoadedRobot, tool: Marker, skip: Collection[str]) -> WholeRobot:
    """All of a robot but `skip`: collision shapes, or visual ones, or assumed capsules."""
    robot = loaded.robot
    if robot.loops:
        raise ModelError(
            "workspace limits of all links are not supported for a robot with closed chains",
            where=f"robot '{robot.name}'",
            fix="bound the joints, or the tool alone by box, or by planes and keep_out with "
            "only_tool = true",
        )
    tree, model = _link_tree(loaded), loaded.sources[-1].path
    check_links(skip, tree[0], f"robot '{robot.name}'")
    wanted = [name for name in tree[0] if name not in skip]
    ends: dict[str, list[Array]] = {tool.frame: [tool.on(robot).position]}
    for load in loaded.excitation.loads:
        at = Marker(frame_of(robot, load.frame).name, load.com)
        ends.setdefault(at.frame, []).append(at.on(robot).position)
    given, drawn = list[Shape](), list[Shape]()
    if model.suffix.lower() != ".toml":
        given += readable_shapes(robot, model, wanted)
        bare = set(wanted) - {shape.name for shape in given}
        drawn += readable_shapes(robot, model, bare, "visual")
    shaped = {*skip, *(shape.name for shape in (*given, *drawn))}
    assumed = assumed_shapes(robot, tree, shaped, ends)
    links = [s for s in (*given, *drawn, *assumed) if not s.flat]
    # the ball of the tool, and a rod as wide from the frame's origin to it
    frame, radius = frame_of(robot, tool.frame), max(tool.radius, POINT_TOOL_RADIUS)
    name = f"{tool.ball if tool.radius > 0.0 else 'tool point'} at {tool.frame}"
    carried = [placed(frame, name, Ball(radius), tool.offset, origin="tool")]
    if np.linalg.norm(tool.offset) > 0.0:
        carried.append(rod(name, frame, ends[tool.frame][0], radius, "tool"))
    moving = [shape for shape in (*carried, *load_balls(loaded)) if shape.body >= 0]
    return links, moving, _notes_on_shapes(drawn, assumed, skip)


def _link_tree(loaded: LoadedRobot) -> Links:
    """The links as the model file has them, or as the bodies of a table are."""
    robot, model = loaded.robot, loaded.sources[-1].path
    frames = {body.name: frame_of(robot, body.name) for body in robot.bodies}
    frames |= {frame.name: frame for frame in robot.frames}
    if model.suffix.lower() != ".toml":
        mechanism = read_mechanism(model)
        parents = {joint.child: joint.parent for joint in mechanism.joints}
        known = {link.name: link.inertia for link in mechanism.links if link.name in frames}
        masses = {name: own for name, own in known.items() if own is not None and own.mass > 0.0}
        return frames, parents, masses
    names = [body.name for body in robot.bodies]
    parents = {name: names[f.body] for name, f in frames.items() if f.body >= 0}
    parents |= {b.name: names[b.parent] for b in robot.bodies if b.parent >= 0}
    masses = {body.name: body.inertia for body in robot.bodies if body.inertia.mass > 0.0}
    for name in [body.name for body in robot.bodies if body.parent < 0]:
        parents.pop(name, None)
    return frames, parents, masses


def load_balls(loaded: LoadedRobot) -> tuple[Shape, ...]:
    """The balls of the loads that the tables name."""
    robot, loads = loaded.robot, loaded.excitation.loads
    return tuple(
        placed(
            frame_of(robot, load.frame),
            f"load {number} (ball of radius {1e3 * load.ball:.3g} mm)",
            Ball(load.ball),
            load.com,
            origin="tool",
        )
        for number, load in enumerate(loads, start=1)
    )


def _notes_on_shapes(
    drawn: Sequence[Shape], assumed: Sequence[Shape], skip: Collection[str]
) -> tuple[str, ...]:
    """Where shapes come from, if not from the model's collision shapes."""
    notes = list[str]()
    if skip:
        notes.append(Declined(f"workspace limits ignore the links {', '.join(skip)}"))
    if drawn:
        names = ", ".join(dict.fromkeys(shape.name for shape in drawn))
        notes.append(
            f"no collision shape; workspace limits use the hull of the visual one: {names}"
        )
    if assumed:
        widths = {
            shape.name: 1e3 * (s.disc if isinstance(s, Capsule) else s.radius)
            for shape in assumed
            for s in [shape.solid]
        }
        names = ", ".join(f"{name} ({width:.3g} mm)" for name, width in widths.items())
        notes.append(
            Gap(
                "no shape in the model; workspace limits use capsules from joint to joint, of "
                f"radius: {names}"
            )
        )
    return tuple(notes)
