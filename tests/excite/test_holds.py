"""How long motions stand still."""

import numpy as np
import pytest

from steelyard.excite.constraints.certificate import holds, holds_note
from steelyard.excite.trajectories.exact_trajectories import SlowedMotion, through_postures

POSTURES = [[0.0, 1.0], [1.0, -1.0], [0.5, 0.0]]


def test_holds_are_found_with_their_lengths() -> None:
    motion = through_postures(POSTURES, [1.0, 2.0], 0.5)
    np.testing.assert_allclose(holds(motion), [0.5, 0.5])
    assert holds_note(motion) == (
        "all joints are at standstill 2 times: 0.5 s each time, 1 s in all",
    )


def test_a_slowed_motion_holds_longer() -> None:
    slow = SlowedMotion(through_postures(POSTURES, [1.0, 2.0], 0.5), 0.5)
    np.testing.assert_allclose(holds(slow), [1.0, 1.0])


def test_holds_that_follow_each_other_are_one() -> None:
    motion = through_postures([[0.0], [1.0], [1.0], [3.0]], [1.0, 2.0, 1.0], 0.25)
    np.testing.assert_allclose(holds(motion), [0.25 + 2.0 + 0.25, 0.25])
    assert "0.25 to 2.5 s each time" in holds_note(motion)[0]


def test_nothing_is_reported_of_a_motion_that_never_stands() -> None:
    assert holds_note(through_postures(POSTURES, 1.0)) == ()


@pytest.mark.parametrize("joint", [0, 1])
def test_a_joint_that_rests_alone_is_no_hold(joint: int) -> None:
    ends = np.zeros((2, 2))
    ends[1, joint] = 1.0
    assert len(holds(through_postures(ends, 1.0))) == 0
