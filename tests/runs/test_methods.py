"""Methods from positions to motion, against scipy and formulas."""

import numpy as np
import pytest
from scipy.signal import butter, savgol_filter, sosfiltfilt

from steelyard.base.errors import LogError, ModelError
from steelyard.runs.processing_choices import (
    METHODS,
    SMOOTHERS,
    description_of,
    method_in_words,
    method_of,
    smoother_of,
)
from steelyard.runs.smoothing.kalman_smoother import CausalKalman
from steelyard.runs.smoothing.smoothing_methods_and_zero_phase_filters import (
    Butterworth,
    Method,
    Smoother,
    apply,
)
from steelyard.runs.smoothing.spline_and_finite_windows import FIR, MovingAverage, SavitzkyGolay

RATE, CUTOFF = 200.0, 10.0


def walk(seed: int = 0, samples: int = 2000) -> np.ndarray:
    return np.cumsum(np.random.default_rng(seed).normal(size=(2, samples)), axis=1)


@pytest.mark.parametrize("method", [m for m in METHODS.values() if m is not CausalKalman])
def test_every_method_follows_a_smooth_motion(method: type) -> None:
    """But the causal one, which is late."""
    t = np.arange(4000) / RATE
    w = 2.0 * np.pi * np.array([[0.5], [1.0]])
    q, dq = np.sin(w * t), w * np.cos(w * t)
    made = method()
    designed = made.designed(CUTOFF, RATE)
    halo = designed.halo or 0
    inner = slice(halo, len(t) - halo)
    for velocity in (None, dq):
        found = designed(q, velocity)
        assert found.shape == (3, 2, len(t) - 2 * halo)
        middle = slice(400, -400)
        for order, truth in enumerate((q, dq, -(w**2) * q)):
            error = np.abs(found[order] - truth[:, inner])[:, middle].max()
            assert error < 0.01 * np.abs(truth).max()


@pytest.mark.parametrize("name", [n for n in METHODS if n not in ("fourier",)])
def test_parts_of_a_local_method_are_the_whole(name: str) -> None:
    designed = METHODS[name]().designed(CUTOFF, RATE)
    if designed.halo is None:
        pytest.skip("takes whole segments")
    x, h = walk(), designed.halo
    whole = designed(x, None)
    part = designed(x[:, 300 : 700 + 2 * h], None)
    np.testing.assert_allclose(part, whole[:, :, 300:700], rtol=1e-9, atol=1e-8 * np.abs(x).max())


def test_savitzky_golay_is_scipys() -> None:
    x = walk()
    for window, degree in ((21, 4), (31, 2), (11, 7)):
        found = SavitzkyGolay(window, degree).designed(CUTOFF, RATE)(x, None)
        for order in range(3):
            expected = savgol_filter(x, window, degree, deriv=order, delta=1.0 / RATE)
            inner = expected[:, window // 2 : -(window // 2)]
            scale = np.abs(inner).max()
            np.testing.assert_allclose(found[order], inner, rtol=0.0, atol=1e-8 * scale)


def test_savitzky_golay_finds_its_window() -> None:
    for degree in (2, 4, 6):
        method = SavitzkyGolay(degree=degree)
        window = method.window_for(5.0, 1000.0)
        bank = method.smooth(5.0, 1000.0)
        at = np.arange(window) - window // 2
        gain = abs((bank.taps * np.exp(-2j * np.pi * 5.0 / 1000.0 * at)).sum())
        assert gain == pytest.approx(0.5, abs=0.02)


def test_butterworth_orders_are_scipys() -> None:
    x = walk()
    for order in (2, 3, 6):
        bank = Butterworth(order).smooth(CUTOFF, RATE)
        expected = sosfiltfilt(butter(order, CUTOFF, fs=RATE, output="sos"), x)
        h = bank.halo
        assert len(x[0]) > 2 * h + 800
        middle = slice(400, -400)
        np.testing.assert_allclose(bank(x)[:, middle], expected[:, h:-h][:, middle], atol=1e-6)


def test_fir_passes_and_stops() -> None:
    taps = FIR(suppression=60.0).taps(CUTOFF, RATE)
    at = np.arange(len(taps)) - len(taps) // 2

    def gain(f: float) -> float:
        return float((taps * np.cos(2.0 * np.pi * f / RATE * at)).sum())

    assert taps.sum() == pytest.approx(1.0)
    np.testing.assert_allclose(taps, taps[::-1], atol=1e-15)
    assert gain(CUTOFF) == pytest.approx(0.5, abs=2e-3)
    assert abs(gain(0.5 * CUTOFF) - 1.0) < 2e-3 and abs(gain(1.55 * CUTOFF)) < 2e-3
    t = np.arange(3000) / RATE
    w = 2.0 * np.pi * 3.0
    designed = FIR().designed(CUTOFF, RATE)
    q, dq, ddq = designed(np.sin(w * t)[None], None)[:, 0]
    inner = slice(designed.halo, -designed.halo)
    np.testing.assert_allclose(q, np.sin(w * t)[inner], atol=3e-4)
    np.testing.assert_allclose(dq, w * np.cos(w * t)[inner], atol=3e-4 * w)
    np.testing.assert_allclose(ddq, -(w**2) * np.sin(w * t)[inner], atol=3e-4 * w**2)


def test_a_fir_that_does_not_fit_says_so() -> None:
    with pytest.raises(LogError, match="does not fit samples at 200 Hz") as caught:
        FIR(transition=2.0).designed(80.0, 200.0)
    assert "transition below" in caught.value.fix


def test_central_differences_are_those_of_the_paper() -> None:
    rng = np.random.default_rng(0)
    theta, step = rng.normal(size=(30, 2)), 0.03
    first = (theta[2:] - theta[:-2]) / (2.0 * step)
    second = (first[2:] - first[:-2]) / (2.0 * step)
    found = MovingAverage(5).designed(CUTOFF, 1.0 / step)(theta.T, None)
    assert found.shape == (3, 2, 30 - 8)
    np.testing.assert_array_equal(found[0], theta[4:-4].T)
    np.testing.assert_allclose(found[1], first[3:-3].T)
    for k in range(22):
        np.testing.assert_allclose(found[2][:, k], second[k : k + 5].mean(axis=0))


@pytest.mark.parametrize("name", [name for name in SMOOTHERS if "kalman" not in name])
def test_passes_are_the_smoother_applied_repeatedly(name: str) -> None:
    """Ends included, and whatever the parts a segment comes in."""
    once = smoother_of({"method": name}, "here").smooth(CUTOFF, RATE)
    thrice = smoother_of({"method": name, "passes": 3}, "here").smooth(CUTOFF, RATE)
    assert thrice.halo == 3 * (once.halo or 0)
    x = walk(samples=3000)
    expected = x
    for _ in range(3):
        expected = np.concatenate(list(apply(once, [expected])), axis=1)
    parts = np.concatenate(list(apply(thrice, np.split(x, [7, 400, 900], axis=1), 50)), axis=1)
    np.testing.assert_allclose(parts, expected, atol=1e-5 * np.abs(x).max())
    assert np.abs(expected - np.concatenate(list(apply(once, [x])), axis=1)).max() > 0.1


@pytest.mark.parametrize("name", ["butterworth", "fir", "savitzky_golay"])
def test_passes_of_a_low_pass_of_motion_smooth_before_it(name: str) -> None:
    """Two passes are one pass of positions that were smoothed by the same filter."""
    smooth = smoother_of(name, "here").smooth(CUTOFF, RATE)
    once = method_of(name, "here").designed(CUTOFF, RATE)
    twice = method_of({"method": name, "passes": 2}, "here").designed(CUTOFF, RATE)
    assert once.halo is not None and twice.halo == 2 * once.halo
    x = walk(samples=4000)
    for velocity in (None, walk(1, 4000)):
        found = twice(x, velocity)
        before = None if velocity is None else smooth(velocity)
        expected = once(smooth(x), before)
        spare = (expected.shape[2] - found.shape[2]) // 2
        assert found.shape[2] > 500
        inner = expected[:, :, spare : expected.shape[2] - spare]
        for order in range(3):
            scale = np.abs(inner[order]).max()
            np.testing.assert_allclose(found[order], inner[order], atol=2e-4 * scale)


def test_passes_of_the_moving_average_are_of_accelerations() -> None:
    x = walk(samples=200)
    once = MovingAverage(1).designed(CUTOFF, RATE)(x, None)
    found = MovingAverage(5, passes=2).designed(CUTOFF, RATE)(x, None)
    triangle = np.array([1, 2, 3, 4, 5, 4, 3, 2, 1]) / 25.0
    for joint in range(2):
        expected = np.convolve(once[2, joint], triangle, mode="valid")
        np.testing.assert_allclose(found[2, joint], expected, atol=1e-8 * RATE**2)
        np.testing.assert_array_equal(found[:2, joint], once[:2, joint, 4:-4])


@pytest.mark.parametrize("name", SMOOTHERS)
def test_smoothers_keep_a_constant(name: str) -> None:
    smoother: Smoother = smoother_of(name, "here")
    smooth = smoother.smooth(CUTOFF, RATE)
    halo = smooth.halo or 0
    np.testing.assert_allclose(
        smooth(np.full((2, 100 + 2 * halo), 3.0)),
        3.0 * np.ones_like(smooth(np.full((2, 100 + 2 * halo), 3.0))),
        rtol=1e-6,
    )


@pytest.mark.parametrize("name", METHODS)
def test_descriptions_come_back(name: str) -> None:
    method: Method = method_of(name, "here")
    assert method_of(description_of(method), "here") == method
    assert method_in_words(method).startswith(name.replace("_", " "))


def test_settings_are_kept() -> None:
    method = method_of({"method": "savitzky_golay", "window": 21, "degree": 3}, "here")
    assert method == SavitzkyGolay(21, 3)
    assert method_of(description_of(method), "here") == method
    assert method_in_words(method) == "savitzky golay, window 21, degree 3"
    twice = smoother_of({"method": "moving_average", "span": 9, "passes": 2}, "here")
    assert twice == MovingAverage(9, 2) and smoother_of(description_of(twice), "here") == twice
    assert method_in_words(twice) == "moving average, span 9, passes 2"


@pytest.mark.parametrize(
    ("given", "wrong", "fix"),
    [
        ("butterwort", "'butterwort' is no method for motion", "did you mean 'butterworth'"),
        ({"order": 3}, "does not name its method", "the methods are auto"),
        ({"method": "fir", "supression": 3}, "does not understand 'supression'", "'suppression'"),
        ({"method": "moving_average", "sp": 3}, "does not understand 'sp'", "span"),
        ({"method": "butterworth", "order": 2.5}, "2.5 cannot be used for 'order'", "integer"),
        ({"method": "butterworth", "order": True}, "True cannot be used for 'order'", "integer"),
        ({"method": "butterworth", "order": 1}, "cannot be differentiated twice", "2 to 12"),
        ({"method": "butterworth", "order": 40}, "rings", "2 to 12"),
        ({"method": "savitzky_golay", "window": 20}, "a window of 20 samples", "odd number"),
        ({"method": "savitzky_golay", "degree": 1}, "degree 1", "from 2"),
        ({"method": "moving_average", "span": 4}, "has no middle", "odd number"),
        ({"method": "moving_average", "span": -1}, "is not valid", "odd number"),
        ({"method": "fir", "suppression": 500.0}, "500 dB", "20 to 120 dB"),
        ({"method": "moving_average", "passes": 0}, "applied 0 times", "from 1 to 20"),
        ({"method": "butterworth", "passes": 21}, "applied 21 times", "from 1 to 20"),
        ({"method": "savitzky_golay", "passes": 0}, "applied 0 times", "from 1 to 20"),
        ({"method": "fir", "passes": -1}, "applied -1 times", "from 1 to 20"),
        ({"method": "fir", "passes": 2.0}, "2.0 cannot be used for 'passes'", "integer"),
        ({"method": "fir", "transition": 0.0}, "a transition of 0", "up to 2"),
    ],
)
def test_mistakes_are_reported(given: object, wrong: str, fix: str) -> None:
    with pytest.raises(ModelError) as caught:
        method_of(given, "robot.toml, line 7")  # type: ignore[arg-type]
    assert wrong in caught.value.wrong and fix in caught.value.fix
    assert caught.value.where == "robot.toml, line 7"
