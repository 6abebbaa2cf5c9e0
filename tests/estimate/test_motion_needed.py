"""Whether logs contain enough motion for `friction = "auto"`."""

import numpy as np
import pytest

from steelyard.estimate.friction.friction_mixes_and_curves import joint_motions, lacking
from steelyard.robot.robot import Coordinate

STEP = 0.01
T = np.arange(0.0, 20.0, STEP)
ONE = (Coordinate("a", "revolute"),)


def motion(*rows: np.ndarray):
    return np.array(rows), np.zeros(len(T), dtype=int), STEP


def test_reversals_travel_and_speeds_of_a_sine() -> None:
    (found,) = joint_motions([motion(np.cos(2.0 * np.pi * 0.5 * T + 0.3))])
    assert found.reversals == 20
    assert found.travel == pytest.approx(40.0 / np.pi, rel=1e-3)
    assert found.speeds == pytest.approx(np.sin(0.45 * np.pi) / np.sin(0.05 * np.pi), rel=0.2)
    assert not lacking([found], ONE)


@pytest.mark.parametrize(
    ("dq", "words"),
    [
        (1.0 + 0.5 * np.sin(T), "a moves in one direction only"),
        (0.05 * np.cos(2.0 * T), "a travels 0.63 rad (1.5 needed)"),
        (np.sign(np.cos(T)), "a moves at one speed only"),
    ],
)
def test_what_is_missing_is_said(dq: np.ndarray, words: str) -> None:
    assert lacking(joint_motions([motion(dq)]), ONE) == (words,)


def test_motion_of_several_logs_adds_up() -> None:
    once = motion(0.05 * np.cos(2.0 * T))
    assert lacking(joint_motions([once]), ONE)
    assert not lacking(joint_motions([once, once, once]), ONE)


def test_a_prismatic_joint_travels_less() -> None:
    found = joint_motions([motion(0.05 * np.cos(2.0 * T))])
    assert not lacking(found, (Coordinate("a", "prismatic"),))
