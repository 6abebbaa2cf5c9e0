"""Units of positions that are logged at the motors of a robot with a prismatic joint."""

from pathlib import Path

import numpy as np
import pytest

from steelyard.base.errors import ModelError
from steelyard.robot.file.robot_file import load_robot

URDF = """<robot name="gantry"><link name="base"/><link name="slide"/><link name="hand"/>
<joint name="lift" type="prismatic"><parent link="base"/><child link="slide"/><axis xyz="0 0 1"/>
<limit lower="0" upper="1" velocity="1" effort="100"/></joint>
<joint name="turn" type="revolute"><parent link="slide"/><child link="hand"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" velocity="1" effort="100"/></joint></robot>"""
TOML = """[robot]
urdf = "gantry.urdf"
[robot.transmission]
ratios = [300.0, 50.0]
[signals]
time = "t"
coordinates = "COORDINATES"
position = "q{}"
position_unit = "UNIT"
velocity = "v{}"
velocity_unit = "rpm"
[signals.effort]
columns = "tau{}"
kind = "motor_torque"
side = "motor"
unit = "Nm"
"""


def scales(folder: Path, coordinates: str, unit: str) -> tuple[list[float], list[float]]:
    (folder / "gantry.urdf").write_text(URDF)
    path = folder / "gantry.toml"
    path.write_text(TOML.replace("COORDINATES", coordinates).replace("UNIT", unit))
    signals = load_robot(path).signals
    assert signals is not None and signals.velocity_scale is not None
    return signals.position_scale.tolist(), signals.velocity_scale.tolist()


def test_a_motor_in_degrees_may_drive_a_prismatic_joint(tmp_path: Path) -> None:
    position, velocity = scales(tmp_path, "motor", "deg")
    np.testing.assert_allclose(position, [np.pi / 180.0] * 2)
    np.testing.assert_allclose(velocity, [np.pi / 30.0] * 2)
    assert scales(tmp_path, "motor", "mm")[0] == [1e-3, 1e-3]


def test_at_the_joints_a_unit_is_for_those_that_it_measures(tmp_path: Path) -> None:
    position, velocity = scales(tmp_path, "joint", "deg")
    np.testing.assert_allclose(position, [1.0, np.pi / 180.0])
    np.testing.assert_allclose(velocity, [1.0, np.pi / 30.0])


def test_a_unit_that_fits_nothing_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match="'furlong'"):
        scales(tmp_path, "motor", "furlong")
