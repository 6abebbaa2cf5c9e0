"""What a robot file may say of a floating base, and what is refused."""

from pathlib import Path

import pytest

from floating_logs import FLAG, HAND, IMU, TRACKED, dog
from steelyard.base.errors import ModelError
from steelyard.robot.file.robot_file import load_robot

IN_WORLD = HAND + 'axes = "world"\n'


@pytest.mark.parametrize(
    ("base", "wrong", "fix"),
    [
        (
            "",
            "the base floats, and its motion is not given",
            "add [signals.base] with acceleration",
        ),
        ("[signals.base]\n", "an acceleration or a position, one of them", "of an accelerometer"),
        (IMU + 'position = "p_{}"\n', "an acceleration or a position, one of them", "acc_{}"),
        (
            '[signals.base]\nacceleration = "acc_{}"\n',
            "neither an angular velocity nor an orientation",
            "of a gyroscope",
        ),
        (
            '[signals.base]\nposition = "p_{}"\nangular_velocity = "gyro_{}"\n',
            "a position, but no orientation",
            "of the same marker body",
        ),
        (
            TRACKED + 'angular_velocity = "gyro_{}"\n',
            "a position and an angular velocity",
            "leave the angular velocity out",
        ),
        (
            TRACKED + "acceleration_bias = [0.1, 0.0, 0.0]\n",
            "acceleration_bias is given, but no acceleration",
            "remove acceleration_bias",
        ),
        (
            TRACKED + "angular_velocity_bias = [0.1, 0.0, 0.0]\n",
            "angular_velocity_bias is given, but no angular velocity",
            "remove angular_velocity_bias",
        ),
        (IMU + "mounting = {yaw = 90.0}\n", "has a frame and a mounting", "keep one of them"),
        (IMU + IN_WORLD, "the base has no orientation", "along the axes of its frame"),
        (IMU.replace('"imu"', '"fore_foot"'), "'fore_foot' is not fixed to the base", "imu"),
        (IMU.replace('"acc_{}"', '"acc"'), "1 columns are given for x, y, z", "list 3 columns"),
        (IMU.replace("gyro_", "acc_"), "column 'acc_x' is used twice", "a column of its own"),
        (IMU + HAND.replace("handle", "hand"), "no link 'hand'", "'handle'"),
        (TRACKED.replace("xyzw", "rpy_deg"), "", ""),
        (IMU + FLAG, "", ""),
        (IMU + FLAG + 'force = "f_{}"\n', "a force or a flag, one of them", "where only contact"),
        (IMU + HAND + "sole = true\n", "one of them, with force and sole", "touching = "),
        (IMU + FLAG + "radius = 0.02\n", "has a radius, but the base has no", "the position"),
        (IMU + FLAG + FLAG, "column 'fore_load' is used twice", "a column of its own"),
        (TRACKED + FLAG + "radius = 0.02\nsole = true\n", "is a sole and a ball", "not both"),
    ],
)
def test_bases_that_are_not_clear(base: str, wrong: str, fix: str, tmp_path: Path) -> None:
    path = dog(tmp_path, base)
    if not wrong:
        assert load_robot(path).robot.floating
        return
    with pytest.raises(ModelError) as caught:
        load_robot(path)
    assert wrong in caught.value.wrong and fix in caught.value.fix
    assert "dog.toml" in caught.value.where


@pytest.mark.parametrize(
    ("old", "new", "wrong"),
    [
        ('base = "floating"', 'base = "trunk"', "the base is at rest"),
        ('"joint_torque"', '"gravity_compensated_torque"', "gravity compensated efforts are not"),
        ("[signals]", '[processing]\nrepetitions = "find"\n[signals]', "repetitions of a motion"),
        ('position = "q_', 'target = "t_{}"\nposition = "q_', "nobody commands a base"),
        ('unit = "Nm"', 'unit = "A"\ngain = "identify"', "beside contacts"),
    ],
)
def test_what_does_not_go_with_a_floating_base(
    old: str, new: str, wrong: str, tmp_path: Path
) -> None:
    path = dog(tmp_path, IMU + HAND)
    text = path.read_text()
    assert old in text
    new = new.replace('unit = "A"', 'unit = "A"')
    path.write_text(text.replace(old, new).replace(
        '"joint_torque"', '"motor_current"' if "identify" in new else '"joint_torque"'
    ))  # fmt: skip
    with pytest.raises(ModelError) as caught:
        load_robot(path)
    assert wrong in f"{caught.value.wrong}; {caught.value.fix}"


def test_velocities_are_not_used(tmp_path: Path) -> None:
    path = dog(tmp_path, IMU)
    path.write_text(
        path.read_text().replace("[signals.effort]", 'velocity = "v_{}"\n[signals.effort]')
    )
    loaded = load_robot(path)
    assert loaded.signals is not None and loaded.signals.velocity is None
    assert "velocity columns are not used" in loaded.notes[-1]


def test_gears_and_offsets_are_those_of_the_joints(tmp_path: Path) -> None:
    rows = "[[10, 0, 0, 0], [0, 10, 0, 0], [0, 3, 10, 0], [0, 0, 0, 10]]"
    gears = f"[robot.transmission]\nmatrix = {rows}\n"
    path = dog(tmp_path, IMU + HAND, gears)
    text = path.read_text().replace('"joint_torque"', '"motor_torque"\nside = "motor"')
    text = text.replace(
        "[signals.effort]",
        'coordinates = "motor"\nposition_offset = [0, 0.1, 0, 0]\n[signals.effort]',
    )
    path.write_text(text)
    loaded = load_robot(path)
    signals = loaded.signals
    assert signals is not None and signals.position_map is not None
    assert signals.effort_map is not None and signals.effort_map[7, 8] == 3.0
    assert (signals.position_map[:6, :6] == 1.0 * (signals.position_map[:6, :6] > 0)).all()
    assert signals.position_offset is not None and signals.position_offset[7] == 0.1
    assert signals.unactuated == tuple(range(6))
