"""The whole chain: any split gives the same, clocks, interpolations, delays."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline, PchipInterpolator

from steelyard.base.errors import LogError, ModelError
from steelyard.robot.file.sections import ProcessingSection
from steelyard.runs.prepare import prepare
from steelyard.runs.processing_choices import METHODS, Processing, method_of, requested_processing
from steelyard.runs.recording import Recording
from steelyard.runs.rows.resampling import (
    CUBIC,
    INTERPOLATIONS,
    WORST_NEIGHBOUR,
    Lane,
    Thinning,
    interpolated,
    sample_count,
)
from steelyard.runs.smoothing.kalman_smoother import CausalKalman, KalmanSmoother
from steelyard.runs.smoothing.smoothing_methods_and_zero_phase_filters import Butterworth
from steelyard.runs.smoothing.spline_and_finite_windows import MovingAverage

WHOLE = [n for n, method in METHODS.items() if method().designed(8.0, 100.0).halo is None]
CHAINS = {
    "default": Processing(),
    "linear": Processing(12.0, 4.0, resampling="linear"),
    "pchip and averages": Processing(
        12.0, 4.0, resampling="pchip", motion=MovingAverage(7), effort=MovingAverage(9)
    ),
    "spline and thinned": Processing(10.0, 4.0, resampling="spline", rate=50.0),
    "smoothed efforts": Processing(
        12.0, 4.0, motion=method_of("savitzky_golay", ""), effort=Butterworth(), effort_cutoff=9.0
    ),
    "repeated passes": Processing(
        12.0, 4.0, motion=MovingAverage(5, passes=2), effort=MovingAverage(9, passes=3)
    ),
    "efforts by kalman": Processing(12.0, 4.0, effort=KalmanSmoother(choose="cutoff")),
    "fir": Processing(12.0, 4.0, motion=method_of("fir", ""), outliers=None),
}


def spoilt(sines, seconds: float = 60.0) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """An uneven clock, noise, spikes, repeats and a limit."""
    rng = np.random.default_rng(0)
    t = np.cumsum(rng.choice([0.004, 0.005], int(seconds / 0.0045)))
    motion = sines(t)
    motion["q"] = motion["q"] + 1e-5 * rng.normal(size=motion["q"].shape)
    motion["dq"] = motion["dq"] + 1e-3 * rng.normal(size=motion["q"].shape)
    effort = motion["effort"] + 0.02 * rng.normal(size=motion["q"].shape)
    effort[300::997, 0] += 20.0
    motion["effort"] = np.clip(effort, -1.5, 1.5)
    motion["effort"][300::997, 0] += 20.0
    motion["q"][777::1301] = motion["q"][776::1301][: len(motion["q"][777::1301])]
    return t, motion


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "velocities"), [("default", True), *((x, bool(k % 2)) for k, x in enumerate(CHAINS))]
)
def test_any_split_gives_the_same(recording, sines, monkeypatch, name: str, velocities) -> None:
    t, motion = spoilt(sines, 25.0)
    dq = motion["dq"] if velocities else None
    made = recording(t, motion["q"], motion["effort"], dq)
    late = replace(made.signals, effort_delay=0.0123, velocity_delay=0.004 if velocities else 0.0)
    made = replace(made, signals=late)
    whole = prepare(made, CHAINS[name])
    data = whole.whole()
    raw = Recording.raw
    monkeypatch.setattr(Recording, "raw", lambda self, rows, size=0: raw(self, rows, 331))
    monkeypatch.setattr("steelyard.runs.processing_chain.SAMPLES_OF_PART", 500)
    again = prepare(made, CHAINS[name])
    parts = again.whole()
    assert again.quality.marked == whole.quality.marked
    assert (again.span, again.n_samples) == (whole.span, whole.n_samples)
    for x in ("q", "dq", "ddq"):
        a, b = getattr(data.motion, x), getattr(parts.motion, x)
        np.testing.assert_allclose(b, a, atol=1e-9 * np.abs(a).max())
    np.testing.assert_allclose(parts.effort, data.effort, atol=1e-9)
    assert (data.weights is None) == (parts.weights is None)
    if data.weights is not None and parts.weights is not None:
        np.testing.assert_array_equal(parts.weights, data.weights)


@pytest.mark.parametrize("name", [n for n in WHOLE if n != CausalKalman.name])
def test_methods_of_whole_segments_work_in_a_run(recording, sines, name: str) -> None:
    t = np.arange(4000) * 0.01
    motion = sines(t)
    made = recording(t, motion["q"], motion["effort"], window="@5:35")
    data = prepare(made, Processing(8.0, 4.0, motion=METHODS[name]())).whole()
    truth = sines(data.t)
    inner = slice(200, -200)
    np.testing.assert_allclose(data.motion.q[inner], truth["q"][inner], atol=2e-3)
    error = np.abs(data.motion.ddq - truth["ddq"])[inner].max()
    assert error < 0.03 * np.abs(truth["ddq"]).max()


@pytest.mark.parametrize("kind", ["pchip", "spline"])
def test_interpolations_are_scipys_by_parts(kind: str) -> None:
    rng = np.random.default_rng(0)
    t, x = np.cumsum(rng.uniform(0.5, 1.5, 900)), rng.normal(size=(900, 2))
    reference = {"pchip": PchipInterpolator, "spline": CubicSpline}[kind](t, x)
    way = INTERPOLATIONS[kind]
    for first in (0, 100, 250, 500):
        low, high = max(0, first - way.margin), min(len(t), first + 200 + way.margin)
        at = np.linspace(t[first], t[first + 199], 500)
        found = interpolated(t[low:high], x[low:high].T, at, [Lane(slice(None), way)])
        np.testing.assert_allclose(found, reference(at).T, atol=1e-10)


def test_flags_take_the_worse_neighbour() -> None:
    t, flags = np.arange(5.0), np.array([[0.0, 2.0, 0.0, 0.0, 1.0]])
    at = np.array([0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.5, 4.0])
    expected = [[0.0, 2.0, 2.0, 2.0, 0.0, 0.0, 1.0, 1.0]]
    np.testing.assert_array_equal(WORST_NEIGHBOUR(t, flags, at), expected)


def test_lanes_read_late_channels_later() -> None:
    t = np.arange(500) * 0.01
    x = np.stack([np.sin(t), np.sin(t - 0.123)], axis=1)
    lanes = (Lane(slice(0, 1), CUBIC), Lane(slice(1, 2), CUBIC, 0.123))
    found = interpolated(t, x.T, np.arange(sample_count(t[0], t[-1], 100.0)) / 100.0, lanes)
    assert found.shape[1] == 500
    np.testing.assert_allclose(found[1, :-14], found[0, :-14], atol=1e-5)
    np.testing.assert_allclose(found[1, -12:], x[-1, 1], atol=1e-12)


def test_a_slower_clock_folds_nothing_down(recording, sines) -> None:
    t = np.arange(30_000) * 0.001
    motion = sines(t)
    hum = 0.2 * np.sin(2.0 * np.pi * 95.3 * t)[:, None]
    made = recording(t, motion["q"] + 0.01 * hum, motion["effort"] + hum)
    run = prepare(made, Processing(8.0, 4.0, rate=100.0))
    data = run.whole()
    assert run.rate == 100.0 and len(data.t) == pytest.approx(3000, abs=30)
    np.testing.assert_allclose(np.diff(data.t), 0.01, atol=1e-9)
    truth = sines(data.t)
    inner = slice(50, -50)
    np.testing.assert_allclose(data.effort[inner], truth["effort"][inner], atol=2e-4)
    folded = np.abs(np.interp(data.t, t, hum[:, 0])).max()
    assert folded > 0.1
    assert "to 100 Hz behind a low-pass of 40 Hz" in " ".join(run.quality.notes)


def test_thinning_passes_and_stops() -> None:
    taps = Thinning.design(4).bank.taps
    at = np.arange(len(taps)) - len(taps) // 2
    for share, least, most in ((0.1, 0.9998, 1.0002), (0.4, 0.9998, 1.0002), (0.5, 0.0, 2e-4)):
        gain = abs((taps * np.exp(-2j * np.pi * share / 4.0 * at)).sum())
        assert least <= gain <= most


def test_a_clock_far_above_the_logs_is_refused(recording, sines) -> None:
    t = np.arange(3000) * 0.01
    motion = sines(t)
    with pytest.raises(LogError, match="1000 Hz is far above the log's 100 Hz"):
        prepare(recording(t, motion["q"], motion["effort"]), Processing(rate=1000.0))


@pytest.mark.parametrize("lag", [0.0374, -0.021])
def test_delays_are_taken_out(recording, sines, lag: float) -> None:
    t = np.arange(4000) * 0.01
    motion, late = sines(t), sines(t - lag)
    plain = recording(t, motion["q"], motion["effort"], motion["dq"])
    a = prepare(plain, Processing(8.0, 4.0)).whole()
    made = recording(t, motion["q"], late["effort"], late["dq"])
    signals = replace(made.signals, effort_delay=lag, velocity_delay=lag)
    run = prepare(replace(made, signals=signals), Processing(8.0, 4.0))
    b = run.whole()
    inside = np.isin(np.round(a.t, 6), np.round(b.t, 6))
    assert 0.99 * len(a.t) < inside.sum() and len(b.t) == inside.sum()
    np.testing.assert_allclose(b.effort, a.effort[inside], atol=2e-3)
    np.testing.assert_allclose(b.motion.dq[60:-60], a.motion.dq[inside][60:-60], atol=2e-3)
    early, behind = max(0.0, -lag), max(0.0, lag)
    assert b.t[0] >= t[0] + early - 1e-9 and b.t[-1] <= t[-1] - behind + 1e-9


def test_the_chain_is_reported_and_kept(recording, sines) -> None:
    t, motion = spoilt(sines)
    wanted = CHAINS["pchip and averages"]
    notes = " ".join(prepare(recording(t, motion["q"], motion["effort"]), wanted).quality.notes)
    for words in (
        "processing:",
        "outliers interpolated",
        "repeated rows interpolated",
        "limit left out",
    ):
        assert words in notes
    assert "pchip to 222.045 Hz, motion by moving average, span 7 (12 Hz), efforts by" in notes
    for processing in (*CHAINS.values(), Processing(rest_speed=(0.1, 0.2))):
        again = Processing.from_dict(processing.to_dict())
        assert again.to_dict() == processing.to_dict() and again.motion == processing.motion


def test_the_robot_files_table_becomes_the_chain() -> None:
    section = ProcessingSection.model_validate(
        {
            "outliers": "keep",
            "repeats": "keep",
            "saturation": "keep",
            "rate": 100.0,
            "resampling": "pchip",
            "motion": {"method": "savitzky_golay", "window": 21},
            "motion_cutoff": 9.0,
            "effort": {"method": "butterworth", "cutoff": 20},
            "matched_cutoff": 3.0,
        }
    )
    found = requested_processing(section, lambda *key: ".".join(map(str, key)))
    assert found.outliers is None and not found.bridge_repeats and not found.leave_out_saturated
    assert (found.rate, found.resampling, found.effort_cutoff) == (100.0, "pchip", 20.0)
    assert found.motion == METHODS["savitzky_golay"](21) and found.effort == Butterworth()
    usual = requested_processing(ProcessingSection(), lambda *key: "")
    assert usual.to_dict() == Processing().to_dict()


@pytest.mark.parametrize(
    ("table", "wrong"),
    [
        ({"effort": {"method": "butterworth", "cutoff": -1}}, "cutoff is -1"),
        ({"effort": {"method": "spline"}}, "is no method for effort"),
        ({"motion": {"method": "fir", "tap": 3}}, "does not understand 'tap'"),
    ],
)
def test_mistakes_name_their_place(table: dict[str, object], wrong: str) -> None:
    section = ProcessingSection.model_validate(table)
    with pytest.raises(ModelError, match=wrong) as caught:
        requested_processing(section, lambda *key: f"robot.toml, line 3, {key[-1]}")
    assert caught.value.where == f"robot.toml, line 3, {next(iter(table))}"


def test_an_unknown_interpolation_is_refused() -> None:
    with pytest.raises(ModelError, match="'sinc' is not a resampling method"):
        Processing(resampling="sinc")
