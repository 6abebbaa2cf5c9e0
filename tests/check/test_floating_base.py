"""Checks of logs of a robot whose base floats: its sensors, contacts, limbs, by a dog in a hand."""

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import polars as pl
import pytest

import steelyard
from floating_logs import HAND, IMU, TRACKED, dog, record
from steelyard.base.arrays import Array
from steelyard.base.errors import DataError
from steelyard.check.decision import slipping_feet
from steelyard.check.finding import Finding
from steelyard.check.hypotheses.sensors_contacts_and_limbs import limbs
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.file.toml_edits import Edit, edited, lines_of
from steelyard.robot.file.toml_schema import tomllib
from steelyard.robot.inertia_and_placement import rpy_rotation

ORIENTED = IMU + 'orientation = "marker_q{}"\n'
Columns = dict[str, Array]
GYRO, ACC = ([f"{kind}_{x}" for x in "xyz"] for kind in ("gyro", "acc"))


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record(tmp_path_factory.mktemp("dog"), noise=0.05)[0]


def changed(log: Path, folder: Path, change: Callable[[Columns], None]) -> Path:
    """The log with other columns."""
    frame = pl.read_parquet(log)
    columns = {name: frame[name].to_numpy().copy() for name in frame.columns}
    change(columns)
    path = folder / "changed.parquet"
    pl.DataFrame(columns).write_parquet(path)
    return path


def scaled(names: list[str], factor: float) -> Callable[[Columns], None]:
    def change(columns: Columns) -> None:
        for name in names:
            columns[name] *= factor

    return change


def exchanged(pairs: list[tuple[str, str]]) -> Callable[[Columns], None]:
    def change(columns: Columns) -> None:
        for a, b in pairs:
            columns[a], columns[b] = columns[b], columns[a]

    return change


def bad(file: Path, log: Path) -> list[Finding]:
    return [f for f in steelyard.check(file, log).last.findings if f.severity]


@pytest.mark.slow
@pytest.mark.parametrize("sensor", [IMU, ORIENTED, TRACKED])
def test_a_clean_log_raises_no_alarm(sensor: str, log: Path, tmp_path: Path) -> None:
    found = steelyard.check(dog(tmp_path, sensor + HAND), log)
    assert [f for f in found.last.findings if f.severity] == []
    names = {f.check for f in found.last.findings}
    assert {"sensors of the base", "contacts", "sensor mounting", "joint order"} <= names
    assert not names & {"mounting", "moving base", "payload"}


OF_SENSORS: list[tuple[str, str, Callable[[Columns], None], str, dict[str, object]]] = [
    ("deg", IMU, scaled(GYRO, 180.0 / np.pi), "in deg/s", {"angular_velocity_unit": "deg/s"}),
    ("deg", ORIENTED, scaled(GYRO, 180.0 / np.pi), "in deg/s", {"angular_velocity_unit": "deg/s"}),
    ("axis", ORIENTED, scaled(["gyro_y"], -1.0), "along y has the opposite sign", {}),
    ("order", ORIENTED, exchanged([("gyro_x", "gyro_y")]), "order y, x, z", {
        "angular_velocity": ["gyro_y", "gyro_x", "gyro_z"]
    }),
    ("g", IMU, scaled(ACC, 1.0 / 9.80665), 'in "g"', {"acceleration_unit": "g"}),
    ("sign", ORIENTED, scaled(ACC, -1.0), "opposite sign", {}),
]  # fmt: skip


@pytest.mark.parametrize(("_name", "sensor", "change", "says", "lines"), OF_SENSORS)
def test_sensors_that_contradict_each_other_are_named(
    _name: str,
    sensor: str,
    change: Callable[[Columns], None],
    says: str,
    lines: dict[str, object],
    log: Path,
    tmp_path: Path,
) -> None:
    found = bad(dog(tmp_path, sensor + HAND), changed(log, tmp_path, change))
    (one,) = [f for f in found if f.check == "sensors of the base"]
    assert one.severity.name == "WRONG"
    assert says in one.says
    assert one.fix is not None
    assert {edit.path[-1]: edit.value for edit in one.fix.edits} == lines


def test_a_quaternion_in_the_other_order_is_named(log: Path, tmp_path: Path) -> None:
    def change(columns: Columns) -> None:
        old = [columns[f"marker_q{x}"] for x in "xyzw"]
        for x, values in zip("wxyz", old, strict=True):
            columns[f"marker_q{x}"] = values

    wrong = changed(log, tmp_path, change)
    (one,) = bad(dog(tmp_path, ORIENTED + HAND), wrong)
    assert "xyzw" in one.says


def test_an_acceleration_without_gravity_is_named(log: Path, tmp_path: Path) -> None:
    def change(columns: Columns) -> None:
        w, x, y, z = (columns[f"marker_q{k}"] for k in "wxyz")
        up = [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)]
        for name, part in zip(ACC, up, strict=True):
            columns[name] -= 9.81 * part

    (one,) = bad(dog(tmp_path, ORIENTED + HAND), changed(log, tmp_path, change))
    assert "without gravity" in one.says


def test_a_bias_of_the_gyroscope_is_named_and_gone_once_it_is_stated(
    log: Path, tmp_path: Path
) -> None:
    bias = (0.06, -0.02, 0.05)

    def change(columns: Columns) -> None:
        for name, x in zip(GYRO, bias, strict=True):
            columns[name] += x

    wrong = changed(log, tmp_path, change)

    def of_sensors(keys: str) -> list[Finding]:
        file = dog(tmp_path, ORIENTED + keys + HAND)
        found = steelyard.check(file, wrong, quick=True).last.findings
        return [f for f in found if f.check == "sensors of the base" and f.severity]

    (named,) = of_sensors("")
    assert "bias" in named.says and named.severity.name == "DOUBTFUL" and named.fix is not None
    says = named.fix.says
    key = says[says.index("angular_velocity_bias") :]
    fitted = np.array(key[key.index("[") + 1 : -1].split(", "), dtype=np.float64)
    np.testing.assert_allclose(fitted, bias, atol=5e-3)
    assert not of_sensors(key + "\n")


@pytest.mark.parametrize("names", [GYRO, ["hand_fx", "hand_fy", "hand_fz"]])
def test_a_sensor_that_stops_is_named(names: list[str], log: Path, tmp_path: Path) -> None:
    def change(columns: Columns) -> None:
        for name in (*names, *(["hand_mx", "hand_my", "hand_mz"] if names != GYRO else ())):
            columns[name][2000:] = columns[name][2000]

    (one,) = bad(dog(tmp_path, IMU + HAND), changed(log, tmp_path, change))
    assert "one value from 8 to 20 s" in one.says


LEGS = [
    (f"{kind}_fore_{joint}", f"{kind}_hind_{joint}")
    for kind in ("q", "tau")
    for joint in ("hip", "knee")
]
WRENCH = [f"hand_{kind}{x}" for kind in "fm" for x in "xyz"]
BY_EVIDENCE = [
    ("joint order", "exchanged", exchanged(LEGS)),
    ("position sign", "fore_knee", scaled(["q_fore_knee"], -1.0)),
    ("effort sign", "hind_hip", scaled(["tau_hind_hip"], -1.0)),
    ("contacts", "opposite sign", scaled(WRENCH, -1.0)),
    ("contacts", "factor of 9.", scaled(WRENCH, 1.0 / 9.81)),
]


@pytest.mark.slow
@pytest.mark.parametrize(("check", "says", "change"), BY_EVIDENCE)
def test_the_evidence_names_what_the_rows_of_the_base_contradict(
    check: str, says: str, change: Callable[[Columns], None], log: Path, tmp_path: Path
) -> None:
    found = bad(dog(tmp_path, ORIENTED + HAND), changed(log, tmp_path, change))
    assert [f.check for f in found] == [check]
    assert says in found[0].says


@pytest.mark.slow
def test_a_turned_sensor_is_named_and_its_mounting_written(log: Path, tmp_path: Path) -> None:
    frame = 'frame = "imu"'
    assert frame in ORIENTED
    robot = load_robot(dog(tmp_path, ORIENTED)).robot
    imu = {one.name: one for one in robot.frames}["imu"]
    turned = imu.rotation @ rpy_rotation(0.0, 0.0, 0.5 * np.pi)
    yaw = float(np.rad2deg(np.arctan2(turned[1, 0], turned[0, 0])))
    pitch = float(np.rad2deg(np.arcsin(-turned[2, 0])))
    roll = float(np.rad2deg(np.arctan2(turned[2, 1], turned[2, 2])))
    mounting = (
        f"mounting = {{roll = {roll}, pitch = {pitch}, yaw = {yaw}, "
        f"position = {imu.position.tolist()}}}"
    )
    file = dog(tmp_path, ORIENTED.replace(frame, mounting) + HAND)
    found = steelyard.check(file, log, fix=tmp_path / "fixed.toml")
    (one,) = [f for f in found.content.diagnosis.findings if f.severity]
    assert one.check == "sensor mounting"
    assert found.fixed is not None
    assert found.fixed.diagnosis.severity.name == "OK"
    corrected = load_robot(found.fixed.save()).signals
    assert corrected is not None and corrected.base is not None
    assert np.allclose(np.reshape(corrected.base.axes, (3, 3)), imu.rotation, atol=1e-3)
    with pytest.raises(DataError, match="sensor mounting"):
        steelyard.identify(file, log)


@pytest.mark.slow
def test_the_place_of_the_sensor_and_a_hand_that_is_not_measured_are_named(
    log: Path, tmp_path: Path
) -> None:
    file = dog(tmp_path, ORIENTED + HAND)
    text = file.read_text().replace('frame = "imu"', "")
    robot = load_robot(file).robot
    imu = {one.name: one for one in robot.frames}["imu"]
    axes = imu.rotation
    roll, pitch, yaw = (
        float(np.rad2deg(x))
        for x in (
            np.arctan2(axes[2, 1], axes[2, 2]),
            np.arcsin(-axes[2, 0]),
            np.arctan2(axes[1, 0], axes[0, 0]),
        )
    )
    place = (imu.position + [0.2, -0.2, 0.1]).tolist()
    mounting = f"mounting = {{roll = {roll}, pitch = {pitch}, yaw = {yaw}, position = {place}}}\n"
    file.write_text(text.replace("[signals.base]\n", f"[signals.base]\n{mounting}"))
    (one,) = bad(file, log)
    assert one.check == "sensor place"
    listed = ", ".join(f"{x:.2f}" for x in imu.position)
    assert f"({listed}) m" in one.says
    found = bad(dog(tmp_path, ORIENTED), log)  # the hand's force is not declared
    assert "unmeasured contacts" in [f.check for f in found]


def test_the_point_that_a_foot_touches_at_is_found() -> None:
    rng = np.random.default_rng(0)
    point, force = np.array([0.02, -0.03, -0.2]), rng.normal(size=(50, 3)) + [0.0, 0.0, 30.0]
    found = slipping_feet._point(force, np.cross(point, force))
    assert np.allclose(found[:2], point[:2], atol=0.01)  # along the force it does not count
    assert np.linalg.norm(np.cross(found - point, force).mean(axis=0)) < 0.05 * 30.0 * 0.2


def test_the_foot_that_moves_against_all_others_slips(monkeypatch: pytest.MonkeyPatch) -> None:
    count, loaded = 400, np.ones(400, dtype=np.bool_)
    place = [
        np.tile(np.reshape(x, (3, 1)), count) for x in ([0.2, 0, 0], [-0.2, 0, 0], [0, 0.2, 0])
    ]
    omega = np.array([0.0, 0.0, 0.5])
    still = [-np.cross(omega, x.T).T for x in place]
    speeds = (0.0, 0.0, 0.3)
    feet = [
        slipping_feet._Foot(name, x, v + np.array([[speed], [0.0], [0.0]]), loaded)
        for name, x, v, speed in zip(("a", "b", "c"), place, still, speeds, strict=True)
    ]
    rates = np.zeros((6, count))
    rates[3:] = omega[:, None]
    reading = cast(
        Any,
        SimpleNamespace(
            motion=lambda: (None, rates, None),
            likelihood=SimpleNamespace(excerpt=SimpleNamespace(t=0.01 * np.arange(count))),
        ),
    )
    monkeypatch.setattr(slipping_feet, "feet_of", lambda _: feet)
    found = slipping_feet._of_reading(reading)
    assert found.severity.name == "DOUBTFUL" and found.says.startswith("'c' slips")
    monkeypatch.setattr(slipping_feet, "feet_of", lambda _: feet[:2])
    assert slipping_feet._of_reading(reading).severity.name == "OK"
    monkeypatch.setattr(slipping_feet, "feet_of", lambda _: feet[:1])
    assert not slipping_feet._of_reading(reading).answered


def test_limbs_are_what_hangs_beside_others(tmp_path: Path) -> None:
    robot = load_robot(dog(tmp_path, IMU)).robot
    assert limbs(robot) == [((6, 7), "fore_thigh"), ((8, 9), "hind_thigh")]


def test_exchanged_contacts_are_lines_of_the_robot_file() -> None:
    tables = [{"frame": "a", "force": ["x", "y", "z"]}, {"frame": "b", "force": ["u", "v", "w"]}]
    edit = Edit(("signals", "base", "contacts"), tables)
    text = '[signals.base]\nacceleration = "acc_{}"\n[[signals.base.contacts]]\nframe = "c"\n'
    assert tomllib.loads(edited(text, [edit]))["signals"]["base"]["contacts"] == tables
    assert tomllib.loads(lines_of([edit]))["signals"]["base"]["contacts"] == tables
