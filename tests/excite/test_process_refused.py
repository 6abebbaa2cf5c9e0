import numpy as np
import pytest
from pydantic import ValidationError

from steelyard.base.errors import DataError
from steelyard.excite.planned.fastest_moves_and_tours import ToolGuidance
from steelyard.excite.planned.tool_paths_lines_and_reach import UnfollowableWay
from tooled import DOWN, arm, box, carried, plan, square, waypoints

JOINT = ToolGuidance("joint")


@pytest.mark.slow
def test_a_box_out_of_reach_names_the_least_move_that_works() -> None:
    pick = box((0.8, -0.25, 0.25), (0.0, 0.0, 0.0))
    centre, size = np.array([1.5, 0.3, 0.2]), (0.1, 0.2, 0.0)
    with pytest.raises(DataError, match="the place box is out of reach") as error:
        plan("ur10", carried(pick, box(centre, size), cycles=1))
    assert "frame 'tool0' of robot 'ur10'" in error.value.where
    shift = np.array([float(x) for x in error.value.fix.split("(")[1].split(")")[0].split(",")])
    advised = float(error.value.fix.split(" m, ")[1].split(" m")[0])
    assert advised == pytest.approx(np.linalg.norm(shift), abs=1e-3) and 0.1 < advised < 0.4
    moved = carried(pick, box(centre + shift, size), cycles=1)
    assert plan("ur10", moved, JOINT).cycles == 1
    with pytest.raises(DataError, match="out of reach"):
        plan("ur10", carried(pick, box(centre + 0.97 * shift, size), cycles=1), JOINT)


@pytest.mark.slow
def test_a_waypoint_out_of_reach_is_named() -> None:
    with pytest.raises(DataError, match=r"waypoint 2 is out of reach: of \(1.600, 0.300") as error:
        plan("ur10", waypoints([[0.6, 0.2, 0.4], [1.6, 0.3, 0.4]]))
    assert "the nearest reachable position is (1.30" in error.value.wrong
    assert "0.307 m" in error.value.fix
    with pytest.raises(DataError, match="the square is out of reach") as error:
        plan("panda", square((0.9, 0.0, 0.3), 0.2))
    assert "move the square by (-0." in error.value.fix


@pytest.mark.slow
def test_lines_through_what_no_posture_can_do_are_refused() -> None:
    """Straight through the base, and from one elbow side to the other."""
    through = waypoints([[0.6, 0.1, 0.3], [-0.6, 0.1, 0.3]])
    with pytest.raises(UnfollowableWay) as error:
        plan("ur10", through, ToolGuidance(attitude=DOWN))
    assert "from waypoint 1 to waypoint 2" in error.value.where
    assert "path = 'joint'" in error.value.fix
    assert "%" in error.value.wrong
    motion = plan("ur10", through, ToolGuidance("joint", DOWN))
    there = motion.trajectory.sample(motion.arrivals[1:2]).q
    np.testing.assert_allclose(arm("ur10").places(there), [[-0.6, 0.1, 0.3]], atol=1e-7)


def test_tasks_that_go_nowhere_are_refused() -> None:
    spot = box((0.7, 0.0, 0.3), (0.0, 0.0, 0.0))
    for task in (carried(spot, spot, lift=0.0), waypoints(2 * [[0.7, 0.0, 0.3]])):
        with pytest.raises(DataError, match="all positions of the task coincide") as error:
            plan("ur10", task)
        assert error.value.fix
    turned = box((0.7, 0.0, 0.3), (0.1, -0.1, 0.1))
    with pytest.raises(DataError, match="the box 'pick' ends below its beginning"):
        plan("ur10", carried(turned, spot))
    for wrong in (
        lambda: carried(spot, spot, cycles=0),
        lambda: carried(spot, spot, lift=-0.1),
        lambda: carried(spot, spot, dwell=-1.0),
        lambda: carried(spot, spot, speed=0.0),
        lambda: square((0.0, 0.0, 0.0), 0.0),
        lambda: waypoints([[0.0, 0.0, 0.0]]),
        lambda: waypoints([[0.0, 0.0], [1.0, 1.0]]),
    ):
        with pytest.raises(ValidationError):
            wrong()
