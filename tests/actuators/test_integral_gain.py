"""Controllers with an integral gain: what they hold when a rollout begins, found, and refused."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest
from proofs.support.servo_arm import ROBOT_FILE, URDF, Servos, log, simulated, targets

import steelyard
from steelyard.actuators.actuator_model import arm_step
from steelyard.actuators.actuator_parameters import ActuatorValues
from steelyard.actuators.choice import FIRST, POSSIBLE
from steelyard.actuators.integral_state import integral_torques
from steelyard.actuators.target_runs import TargetRun
from steelyard.base.errors import ModelError
from steelyard.export.model_files.actuators_mjcf import actuators_mjcf
from steelyard.robot.file.robot_file import load_robot

TRUE = Servos(integral=(20.0, 15.0))
JOINTS = ("shoulder", "elbow")
KNOWN = "position_sign = [1, 1]\nposition_offset = [0.0, 0.0]\n"
PD = '[actuator]\nlaw = "position_pd"\n'


def test_what_integrals_hold_is_that_of_the_simulated_controllers(tmp_path: Path) -> None:
    (tmp_path / "servos.urdf").write_text(URDF)
    step = arm_step(load_robot(tmp_path / "servos.urdf").robot)
    servos = Servos(integral=(20.0, 15.0), delay=0.0)
    t, target = targets(40.0, 2, rate=200.0)
    q, torque = simulated(servos, t, target, 2.5e-4)
    v = np.gradient(q, t, axis=0)
    late = target[np.clip(np.arange(len(t)) - 1, 0, None)]
    held = torque - np.array(servos.stiffness) * (late - q) + np.array(servos.damping) * v
    values = ActuatorValues.of((1.0, 1.0), **vars(servos))
    rows = np.arange(100, len(t) - 100, 50).tolist()
    found = integral_torques(step, values, TargetRun("log", t, target, q), rows)
    smooth = np.stack([held[r - 3 : r + 4].mean(axis=0) for r in rows])
    off = found - smooth  # targets are steps, by which torques of single rows differ
    assert (np.abs(off.mean(axis=0)) < 0.08 * smooth.std(axis=0)).all()
    assert (off.std(axis=0) < 0.25 * smooth.std(axis=0)).all()
    (first,) = integral_torques(step, values, TargetRun("log", t, target, q), [0])
    assert first == pytest.approx(held[0], abs=0.05)
    none = values.changed(integral=0.0)
    assert not integral_torques(step, none, TargetRun("log", t, target, q), rows).any()


def test_an_integral_gain_is_found(tmp_path: Path) -> None:
    (tmp_path / "servos.urdf").write_text(URDF)
    (tmp_path / "servos.toml").write_text(ROBOT_FILE + KNOWN + PD + 'integral = "identify"\n')
    pl.DataFrame(dict(log(TRUE, 40.0, 5, step=2e-4))).write_csv(tmp_path / "log.csv")
    found = steelyard.identify_actuators(tmp_path / "servos.toml", tmp_path / "log.csv")
    values = {(p.name, p.joint): p for p in found.parameters}
    for name in ("stiffness", "integral", "coulomb"):
        for joint, true in zip(JOINTS, vars(TRUE)[name], strict=True):
            one = values[name, joint]
            assert one.status == "identified" and one.value == pytest.approx(true, rel=0.06), one
    assert found.fitted[0].rms.max() < 1.5e-3
    assert "integral gain" in str(found) and "integral" in found.report()
    assert any("integral gain" in words for words in actuators_mjcf(found.model).unsupported)


def test_the_choice_of_the_law_begins_with_it() -> None:
    assert FIRST[0] == "integral" and set(FIRST) < set(POSSIBLE)


def test_beside_a_supply_it_is_refused(tmp_path: Path) -> None:
    (tmp_path / "servos.urdf").write_text(URDF)
    fed = 'supply_voltage = "supply"\nnominal_voltage = 1.0\n'
    (tmp_path / "servos.toml").write_text(ROBOT_FILE + fed + PD + "integral = 3.0\n")
    pl.DataFrame(dict(log(Servos(), 36.0, 5, step=1e-3, supply=lambda t: 1.0))).write_csv(
        tmp_path / "log.csv"
    )
    with pytest.raises(ModelError, match="integral gain beside a supply"):
        steelyard.identify_actuators(tmp_path / "servos.toml", tmp_path / "log.csv")
