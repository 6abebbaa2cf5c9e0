"""Outliers, repeats and saturation: found, bridged, left out, and only where they are."""

import numpy as np

from steelyard.runs.prepare import prepare
from steelyard.runs.processing_choices import Processing
from steelyard.runs.rows.faulty_row_detectors import (
    Extremes,
    bridged,
    outlying,
    saturated,
    sensor_step,
    stale_rows,
    usual_distance,
)

RATE = 250.0


def noisy(sines, seconds: float = 40.0, seed: int = 0) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    t = np.arange(int(seconds * RATE)) / RATE
    rng = np.random.default_rng(seed)
    motion = sines(t)
    motion["q"] = motion["q"] + 1e-5 * rng.normal(size=motion["q"].shape)
    motion["effort"] = motion["effort"] + 0.02 * rng.normal(size=motion["effort"].shape)
    return t, motion


def test_spikes_are_found_and_nothing_else(recording, sines) -> None:
    t, motion = noisy(sines)
    clean = prepare(recording(t, motion["q"], motion["effort"])).quality
    assert clean.marked.outliers <= 1e-4 * 4 * len(t) and clean.marked.stale == 0
    rng = np.random.default_rng(1)
    rows = 50 + 90 * np.arange(100)
    widths = rng.integers(1, 4, len(rows))
    q, effort = motion["q"].copy(), motion["effort"].copy()
    for row, width in zip(rows, widths, strict=True):
        effort[row : row + width, row % 2] += rng.choice([-1.0, 1.0]) * rng.uniform(1.0, 50.0)
        q[row + 40 : row + 40 + width, row % 2] += rng.choice([-1.0, 1.0]) * 0.01
    run = prepare(recording(t, q, effort))
    assert 0.9 * 2 * widths.sum() <= run.quality.marked.outliers <= 2 * widths.sum() + 4
    assert any("outliers interpolated" in loss for loss in run.quality.losses)
    plain = prepare(recording(t, motion["q"], motion["effort"])).whole()
    data = run.whole()
    first, last = max(data.t[0], plain.t[0]), min(data.t[-1], plain.t[-1])
    a, b = (d.motion.ddq[(d.t >= first) & (d.t <= last)] for d in (data, plain))
    assert np.abs(a - b).max() < 0.05 * np.abs(b).max()
    kept = prepare(recording(t, q, effort), Processing(outliers=None)).whole()
    assert np.abs(kept.motion.ddq).max() > 3.0 * np.abs(data.motion.ddq).max()


def test_marked_efforts_do_not_count(recording, sines) -> None:
    t, motion = noisy(sines)
    effort = motion["effort"].copy()
    effort[5000:5002, 1] += 30.0
    run = prepare(recording(t, motion["q"], effort))
    weights = run.whole().weights
    assert weights is not None
    dropped = np.argwhere(weights == 0.0)
    assert set(dropped[:, 1]) == {1} and 2 <= len(dropped) <= 4
    np.testing.assert_allclose(run.whole().t[dropped[:, 0]], 20.0, atol=0.02)
    clean = prepare(recording(t, motion["q"], motion["effort"])).whole()
    assert clean.weights is None


def test_the_median_says_what_stands_out() -> None:
    """Hampel's rule written down: the distance from the median in median deviations."""
    rng = np.random.default_rng(3)
    x = rng.normal(size=(1, 400))
    x[0, [50, 51, 52, 200, 330]] += [30.0, 28.0, 33.0, -25.0, 40.0]
    usual = usual_distance(x)
    marks = outlying(x, usual, 6.0)
    expected = []
    for k in range(4, 396):
        window = x[0, k - 4 : k + 5]
        rise = np.median(window[-3:]) - np.median(window[:3])
        window = window - rise * np.arange(-4, 5) / 6.0
        deviation = 1.4826 * np.median(np.abs(window - np.median(window)))
        if abs(window[4] - np.median(window)) > 6.0 * max(usual[0], deviation):
            expected.append(k)
    assert expected == np.flatnonzero(marks[0]).tolist() == [50, 51, 52, 200, 330]


def test_steps_and_reversals_are_motion() -> None:
    t = np.arange(2000) * 0.004
    friction = np.sign(np.sin(2.0 * t)) + 0.3 * np.sin(5.0 * t)
    triangle = np.abs(np.mod(t, 2.0) - 1.0)
    rest = np.where(np.mod(t, 3.0) < 1.5, 0.0, np.sin(np.pi * (t - 1.5)))
    x = np.stack((friction, triangle, rest))
    assert not outlying(x, usual_distance(x), 10.0).any()


def test_bridges_are_cubic_in_motion_and_straight_in_efforts() -> None:
    rng = np.random.default_rng(0)
    t = np.cumsum(rng.uniform(0.5, 1.5, 40))
    cubic = 0.01 * t**3 - t
    x = np.stack((cubic, cubic))
    marks = np.zeros(x.shape, dtype=bool)
    marks[:, 10:13] = marks[:, 20] = marks[:, 22] = True
    spoilt = np.where(marks, 99.0, x)
    filled = bridged(t, spoilt, marks, [0])
    np.testing.assert_allclose(filled[0], cubic, rtol=1e-9, atol=1e-9)
    good = ~marks[1]
    np.testing.assert_allclose(filled[1], np.interp(t, t[good], cubic[good]), rtol=1e-9)


def test_repeated_rows_are_bridged_in_motion_only(recording, sines) -> None:
    t, motion = noisy(sines)
    q, effort = motion["q"].copy(), motion["effort"].copy()
    rows = np.arange(400, 9000, 100)
    fast = np.abs(motion["dq"][rows]).max(axis=1) > 0.2
    q[rows], effort[rows] = q[rows - 1], effort[rows - 1]
    q[9500:] = q[9500]
    run = prepare(recording(t, q, effort))
    assert run.quality.marked.stale >= fast.sum() and run.quality.marked.stale <= len(rows)
    plain = prepare(recording(t, motion["q"], motion["effort"]))
    kept = prepare(recording(t, q, effort), Processing(bridge_repeats=False))
    inside = slice(100, 8000)
    truth = plain.whole().motion.ddq[inside]
    wrong, corrected = (np.abs(r.whole().motion.ddq[inside] - truth).max() for r in (kept, run))
    assert corrected < 0.2 * wrong


def test_a_slow_coarse_sensor_is_not_stale() -> None:
    t = np.arange(4000) * 0.001
    q = np.round(np.stack((0.02 * np.sin(t), 0.05 * np.cos(t))), 4)
    assert not stale_rows(q, sensor_step(q)).any()


def test_saturation_is_distinguished_from_peaks(recording, sines) -> None:
    t, motion = noisy(sines)
    limit = 0.8 * np.abs(motion["effort"][:, 0]).max()
    effort = motion["effort"].copy()
    effort[:, 0] = np.clip(effort[:, 0], -limit, limit)
    run = prepare(recording(t, motion["q"], effort))
    at_limit = np.abs(effort[:, 0]) == limit
    assert 0.9 * at_limit.sum() < run.quality.marked.cut_off <= at_limit.sum()
    data = run.whole()
    assert data.weights is not None and (data.weights[:, 1] == 1.0).all()
    near = np.abs(np.interp(data.t, t, effort[:, 0])) > 0.999 * limit
    assert (data.weights[near, 0] == 0.0).mean() > 0.95
    assert 0.05 < (data.weights[:, 0] == 0.0).mean() < 0.9
    left = prepare(recording(t, motion["q"], effort), Processing(leave_out_saturated=False))
    assert left.whole().weights is None
    coarse = np.round(motion["effort"], 1)
    assert prepare(recording(t, motion["q"], coarse)).quality.marked.cut_off == 0


def test_extremes_do_not_depend_on_the_split() -> None:
    rng = np.random.default_rng(0)
    swing = 30.0 * np.sin(np.arange(5000) / 50.0) + rng.normal(size=(2, 5000))
    x = np.clip(swing, -20.0, 15.0)
    found = []
    for cuts in ([], [1, 7, 1000, 1001, 1500, 4000], list(range(50, 5000, 37))):
        extremes = Extremes(2)
        for part in np.split(x, cuts, axis=1):
            extremes.add(part)
        found.append(extremes.limits(np.full(2, 1e-9)))
    np.testing.assert_array_equal(found[0], [[-20.0, 15.0]] * 2)
    for other in found[1:]:
        np.testing.assert_array_equal(found[0], other)
    marks = saturated(x, found[0])
    assert marks.any() and (np.isin(x, (-20.0, 15.0)) >= marks).all()
