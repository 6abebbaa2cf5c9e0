from dataclasses import replace

import numpy as np
import pytest

from invented import dh_arm, single, tree
from steelyard.base.arrays import Array
from steelyard.base.errors import DataError
from steelyard.excite.collision.workspace_from_tables import up_of
from steelyard.excite.constraints.constraint_and_limits import MotionLimits
from steelyard.excite.planned.fastest_moves_and_tours import (
    STRAIGHTNESS,
    ProcessMotion,
    ToolGuidance,
)
from steelyard.excite.planned.inverse_kinematics import Attitude
from steelyard.excite.planned.plans_from_tables import TASKS
from tooled import DOWN, Arm, arm, boxes, carried, invented_arm, plan, square, waypoints


def grid(motion: ProcessMotion, count: int = 8000) -> Array:
    return np.linspace(0.0, motion.trajectory.duration, count)


def check_keeps(motion: ProcessMotion, limits: MotionLimits) -> None:
    """Exact extremes and a dense grid keep the limits, and some limit is met."""
    low, high = motion.trajectory.extremes(0)
    assert np.all(low >= limits.lower) and np.all(high <= limits.upper)
    bounds = [limits.velocity, limits.acceleration]
    bounds += [] if limits.jerk is None else [limits.jerk]
    t = grid(motion)
    for order, bound in enumerate(bounds, start=1):
        low, high = motion.trajectory.extremes(order)
        largest = np.maximum(-low, high)
        assert np.all(largest <= bound * (1.0 + 1e-9))
        seen = np.abs(motion.trajectory.derivative(t, order)).max(axis=0)
        assert np.all(seen <= largest * (1.0 + 1e-9) + 1e-12)


def check_rests(motion: ProcessMotion) -> None:
    """From rest to rest, back where it began, without jumps of position, speed, acceleration."""
    trajectory = motion.trajectory
    ends = trajectory.sample([0.0, trajectory.duration])
    np.testing.assert_allclose(ends.q[1], ends.q[0], atol=1e-9)
    for order in (0, 1, 2):
        after = trajectory.derivative(trajectory.breaks[1:-1], order)
        before = trajectory.derivative(trajectory.breaks[1:-1] - 1e-9, order)
        np.testing.assert_allclose(before, after, atol=2e-6)
    for t in motion.arrivals:
        np.testing.assert_allclose(trajectory.derivative([t], 1), 0.0, atol=1e-7)
        np.testing.assert_allclose(trajectory.derivative([t], 2), 0.0, atol=1e-5)


def off_segments(motion: ProcessMotion, tooled: Arm, count: int = 60) -> float:
    """Greatest distance of the tool from the segments between its places, by Pinocchio."""
    worst = 0.0
    spans = zip(motion.arrivals[:-1], motion.arrivals[1:], strict=True)
    for (start, end), a, b in zip(spans, motion.places[:-1], motion.places[1:], strict=True):
        at = tooled.places(motion.trajectory.sample(np.linspace(start, end, count)).q)
        way = b - a
        share = np.clip((at - a) @ way / (way @ way), 0.0, 1.0)
        worst = max(worst, np.linalg.norm(at - a - share[:, None] * way, axis=1).max())
    return worst


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ur10", "panda"])
@pytest.mark.parametrize("attitude", [Attitude(), DOWN])
def test_picks_and_places_on_straight_lines(name: str, attitude: Attitude) -> None:
    tooled, (pick, place) = arm(name), boxes(name)
    task = carried(pick, place, cycles=2, lift=0.1, dwell=0.05)
    motion = plan(name, task, ToolGuidance(attitude=attitude), seed=1)
    check_keeps(motion, tooled.limits)
    check_rests(motion)
    seen = off_segments(motion, tooled)
    assert seen <= motion.deviation <= STRAIGHTNESS
    q = motion.trajectory.sample(grid(motion, 300)).q
    turned = np.array([tooled.pose(x)[1] for x in q])
    assert np.linalg.norm(attitude.turns(turned), axis=1).max(initial=0.0) <= 1e-4
    assert motion.cycles == 2 and len(motion.moves) == 12
    places = tooled.places(motion.postures)
    np.testing.assert_allclose(places, motion.places, atol=1e-7)


@pytest.mark.parametrize("path", ["line", "joint"])
def test_points_lie_in_their_boxes_and_are_lifted(path: str) -> None:
    pick, place = boxes("ur10")
    task = carried(pick, place, cycles=4, lift=0.15, dwell=0.2)
    motion = plan("ur10", task, ToolGuidance(path), seed=5)
    at = arm("ur10").places(motion.trajectory.sample(motion.arrivals).q)
    np.testing.assert_allclose(at, motion.places, atol=1e-6)
    for box, first in ((pick, 1), (place, 4)):
        inside = at[first:-1:6]
        assert len(inside) == 4
        low, high = np.array([box.x, box.y, box.z]).T
        assert np.all((inside >= low - 1e-6) & (inside <= high + 1e-6))
        assert np.ptp(inside[:, :2], axis=0).min() > 0.02
        for lifted in (at[first - 1 : -1 : 6], at[first + 1 :: 6][:4]):
            np.testing.assert_allclose(
                lifted - inside, np.tile([0.0, 0.0, 0.15], (4, 1)), atol=1e-6
            )
    for k in range(1, 24, 6):
        still = motion.trajectory.sample(motion.arrivals[k] + np.linspace(0.001, 0.199, 5))
        np.testing.assert_allclose(still.dq, 0.0, atol=1e-12)
    check_rests(motion)
    check_keeps(motion, arm("ur10").limits)


@pytest.mark.slow
def test_seeds_decide_the_points() -> None:
    task = carried(*boxes("ur10"), cycles=2)
    one, again, other = (plan("ur10", task, seed=seed) for seed in (3, 3, 4))
    assert one.trajectory.to_dict() == again.trajectory.to_dict()
    assert np.abs(one.places - other.places).max() > 0.01


def test_joint_moves_are_straight_in_joint_space_and_as_fast_as_limits_allow() -> None:
    tooled = arm("panda")
    motion = plan("panda", square((0.5, 0.0, 0.3), 0.2), ToolGuidance("joint"))
    t = motion.trajectory.breaks
    assert len(t) == 5
    for k in range(4):
        a, b = motion.postures[k], motion.postures[k + 1]
        q = motion.trajectory.sample(t[k] + np.linspace(0.0, 1.0, 11) * (t[k + 1] - t[k])).q
        tau = np.linspace(0.0, 1.0, 11)[:, None]
        s = 10.0 * tau**3 - 15.0 * tau**4 + 6.0 * tau**5
        np.testing.assert_allclose(q, a + s * (b - a), atol=1e-9)
        speed = np.max(1.875 * np.abs(b - a) / tooled.limits.velocity)
        bend = np.sqrt(np.max(10.0 / np.sqrt(3.0) * np.abs(b - a) / tooled.limits.acceleration))
        assert t[k + 1] - t[k] == pytest.approx(max(speed, bend), rel=1e-6)
        assert motion.moves[k].limit.startswith("velocity" if speed > bend else "acceleration")


def test_traces_the_edges_of_a_horizontal_square() -> None:
    tooled = arm("ur10")
    task = square((0.7, 0.1, 0.4), 0.3, laps=2)
    motion = plan("ur10", task)
    at = tooled.places(motion.trajectory.sample(motion.arrivals).q)
    np.testing.assert_allclose(at[:4], at[4:8], atol=1e-7)
    np.testing.assert_allclose(
        at.mean(axis=0) - at[0] / 9 - (8 / 9) * np.array(task.centre), 0, atol=1e-7
    )
    edges = np.diff(at, axis=0)
    np.testing.assert_allclose(np.linalg.norm(edges, axis=1), 0.3, atol=1e-7)
    np.testing.assert_allclose(edges[:, 2], 0.0, atol=1e-7)
    np.testing.assert_allclose(np.sum(edges[1:] * edges[:-1], axis=1), 0.0, atol=1e-7)
    heading = np.arctan2(edges[:, 1], edges[:, 0])
    assert np.min(np.abs(np.exp(1j * heading) - 1.0)) < 1e-6
    assert off_segments(motion, tooled) <= motion.deviation <= 1e-4
    check_keeps(motion, tooled.limits)
    check_rests(motion)
    assert "2 cycles, 8 moves" in motion.summary and "mm" in motion.summary


def test_horizontal_is_across_gravity() -> None:
    robot = tree()
    up = up_of(robot)
    np.testing.assert_allclose(up, -np.array(robot.gravity) / np.linalg.norm(robot.gravity))
    corners = TASKS["square"](square((0.1, 0.2, 0.3), 0.4), robot, 0).places
    np.testing.assert_allclose((corners - corners[0]) @ up, 0.0, atol=1e-12)
    np.testing.assert_allclose(corners.mean(axis=0), [0.1, 0.2, 0.3])
    np.testing.assert_array_equal(up_of(robot.changed(gravity=np.zeros(3))), [0.0, 0.0, 1.0])


@pytest.mark.slow
@pytest.mark.parametrize("path", ["line", "joint"])
def test_the_tool_keeps_its_own_limits(path: str) -> None:
    tooled, task = arm("ur10"), square((0.7, 0.0, 0.4), 0.4)
    motion = plan("ur10", task, ToolGuidance(path, speed=0.8, acceleration=0.4))
    t = np.linspace(0.0, motion.trajectory.duration, 6_001)
    at = tooled.places(motion.trajectory.sample(t).q)
    speed = np.linalg.norm(np.gradient(at, t, axis=0), axis=1).max()
    bend = np.linalg.norm(np.diff(at, 2, axis=0), axis=1).max() / (t[1] - t[0]) ** 2
    assert speed <= 0.8 and bend <= 0.4 * (1.0 + 1e-6)
    assert {move.limit for move in motion.moves} == {"acceleration of the tool"}
    assert bend > 0.97 * 0.4
    slow = plan("ur10", task, ToolGuidance(path, speed=0.1))
    assert {move.limit for move in slow.moves} == {"speed of the tool"}
    if path == "line":
        least = 1.875 * 0.4 / 0.1
        assert all(least <= p.duration <= 1.012 * least for p in slow.moves)


def test_jerks_slow_a_motion_down() -> None:
    limits = replace(arm("panda").limits, jerk=np.full(7, 20.0))
    gentle = plan("panda", square((0.5, 0.0, 0.3), 0.2), limits=limits)
    check_keeps(gentle, limits)
    assert any(move.limit.startswith("jerk of 'panda_joint") for move in gentle.moves)


@pytest.mark.parametrize(
    "tooled",
    [
        invented_arm(dh_arm(), dh_arm().bodies[-1].name),
        invented_arm(tree(), "tip"),
        invented_arm(single(), "rod"),
    ],
)
def test_waypoints_of_invented_arms(tooled: Arm) -> None:
    rng = np.random.default_rng(2)
    middle = 0.5 * (tooled.limits.lower + tooled.limits.upper)
    half = 0.5 * (tooled.limits.upper - tooled.limits.lower)
    q = middle + 0.4 * rng.uniform(-1.0, 1.0, (3, tooled.robot.n)) * half
    places = tooled.places(q)
    if np.ptp(places, axis=0).max() < 1e-6:
        with pytest.raises(DataError, match="positions of the task coincide"):
            plan(tooled, waypoints(places))
        return
    motion = plan(tooled, waypoints(places, 0.1), ToolGuidance("joint"))
    at = tooled.places(motion.trajectory.sample(motion.arrivals).q)
    np.testing.assert_allclose(at, np.vstack([places, places[:1]]), atol=1e-7)
    check_keeps(motion, tooled.limits)
    check_rests(motion)
