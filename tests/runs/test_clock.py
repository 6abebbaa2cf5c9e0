"""Broken rows, repeats, backward steps and gaps, whatever the split into parts."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from steelyard.base.errors import LogError
from steelyard.runs.prepare import prepare
from steelyard.runs.processing_choices import Processing
from steelyard.runs.recording import Recording
from steelyard.runs.rows.clock_and_row_scan import RowScan, learn_clock, nice_rate
from steelyard.runs.rows.faulty_row_detectors import RowVerdict


def scanned(recording: Recording) -> tuple[np.ndarray, np.ndarray, dict[str, int]]:
    scan = RowScan(learn_clock(recording), recording)
    pieces = list(scan.pieces())
    t = np.concatenate([p.t for p in pieces])
    segment = np.concatenate([np.full(len(p.t), p.segment) for p in pieces])
    counts = {v.name: int(scan.counts[v]) for v in RowVerdict if scan.counts[v]}
    return t, segment, counts


@pytest.mark.parametrize(
    ("step", "rate"),
    [
        (0.01069, 100.0),
        (0.00102, 1000.0),
        (0.0099993, 100.0),
        (0.02, 50.0),
        (0.0002, 5000.0),
        (0.008, 125.0),
        (1 / 240, 250.0),
        (1 / 60, 60.0),
        (0.1, 10.0),
        (1.001, 1.0),
    ],
)
def test_rates_are_rounded_up_to_nice_ones(step: float, rate: float) -> None:
    assert nice_rate(step) == pytest.approx(rate)


def test_a_clean_log_is_kept_whole(recording, sines) -> None:
    t = 100.0 + np.arange(1000) * 0.01
    motion = sines(t)
    found, segment, counts = scanned(recording(t, motion["q"], motion["effort"]))
    np.testing.assert_allclose(found, t - 100.0, atol=1e-9)
    assert not segment.any() and counts == {"KEPT": 1000}


def test_every_kind_of_broken_row_is_counted(recording, sines) -> None:
    t = 5.0 + np.arange(1000) * 0.01
    motion = sines(t)
    q, effort = motion["q"], motion["effort"]
    q[100, 0] = np.nan
    effort[110, 1] = np.nan
    q[120, 1] = 1e293
    effort[130, 0] = -np.inf
    t[140] = np.nan
    t[150] = np.inf
    t[200] = t[199]
    t[300] = t[300] - 0.015
    t[400] = 1e12
    t[401] = -1e12
    q[500, 0] += 3.0
    found, segment, counts = scanned(recording(t, q, effort))
    assert counts == {
        "KEPT": 989,
        "UNREADABLE": 3,
        "ABSURD": 3,
        "REPEATED": 1,
        "BACKWARD": 2,
        "JUMP": 2,
    }
    assert not segment.any() and (np.diff(found) > 0.0).all() and len(found) == 989


def test_a_garbage_head_is_dropped_in_the_time_column_too(recording, sines) -> None:
    t = np.arange(1000) * 0.01
    motion = sines(t)
    q = motion["q"]
    rng = np.random.default_rng(4)
    t[:25] = rng.choice([0.0, 1e300, -1e-300, 253.0, 7e8, np.nan], 25)
    q[:25] = rng.choice([0.0, 253.0, -1e200, 1.5708, np.inf], (25, 2))
    found, segment, counts = scanned(recording(t, q, motion["effort"]))
    assert counts["KEPT"] == 975 and sum(counts.values()) == 1000
    np.testing.assert_allclose(found, np.arange(975) * 0.01, atol=1e-9)
    assert not segment.any()


def test_a_gap_splits_and_lost_packets_do_not(recording, sines) -> None:
    t = np.arange(3000) * 0.001
    t[1000:] += 0.008
    t[2000:] += 0.5
    motion = sines(t)
    found, segment, counts = scanned(recording(t, motion["q"], motion["effort"]))
    assert counts == {"KEPT": 3000}
    assert np.flatnonzero(np.diff(segment)).tolist() == [1999]


def test_a_wrapped_angle_splits(recording) -> None:
    t = np.arange(1000) * 0.01
    q = np.stack([(0.7 * t + np.pi) % (2.0 * np.pi) - np.pi, np.sin(t)], axis=1)
    _, segment, counts = scanned(recording(t, q, q))
    assert counts == {"KEPT": 1000} and segment.max() == 1


def test_a_clock_set_back_goes_on_when_it_has_caught_up(recording, sines) -> None:
    t = np.arange(1000) * 0.01
    t[500:] -= 0.3
    motion = sines(np.arange(1000) * 0.01)
    found, segment, counts = scanned(recording(t, motion["q"], motion["effort"]))
    assert counts["BACKWARD"] in (30, 31) and counts["KEPT"] + counts["BACKWARD"] == 1000
    assert (np.diff(found) > 0.0).all()


@pytest.mark.slow
@settings(
    deadline=None, max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    size=st.integers(1, 130),
    faults=st.lists(
        st.tuples(st.integers(0, 299), st.sampled_from(["nan", "time", "same", "gap", "jump"])),
        max_size=12,
    ),
)
def test_parts_of_any_size_give_the_same(recording, sines, size: int, faults) -> None:
    t = np.arange(300) * 0.01
    motion = sines(t)
    q = motion["q"]
    for row, fault in faults:
        if fault == "nan":
            q[row, 0] = np.nan
        elif fault == "time":
            t[row] = -1e9
        elif fault == "same":
            t[row] = t[row - 1]
        elif fault == "gap":
            t[row:] += 0.2
        else:
            q[row] += 2.0
    whole = recording(t, q, motion["effort"])
    expected = scanned(whole)
    small = replace(whole, log=Small(whole.log, size))
    found = scanned(small)
    for a, b in zip(found[:2], expected[:2], strict=True):
        np.testing.assert_array_equal(a, b)
    assert found[2] == expected[2]


class Small:
    """A log that comes in parts of one size."""

    def __init__(self, log, size: int) -> None:
        self.log, self.size = log, size
        self.path, self.columns = log.path, log.columns

    def parts(self, columns, rows=(0, None), size=0):
        return self.log.parts(columns, rows, self.size)


@pytest.mark.parametrize(
    ("window", "first", "last", "rows"),
    [
        ("@2:5", 2.0, 4.99, 300),
        ("@:5", 0.0, 4.99, 500),
        ("@2:", 2.0, 9.99, 800),
        ("#100:900", 1.0, 8.99, 800),
    ],
)
def test_windows_count_only_their_rows(recording, sines, window, first, last, rows) -> None:
    t = 77.0 + np.arange(1000) * 0.01
    motion = sines(t)
    motion["q"][[50, 450, 960]] = np.nan
    found, _, counts = scanned(recording(t, motion["q"], motion["effort"], window=window))
    assert found[0] == pytest.approx(first) and found[-1] == pytest.approx(last)
    assert sum(counts.values()) == rows
    missing = sum(first <= at < last for at in (0.5, 4.5, 9.6))
    assert counts.get("UNREADABLE", 0) == missing


def test_positions_that_jump_are_not_put_down_to_the_clock(recording, sines) -> None:
    t = np.arange(1000) * 0.01
    motion = sines(t)
    with pytest.raises(LogError, match="positions jump farther than a robot can move") as caught:
        prepare(recording(t, 1e4 * motion["q"], motion["effort"]))
    assert "position_unit" in caught.value.fix


@pytest.mark.parametrize("kind", ["constant", "falling", "wrong"])
def test_a_time_column_that_is_none_is_refused(recording, sines, kind: str) -> None:
    t = np.arange(1000) * 0.01
    motion = sines(t)
    clock = {
        "constant": np.zeros(1000),
        "falling": -t,
        "wrong": np.random.default_rng(0).standard_normal(1000),
    }[kind]
    with pytest.raises(LogError, match="column 't' does not increase") as caught:
        prepare(recording(clock, motion["q"], motion["effort"]))
    assert "[signals]" in caught.value.fix


def test_time_in_milliseconds_is_named(recording, sines) -> None:
    t = np.arange(1000) * 0.01
    motion = sines(t)
    with pytest.raises(LogError, match="time looks like milliseconds") as caught:
        prepare(recording(1e3 * t, motion["q"], motion["effort"]), Processing(matched_cutoff=3.0))
    assert "time_unit" in caught.value.fix


def test_a_log_of_one_row_is_refused(recording, sines) -> None:
    t = np.zeros(1)
    motion = sines(t)
    with pytest.raises(LogError, match="the log has one row"):
        prepare(recording(t, motion["q"], motion["effort"]))


def test_times_that_are_not_examined_are_known(recording, sines) -> None:
    t = np.arange(2000) * 0.01
    motion = sines(t)
    effort = motion["effort"].copy()
    effort[500:600, 0] = np.nan
    effort[50, 0] = np.nan
    effort[1980:1989, 0] = np.nan
    run = prepare(recording(t, motion["q"], effort))
    assert run.quality.unexamined == (pytest.approx((4.99, 6.0)), pytest.approx((19.79, 19.99)))
    whole = prepare(recording(t, motion["q"], motion["effort"]))
    assert whole.quality.unexamined == ()
