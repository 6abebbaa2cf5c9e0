"""Checks that need no model, on an invented log with one fault at a time."""

import re
from collections.abc import Callable
from dataclasses import replace
from itertools import permutations
from math import inf
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from steelyard.base.arrays import Array
from steelyard.check.all_checks import CHECKS, OF_SIGNALS, Diagnosis, examine
from steelyard.check.cases_and_checks import Case, CheckedLog
from steelyard.check.finding import Finding, Severity, percent_of
from steelyard.check.signals.corrupt_and_repeated_rows import (
    corrupt_rows_check,
    repeated_rows_check,
)
from steelyard.check.signals.measured_signals import (
    noise_check,
    saturation_check,
    signed_efforts_check,
)
from steelyard.check.signals.motion_units import JointFacts, unit_reading
from steelyard.check.signals.movement_rests_and_moving_base import excitation_check, rests_check
from steelyard.check.signals.position_unit_and_columns import position_check
from steelyard.check.signals.time_stamps_and_scale import clock_check
from steelyard.check.signals.velocity_check import velocity_check
from steelyard.logs.clocks_and_combined_logs import Numbered
from steelyard.logs.log_and_errors import Cut, Log
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.file.signals import ROW, VELOCITY_UNITS
from steelyard.robot.file.toml_edits import edited
from steelyard.robot.init.column_names import Column
from steelyard.robot.robot import Coordinate, Limits
from steelyard.runs.processing_choices import Processing
from steelyard.runs.recording import LogInMemory, Recording

OWN = (
    clock_check,
    corrupt_rows_check,
    repeated_rows_check,
    noise_check,
    saturation_check,
    signed_efforts_check,
    rests_check,
    excitation_check,
    position_check,
    velocity_check,
)
ROBOT = """[robot]
name = "invented"

[robot.dh]
convention = "modified"
links = [{d = 0.3, mass = 4.0}, {a = 0.2, mass = 2.0}, {a = 0.3, alpha = 1.0, mass = 1.0}]

[robot.limits]
joint_1 = {lower = -2.9, upper = 2.9, velocity = 2.5}
joint_2 = {lower = -2.0, upper = 2.0, velocity = 2.5}
joint_3 = {lower = -2.9, upper = 2.9, velocity = 3.0}

[signals]
time = "time"
position = "q{}"
velocity = "dq{}"

[signals.effort]
columns = "tau{}"
kind = "joint_torque"
unit = "Nm"
"""
COLUMNS = ("time", *(f"{what}{k}" for what in ("q", "dq", "tau") for k in (1, 2, 3)))
Q, DQ, TAU = slice(1, 4), slice(4, 7), slice(7, 10)
Change = Callable[[Array], Array]


def sound(rate: float = 100.0, duration: float = 20.0, seed: int = 0) -> Array:
    """A log of three joints on sines, with a little jitter, noise, rounding; rests at its ends."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(duration * rate)) / rate
    t = t + 0.03 / rate * rng.normal(size=len(t))
    inside = np.clip(t - 2.0, 0.0, duration - 4.0)
    ramp = ((t > 2.0) & (t < duration - 2.0)).astype(np.float64)[:, None]
    turn = np.array([[0.25, 0.5], [0.3125, 0.625], [0.1875, 0.75]]) * 2.0 * np.pi
    size = np.array([[0.9, 0.2], [0.7, 0.15], [1.0, -0.2]])
    phase = turn * inside[:, None, None]
    q = (size * np.sin(phase)).sum(axis=2)
    dq = ramp * (size * turn * np.cos(phase)).sum(axis=2)
    tau = 20.0 * np.cos(q) + 3.0 * dq + 0.2 * rng.normal(size=q.shape)
    table = np.column_stack((t, q, dq, tau))
    table[:, 1:] += 1e-5 * rng.normal(size=(len(t), 9))
    return np.round(table, 6)


def case_of(
    folder: Path,
    table: Array,
    text: str = ROBOT,
    guesses: bool = False,
    columns: tuple[str, ...] = COLUMNS,
) -> Case:
    """The robot file and one log."""
    path = folder / "robot.toml"
    path.write_text(text)
    loaded = load_robot(path)
    assert loaded.signals is not None
    log: Log = LogInMemory(folder / "run.csv", columns, table)
    if loaded.signals.time == ROW:
        log = Numbered(log)
    known = {"velocity": COLUMNS[DQ]} if guesses else {}
    checked = CheckedLog(Recording(log, loaded.signals), Processing(), "run")
    return Case(loaded, (checked,), None, known)


def diagnosis(folder: Path, table: Array, text: str = ROBOT) -> Diagnosis:
    return examine(case_of(folder, table, text), checks=OWN)


def of(found: Diagnosis, check: str) -> Finding:
    return next(f for f in found.findings if f.check == check)


def scaled(columns: slice | int, factor: float) -> Change:
    def change(table: Array) -> Array:
        table[:, columns] *= factor
        return table

    return change


def swapped(table: Array) -> Array:
    table[:, [4, 6]] = table[:, [6, 4]]
    return table


def late(table: Array) -> Array:
    table[5:, DQ] = table[:-5, DQ].copy()
    return table[5:]


def jittery(table: Array) -> Array:
    table[:, 0] += 0.0025 * np.random.default_rng(1).normal(size=len(table))
    return table


def frozen(table: Array) -> Array:
    """The encoder of the second joint, and its velocity, stand still for 6 s."""
    table[700:1300, 2], table[700:1300, 5] = table[700, 2], 0.0
    return table


def lost_in_bursts(table: Array) -> Array:
    """Rows are lost for 0.8 s, three times; the time is written anew."""
    keep = np.ones(len(table), dtype=bool)
    for start in (450, 905, 1310):
        keep[start : start + 80] = False
    table = table[keep]
    table[:, 0] = np.arange(len(table)) / 100.0
    return table


def gappy(table: Array) -> Array:
    keep = np.ones(len(table), dtype=bool)
    for start in (500, 900, 1300):
        keep[start : start + 12] = False
    return table[keep]


def backward(table: Array) -> Array:
    table[[700, 1000], 0] -= 0.05
    return table


def stamped_twice(table: Array) -> Array:
    table[::20, 0] = table[1::20, 0]
    return table


def corrupt(table: Array) -> Array:
    rows = np.random.default_rng(2).choice(len(table), len(table) // 10, replace=False)
    table[rows, 1:] = 1e200
    table[rows[::2], 3] = np.nan
    return table


def read_too_often(table: Array) -> Array:
    table[1::2, 1:] = table[::2, 1:]
    return table


def coarse(table: Array) -> Array:
    table[:, 8] = np.round(table[:, 8] / 2.0) * 2.0
    return table


def noisy(table: Array) -> Array:
    table[:, 7] = 10.0 * np.random.default_rng(3).normal(size=len(table))
    return table


def constant(table: Array) -> Array:
    table[:, 8] = 0.0
    return table


def clipped(table: Array) -> Array:
    table[:, 9] = np.minimum(table[:, 9], np.quantile(table[:, 9], 0.95))
    return table


def resting(table: Array) -> Array:
    start = table[:1].repeat(16000, axis=0)
    start[:, 0] = table[0, 0] - 0.01 * np.arange(16000, 0, -1)
    start[:, 1:] += 1e-5 * np.random.default_rng(4).normal(size=(16000, 9))
    return np.concatenate((start, table))


def still(table: Array) -> Array:
    table[:, [2, 5]] = 1e-5 * np.random.default_rng(5).normal(size=(len(table), 2))
    return table


def absolute(table: Array) -> Array:
    table[:, 7:] = np.abs(table[:, 7:] - 18.0)
    return table


SIGNALS = "signals"
DEGREES = 180.0 / np.pi
WITHOUT = {"velocity": None, "velocity_unit": None, "velocity_sign": None}
WRONG, DOUBTFUL = Severity.WRONG, Severity.DOUBTFUL
FAULTS: dict[str, tuple[Change, str, Severity, dict[str, Any], tuple[int, ...]]] = {
    "milliseconds": (scaled(0, 1e3), "clock", WRONG, {"time_unit": "ms"}, ()),
    "microseconds": (scaled(0, 1e6), "clock", WRONG, {"time_unit": "us"}, ()),
    "jitter": (jittery, "clock", DOUBTFUL, {}, ()),
    "gaps": (gappy, "clock", DOUBTFUL, {}, ()),
    "backward": (backward, "clock", DOUBTFUL, {}, ()),
    "repeated stamps": (stamped_twice, "clock", DOUBTFUL, {}, ()),
    "corrupt rows": (corrupt, "rows", DOUBTFUL, {}, ()),
    "repeated rows": (read_too_often, "repeats", DOUBTFUL, {}, ()),
    "few levels": (coarse, "noise", DOUBTFUL, {}, (2,)),
    "constant": (constant, "noise", WRONG, {}, (2,)),
    "noise": (noisy, "noise", DOUBTFUL, {}, (1,)),
    "cut off": (clipped, "saturation", DOUBTFUL, {}, (3,)),
    "absolute": (absolute, "signed efforts", DOUBTFUL, {}, (1, 2, 3)),
    "mostly rest": (resting, "rests", DOUBTFUL, {}, ()),
    "one joint still": (still, "excitation", DOUBTFUL, {}, (2,)),
    "degrees": (scaled(Q, DEGREES), "position", WRONG, {"position_unit": "deg"}, (1, 2, 3)),
    "one in degrees": (
        scaled(2, DEGREES),
        "position",
        WRONG,
        {"position_unit": ["rad", "deg", "rad"]},
        (2,),
    ),
    "deg/s": (scaled(DQ, DEGREES), "velocity", WRONG, {"velocity_unit": "deg/s"}, (1, 2, 3)),
    "rpm": (scaled(DQ, 30.0 / np.pi), "velocity", WRONG, {"velocity_unit": "rpm"}, (1, 2, 3)),
    "turned": (scaled(5, -1.0), "velocity", WRONG, {"velocity_sign": [1, -1, 1]}, (2,)),
    "swapped": (swapped, "velocity", WRONG, {"velocity": ["dq3", "dq2", "dq1"]}, (1, 3)),
    "too large": (scaled(4, 1.5), "velocity", WRONG, WITHOUT, (1,)),
    "late": (late, "velocity", DOUBTFUL, WITHOUT, (1, 2, 3)),
}


@pytest.mark.parametrize("cut", [(250, 1750), (237, 1700)])
def test_a_log_that_only_moves_has_no_rest(tmp_path: Path, cut: tuple[int, int]) -> None:
    found = of(diagnosis(tmp_path, sound()[slice(*cut)]), "rests")
    assert found.says == "no standstill" and found.figure.startswith("0.0 % at rest")


def test_joints_that_turn_round_together_do_not_rest(tmp_path: Path) -> None:
    table = sound()
    t = table[:, 0]
    for joint in range(3):
        table[:, 1 + joint] = np.cos(2.0 * np.pi * 0.25 * t)
        table[:, 4 + joint] = -0.5 * np.pi * np.sin(2.0 * np.pi * 0.25 * t)
    assert of(diagnosis(tmp_path, table), "rests").says == "no standstill"


def test_they_are_registered_and_quick() -> None:
    assert set(OWN) <= set(CHECKS)
    assert all(s.quick for s in OWN)
    assert {check for _, check, *_ in FAULTS.values()} == {s.name for s in OWN}
    elsewhere = {"set points", "computed efforts"}  # tested in files of their own
    assert {s.name for s in OF_SIGNALS} == {s.name for s in OWN} | elsewhere


@pytest.mark.parametrize("seed", range(5))
def test_a_sound_log_is_ok(tmp_path: Path, seed: int) -> None:
    found = diagnosis(tmp_path, sound(seed=seed))
    assert [f.says for f in found.findings if f.severity] == []
    assert [f.check for f in found.findings] == [s.name for s in OWN]
    ends = re.findall(r"([\d.]+) s(?: of it)? at", of(found, "rests").says)
    assert [float(end) for end in ends] == pytest.approx([2.0, 2.0], abs=0.11)
    assert found.edits == ()


@pytest.mark.slow
@pytest.mark.parametrize("fault", list(FAULTS))
def test_a_fault_is_found_alone_with_its_fix_and_a_small_picture(
    tmp_path: Path, fault: str
) -> None:
    change, check, severity, edits, joints = FAULTS[fault]
    table = change(sound())
    found = diagnosis(tmp_path, table)
    about = of(found, check)
    assert about.severity == severity
    assert about.joints == tuple(f"joint_{k}" for k in joints)
    assert about.fix is not None
    assert {e.path: e.value for e in about.fix.edits} == {
        (SIGNALS, key): value for key, value in edits.items()
    }
    assert [f.check for f in found.findings if f.severity] == [check]
    if edits:
        corrected = diagnosis(tmp_path, table, edited(ROBOT, about.fix.edits))
        assert corrected.severity == Severity.OK
    assert about.picture is not None
    for finding in found.findings:
        for trace in finding.picture.traces if finding.picture else ():
            assert len(trace.x) == len(trace.y) <= 2000
            assert len(trace.x) > 0


@pytest.mark.parametrize("fault", ["milliseconds", "microseconds", "degrees", "one in degrees"])
def test_units_are_distinguished_without_velocities(tmp_path: Path, fault: str) -> None:
    change, check, severity, edits, _ = FAULTS[fault]
    text = ROBOT.replace('velocity = "dq{}"\n', "")
    found = diagnosis(tmp_path, change(sound()), text)
    about = of(found, check)
    assert about.severity == severity
    assert about.fix is not None
    assert {e.path[-1]: e.value for e in about.fix.edits} == edits
    assert not any(f.check == "velocity" for f in found.findings)


@pytest.mark.parametrize(
    ("line", "change", "edit"),
    [
        ('time_unit = "ms"', scaled(0, 1.0), ("time_unit", "s")),
        ('position_unit = "deg"', scaled(0, 1.0), ("position_unit", "rad")),
        ('velocity_unit = "rpm"', scaled(0, 1.0), ("velocity_unit", "rad/s")),
        ('velocity_unit = "deg/s"', scaled(DQ, 30.0 / np.pi), ("velocity_unit", "rpm")),
        ("velocity_sign = [1, 1, -1]", scaled(0, 1.0), ("velocity_sign", [1, 1, 1])),
    ],
)
def test_units_that_are_declared_wrongly(
    tmp_path: Path, line: str, change: Change, edit: tuple[str, Any]
) -> None:
    text = ROBOT.replace('position = "q{}"', f'position = "q{{}}"\n{line}')
    found = diagnosis(tmp_path, change(sound()), text)
    assert found.severity == Severity.WRONG
    assert {e.path: e.value for e in found.edits} == {(SIGNALS, edit[0]): edit[1]}


@pytest.mark.parametrize("declared", [50.0, 200.0, 1000.0, 10.0])
@pytest.mark.parametrize("used", [True, False])
def test_a_wrong_rate_is_found_by_the_velocities(
    tmp_path: Path, declared: float, used: bool
) -> None:
    text = ROBOT.replace('time = "time"', f"rate = {declared}")
    columns = tuple(f"{c}_rad_s" if c.startswith("dq") else c for c in COLUMNS)
    text = text.replace('velocity = "dq{}"\n', 'velocity = "dq{}_rad_s"\n' if used else "")
    case = case_of(tmp_path, sound(), text, columns=columns)
    case = replace(case, guesses={} if used else {"velocity": columns[DQ]})
    found = examine(case, checks=OWN)
    clock = of(found, "clock")
    assert clock.severity == Severity.WRONG and "the rate is 100 Hz" in clock.says
    assert f"at the declared {declared:g} Hz velocities" in clock.says
    assert {e.path: e.value for e in found.edits} == {(SIGNALS, "rate"): 100.0}
    assert [f.check for f in found.findings if f.severity > Severity.OK] == ["clock"]


@pytest.mark.parametrize("unit", ["deg/s", "rpm"])
def test_a_unit_of_velocities_is_no_rate(tmp_path: Path, unit: str) -> None:
    table = scaled(DQ, 1.0 / VELOCITY_UNITS["revolute"][unit])(sound())
    found = diagnosis(tmp_path, table, ROBOT.replace('time = "time"', "rate = 100.0"))
    assert of(found, "clock").severity == Severity.OK
    assert {e.path: e.value for e in found.edits} == {(SIGNALS, "velocity_unit"): unit}


@pytest.mark.parametrize(
    ("position", "velocity", "edits"),
    [
        (["q1", "dq2", "q3"], None, {"position": ["q1", "q2", "q3"]}),
        (["dq1", "dq2", "dq3"], None, {"position": ["q1", "q2", "q3"]}),
        (
            ["q1", "dq2", "q3"],
            ["dq1", "q2", "dq3"],
            {"position": ["q1", "q2", "q3"], "velocity": ["dq1", "dq2", "dq3"]},
        ),
    ],
)
def test_a_velocity_that_is_declared_as_position_is_named_and_corrected(
    tmp_path: Path, position: list[str], velocity: list[str] | None, edits: dict[str, list[str]]
) -> None:
    text = ROBOT.replace('"q{}"', str(position).replace("'", '"'))
    line = "" if velocity is None else f"velocity = {velocity}\n".replace("'", '"')
    found = diagnosis(tmp_path, sound(), text.replace('velocity = "dq{}"\n', line))
    about = of(found, "position")
    assert about.severity == Severity.WRONG
    assert "its values are the derivative of 'q" in about.says
    assert {e.path[-1]: e.value for e in found.edits} == edits
    assert not any(f.check == "velocity" for f in found.findings)


@pytest.mark.slow
def test_positions_of_one_frequency_are_no_velocities(tmp_path: Path) -> None:
    table, turn = sound(), 2.0 * np.pi * np.array([0.25, 0.3125, 0.1875])
    phase = turn * table[:, :1]
    for sign in (1.0, -1.0):
        table[:, Q], table[:, DQ] = np.sin(phase), sign * turn * np.cos(phase)
        (found,) = position_check(case_of(tmp_path, table))
        assert found.severity == Severity.OK
    text = ROBOT.replace('"q{}"', '"dq{}"').replace('velocity = "dq{}"\n', "")
    table[:, DQ] *= sign
    (found,) = position_check(case_of(tmp_path, table, text))
    assert "derivative of 'q1'" in found.says


@pytest.mark.parametrize(
    ("name", "severity"),
    [("dq2_rad_s", Severity.WRONG), ("qd2", Severity.DOUBTFUL), ("angle2", Severity.OK)],
)
def test_a_position_column_is_called_a_velocity(
    tmp_path: Path, name: str, severity: Severity
) -> None:
    names = tuple(name if column == "q2" else column for column in COLUMNS)
    kept = [k for k, column in enumerate(names) if column != "dq2"]
    columns = tuple(names[k] for k in kept)
    text = ROBOT.replace('"q{}"', f'["q1", "{name}", "q3"]').replace('velocity = "dq{}"\n', "")
    found = examine(case_of(tmp_path, sound()[:, kept], text, columns=columns), checks=OWN)
    about = of(found, "position")
    assert about.severity == severity and not found.edits
    assert ("holds velocities: by its name" in about.says) == (severity > Severity.OK)


def test_exchanged_headers_of_position_and_velocity_are_seen_in_the_values(tmp_path: Path) -> None:
    names = dict(zip(("q2", "dq2"), ("dq2", "q2"), strict=True))
    columns = tuple(names.get(column, column) for column in COLUMNS)
    found = examine(case_of(tmp_path, sound(), columns=columns), checks=OWN)
    assert (
        "'q2' holds velocities: its values are the derivative of 'dq2'"
        in of(found, "position").says
    )
    text = ROBOT.replace('"q{}"', '["q1", "dq2", "q3"]')
    text = text.replace('"dq{}"', '["dq1", "q2", "dq3"]')
    assert examine(case_of(tmp_path, sound(), text, columns=columns), checks=OWN).severity == 0


def test_the_lag_of_velocities_that_are_left_out_is_a_fact(tmp_path: Path) -> None:
    text = ROBOT.replace('velocity = "dq{}"\n', "")
    case = case_of(tmp_path, late(sound()), text, guesses=True)
    (found,) = velocity_check(case)
    assert found.severity == Severity.OK
    assert "left out" in found.says
    assert "late" in found.says
    agreed = unit_reading(case, case.logs[0]).agreement
    assert agreed is not None
    assert np.all(np.abs(agreed.lag - 0.05) < 3.0 * agreed.lag_std + 1e-3)
    assert np.all(agreed.lag_std < 2e-3)


@pytest.mark.parametrize(
    ("places", "severity"), [(0, Severity.OK), (8, Severity.DOUBTFUL), (40, Severity.WRONG)]
)
def test_rows_lost_before_stamps_were_made_even_are_found(
    tmp_path: Path, places: int, severity: Severity
) -> None:
    table = sound(200.0)
    keep = np.ones(len(table), dtype=np.bool_)
    for start in np.linspace(450, len(table) - 460, places).astype(int):
        keep[start : start + 8] = False
    stamps = table[: np.count_nonzero(keep), 0].copy()
    table = table[keep]
    table[:, 0] = stamps
    found = diagnosis(tmp_path, table)
    assert of(found, "clock").severity == severity
    assert of(found, "velocity").severity == Severity.OK
    assert ("jump" in of(found, "clock").says) == (places > 0)
    assert not found.edits


def test_late_and_early_samples_are_not_missing_ones(tmp_path: Path) -> None:
    table = sound(200.0)
    rows = np.arange(len(table), dtype=np.float64)
    held = np.random.default_rng(2).random(len(rows)) < 0.06
    for start in np.flatnonzero(held).tolist():
        rows[start : start + 3] = rows[start] + 0.2 * np.arange(len(rows[start : start + 3]))
    each = [np.interp(rows, np.arange(len(table)), column) for column in table[:, 1:].T]
    table[:, 1:] = np.column_stack(each)
    found = of(diagnosis(tmp_path, table), "clock")
    assert found.severity == Severity.DOUBTFUL
    assert "jump ahead" in found.says and "No row is missing" in found.says


@pytest.mark.parametrize("rate", [100.0, 1000.0])
@pytest.mark.parametrize("kind", ["backward", "backward, even steps", "forward", "central"])
def test_velocities_that_are_differences_of_positions_are_doubtful(
    tmp_path: Path, kind: str, rate: float
) -> None:
    table = sound(rate)
    t, q = table[:, :1], table[:, Q]
    slope = np.diff(q, axis=0) / np.diff(t, axis=0)
    if kind == "backward, even steps":
        slope = np.diff(q, axis=0) * rate
    if kind == "central":
        table[:, DQ] = np.gradient(q, axis=0) * rate
    else:
        rows = slice(-1) if kind == "forward" else slice(1, None)
        table[rows, DQ] = slope
    (found,) = velocity_check(case_of(tmp_path, table))
    differ = "differences of successive positions" in found.says
    assert (found.severity, differ) == (
        (Severity.OK, False) if kind == "central" else (Severity.DOUBTFUL, True)
    )
    assert kind == "central" or {e.path[-1] for e in found.fix.edits} >= {"velocity"}


def test_the_standard_error_of_the_lag_is_honest(tmp_path: Path) -> None:
    off = []
    for seed in range(20):
        table = sound(seed=seed)
        table[:, DQ] += 0.2 * np.random.default_rng(100 + seed).normal(size=(len(table), 3))
        case = case_of(tmp_path, table)
        agreed = unit_reading(case, case.logs[0]).agreement
        assert agreed is not None
        off += list(agreed.lag / agreed.lag_std)
    assert 0.5 < float(np.std(off)) < 1.5


@pytest.mark.slow
def test_every_order_of_the_velocities_is_found(tmp_path: Path) -> None:
    # without masses nothing is compared with forces, whose part in it the cases of FAULTS show
    text = re.sub(r", mass = [\d.]+", "", ROBOT)
    for order in permutations(range(3)):
        table = sound(duration=10.0)
        table[:, DQ] = table[:, DQ][:, list(order)]
        (found,) = velocity_check(case_of(tmp_path, table, text))
        edits = () if found.fix is None else found.fix.edits
        wanted = [f"dq{k + 1}" for k in np.argsort(order)]
        proposed = edits[0].value if edits else ["dq1", "dq2", "dq3"]
        assert proposed == wanted


@pytest.mark.slow
def test_slow_stamps_are_distinguished_from_a_slow_log(tmp_path: Path) -> None:
    fast = sound(rate=5000.0, duration=6.0)
    fast[:, 0] *= 1e3
    (clock,) = clock_check(case_of(tmp_path, fast))
    assert clock.fix is not None
    assert [e.value for e in clock.fix.edits] == ["ms"]
    (clock,) = clock_check(case_of(tmp_path, sound(rate=5.0, duration=200.0)))
    assert clock.severity == Severity.OK


def test_motor_side_positions_are_recognised(tmp_path: Path) -> None:
    table = sound()
    table[:, Q] *= 100.0
    table[:, DQ] *= 100.0
    named = ROBOT.replace('velocity = "dq{}"\n', "").replace('"q{}"', '"q_motor{}"')
    columns = tuple(c.replace("q", "q_motor") if c[0] == "q" else c for c in COLUMNS)
    case = case_of(tmp_path, table)
    path = tmp_path / "robot.toml"
    path.write_text(named)
    loaded = load_robot(path)
    assert loaded.signals is not None
    log = LogInMemory(tmp_path / "run.csv", columns, table)
    checked = CheckedLog(Recording(log, loaded.signals), Processing(), "run")
    (found,) = position_check(Case(loaded, (checked,)))
    assert found.severity == Severity.WRONG
    assert "appear to be those of motors" in found.says
    assert found.fix is not None
    assert 'coordinates = "motor"' in found.fix.says
    assert case.loaded.signals is not None
    geared = named.replace(
        "[signals]", "[robot.transmission]\nratios = [100, 100, 100]\n\n[signals]"
    )
    geared = geared.replace("[signals]", '[signals]\ncoordinates = "motor"')
    path.write_text(geared)
    loaded = load_robot(path)
    assert loaded.signals is not None
    checked = CheckedLog(Recording(log, loaded.signals), Processing(), "run")
    (found,) = position_check(Case(loaded, (checked,)))
    assert found.severity == Severity.OK
    assert "motor-side signals, ratios 100 100 100" in found.says
    path.write_text(geared.replace("[100, 100, 100]", "[1, 1, 1]"))
    loaded = load_robot(path)
    assert loaded.signals is not None
    checked = CheckedLog(Recording(log, loaded.signals), Processing(), "run")
    (found,) = position_check(Case(loaded, (checked,)))
    assert found.severity == Severity.DOUBTFUL
    assert found.fix is not None and not found.fix.edits
    assert "gear ratios" in found.fix.says


def test_positions_outside_their_limits_are_doubtful(tmp_path: Path) -> None:
    table = sound()
    table[:, 2] += 2.5
    (found,) = position_check(case_of(tmp_path, table))
    assert found.severity == Severity.DOUBTFUL
    assert found.joints == ("joint_2",)
    assert found.fix is not None
    assert "position_offset" in found.fix.says
    assert "the model file is of another robot" in found.fix.says
    assert found.says == "joint_2 is outside its limits; positions in rad"
    table[:, 3] += 2.5
    (found,) = position_check(case_of(tmp_path, table))
    assert found.says == "joint_2, joint_3 are outside their limits; positions in rad"
    (found,) = position_check(case_of(tmp_path, sound()))
    assert found.says == "positions in rad, within the joints' limits"


def test_a_corrupt_head_is_reported_and_harmless(tmp_path: Path) -> None:
    table = sound()
    table[1:15, 1:] = 1e250
    found = diagnosis(tmp_path, table)
    assert found.severity == Severity.OK
    assert of(found, "rows").says == "14 corrupt rows at the start (rows 1 to 14), dropped"


def test_corrupt_rows_have_a_line_of_their_own_in_brief(tmp_path: Path) -> None:
    table = sound()
    table[1:15, 1:] = 1e250
    assert of(diagnosis(tmp_path, table), "rows").brief == "14 corrupt rows dropped"
    assert of(diagnosis(tmp_path, sound()), "rows").brief == ""


@pytest.mark.parametrize("order", ["sorted by effort", "shuffled"])
def test_rows_out_of_order_are_the_only_finding(tmp_path: Path, order: str) -> None:
    table = sound()
    table = (
        table[np.argsort(table[:, 8])]
        if order == "sorted by effort"
        else np.random.default_rng(8).permutation(table)
    )
    found = diagnosis(tmp_path, table)
    assert [f.check for f in found.findings] == ["clock", "other checks"]
    clock, rest = found.findings
    assert clock.severity == Severity.WRONG and found.edits == ()
    assert clock.says.startswith("rows are not in the order of time: it decreases at ")
    assert clock.fix is not None and clock.fix.says.startswith("sort the rows by ")
    assert not rest.answered and rest.severity == Severity.OK


def test_nothing_moves(tmp_path: Path) -> None:
    table = sound()
    table[:, 1:7] = 1e-5 * np.random.default_rng(7).normal(size=(len(table), 6))
    found = diagnosis(tmp_path, table)
    assert of(found, "excitation").severity == Severity.WRONG
    assert "no joint moves" in of(found, "rows").says
    assert [f.check for f in found.findings if f.severity] == ["excitation"]


def test_joints_may_move_in_different_logs(tmp_path: Path) -> None:
    first, second = sound(), sound()
    first[:, [1, 4]], second[:, [2, 3, 5, 6]] = 0.5, 0.5
    a, b = case_of(tmp_path, first), case_of(tmp_path, second)
    found = excitation_check(Case(a.loaded, (*a.logs, *b.logs)))
    assert [f.severity for f in found] == [Severity.OK] * 3
    assert found[-1].says == "every joint moves"
    found = excitation_check(Case(a.loaded, (*a.logs, *a.logs)))
    assert found[-1].severity == Severity.DOUBTFUL
    assert found[-1].joints == ("joint_1",)


@pytest.mark.parametrize("rows", [0, 1, 5, 40])
def test_short_logs_do_no_harm(tmp_path: Path, rows: int) -> None:
    if rows == 0:
        table = np.zeros((0, 10))
        assert velocity_check(case_of(tmp_path, table)) == ()
        return
    found = diagnosis(tmp_path, sound()[:rows])
    assert found.severity == Severity.WRONG


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e300])
def test_garbage_alone_does_no_harm(tmp_path: Path, value: float) -> None:
    found = diagnosis(tmp_path, np.full((2000, 10), value))
    assert of(found, "rows").severity == Severity.WRONG
    assert of(found, "clock").severity == Severity.WRONG


def test_names_of_columns_speak_for_their_units() -> None:
    assert Column("q1_rad").unit_named(("rad", "deg")) == "rad"
    assert Column("dq1_rad_s").unit_named(("rad/s", "rpm")) == "rad/s"
    assert Column("joint_m").unit_named(("m", "mm")) == "m"
    assert Column("q1_degrees").unit_named(("rad", "deg")) == "deg"
    assert Column("q1").unit_named(("rad", "deg")) == ""
    joint = Coordinate("arm", "revolute", Limits(-3.0, 3.0, 2.0, 10.0))
    units = {"deg": 1.0, "rad": 180.0 / np.pi}
    rates = {"rad/s": 1.0, "deg/s": np.pi / 180.0}
    facts = JointFacts(joint, -0.03, 0.03, 0.03, True, 57.3, units, rates, 0.5)
    assert facts.cheapest(1.0).position_unit == "deg"
    assert replace(facts, named=("rad", "rad/s")).cheapest(1.0).position_unit == "rad"


def test_a_declared_delay_of_velocities_is_held_against_the_log(tmp_path: Path) -> None:
    declared = ROBOT.replace('velocity = "dq{}"', 'velocity = "dq{}"\nvelocity_delay = 0.05')
    assert of(diagnosis(tmp_path, late(sound()), declared), "velocity").severity == Severity.OK
    found = of(diagnosis(tmp_path, sound(), declared), "velocity")
    assert found.severity == Severity.DOUBTFUL and "late" in found.says


def test_other_effort_columns_are_named(tmp_path: Path) -> None:
    table = sound()
    names = (*COLUMNS, *(f"current{k}_A" for k in (1, 2, 3)), "tau_des1")
    wide = np.concatenate((constant(table.copy()), table[:, TAU], table[:, :1]), axis=1)
    case = case_of(tmp_path, table)
    (log,) = case.logs
    recording = replace(log.recording, log=LogInMemory(Path("log"), names, wide))
    (finding,) = noise_check(replace(case, logs=(replace(log, recording=recording),)))
    assert finding.severity == WRONG and finding.joints == ("joint_2",)
    assert finding.fix is not None and finding.fix.says.endswith("has 'current{}_A' too")


def windowed(folder: Path, table: Array, seconds: tuple[float, float]) -> Case:
    """The robot file and a window of one log."""
    case = case_of(folder, table)
    (log,) = case.logs
    recording = replace(log.recording, cut=Cut(seconds=seconds))
    return replace(case, logs=(replace(log, recording=recording),))


@pytest.mark.parametrize("seconds", [(-inf, 8.0), (8.0, inf)])
def test_a_window_in_seconds_is_checked_by_its_own_rows(
    seconds: tuple[float, float], tmp_path: Path
) -> None:
    table = sound()
    t = table[:, 0] - table[0, 0]
    alone = table[(t >= seconds[0]) & (t < seconds[1])]
    found = examine(windowed(tmp_path, table, seconds), checks=OWN)
    assert of(found, "rows").figure.startswith(f"0 of {len(alone)} rows")
    expected = diagnosis(tmp_path, alone).findings
    assert [(f.says, f.figure) for f in found.findings] == [(f.says, f.figure) for f in expected]


def test_broken_stamps_do_not_widen_a_window(tmp_path: Path) -> None:
    table = sound()
    table[[300, 1500], 0] = table[900, 0]
    start, stop = np.searchsorted(sound()[:, 0] - sound()[0, 0], (8.0, 12.0))
    assert windowed(tmp_path, table, (8.0, 12.0)).logs[0].window == (start, stop)


def test_a_window_with_few_rows_is_the_whole_log_as_its_clock_may_be_misread(
    tmp_path: Path,
) -> None:
    table = sound()
    table[:, 0] *= 1000.0
    found = examine(windowed(tmp_path, table, (0.0, 400.0)), checks=OWN)
    assert of(found, "clock").severity is Severity.WRONG
    assert of(found, "rows").figure.startswith("0 of 2000 rows")


def test_a_window_of_a_log_without_stamps_counts_rows(tmp_path: Path) -> None:
    text = ROBOT.replace('time = "time"', "rate = 100.0")
    case = case_of(tmp_path, sound(), text)
    recording = replace(case.logs[0].recording, cut=Cut(seconds=(5.0, 15.0)))
    assert replace(case.logs[0], recording=recording).window == (500, 1500)


def test_stamps_that_are_all_missing_make_every_row_corrupt(tmp_path: Path) -> None:
    table = sound()
    table[:, 0] = np.nan
    found = diagnosis(tmp_path, table)
    assert of(found, "rows").figure.startswith("2000 of 2000 rows (100 %)")
    assert of(found, "clock").severity is Severity.WRONG


@pytest.mark.parametrize(
    ("share", "words"),
    [(0.0, "0 %"), (1e-13, "below 0.01 %"), (0.0052, "0.52 %"), (0.994, "99 %"), (1.0, "100 %")],
)
def test_shares_are_printed_in_percent(share: float, words: str) -> None:
    assert percent_of(share) == words


def test_a_frozen_encoder_is_named_with_its_rows_and_no_line_is_written(tmp_path: Path) -> None:
    found = examine(case_of(tmp_path, frozen(sound())), checks=OWN)
    (rows,) = (f for f in found.findings if f.severity)
    assert (rows.check, rows.severity, rows.joints) == ("rows", Severity.DOUBTFUL, ("joint_2",))
    assert "from row 700 to 1299 (7 to 12.99 s)" in rows.says
    assert "its encoder is frozen, and these rows are left out" in rows.says
    assert not found.edits and rows.fix is not None and "repair the encoder" in rows.fix.says


def test_a_dead_effort_is_named_with_its_seconds(tmp_path: Path) -> None:
    table = sound()
    table[700:1000, 8] = 0.0
    found = examine(case_of(tmp_path, table), checks=OWN)
    (noise,) = (f for f in found.findings if f.severity)
    assert (noise.check, noise.severity, noise.joints) == ("noise", Severity.DOUBTFUL, ("joint_2",))
    assert "the effort of joint_2 keeps one value from 7 to 9.99 s while it moves" in noise.says
    assert noise.fix is not None and "repair the sensor" in noise.fix.says and not found.edits


def test_bursts_of_lost_rows_are_named_and_no_unit_is_written(tmp_path: Path) -> None:
    found = examine(case_of(tmp_path, lost_in_bursts(sound())), checks=OWN)
    (rows,) = (f for f in found.findings if f.severity)
    assert (rows.check, rows.severity) == ("rows", Severity.DOUBTFUL) and not found.edits
    for row in (450, 905 - 80, 1310 - 160):
        assert f"jump at row {row} (" in rows.says.replace(" together", "")
    assert rows.says.count("rows are lost there") == 3


def test_a_joint_that_comes_to_rest_is_not_frozen(tmp_path: Path) -> None:
    table = sound()
    slow = np.clip((900 - np.arange(len(table))) / 100.0, 0.0, 1.0) ** 2
    way = np.cumsum(np.where(np.arange(len(table)) < 800, 1.0, slow)) * 0.01
    table[:, 1], table[:, 4] = np.round(way / 8.0, 4), np.gradient(way / 8.0, 0.01)
    found = examine(case_of(tmp_path, table), checks=OWN)
    assert not any(f.severity for f in found.findings if f.check == "rows")


@pytest.mark.parametrize(("factor", "written"), [(20.0, False), (1000.0, True)])
def test_a_clock_is_not_in_another_unit_unless_velocities_hold_its_factor(
    factor: float, written: bool, tmp_path: Path
) -> None:
    table = sound()
    table[:, 0] *= factor
    found = examine(case_of(tmp_path, table), checks=OWN)
    clock = of(found, "clock")
    assert clock.severity == Severity.WRONG and bool(found.edits) == written
    if not written:
        assert "time stamps are 20 times too far apart: the step is 10 ms, not 200 ms" in clock.says
        assert clock.fix is not None and "rate = 100 instead" in clock.fix.says
        assert of(found, "position").severity == Severity.OK
