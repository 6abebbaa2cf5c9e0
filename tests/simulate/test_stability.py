"""How fine the plant's steps are."""

from collections.abc import Callable

import numpy as np
import pytest

from steelyard.base.errors import ModelError
from steelyard.model.laws.friction_over_speed import Viscous
from steelyard.model.laws.friction_with_memory import Dahl, LuGre
from steelyard.model.laws.laws_without_friction import Spring
from steelyard.robot.robot import Robot
from steelyard.simulate.virtual_robot import MujocoPlant


def step_of(robot: Robot, truth: object) -> float:
    return MujocoPlant(robot, truth).timestep  # type: ignore[arg-type]


def test_memory_is_integrated_at_ten_kilohertz_or_finer(
    pendulum: Robot, make_truth: Callable
) -> None:
    inertia, friction = 0.251, 2.0
    for length, wanted in ((3e-4, 1e-4), (2e-6, 1e-4), (1e-7, 2.5e-5)):
        truth = make_truth(pendulum, Dahl(length=length), **{"dahl.pivot": friction})
        step = step_of(pendulum, truth)
        assert step == pytest.approx(wanted)
        # at a reversal the state changes by 2 per length
        assert step * np.sqrt(2.0 * friction / length / inertia) <= 0.5


def test_dampings_and_springs_count_too(pendulum: Robot, make_truth: Callable) -> None:
    damped = make_truth(pendulum, Viscous(), **{"viscous.pivot": 3000.0})
    assert step_of(pendulum, damped) == pytest.approx(6.25e-5)
    sprung = make_truth(pendulum, Spring(), **{"spring.pivot": 1e7})
    assert step_of(pendulum, sprung) == pytest.approx(6.25e-5)
    bristles = make_truth(pendulum, LuGre(), **{"lugre.pivot": 1.0, "lugre_damping.pivot": 1.0})
    assert step_of(pendulum, bristles) < 1e-4


def test_absurdly_fine_steps_are_refused(pendulum: Robot, make_truth: Callable) -> None:
    truth = make_truth(pendulum, Dahl(length=1e-9), **{"dahl.pivot": 50.0})
    with pytest.raises(ModelError, match="too stiff to be simulated: it needs steps below") as e:
        MujocoPlant(pendulum, truth)
    assert "presliding lengths" in e.value.fix


def test_a_stiff_contact_stays_stable(pendulum: Robot, make_truth: Callable) -> None:
    truth = make_truth(pendulum, Dahl(length=1e-5), **{"dahl.pivot": 4.0})
    plant = MujocoPlant(pendulum, truth)
    plant.place([0.5])
    speeds = [abs(plant.step(np.zeros(1), 1e-3)[1][0]) for _ in range(2000)]
    assert max(speeds) < 0.02
