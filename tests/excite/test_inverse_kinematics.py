from dataclasses import replace

import numpy as np
import pytest

from invented import dh_arm, tree
from steelyard.base.errors import ModelError
from steelyard.excite.planned.inverse_kinematics import (
    Attitude,
    InverseKinematics,
    within,
)
from steelyard.excite.planned.tool_paths_lines_and_reach import least_shift
from steelyard.model.equations.frame_and_point_kinematics import (
    frame_kinematics,
    frame_of,
    last_frame,
)
from steelyard.robot.file.sections import DHRow
from steelyard.robot.models.denavit_hartenberg import dh_mechanism
from steelyard.robot.robot_from_mechanism import reduced
from tooled import Arm, arm, invented_arm


def solver_of(tooled: Arm, attitude: Attitude) -> InverseKinematics:
    frame = frame_of(tooled.robot, tooled.frame)
    return InverseKinematics.of(tooled.robot, frame, tooled.limits, attitude)


def random_places(tooled: Arm, count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    middle = 0.5 * (tooled.limits.lower + tooled.limits.upper)
    half = np.minimum(0.4 * (tooled.limits.upper - tooled.limits.lower), 1.5)
    q = middle + rng.uniform(-1.0, 1.0, (count, tooled.robot.n)) * half
    poses = [tooled.pose(x) for x in q]
    return np.array([p for p, _ in poses]), np.array([r for _, r in poses])


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ur10", "panda"])
def test_postures_bring_the_tool_to_the_place_in_the_attitude(name: str) -> None:
    tooled = arm(name)
    places, rotations = random_places(tooled, 12)
    start = 0.5 * (tooled.limits.lower + tooled.limits.upper)
    for place, rotation in zip(places, rotations, strict=True):
        for attitude in (Attitude(), Attitude(rotation[:, 2])):
            found = solver_of(tooled, attitude).reach(place, start, seed=1, restarts=40)
            assert found.reached.all()
            for q in found.q[:3]:
                at, turned = tooled.pose(q)
                np.testing.assert_allclose(at, place, atol=1e-7)
                if attitude.rows:
                    np.testing.assert_allclose(turned[:, 2], rotation[:, 2], atol=1e-7)
                assert np.all((q >= tooled.limits.lower) & (q <= tooled.limits.upper))


@pytest.mark.parametrize(
    "tooled", [invented_arm(dh_arm(), dh_arm().bodies[-1].name), invented_arm(tree(), "tip")]
)
def test_invented_arms_reach_where_they_can_be(tooled: Arm) -> None:
    places, _ = random_places(tooled, 10)
    solver = solver_of(tooled, Attitude())
    for place in places:
        found = solver.reach(place, np.zeros(tooled.robot.n), seed=0)
        assert found.reached[0]
        np.testing.assert_allclose(tooled.pose(found.q[0])[0], place, atol=1e-7)


def test_the_nearest_posture_comes_first_and_seeds_decide_all() -> None:
    tooled = arm("ur10")
    solver = solver_of(tooled, Attitude([0.0, 0.6, -0.8]))
    start = np.array([0.1, -1.2, 1.5, 0.2, 1.0, 0.0])
    place = np.array([0.6, 0.2, 0.5])
    found, again = (solver.reach(place, start, seed=3) for _ in range(2))
    np.testing.assert_array_equal(found.q, again.q)
    far = np.linalg.norm(found.q - start, axis=1)
    assert len(far) > 2 and np.all(np.diff(far) >= 0.0) and far[-1] > far[0] + 0.5
    other = solver.reach(place, start, seed=4)
    assert other.q.shape != found.q.shape or np.abs(other.q - found.q).max() > 1e-3


def test_an_attitude_asks_for_no_more_than_it_says() -> None:
    axis = np.array([1.0, 2.0, 2.0]) / 3.0
    pointing = Attitude(axis)
    tool = np.stack([np.cross(axis, [0.0, 0.6, -0.8]), [0.0, 0.0, 0.0], axis], axis=1)
    tool[:, 0] /= np.linalg.norm(tool[:, 0])
    tool[:, 1] = np.cross(axis, tool[:, 0])
    np.testing.assert_allclose(pointing.turns(tool[None]), 0.0, atol=1e-12)
    flipped = tool @ np.diag([1.0, -1.0, -1.0])
    assert np.linalg.norm(pointing.turns(flipped[None])) == pytest.approx(np.pi)
    with pytest.raises(ValueError, match="no direction"):
        Attitude([0.0, 0.0, 0.0])


def test_turns_are_those_still_to_make() -> None:
    pointing = Attitude([np.sin(0.3), 0.0, np.cos(0.3)])
    assert np.linalg.norm(pointing.turns(np.eye(3)[None])) == pytest.approx(0.3)
    rates = np.zeros((1, 3, 1))
    rates[0, :, 0] = [0.0, 1.0, 0.0]
    before, after = (
        pointing.turns(
            np.array([[[np.cos(x), 0, np.sin(x)], [0, 1, 0], [-np.sin(x), 0, np.cos(x)]]])
        )
        for x in (0.3 - 1e-6, 0.3 + 1e-6)
    )
    made = -(after - before) / 2e-6
    np.testing.assert_allclose(pointing.slopes(rates)[0, :, 0], made[0], atol=1e-6)


def test_the_least_shift_is_that_of_geometry() -> None:
    """A planar arm of two links of 1 m and 0.5 m reaches a ring, and nothing else.

    Its elbow bends by 3 rad at most, so the hole is that of the law of cosines.
    """
    rows = [DHRow(a=a) for a in (0.0, 1.0, 0.5)]
    robot = reduced(dh_mechanism(rows, "modified", "planar"))[0]
    frame = robot.bodies[-1].name
    lower, upper = np.full(3, -3.0), np.full(3, 3.0)
    solver = InverseKinematics(frame_kinematics(robot, frame), lower, upper, Attitude())
    outside = np.array([[1.2, 1.6, 0.0]])
    shift = least_shift(solver, outside, np.zeros(3), 0)
    assert shift is not None
    assert np.linalg.norm(shift) == pytest.approx(0.5, abs=2e-3)
    np.testing.assert_allclose(shift, [-0.3, -0.4, 0.0], atol=2e-3)
    inside = np.array([[0.3, 0.0, 0.0]])
    shift = least_shift(solver, inside, np.zeros(3), 0)
    assert shift is not None
    hole = np.sqrt(1.25 + np.cos(3.0))
    assert np.linalg.norm(shift) == pytest.approx(hole - 0.3, abs=2e-3)
    both = np.array([[1.6, 0.0, 0.0], [1.2, 0.0, 0.0]])
    shift = least_shift(solver, both, np.zeros(3), 0)
    assert shift is not None
    np.testing.assert_allclose(shift, [-0.1, 0.0, 0.0], atol=2e-3)
    np.testing.assert_allclose(least_shift(solver, both - [0.2, 0, 0], np.zeros(3), 0), 0.0)


def test_narrower_ranges() -> None:
    limits = arm("panda").limits
    narrow = within(limits, 0.01)
    np.testing.assert_allclose(narrow.lower, limits.lower + 0.01)
    np.testing.assert_allclose(narrow.upper, limits.upper - 0.01)
    np.testing.assert_allclose(within(limits, 9.0).lower, limits.lower * 0.99 + limits.upper * 0.01)


def test_frames_that_cannot_be_led_are_refused() -> None:
    tooled = arm("ur10")
    with pytest.raises(ModelError, match="'base_link' is fixed to the base") as error:
        solver_of(replace(tooled, frame="base_link"), Attitude())
    assert f"such as '{last_frame(tooled.robot)}'" in error.value.fix
