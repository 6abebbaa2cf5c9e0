"""Efforts and a supply voltage logged beside targets: scale of torques, gains, what is refused."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from proofs.support.servo_arm import ROBOT_FILE, URDF, Servos, log

import steelyard
from steelyard.actuators.actuator_model import EffortGain, arm_step
from steelyard.actuators.actuator_parameters import ActuatorValues
from steelyard.actuators.actuators_page import ActuatorIdentification
from steelyard.actuators.logged_efforts import Factor, factors
from steelyard.actuators.read_targets import read_targets
from steelyard.actuators.target_runs import TargetRun, windows_of
from steelyard.base.errors import LogError
from steelyard.robot.file.robot_file import load_robot
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
    return log(TRUE, 36.0, 3)


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
    (scale,) = [f for f in checked.content.diagnosis.findings if f.check == "scale"]
    assert "logged efforts (shoulder, elbow)" in scale.says


def test_a_stated_stiffness_wins_over_efforts(tmp_path: Path, measured: Columns) -> None:
    stated = PD + "stiffness = [6.0, 4.0]\n"
    found = identified(tmp_path, measured, efforts("motor_torque", "Nm"), actuator=stated)
    assert found.model.values["stiffness"].tolist() == [6.0, 4.0]
    assert not found.model.measured


def test_currents_get_gains_and_wrong_signs_are_named(tmp_path: Path, measured: Columns) -> None:
    drives = {**measured, "tau1": measured["tau1"] / -1.7e-3, "tau2": -measured["tau2"]}
    found = identified(tmp_path, drives, efforts("motor_current", "mA", '["identify", 1e3]'))
    one, other = found.model.efforts
    assert one.status == "identified" and one.unit == "Nm/A"
    assert one.value == pytest.approx(-1.7, rel=0.02)
    assert one.interval is not None and one.interval[0] < one.value < one.interval[1]
    assert other.status == "contradicted"
    assert any("elbow count against the joint" in note for note in found.notes)
    assert not found.model.measured and holds(found, "stiffness", 1, 0.03)
    assert "Nm/A" in str(found) and "scale of the masses" in found.basis[0]
    assert "Logged efforts" in found.report()
    motion = {name: x for name, x in measured.items() if not name.startswith("tau")}
    pl.DataFrame(motion).write_csv(tmp_path / "motion.csv")
    scored = steelyard.validate_actuators(found.model, tmp_path / "motion.csv")
    assert scored.validation[0].rms.max() < 1.5e-3
    assert found.to_dict()["efforts"][0]["status"] == "identified"


def shown(folder: Path, columns: Columns, kind: str, unit: str) -> Mapping[int, Factor]:
    """Efforts per torque of the true law."""
    (folder / "servos.urdf").write_text(URDF)
    file = load_robot(folder / "s.toml", ROBOT_FILE + efforts(kind, unit, '"identify"') + PD)
    assert file.targets is not None
    q, target, torque = (
        np.stack([columns[f"{name}{j}"] for j in (1, 2)], axis=1) for name in ("q", "target", "tau")
    )
    run = TargetRun("log", columns["time"], target, q, effort=torque)
    values = ActuatorValues.of((1.0, 1.0), **vars(TRUE))
    return factors(arm_step(file.robot), windows_of([run], 4.0), values, file.targets, 1)


def test_loads_without_signs_count_and_noise_does_not(tmp_path: Path, measured: Columns) -> None:
    rng = np.random.default_rng(0)
    noise = rng.normal(size=len(measured["time"]))
    loads = {**measured, "tau1": np.round(np.abs(measured["tau1"]) / 0.017), "tau2": noise}
    found = shown(tmp_path, loads, "motor_current", "%")
    assert found.keys() == {0} and found[0].unsigned
    assert found[0].value == pytest.approx(1.0 / 0.017, rel=0.02)


def test_sensors_at_the_joint_lack_friction_and_rotor(tmp_path: Path, measured: Columns) -> None:
    changed = dict(measured)
    for j, coulomb in enumerate(TRUE.coulomb, start=1):
        v = np.gradient(measured[f"q{j}"], measured["time"])
        changed[f"tau{j}"] = 2.0 * (measured[f"tau{j}"] - coulomb * np.tanh(v / 0.05))
    at_joint, of_motor = (
        shown(tmp_path, changed, kind, unit)[0].value
        for kind, unit in (("joint_torque", "Nm"), ("motor_torque", "Nm"))
    )
    assert at_joint == pytest.approx(2.0, rel=0.03)
    assert abs(of_motor - 2.0) > 2.0 * abs(at_joint - 2.0)


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
    [{"value": "x"}, {"interval": [1.0]}, {"unit": 3}, {"value": float("inf")}],
)
def test_damaged_gains_are_refused(damage: dict[str, object]) -> None:
    whole = EffortGain("elbow", "Nm/A", 1.7, (1.6, 1.8), "identified").to_dict()
    assert EffortGain.from_dict(whole).interval == (1.6, 1.8)
    with pytest.raises((ValueError, TypeError)):
        EffortGain.from_dict({**whole, **damage})
