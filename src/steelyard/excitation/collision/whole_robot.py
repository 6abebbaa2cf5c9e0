"""Everything that a robot moves, as shapes: links, tool and loads, and what had to be assumed."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from steelyard.arrays import Array
from steelyard.errors import ModelError
from steelyard.excitation.constraints.markers import Marker
from steelyard.excitation.shapes.assumed_shapes import LinkTree, assumed_shapes, rod
from steelyard.excitation.shapes.model_shapes import readable_shapes
from steelyard.excitation.shapes.shapes import Shape, placed
from steelyard.excitation.shapes.solids import Ball, Capsule, HalfSpace
from steelyard.excitation.uncovered import Declined, Gap
from steelyard.kernel.quantities.kinematics import frame_of, last_frame
from steelyard.robot.robot import Robot
from steelyard.robot_file.loaded import LoadedRobot
from steelyard.robot_file.model_source import read_mechanism
from steelyard.suggest import advice

POINT = 1e-4
"""Radius of the ball that stands for a tool that is a point [m]."""


@dataclass(frozen=True, eq=False)
class WholeRobot:
    """Everything that moves.

    Attributes:
        links: Shapes of the links.
        carried: Balls of the tool and of the loads.
        still: Names of links that the base carries: they do not move.
        without: Names of links that were left out.
        notes: What the user should know, one sentence each.
    """

    links: tuple[Shape, ...]
    carried: tuple[Shape, ...]
    still: tuple[str, ...]
    notes: tuple[str, ...]
    without: tuple[str, ...] = ()

    @property
    def scope(self) -> str:
        """What it stands for."""
        return f"all links{' but ' if self.without else ''}{', '.join(self.without)}"


def whole_robot(loaded: LoadedRobot, tool: Marker, skip: Collection[str] = ()) -> WholeRobot:
    """All that a robot moves: collision shapes, or visual ones, or assumed capsules.

    Args:
        loaded: The robot, its tables and the files it came from.
        tool: Its tool.
        skip: Links to go without.

    Raises:
        ModelError: The robot has closed chains, or a frame or a link does not exist.
    """
    robot = loaded.robot
    if robot.loops:
        raise ModelError(
            "workspace limits of all links are not supported for a robot with closed chains",
            where=f"robot '{robot.name}'",
            fix="bound the joints, or the tool alone by box, or by planes and keep_out with "
            "only_tool = true",
        )
    tree, model = _tree(loaded), loaded.sources[-1].path
    for name in skip:
        if name not in tree.frames:
            raise ModelError(
                f"there is no link '{name}' to skip",
                where=f"robot '{robot.name}'",
                fix=advice(name, tree.frames, "links"),
            )
    wanted = [name for name in tree.frames if name not in skip]
    ends: dict[str, list[Array]] = {tool.frame: [_at(robot, tool.frame, tool.offset)]}
    for load in loaded.excitation.loads:
        name = load.frame or last_frame(robot)
        ends.setdefault(name, []).append(_at(robot, name, load.com))
    given, drawn = list[Shape](), list[Shape]()
    if model.suffix.lower() != ".toml":
        given += readable_shapes(robot, model, wanted)
        bare = set(wanted) - {shape.name for shape in given}
        drawn += readable_shapes(robot, model, bare, "visual")
    shaped = {*skip, *(shape.name for shape in (*given, *drawn))}
    assumed = assumed_shapes(robot, tree, shaped, ends)
    links = [s for s in (*given, *drawn, *assumed) if not isinstance(s.solid, HalfSpace)]
    return WholeRobot(
        tuple(shape for shape in links if shape.body >= 0),
        tuple(s for s in (*_tool(robot, tool), *load_balls(loaded)) if s.body >= 0),
        tuple(dict.fromkeys(shape.name for shape in links if shape.body < 0)),
        _notes(drawn, assumed, skip),
        tuple(skip),
    )


def _tree(loaded: LoadedRobot) -> LinkTree:
    """The links as the model file has them, or as the bodies of a table are."""
    robot, model = loaded.robot, loaded.sources[-1].path
    frames = {body.name: frame_of(robot, body.name) for body in robot.bodies}
    frames |= {frame.name: frame for frame in robot.frames}
    if model.suffix.lower() != ".toml":
        mechanism = read_mechanism(model)
        parents = {joint.child: joint.parent for joint in mechanism.joints}
        known = {link.name: link.inertia for link in mechanism.links if link.name in frames}
        masses = {name: own for name, own in known.items() if own is not None and own.mass > 0.0}
        return LinkTree(frames, parents, masses)
    names = [body.name for body in robot.bodies]
    parents = {name: names[f.body] for name, f in frames.items() if f.body >= 0}
    parents |= {b.name: names[b.parent] for b in robot.bodies if b.parent >= 0}
    masses = {body.name: body.inertia for body in robot.bodies if body.inertia.mass > 0.0}
    roots = [body.name for body in robot.bodies if body.parent < 0]
    for name in roots:
        parents.pop(name, None)
    return LinkTree(frames, parents, masses)


def _tool(robot: Robot, tool: Marker) -> list[Shape]:
    """The ball of the tool, and a rod as wide from the frame's origin to it."""
    frame, radius = frame_of(robot, tool.frame), max(tool.radius, POINT)
    name = f"tool point at {tool.frame}"
    if tool.radius > 0.0:
        name = f"{tool.ball} at {tool.frame}"
    shapes = [placed(frame, name, Ball(radius), tool.offset, origin="tool")]
    if np.linalg.norm(tool.offset) > 0.0:
        end = _at(robot, tool.frame, tool.offset)
        shapes.append(rod(name, frame, end, radius, "tool"))
    return shapes


def _at(robot: Robot, name: str, place: ArrayLike) -> Array:
    """A place in a frame, in that of the frame's body, shape `(3,)` [m]."""
    frame = frame_of(robot, name)
    return np.asarray(frame.position + frame.rotation @ np.asarray(place))


def load_balls(loaded: LoadedRobot) -> tuple[Shape, ...]:
    """The balls of the loads that the tables name."""
    robot, loads = loaded.robot, loaded.excitation.loads
    return tuple(
        placed(
            frame_of(robot, load.frame or last_frame(robot)),
            f"load {number} (ball of radius {1e3 * load.ball:.3g} mm)",
            Ball(load.ball),
            load.com,
            origin="tool",
        )
        for number, load in enumerate(loads, start=1)
    )


def _notes(
    drawn: Sequence[Shape], assumed: Sequence[Shape], skip: Collection[str]
) -> tuple[str, ...]:
    """Where shapes come from, if not from the model's collision shapes."""
    notes = list[str]()
    if skip:
        notes.append(Declined(f"workspace limits ignore the links {', '.join(skip)}, as specified"))
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
