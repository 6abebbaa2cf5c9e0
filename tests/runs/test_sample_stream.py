"""Samples of rows as they arrive."""

from dataclasses import replace

import numpy as np
import pytest

from invented import tree
from steelyard.base.arrays import Array
from steelyard.robot.file.signals import ROW, Signals
from steelyard.runs.rows.faulty_row_detectors import RowVerdict
from steelyard.runs.sample_stream import (
    JUMPS_UNTIL_RESTART,
    PAUSE_SECONDS,
    RESTARTED,
    SampleStream,
    StreamSample,
)

ROBOT = tree()
N = ROBOT.n
ONES = np.ones(N)


def names(kind: str) -> tuple[str, ...]:
    return tuple(f"{kind}{k}" for k in range(N))


SIGNALS = Signals(
    "t", 1e-3, names("q"), 2.0 * ONES, names("v"), -ONES, names("i"), 1e-3 * ONES,
    "motor_current", ("A",) * N, ONES,
)  # fmt: skip
"""Milliseconds, positions in half units, velocities of the other sign, milliamperes."""


def rows(count: int = 60, step: float = 10.0) -> Array:
    t = 5000.0 + step * np.arange(count)
    q = 0.01 * np.arange(count)[:, None] * ONES
    return np.column_stack([t, q, -0.5 * np.ones((count, N)), 1000.0 * q])


def samples(table: Array, signals: Signals = SIGNALS, size: int = 7) -> list[StreamSample]:
    stream = SampleStream(signals, ROBOT)
    return [s for k in range(0, len(table), size) for s in stream.samples(table[k : k + size])]


def test_units_signs_and_time_from_the_first_sample() -> None:
    found = samples(rows())
    assert len(found) == 60 and found[0].t == 0.0
    last = found[-1]
    assert last.t == pytest.approx(0.59)
    assert np.allclose(last.q, 1.18) and np.allclose(last.dq, 0.5)
    assert np.allclose(last.effort, 0.59)
    assert np.array_equal(last.row, rows()[-1])


@pytest.mark.parametrize("size", [1, 2, 13, 100])
def test_broken_rows_are_left_out_and_counted(size: int) -> None:
    table = rows()
    table[5, 3] = np.nan
    table[8, 1] = 1e9
    table[12, 0] = table[11, 0]
    table[20], table[21] = table[21].copy(), table[20].copy()
    table[30, 2] = 40.0
    stream = SampleStream(SIGNALS, ROBOT)
    found = [s for k in range(0, 60, size) for s in stream.samples(table[k : k + size])]
    assert dict(stream.dropped) == {
        RowVerdict.UNREADABLE: 1,
        RowVerdict.ABSURD: 1,
        RowVerdict.REPEATED: 1,
        RowVerdict.BACKWARD: 1,
        RowVerdict.JUMP: 1,
    }
    assert len(found) == 55 and stream.start == pytest.approx(5.0)
    assert np.all(np.diff([s.t for s in found]) > 0.0)


def test_positions_that_stay_elsewhere_are_taken() -> None:
    table = rows()
    prismatic = next(k for k, c in enumerate(ROBOT.coordinates) if c.kind == "prismatic")
    table[30:, 1 + prismatic] += 40.0
    stream = SampleStream(SIGNALS, ROBOT)
    found = list(stream.samples(table))
    assert (
        dict(stream.dropped) == {RowVerdict.JUMP: JUMPS_UNTIL_RESTART}
        and len(found) == 60 - JUMPS_UNTIL_RESTART
    )


def test_time_goes_on_when_the_clock_is_set_back() -> None:
    table = rows(120)
    table[60:, 0] -= 4000.0
    stream = SampleStream(SIGNALS, ROBOT)
    found = list(stream.samples(table))
    assert stream.restarts == 1 and dict(stream.dropped) == {RowVerdict.BACKWARD: RESTARTED}
    steps = np.diff([s.t for s in found])
    assert np.sum(steps > 0.011) == 1 and steps.max() == pytest.approx(PAUSE_SECONDS)
    assert found[-1].row[0] == pytest.approx(1e3 * (5.0 + found[-1].t))


def test_a_clock_that_stands_still_is_not_set_back() -> None:
    table = rows()
    table[20:, 0] = table[20, 0]
    stream = SampleStream(SIGNALS, ROBOT)
    assert len(list(stream.samples(table))) == 21
    assert stream.restarts == 0 and stream.dropped[RowVerdict.REPEATED] == 39


def test_jumps_of_a_turn_are_taken_out_of_revolute_joints() -> None:
    table = rows(500)
    turning = [c.kind == "revolute" for c in ROBOT.coordinates]
    q = 3.0 + 0.02 * np.arange(500)
    wrapped = (q + np.pi) % (2.0 * np.pi) - np.pi
    table[:, 1 : 1 + N] = 0.5 * np.where(turning, wrapped[:, None], q[:, None])
    for size in (1, 11, 500):
        found = np.array([s.q for s in samples(table, size=size)])
        assert np.allclose(found, q[:, None])


def test_velocities_are_differences_if_they_are_not_logged() -> None:
    bare = replace(SIGNALS, velocity=None, velocity_scale=None)
    table = np.delete(rows(), np.s_[1 + N : 1 + 2 * N], axis=1)
    found = samples(table, bare)
    assert len(found) == 59 and np.allclose([s.dq for s in found], 2.0)


def test_rows_without_a_clock_are_counted() -> None:
    counted = replace(SIGNALS, time=ROW, time_scale=0.002)
    stream = SampleStream(counted, ROBOT)
    assert stream.columns == counted.columns[1:]
    found = [s for part in np.split(rows()[:, 1:], 6) for s in stream.samples(part)]
    assert [s.t for s in found] == pytest.approx(list(0.002 * np.arange(60)))


@pytest.mark.parametrize("lags", [(0.004, 0.015), (-0.012, 0.003), (0.0, -0.02)])
def test_signals_that_are_late_are_brought_together(lags: tuple[float, float]) -> None:
    late = replace(SIGNALS, velocity_delay=lags[0], effort_delay=lags[1])
    table, t = rows(), 0.01 * np.arange(60)
    table[:, 1 : 1 + N] = 0.5 * t[:, None]
    table[:, 1 + N : 1 + 2 * N] = -3.0 * (t - lags[0])[:, None]
    table[:, 1 + 2 * N :] = 1000.0 * (t - lags[1])[:, None]
    found = samples(table, late)
    assert 55 <= len(found) < 60
    for s in found:
        assert np.allclose(s.q, s.t) and np.allclose(s.dq, 3.0 * s.t)
        assert np.allclose(s.effort, s.t)
