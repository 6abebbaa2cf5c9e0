"""Every controller against its formula, and by its name."""

import numpy as np
import pytest

from steelyard.base.arrays import Parameters
from steelyard.base.errors import ModelError
from steelyard.base.motion import Motion
from steelyard.model.laws.friction_with_memory import Dahl
from steelyard.model.laws.laws_without_friction import RotorInertia
from steelyard.model.model import ValuedModel
from steelyard.model.torque_and_quantities import FRICTION
from steelyard.uses.control.feedforward import feedforward_torque
from steelyard.uses.control.joint_controllers import (
    CONTROLS,
    PD,
    PID,
    Cascade,
    ComputedTorque,
    Control,
    ControlTask,
    TorqueFeedforward,
    control_of,
)
from uses.conftest import TICK, valued_of


def made(kind: type[Control], valued: ValuedModel) -> Control:
    return kind(valued) if kind.needs_model else kind()  # type: ignore[call-arg]


@pytest.mark.parametrize("kind", CONTROLS, ids=lambda kind: kind.kind)
def test_every_controller_pushes_towards_the_motion_and_is_by_its_name(
    kind: type[Control], valued: ValuedModel, task: ControlTask
) -> None:
    control = made(kind, valued)
    found = control_of(kind.kind, valued if kind.needs_model else None)
    assert type(found) is kind
    there, behind = (control.start(task)(0, task.motion.q[0] - shift, task.motion.dq[0])
                     for shift in (0.0, 0.01))  # fmt: skip
    assert np.all(behind > there)
    if not kind.needs_model:
        np.testing.assert_array_equal(there, 0.0)


def test_pd_takes_given_gains_or_those_of_a_natural_frequency(task: ControlTask) -> None:
    q, dq = task.motion.q[5] - 0.1, task.motion.dq[5] + 0.2
    found = PD(100.0, 5.0).start(task)(5, q, dq)
    np.testing.assert_allclose(found, task.inertia * (100.0 * 0.1 - 5.0 * 0.2))
    # 60 rad/s is below 20 Hz: the coupling decides
    found = PD().start(task)(5, q, dq)
    np.testing.assert_allclose(found, task.inertia * (60.0**2 * 0.1 - 120.0 * 0.2))


def test_pid_integrates_up_to_the_limits(task: ControlTask) -> None:
    loop, alone = PID(100.0, 5.0, 400.0).start(task), PD(100.0, 5.0).start(task)
    for k in range(4):
        q, dq = task.motion.q[k] - 0.1, task.motion.dq[k]
        integral = loop(k, q, dq) - alone(k, q, dq)
        np.testing.assert_allclose(integral, task.inertia * 400.0 * 0.1 * TICK * (k + 1))
    for k in range(4, 200):
        q, dq = task.motion.q[k] - 0.1, task.motion.dq[k]
        integral = loop(k, q, dq) - alone(k, q, dq)
    np.testing.assert_allclose(integral, task.limits)


def test_cascade_is_a_position_loop_around_a_speed_loop(task: ControlTask) -> None:
    loop = Cascade(kv=20.0, ks=50.0, tn=0.02).start(task)
    for k in range(3):
        q, dq = task.motion.q[k] - 0.01, task.motion.dq[k] + 0.05
        error = 20.0 * 0.01 - 0.05
        expected = 50.0 * task.inertia * (error + (k + 1) * TICK * error / 0.02)
        np.testing.assert_allclose(loop(k, q, dq), expected)
    for k in range(3, 250):
        q, dq = task.motion.q[k] - 0.01, task.motion.dq[k] + 0.05
        found = loop(k, q, dq)
    np.testing.assert_allclose(found, 50.0 * task.inertia * error + task.limits)


def test_computed_torque_on_the_motion_is_the_torque_of_the_model(
    valued: ValuedModel, task: ControlTask
) -> None:
    motion = task.motion
    full, printed = (
        ComputedTorque(valued, 100.0, 5.0, friction=friction).start(task)
        for friction in (True, False)
    )
    for k in (3, 150):
        own = full(k, motion.q[k], motion.dq[k])
        np.testing.assert_allclose(own, valued.torque(motion)[k], rtol=1e-9)
        rest = own - printed(k, motion.q[k], motion.dq[k])
        np.testing.assert_allclose(
            rest, feedforward_torque(valued, motion, quantity=FRICTION)[k], rtol=1e-9
        )


def test_feedback_of_computed_torque_goes_through_the_mass_matrix(
    valued: ValuedModel, task: ControlTask
) -> None:
    q, dq = task.motion.q[7], task.motion.dq
    off = np.linspace(-0.01, 0.02, len(q))
    pushed = ComputedTorque(valued, 300.0, 5.0).start(task)(7, q - off, dq[7])
    pulled = ComputedTorque(valued, 100.0, 5.0).start(task)(7, q - off, dq[7])
    np.testing.assert_allclose(
        pushed - pulled, valued.mass_matrix(q - off) @ (200.0 * off), rtol=1e-8
    )


def test_feedforward_adds_the_models_torque_to_any_controller(
    valued: ValuedModel, task: ControlTask
) -> None:
    q, dq = task.motion.q[9] - 0.01, task.motion.dq[9]
    for inner in (PD(), PID(), Cascade()):
        ahead = TorqueFeedforward(inner, valued).start(task)(9, q, dq)
        alone = inner.start(task)(9, q, dq)
        np.testing.assert_allclose(ahead - alone, valued.torque(task.motion)[9], rtol=1e-9)
    assert isinstance(control_of("cascade", valued), TorqueFeedforward)


def test_late_values_are_compared_with_the_motion_as_late(task: ControlTask) -> None:
    shifted = Motion(
        task.motion.t, *(np.roll(x, 2, axis=0) for x in vars(task.motion).values() if x.ndim == 2)
    )
    late = ControlTask(task.motion, shifted, TICK, task.inertia, 60.0, task.limits)
    for control in (PD(), PID(), Cascade()):
        found = control.start(late)(5, task.motion.q[3], task.motion.dq[3])
        np.testing.assert_array_equal(found, 0.0)


def test_friction_with_memory_is_that_of_the_whole_desired_motion(task: ControlTask) -> None:
    valued = valued_of(RotorInertia(), Dahl(length=1e-3))
    loop = ComputedTorque(valued).start(task)
    expected = valued.torque(task.motion)
    for k in (0, 40, 41, 299):
        own = loop(k, task.motion.q[k], task.motion.dq[k])
        np.testing.assert_allclose(own, expected[k], rtol=1e-9)


def test_gains_in_options(valued: ValuedModel) -> None:
    assert control_of("pd,kp=400,kd=30") == PD(400.0, 30.0)
    assert control_of("cascade,kv=20,tn=0.05") == Cascade(kv=20.0, tn=0.05)
    law = control_of("computed_torque,kp=100,kv=5,friction=0", valued)
    assert isinstance(law, ComputedTorque) and (law.kp, law.kv, law.friction) == (100.0, 5.0, False)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("pdd", "no controller 'pdd'.*did you mean 'pd'"),
        ("cascade,kp=3", "controller 'cascade' has no gain 'kp'"),
        ("pd,kp", "'' is no value of 'kp'"),
        ("pd,kp=-3", "'-3' is no value of 'kp'"),
        ("pd,kp=nan", "'nan' is no value of 'kp'"),
        ("computed_torque", "computes with a model, and none is given"),
    ],
)
def test_unusable_controllers_are_refused(text: str, words: str) -> None:
    with pytest.raises(ModelError, match=r"(?s)" + words):
        control_of(text)


def test_friction_of_the_law_is_on_or_off(valued: ValuedModel) -> None:
    with pytest.raises(ModelError, match="friction=0 or friction=1"):
        control_of("computed_torque,friction=0.5", valued)


def test_an_indefinite_mass_matrix_is_refused_with_its_posture(
    valued: ValuedModel, task: ControlTask
) -> None:
    known = valued.values
    names = dict(known.as_dict())
    rotor = next(n for n in names if n.startswith("rotor_inertia."))
    units = dict(zip(valued.values.names, valued.values.units, strict=True))
    names[rotor] = -50.0
    wrong = valued.model.at(
        Parameters(list(names), [units[n] for n in names], list(names.values()))
    )
    joint = valued.model.robot.coordinates[0]
    with pytest.raises(ModelError, match="not positive definite at") as caught:
        ComputedTorque(wrong).start(task)
    assert f"{joint.name} " in caught.value.wrong and joint.unit in caught.value.wrong
    assert "s of the motion" in caught.value.where
    assert "torque feedforward" in caught.value.fix
