"""The observer of external efforts on samples, against MuJoCo, Pinocchio and the formula."""

from dataclasses import replace
from functools import cache

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from in_amperes import ROBOT
from oracles import pinocchio_model
from steelyard.base.arrays import Z95, Array
from steelyard.base.errors import DataError, ModelError
from steelyard.estimate.covariance_and_band_widths import Calibration
from steelyard.estimate.external.contact_thresholds import ContactThresholds
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.estimate.information.base_parameters_and_regressor import (
    base_parameters,
    base_regressor,
)
from steelyard.model.equations.frame_and_point_kinematics import last_frame
from steelyard.simulate.mujoco_model import build
from weighed import identified_of

STEP = 1e-3
FRAME = last_frame(ROBOT)


@cache
def model() -> IdentifiedModel:
    """The demo arm, its parameters known within 2 %, without rotors, friction and offsets."""
    found = identified_of(ROBOT)
    values = found.estimate.standard.parameters
    numbers = values.values.copy()
    numbers[10 * len(ROBOT.bodies) :] = 0.0
    known = replace(values, values=numbers)
    covariance = np.diag(np.square(0.02 * numbers))
    standard = replace(found.estimate.standard, parameters=known, covariance=covariance)
    return replace(
        found,
        base=base_parameters(found.model),
        estimate=replace(found.estimate, standard=standard, sigma=0.1 * np.ones(ROBOT.n)),
    )


def pushed(force: Array, moving: bool) -> tuple[Array, Array, Array, Array]:
    """MuJoCo's arm, held by a controller, with a force [N] at the origin of its last body."""
    found = model()
    tens = found.valued.values.values[: 10 * len(ROBOT.bodies)].reshape(-1, 10)
    plant = build(ROBOT, tens).compiled
    plant.opt.timestep = STEP
    data = mujoco.MjData(plant)
    aim = np.linspace(0.2, 0.8, ROBOT.n)
    data.qpos[:] = aim
    body = plant.nbody - 1
    rows = []
    for k in range(1500):
        t = k * STEP
        goal = aim + (0.3 * (1.0 - np.cos(2.0 * t)) if moving else 0.0)
        speed = 0.6 * np.sin(2.0 * t) if moving else 0.0
        mujoco.mj_forward(plant, data)
        pull = 100.0 * (goal - data.qpos) + 20.0 * (speed - data.qvel)
        tau = data.qfrc_bias + found.mass_matrix(data.qpos) @ pull
        data.qfrc_applied[:] = tau
        mujoco.mj_applyFT(plant, data, force, np.zeros(3), data.xpos[body], body, data.qfrc_applied)
        rows.append((t, data.qpos.copy(), data.qvel.copy(), tau.copy()))
        mujoco.mj_step(plant, data)
    t, q, dq, tau = (np.array(column) for column in zip(*rows, strict=True))
    return t, q, dq, tau


@pytest.mark.slow
@pytest.mark.parametrize("moving", [False, True])
def test_a_force_in_mujoco_is_found(moving: bool) -> None:
    force = np.array([12.0, -20.0, 15.0])
    t, q, dq, tau = pushed(force, moving)
    link = ROBOT.bodies[-1].name
    observer = model().observe(link, bandwidth=10.0, axes="base", force=30.0, lever=0.0)
    for sample in zip(t, q, dq, tau, strict=True):
        observer.step(*sample)
    wanted = model().jacobian(q[-1], link)[:3].T @ force
    assert np.abs(observer.torque - wanted).max() < 0.02 * np.abs(wanted).max()
    assert np.all(np.abs(observer.wrench[:3] - force) < observer.half_width[:3])
    assert np.linalg.norm(observer.wrench[:3] - force) < 2.0
    assert np.array_equal(observer.wrench[3:], np.zeros(3))


def test_the_wrench_is_the_weighted_formula_with_pinocchios_jacobian() -> None:
    found, rng = model(), np.random.default_rng(0)
    q, dq, tau = rng.normal(size=(3, ROBOT.n))
    observer = found.observe(ROBOT.bodies[-1].name, axes="base", force=25.0, lever=0.2)
    for k in range(3):
        observer.step(0.002 * k, q, dq, tau)
    robot = pinocchio_model(ROBOT)
    data = robot.createData()
    pin.computeJointJacobians(robot, data, q)
    oracle = pin.getJointJacobian(
        robot, data, robot.njoints - 1, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    )
    columns = base_regressor(found.model).dense(q[:, None], dq[:, None], np.zeros((ROBOT.n, 1)))
    spread = columns[:, 0] @ found.base_covariance @ columns[:, 0].T
    sigma = found.residual_std(0.5 * np.pi * found.cutoffs.score)
    off = np.linalg.inv(spread + np.diag(np.square(sigma)))
    size = np.linalg.inv(np.diag(np.repeat(np.square([25.0, 5.0]), 3)))
    covariance = np.linalg.inv(oracle @ off @ oracle.T + size)
    assert np.allclose(observer.wrench, covariance @ oracle @ off @ observer.torque, rtol=1e-6)
    assert np.allclose(observer.half_width, Z95 * np.sqrt(np.diag(covariance)), rtol=1e-6)
    assert np.allclose(observer.torque_half_width, Z95 * np.sqrt(np.diag(np.linalg.inv(off))))


def test_axes_of_the_frame_turn_the_wrench() -> None:
    q, dq, tau = np.random.default_rng(1).normal(size=(3, ROBOT.n))
    both = [model().observe(FRAME, axes=axes) for axes in ("base", "frame")]
    for observer in both:
        observer.step(0.0, q, dq, tau)
        observer.step(0.002, q, dq, tau)
    _, turned = model().pose(q, FRAME)
    in_base = np.concatenate([turned @ part for part in np.split(both[1].wrench, 2)])
    assert np.allclose(both[0].wrench, in_base)
    assert np.linalg.norm(in_base) > 1e-3


def test_singular_postures_stay_finite_and_unseen_directions_keep_the_expected_size() -> None:
    straight, still = np.zeros(ROBOT.n), np.zeros(ROBOT.n)
    first = ROBOT.bodies[0].name
    for frame in (ROBOT.bodies[-1].name, first):
        observer = model().observe(frame, force=10.0, lever=0.1)
        for k in range(3):
            observer.step(0.002 * k, straight, still, np.ones(ROBOT.n))
        assert np.isfinite(observer.wrench).all()
        assert np.all(observer.half_width <= Z95 * np.repeat([10.0, 1.0], 3) * (1.0 + 1e-12))
    # one joint behind the first link: five directions of six are not seen
    assert np.sum(observer.half_width > 0.999 * Z95 * np.repeat([10.0, 1.0], 3)) >= 4


def test_a_step_of_external_effort_arrives_with_the_stated_bandwidth() -> None:
    q, still = 0.3 * np.ones(ROBOT.n), np.zeros(ROBOT.n)
    free = model().torque(q, still, still)
    observer = model().observe(FRAME, bandwidth=4.0)
    for k in range(501):
        observer.step(0.001 * k, q, still, free - (0.001 * k > 0.1) * np.ones(ROBOT.n))
        if k == 100:
            assert np.abs(observer.torque).max() < 1e-9
    share = 1.0 - np.exp(-2.0 * np.pi * 4.0 * 0.4)
    assert np.allclose(observer.torque, share, rtol=5e-3)
    assert observer.steps == 501 and observer.gaps == 1


def test_correlated_and_wider_residuals_widen_the_interval() -> None:
    n = ROBOT.n
    edges, factors = np.tile([0.1, 0.4], (n, 1)), np.full((n, 4), 2.0 * Z95)
    correlation = np.eye(n) + 0.3 * (np.ones((n, n)) - np.eye(n))
    wide = Calibration("runs", 3, edges, factors, correlation=correlation)
    assert Calibration.from_dict(wide.to_dict()).correlation.tolist() == correlation.tolist()
    q, dq = np.zeros(n), 0.5 * np.ones(n)
    free = model().effort_uncertainty(5.0)
    calibrated = replace(model(), calibration=wide).effort_uncertainty(5.0)
    columns = base_regressor(model().model).dense(q[:, None], dq[:, None], q[:, None])[:, 0][None]
    moving = np.ones((n, 1), dtype=bool)
    less, more = (u.covariance(columns, dq[:, None], moving)[0] for u in (free, calibrated))
    assert np.allclose(np.diag(more), 4.0 * np.diag(less))
    noise = np.square(2.0 * free.sigma) * 0.3
    assert np.allclose((more - 4.0 * less)[0, 1], np.sqrt(noise[0] * noise[1]))


def test_a_joint_at_rest_has_its_dead_zone() -> None:
    rubbed = identified_of(ROBOT, values={f"coulomb.{name}": 3.0 for name in ROBOT.joint_names})
    uncertainty = rubbed.effort_uncertainty(5.0)
    # Coulomb friction of 3 Nm, and viscous friction at the speed at which it is taken
    assert np.all((uncertainty.dead_zone >= 3.0) & (uncertainty.dead_zone < 3.03))
    n = ROBOT.n
    nothing = np.zeros((1, n, uncertainty.factor.shape[0]))
    at_rest = uncertainty.covariance(nothing, np.zeros((n, 1)), np.zeros((n, 1), dtype=bool))
    wanted = np.square(uncertainty.sigma) + np.square(uncertainty.dead_zone) / 3.0
    assert np.allclose(np.diag(at_rest[0]), wanted)


def test_contact_is_told_by_thresholds() -> None:
    n, q = ROBOT.n, np.zeros(ROBOT.n)
    limits = np.full((n, 5), 2.0)
    limits[1] = np.nan
    edges = np.tile([0.01, 0.1, 0.4], (n, 1))
    own = tuple((True,) * 5 for _ in range(n))
    thresholds = ContactThresholds(edges, 5.0, 1.0, 60.0, limits, own, np.full(n, np.nan))
    observer = model().observe(FRAME, thresholds=thresholds)
    assert observer.bandwidth == 5.0
    free, push = model().torque(q, q, q), np.array([3.0, 9.0, 1.0, -3.0, *np.zeros(n - 4)])
    for k in range(400):
        observer.step(0.002 * k, q, q, free - push)
    assert observer.contact.tolist() == [True, False, False, True, *(n - 4) * [False]]
    with pytest.raises(DataError, match="do not fit a bandwidth"):
        model().observe(FRAME, thresholds=thresholds, bandwidth=3.0)


def test_contact_of_a_resting_robot_is_told_by_changes() -> None:
    n, q = ROBOT.n, np.zeros(ROBOT.n)
    edges = np.tile([0.01, 0.1, 0.4], (n, 1))
    changes = np.array([2.0, np.nan, *np.full(n - 2, 2.0)])
    own = tuple((True,) * 5 for _ in range(n))
    thresholds = ContactThresholds(edges, 5.0, 1.0, 60.0, np.full((n, 5), 99.0), own, changes)
    observer, free = model().observe(FRAME, thresholds=thresholds), model().torque(q, q, q)
    push, found = np.array([3.0, 9.0, 1.0, -3.0, *np.zeros(n - 4)]), []
    for k in range(1000):
        observer.step(0.005 * k, q, q, free - 5.0 - push * (k >= 600))
        found.append(observer.contact)
    assert not np.any(found[:640])
    assert found[699].tolist() == [True, False, False, True, *(n - 4) * [False]]


def test_a_gap_begins_anew_and_slow_samples_are_refused() -> None:
    q = np.zeros(ROBOT.n)
    observer = model().observe(FRAME, bandwidth=5.0)
    observer.step(0.0, q, q, q)
    observer.step(0.01, q, q, q)
    assert np.abs(observer.torque).max() > 0.0
    observer.step(1.0, q, q, q)
    assert np.array_equal(observer.torque, q) and observer.gaps == 2
    slow = model().observe(FRAME, bandwidth=5.0)
    with pytest.raises(DataError, match="at least 50 samples a second"):
        for k in range(60):
            slow.step(0.1 * k, q, q, q)


def test_bad_samples_are_named() -> None:
    q = np.zeros(ROBOT.n)
    observer = model().observe(FRAME)
    with pytest.raises(DataError, match="no thresholds"):
        _ = observer.contact
    with pytest.raises(DataError, match="for 6 joints"):
        observer.step(0.0, q[:2], q, q)
    observer.step(0.0, q, q, q)
    with pytest.raises(DataError, match="time does not increase"):
        observer.step(0.0, q, q, q)
    with pytest.raises(DataError):
        observer.step(0.1, q, np.nan * q, q)
    with pytest.raises(ModelError, match="no frame 'nose'"):
        model().observe("nose")
    with pytest.raises(DataError, match="no bandwidth"):
        model().observe(FRAME, bandwidth=0.0)
    with pytest.raises(DataError, match="no expected size"):
        model().observe(FRAME, force=0.0)
