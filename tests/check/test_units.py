"""Units of positions and velocities by names, velocities, ranges and speeds."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from check.test_signals import COLUMNS, DEGREES, DOUBTFUL, ROBOT, WRONG, Q, case_of, scaled, sound
from steelyard.base.arrays import Array
from steelyard.check.all_checks import examine
from steelyard.check.finding import Severity
from steelyard.check.signals.position_unit_and_columns import position_check
from steelyard.check.signals.time_stamps_and_scale import clock_check
from steelyard.check.signals.velocity_check import velocity_check

LIMITS = re.compile(r"\[robot.limits\]\n(joint_.*\n)+")
UNLIMITED = LIMITS.sub("", ROBOT)
LEFT_OUT = UNLIMITED.replace('velocity = "dq{}"\n', "")
IN_DEG = {"position_unit": "deg", "velocity_unit": "deg/s"}


def named(text: str, unit: str) -> tuple[str, tuple[str, ...]]:
    """A robot file and columns whose names end in a unit, such as `q1_deg` and `dq1_deg_s`."""
    text = text.replace('"q{}"', f'"q{{}}_{unit}"').replace('"dq{}"', f'"dq{{}}_{unit}_s"')
    end = {"q": f"_{unit}", "dq": f"_{unit}_s"}
    return text, tuple(name + end.get(name.rstrip("123"), "") for name in COLUMNS)


def units_found(
    folder: Path, table: Array, text: str, columns: tuple[str, ...] = COLUMNS
) -> tuple[Severity, dict[str, Any]]:
    """The worst severity on positions and velocities, and the changes that are proposed."""
    case = case_of(folder, table, text, columns=columns)
    found = examine(case, checks=(clock_check, position_check, velocity_check))
    return found.severity, {edit.path[-1]: edit.value for edit in found.edits}


def in_degrees(table: Array) -> Array:
    table[:, 1:7] *= DEGREES
    return table


def turning(table: Array, turns: float = 10.0) -> Array:
    """Joint 3 turns round besides."""
    inside = np.clip((table[:, 0] - 2.0) / 16.0, 0.0, 1.0)
    phase, angle = 2.0 * np.pi * inside, 2.0 * np.pi * turns
    table[:, 3] += angle * (inside - np.sin(phase) / (2.0 * np.pi))
    table[:, 6] += angle / 16.0 * (1.0 - np.cos(phase))
    return table


def alone(table: Array, rest: float = 0.0) -> Array:
    """Only joint 2 moves."""
    table[:, [1, 3]], table[:, [4, 6]] = rest, 0.0
    return table


@pytest.mark.parametrize("text", [ROBOT, UNLIMITED, LEFT_OUT])
@pytest.mark.parametrize("unit", ["rad", "deg"])
def test_degrees_are_recognised_whatever_the_columns_are_called(
    tmp_path: Path, text: str, unit: str
) -> None:
    severity, edits = units_found(tmp_path, in_degrees(sound()), *named(text, unit))
    if (
        unit == "rad" and text == UNLIMITED
    ):  # names and velocities speak for rad, only speed against
        assert (severity, edits) == (DOUBTFUL, {})
    else:
        wanted = {"position_unit": "deg"} if text == LEFT_OUT else IN_DEG
        assert (severity, edits) == (WRONG, wanted)


@pytest.mark.parametrize("unit", ["rad", "deg"])
def test_radians_declared_as_degrees_are_distinguished_by_velocities(
    tmp_path: Path, unit: str
) -> None:
    text = ROBOT.replace('position = "q{}"', 'position = "q{}"\nposition_unit = "deg"')
    text, columns = named(text, unit)
    text, columns = text.replace(f"_{unit}_s", ""), tuple(c.removesuffix("_s") for c in columns)
    columns = tuple(c.removesuffix(f"_{unit}") if c[0] == "d" else c for c in columns)
    found = units_found(tmp_path, sound(), text, columns)
    assert found == (WRONG, {"position_unit": "rad"})


@pytest.mark.parametrize("text", [UNLIMITED, LEFT_OUT])
def test_a_joint_without_limits_may_turn_as_far_as_it_likes(tmp_path: Path, text: str) -> None:
    assert units_found(tmp_path, turning(sound()), text) == (Severity.OK, {})
    declared = text.replace('position = "q{}"', 'position = "q{}"\nposition_unit = "deg"').replace(
        'velocity = "dq{}"', 'velocity = "dq{}"\nvelocity_unit = "deg/s"'
    )
    assert units_found(tmp_path, in_degrees(turning(sound())), declared) == (Severity.OK, {})
    assert units_found(tmp_path, turning(sound(), 20.0), text) == (Severity.OK, {})


def test_a_joint_with_limits_may_not(tmp_path: Path) -> None:
    assert units_found(tmp_path, turning(sound()), ROBOT)[0] != Severity.OK


@pytest.mark.parametrize("lines", ["", 'velocity = "dq{}"\n'])
def test_placeholders_for_limits_of_speed_say_little(tmp_path: Path, lines: str) -> None:
    text = re.sub(r"velocity = [\d.]+}", "velocity = 0.1}", ROBOT)
    text = text.replace('velocity = "dq{}"\n', lines)
    assert units_found(tmp_path, sound(), text) == (Severity.OK, {})
    edits = IN_DEG if lines else {"position_unit": "deg"}
    assert units_found(tmp_path, in_degrees(sound()), text) == (WRONG, edits)


@pytest.mark.slow
@pytest.mark.parametrize("text", [ROBOT, UNLIMITED, LEFT_OUT])
@pytest.mark.parametrize("rest", [0.0, 0.01, 0.3])
def test_joints_that_rest_have_the_units_of_the_one_that_moves(
    tmp_path: Path, text: str, rest: float
) -> None:
    assert units_found(tmp_path, alone(sound(), rest), text) == (Severity.OK, {})
    wanted = {"position_unit": "deg"} if text == LEFT_OUT else IN_DEG
    assert units_found(tmp_path, in_degrees(alone(sound(), rest)), text) == (WRONG, wanted)


@pytest.mark.slow
def test_units_are_the_same_for_all_joints_where_two_readings_fit_alike(tmp_path: Path) -> None:
    text = LEFT_OUT.replace('position = "q{}"', 'position = "q{}"\nposition_unit = "deg"')
    case = case_of(tmp_path, sound(), text, guesses=True)
    found = examine(case, checks=(clock_check, position_check, velocity_check))
    assert all(isinstance(edit.value, str) for edit in found.edits)
    mixed = text.replace('"deg"', '["rad", "deg", "rad"]')
    assert units_found(tmp_path, scaled(2, DEGREES)(sound()), mixed) == (Severity.OK, {})


@pytest.mark.parametrize("limits", ["joint_2 = {lower = -0.8, upper = 0.8, velocity = 1.0}\n", ""])
def test_millimetres_are_recognised(tmp_path: Path, limits: str) -> None:
    text = LIMITS.sub("", ROBOT).replace("{a = 0.2,", '{kind = "prismatic", a = 0.2,')
    text = text.replace('"Nm"', '["Nm", "N", "Nm"]')
    text = text.replace("[signals]", f"[robot.limits]\n{limits}\n[signals]", 1)
    table = sound()
    table[:, [2, 5]] *= 0.5
    assert units_found(tmp_path, table.copy(), text) == (Severity.OK, {})
    table[:, [2, 5]] *= 1e3
    edits = {"position_unit": "mm", "velocity_unit": "mm/s"}
    assert units_found(tmp_path, table, text) == (WRONG, edits)


def test_exchanged_columns_of_a_sliding_and_a_turning_joint_are_no_unit(tmp_path: Path) -> None:
    text = LIMITS.sub("", ROBOT).replace("{a = 0.2,", '{kind = "prismatic", a = 0.2,')
    text = text.replace('"Nm"', '["Nm", "N", "Nm"]')
    limits = (
        "joint_2 = {lower = 0.0, upper = 0.03, velocity = 0.1}\n"
        "joint_3 = {lower = -3.0, upper = 3.0, velocity = 4.0}\n"
    )
    text = text.replace("[signals]", f"[robot.limits]\n{limits}\n[signals]", 1)
    table = sound()
    table[:, [2, 5]] *= 0.015 / np.abs(table[:, 2]).max()
    table[:, 2] += 0.015
    assert units_found(tmp_path, table.copy(), text) == (Severity.OK, {})
    table[:, [2, 3, 5, 6]] = table[:, [3, 2, 6, 5]]
    case = case_of(tmp_path, table, text, columns=COLUMNS)
    found = examine(case, checks=(clock_check, position_check))
    assert (found.severity, found.edits) == (DOUBTFUL, ())
    (one,) = (f for f in found.findings if f.severity)
    assert one.fix is not None and "compare the order of columns" in one.fix.says


@pytest.mark.slow
def test_positions_called_motors_are_not_taken_for_degrees(tmp_path: Path) -> None:
    text = LEFT_OUT.replace('"q{}"', '"q_motor{}"')
    columns = tuple(c.replace("q", "q_motor") if c[0] == "q" else c for c in COLUMNS)
    assert units_found(tmp_path, scaled(Q, 100.0)(sound()), text, columns) == (WRONG, {})
    assert units_found(tmp_path, sound(), text, columns) == (Severity.OK, {})
