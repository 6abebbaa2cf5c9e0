"""A payload taken and let go."""

from dataclasses import replace

import numpy as np
import pytest

from steelyard.base.errors import ModelError
from steelyard.estimate.closed_loop.feedback_and_forward_dynamics import JointPD
from steelyard.excite.trajectories.fourier import random_fourier
from steelyard.robot.inertia_and_placement import Inertia
from steelyard.robot.robot import Robot
from steelyard.simulate.drives_sensors_and_loads import Payload
from steelyard.simulate.ground_truth import Truth, random_truth
from steelyard.simulate.virtual_robot import MujocoPlant, VirtualRobot

LOAD = Inertia.about_com(2.0, [0.02, -0.01, 0.08], np.diag([0.01, 0.012, 0.006]))


def combined(robot: Robot, truth: Truth) -> Truth:
    """The truth with the load welded to the tool, by the sum of two bodies."""
    tool = next(f for f in robot.frames if f.name == "tool")
    own = Inertia.from_ten(truth.inertial[tool.body])
    both = own + LOAD.moved(tool.rotation, tool.position)
    names = [n for n in truth.values.names if n.endswith(f".{robot.bodies[tool.body].name}")]
    return truth.changed(**dict(zip(names[:10], both.ten.tolist(), strict=True)))


def test_a_carried_payload_is_a_heavier_body(arm: Robot) -> None:
    truth = random_truth(arm, 1)
    loaded = MujocoPlant(arm, truth, Payload(LOAD, "tool"))
    welded = MujocoPlant(arm, combined(arm, truth))
    loaded.loaded = True
    control = JointPD(np.full(6, 40.0), np.full(6, 4.0))
    states = []
    for plant in (loaded, welded):
        plant.place(np.linspace(0.5, -0.5, 6))
        for _ in range(400):
            q, dq = plant.step(control.torque(-plant.state()[0], -plant.state()[1]), 1e-3)
        states.append(np.concatenate((q, dq)))
    np.testing.assert_allclose(states[0], states[1], atol=1e-9)
    bare = MujocoPlant(arm, truth)
    bare.place(np.linspace(0.5, -0.5, 6))
    for _ in range(400):
        q, _ = bare.step(control.torque(-bare.state()[0], -bare.state()[1]), 1e-3)
    assert np.abs(q - states[0][:6]).max() > 0.01


@pytest.mark.slow
def test_it_is_taken_and_let_go_in_mid_run(arm: Robot) -> None:
    truth = random_truth(arm, 1)
    motion = random_fourier(arm, seed=2, period=3.0)
    runs = {
        name: VirtualRobot(arm, model, rest=0.5, payload=load).follow(motion)
        for name, model, load in (
            ("bare", truth, None),
            ("middle", truth, Payload(LOAD, "tool", attach=1.2, release=2.0)),
            ("welded", combined(arm, truth), None),
            ("always", truth, Payload(LOAD, "tool")),
        )
    }
    bare, middle, always = (runs[n].tau for n in ("bare", "middle", "always"))
    # up to the tick at which it is taken nothing differs; the gains are those of the bare robot
    np.testing.assert_array_equal(middle[:1201], bare[:1201])
    during, after = slice(1850, 2000), slice(3700, 4000)
    apart = np.abs(always - bare)[during].max()
    assert apart > 3.0 and np.abs(middle[1202] - bare[1202]).max() > 0.0
    assert np.abs(middle - always)[during].max() < 0.02 * apart
    assert np.abs(middle - bare)[after].max() < 0.02 * apart
    assert np.abs(always - bare)[after].max() > 0.5


def test_a_body_counts_as_a_frame(arm: Robot) -> None:
    flange = next(k for k, b in enumerate(arm.bodies) if b.name == "flange")
    loaded = Payload(LOAD, "flange").added(arm, arm.nominal)
    np.testing.assert_allclose(loaded[flange] - arm.nominal[flange], LOAD.ten)
    np.testing.assert_array_equal(np.delete(loaded, flange, 0), np.delete(arm.nominal, flange, 0))


def test_a_ball_of_steel() -> None:
    ball = Payload.ball(2.0, "tool").inertia
    radius = np.sqrt(ball.inertia_com[0, 0] / (0.4 * 2.0))
    assert 2.0 / (4.0 / 3.0 * np.pi * radius**3) == pytest.approx(7800.0)


def test_impossible_payloads_are_refused(arm: Robot) -> None:
    with pytest.raises(
        ModelError, match="the payload is not physically consistent: the mass is negative"
    ):
        Payload(Inertia.about_com(-1.0, np.zeros(3), np.eye(3)), "tool")
    with pytest.raises(ModelError, match="attached at 3 s, released at 2 s"):
        Payload(LOAD, "tool", 3.0, 2.0)
    for frame, wrong in (("tol", "there is no frame 'tol'"), ("base", "is fixed to the base")):
        with pytest.raises(ModelError, match=wrong) as caught:
            MujocoPlant(arm, random_truth(arm, 0), Payload(LOAD, frame))
        assert "tool" in caught.value.fix and "base" not in caught.value.fix


def test_times_are_those_of_the_log() -> None:
    load = replace(Payload(LOAD, "tool"), attach=0.5, release=1.0)
    assert load.carried(np.array([0.0, 0.5, 0.999, 1.0])).tolist() == [False, True, True, False]
