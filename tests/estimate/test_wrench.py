"""Wrenches from external efforts, against formulas and dense least squares."""

import numpy as np
import pytest

from steelyard.base.arrays import Array
from steelyard.base.errors import DataError
from steelyard.estimate.external.momentum_observer_with_wrench_and_contact import momentum_residual
from steelyard.estimate.external.wrench_methods_and_observer_step import (
    Expected,
    ExternalEfforts,
    InverseJacobian,
    Weighted,
    condition_numbers,
    learned_of,
)
from steelyard.uses.wrench import wrench_kalman_smoother as smoothing
from steelyard.uses.wrench.wrench_along_run import (
    SIMULTANEOUS,
    largest_size,
    name_of,
    unobservable_directions,
)
from steelyard.uses.wrench.wrench_kalman_smoother import RESIDUAL_CORRELATION_TIME, Smoothed

STEP = 0.05


def efforts(samples: int = 15, n: int = 6, k: int = 3, noise: float = 0.2) -> ExternalEfforts:
    """Invented efforts of an invented arm that moves."""
    rng = np.random.default_rng(samples + n)
    correlation = np.eye(n) + 0.2 * (np.ones((n, n)) - np.eye(n))
    turning = np.linspace(0.0, 1.0, samples)[:, None, None]
    jacobian = rng.normal(size=(6, n)) + turning * rng.normal(size=(6, n))
    return ExternalEfforts(
        step=STEP,
        torque=10.0 * rng.normal(size=(samples, n)),
        jacobian=jacobian,
        spread=2.0 * rng.normal(size=(samples, n, k)),
        slow=noise * rng.uniform(0.5, 1.5, (samples, n)),
        noise=noise * rng.uniform(0.5, 1.5, (samples, n)),
        correlation=correlation,
        per_independent=1.3,
    )


def dense(given: ExternalEfforts, expected: Expected, duration: float) -> tuple[Array, Array]:
    """Mean and covariance of all wrenches given all efforts, from one large covariance."""
    samples, n = given.torque.shape
    apart = given.step * np.abs(np.subtract.outer(np.arange(samples), np.arange(samples)))
    loads = np.zeros((samples * n, samples * 6))
    residual = np.zeros((samples * n, samples * n))
    for i in range(samples):
        rows = slice(i * n, i * n + n)
        loads[rows, i * 6 : i * 6 + 6] = given.jacobian[i].T
        noise = np.outer(given.noise[i], given.noise[i]) * given.correlation
        residual[rows, rows] += given.per_independent * noise
        for j in range(samples):
            slow = np.outer(given.slow[i], given.slow[j]) * given.correlation
            residual[rows, j * n : j * n + n] += (
                np.exp(-apart[i, j] / RESIDUAL_CORRELATION_TIME) * slow
            )
    columns = given.spread.reshape(samples * n, -1)
    before = np.kron(np.exp(-apart / duration), np.diag(expected.variances))
    together = loads @ before @ loads.T + columns @ columns.T + residual
    gain = np.linalg.solve(together, loads @ before).T
    left = before - gain @ loads @ before
    blocks = [left[i * 6 : i * 6 + 6, i * 6 : i * 6 + 6] for i in range(samples)]
    return (gain @ given.torque.ravel()).reshape(samples, 6), np.array(blocks)


@pytest.mark.parametrize("n", [6, 7, 4])
def test_the_smoother_is_least_squares_of_all_samples(
    n: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(smoothing, "ROUNDS", 0)
    expected = Expected(20.0, 0.3)
    given = efforts(n=n)
    found = Smoothed(expected, 0.7)(given)
    values, covariance = dense(given, expected, 0.7)
    assert np.allclose(found.values, values, rtol=1e-8, atol=1e-8)
    assert np.allclose(found.learned, learned_of(covariance, expected), atol=1e-9)
    unobservable = np.linalg.eigvalsh(found.learned) < 0.5
    assert unobservable.any() == (n == 4)
    if n > 4:
        assert np.allclose(found.covariance, covariance, rtol=1e-6, atol=1e-8)
    else:
        assert (np.diagonal(found.covariance - covariance, axis1=1, axis2=2) > -1e-9).all()
        widest = np.linalg.eigvalsh(found.covariance / np.outer(*2 * [expected.variances**0.5]))
        assert (widest[:, -1] > 0.5).all()


def test_parameters_without_effect_make_no_difference(monkeypatch: pytest.MonkeyPatch) -> None:
    given = efforts()
    more = np.concatenate([given.spread, 1e-7 * given.spread], axis=2)
    wide = ExternalEfforts(**{**vars(given), "spread": more})
    for own, other in zip(*(vars(Smoothed()(one)).values() for one in (given, wide)), strict=True):
        assert np.allclose(own, other, rtol=1e-5, atol=1e-6)


def with_errors(given: ExternalEfforts, push: Array, seed: int) -> ExternalEfforts:
    """Efforts of a push `(N, 6)`, with errors as the model's uncertainty has them."""
    rng = np.random.default_rng(seed)
    root, keep = np.linalg.cholesky(given.correlation), np.exp(-STEP / RESIDUAL_CORRELATION_TIME)
    slow = rng.normal(size=given.torque.shape)
    for k in range(1, len(slow)):
        slow[k] = keep * slow[k - 1] + np.sqrt(1.0 - keep**2) * slow[k]
    white = np.sqrt(given.per_independent) * rng.normal(size=given.torque.shape)
    torque = np.einsum("tin,ti->tn", given.jacobian, push)
    torque += given.spread @ rng.normal(size=given.spread.shape[2])
    torque += given.slow * (slow @ root.T) + given.noise * (white @ root.T)
    return ExternalEfforts(**{**vars(given), "torque": torque})


def test_free_motion_has_small_wrenches_and_a_push_its_size() -> None:
    given = efforts(400, noise=2.0)
    t = STEP * np.arange(400)
    push = np.zeros((400, 6))
    push[:, 0] = 25.0 * np.exp(-(((t - 12.0) / 0.8) ** 2))
    made, calm = with_errors(given, push, 5), with_errors(given, 0.0 * push, 5)
    found, free = Smoothed()(made), Smoothed()(calm)
    error, other = found.values - push, Weighted()(made).values - push
    assert np.sqrt(np.mean(error**2)) < 0.4 * np.sqrt(np.mean(other**2))
    std, small = (np.sqrt(np.diagonal(x.covariance, axis1=1, axis2=2)) for x in (found, free))
    assert np.mean(np.abs(error) < 1.96 * std) >= 0.9
    assert np.mean(np.abs(free.values) < 1.96 * small) >= 0.9
    near = np.abs(t - 12.0) < 1.0
    assert small[near].mean() < 0.9 * std[near].mean()
    assert found.values[:, 0].max() == pytest.approx(25.0, abs=3.0)


def test_a_force_that_acts_all_the_time_is_within_its_interval() -> None:
    push = np.tile([0.0, 0.0, -25.0, 0.0, 1.0, 0.0], (400, 1))
    made = with_errors(efforts(400, noise=2.0), push, 6)
    found = Smoothed()(made)
    std = np.sqrt(np.diagonal(found.covariance, axis1=1, axis2=2))
    assert np.mean(np.abs(found.values - push) < 1.96 * std) >= 0.9
    assert found.values[:, 2].mean() == pytest.approx(-25.0, abs=3.0)


def test_a_direction_that_is_never_observable_keeps_its_size_whatever_the_rest_shows() -> None:
    given = efforts(60, n=3, k=1)
    jacobian = np.zeros_like(given.jacobian)
    jacobian[:, [0, 1, 5], [0, 1, 2]] = 1.0
    quiet = {"jacobian": jacobian, "torque": 1e-3 * given.torque}
    found = Smoothed(Expected(10.0, 0.5))(ExternalEfforts(**{**vars(given), **quiet}))
    std = np.sqrt(np.diagonal(found.covariance, axis1=1, axis2=2))
    assert np.allclose(std[:, [2, 3, 4]], [10.0, 5.0, 5.0], rtol=2e-2)
    assert (std[:, [0, 1]] < 3.0).all() and np.allclose(found.values[:, [2, 3, 4]], 0.0)
    directions = unobservable_directions(found.learned.mean(axis=0), Expected(10.0, 0.5))
    assert {name_of(one) for one in directions} == {
        "force along z",
        "moment about x",
        "moment about y",
    }


def test_the_largest_size_is_that_of_all_forces_of_the_simultaneous_region() -> None:
    rng = np.random.default_rng(4)
    force, roots = 3.0 * rng.normal(size=(20, 3)), rng.normal(size=(20, 3, 3))
    force[0], roots[1, :, 2], force[2], roots[2] = 0.0, 0.0, [5.0, 1.0, 0.0], np.diag([0, 1, 30])
    found = largest_size(force, roots @ roots.swapaxes(1, 2))
    ball = rng.normal(size=(100_000, 3))
    ball /= np.linalg.norm(ball, axis=1)[:, None]
    for size, own, root in zip(found, force, roots, strict=True):
        most = np.linalg.norm(own + SIMULTANEOUS * ball @ root.T, axis=1).max()
        assert most <= size * (1.0 + 1e-9) and size == pytest.approx(most, rel=1e-3)
    still = largest_size(np.array([[3.0, 0.0, 4.0], [0.0, 0.0, 0.0]]), np.zeros((2, 3, 3)))
    assert still == pytest.approx([5.0, 0.0])


def test_a_force_along_a_direction_that_is_not_observable_is_within_the_interval_of_sizes() -> None:
    given = efforts(60, n=3, k=1)
    jacobian = np.zeros_like(given.jacobian)
    jacobian[:, [0, 1, 5], [0, 1, 2]] = 1.0
    push = np.tile([30.0, 0.0, 60.0, 0.0, 0.0, 0.0], (60, 1))
    made = with_errors(ExternalEfforts(**{**vars(given), "jacobian": jacobian}), push, 3)
    for method in (Smoothed(), Weighted()):
        found = method(made)
        upper = largest_size(found.values[:, :3], found.covariance[:, :3, :3])
        assert (np.linalg.norm(found.values[:, :3], axis=1) < 45.0).all()
        assert (upper > np.hypot(30.0, 60.0)).all()


def test_weighted_and_inverse_are_their_formulas() -> None:
    given, expected = efforts(4), Expected(25.0, 0.2)
    weighted, inverse = Weighted(expected)(given), InverseJacobian(expected)(given)
    prior = np.diag(1.0 / expected.variances)
    for k in range(4):
        jacobian, torque = given.jacobian[k], given.torque[k]
        std = np.hypot(given.slow[k], given.noise[k])
        off = given.spread[k] @ given.spread[k].T + np.outer(std, std) * given.correlation
        weight = np.linalg.inv(off)
        covariance = np.linalg.inv(jacobian @ weight @ jacobian.T + prior)
        assert np.allclose(weighted.values[k], covariance @ jacobian @ weight @ torque)
        assert np.allclose(weighted.covariance[k], covariance)
        back = np.linalg.inv(jacobian.T)
        assert np.allclose(inverse.values[k], back @ torque)
        assert np.allclose(inverse.covariance[k], back @ off @ back.T)
    assert np.array_equal(weighted.learned, inverse.learned)


def test_all_are_finite_where_the_jacobian_is_singular() -> None:
    given = efforts(5)
    jacobian = given.jacobian.copy()
    jacobian[2, :, 3] = jacobian[2, :, 4]
    one = ExternalEfforts(**{**vars(given), "jacobian": jacobian})
    assert condition_numbers(jacobian)[2] > 1e12
    assert np.isinf(condition_numbers(jacobian[:, :, :5])).all()
    for method in (Smoothed(), Weighted()):
        found = method(one)
        assert np.isfinite(found.values).all() and np.isfinite(found.covariance).all()
        assert np.linalg.eigvalsh(found.covariance).min() > 0.0


def test_without_a_lever_there_is_no_moment() -> None:
    found = Smoothed(Expected(30.0, 0.0))(efforts())
    assert np.array_equal(found.values[:, 3:], np.zeros((15, 3)))
    assert np.array_equal(found.covariance[:, 3:, 3:], np.zeros((15, 3, 3)))
    assert np.abs(found.values[:, :3]).max() > 1.0


def test_directions_are_named() -> None:
    assert name_of(np.array([0.0, 0.0, -1.0, 0.0, 0.2, 0.0])) == "force along z"
    mixed = np.array([0.0, 0.8, 0.0, -0.6, 0.0, 0.0])
    assert name_of(mixed) == "force along y with moment about −x"
    assert name_of(-mixed) == name_of(mixed)
    assert name_of(np.array([0.0, 0.0, 0.0, -0.7, 0.7001, 0.1])) == (
        "moment about the axis (−1, 1, 0)"
    )
    assert name_of(np.array([0.4, 0.0, 0.8, 0.0, 0.0, 0.0])) == "force along the axis (0.5, 0, 1)"
    rng = np.random.default_rng(2)
    hidden = np.eye(6)[:, [1, 5]] @ np.linalg.qr(rng.normal(size=(2, 2)))[0]
    learned = 0.9 * np.eye(6) - 0.9 * hidden @ hidden.T
    found = unobservable_directions(learned, Expected())
    assert {name_of(one) for one in found} == {"force along y", "moment about z"}
    assert np.allclose([np.linalg.norm(one) for one in found], 1.0)
    assert unobservable_directions(0.9 * np.eye(6), Expected()) == ()


def test_the_momentums_residual_is_the_external_effort() -> None:
    t = np.arange(0.0, 2.0, 1e-3)[:, None]
    inertia, external = 2.0, 3.0 * np.cos(2.0 * t)
    momentum = inertia * np.sin(4.0 * t)
    applied = 4.0 * inertia * np.cos(4.0 * t) - external
    found = momentum_residual(momentum, applied, 1e3)
    assert np.allclose(found[1:-1], external[1:-1], atol=1e-4)
    assert np.allclose(found, external, atol=0.05)
    assert np.array_equal(momentum_residual(momentum[:1], applied[:1], 1e3), [[0.0]])


def test_what_is_no_duration_or_size_is_refused() -> None:
    with pytest.raises(DataError, match="no duration of a push"):
        Smoothed(duration=0.0)
    for sizes in ((-1.0,), (0.01,), (1e6,), (np.nan,), (30.0, -1.0), (30.0, 1e12)):
        with pytest.raises(DataError, match="no expected size"):
            Expected(*sizes)


def test_a_push_longer_than_the_log_is_averaged_over_the_log() -> None:
    given = efforts()
    long, longer = (Smoothed(duration=some)(given) for some in (1e9, 1e10))
    assert np.isfinite(long.values).all()
    assert np.allclose(long.values, longer.values, atol=0.01)
