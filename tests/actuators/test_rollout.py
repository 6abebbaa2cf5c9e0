"""Rollouts under position controllers against MuJoCo, their derivatives against differences."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from proofs.support.servo_arm import URDF, Servos, moved, simulated, targets

from steelyard.actuators.actuator_model import arm_step
from steelyard.actuators.actuator_parameters import (
    KINDS,
    ActuatorValues,
    free_parameters,
)
from steelyard.actuators.actuator_parameters import (
    moved as moved_values,
)
from steelyard.actuators.closed_loop_step import ArmStep
from steelyard.actuators.rollout import rollouts
from steelyard.actuators.target_runs import TargetRun, windows_of
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.inertia_and_placement import Inertia


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> ArmStep:
    place: Path = tmp_path_factory.mktemp("servos") / "servos.urdf"
    place.write_text(URDF)
    return arm_step(load_robot(place).robot)


def values_of(servos: Servos) -> ActuatorValues:
    return ActuatorValues.of((1.0, 1.0), **vars(servos))


@pytest.mark.parametrize(
    "servos",
    [
        Servos(coulomb=(0.0, 0.0)),
        Servos(),
        Servos(torque_limit=(0.9, 0.3), coulomb=(0.0, 0.0)),
        Servos(armature=(1e-4, 1e-4), damping=(1.0, 0.8), delay=0.0),
        Servos(torque_limit=(0.9, 0.3), back_emf=(0.3, 0.2)),
        Servos(stribeck=(0.1, 0.05), stribeck_speed=(0.3, 0.2)),
        Servos(load_friction=(0.2, 0.1)),
        Servos(integral=(20.0, 15.0)),
    ],
    ids=[
        *("no friction", "friction", "torque limit", "light", "back-EMF", "Stribeck", "load"),
        "integral",
    ],
)
def test_a_rollout_is_that_of_mujoco(arm: ArmStep, servos: Servos) -> None:
    t, target = targets(6.0, seed=3)
    start = target[0] + 0.02
    run = TargetRun("log", t, target, np.tile(start, (len(t), 1)))
    (window,) = windows_of([run], None)

    def both(step: float) -> tuple[np.ndarray, np.ndarray]:
        (ours,) = rollouts(arm, values_of(servos), [window], (), step)
        return ours.q, moved(servos, t, target, step, start)

    # to steps of no length: both change by the first order of the step where a limit is reached
    (ours, theirs), (coarse, rough) = both(1e-4), both(2e-4)
    ours, theirs = 2.0 * ours - coarse, 2.0 * theirs - rough
    assert theirs.std(axis=0).min() > 0.1
    assert np.abs(ours - theirs).max() < 1e-3


def sagging(t: float) -> float:
    """A battery under load, over its nominal voltage."""
    return float(0.85 + 0.1 * np.cos(3.0 * t))


def test_stiffness_and_limits_follow_the_supply_as_in_mujoco(arm: ArmStep) -> None:
    servos = Servos(torque_limit=(0.9, 0.3))
    t, target = targets(6.0, seed=3)
    start = target[0] + 0.02
    fed = np.array([sagging(x) for x in t])
    run = TargetRun("log", t, target, np.tile(start, (len(t), 1)), fed)
    (ours,) = rollouts(arm, values_of(servos), windows_of([run], None), (), 2e-4)
    theirs, _ = simulated(servos, t, target, 2e-4, start, sagging)
    plain = moved(servos, t, target, 2e-4, start)
    assert np.abs(ours.q - theirs).max() < 3e-3
    assert np.abs(plain - theirs).max() > 0.03


def test_signs_and_zeros_of_the_log_do_not_change_the_motion(arm: ArmStep) -> None:
    t, target = targets(4.0, seed=3)
    values = values_of(Servos())
    run = TargetRun("log", t, target, target)
    (plain,) = rollouts(arm, values, windows_of([run], None))
    signs, zero = np.array([-1.0, 1.0]), np.array([0.3, -0.2])
    other = ActuatorValues.of(signs.tolist(), **{**values.values, "zero": zero})
    logged = (target - zero) * signs
    (turned,) = rollouts(arm, other, windows_of([TargetRun("log", t, logged, logged)], None))
    np.testing.assert_allclose(turned.q * signs + zero, plain.q, atol=1e-9)


def test_factors_on_masses_are_those_of_heavier_links(arm: ArmStep) -> None:
    t, target = targets(4.0, seed=3)
    values, factors = values_of(Servos()), np.array([1.3, 0.8])
    bodies = tuple(
        replace(body, inertia=Inertia.from_ten(body.inertia.ten * factor))
        for body, factor in zip(arm.model.robot.bodies, factors, strict=True)
    )
    other = arm_step(replace(arm.model.robot, bodies=bodies))
    windows = windows_of([TargetRun("log", t, target, target)], None)
    (heavier,) = rollouts(other, values, windows)
    (scaled,) = rollouts(arm, values.changed(mass_factor=factors), windows)
    (plain,) = rollouts(arm, values, windows)
    np.testing.assert_allclose(scaled.q, heavier.q, atol=1e-9)
    assert np.abs(scaled.q - plain.q).max() > 1e-3


@pytest.mark.parametrize("start", [0, 1])
def test_slopes_are_those_of_differences(arm: ArmStep, start: int) -> None:
    t, target = targets(3.0, seed=5)
    values = values_of(Servos(torque_limit=(0.7, 0.3))).changed(
        load_friction=0.1, dead_band=0.004, offset=0.002, zero=(0.1, -0.2)
    )
    values = values.changed(back_emf=(0.05, 0.03), stribeck=(0.06, 0.03), mass_factor=(1.1, 0.9))
    values = values.changed(stribeck_speed=0.4, integral=(6.0, 3.0))
    fed = np.array([sagging(x) for x in t])
    run = TargetRun("log", t, target, target + 0.01, fed)
    windows = windows_of([run], 1.0 if start else None)[start : start + 1]
    free = free_parameters([*(kind.name for kind in KINDS), "delays"], {}, 2)
    assert len(free) == 2 * len(KINDS) + 1
    (found,) = rollouts(arm, values, windows, free, 0.005)
    close = []
    for k, one in enumerate(free):
        small = np.zeros(len(free))
        small[k] = 1e-6
        ends = [
            rollouts(arm, moved_values(values, free, side * small), windows, (), 0.005)[0].q
            for side in (1.0, -1.0)
        ]
        slope = (ends[0] - ends[1]) / 2e-6
        off = np.abs(slope - found.slopes[:, :, k]).max(axis=1)
        size = max(np.abs(slope).max(), 1e-9)
        # where a joint starts to stick, or reaches its limit, one difference in many is another
        close.append(np.mean(off < 1e-3 * size))
        assert size > 1e-6, one
    assert min(close) > 0.9


def test_windows_in_any_number_are_rolled_out_alike(arm: ArmStep) -> None:
    t, target = targets(20.0, seed=7)
    run = TargetRun("log", t, target, target)
    windows = windows_of([run], 2.0)
    free = free_parameters(("stiffness", "delay"), {}, 2)
    together = rollouts(arm, values_of(Servos()), windows, free)
    assert len(windows) == 10
    for window, one in zip(windows, together, strict=True):
        (alone,) = rollouts(arm, values_of(Servos()), [window], free, threads=1)
        np.testing.assert_allclose(one.q, alone.q, atol=1e-12)
        np.testing.assert_allclose(one.slopes, alone.slopes, atol=1e-9)
