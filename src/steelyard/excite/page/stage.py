"""What a replay shows: shapes of a robot along a motion, and the path of its tool."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import ModelError
from steelyard.excite.collision.cell import tool_of
from steelyard.excite.collision.model_shapes import robot_shapes, world_shapes
from steelyard.excite.collision.robot_shapes import along
from steelyard.excite.collision.shapes import Shape, ShapeKinematics
from steelyard.excite.collision.solids import Ball, Cylinder
from steelyard.excite.page.robot_in_space import all_lines, faces_of, tool_frame, tool_path
from steelyard.robot.loop_closures import all_joints, closest
from steelyard.robot.robot import Robot

if TYPE_CHECKING:
    from steelyard.excite.constraints.markers import Marker
    from steelyard.excite.trajectories.trajectory import ExactTrajectory
    from steelyard.robot.file.excitation_sections import WorkspaceSection
    from steelyard.robot.file.loaded_robot import LoadedRobot


PATH_POINTS_A_SECOND = 50.0
"""Points of the tool's path a second."""

MOST_PATH_POINTS = 6000
"""Most points of the path."""

STICK_RADIUS_SHARE = 0.02
"""Radius of a stick, over the length of the arm."""

SHORT_STICK = 1e-6
"""Sticks that are shorter [m] are left out."""


@dataclass(frozen=True, eq=False)
class Stage:
    """Everything that a replay shows.

    Attributes:
        robot: The robot.
        trajectory: Its motion.
        shapes: What is drawn; a stick stands for a link without shapes.
        tool: The point whose path is drawn.
        t: Times of the path, shape `(F,)` [s].
        joints: Positions of all joints there, shape `(F, n_joints)`.
        path: The tool there, shape `(F, 3)` [m].
        walls: Lines of walls, shape `(L, 2, 3)` each [m], and whether they are of boxes that are
            kept out of.
        notes: What the user should know, one sentence each.
    """

    robot: Robot
    trajectory: ExactTrajectory
    shapes: tuple[Shape, ...]
    tool: Marker
    t: Array
    joints: Array
    path: Array
    walls: tuple[tuple[bool, Array], ...]
    notes: tuple[str, ...]

    @property
    def duration(self) -> float:
        """Length of the motion [s]."""
        return self.trajectory.duration

    @cached_property
    def _kinematics(self) -> ShapeKinematics:
        return ShapeKinematics(self.robot, self.shapes)

    def at(self, time: float) -> tuple[Array, Array]:
        """Axes `(G, 3, 3)` and origins `(G, 3)` [m] of all shapes at a time of the motion."""
        poses = self._kinematics(self._posture(time)[None])
        return poses.rotations[0], poses.origins[0]

    def _posture(self, time: float) -> Array:
        """Positions of all joints, shape `(n_joints,)`."""
        own = self.trajectory.derivative([time], 0)[0]
        if not self.robot.passive:
            return np.asarray(own)
        near = self.joints[np.argmin(np.abs(self.t - time))]
        n = self.robot.n
        start = np.concatenate([own, near[n:]])
        return closest(self.robot, start, range(n, self.robot.n_joints))


def staged(loaded: LoadedRobot, trajectory: ExactTrajectory) -> Stage:
    """The stage of a robot and a motion.

    Args:
        loaded: The robot and the tables of its file.
        trajectory: A motion of its joints.

    Raises:
        ModelError: The file of the cell cannot be read, or the tool is not there.
    """
    robot, section = loaded.robot, loaded.excitation
    tool = tool_of(section.workspace, robot)
    count = int(np.clip(PATH_POINTS_A_SECOND * trajectory.duration, 2, MOST_PATH_POINTS))
    t = np.linspace(0.0, trajectory.duration, count)
    joints = all_joints(robot, trajectory.derivative(t, 0))
    path = tool_path(robot, tool, joints)
    shapes, notes = _shapes(loaded)
    bare = sticks(robot, tool, {shape.body for shape in shapes})
    cell = _cell(loaded)
    walls = _walls(section.workspace, robot, path)
    everything = (*shapes, *bare, *cell)
    return Stage(robot, trajectory, everything, tool, t, joints, path, walls, notes)


def _shapes(loaded: LoadedRobot) -> tuple[tuple[Shape, ...], tuple[str, ...]]:
    """Shapes of the model, none where it has none."""
    section, model = loaded.excitation.collision, loaded.sources[-1].path
    skip = () if section is None else section.without
    if model.suffix == ".toml":
        return (), ("the robot has no model file: its links are drawn as sticks",)
    try:
        found = robot_shapes(loaded.robot, model, skip)
    except ModelError as error:
        return (), (f"links are drawn as sticks: {error.wrong}",)
    return found.shapes, ()


def _cell(loaded: LoadedRobot) -> tuple[Shape, ...]:
    """What stands around the robot."""
    section = loaded.excitation.collision
    if section is None or section.world is None:
        return ()
    return world_shapes(loaded.sources[0].path.parent / Path(section.world))


def sticks(robot: Robot, tool: Marker, shaped: set[int]) -> tuple[Shape, ...]:
    """Bodies without shapes: a ball at each joint, a stick to every joint and tool they carry.

    Args:
        robot: The robot.
        tool: Its tool.
        shaped: Bodies that have shapes; -1 is the base.
    """
    last = tool_frame(robot, tool)
    ends = [(body.parent, body.joint, body.position) for body in robot.bodies]
    ends.append((last.body, last.name, last.position))
    reach = sum(float(np.linalg.norm(end)) for _, _, end in ends)
    radius = max(STICK_RADIUS_SHARE * reach, 1e-3)
    found = []
    for k, body in enumerate(robot.bodies):
        if k not in shaped:
            ball = Ball(1.3 * radius)
            found.append(Shape(body.name, k, np.eye(3), np.zeros(3), ball))
    for carrier, name, end in ends:
        length = float(np.linalg.norm(end))
        if carrier not in shaped and length > SHORT_STICK:
            turned = along(end / length)
            stick = Cylinder(radius, length)
            found.append(Shape(f"to {name}", carrier, turned, 0.5 * end, stick))
    return tuple(found)


def _walls(
    workspace: WorkspaceSection | None, robot: Robot, path: Array
) -> tuple[tuple[bool, Array], ...]:
    faces = faces_of(workspace, robot, path)
    kinds = {bad: [face for face in faces if face.forbidden == bad] for bad in (False, True)}
    return tuple((bad, all_lines(own)) for bad, own in kinds.items() if own)
