"""From a log to a run: exact motions, blocks of any size, errors in words."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from steelyard.base.errors import LogError
from steelyard.base.progress import silent
from steelyard.logs.formats import open_log
from steelyard.runs.prepare import prepare
from steelyard.runs.processing_choices import Processing
from steelyard.runs.recording import LoggedSamples, Recording
from steelyard.runs.run import Block
from steelyard.runs.runs_of_named_logs import prepared


def jittered(n: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).choice([0.010, 0.012], n, p=[0.65, 0.35]).cumsum()


@pytest.mark.parametrize("velocities", [False, True])
def test_an_exact_motion_comes_back(recording, sines, velocities: bool) -> None:
    t = 50.0 + jittered(4000)
    motion = sines(t)
    run = prepare(recording(t, motion["q"], motion["effort"], motion["dq"] if velocities else None))
    data = run.whole()
    assert run.rate == 100.0 and run.name == "run" and run.effort_units == ("Nm", "Nm")
    inside = slice(60, -60)
    truth = sines(data.t + t[0])
    for found, name, bound in (
        (data.motion.q, "q", 2e-5),
        (data.motion.dq, "dq", 3e-4),
        (data.motion.ddq, "ddq", 2e-2),
        (data.effort, "effort", 1e-4),
    ):
        error = np.abs(found - truth[name])[inside].max()
        assert error < bound * np.abs(truth[name]).max(), name
    assert data.moving.mean() > 0.97


def test_blocks_of_any_size_are_the_whole_and_can_be_read_again(recording, sines) -> None:
    t = jittered(3000)
    t[1500:] += 1.0
    motion = sines(t)
    run = prepare(recording(t, motion["q"], motion["effort"]))
    whole = run.whole()
    assert set(whole.segment.tolist()) == {0, 1} and run.n_samples == len(whole.t)
    for size in (37, 1000, 10**6):
        for _ in range(2):
            blocks = list(run.blocks(size))
            assert max(len(b.t) for b in blocks) <= size
            np.testing.assert_array_equal(np.concatenate([b.t for b in blocks]), whole.t)
            for name in ("q", "dq", "ddq"):
                joined = np.concatenate([getattr(b, name) for b in blocks], axis=1)
                np.testing.assert_array_equal(joined.T, getattr(whole.motion, name))
            assert all(getattr(b, x).flags.c_contiguous for b in blocks for x in ("q", "moving"))


def test_blocks_are_cut_and_joined(recording, sines) -> None:
    t = jittered(800)
    motion = sines(t)
    blocks = list(prepare(recording(t, motion["q"], motion["effort"])).blocks(100))
    joined = Block.joined(blocks)
    again = Block.joined([joined.part(0, 123), joined.part(123, len(joined.t))])
    for name in ("t", "q", "dq", "ddq", "effort", "moving"):
        np.testing.assert_array_equal(getattr(again, name), getattr(joined, name))
        assert getattr(joined.part(5, 9), name).shape[-1] == 4
        assert getattr(joined.part(5, 9), name).flags.c_contiguous


def test_small_parts_of_the_log_do_not_show(recording, sines, monkeypatch) -> None:
    t = jittered(3000)
    motion = sines(t)
    made = recording(t, motion["q"], motion["effort"])
    expected = prepare(made).whole()
    monkeypatch.setattr(Recording, "in_memory", lambda self: self)
    log = made.log
    small = replace(made, log=Small(log, 61))
    found = prepare(small).whole()
    np.testing.assert_allclose(found.motion.ddq, expected.motion.ddq, atol=1e-9)
    np.testing.assert_array_equal(found.moving, expected.moving)
    np.testing.assert_allclose(found.effort, expected.effort, atol=1e-12)


class Small:
    """A log that comes in parts of one size."""

    def __init__(self, log, size: int) -> None:
        self.log, self.size = log, size
        self.path, self.columns = log.path, log.columns

    def parts(self, columns, rows=(0, None), size=0):
        return self.log.parts(columns, rows, self.size)


@pytest.mark.slow
def test_a_log_too_large_to_hold_is_read_in_parts(recording, sines) -> None:
    t = np.arange(120_000) * 0.001
    motion = sines(t)
    made = recording(t, motion["q"], motion["effort"], suffix=".csv")
    assert made.in_memory() is made and made.in_memory(10**6).log is not made.log
    run = prepare(made)
    assert run.n_samples > 119_000 and run.quality.rows == 120_000


def test_units_are_converted(recording, sines) -> None:
    t = jittered(2000)
    motion = sines(t)
    plain = prepare(recording(t, motion["q"], motion["effort"])).whole()
    degrees = recording(
        1e3 * t,
        np.degrees(motion["q"]),
        motion["effort"],
        position_scale=np.pi / 180.0,
        time_scale=1e-3,
    )
    np.testing.assert_allclose(prepare(degrees).whole().motion.dq, plain.motion.dq, atol=1e-8)
    ((t, x),) = degrees.raw(degrees.cut.rows)
    part = LoggedSamples.of(t, x, degrees.channels)
    np.testing.assert_allclose(part.q, motion["q"])
    assert part.dq is None


def test_rests_are_found_and_the_ends_left_out(recording) -> None:
    t = np.arange(3000) * 0.01
    rise = np.clip((t - 5.0) / 4.0, 0, 1), np.clip((t - 15.0) / 4.0, 0, 1)
    q = np.stack([0.5 - 0.5 * np.cos(np.pi * r) for r in rise], axis=1)
    q += np.random.default_rng(0).uniform(-5e-5, 5e-5, q.shape)
    run = prepare(recording(t, q, q), Processing(motion_cutoff=8.0, matched_cutoff=4.0))
    data = run.whole()
    assert run.span == pytest.approx((5.0, 19.0), abs=0.1)
    assert data.moving[:, 0].sum() == pytest.approx(400, abs=12)
    assert data.moving[:, 1].sum() == pytest.approx(400, abs=12)
    between = (data.t > 9.2) & (data.t < 14.8)
    assert not data.moving[between].any()


def test_a_requested_rest_speed_is_exact(recording, sines) -> None:
    t = np.arange(2000) * 0.01
    motion = sines(t)
    made = recording(t, motion["q"], motion["effort"])
    data = prepare(made, Processing(rest_speed=(0.3, 0.4))).whole()
    np.testing.assert_array_equal(data.moving, np.abs(data.motion.dq) > [0.3, 0.4])
    assert (np.abs(data.motion.dq[[0, -1]]) >= [0.6, 0.8]).any(axis=1).all()


def test_quality_says_what_was_found(recording, sines) -> None:
    t = jittered(3000)
    t[1000:] += 2.0
    t[2500:] += 2.0
    t[2520:] += 2.0
    motion = sines(t)
    q = np.round(motion["q"], 4)
    q[[10, 11]] = 1e293
    t[500] = t[499]
    run = prepare(recording(t, q, motion["effort"]))
    quality = run.quality
    assert (quality.rows, quality.kept) == (3000, 2997)
    assert quality.dropped == {
        "an implausible value": 2,
        "a repeated time stamp": 1,
    }
    assert len(quality.gaps) == 3 and len(run.segments) == 3
    np.testing.assert_allclose(quality.resolution, 1e-4, rtol=1e-6)
    assert quality.steps[2] == pytest.approx(0.010, abs=1e-6)
    notes, losses = "\n".join(quality.notes), "\n".join(quality.losses)
    assert "dropped 3 of 3000 rows: 2 with an implausible value, 1 with" in quality.dropped_rows
    assert "3 gaps split the run" in losses and "1 stretch" in losses
    assert "resampled to 100 Hz" in notes and f"motion cut-off {run.motion_cutoff:g} Hz" in notes
    assert dict(quality.rows_of_text)["rows"] == "2997 of 3000 used"
    assert (quality.max_speed > 0.5).all()


def test_a_cut_stays_within_its_window(recording, sines) -> None:
    t = 300.0 + jittered(3000)
    motion = sines(t)
    run = prepare(recording(t, motion["q"], motion["effort"], window="@5:20"))
    data = run.whole()
    assert run.name == "run@5:20" and 5.0 <= data.t[0] < 5.1 and 19.9 < data.t[-1] < 20.0
    np.testing.assert_allclose(data.motion.q, sines(data.t + t[0])["q"], atol=2e-3)


def test_the_filter_looks_beyond_the_cut(recording, sines) -> None:
    t = np.arange(6000) * 0.01
    motion = sines(t)
    cutoffs = Processing(motion_cutoff=8.0, matched_cutoff=4.0)
    whole = prepare(recording(t, motion["q"], motion["effort"]), cutoffs).whole()
    for window in ("@20.005:40.005", "#2001:4001"):
        cut = prepare(recording(t, motion["q"], motion["effort"], window=window), cutoffs)
        data = cut.whole()
        assert data.t[0] == pytest.approx(20.01) and data.t[-1] == pytest.approx(40.0)
        same = np.round((data.t - whole.t[0]) * 100.0).astype(int)
        np.testing.assert_allclose(data.motion.ddq, whole.motion.ddq[same], atol=1e-6)
        assert cut.quality.rows == 2000


def test_runs_made_before_spare_the_survey(recording, sines, monkeypatch) -> None:
    t = np.arange(4000) * 0.005
    made = recording(t, sines(t)["q"], sines(t)["effort"])
    lower = Processing(matched_cutoff=2.0)
    (first,), (alone,) = (prepared([made], x, silent) for x in (Processing(), lower))
    monkeypatch.setattr("steelyard.runs.prepare.survey", None)
    (again,) = prepared([made], lower, silent, before=[first])
    assert again.matched_cutoff == alone.matched_cutoff != first.matched_cutoff
    for mine, others in zip(again.blocks(), alone.blocks(), strict=True):
        np.testing.assert_array_equal(mine.ddq, others.ddq)


def test_a_gap_beside_the_cut(recording, sines) -> None:
    """The segment starts at 20 s; the first half second is bent by the 2 Hz filter."""
    t = np.arange(6000) * 0.01
    t[1980:] += 0.2
    motion = sines(t)
    cutoffs = Processing(motion_cutoff=2.0, matched_cutoff=2.0)
    run = prepare(recording(t, motion["q"], motion["effort"], window="#2000:4000"), cutoffs)
    data = run.whole()
    assert data.t[0] == pytest.approx(20.5) and not run.quality.gaps
    assert (np.diff(data.t) < 0.011).all()
    beside = prepare(recording(t, motion["q"], motion["effort"], window="#1980:4000"), cutoffs)
    assert beside.whole().t[0] == pytest.approx(20.5)


def test_a_motion_shorter_than_the_filter(recording) -> None:
    t = np.arange(2000) * 0.01
    rise = np.clip((t - 10.0) / 0.3, 0, 1)
    q = np.stack([0.5 - 0.5 * np.cos(np.pi * rise), 0.0 * t], axis=1)
    made = recording(t, q, q)
    error = failing(made, Processing(motion_cutoff=20.0, matched_cutoff=4.0))
    assert "the motion in this log is shorter than its filter" in error.wrong


def test_csv_with_every_quirk_is_survived(recording, sines, tmp_path: Path) -> None:
    t = jittered(2000)
    motion = sines(t)
    made = recording(t, motion["q"], motion["effort"], suffix=".csv")
    path = tmp_path / "run.csv"
    lines = path.read_text().splitlines()
    lines[5] = "garbage," * 4
    lines[6] = lines[6].rsplit(",", 3)[0]
    lines[700] = ",".join(["nan", *lines[700].split(",")[1:]])
    lines[800] = ",".join(["1e293"] * 5)
    path.write_text("\n".join(lines[:-1]) + "\n" + lines[-1][:25])
    run = prepare(replace(made, log=open_log(path)))
    assert run.quality.rows == 2000
    assert sum(run.quality.dropped.values()) == 5
    assert "a cell that is missing or not a number" in run.quality.dropped


def failing(made: Recording, processing: Processing | None = None) -> LogError:
    with pytest.raises(LogError) as caught:
        prepare(made, processing)
    assert "run" in caught.value.where
    return caught.value


def test_a_log_shorter_than_its_filter(recording, sines) -> None:
    t = np.arange(100) * 0.01
    motion = sines(t)
    error = failing(recording(t, motion["q"], motion["effort"]), Processing(matched_cutoff=2.0))
    assert "2 Hz needs 2 s without a gap, the log has 0.99 s" in error.wrong
    assert "record for longer" in error.fix
    few = recording(t[:6], motion["q"][:6], motion["effort"][:6])
    assert "shorter than any filter: 6 rows" in failing(few).wrong


def test_a_static_log(recording) -> None:
    t = np.arange(1500) * 0.01
    noise = np.random.default_rng(0).standard_normal((1500, 2))
    for q in (np.ones((1500, 2)), 1e-5 * noise, np.round(3e-5 * noise, 4)):
        error = failing(recording(t, 0.5 + q, noise))
        assert error.wrong == "no joint moves in this log"
        given = Processing(motion_cutoff=12.0, matched_cutoff=4.0)
        run = prepare(recording(t, 0.5 + q, noise), given, at_rest=True)
        assert not any(block.moving.any() for block in run.blocks())
        assert run.duration == pytest.approx(15.0, abs=0.1)


def test_a_log_of_broken_rows(recording, sines) -> None:
    t = np.arange(500) * 0.01
    motion = sines(t)
    for efforts in (motion["effort"], motion["effort"] * np.nan):
        error = failing(recording(t, motion["q"] * np.nan, efforts))
        assert "every row of the log is invalid: 500 of 500" in error.wrong
        assert "[signals]" in error.fix


def test_a_window_beside_the_log(recording, sines) -> None:
    t = np.arange(500) * 0.01
    motion = sines(t)
    for window in ("@90:99", "#9000:"):
        error = failing(recording(t, motion["q"], motion["effort"], window=window))
        assert f"{window} holds no row: the log lasts 4.99 s (500 rows)" in error.wrong
        assert window in error.where


def test_an_empty_table(recording) -> None:
    none = np.zeros((0, 2))
    assert failing(recording(np.zeros(0), none, none)).wrong == "the log has no rows"


def test_a_column_that_the_log_lacks(recording, sines) -> None:
    t = np.arange(500) * 0.01
    motion = sines(t)
    made = recording(t, motion["q"], motion["effort"])
    with pytest.raises(LogError, match="no column 'tau_9'"):
        replace(made, signals=replace(made.signals, effort=("tau_0", "tau_9")))
