"""Motions as tables of samples: CSV, and keyframes of MuJoCo."""

import csv
import io
from collections.abc import Iterable

from steelyard.errors import OutputError
from steelyard.excitation.export.points import even_times, grid_times, head, orders_at
from steelyard.excitation.trajectories.exact import ExactTrajectory
from steelyard.robot.robot import Robot


def csv_of(trajectory: ExactTrajectory, robot: Robot, rate: float) -> str:
    """A row every `1 / rate` seconds and one at the end, with all digits.

    Columns are `time_s`, then `q_NAME`, `dq_NAME` and `ddq_NAME` of all joints, in SI units.
    """
    times = grid_times(trajectory.duration, rate)
    names = [f"{what}_{c.name}" for what in ("q", "dq", "ddq") for c in robot.coordinates]
    parts = [values.tolist() for values in orders_at(trajectory, times)]
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(["time_s", *names])
    for t, q, dq, ddq in zip(times.tolist(), *parts, strict=True):
        table.writerow([t, *q, *dq, *ddq])
    return text.getvalue()


def keyframes_of(trajectory: ExactTrajectory, robot: Robot, rate: float) -> str:
    """An MJCF file of keyframes, to be included in a model with the robot's joints.

    A keyframe has a position and a velocity for every joint of MuJoCo, depth first along the
    tree; joints that follow others (mimic) have theirs.

    Raises:
        OutputError: The robot has joints that loops determine.
    """
    if robot.loops:
        raise OutputError(
            "keyframes need the positions of all joints, but loops determine some of them",
            where=f"robot '{robot.name}'",
            fix="export the motion in another format",
        )
    bodies = [robot.bodies[index] for index in _depth_first(robot)]
    followed = [body.coordinate for body in bodies]
    ratio, offset = [body.ratio for body in bodies], [body.offset for body in bodies]
    times = even_times(trajectory.duration, rate)
    q, dq, _ = orders_at(trajectory, times)
    joints = ", ".join(body.joint for body in bodies)
    lines = head(
        trajectory,
        robot,
        " ",
        f"{len(times)} keyframes in rad (prismatic joints: m). Include this file in a model whose",
        f"joints are, in this order: {joints}.",
    )
    lines = ["<mujoco>", "  <!--", *lines, "  -->", "  <keyframe>"]
    for t, position, velocity in zip(
        times.tolist(), q[:, followed] * ratio + offset, dq[:, followed] * ratio, strict=True
    ):
        state = f'qpos="{_numbers(position.tolist())}" qvel="{_numbers(velocity.tolist())}"'
        lines.append(f'    <key time="{t!r}" {state}/>')
    return "\n".join([*lines, "  </keyframe>", "</mujoco>", ""])


def _depth_first(robot: Robot, parent: int = -1) -> list[int]:
    """Indices of the bodies behind a parent, each followed by those that it carries."""
    found = []
    for index, body in enumerate(robot.bodies):
        if body.parent == parent:
            found += [index, *_depth_first(robot, index)]
    return found


def _numbers(values: Iterable[float]) -> str:
    return " ".join(repr(value) for value in values)
