"""Robot files of joints that follow position targets: what they may say, and what is refused."""

from pathlib import Path

import pytest
from proofs.support.servo_arm import ROBOT_FILE, URDF

from steelyard.base.errors import ModelError
from steelyard.robot.file.robot_file import load_robot

EFFORT = 'effort = {columns = "tau{}", kind = "joint_torque", unit = "Nm"}\n'


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


@pytest.mark.parametrize(
    ("more", "wrong"),
    [
        ('commanded_position = "cmd{}"\n', "commanded_position is given"),
        (EFFORT + 'commanded_position = "cmd{}"\n', "both given"),
        ('velocity = "dq{}"\n', "velocity is given beside target"),
        ('coordinates = "motor"\n', "targets are those of motors"),
        (EFFORT + '[actuator]\nlaw = "auto"\n', "no position targets without efforts"),
        ("[processing]\nmotion_cutoff = 5.0\n", r"\[processing\] is for logs with efforts"),
        ('[model]\nterms = ["rigid_body"]\n', r"\[model\] is for logs with efforts"),
        ('[[knowledge]]\nkind = "total_mass"\nupper = 3.0\n', "is for logs with efforts"),
        ("[actuator]\nstiffness = 0.0\n", "stiffness"),
        ("[actuator]\ndelay = -1.0\n", "delay"),
        ("position_sign = [1]\n", "1 signs"),
        ("position_offset = [0.0]\n", "1 offsets"),
    ],
)
def test_what_does_not_go_with_targets_is_refused(tmp_path: Path, more: str, wrong: str) -> None:
    with pytest.raises(ModelError, match=wrong):
        loaded(tmp_path, ROBOT_FILE + more)
