"""Arms with tools for process motions, and Pinocchio's word on where the tools are."""

import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import ArrayLike

from oracles import body_positions, pinocchio_model
from steelyard.base.arrays import Array
from steelyard.excite.constraints.constraint_and_limits import MotionLimits, motion_limits
from steelyard.excite.planned.fastest_moves_and_tours import (
    ProcessMotion,
    ToolGuidance,
    TourPlanner,
)
from steelyard.excite.planned.inverse_kinematics import Attitude
from steelyard.excite.planned.plans_from_tables import TASKS
from steelyard.model.equations.frame_and_point_kinematics import frame_of
from steelyard.robot.file.excitation_sections import (
    BoxSpans,
    MotionOfAKind,
    PickAndPlaceSection,
    SquareSection,
    WaypointsSection,
)
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.robot import Robot

FILES = {
    "ur10": ("ur_description/urdf/ur10_robot.urdf", "tool0", ""),
    "panda": ("panda_description/urdf/panda.urdf", "panda_hand", "panda_finger_joint1 = 0.0"),
}


DOWN = Attitude([0.0, 0.0, -1.0])
FREE = ToolGuidance()
REACH = {"ur10": 0.8, "panda": 0.5}


@dataclass(frozen=True, eq=False)
class Arm:
    """A robot, its limits, its tool's frame, and where that is by Pinocchio's own reading."""

    robot: Robot
    limits: MotionLimits
    frame: str
    pose: Callable[[Array], tuple[Array, Array]]

    def places(self, q: Array) -> Array:
        return np.array([self.pose(x)[0] for x in q])


@cache
def arm(name: str) -> Arm:
    """An arm of the shared models, read by us and by Pinocchio from the same URDF."""
    data = os.environ.get("STEELYARD_DATA")
    if not data:
        pytest.skip("STEELYARD_DATA names no folder with the robots' data")
    path, frame, locked = FILES[name]
    urdf = Path(data).parent / "models" / path
    text = f"[robot]\nurdf = '{urdf}'\nlocked = {{ {locked} }}\n"
    robot = load_robot("invented.toml", text).robot
    model = pin.buildModelFromUrdf(str(urdf))
    state, tool = model.createData(), model.getFrameId(frame)

    def pose(q: Array) -> tuple[Array, Array]:
        pin.framesForwardKinematics(model, state, np.pad(q, (0, model.nq - robot.n)))
        return state.oMf[tool].translation.copy(), state.oMf[tool].rotation.copy()

    return Arm(robot, motion_limits(robot), frame, pose)


def invented_arm(robot: Robot, frame: str) -> Arm:
    """An invented robot; Pinocchio gets its bodies."""
    model, carried = pinocchio_model(robot), frame_of(robot, frame)
    state = model.createData()

    def pose(q: Array) -> tuple[Array, Array]:
        pin.forwardKinematics(model, state, body_positions(robot, q))
        at = state.oMi[carried.body + 1] * pin.SE3(
            np.array(carried.rotation), np.array(carried.position)
        )
        return at.translation.copy(), at.rotation.copy()

    return Arm(robot, motion_limits(robot), frame, pose)


def box(centre: ArrayLike, size: ArrayLike) -> BoxSpans:
    low, high = centre - 0.5 * np.array(size), centre + 0.5 * np.array(size)
    x, y, z = zip(low.tolist(), high.tolist(), strict=True)
    return BoxSpans(x=x, y=y, z=z)


def boxes(name: str) -> tuple[BoxSpans, BoxSpans]:
    x = REACH[name]
    return box((x, -0.25, 0.25), (0.2, 0.1, 0.1)), box((x, 0.3, 0.2), (0.1, 0.2, 0.0))


def carried(pick: BoxSpans, place: BoxSpans, **changes: float) -> PickAndPlaceSection:
    """Pick and place without rests."""
    return PickAndPlaceSection(
        kind="pick_and_place", pick=pick, place=place, **{"dwell": 0.0} | changes
    )


def square(centre: tuple[float, ...], side: float, **changes: float) -> SquareSection:
    """A lap of a square without rests."""
    return SquareSection(
        kind="square", centre=centre, side=side, **{"dwell": 0.0, "laps": 1} | changes
    )


def waypoints(points: ArrayLike, dwell: float = 0.0) -> WaypointsSection:
    return WaypointsSection(kind="waypoints", points=np.array(points).tolist(), dwell=dwell)


def plan(
    tooled: str | Arm,
    task: MotionOfAKind,
    guidance: ToolGuidance = FREE,
    *,
    limits: MotionLimits | None = None,
    seed: int = 0,
) -> ProcessMotion:
    tooled = arm(tooled) if isinstance(tooled, str) else tooled
    robot, frame = tooled.robot, frame_of(tooled.robot, tooled.frame)
    tour = TASKS[task.kind](task, robot, seed)
    return TourPlanner(robot, limits or tooled.limits, frame, guidance, seed).fastest(tour)
