"""Efforts and a supply voltage logged beside targets: scale of torques, gains, what is refused."""

import re
import warnings
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from proofs.support.servo_arm import ROBOT_FILE, URDF, Servos, log

import steelyard
from steelyard.actuators.actuator_model import EffortGain, arm_step, gains_from
from steelyard.actuators.actuator_parameters import ActuatorValues
from steelyard.actuators.actuators_page import ActuatorIdentification
from steelyard.actuators.logged_efforts import Efforts, logged_efforts
from steelyard.actuators.logs_signs_and_zeros import Job, read_logs, search_of
from steelyard.actuators.read_targets import read_targets
from steelyard.actuators.target_runs import TargetRun, windows_of
from steelyard.base.arrays import json_values
from steelyard.base.errors import LogError
from steelyard.base.progress import silent
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.file.signals import TargetSignals
from steelyard.runs.runs_of_named_logs import log_files

TRUE = Servos()
PD = '[actuator]\nlaw = "position_pd"\n'
LIGHTER = 0.85  # masses of a model file that is wrong, over the true ones
KNOWN = "position_sign = [1, 1]\nposition_offset = [0.0, 0.0]\n"
Columns = Mapping[str, np.ndarray]


def efforts(kind: str, unit: str, gain: str = "") -> str:
    more = f", gain = {gain}" if gain else ""
    return f'effort = {{columns = "tau{{}}", kind = "{kind}", unit = "{unit}"{more}}}\n'


def sagging(t: float) -> float:
    return float(0.85 + 0.1 * np.cos(0.3 * t))


@pytest.fixture(scope="module")
def measured() -> Columns:
    return log(TRUE, 36.0, 3, torques=True)


@pytest.fixture(scope="module")
def sagged() -> Columns:
    return log(TRUE, 36.0, 3, step=2e-4, supply=sagging)


def identified(
    folder: Path, columns: Columns, more: str, urdf: str = URDF, actuator: str = PD
) -> ActuatorIdentification:
    (folder / "servos.urdf").write_text(urdf)
    (folder / "servos.toml").write_text(ROBOT_FILE + KNOWN + more + actuator)
    pl.DataFrame(dict(columns)).write_csv(folder / "log.csv")
    return steelyard.identify_actuators(folder / "servos.toml", folder / "log.csv")


def holds(found: ActuatorIdentification, name: str, joint: int, rel: float) -> bool:
    """Whether a value is near the true one."""
    one = next(p for p in found.parameters if p.name == name and p.joint == JOINTS[joint])
    return one.status == "identified" and one.value == pytest.approx(
        vars(TRUE)[name][joint], rel=rel
    )


JOINTS = ("shoulder", "elbow")


def lighter(urdf: str) -> str:
    """The same links, lighter by one factor."""
    for size in ("0.25", "0.2", "4e-4", "3e-4", "1e-4"):
        urdf = urdf.replace(f'="{size}"', f'="{LIGHTER * float(size):.6g}"')
    return urdf


def test_torques_of_motors_give_the_scale_where_masses_are_wrong(
    tmp_path: Path, measured: Columns
) -> None:
    found = identified(tmp_path, measured, efforts("motor_torque", "Nm"), lighter(URDF))
    assert all(holds(found, name, j, 0.03) for name in ("stiffness", "coulomb") for j in (0, 1))
    masses = [p.value for p in found.parameters if p.name == "mass_factor"]
    assert masses == pytest.approx([1.0 / LIGHTER] * 2, rel=0.03)
    assert found.model.measured == JOINTS
    assert "scale of the logged efforts" in found.basis[0]
    found.save(tmp_path / "model")
    again = steelyard.load_actuators(tmp_path / "model")
    assert again.to_dict() == found.model.to_dict()
    assert [one.status for one in again.efforts] == ["stated", "stated"]
    checked = steelyard.check_targets(tmp_path / "servos.toml", tmp_path / "log.csv")
    said = {f.check: f for f in checked.content.diagnosis.findings}
    assert "logged efforts (shoulder, elbow)" in said["scale"].says
    assert "they follow the torques" in said["efforts"].says and not said["efforts"].severity


def test_a_stated_stiffness_wins_over_efforts(tmp_path: Path, measured: Columns) -> None:
    stated = PD + "stiffness = [6.0, 4.0]\n"
    found = identified(tmp_path, measured, efforts("motor_torque", "Nm"), actuator=stated)
    assert found.model.values["stiffness"].tolist() == [6.0, 4.0]
    assert not found.model.measured
    assert all(one.status == "contradicted" for one in found.model.efforts)
    assert all(one.by_masses is None for one in found.model.efforts)  # the scale is stated
    assert any("times the torque of the law" in words for words in found.warnings)


def test_currents_get_gains_and_wrong_signs_are_named(tmp_path: Path, measured: Columns) -> None:
    drives = {**measured, "tau1": measured["tau1"] / -1.7e-3, "tau2": -measured["tau2"]}
    found = identified(tmp_path, drives, efforts("motor_current", "mA", '["identify", 1e3]'))
    one, other = found.model.efforts
    assert one.status == "identified" and one.unit == "Nm/A"
    assert one.value == pytest.approx(-1.7, rel=0.02)
    assert one.interval is not None and one.interval[0] < one.value < one.interval[1]
    assert other.status == "contradicted"
    assert any("elbow count against the joint" in words for words in found.warnings)
    assert not found.model.measured and holds(found, "stiffness", 1, 0.03)
    assert "Nm/A" in str(found) and "scale of the masses" in found.basis[0]
    assert "Logged efforts" in found.report()
    motion = {name: x for name, x in measured.items() if not name.startswith("tau")}
    pl.DataFrame(motion).write_csv(tmp_path / "motion.csv")
    scored = steelyard.validate_actuators(found.model, tmp_path / "motion.csv")
    assert scored.validation[0].rms.max() < 1.5e-3
    file = load_robot(tmp_path / "servos.toml")
    logs = [log_files([str(tmp_path / f"{name}.csv")]) for name in ("log", "motion")]
    assert file.targets is not None
    both = read_logs(file, file.targets, *logs, silent)
    assert np.isfinite(both[0].runs[0].effort).all() and np.isnan(both[1].runs[0].effort).all()
    assert found.to_dict()["efforts"][0]["status"] == "identified"


def shown(
    folder: Path,
    columns: Columns,
    kind: str = "motor_torque",
    unit: str = "Nm",
    true: Servos = TRUE,
) -> Efforts:
    """What a log shows of efforts, with the true law."""
    (folder / "servos.urdf").write_text(URDF)
    file = load_robot(folder / "s.toml", ROBOT_FILE + efforts(kind, unit, '"identify"') + PD)
    assert file.targets is not None
    q, target, torque = (
        np.stack([columns[f"{name}{j}"] for j in (1, 2)], axis=1) for name in ("q", "target", "tau")
    )
    run = TargetRun("log", columns["time"], target, q, effort=torque)
    values = ActuatorValues.of((1.0, 1.0), **vars(true))
    windows = windows_of([run], 4.0)
    return logged_efforts(arm_step(file.robot), windows, values, file.targets, (0, 1), 1)


def test_loads_without_signs_count_and_noise_does_not(tmp_path: Path, measured: Columns) -> None:
    rng = np.random.default_rng(0)
    noise, size = (rng.normal(size=len(measured["time"])) for _ in range(2))
    load = np.abs(measured["tau1"]) / 0.017
    for column in (np.round(load), load + 0.3 * size):
        found = shown(tmp_path, {**measured, "tau1": column, "tau2": noise}).factors
        assert found.keys() == {0} and found[0].unsigned
        assert found[0].value == pytest.approx(1.0 / 0.017, rel=0.02)


def test_efforts_of_one_sign_keep_it(tmp_path: Path, measured: Columns) -> None:
    heavy = measured["tau1"] - 3.0  # as if a spring pulled all the time
    found = shown(tmp_path, {**measured, "tau1": -1.5 * heavy}).factors
    assert not found[0].unsigned and found[0].value == pytest.approx(-1.5, rel=0.02)


def test_exchanged_columns_are_named(tmp_path: Path, measured: Columns) -> None:
    other = {**measured, "tau1": measured["tau2"], "tau2": measured["tau1"]}
    found = shown(tmp_path, other)
    assert not found.factors and found.others == {0: 1, 1: 0}


def test_torques_of_integral_gains_are_in_the_law(tmp_path: Path) -> None:
    true = Servos(integral=(15.0, 10.0))
    found = shown(tmp_path, log(true, 36.0, 3, step=2e-4, torques=True), true=true).factors
    assert [found[j].value for j in (0, 1)] == pytest.approx([1.0, 1.0], rel=0.02)


def test_torques_that_do_not_change_tell_nothing(tmp_path: Path) -> None:
    t = np.arange(0.0, 36.0, 0.02)
    rest = np.zeros(len(t))
    noise = 0.8 + 0.01 * np.random.default_rng(0).normal(size=len(t))
    still = {"time": t, "q1": rest, "q2": rest, "target1": rest, "target2": rest}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert not shown(tmp_path, {**still, "tau1": noise, "tau2": rest}).factors


def test_sensors_at_the_joint_lack_friction_and_rotor(tmp_path: Path, measured: Columns) -> None:
    changed = dict(measured)
    for j, coulomb in enumerate(TRUE.coulomb, start=1):
        v = np.gradient(measured[f"q{j}"], measured["time"])
        changed[f"tau{j}"] = 2.0 * (measured[f"tau{j}"] - coulomb * np.tanh(v / 0.05))
    at_joint, of_motor = (
        shown(tmp_path, changed, kind).factors[0].value for kind in ("joint_torque", "motor_torque")
    )
    assert at_joint == pytest.approx(2.0, rel=0.03)
    assert abs(of_motor - 2.0) > 2.0 * abs(at_joint - 2.0)


def test_gains_of_another_unit_are_doubted(tmp_path: Path, measured: Columns) -> None:
    drives = efforts("motor_current", "mA", "[1e4, 1e4]")
    found = identified(tmp_path, measured, drives)
    assert found.model.measured and any("many times as heavy" in w for w in found.warnings)
    assert found.fitted[0].rms.max() < 1.5e-3
    checked = steelyard.check_targets(tmp_path / "servos.toml", tmp_path / "log.csv")
    (finding,) = [f for f in checked.content.diagnosis.findings if f.check == "efforts"]
    assert finding.severity.name == "DOUBTFUL"
    checked.save(tmp_path / "page")
    page = (tmp_path / "page" / "check.html").read_text("utf-8")
    assert "Do logged efforts follow the controllers" in page
    assert re.search("masses of the model file ask for about 1.0[0-9][0-9] Nm/A", finding.says)


def test_the_supply_explains_what_changes_with_it(tmp_path: Path, sagged: Columns) -> None:
    volts = {**sagged, "supply": 12.0 * sagged["supply"]}
    found = identified(tmp_path, volts, 'supply_voltage = "supply"\nnominal_voltage = 12.0\n')
    assert all(holds(found, name, j, 0.03) for name in ("stiffness", "coulomb") for j in (0, 1))
    assert found.fitted[0].rms.max() < 1.3e-3
    blind = replace(found.model, signals=replace(found.model.signals, supply=""))
    without = steelyard.validate_actuators(blind, tmp_path / "log.csv")
    assert without.validation[0].rms.max() > 2.0 * found.fitted[0].rms.max()


def test_a_supply_in_another_unit_is_refused(tmp_path: Path, sagged: Columns) -> None:
    fed = 'supply_voltage = "supply"\nnominal_voltage = 120.0\n'
    with pytest.raises(LogError, match="times the nominal voltage"):
        identified(tmp_path, {**sagged, "supply": 12.0 * sagged["supply"]}, fed)


def test_rows_without_efforts_are_rows_of_motion(tmp_path: Path, measured: Columns) -> None:
    tau = measured["tau1"].copy()
    tau[::2] = np.nan
    (tmp_path / "servos.urdf").write_text(URDF)
    file = load_robot(tmp_path / "s.toml", ROBOT_FILE + efforts("motor_torque", "Nm") + PD)
    pl.DataFrame({**measured, "tau1": tau}).write_csv(tmp_path / "log.csv")
    assert file.targets is not None
    (one,) = log_files([str(tmp_path / "log.csv")])
    found = read_targets(one, file.targets, file.robot)
    assert len(found.runs[0].t) == len(tau) and not found.notes
    assert np.isnan(found.runs[0].effort[::2, 0]).all()


@pytest.mark.parametrize(
    "damage",
    [
        {"value": "x"},
        {"value": 0.0},
        {"interval": [1.0]},
        {"interval": [1.8, 1.6]},
        {"interval": [1.8, 1.9]},
        {"unit": 3},
        {"value": float("inf")},
        {"status": "sure"},
        {"joint": "wrist"},
    ],
)
def test_damaged_gains_are_refused(damage: dict[str, object]) -> None:
    whole = EffortGain("elbow", "Nm/A", 1.7, (1.6, 1.8), "identified").to_dict()
    assert gains_from([whole], ["elbow"])[0].interval == (1.6, 1.8)
    with pytest.raises(ValueError):
        gains_from([{**whole, **damage}], ["elbow"])


@pytest.mark.parametrize(
    "damage",
    [
        {"effort": "ab"},
        {"effort_gain": "ab"},
        {"effort_gain": [1.0, 0.0]},
        {"effort_scale": [None, None]},
        {"effort_units": [1, 2]},
        {"nominal": None},
        {"nominal": -1.0},
        {"supply": "time"},
        {"effort": ["q1", "tau2"]},
    ],
)
def test_damaged_signals_are_refused(tmp_path: Path, damage: dict[str, object]) -> None:
    (tmp_path / "servos.urdf").write_text(URDF)
    fed = 'supply_voltage = "supply"\nnominal_voltage = 12.0\n'
    file = load_robot(tmp_path / "s.toml", ROBOT_FILE + fed + efforts("motor_torque", "Nm") + PD)
    whole = json_values(file.targets)
    assert TargetSignals.from_dict(whole).effort == ("tau1", "tau2")
    with pytest.raises((ValueError, TypeError)):
        TargetSignals.from_dict({**whole, **damage})


@pytest.mark.parametrize("hole", [np.nan, 0.0])
def test_a_supply_that_is_missing_for_long_is_told(
    tmp_path: Path, sagged: Columns, hole: float
) -> None:
    volts = 12.0 * sagged["supply"]
    volts[200:600] = hole
    (tmp_path / "servos.urdf").write_text(URDF)
    fed = 'supply_voltage = "supply"\nnominal_voltage = 12.0\n'
    file = load_robot(tmp_path / "s.toml", ROBOT_FILE + fed)
    pl.DataFrame({**sagged, "supply": volts}).write_csv(tmp_path / "log.csv")
    assert file.targets is not None
    (one,) = log_files([str(tmp_path / "log.csv")])
    found = read_targets(one, file.targets, file.robot)
    assert "of the nominal 12, and not logged for up to 8.02 s" in found.notes[0]
    assert found.runs[0].supply[400] == pytest.approx(sagged["supply"][[199, 600]].mean(), abs=0.01)
    pl.DataFrame({k: x for k, x in sagged.items() if k != "supply"}).write_csv(tmp_path / "no.csv")
    (other,) = log_files([str(tmp_path / "no.csv")])
    with pytest.raises(LogError, match="no column 'supply' of the supply voltage"):
        read_targets(other, file.targets, file.robot)


def test_an_integral_gain_is_not_tried_beside_a_supply(tmp_path: Path, sagged: Columns) -> None:
    (tmp_path / "servos.urdf").write_text(URDF)
    fed = 'supply_voltage = "supply"\nnominal_voltage = 1.0\n'
    file = load_robot(tmp_path / "s.toml", ROBOT_FILE + fed)
    pl.DataFrame(dict(sagged)).write_csv(tmp_path / "log.csv")
    assert file.targets is not None
    logs = read_logs(file, file.targets, log_files([str(tmp_path / "log.csv")]), (), silent)
    job = Job(file, file.targets, arm_step(file.robot), logs, 1, silent)
    start = ActuatorValues.of((1.0, 1.0), **vars(TRUE))
    assert search_of(job, (), start, (0, 1), 0.01).joints["integral"] == []
