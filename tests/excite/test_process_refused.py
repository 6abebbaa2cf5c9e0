import numpy as np
import pytest

from steelyard.base.errors import DataError
from steelyard.excite.planned.plans import Box, PickAndPlace, Square, Waypoints
from steelyard.excite.planned.postures import UnfollowableWay
from steelyard.excite.planned.route import ToolGuidance, ToolLimits
from tooled import DOWN, arm, boxes, plan


@pytest.mark.slow
def test_a_box_out_of_reach_names_the_least_move_that_works() -> None:
    pick, place = boxes("ur10")
    far = Box((1.5, 0.3, 0.2), place.size)
    with pytest.raises(DataError, match="the place box is out of reach") as error:
        plan("ur10", PickAndPlace(pick, far, cycles=1))
    assert "frame 'tool0' of robot 'ur10'" in error.value.where
    shift = np.array([float(x) for x in error.value.fix.split("(")[1].split(")")[0].split(",")])
    advised = float(error.value.fix.split(" m, ")[1].split(" m")[0])
    assert advised == pytest.approx(np.linalg.norm(shift), abs=1e-3) and 0.1 < advised < 0.4
    moved = Box(tuple(far.centre + shift), far.size)
    joint = ToolGuidance(path="joint")
    assert plan("ur10", PickAndPlace(pick, moved, cycles=1, manner=joint)).cycles == 1
    less = Box(tuple(far.centre + 0.97 * shift), far.size)
    with pytest.raises(DataError, match="out of reach"):
        plan("ur10", PickAndPlace(pick, less, cycles=1, manner=joint))


def test_a_waypoint_out_of_reach_is_named() -> None:
    with pytest.raises(DataError, match=r"waypoint 2 is out of reach: of \(1.600, 0.300") as error:
        plan("ur10", Waypoints([[0.6, 0.2, 0.4], [1.6, 0.3, 0.4]]))
    assert "the nearest reachable position is (1.30" in error.value.wrong
    assert "0.307 m" in error.value.fix
    with pytest.raises(DataError, match="the square is out of reach") as error:
        plan("panda", Square((0.9, 0.0, 0.3), 0.2))
    assert "move the square by (-0." in error.value.fix


def test_lines_through_what_no_posture_can_do_are_refused() -> None:
    """Straight through the base, and from one elbow side to the other."""
    with pytest.raises(UnfollowableWay) as error:
        plan(
            "ur10",
            Waypoints([[0.6, 0.1, 0.3], [-0.6, 0.1, 0.3]], manner=ToolGuidance(attitude=DOWN)),
        )
    assert "from waypoint 1 to waypoint 2" in error.value.where
    assert "path = 'joint'" in error.value.fix
    assert "%" in error.value.wrong
    joint = ToolGuidance(path="joint", attitude=DOWN)
    motion = plan("ur10", Waypoints([[0.6, 0.1, 0.3], [-0.6, 0.1, 0.3]], manner=joint))
    there = motion.trajectory.sample(motion.arrivals[1:2]).q
    np.testing.assert_allclose(arm("ur10").places(there), [[-0.6, 0.1, 0.3]], atol=1e-7)


def test_bad_input_is_refused_with_words() -> None:
    tooled, box = arm("ur10"), Box((0.7, 0.0, 0.3), (0.1, 0.1, 0.1))
    start = np.array([0.0, 7.0, 0.0, 0.0, 0.0, 0.0])
    spot = Box((0.7, 0.0, 0.3), (0.0, 0.0, 0.0))
    with pytest.raises(DataError, match="all positions of the task coincide"):
        plan("ur10", PickAndPlace(spot, spot, lift=0.0))
    square = Square((0.7, 0.0, 0.4), 0.2)
    with pytest.raises(
        DataError, match="outside the range of joint 'shoulder_lift_joint' by 0.717"
    ):
        square.plan(tooled.robot, tooled.limits, tooled.frame, start=start)
    with pytest.raises(DataError, match="has 3 values") as error:
        square.plan(tooled.robot, tooled.limits, tooled.frame, start=start[:3])
    assert "each of its 6 joints" in error.value.fix
    for wrong in (
        lambda: Box((0.0, 0.0, 0.0), (0.1, -0.1, 0.1)),
        lambda: PickAndPlace(box, box, cycles=0),
        lambda: PickAndPlace(box, box, lift=-0.1),
        lambda: Square((0.0, 0.0, 0.0), 0.0),
        lambda: Waypoints([[0.0, 0.0, 0.0]]),
        lambda: Waypoints([[0.0, 0.0], [1.0, 1.0]]),
        lambda: ToolGuidance(share=0.0),
        lambda: ToolGuidance(dwell=-1.0),
        lambda: ToolGuidance(path="curve"),  # type: ignore[arg-type]
        lambda: ToolLimits(speed=0.0),
    ):
        with pytest.raises(DataError) as error:
            wrong()
        assert error.value.fix
