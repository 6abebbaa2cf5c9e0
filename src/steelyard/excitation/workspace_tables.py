"""Constraints from `[excitation.workspace]`: of the tool's ball, and of all that moves."""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import ModelError
from steelyard.excitation.collision.room import room_of
from steelyard.excitation.collision.whole_robot import load_balls, whole_robot
from steelyard.excitation.constraints.constraint import Constraint
from steelyard.excitation.constraints.keep_out import checked_boxes, keep_out
from steelyard.excitation.constraints.markers import Marker
from steelyard.excitation.constraints.workspace import planes, tool_box
from steelyard.excitation.shapes.model_shapes import world_shapes
from steelyard.excitation.shapes.shapes import Shape, obstacle, wall
from steelyard.excitation.shapes.solids import Box
from steelyard.excitation.uncovered import Gap
from steelyard.kernel.quantities.kinematics import frame_of, last_frame
from steelyard.robot.robot import Robot
from steelyard.robot_file.excitation_sections import WorkspaceSection
from steelyard.robot_file.loaded import LoadedRobot
from steelyard.robot_file.model_source import beside
from steelyard.robot_file.motion_sections import BoxSpans

_AXES = "xyz"

_LEAST = 1e-12
"""Length of a normal that has no direction, and is refused."""

LEVEL = "no gravity is declared: the floor is assumed normal to z of the base"
"""The note on a floor where gravity's direction is not declared."""

ConstraintsAndNotes = tuple[list[Constraint], list[str]]
"""Constraints, and what was assumed."""


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
    with written("workspace] frame"):
        frame = frame_of(robot, section.frame or last_frame(robot))
    return Marker(frame.name, section.point, section.radius)


def workspace_of(loaded: LoadedRobot, world: tuple[Shape, ...]) -> ConstraintsAndNotes:
    """Box of the tool, floor, planes and forbidden boxes; what is carried against the world.

    Raises:
        ModelError: A workspace limit is invalid, or something that it must hold for is missing.
    """
    section = loaded.excitation.workspace or WorkspaceSection()
    found, tool = list[Constraint](), tool_of(section, loaded.robot)
    lower, upper = _sides(section.box)
    if section.box.bounded:
        with written("workspace] box"):
            found.append(tool_box(loaded.robot, [tool], lower, upper))
    if section.only_tool:
        found += _of_tool(section, loaded.robot, tool)
    if section.limits_links or (world and (loaded.excitation.loads or section.radius > 0.0)):
        return _of_all(loaded, section, tool, world, found)
    idle = section.radius > 0.0 and not found
    notes = ["the tool's radius has no effect: it has no box, plane or keep_out"] if idle else []
    return found, notes


def _of_tool(section: WorkspaceSection, robot: Robot, tool: Marker) -> list[Constraint]:
    """Planes and forbidden boxes of the tool's ball."""
    found = list[Constraint]()
    if section.planes:
        normals = np.array([plane.normal for plane in section.planes])
        sizes = np.maximum(np.linalg.norm(normals, axis=1), _LEAST)
        levels = np.array([plane.above for plane in section.planes]) / sizes
        with written("workspace] planes"):
            found.append(planes(robot, [tool], normals, levels))
    if section.keep_out:
        low, high = _boxes(section)
        with written("workspace] keep_out"):
            found.append(keep_out(robot, [tool], low, high))
    return found


def _of_all(
    loaded: LoadedRobot,
    section: WorkspaceSection,
    tool: Marker,
    world: tuple[Shape, ...],
    found: list[Constraint],
) -> ConstraintsAndNotes:
    """What holds for all that the robot moves."""
    collision, loads = loaded.excitation.collision, loaded.excitation.loads
    margin = 0.0 if collision is None else collision.margin
    with written("workspace]"):
        whole = whole_robot(loaded, tool, section.without)
    walls = walls_of(section, loaded.robot)
    own = [ball.name for ball, load in zip(load_balls(loaded), loads, strict=True) if load.radius]
    built, notes = room_of(loaded.robot, whole, walls, world, margin, own)
    level = [Gap(LEVEL)] if section.floor is not None and not loaded.robot.gravity.any() else []
    return [*found, *([] if built is None else [built])], [*notes, *level]


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
    with written("workspace] planes"):
        for number, plane in enumerate(section.planes, start=1):
            found.append(wall(f"plane {number}", plane.normal, plane.above))
    if section.keep_out:
        with written("workspace] keep_out"):
            corners = checked_boxes(*_boxes(section), "forbidden boxes")
        for number, (low, high) in enumerate(zip(*corners, strict=True), start=1):
            x, y, z = (float(size) for size in high - low)
            middle = 0.5 * (low + high)
            found.append(obstacle(f"forbidden box {number}", Box((x, y, z)), middle))
    return tuple(found)


def up_of(robot: Robot) -> Array:
    """Where the floor's normal points in the base frame: against gravity, or z without any."""
    size = float(np.linalg.norm(robot.gravity))
    return np.array([0.0, 0.0, 1.0]) if size == 0.0 else np.asarray(-robot.gravity / size)


def _boxes(section: WorkspaceSection) -> tuple[Array, Array]:
    """Lower and upper corners, shape `(b, 3)` each [m].

    Raises:
        ModelError: One is open.
    """
    boxes = [_sides(box) for box in section.keep_out]
    if any(None in low or None in high for low, high in boxes):
        raise ModelError(
            "a forbidden box is open",
            where="[excitation.workspace] keep_out",
            fix="give x, y and z of each, with two numbers each",
        )
    low, high = zip(*boxes, strict=True)
    return np.array(low), np.array(high)


@contextmanager
def written(key: str) -> Iterator[None]:
    """Errors inside say which key of the tables they are about."""
    try:
        yield
    except ModelError as error:
        where = f"[excitation.{key}"
        raise ModelError(error.wrong, where=where, fix=error.fix) from None


def _sides(box: BoxSpans) -> tuple[list[float | None], list[float | None]]:
    spans = [getattr(box, axis) for axis in _AXES]
    return [s and s[0] for s in spans], [s and s[1] for s in spans]
