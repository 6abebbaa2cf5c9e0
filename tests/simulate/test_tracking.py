"""Tracking errors with a true, a wrong and no model."""

import numpy as np
import pytest

from steelyard.base.errors import ModelError
from steelyard.excite.trajectories.exact_trajectories import SampledMotion
from steelyard.excite.trajectories.fourier import random_fourier
from steelyard.model.equations.frame_and_point_kinematics import (
    frame_kinematics,
    frame_of,
    last_frame,
)
from steelyard.robot.robot import Robot
from steelyard.simulate.drives_sensors_and_loads import customary_drives
from steelyard.simulate.ground_truth import Truth, random_truth
from steelyard.simulate.track import Tracking, controllers_of, tracking
from steelyard.uses.control.joint_controllers import control_of


def run(robot: Robot, truth: Truth, control: str, *models: tuple[str, Truth]) -> Tracking:
    """Of a random motion; models are those of truths."""
    valued = [(name, model.model.at(model.values)) for name, model in models]
    motion = random_fourier(robot, seed=3, period=1.0)
    frame = frame_of(robot, last_frame(robot))
    named = controllers_of(control, valued)
    return tracking(robot, truth, motion, named, frame, customary_drives(robot))


@pytest.mark.slow
@pytest.mark.parametrize("control", ["pid", "cascade"])
def test_the_true_model_reduces_errors_and_a_drifted_one_less(leg: Robot, control: str) -> None:
    truth = random_truth(leg, 0)
    found = run(leg, truth, control, ("true", truth), ("worn", truth.drifted(0.5)))
    names = [control, f"{control} + feedforward, true", f"{control} + feedforward, worn"]
    assert [one.name for one in found.runs] == names
    exact, worn = (found.ratios(one) for one in found.runs[1:])
    assert exact.max() < 0.4 and worn.mean() > exact.mean()
    np.testing.assert_array_equal(found.ratios(found.reference), 1.0)
    bare = found.reference
    assert np.all(bare.largest >= bare.rms) and bare.tool_largest >= bare.tool_rms > 0.0


@pytest.mark.slow
def test_computed_torque_is_compared_with_pd_control_of_the_same_gains(leg: Robot) -> None:
    truth = random_truth(leg, 0)
    found = run(leg, truth, "computed_torque,kp=200,kv=20", ("m", truth))
    names = ["pd", "computed torque without friction", "computed torque"]
    assert [one.name for one in found.runs] == names
    bare, printed, full = (one.rms.mean() for one in found.runs)
    assert full < 0.1 * printed < 0.1 * bare
    only = controllers_of("computed_torque,friction=0", [("m", truth.model.at(truth.values))])
    assert list(only) == ["pd", "computed torque without friction"]


def test_the_tool_is_where_the_joints_put_it(leg: Robot) -> None:
    found = run(leg, random_truth(leg, 0), "cascade")
    motion = random_fourier(leg, seed=3, period=1.0)
    q = motion.sample(np.clip(found.t, 0.0, 1.0)).q
    place, _ = frame_kinematics(leg, last_frame(leg))(q)[:2]
    np.testing.assert_allclose(found.desired, place, atol=1e-12)
    place, _ = frame_kinematics(leg, last_frame(leg))(q - found.runs[0].error)[:2]
    np.testing.assert_allclose(found.runs[0].tool, place, atol=1e-12)
    apart = np.linalg.norm(place - found.desired, axis=1)
    np.testing.assert_allclose(found.runs[0].deviation, apart, atol=1e-12)
    assert found.t[0] == pytest.approx(0.0) and found.t[-1] == pytest.approx(1.2)


@pytest.mark.slow
def test_a_tool_behind_passive_joints_is_followed(four_bar: Robot) -> None:
    truth = random_truth(four_bar, 0).drifted(0.0)
    motion = SampledMotion([0.0, 0.5, 1.0], [[1.2], [0.9], [1.2]])
    frame = frame_of(four_bar, "coupler")
    valued = truth.model.at(truth.values)
    controllers = controllers_of("computed_torque", [("m", valued)])
    found = tracking(four_bar, truth, motion, controllers, frame, customary_drives(four_bar))
    crank = motion.sample(np.clip(found.t, 0.0, 1.0)).q[:, 0]
    pin = 0.4 * np.column_stack([np.cos(crank), np.sin(crank), 0.0 * crank])
    np.testing.assert_allclose(found.desired, pin, atol=1e-9)
    assert found.runs[-1].tool_rms < 0.3 * found.reference.tool_rms


def test_a_law_that_needs_a_model_is_refused_without_one() -> None:
    with pytest.raises(ModelError, match="none is given"):
        controllers_of("computed_torque", [])
    assert list(controllers_of("pid", [])) == ["pid"]
    assert control_of("pid") == controllers_of("pid", [])["pid"]
