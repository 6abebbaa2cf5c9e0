"""Recordings of motors, and from another zero, become those of joints."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from steelyard.base.arrays import frozen
from steelyard.logs.log_and_errors import Cut
from steelyard.robot.file.signals import Signals
from steelyard.runs.recording import LoggedSamples, LogInMemory, Recording
from steelyard.runs.rows.clock_and_row_scan import learn_clock
from steelyard.runs.rows.faulty_row_detectors import RowVerdict, broken_rows

RATIOS = np.array([[50.0, 0.0], [40.0, -40.0]])
OFFSET = np.array([0.3, -0.2])
COLUMNS = ("t", "a", "b", "va", "vb", "ea", "eb")


def recording(velocities: bool = True) -> tuple[Recording, np.ndarray]:
    """A log of motors, with positions in degrees, and its table."""
    table = np.random.default_rng(4).normal(size=(50, len(COLUMNS)))
    two = frozen(np.ones(2))
    signals = Signals(
        "t", 1e-3, ("a", "b"), frozen(np.full(2, np.pi / 180.0)),
        ("va", "vb") if velocities else None, frozen([2.0, 3.0]) if velocities else None,
        ("ea", "eb"), two * 1e-3, "motor_torque", ("Nm", "Nm"), two,
        position_map=frozen(np.linalg.inv(RATIOS)), position_offset=frozen(OFFSET),
        effort_map=frozen(RATIOS.T),
    )  # fmt: skip
    return Recording(LogInMemory(Path("motors.csv"), COLUMNS, table), signals), table


def samples_of(recording: Recording, size: int = 100) -> list[LoggedSamples]:
    raw = recording.raw(recording.cut.rows, size)
    return [LoggedSamples.of(t, x, recording.channels) for t, x in raw]


def test_logged_motors_become_joints() -> None:
    log, table = recording()
    (samples,) = samples_of(log)
    np.testing.assert_allclose(samples.t, table[:, 0] * 1e-3)
    degrees = np.linalg.solve(RATIOS, np.deg2rad(table[:, 1:3]).T).T
    np.testing.assert_allclose(samples.q, degrees + OFFSET, rtol=1e-12)
    assert samples.dq is not None
    speed = np.linalg.solve(RATIOS, (table[:, 3:5] * [2.0, 3.0]).T).T
    np.testing.assert_allclose(samples.dq, speed, rtol=1e-12)
    joints = np.array([RATIOS.T @ motor for motor in table[:, 5:7] * 1e-3])
    np.testing.assert_allclose(samples.effort, joints, rtol=1e-12)


def test_without_velocities_positions_and_efforts_alone_are_mapped() -> None:
    log, table = recording(velocities=False)
    (samples,) = samples_of(log)
    assert samples.dq is None and log.channels.count == 4
    np.testing.assert_allclose(samples.effort, table[:, 5:7] @ RATIOS * 1e-3, rtol=1e-12)


def sparse(alone: dict[str, slice], rows: int = 900) -> tuple[Recording, np.ndarray]:
    """A table of messages: some columns in rows of theirs only."""
    log, _ = recording()
    t = 0.002 * np.arange(rows)
    table = np.column_stack([t, *(np.sin((k + 1.0) * t) for k in range(len(COLUMNS) - 1))])
    whole = table.copy()
    for column, among in alone.items():
        given = np.zeros(rows, dtype=np.bool_)
        given[among] = True
        table[~given, COLUMNS.index(column)] = np.nan
    one = frozen(np.ones(2))
    signals = replace(
        log.signals, time_scale=1.0, position_scale=one, velocity_scale=one, effort_scale=one,
        position_map=None, position_offset=None, effort_map=None,
    )  # fmt: skip
    return Recording(LogInMemory(Path("topics.csv"), COLUMNS, table), signals), whole


def test_rows_of_other_topics_are_no_corrupt_ones() -> None:
    log, _ = sparse(dict.fromkeys(COLUMNS[1:], slice(0, None, 3)))
    ((t, x),) = log.raw((0, None))
    verdict = broken_rows(t, x, log.channels)
    assert (verdict[::3] == RowVerdict.KEPT).all()
    assert np.count_nonzero(verdict == RowVerdict.EMPTY) == 600
    assert learn_clock(log).step == pytest.approx(0.006)


@pytest.mark.parametrize("each", [False, True])
def test_columns_in_rows_of_their_own_are_put_together(each: bool) -> None:
    first = {name: k if each else 3 * (name[0] == "e") for k, name in enumerate(COLUMNS[1:])}
    alone = {name: slice(row, None, 6) for name, row in first.items()}
    log, whole = sparse(alone)
    ((t, x),) = log.raw((0, None))
    kept = broken_rows(t, x, log.channels) == RowVerdict.KEPT
    assert np.count_nonzero(kept) >= 148 and not kept[1::6].any()
    np.testing.assert_allclose(x[kept], whole[kept, 1:], atol=1e-3)


def test_pauses_are_not_bridged_and_cells_that_are_missing_now_and_then_stay_so() -> None:
    log, whole = sparse({"ea": slice(3, None, 6), "eb": slice(3, None, 6)})
    table = log.log.table.copy()
    table[300:420, 5:] = np.nan
    ((_, x),) = replace(log, log=LogInMemory(Path("a.csv"), COLUMNS, table)).raw((0, None))
    assert np.isnan(x[304:416, 4:]).all() and not np.isnan(x[10:290, 4:]).any()
    whole[::5, 6] = np.nan
    ((_, x),) = replace(log, log=LogInMemory(Path("a.csv"), COLUMNS, whole)).raw((0, None))
    np.testing.assert_array_equal(np.isnan(x), np.isnan(whole[:, 1:]))


def test_neither_the_parts_nor_the_log_in_memory_change_by_reading() -> None:
    log, table = recording()
    before, (whole,) = table.copy(), samples_of(log)
    in_memory = replace(log.in_memory(), cut=Cut(rows=(10, 40)))
    parts = list(samples_of(in_memory, 7))
    np.testing.assert_array_equal(np.concatenate([p.q for p in parts]), whole.q[10:40])
    np.testing.assert_array_equal(np.concatenate([p.effort for p in parts]), whole.effort[10:40])
    np.testing.assert_array_equal(table, before)


def test_an_offset_alone_moves_positions_only() -> None:
    log, table = recording()
    log = replace(log, signals=replace(log.signals, position_map=None, effort_map=None))
    (samples,) = samples_of(log)
    np.testing.assert_allclose(samples.q, np.deg2rad(table[:, 1:3]) + OFFSET, rtol=1e-12)
    assert samples.dq is not None
    np.testing.assert_allclose(samples.dq, table[:, 3:5] * [2.0, 3.0])
    np.testing.assert_allclose(samples.effort, table[:, 5:7] * 1e-3)
