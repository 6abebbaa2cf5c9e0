"""Robot files of joints that follow position targets: what they may say, and what is refused."""

from pathlib import Path

import pytest
from proofs.support.servo_arm import ROBOT_FILE, URDF

from steelyard.base.errors import ModelError
from steelyard.robot.file.robot_file import load_robot

EFFORT = 'effort = {columns = "tau{}", kind = "joint_torque", unit = "Nm"}\n'


MOTOR = EFFORT.replace("joint_torque", "motor_torque").replace("unit", 'side = "motor", unit')
CURRENT = EFFORT.replace("joint_torque", "motor_current").replace('"Nm"', '"A"')
SUPPLY = 'supply_voltage = "tau1"\nnominal_voltage = 12.0\n'
ANCHOR = 'gain = [1.0, "identify"], unit'
ACTUATOR = '[actuator]\nlaw = "auto"\n'


def loaded(folder: Path, text: str) -> object:
    (folder / "servos.urdf").write_text(URDF)
    return load_robot(folder / "servos.toml", text)


def test_targets_are_read_in_the_unit_of_positions(tmp_path: Path) -> None:
    text = ROBOT_FILE + 'position_unit = "deg"\nposition_sign = [1, -1]\n'
    robot = load_robot(tmp_path / "servos.toml", text) if loaded(tmp_path, text) else None
    assert robot is not None and robot.signals is None and robot.targets is not None
    assert robot.targets.scale == pytest.approx([0.017453, 0.017453], rel=1e-4)
    assert robot.targets.signs == (1, -1) and robot.targets.zeros == (None, None)
    assert robot.targets.columns == ("time", "q1", "q2", "target1", "target2")


def test_beside_efforts_targets_are_the_commanded_motion(tmp_path: Path) -> None:
    (tmp_path / "servos.urdf").write_text(URDF)
    robot = load_robot(tmp_path / "servos.toml", ROBOT_FILE + EFFORT)
    assert robot.targets is None and robot.signals is not None
    assert robot.signals.commanded_position == ("target1", "target2")


def test_where_actuators_are_described_efforts_are_beside_targets(tmp_path: Path) -> None:
    (tmp_path / "servos.urdf").write_text(URDF)
    some = EFFORT.replace('"joint_torque", unit = "Nm"', '"motor_current", unit = "mA"')
    known = some.replace("}\n", ", gain = [1.5, -2.0]}\n")
    supply = 'supply_voltage = "supply"\nnominal_voltage = 12.0\n'
    robot = load_robot(tmp_path / "servos.toml", ROBOT_FILE + supply + some + ACTUATOR)
    assert robot.signals is None and robot.targets is not None
    assert robot.targets.columns[-3:] == ("tau1", "tau2", "supply")
    assert robot.targets.effort_gain == (None, None) and robot.targets.nominal == 12.0
    assert robot.targets.effort_scale == (1e-3, 1e-3) and not robot.targets.effort_at_joint
    robot = load_robot(tmp_path / "servos.toml", ROBOT_FILE + known + ACTUATOR)
    assert robot.targets is not None and robot.targets.effort_gain == (1.5, -2.0)


@pytest.mark.parametrize(
    ("more", "wrong"),
    [
        ('commanded_position = "cmd{}"\n', "commanded_position is given"),
        (EFFORT + 'commanded_position = "cmd{}"\n', "both given"),
        ('velocity = "dq{}"\n', "velocity is given beside target"),
        ('coordinates = "motor"\n', "targets are those of motors"),
        ("[processing]\nmotion_cutoff = 5.0\n", r"\[processing\] is for identification from"),
        ('[model]\nterms = ["rigid_body"]\n', r"\[model\] is for identification from efforts"),
        ('[[knowledge]]\nkind = "total_mass"\nupper = 3.0\n', "is for identification from"),
        (EFFORT + 'velocity = "dq{}"\n' + ACTUATOR, "remove velocity"),
        (EFFORT.replace("joint_t", "gravity_compensated_t") + ACTUATOR, "gravity compensated"),
        (EFFORT.replace("unit", "delay = 0.01, unit") + ACTUATOR, "have a delay"),
        (EFFORT.replace("tau{}", "q{}") + ACTUATOR, "used twice"),
        (EFFORT.replace('"tau{}"', '["time", "tau2"]') + ACTUATOR, "used twice"),
        (MOTOR + ACTUATOR, "no transmission"),
        (CURRENT.replace("unit", ANCHOR) + ACTUATOR, "stands for a scale"),
        (SUPPLY + EFFORT + "[actuator]\n", "used twice"),
        ("[processing]\nmotion_cutoff = 5.0\n[model]\nfriction = 'auto'\n", r"\[model\], \[proc"),
        (EFFORT + 'supply_voltage = "supply"\n', "no actuators are identified"),
        ('supply_voltage = "supply"\n', "supply_voltage is given alone"),
        ("nominal_voltage = 12.0\n", "nominal_voltage is given alone"),
        ('supply_voltage = "q1"\nnominal_voltage = 12.0\n', "used twice"),
        ("[actuator]\nstiffness = 0.0\n", "stiffness"),
        ("[actuator]\ndelay = -1.0\n", "delay"),
        ("position_sign = [1]\n", "1 signs"),
        ("position_offset = [0.0]\n", "1 offsets"),
    ],
)
def test_what_does_not_go_with_targets_is_refused(tmp_path: Path, more: str, wrong: str) -> None:
    with pytest.raises(ModelError, match=wrong):
        loaded(tmp_path, ROBOT_FILE + more)
