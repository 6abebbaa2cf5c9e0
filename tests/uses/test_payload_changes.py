"""When a payload changes: from windows of invented residuals."""

import numpy as np
import pytest

from steelyard.base.arrays import Array
from steelyard.uses.payload.change_detection import (
    CHANGE_SPAN,
    CHANGE_STEP,
    PayloadChanges,
    PayloadWindows,
    changes_of,
    payload_windows,
)

PHI = np.array([2.0, 0.0, 0.1, 0.2, 0.03, 0.0, 0.03, 0.0, 0.0, 0.02])
PRIOR = np.diag(np.full(10, 0.01))


def correlated(rng: np.random.Generator, count: int, memory: float) -> Array:
    """Noise of unit variance that forgets by `memory` per window, with heavy tails."""
    white = rng.standard_t(4, size=(count, 3)) / np.sqrt(2.0)
    noise = np.empty_like(white)
    noise[0] = white[0]
    for k in range(1, count):
        noise[k] = memory * noise[k - 1] + np.sqrt(1.0 - memory**2) * white[k]
    return noise


def windows(
    seed: int,
    count: int,
    carried: slice,
    *,
    memory: float = 0.0,
    gap: float = 0.0,
    at: int = 0,
    load: Array = PHI,
) -> PayloadWindows:
    """Windows of an arm that carries a load for a while; a pause of `gap` before window `at`."""
    rng = np.random.default_rng(seed)
    t = CHANGE_STEP * np.arange(count)
    phases = rng.uniform(0.0, 2.0 * np.pi, (3, 10))
    speeds = rng.uniform(0.5, 3.0, (3, 10))
    rows = 10.0 * np.sin(speeds * t[:, None, None] + phases)
    loads = np.zeros((count, 10))
    loads[carried] = load
    efforts = np.einsum("wij,wj->wi", rows, loads) + correlated(rng, count, memory)
    starts = t + np.where(np.arange(count) >= at, gap, 0.0)
    return PayloadWindows(
        starts,
        starts + CHANGE_STEP,
        np.einsum("wki,wkj->wij", rows, rows),
        np.einsum("wki,wk->wi", rows, efforts),
        np.sum(efforts**2, axis=1),
        PRIOR,
    )


def test_a_pick_and_a_release_are_found_in_time() -> None:
    found = changes_of(windows(1, 600, slice(200, 420)))
    assert [round(change.time, 1) for change in found.changes] == [20.0, 42.0]
    for change, when in zip(found.changes, (20.0, 42.0), strict=True):
        assert change.earliest - 1e-9 <= when <= change.latest + 1e-9
        assert change.latest - change.earliest < 1.0 and change.ratio > 1.0


def test_in_a_pause_the_time_is_anywhere() -> None:
    (found,) = changes_of(windows(2, 400, slice(200, None), gap=5.0, at=200)).changes
    assert found.earliest <= 20.1 and found.latest >= 24.9
    assert found.time == pytest.approx(22.5, abs=0.2)


@pytest.mark.slow
@pytest.mark.parametrize("memory", [0.0, 0.6, 0.9])
def test_residuals_alone_are_no_change(memory: float) -> None:
    """An hour of correlated, heavy-tailed residuals at one false event in ten hours."""
    count = sum(
        len(changes_of(windows(seed, 3000, slice(0, 0), memory=memory)).changes)
        for seed in range(12)
    )
    assert count <= 1


def test_correlation_raises_the_threshold() -> None:
    plain, alike = (
        changes_of(windows(3, 3000, slice(0, 0), memory=memory)) for memory in (0.0, 0.9)
    )
    assert plain.inflation < 2.0 < alike.inflation
    assert alike.threshold > 2.0 * plain.threshold


def test_a_payload_of_the_whole_log_is_no_change() -> None:
    assert changes_of(windows(4, 600, slice(None))).changes == ()


def test_a_log_shorter_than_the_span_has_none() -> None:
    found: PayloadChanges = changes_of(
        windows(5, round(CHANGE_SPAN / CHANGE_STEP), slice(10, None))
    )
    assert found.changes == () and found.inflation == 1.0
    assert found.least_mass == np.inf


def test_changes_above_the_least_mass_are_found_and_smaller_ones_are_not() -> None:
    least = changes_of(windows(6, 600, slice(0, 0))).least_mass
    assert 0.0 < least < 1.0
    for factor, count in ((1.5, 1), (0.4, 0)):
        load = np.zeros(10)
        load[0] = factor * least
        assert len(changes_of(windows(6, 600, slice(300, None), load=load)).changes) == count


def test_what_raises_the_threshold_raises_the_least_mass() -> None:
    plain, alike = (
        changes_of(windows(3, 3000, slice(0, 0), memory=memory)) for memory in (0.0, 0.9)
    )
    assert alike.least_mass > 1.5 * plain.least_mass


def products(drift: float) -> Array:
    """One row, one friction column and ten of a payload; friction off by `drift`."""
    rng = np.random.default_rng(0)
    columns = rng.normal(size=(900, 20, 11))
    loads = np.where(np.arange(900) < 450, 0.0, 1.0)[:, None] * PHI
    efforts = np.einsum("wsi,wi->ws", columns[:, :, 1:], loads) + drift * columns[:, :, 0]
    efforts += 0.01 * rng.normal(size=efforts.shape)
    whole = np.concatenate([columns, efforts[:, :, None]], axis=2)
    return np.einsum("wsi,wsj->wij", whole, whole)


def test_friction_of_the_day_is_no_payload() -> None:
    starts, grams = CHANGE_STEP * np.arange(900), products(3.0) / 1e-4
    found = payload_windows(starts, starts + CHANGE_STEP, grams, np.array([5.0]), 5.0)
    loaded = slice(450, None)
    mean = np.linalg.solve(found.matrix[loaded].sum(axis=0), found.vector[loaded].sum(axis=0))
    np.testing.assert_allclose(mean, PHI, atol=1e-3)
    empty = np.linalg.solve(found.matrix[:450].sum(axis=0), found.vector[:450].sum(axis=0))
    np.testing.assert_allclose(empty, 0.0, atol=1e-3)
    (change,) = changes_of(found).changes
    assert change.time == pytest.approx(45.0, abs=0.11)
