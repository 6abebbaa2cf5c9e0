"""Laws of exact trajectories, for all kinds."""

import json
from dataclasses import replace

import numpy as np
import pytest

from exact_motions import MAKERS
from steelyard.base.errors import DataError
from steelyard.excite.trajectories.exact_trajectories import (
    ChainedMotion,
    ExactTrajectory,
    PiecewiseMotion,
    SlowedMotion,
    from_scipy,
    quintic,
    through_postures,
)
from steelyard.excite.trajectories.fourier import FourierMotion, repeated
from steelyard.excite.trajectories.trajectory_files import KINDS, trajectory_from_dict

CASES = pytest.mark.parametrize("seed", range(2))
KIND = pytest.mark.parametrize("make", MAKERS, ids=lambda make: make.__name__)


def inside(motion: ExactTrajectory, count: int) -> np.ndarray:
    """Times that keep away from the breaks."""
    t = np.linspace(0.0, motion.duration, count)
    away = np.abs(t[:, None] - motion.breaks).min(axis=1)
    return t[away > 1e-3 * motion.duration]


def attained(motion: ExactTrajectory, order: int) -> tuple[np.ndarray, np.ndarray]:
    """Least and greatest value of a search that refines its grid thrice."""
    sides = np.concatenate([motion.breaks, motion.breaks - 1e-12 * motion.duration])
    coarse = np.sort(np.concatenate([np.linspace(0.0, motion.duration, 5001), sides]))
    coarse = coarse[coarse >= 0.0]
    found = []
    for sign in (-1.0, 1.0):
        values = sign * motion.derivative(coarse, order)
        best = values.max(axis=0)
        for joint, middle in enumerate(coarse[values.argmax(axis=0)]):
            width = motion.duration / 5000
            for _ in range(2):
                t = np.clip(np.linspace(middle - width, middle + width, 1001), 0, motion.duration)
                here = sign * motion.derivative(t, order)[:, joint]
                best[joint] = max(best[joint], here.max())
                middle, width = t[here.argmax()], width / 400.0
        found.append(sign * best)
    return found[0], found[1]


@KIND
@CASES
@pytest.mark.parametrize("order", range(4))
def test_extremes_are_never_exceeded_and_attained(make, seed: int, order: int) -> None:
    motion = make(np.random.default_rng(seed))
    least, greatest = motion.extremes(order)
    low, high = attained(motion, order)
    size = np.maximum(np.abs(low), np.abs(high))
    assert least.shape == greatest.shape == (3,)
    assert np.all(low >= least - 1e-12 * size) and np.all(high <= greatest + 1e-12 * size)
    assert np.all(low - least <= 1e-9 * size) and np.all(greatest - high <= 1e-9 * size)


@KIND
@CASES
def test_derivatives_match_central_differences(make, seed: int) -> None:
    motion = make(np.random.default_rng(seed))
    t, h = inside(motion, 301), 2e-6 * motion.duration
    for order in range(3):
        slope = motion.derivative(t + h, order) - motion.derivative(t - h, order)
        exact = motion.derivative(t, order + 1)
        error = np.abs(slope / (2.0 * h) - exact).max()
        assert error < 1e-6 * max(1.0, np.abs(exact).max())


@KIND
@CASES
def test_samples_are_the_derivatives_and_rest_outside(make, seed: int) -> None:
    motion = make(np.random.default_rng(seed))
    t = np.linspace(0.0, motion.duration, 55)
    got = motion.sample(t)
    for order, values in enumerate((got.q, got.dq, got.ddq)):
        np.testing.assert_allclose(values, motion.derivative(t, order), rtol=1e-13, atol=1e-12)
    outside = motion.sample([-1.0, motion.duration + 1.0])
    assert not outside.dq.any() and not outside.ddq.any()
    np.testing.assert_allclose(outside.q, got.q[[0, -1]], atol=1e-12)


@KIND
def test_a_single_time_is_one_sample(make) -> None:
    motion = make(np.random.default_rng(0))
    for trajectory in (motion, SlowedMotion(motion, 0.5)):
        many = trajectory.sample([0.3, 0.7])
        for time in (0.7, np.float64(0.7), np.array(0.7)):
            one = trajectory.sample(time)
            np.testing.assert_array_equal(one.t, [0.7])
            for name in ("q", "dq", "ddq"):
                np.testing.assert_allclose(getattr(one, name), getattr(many, name)[1:], rtol=1e-13)
        for wrong in ([[0.1], [0.2]], "soon", [np.nan], [[0.1], [0.2, 0.3]]):
            with pytest.raises(DataError, match="'t' "):
                trajectory.sample(wrong)


@KIND
@CASES
def test_breaks_span_the_time_and_nothing_jumps_between(make, seed: int) -> None:
    motion = make(np.random.default_rng(seed))
    breaks = motion.breaks
    assert breaks[0] == 0.0 and breaks[-1] == motion.duration and np.all(np.diff(breaks) > 0.0)
    span = np.diff(breaks)
    for order in range(4):
        near = [motion.derivative(breaks[:-1] + f * span, order) for f in (1e-7, 0.5, 1 - 1e-7)]
        nearer = [
            motion.derivative(breaks[:-1] + f * span, order) for f in (2e-7, 0.5 + 1e-7, 1 - 2e-7)
        ]
        size = 1.0 + max(np.abs(bound).max() for bound in motion.extremes(order))
        assert np.abs(np.array(near) - nearer).max() < 1e-4 * size


@KIND
@CASES
def test_round_trip_keeps_all_digits(make, seed: int) -> None:
    motion = make(np.random.default_rng(seed))
    values = json.loads(json.dumps(motion.to_dict()))
    back = trajectory_from_dict(values)
    assert values["kind"] in KINDS and type(back) is type(motion)
    t = np.linspace(0.0, motion.duration, 101)
    for order in range(4):
        np.testing.assert_array_equal(back.derivative(t, order), motion.derivative(t, order))


@KIND
def test_positions_are_continuous(make) -> None:
    motion = make(np.random.default_rng(9))
    t = np.linspace(0.0, motion.duration, 20_001)
    speed = np.max(np.abs(motion.extremes(1)), axis=0)
    assert np.all(np.abs(np.diff(motion.derivative(t, 0), axis=0)) <= speed * t[1] + 1e-9)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("order", range(4))
def test_series_equal_the_roots_on_the_unit_circle(seed: int, order: int) -> None:
    rng = np.random.default_rng(seed)
    sine, cosine = rng.standard_normal((2, 1, 6))
    motion = FourierMotion(np.zeros(1), sine, cosine, 7.0, rests=False)
    k = np.arange(1, 7)
    waves = (cosine[0] - 1j * sine[0]) / 2.0 * (2j * np.pi / 7.0 * k) ** order
    slope = waves * 1j * k
    roots = np.roots(np.concatenate([slope[::-1], [0.0], slope.conj()]))
    angles = np.angle(roots[np.abs(np.abs(roots) - 1.0) < 1e-6])
    values = 2.0 * np.real(np.exp(1j * np.outer(angles, k)) @ waves)
    values -= cosine.sum() if order == 0 else 0.0
    least, greatest = motion.extremes(order)
    assert least[0] == pytest.approx(values.min(), rel=1e-11)
    assert greatest[0] == pytest.approx(values.max(), rel=1e-11)


def test_minimum_jerk_has_its_known_peaks() -> None:
    motion = through_postures([[0.0, 1.0], [1.0, -1.0]], 2.0)
    np.testing.assert_allclose(motion.extremes(1)[1][0], 15 / 8 / 2, rtol=1e-12)
    np.testing.assert_allclose(
        motion.extremes(2)[1], np.array([1, 2]) * 10 / 3**0.5 / 4, rtol=1e-12
    )
    np.testing.assert_allclose(motion.extremes(3)[0], [-30 / 8, -120 / 8], rtol=1e-12)


def test_a_dwell_stands_still() -> None:
    motion = through_postures([[0.0], [1.0], [3.0]], [1.0, 2.0], 0.5)
    assert motion.duration == 4.0
    np.testing.assert_array_equal(motion.derivative([1.2, 3.9], 0), [[1.0], [3.0]])
    assert not motion.derivative([1.2, 3.9], 1).any()


def test_quintic_meets_both_ends() -> None:
    ends = np.random.default_rng(0).standard_normal((2, 3, 4))
    motion = PiecewiseMotion(np.array([0.0, 1.7]), quintic(ends[0], ends[1], 1.7))
    for order in range(3):
        got = motion.derivative([0.0, 1.7], order)
        np.testing.assert_allclose(got, ends[:, order], atol=1e-12)


def test_splines_of_scipy_are_taken_over() -> None:
    from scipy.interpolate import CubicSpline, make_interp_spline

    rng = np.random.default_rng(0)
    t, q = np.sort(rng.uniform(0.0, 5.0, 9)) - 0.0, rng.standard_normal((9, 5))
    t[0] = 0.0
    fine = np.linspace(0.0, t[-1], 77)
    for curve in (CubicSpline(t, q), make_interp_spline(t, q, k=5)):
        motion = from_scipy(curve)
        for order in range(3):
            got = motion.derivative(fine, order)
            np.testing.assert_allclose(got, curve(fine, order), atol=1e-10)


def test_repeating_a_series_adds_periods() -> None:
    motion = MAKERS[0](np.random.default_rng(0))
    more = repeated(motion, 3)
    assert isinstance(more, FourierMotion) and more.duration == 3 * motion.duration
    thrice = repeated(repeated(MAKERS[4](np.random.default_rng(0)), 2), 3)
    assert isinstance(thrice, ChainedMotion) and thrice.times == 18
    assert repeated(through_postures([[0.0], [1.0]], 1.0), 1).duration == 1.0


def test_old_series_without_rests_are_read() -> None:
    values = MAKERS[0](np.random.default_rng(0)).to_dict()
    assert values.pop("rests") is True
    back = trajectory_from_dict(values)
    assert isinstance(back, FourierMotion) and back.rests
    moving = MAKERS[1](np.random.default_rng(0)).to_dict()
    assert moving.pop("rests") is False
    with pytest.raises(ValueError, match="does not start at rest"):
        trajectory_from_dict(moving)


def test_parts_that_do_not_join_are_refused() -> None:
    there = through_postures([[0.0, 0.0], [1.0, 1.0]], 2.0)
    away = through_postures([[1.0, 1.5], [1.0, 1.0]], 2.0)
    with pytest.raises(ValueError, match=r"do not join: joint 2 jumps by 0\.5 at 2 s"):
        ChainedMotion((there, away))
    with pytest.raises(ValueError, match="do not join: joint 1 jumps by 1 at 2 s"):
        repeated(there, 2)
    with pytest.raises(ValueError, match=r"moves? \[1, 2\] joints"):
        ChainedMotion((there, through_postures([[1.0], [1.0]], 2.0)))
    with pytest.raises(ValueError, match="0 parts are no motion"):
        ChainedMotion(())
    near = through_postures([[1.0, 1.0 + 9e-10], [0.0, 0.0]], 1.0)
    assert ChainedMotion((there, near), times=2).duration == 6.0


@pytest.mark.parametrize(
    "breaks, shape, words",
    [
        ([0.0], (0, 2, 1), "rise from 0"),
        ([1.0, 2.0], (1, 2, 1), "rise from 0"),
        ([0.0, 2.0, 1.0], (2, 2, 1), "rise from 0"),
        ([0.0, np.nan], (1, 2, 1), "rise from 0"),
        ([0.0, np.inf], (1, 2, 1), "not finite"),
        ([0.0, 1.0], (2, 2, 1), "expected an array of 1"),
        ([0.0, 1.0], (1, 0, 1), "no coefficients"),
    ],
)
def test_pieces_that_are_none_are_refused(breaks, shape, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        PiecewiseMotion(breaks, np.zeros(shape))
    with pytest.raises(ValueError, match="joint 1 jumps by 1 at 1 s"):
        PiecewiseMotion(np.arange(3.0), np.array([[[0.0]], [[1.0]]]))


def test_sums_and_ramps_that_do_not_fit_are_refused() -> None:
    series = MAKERS[1](np.random.default_rng(0))
    assert isinstance(series, FourierMotion)
    line = np.zeros((1, 1, 3))
    for trend, words in (
        (PiecewiseMotion(np.array([0.0, 1e3]), line), "equally long"),
        (PiecewiseMotion(series.breaks, line[:, :, :2]), "numbers of joints"),
        (PiecewiseMotion(series.breaks, np.zeros((1, 15, 3))), "degree above 13"),
    ):
        with pytest.raises(ValueError, match=words):
            replace(series, trend=trend)
    for ramp in (0.0, 0.51 * series.duration, np.nan):
        with pytest.raises(ValueError, match="does not fit twice into"):
            series.ramped(np.zeros(3), ramp)


def test_postures_and_times_are_checked() -> None:
    with pytest.raises(ValueError, match="there are two or more"):
        through_postures([[0.0]], 1.0)
    for move, dwell in ((0.0, 0.0), (1.0, -1.0), (np.inf, 0.0)):
        with pytest.raises(ValueError, match="breaks of a motion rise|not finite"):
            through_postures([[0.0], [1.0]], move, dwell)


def test_a_posture_that_is_no_number_is_refused() -> None:
    series = MAKERS[1](np.random.default_rng(0))
    assert isinstance(series, FourierMotion)
    with pytest.raises(ValueError, match="coefficient of the motion is not finite"):
        series.ramped([0.0, np.nan, 0.0], 0.1)
