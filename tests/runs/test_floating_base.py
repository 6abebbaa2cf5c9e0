"""Motion of a floating base from the columns of its sensors, and efforts with contacts."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from floating_logs import HAND, IMU, TRACKED, dog, record
from steelyard.base.arrays import json_values
from steelyard.base.errors import LogError
from steelyard.base.motion import Motion
from steelyard.model.laws.laws_without_friction import RigidBody
from steelyard.model.model import Model
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.file.signals import signals_from_dict
from steelyard.runs.floating_base import of_angles, rotations
from steelyard.runs.motion_error_from_noise import motion_error
from steelyard.runs.run import RunData
from steelyard.runs.runs_of_named_logs import load_runs

Logged = tuple[Path, Motion]
WORLD = HAND.replace("hand_", "world_") + 'axes = "world"\n'
ORIENTED = 'orientation = "marker_q{}"\norientation_kind = "xyzw"\n'
IN_DEGREES = 'acceleration_unit = "g"\nangular_velocity_unit = "deg/s"\n'
MOUNTED = IMU.replace(
    'frame = "imu"\n',
    "mounting = {roll = 10.0, pitch = -20.0, yaw = 30.0, position = [0.1, 0.0, 0.2]}\n",
)


@pytest.fixture(scope="module")
def logged(tmp_path_factory: pytest.TempPathFactory) -> Logged:
    return record(tmp_path_factory.mktemp("dog"))


def changed(logged: Logged, folder: Path, change: Callable[[pl.DataFrame], pl.DataFrame]) -> Path:
    path = folder / "changed.parquet"
    change(pl.read_parquet(logged[0])).write_parquet(path)
    return path


def run_of(folder: Path, base: str, log: Path) -> RunData:
    (run,) = load_runs(dog(folder, base), log)
    return run.whole()


def check(run: RunData, true: Motion, columns: slice = slice(None)) -> None:
    """The motion is the true one, and the efforts with contacts are the torques of the bodies."""
    at = np.searchsorted(true.t, run.t - 1e-9)[200:-200]
    inside = slice(200, -200)
    for name in ("dq", "ddq"):
        mine, its = getattr(run.motion, name)[inside], getattr(true, name)[at]
        np.testing.assert_allclose(mine[:, columns], its[:, columns], atol=2e-3)
    np.testing.assert_allclose(run.motion.q[inside, 6:], true.q[at, 6:], atol=1e-4)


def check_efforts(run: RunData, folder: Path) -> None:
    model = Model(load_robot(folder / "dog.toml").robot, (RigidBody(),)).prior
    assert model is not None
    rest = (model.torque(run.motion) - run.effort)[200:-200]
    np.testing.assert_allclose(rest, 0.0, atol=3e-2)


ACCELERATED = slice(3, None)
"""An inertial sensor knows no velocity of the base."""


@pytest.mark.parametrize("contact", [HAND, ORIENTED + WORLD])
def test_an_inertial_sensor(contact: str, logged: Logged, tmp_path: Path) -> None:
    run = run_of(tmp_path, IMU + contact, logged[0])
    check(run, logged[1], ACCELERATED)
    check_efforts(run, tmp_path)
    assert run.moving[:, :6].all() and not run.motion.q[:, :6].any()


def test_motion_capture(logged: Logged, tmp_path: Path) -> None:
    run = run_of(tmp_path, TRACKED + HAND, logged[0])
    check(run, logged[1])
    check_efforts(run, tmp_path)


def test_units_and_a_mounting(logged: Logged, tmp_path: Path) -> None:
    plain = run_of(tmp_path, MOUNTED, logged[0])
    other = changed(logged, tmp_path, lambda table: table.with_columns(
        pl.col("^acc_.$") / 9.80665, pl.col("^gyro_.$") * 180.0 / np.pi
    ))  # fmt: skip
    found = run_of(tmp_path, MOUNTED.replace("[[", IN_DEGREES + "[[") + IN_DEGREES, other)
    np.testing.assert_allclose(found.motion.ddq, plain.motion.ddq, atol=1e-6)
    frame = load_robot(dog(tmp_path, IMU)).signals
    assert frame is not None and frame.base is not None
    turn = np.reshape(frame.base.axes, (3, 3))
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
    assert frame.base.place == pytest.approx((0.1, 0.05, 0.02))


def test_a_late_sensor_is_corrected(logged: Logged, tmp_path: Path) -> None:
    late = changed(logged, tmp_path, lambda table: table.with_columns(
        pl.col("^(acc|gyro)_.$").shift(5, fill_value=0.0)
    ))  # fmt: skip
    check(run_of(tmp_path, IMU + "delay = 0.02\n", late), logged[1], ACCELERATED)


def test_stated_biases_are_subtracted(logged: Logged, tmp_path: Path) -> None:
    biased = changed(logged, tmp_path, lambda table: table.with_columns(
        (pl.col("acc_x") + 0.3) / 9.80665, pl.col("acc_y") / 9.80665,
        (pl.col("acc_z") - 0.2) / 9.80665, pl.col("gyro_x") * 180.0 / np.pi,
        (pl.col("gyro_y") + 0.1) * 180.0 / np.pi, pl.col("gyro_z") * 180.0 / np.pi,
    ))  # fmt: skip
    keys = "acceleration_bias = [0.3, 0.0, -0.2]\nangular_velocity_bias = [0.0, 0.1, 0.0]\n"
    check(run_of(tmp_path, IMU + IN_DEGREES + keys, biased), logged[1], ACCELERATED)


def test_an_unknown_wrench_leaves_the_rows_of_the_base_out(logged: Logged, tmp_path: Path) -> None:
    run = run_of(tmp_path, IMU + 'wrench = "unknown"\n', logged[0])
    assert not run.moving[:, :6].any() and run.moving[:, 6:].any()


def test_orientations_of_all_kinds() -> None:
    angles = np.array([[0.3, -0.5], [0.2, 1.1], [-2.0, 3.0]])
    axes = of_angles(angles)
    from scipy.spatial.transform import Rotation

    turned = Rotation.from_euler("ZYX", angles[::-1].T)
    np.testing.assert_allclose(axes, turned.as_matrix(), atol=1e-12)
    four = 3.0 * turned.as_quat()
    given = {
        "xyzw": four, "wxyz": four[:, [3, 0, 1, 2]], "rpy_rad": angles.T,
        "rpy_deg": np.rad2deg(angles.T), "matrix": axes.reshape(-1, 9),
    }  # fmt: skip
    for kind, values in given.items():
        np.testing.assert_allclose(rotations(values, kind), axes, atol=1e-12)


def oriented(logged: Logged, folder: Path, quaternion: Sequence[float]) -> Path:
    """The log with one orientation of the marker body, x, y, z, w."""
    given = [pl.lit(x).alias(f"marker_q{k}") for k, x in zip("xyzw", quaternion, strict=True)]
    return changed(logged, folder, lambda table: table.with_columns(*given))


def test_it_is_the_base_that_must_not_turn_over(logged: Logged, tmp_path: Path) -> None:
    from scipy.spatial.transform import Rotation

    mounted = Rotation.from_quat([0.1, -0.3, 0.2, 0.8])  # of the link "imu"
    pitched = Rotation.from_euler("Y", 90.0, degrees=True)
    upside = oriented(logged, tmp_path, (pitched * mounted).as_quat().tolist())
    with pytest.raises(LogError, match="pitches by 90°, where roll and yaw are not") as caught:
        run_of(tmp_path, TRACKED, upside)
    assert "LOG@START:STOP" in caught.value.fix
    # a marker body that stands steeply on a base that does not
    steep = oriented(logged, tmp_path, pitched.as_quat().tolist())
    run_of(tmp_path, TRACKED, steep)


def test_noise_of_sensors_is_noise_of_what_they_measure(tmp_path: Path) -> None:
    log, _ = record(tmp_path, noise=0.05)
    (run,) = load_runs(dog(tmp_path, IMU), log)
    error = motion_error(run)
    std = np.sqrt(np.einsum("nii->ni", error.covariance()))
    raw = run.whole().motion
    (clean,) = load_runs(dog(tmp_path, IMU), record(tmp_path, "clean")[0])
    rest = raw.ddq[200:-200, :3] - clean.whole().motion.ddq[200:-200, :3]
    assert not std[:3, :2].any() and not std[3:6, 0].any()
    np.testing.assert_allclose(rest.std(axis=0), std[:3, 2], rtol=0.3)


def test_signals_are_kept_in_models(tmp_path: Path) -> None:
    signals = load_robot(dog(tmp_path, IMU + ORIENTED + WORLD)).signals
    assert signals is not None and signals.n == 10 and signals.n_base == 6
    again = signals_from_dict(json_values(signals))
    assert again.reads_alike(signals) and again.base == signals.base
    assert not again.reads_alike(load_robot(dog(tmp_path, IMU)).signals)
