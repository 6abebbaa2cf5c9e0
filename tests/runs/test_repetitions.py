"""Means over repetitions: aligned, with the sample variance, as runs with weights."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import uniform_filter1d

from steelyard.base.errors import LogError
from steelyard.runs.mean_over_repetitions import (
    average_aligned,
    mean_of_logs,
    mean_of_periods,
    weights_of,
)
from steelyard.runs.prepare import prepare, prepare_mean
from steelyard.runs.processing_choices import Processing
from steelyard.runs.recording import Recording
from steelyard.runs.spectrum_and_period import Repetitions

RATE = 200.0


def wave(t: np.ndarray, period: float = 3.0) -> np.ndarray:
    w = 2.0 * np.pi / period
    return np.stack((0.5 * np.sin(w * t), 0.4 * np.sin(2 * w * t) + 0.3 * np.cos(w * t)), axis=-1)


def made(
    recording: Callable[..., Recording], count: int, seed: int = 0, **more: object
) -> Recording:
    """Repetitions of 3 s; noise of the effort grows over each from 0.1 to 0.3."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 3.0 * count, 1.0 / RATE)
    level = 0.1 + 0.2 * np.mod(t, 3.0)[:, None] / 3.0
    q = wave(t) + 1e-4 * rng.standard_normal((len(t), 2))
    return recording(t, q, 5.0 * wave(t + 0.2) + level * rng.standard_normal((len(t), 2)), **more)


def test_mean_and_variance_are_numpys() -> None:
    rng = np.random.default_rng(0)
    x = np.concatenate((wave(np.arange(3000) / RATE).T, rng.standard_normal((1, 3000))))
    found = average_aligned([x], [np.array([0.0, 600, 1200, 1800, 2400])], 600, slice(0, 2))
    pieces = x.reshape(3, 5, 600)
    np.testing.assert_allclose(found.starts, [0, 600, 1200, 1800, 2400], atol=1e-6)
    np.testing.assert_allclose(found.mean, pieces.mean(axis=1), atol=1e-6)
    np.testing.assert_allclose(found.variance[2], pieces[2].var(axis=0, ddof=1), atol=1e-5)
    assert found.apart.max() < 1e-6


def test_repetitions_are_aligned_between_samples() -> None:
    late = np.array([0.0, 0.3, -0.4, 0.25, -0.15])
    at = np.arange(700) / RATE
    logs = [wave(at - shift / RATE).T for shift in late]
    found = average_aligned(logs, [np.array([30.0])] * 5, 600, slice(0, 2), context=20)
    np.testing.assert_allclose(found.starts - 30.0, late - late.mean(), atol=1e-3)
    np.testing.assert_allclose(found.mean[:, 20:-20], logs[0][:, 30:630], atol=1e-5)
    assert found.mean.shape == (2, 640)


def test_another_motion_is_no_repetition() -> None:
    logs = [wave(np.arange(600) / RATE).T] * 4 + [wave(np.arange(600) / RATE, 2.7).T]
    with pytest.raises(LogError, match="repetition 5 of 5 differs from the others"):
        average_aligned(logs, [np.zeros(1)] * 5, 600, slice(0, 2))
    with pytest.raises(LogError, match="fewer than two whole repetitions"):
        average_aligned(logs[:1], [np.zeros(1)], 600, slice(0, 2))


def test_another_effort_is_no_repetition(recording: Callable[..., Recording]) -> None:
    """A lap with an offset or the other sign ends with joint, lap and log; of two laps too."""
    t = np.arange(0.0, 30.0, 1.0 / RATE)
    effort = 40.0 * wave(t + 0.2) + np.random.default_rng(0).standard_normal((len(t), 2))
    for last, changed in (
        (30.0, effort + [0.0, 20.0]),
        (30.0, effort * [1.0, -1.0]),
        (9.0, effort + [0.0, 20.0]),
    ):
        lap = (t >= 6.0) & (t < 9.0)
        log = recording(t, wave(t), np.where(lap[:, None], changed, effort), window=f"@0:{last}")
        with pytest.raises(
            LogError, match="effort 'tau_1' of repetition (2 of 9|. of 2)"
        ) as caught:
            mean_of_periods(log, Repetitions(period=3.0, drop_last=0))
        assert caught.value.where == f"{log.where}, repetitions of [processing]"


@pytest.mark.parametrize("count", [2, 3, 5, 10])
def test_noise_alone_is_no_other_effort(count: int) -> None:
    """Of any size, white and, of more than two repetitions, over a tenth of each."""
    q, starts = wave(np.arange(count * 300 + 1) / 100.0).T, [300.0 * np.arange(float(count))]
    for seed in range(100):
        rng = np.random.default_rng(seed)
        noise = rng.standard_normal(q.shape)
        if count > 2 and seed % 2:
            noise = np.sqrt(30.0) * uniform_filter1d(noise, 30, axis=1)
        channels = np.concatenate((q, q + 10.0 ** rng.uniform(-3.0, 2.0) * noise))
        names = {2: "tau_0", 3: "tau_1"}
        average_aligned([channels], starts, 300, slice(0, 2), efforts=names)


def test_a_mean_is_as_long_as_its_period(recording: Callable[..., Recording]) -> None:
    t = np.arange(0.0, 30.0, 0.03)
    mean = mean_of_periods(recording(t, wave(t, 10.0), wave(t, 10.0)), Repetitions(5.0 * 2.0, 0, 0))
    assert "mean of 3 repetitions of 10 s" in mean.words
    t = np.arange(0.0, 60.0, 0.03)
    mean = mean_of_periods(recording(t, wave(t, 20.0), wave(t, 20.0)), Repetitions(20.0, 0, 0))
    assert "mean of 3 repetitions of 20 s" in mean.words
    assert mean.importance.weights.shape[1] == 667 + 2 * 133


def test_a_log_of_periods_becomes_its_mean(recording: Callable[..., Recording]) -> None:
    log = made(recording, 22)
    mean = mean_of_periods(log, Repetitions())
    assert len(mean.averaged.starts) == 20
    assert "mean of 20 repetitions of 3 s" in mean.words
    run = prepare(log, Processing(repetitions=Repetitions()))
    assert run.name == log.name
    data = run.whole()
    assert len(data.t) == pytest.approx(600, abs=3)
    phase = mean.averaged.starts[0] / RATE + data.t - run.span[0] + (run.span[0] - 3.0)
    np.testing.assert_allclose(data.motion.q, wave(phase), atol=2e-3)
    left = data.effort - 5.0 * wave(phase + 0.2)
    level = 0.1 + 0.2 * np.mod(phase, 3.0) / 3.0
    assert np.std(left / level[:, None]) == pytest.approx(1.0 / np.sqrt(20.0), rel=0.15)
    assert data.weights is not None
    wanted = 1.0 / level**2
    ratio = data.weights / (wanted / wanted.mean())[:, None]
    assert np.abs(np.log(ratio[20:-20])).mean() < 0.25
    assert any("mean of 20 repetitions" in note for note in run.quality.notes)


def test_dropping(recording: Callable[..., Recording]) -> None:
    log = made(recording, 6)
    few = mean_of_periods(log, Repetitions(period=3.0, drop_first=2, drop_last=1))
    assert len(few.averaged.starts) == 3
    assert few.averaged.starts[0] == pytest.approx(6.0 * RATE, abs=0.1 * RATE)
    with pytest.raises(LogError, match="of 6 whole repetitions of 3 s in this log 1 are left"):
        mean_of_periods(log, Repetitions(period=3.0, drop_first=3, drop_last=2))
    with pytest.raises(LogError, match="of 0 whole repetitions of 30 s"):
        mean_of_periods(log, Repetitions(period=30.0))


def test_a_motion_without_period_is_reported(recording: Callable[..., Recording]) -> None:
    rng = np.random.default_rng(4)
    t = np.arange(0.0, 20.0, 1.0 / RATE)
    q = np.stack([np.interp(t, np.arange(21.0), rng.normal(size=21)) for _ in range(2)], axis=1)
    with pytest.raises(LogError, match="no period was found") as caught:
        prepare(recording(t, q, q), Processing(repetitions=Repetitions()))
    assert "repetitions = {period" in caught.value.fix


def process(standing: int, cycles: int = 6) -> np.ndarray:
    """Six joints, so many standing: cycles of 3.4 s, of which the last 0.9 s are a pause."""
    rng = np.random.default_rng(7)
    places = rng.uniform(-1.0, 1.0, (5, 6))
    s = np.arange(100) / 100.0
    course = (s**3 * (10.0 - 15.0 * s + 6.0 * s**2))[:, None]
    moves = [a + course * (b - a) for a, b in zip(places, np.roll(places, -1, axis=0), strict=True)]
    cycle = np.vstack([*moves, np.tile(places[0], (180, 1))])
    q = np.vstack([np.tile(places[0], (150, 1)), np.tile(cycle, (cycles, 1))])
    pushed = 3e-4 * (q[:, 5:] - q[0, 5]) if standing < 6 else 0.0
    q[:, :standing] = q[0, :standing] + pushed
    bit = 2.0 * np.pi / 2**17
    return np.round(q / bit + rng.standard_normal(q.shape)) * bit


@pytest.mark.parametrize("standing", [0, 1, 3, 5])
def test_joints_that_stand_do_not_hide_repetitions(
    recording: Callable[..., Recording], standing: int
) -> None:
    q = process(standing)
    t = np.arange(len(q)) / RATE
    mean = mean_of_periods(recording(t, q, q), Repetitions(drop_first=0, drop_last=0))
    assert len(mean.averaged.starts) == 6
    assert np.diff(mean.averaged.starts).mean() == pytest.approx(3.4 * RATE, rel=1e-4)
    assert 0.0 <= mean.averaged.starts[0] <= 160.0
    assert mean.averaged.apart.max() < 5e-4


@pytest.mark.parametrize("wanted", [Repetitions(), Repetitions(period=3.4)])
def test_all_joints_stand(recording: Callable[..., Recording], wanted: Repetitions) -> None:
    q = process(6)
    with pytest.raises(LogError, match="no joint moves in this log") as caught:
        mean_of_periods(recording(np.arange(len(q)) / RATE, q, q), wanted)
    assert "record a motion" in caught.value.fix


def test_logs_of_one_motion(recording: Callable[..., Recording], tmp_path: Path) -> None:
    logs = []
    for number, wait in enumerate((1.0, 1.31, 0.777)):
        rng = np.random.default_rng(number)
        t = np.arange(0.0, 8.0, 1.0 / RATE)
        q = wave(np.clip(t - wait, 0.0, 3.0)) * [1.0, 1.0]
        effort = q + 0.1 * rng.standard_normal(q.shape)
        table = recording(t, q + 1e-5 * rng.standard_normal(q.shape), effort)
        logs.append(replace(table.in_memory()))
    mean = mean_of_logs(logs)
    assert len(mean.averaged.starts) == 3
    apart = np.diff(mean.averaged.starts / RATE)
    np.testing.assert_allclose(apart, [0.31, 0.777 - 1.31], atol=1e-3)
    assert prepare_mean(mean, "mean").name == "mean"
    with pytest.raises(LogError, match="fewer than two"):
        mean_of_logs(logs[:1])
    with pytest.raises(LogError, match="no log to average"):
        mean_of_logs([])


def test_weights_of_few_repetitions_are_averaged_over_time() -> None:
    rng = np.random.default_rng(0)
    for count in (2, 5, 50):
        variance = rng.chisquare(count - 1, (2, 4000)) / (count - 1)
        weights = weights_of(variance, count)
        np.testing.assert_allclose(weights.mean(axis=1), 1.0)
        assert np.std(weights) < 0.25
    steps = np.repeat([[1.0, 4.0]], 500, axis=1).reshape(1, -1)
    assert weights_of(steps, 200)[0, 100] == pytest.approx(4.0 * weights_of(steps, 200)[0, 900])


def test_the_choice_is_kept_in_files() -> None:
    processing = Processing(repetitions=Repetitions(2.5, 2, 0))
    again = Processing.from_dict(processing.to_dict())
    assert again.repetitions == processing.repetitions
    assert Processing.from_dict(Processing().to_dict()).repetitions is None


@pytest.mark.parametrize("text", ['"find"', "{period = 13.333, drop_first = 0, drop_last = 0}"])
def test_robot_files_ask_for_it(text: str) -> None:
    from steelyard.robot.file.sections import ProcessingSection
    from steelyard.robot.file.toml_schema import tomllib
    from steelyard.runs.processing_choices import requested_processing

    section = ProcessingSection(**tomllib.loads(f"repetitions = {text}"))
    found = requested_processing(section, lambda *place: ".".join(place)).repetitions
    wanted = Repetitions() if "find" in text else Repetitions(13.333, 0, 0)
    assert found == wanted


def test_the_panda_comes_back_after_its_period(real: Callable[[str], Recording]) -> None:
    log = real("panda/panda_gaz2019_trajectory1.parquet")
    from steelyard.runs.mean_over_repetitions import _evenly_sampled
    from steelyard.runs.spectrum_and_period import find_period

    channels, rate = _evenly_sampled(log.in_memory())
    assert find_period(channels[log.channels.q], rate) == pytest.approx(13.333, abs=0.005)


def test_the_ur10e_repeats_itself_over_logs(real: Callable[[str], Recording]) -> None:
    """Three runs of one trajectory on one day; the next day's start posture is another."""
    names = ("13_51_41", "14_04_13", "14_04_41")
    logs = [real(f"ur10e/identification/ur-19_10_01-{name}.parquet") for name in names]
    mean = mean_of_logs(logs)
    assert len(mean.averaged.starts) == 3
    assert mean.averaged.apart.max() < 3e-3
    run = prepare_mean(mean, "five seconds")
    assert run.duration == pytest.approx(5.0, abs=0.5)
