"""Motions for robots with a floating base, which hang while they move."""

from pathlib import Path

import pytest

import steelyard
from floating_logs import HAND, IMU, JOINTS, dog, record
from steelyard.base.errors import ModelError
from steelyard.excite.excite import design_task


def test_a_motion_is_for_a_robot_that_hangs_and_says_so(tmp_path: Path) -> None:
    """The same joints with the base fixed; what stands is not covered."""
    file = dog(tmp_path, IMU + HAND)
    found = steelyard.design_excitation(file, motion="sweeps", budget=1.0)
    robot = design_task(file).tables[0].robot
    assert not robot.floating and robot.joint_names == JOINTS
    (gap,) = (g for g in found.designed.certificate.gaps if "hangs" in g)
    assert "'trunk' held still" in gap and "not the base's mass" in gap
    alone = design_task(tmp_path / "dog.xml", fixed_base="floating")
    assert alone.held == gap and set(alone.tables[0].robot.joint_names) == set(JOINTS)


def test_an_earlier_log_of_a_robot_that_floats_is_refused(tmp_path: Path) -> None:
    """Its model has other parameters than one that hangs."""
    log, _ = record(tmp_path)
    file = dog(tmp_path, IMU + HAND)
    model = steelyard.identify(file, log, check=False).model
    with pytest.raises(ModelError, match="beside an earlier log"):
        design_task(file, earlier=model)
