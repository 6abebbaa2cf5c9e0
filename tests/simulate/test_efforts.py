"""Efforts and positions as a log declares them: kinds, motors' side, gains."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from steelyard.base.arrays import Parameters
from steelyard.base.errors import ModelError
from steelyard.base.motion import Motion
from steelyard.excite.trajectories.fourier import FourierMotion, random_fourier
from steelyard.logs.formats import open_log
from steelyard.model.laws.friction_over_speed import Coulomb, Viscous
from steelyard.model.laws.laws_without_friction import RigidBody, RotorInertia
from steelyard.model.model import Model
from steelyard.model.terms.term import Term
from steelyard.robot.file.sections import EffortSection, SignalsSection
from steelyard.robot.file.signals import Signals
from steelyard.robot.file.signals_from_tables import build_signals
from steelyard.robot.robot import Robot, Transmission
from steelyard.runs.recording import Recording
from steelyard.simulate.drives_sensors_and_loads import Sensors, TrueRun
from steelyard.simulate.ground_truth import Truth, random_truth
from steelyard.simulate.virtual_robot import VirtualRobot, write_run

MOTORS = ("m1", "m2")
GEARS = np.array([[50.0, 0.0], [40.0, -40.0]])
TERMS: tuple[Term, ...] = (
    RigidBody(),
    RotorInertia(motors=MOTORS),
    Viscous(motors=MOTORS),
    Coulomb(smoothing=0.1),
)


@pytest.fixture(scope="module")
def geared(leg: Robot) -> Robot:
    return leg.changed(transmission=Transmission(MOTORS, GEARS))


@pytest.fixture(scope="module")
def truth(geared: Robot) -> Truth:
    return random_truth(geared, 3, terms=TERMS)


@pytest.fixture(scope="module")
def run(geared: Robot, truth: Truth) -> TrueRun:
    return VirtualRobot(geared, truth, rest=0.2).follow(motion(geared))


def motion(robot: Robot) -> FourierMotion:
    return random_fourier(robot, seed=5, period=3.0, harmonics=3)


def short(robot: Robot) -> FourierMotion:
    return random_fourier(robot, seed=5, period=1.0, harmonics=3)


def torque(truth: Truth, run: TrueRun, *terms: type, still: bool = False) -> np.ndarray:
    """Torque of some of the truth's terms along a run, by the model."""
    spline = CubicSpline(run.t, run.q)
    states = [spline(run.t, k) for k in range(3)]
    if still:
        states[1:] = np.zeros_like(states[1]), np.zeros_like(states[2])
    model = Model(truth.robot, tuple(t for t in truth.model.terms if isinstance(t, terms)))
    values = Parameters(model.names, model.units, [truth.values[name] for name in model.names])
    return model.at(values).torque(Motion(run.t, *states))


def test_behind_the_gears_neither_rotors_nor_friction_of_motors_are_felt(
    run: TrueRun, truth: Truth
) -> None:
    wanted = torque(truth, run, RigidBody, Coulomb)
    hidden = torque(truth, run, RotorInertia, Viscous)
    inner = slice(250, -250)
    error = np.linalg.norm((run.effort("link_torque") - wanted)[inner], axis=0)
    assert np.all(error < 5e-3 * np.linalg.norm(hidden[inner], axis=0))
    assert np.all(
        np.linalg.norm(hidden[inner], axis=0) > 0.02 * np.linalg.norm(wanted[inner], axis=0)
    )


def test_gravity_is_compensated_by_the_true_bodies(run: TrueRun, truth: Truth) -> None:
    gravity = torque(truth, run, RigidBody, still=True)
    np.testing.assert_allclose(
        run.tau - run.effort("gravity_compensated_torque"), gravity, atol=1e-9
    )
    assert np.abs(gravity).max() > 1.0


def test_other_kinds_are_the_joints_torque(run: TrueRun) -> None:
    for kind in ("joint_torque", "motor_torque", "motor_current"):
        np.testing.assert_array_equal(run.effort(kind), run.tau)


def test_motor_torques_do_the_same_work(run: TrueRun, geared: Robot) -> None:
    sensors = Sensors(rate=1000.0, effort="motor_torque")
    columns = sensors.read(run, geared, np.random.default_rng(0))
    motors = np.column_stack([columns["motor_tau1_Nm"], columns["motor_tau2_Nm"]])
    power = np.sum(motors * (run.dq @ GEARS.T), axis=1)
    np.testing.assert_allclose(power, np.sum(run.tau * run.dq, axis=1), atol=1e-9)


def test_motor_torques_need_gears(run: TrueRun, leg: Robot) -> None:
    with pytest.raises(ModelError, match="the robot has no transmission"):
        Sensors(effort="motor_torque").read(run, leg, np.random.default_rng(0))


def signals(robot: Robot, effort: dict[str, object], **fields: object) -> Signals:
    section = SignalsSection(
        time="t", position="x{}", velocity="v{}", effort=EffortSection(columns="e{}", **effort),
        **fields,
    )  # fmt: skip
    return build_signals(section, robot.coordinates, lambda *keys: ".".join(map(str, keys)),
                         robot.transmission)  # fmt: skip


KINDS = (
    {"kind": "motor_torque", "unit": "Nm", "side": "motor"},
    {"kind": "motor_current", "unit": "mA", "side": "motor", "gain": (0.1, -0.2)},
    {"kind": "motor_current", "unit": "A", "gain": (10.0, 12.0)},
    {"kind": "link_torque", "unit": "Nm"},
    {"kind": "gravity_compensated_torque", "unit": "Nm"},
)


@pytest.fixture(scope="module")
def happened(geared: Robot, truth: Truth) -> TrueRun:
    return VirtualRobot(geared, truth, rest=0.2).follow(short(geared))


@pytest.mark.parametrize(
    ("effort", "side"), [(KINDS[0], "joint"), *((kind, "motor") for kind in KINDS)]
)
def test_a_declared_log_is_read_back_as_it_happened(
    geared: Robot,
    truth: Truth,
    happened: TrueRun,
    tmp_path: Path,
    effort: dict[str, object],
    side: str,
) -> None:
    declared = signals(
        geared, effort, coordinates=side, position_unit="deg", position_offset=(0.3, -0.1)
    )
    rig = VirtualRobot(geared, truth, Sensors(rate=500.0), rest=0.2, signals=declared)
    with rig.record(tmp_path / "log.parquet"):
        rig.send(short(geared))
    recording = Recording(open_log(tmp_path / "log.parquet"), declared)
    (t, channels), *_ = recording.raw((0, None))
    np.testing.assert_allclose(t, happened.t[::2])
    np.testing.assert_allclose(channels[:, :2], happened.q[::2], atol=1e-9)
    np.testing.assert_allclose(channels[:, 2:4], happened.dq[::2], atol=1e-9)
    wanted = happened.effort(str(effort["kind"]))[::2]
    np.testing.assert_allclose(channels[:, 4:] * declared.gains, wanted, atol=1e-9)


@pytest.mark.slow
def test_unknown_gains_are_those_of_the_sensors_and_stated_in_the_truth(
    leg: Robot, tmp_path: Path
) -> None:
    declared = signals(leg, {"kind": "motor_current", "unit": "A", "gain": ("identify", 10.0)})
    truth, path = random_truth(leg, 1), short(leg)
    sensors = Sensors(gains=np.random.default_rng(4).uniform(5.0, 15.0, 2))
    files = write_run(VirtualRobot(leg, truth, sensors, signals=declared), path, tmp_path / "out")
    run = VirtualRobot(leg, truth).follow(path)
    (_, channels), *_ = Recording(open_log(files.log), declared).raw((0, None))
    hidden = json.loads(files.truth.read_text())["drive_gains"]
    assert 5.0 < hidden["thigh_joint"] < 15.0
    np.testing.assert_allclose(channels[:, 4] * hidden["thigh_joint"], run.tau[::4, 0])
    np.testing.assert_allclose(channels[:, 5] * 10.0, run.tau[::4, 1])
    assert Sensors().gains is None


def test_friction_of_motors_is_felt_at_all_their_joints(
    geared: Robot, make_truth: Callable
) -> None:
    truth = make_truth(geared, Viscous(motors=("m2",)), **{"viscous.m2": 1e-3})
    run = VirtualRobot(geared, truth, rest=0.2).follow(motion(geared))
    power = np.sum((run.tau - run.effort("link_torque")) * run.dq, axis=1)
    speed = run.dq @ GEARS[1]
    moving = np.abs(speed) > 1.0
    np.testing.assert_allclose(power[moving], 1e-3 * speed[moving] ** 2, rtol=0.05)
