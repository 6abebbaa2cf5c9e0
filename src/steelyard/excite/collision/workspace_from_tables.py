"""The tool box, floor, planes, boxes and models of the cell, from `[excitation.workspace]`."""

from collections.abc import Sequence

import numpy as np

from steelyard.base.arrays import Array, by_key
from steelyard.base.errors import ModelError
from steelyard.excite.collision.clearance import CLEARANCE_ROOM, Clearance
from steelyard.excite.collision.pairs_to_keep_apart import Pair, random_postures
from steelyard.excite.collision.robot_and_cell_shapes_from_files import world_shapes
from steelyard.excite.collision.shapes_given_or_assumed import WholeRobot, load_balls, whole_robot
from steelyard.excite.collision.solids_and_shapes import Box, Shape, obstacle, wall
from steelyard.excite.constraints.constraint_and_limits import Constraint, Gap
from steelyard.excite.constraints.tool_workspace import (
    Marker,
    checked_boxes,
    keep_out,
    planes,
    tool_box,
)
from steelyard.model.equations.frame_and_point_kinematics import frame_of
from steelyard.robot.file.excitation_sections import WorkspaceSection
from steelyard.robot.file.model_reading_and_loaded_robot import LoadedRobot, beside
from steelyard.robot.file.tables_by_kind import at_place
from steelyard.robot.robot import Robot

WALL_RESERVE = 5e-5  # kept beyond every wall [m], for controllers that interpolate between points

WALLS_NAME = "floor, planes and boxes"  # of the constraint

_WALL_POSTURES = 24
_SAME_DISTANCE = 1e-9
_NEAR_DISTANCE = 1e-3
_INSIDE_DISTANCE = 1e-6

WALLS_PROOF = (
    "distances of convex shapes with bounds of their rate of change, over time intervals; "
    f"{1e3 * WALL_RESERVE:g} mm are reserved at every boundary"
)


def clearance_of_walls(
    loaded: LoadedRobot, whole: WholeRobot, walls: Sequence[Shape], cell: Sequence[Shape]
) -> tuple[list[Constraint], tuple[str, ...]]:
    """All that moves against walls, and what it carries against the cell, if there is something.

    Links are kept from the `cell` elsewhere, and so are loads with a radius; all else keeps the
    margin of collisions from it. Also what the user should know, one sentence each.
    """
    collision, loads = loaded.excitation.collision, loaded.excitation.loads
    aside = [ball.name for ball, one in zip(load_balls(loaded), loads, strict=True) if one.radius]
    links, carried, notes = whole
    moving = [link for link in links if link.body >= 0]
    shapes = (*moving, *carried, *walls, *cell)
    first = len(moving) + len(carried)
    standing = first + len(walls)
    loose = [k for k in range(len(moving), first) if shapes[k].name not in aside]
    meeting = [(i, j) for i in range(first) for j in range(first, standing)]
    meeting += [(i, j) for i in loose for j in range(standing, len(shapes))]
    ways = by_key(((shapes[i].name, shapes[j].name), (i, j)) for i, j in meeting)
    pairs = tuple(Pair(first, second, tuple(own)) for (first, second), own in ways.items())
    if not pairs:
        return [], notes
    kept, more = _changing_pairs(loaded.robot, shapes, pairs)
    notes += more
    if walls and (still := ", ".join(dict.fromkeys(s.name for s in links if s.body < 0))):
        notes += (f"the base does not move, so workspace limits ignore its links: {still}",)
    if not kept:
        return [], notes
    names = frozenset(wall.name for wall in walls)
    things = len({pair.first for pair in kept})
    skip = () if loaded.excitation.workspace is None else loaded.excitation.workspace.without
    scope = f"all links{' but ' if skip else ''}{', '.join(skip)}"
    margin = 0.0 if collision is None else collision.margin
    found = Clearance(
        loaded.robot,
        shapes,
        kept,
        np.array([WALL_RESERVE if pair.second in names else margin for pair in kept]),
        np.full(len(kept), CLEARANCE_ROOM),
        name=WALLS_NAME,
        scope=f"{scope}, tool and loads: {things} moving bodies",
        walls=names,
        how=WALLS_PROOF,
    )
    return [found], notes


def _changing_pairs(
    robot: Robot, shapes: tuple[Shape, ...], pairs: tuple[Pair, ...]
) -> tuple[tuple[Pair, ...], tuple[str, ...]]:
    """Pairs whose distance the joints change, or that are well apart; and notes on the others."""
    zero = np.zeros(len(pairs))
    seen = Clearance(robot, shapes, pairs, zero, zero + CLEARANCE_ROOM).distances(
        random_postures(robot)[:_WALL_POSTURES]
    )
    same, least = np.ptp(seen, axis=0) < _SAME_DISTANCE, seen.min(axis=0)
    close = [
        (pair, float(d))
        for pair, d, s in zip(pairs, least, same, strict=True)
        if s and d < _NEAR_DISTANCE
    ]
    inside = [
        f"{p.first} in {p.second} by {-1e3 * d:.3g} mm" for p, d in close if d < -_INSIDE_DISTANCE
    ]
    touching = [f"{p.first} and {p.second}" for p, d in close if d >= -_INSIDE_DISTANCE]
    notes = list[str]()
    if inside:
        names = ", ".join(inside)
        notes.append(Gap(f"outside the workspace limits in every posture, so left out: {names}"))
    if touching:
        notes.append(f"in contact in every posture, so left out: {', '.join(touching)}")
    left = [pair for pair, _ in close]
    return tuple(pair for pair in pairs if pair not in left), tuple(notes)


ASSUMED_FLOOR_NOTE = "no gravity is declared: the floor is assumed normal to z of the base"

ConstraintsAndNotes = tuple[list[Constraint], list[str]]  # constraints, and what was assumed


def world_of(loaded: LoadedRobot) -> tuple[Shape, ...]:
    """The shapes of the cell, if a file names one."""
    section = loaded.excitation.collision
    if section is None or section.world is None:
        return ()
    where = "[excitation.collision] world"
    return world_shapes(beside(loaded.sources[0].path, section.world, where))


def tool_of(section: WorkspaceSection | None, robot: Robot) -> Marker:
    """The tool: the named frame, or the last one of the robot."""
    section = WorkspaceSection() if section is None else section
    with at_place("[excitation.workspace] frame"):
        frame = frame_of(robot, section.frame)
    return Marker(frame.name, section.point, section.radius)


def workspace_of(loaded: LoadedRobot, world: tuple[Shape, ...]) -> ConstraintsAndNotes:
    """Box of the tool, floor, planes and forbidden boxes; what is carried against the world.

    Raises:
        ModelError: A workspace limit is invalid, or something that it must hold for is missing.
    """
    section = loaded.excitation.workspace or WorkspaceSection()
    found, tool = list[Constraint](), tool_of(section, loaded.robot)
    if section.box.bounded:
        sides = zip(*(span or (None, None) for span in section.box.spans), strict=True)
        with at_place("[excitation.workspace] box"):
            found.append(tool_box(loaded.robot, tool, *sides))
    if section.only_tool and section.planes:
        normals, levels = zip(*((x.normal, x.above) for x in section.planes), strict=True)
        with at_place("[excitation.workspace] planes"):
            found.append(planes(loaded.robot, tool, normals, levels))
    if section.only_tool and section.keep_out:
        low, high = _boxes(section)
        with at_place("[excitation.workspace] keep_out"):
            found.append(keep_out(loaded.robot, tool, low, high))
    if not (section.limits_links or (world and (loaded.excitation.loads or section.radius > 0.0))):
        idle = section.radius > 0.0 and not found
        return found, ["the tool's radius has no effect: it has no box, plane or keep_out"] * idle
    with at_place("[excitation.workspace]"):
        whole = whole_robot(loaded, tool, section.without)
    built, notes = clearance_of_walls(loaded, whole, walls_of(section, loaded.robot), world)
    if section.floor is not None and not loaded.robot.gravity.any():
        notes += (Gap(ASSUMED_FLOOR_NOTE),)
    return [*found, *built], list(notes)


def walls_of(section: WorkspaceSection, robot: Robot) -> tuple[Shape, ...]:
    """Floor, planes and boxes that hold for all links, as shapes that stand still.

    Raises:
        ModelError: A plane has no direction, or a box is open or empty.
    """
    found = list[Shape]()
    if section.floor is not None:
        found.append(wall("floor", up_of(robot), section.floor))
    if section.only_tool:
        return tuple(found)
    with at_place("[excitation.workspace] planes"):
        for number, plane in enumerate(section.planes, start=1):
            found.append(wall(f"plane {number}", plane.normal, plane.above))
    if section.keep_out:
        with at_place("[excitation.workspace] keep_out"):
            corners = checked_boxes(*_boxes(section), "forbidden boxes")
        for number, (low, high) in enumerate(zip(*corners, strict=True), start=1):
            x, y, z = (float(size) for size in high - low)
            found.append(obstacle(f"forbidden box {number}", Box((x, y, z)), 0.5 * (low + high)))
    return tuple(found)


def up_of(robot: Robot) -> Array:
    """Where the floor's normal points in the base frame: against gravity, or z without any."""
    size = float(np.linalg.norm(robot.gravity))
    return np.array([0.0, 0.0, 1.0]) if size == 0.0 else np.asarray(-robot.gravity / size)


def _boxes(section: WorkspaceSection) -> tuple[Array, Array]:
    """Lower and upper corners, shape `(b, 3)` each [m]."""
    boxes = [box.spans for box in section.keep_out]
    if any(None in spans for spans in boxes):
        raise ModelError(
            "a forbidden box is open",
            where="[excitation.workspace] keep_out",
            fix="give x, y and z of each, with two numbers each",
        )
    low, high = np.array(boxes).transpose(2, 0, 1)
    return low, high
