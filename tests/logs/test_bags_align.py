"""Topics on their own clocks: interpolated where something is known, NaN elsewhere."""

import tracemalloc
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bag_writers import floats, in_order, joint_state, wrench, write_bag1, write_bag2, write_mcap
from steelyard.logs.formats import open_log
from steelyard.logs.messages.message_log import SAMPLES_KEPT_BEHIND, Track

MS = 1_000_000
Q, FX = "/joint_states/position/a", "/wrench/wrench/force/x"


def track(stamps: list[float], values: list[float] | None = None) -> Track:
    values = stamps if values is None else values
    return Track(((t, np.array([v])) for t, v in zip(stamps, values, strict=True)), 1)


def test_two_rates_with_an_offset_are_interpolated(tmp_path: Path) -> None:
    """Joints every 4 ms, forces every 10 ms and 3 ms later; forces are 2 t, read as written."""
    joints = [joint_state(k * 4 * MS, ["a"], [k / 3], [], []) for k in range(100)]
    force = [wrench(k * 10 * MS + 3 * MS, [0.02 * k, 1, 2, 3, 4, 5]) for k in range(30)]
    for path in (
        write_bag1(tmp_path / "run.bag", in_order([*joints, *force])),
        write_bag2(tmp_path / "run", in_order([*joints, *force])),
        write_mcap(tmp_path / "one_after_the_other.mcap", [*joints, *force], chunk=2000),
    ):
        (part,) = open_log(path).parts(("/joint_states/stamp", Q, FX, "/wrench/stamp"))
        t = np.arange(100) * 4 * MS / 10**9
        np.testing.assert_array_equal(part[:, 0], t)
        np.testing.assert_array_equal(part[:, 1], np.arange(100) / 3)
        known = (t >= 0.003) & (t <= 0.293)
        np.testing.assert_allclose(part[known, 2], 2.0 * (t[known] - 0.003), atol=1e-15)
        np.testing.assert_allclose(part[known, 3], t[known], atol=1e-15)
        np.testing.assert_array_equal(np.isnan(part[:, 2]), ~known)
        (other,) = open_log(path).parts(("/wrench/stamp", FX, Q))
        np.testing.assert_array_equal(other[:, 1], 0.02 * np.arange(30))
        np.testing.assert_allclose(other[:, 2], other[:, 0] / 0.012, rtol=1e-12)


def test_log_times_align_if_they_are_requested(tmp_path: Path) -> None:
    """The force sensor's clock has another zero; what the recorder noted is common to both."""
    joints = [joint_state(k * 10 * MS, ["a"], [k], [], []) for k in range(20)]
    force = [
        replace(wrench(10**15 + k, [k, 0, 0, 0, 0, 0]), time=joints[k].time) for k in range(20)
    ]
    log = open_log(write_mcap(tmp_path / "run.mcap", in_order([*joints, *force])))
    (part,) = log.parts(("/joint_states/log_time", Q, FX))
    np.testing.assert_array_equal(part[:, 1], part[:, 2])
    (part,) = log.parts(("/joint_states/stamp", Q, FX))
    assert np.isnan(part[:, 2]).all()


@pytest.mark.slow
def test_windows_and_parts_do_not_show(tmp_path: Path) -> None:
    joints = [joint_state(k * 4 * MS, ["a"], [k / 3], [], []) for k in range(3000)]
    command = [floats(k * 7 * MS, [k, -k]) for k in range(1800)]
    log = open_log(write_bag2(tmp_path / "run", in_order([*joints, *command])))
    columns = ("/joint_states/stamp", "/cmd/data/1", Q, "/cmd/data/0")
    (whole,) = log.parts(columns)
    assert np.count_nonzero(np.isnan(whole)) == 0
    for size, start, stop in ((1000, 0, None), (7, 1020, 1030), (2500, 11, 2900)):
        parts = list(log.parts(columns, (start, stop), size))
        np.testing.assert_array_equal(np.concatenate(parts), whole[start:stop])
        assert [len(p) for p in parts[:-1]] == [size] * (len(parts) - 1)


def test_a_long_pause_is_not_bridged_and_a_short_one_is() -> None:
    stamps = [k / 100 for k in range(50)]
    lone = track([*stamps, 0.55, *(1.0 + t for t in stamps)])
    assert lone.at(0.52, 0.52)[0] == pytest.approx(0.52)
    assert np.isnan(lone.at(0.7, 0.7)[0])
    assert lone.at(1.0, 1.0)[0] == 1.0
    assert lone.at(1.255, 1.255)[0] == pytest.approx(1.255)


def test_samples_that_contradict_their_neighbours_are_passed_over() -> None:
    stamps = [0.0, 0.01, 0.02, 9e9, 0.03, 0.03, 0.04, -5.0, 0.05, np.nan, 0.06, 0.07]
    found = track(stamps, [100 * t for t in stamps])
    assert found.at(0.025, 0.025)[0] == pytest.approx(2.5)
    assert found.at(0.035, 0.035)[0] == pytest.approx(3.5)
    assert found.at(0.065, 0.065)[0] == pytest.approx(6.5)


def test_one_mad_stamp_among_the_rows_does_not_spend_the_other_topic(tmp_path: Path) -> None:
    joints = [joint_state(k * 10 * MS, ["a"], [k], [], []) for k in range(200)]
    mad = joint_state(10**18, ["a"], [-1.0], [], [])
    force = [wrench(k * 10 * MS, [k, 0, 0, 0, 0, 0]) for k in range(200)]
    notes = in_order([*joints, *force, replace(mad, time=joints[100].time + 1)])
    (part,) = open_log(write_mcap(tmp_path / "run.mcap", notes)).parts(("/joint_states/stamp", FX))
    assert np.isnan(part[101, 1])
    np.testing.assert_allclose(np.delete(part[:, 1], 101), np.arange(200.0), atol=1e-9)


@settings(deadline=None, max_examples=50)
@given(
    st.lists(st.integers(0, 400), min_size=2, max_size=80, unique=True),
    st.lists(st.integers(0, 400), min_size=1, max_size=40),
)
def test_interpolation_is_that_of_numpy(samples: list[int], rows: list[int]) -> None:
    stamps = np.sort(np.array(samples, dtype=float))
    values = np.sin(stamps)
    far = 10.0 * np.median(np.diff(stamps))
    found = track(stamps.tolist(), values.tolist())
    for t in map(float, sorted(rows)):
        value = found.at(t, t)[0]
        after = np.searchsorted(stamps, t)
        if after == len(stamps) or (after == 0 and stamps[0] != t):
            assert np.isnan(value)
        elif stamps[after] != t and stamps[after] - stamps[after - 1] > far:
            assert np.isnan(value)
        else:
            assert value == pytest.approx(np.interp(t, stamps, values), abs=1e-12)


def test_memory_is_bounded_however_long_the_rows_pause() -> None:
    def samples() -> Iterator[tuple[float, np.ndarray]]:
        for k in range(200_000):
            yield k / 1000, np.zeros(10)

    other = Track(samples(), 10)
    tracemalloc.start()
    other.at(0.0, 0.0)
    other.at(199.0, 199.0)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 100_000 + 10 * SAMPLES_KEPT_BEHIND * 8 * 10
