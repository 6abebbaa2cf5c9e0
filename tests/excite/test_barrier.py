"""The barrier against finite differences, and who is inside."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from designing import FAMILIES, box, problem, torques
from steelyard.base.arrays import Array
from steelyard.excite.constraints.constraint_and_limits import Constraint, Margins
from steelyard.excite.search.margins_barrier_and_newton import (
    CONSTRAINT_STEP,
    InequalityConstraints,
)
from steelyard.excite.trajectories.exact_trajectories import ExactTrajectory

MIDDLE = np.array([-0.1, 0.1, 0.3])
SOME = ["rest", "rest, from to", "raw", "quintic, from", "blended", "reaching"]


@dataclass(frozen=True, eq=False)
class Straight(Constraint):
    """A constraint that is linear in position, speed and acceleration: no second derivatives."""

    level: float
    name: str = "straight"
    labels: tuple[str, ...] = ("first", "second")
    unit: str = "rad"

    @property
    def activation_distance(self) -> Array:
        return np.array([0.7, 0.4])

    @property
    def slopes(self) -> Array:
        """By position, speed and acceleration, `(3, 2, 3)`."""
        drawn = np.random.default_rng(3).normal(size=(3, 2, 3))
        return np.asarray(drawn * np.array([0.5, 0.3, 0.05])[:, None, None])

    def margins(self, q: Array, dq: Array, ddq: Array) -> Margins:
        states, slopes = (q, dq, ddq), self.slopes
        values = self.level + sum(x @ s.T for x, s in zip(states, slopes, strict=True))
        by = [np.broadcast_to(s, (len(q), 2, 3)) for s in slopes]
        return Margins(np.asarray(values), *by)

    def proven(self, trajectory: ExactTrajectory) -> Array:
        return np.zeros(2)


def inequalities(
    name: str, constraints: tuple[Constraint, ...] = (), jerk: bool = True
) -> InequalityConstraints:
    return problem(FAMILIES[name], constraints, jerk=jerk).inequalities


def inside(inequalities: InequalityConstraints, seed: int, share: float = 0.9) -> Array:
    """A motion that keeps the constraints, about a tenth of the way from the nearest."""
    still = inequalities.basis.still(MIDDLE)
    change = np.random.default_rng(seed).standard_normal(still.shape)
    assert inequalities.smallest_margin(still) > 0.0
    size = 1.0
    while inequalities.smallest_margin(still + size * change) > 0.0:
        size *= 2.0
    low, high = 0.0, size
    for _ in range(30):
        size = 0.5 * (low + high)
        low, high = (
            (size, high)
            if inequalities.smallest_margin(still + size * change) > 0.0
            else (low, size)
        )
    return np.asarray(still + share * low * change)


def central(function: Callable[[Array], Array], x: Array, h: float) -> Array:
    """Fourth-order differences of an array by the coefficients, `(n * m, ...)`."""
    rows = []
    for k in range(x.size):
        step = np.zeros(x.size)
        step[k] = h
        step = step.reshape(x.shape)
        near, far = (
            (function(x + s * step) - function(x - s * step)) / (2.0 * s * h) for s in (1.0, 2.0)
        )
        rows.append((4.0 * near - far) / 3.0)
    return np.array(rows)


def value_of(inequalities: InequalityConstraints, x: Array) -> Array:
    barrier = inequalities.barrier(x)
    assert barrier is not None
    return np.array(barrier.value)


def gradient_of(inequalities: InequalityConstraints, x: Array) -> Array:
    barrier = inequalities.barrier(x)
    assert barrier is not None
    return barrier.gradient.ravel()


@pytest.mark.parametrize("name", SOME)
@pytest.mark.parametrize("jerk", [False, True])
def test_barrier_of_the_limits_is_its_formula(name: str, jerk: bool) -> None:
    w = inequalities(name, jerk=jerk)
    x = inside(w, 0)
    motion = w.basis.motion(x)
    total = 0.0
    sides = w.limits.bounds
    assert len(sides) == (4 if jerk else 3)
    for order, (lower, upper) in enumerate(sides):
        values, half = motion.derivative(w.t, order), 0.5 * (upper - lower)
        total -= np.log((upper - values) / half).sum() + np.log((values - lower) / half).sum()
    barrier = w.barrier(x)
    assert barrier is not None
    assert barrier.value == pytest.approx(total / len(w.t), rel=1e-9)


@pytest.mark.parametrize("name", SOME)
@pytest.mark.parametrize("jerk", [False, True])
def test_slope_and_curvature_of_the_limits(name: str, jerk: bool) -> None:
    w = inequalities(name, jerk=jerk)
    x = inside(w, 1)
    barrier = w.barrier(x)
    assert barrier is not None and barrier.gradient.shape == x.shape
    gradient = central(lambda y: value_of(w, y), x, 1e-4).ravel()
    size = np.abs(gradient).max()
    np.testing.assert_allclose(barrier.gradient.ravel(), gradient, rtol=1e-6, atol=1e-7 * size)
    hessian = central(lambda y: gradient_of(w, y), x, 1e-4)
    size = np.abs(hessian).max()
    np.testing.assert_allclose(barrier.hessian, hessian, rtol=1e-6, atol=1e-6 * size)
    np.testing.assert_allclose(barrier.hessian, barrier.hessian.T, atol=1e-12 * size)
    assert np.linalg.eigvalsh(barrier.hessian).min() > 0.0


@pytest.mark.parametrize("level", [0.35, 0.8])
def test_curvature_of_constraints_without_second_derivatives_is_exact(level: float) -> None:
    w = inequalities("rest", (Straight(level),))
    x = inside(w, 2, 0.95)
    near = Straight(level).margins(*w.state(x)).values / Straight(level).activation_distance
    assert 0.0 < near.min() < 0.5 and (near < 1.0).any(axis=0).all()
    barrier = w.barrier(x)
    assert barrier is not None
    gradient = central(lambda y: value_of(w, y), x, 1e-5).ravel()
    np.testing.assert_allclose(barrier.gradient.ravel(), gradient, rtol=1e-6, atol=1e-7)
    hessian = central(lambda y: gradient_of(w, y), x, 1e-5)
    np.testing.assert_allclose(barrier.hessian, hessian, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("name", ["rest", "quintic, from", "reaching"])
@pytest.mark.parametrize(
    "constraints",
    [(box(0.5),), (torques(0.8),), (box(0.6), torques())],
    ids=["box", "torque", "both"],
)
def test_barrier_of_constraints(name: str, constraints: tuple[Constraint, ...]) -> None:
    bare, w = inequalities(name), inequalities(name, constraints)
    x = inside(w, 3, 0.98)
    barrier, alone = w.barrier(x), bare.barrier(x)
    assert barrier is not None and alone is not None
    expected, counted, count = 0.0, 0, len(w.t[::CONSTRAINT_STEP])
    hidden = np.zeros((x.size, x.size))
    for constraint in constraints:
        s = constraint.margins(*w.state(x)).values / constraint.activation_distance
        near = s[s < 1.0]
        counted += near.size
        expected += (-np.log(near) - (1.0 - near) - 0.5 * (1.0 - near) ** 2).sum()
        rows = central(
            lambda y, c=constraint: c.margins(*w.state(y)).values / c.activation_distance, x, 1e-5
        )
        weight = np.where(s < 1.0, 1.0 / s**2 - 1.0, 0.0)
        hidden += np.einsum("atk,tk,btk->ab", rows, weight, rows) / count
    assert counted >= 3, "constraints are near"
    assert barrier.value - alone.value == pytest.approx(expected / count, rel=1e-9)
    gradient = central(lambda y: value_of(w, y), x, 1e-5).ravel()
    size = np.abs(gradient).max()
    np.testing.assert_allclose(barrier.gradient.ravel(), gradient, rtol=1e-5, atol=1e-6 * size)
    size = np.abs(hidden).max()
    found = barrier.hessian - alone.hessian
    np.testing.assert_allclose(found, hidden, rtol=1e-5, atol=1e-6 * size)
    assert np.linalg.eigvalsh(barrier.hessian).min() > 0.0


def test_far_constraints_do_not_matter() -> None:
    bare, w = inequalities("rest"), inequalities("rest", (box(50.0),))
    x = inside(w, 0)
    barrier, alone = w.barrier(x), bare.barrier(x)
    assert barrier is not None and alone is not None
    assert barrier.value == alone.value
    np.testing.assert_array_equal(barrier.gradient, alone.gradient)
    np.testing.assert_array_equal(barrier.hessian, alone.hessian)


def test_a_margin_at_its_room_joins_smoothly() -> None:
    """Value, slope and curvature are continuous where a margin begins to matter."""
    w = inequalities("rest", (Straight(0.9),))
    still = w.basis.still(MIDDLE)
    margins = Straight(0.9).margins(*w.state(still)).values / Straight(0.9).activation_distance
    one, other = np.zeros((2, *still.shape))
    gradient = Straight(0.9).slopes[0, 0] / Straight(0.9).activation_distance[0]
    towards = gradient / (gradient @ gradient) * (margins[0, 0] - 1.0)
    one[:, -1] = towards - 1e-6 * gradient
    other[:, -1] = towards + 1e-6 * gradient
    far, near = w.barrier(still - one), w.barrier(still - other)
    assert far is not None and near is not None
    assert near.value == pytest.approx(far.value, abs=1e-4)
    np.testing.assert_allclose(near.gradient, far.gradient, atol=1e-3)
    np.testing.assert_allclose(near.hessian, far.hessian, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("name", SOME)
@pytest.mark.parametrize("constraints", [(), (box(0.7), torques())], ids=["bare", "constrained"])
def test_inside_and_outside(name: str, constraints: tuple[Constraint, ...]) -> None:
    w = inequalities(name, constraints)
    for seed in range(4):
        x = inside(w, seed, 0.999)
        still = w.basis.still(MIDDLE)
        beyond = still + (x - still) / 0.999 * 1.001
        assert 0.0 < w.smallest_margin(x) < 0.05 and w.barrier(x) is not None
        assert w.smallest_margin(beyond) < 0.0 and w.barrier(beyond) is None
        assert (w.limit_margins(x) > 0.0).all()


def test_worst_is_the_smallest_of_all_margins() -> None:
    constraints = (box(0.7), torques())
    w = inequalities("rest", constraints)
    x = inside(w, 1, 0.95)
    motion = w.basis.motion(x)
    margins = []
    for order, (lower, upper) in enumerate(w.limits.bounds):
        values, half = motion.derivative(w.t, order), 0.5 * (upper - lower)
        margins.append(min(((upper - values) / half).min(), ((values - lower) / half).min()))
    states = [motion.derivative(w.t, order) for order in range(3)]
    parts = [float((c.margins(*states).values / c.activation_distance).min()) for c in constraints]
    assert w.smallest_margin(x) == pytest.approx(min(*margins, *parts), rel=1e-9)
    assert min(parts) < min(margins), "a constraint is nearest here"


def test_margins_change_as_they_say() -> None:
    w = inequalities("rest, from to")
    x = inside(w, 0, 0.5)
    dx = np.random.default_rng(9).standard_normal(x.shape)
    np.testing.assert_allclose(
        w.limit_margins(x + dx), w.limit_margins(x) + w.margin_rates(dx), rtol=1e-9, atol=1e-9
    )


def test_a_constraint_that_is_not_a_number_is_not_kept() -> None:
    class Broken(Straight):
        def margins(self, q: Array, dq: Array, ddq: Array) -> Margins:
            return Margins(np.full((len(q), 2), np.nan))

    w = inequalities("rest", (Broken(1.0),))
    still = w.basis.still(MIDDLE)
    assert w.barrier(still) is None
    assert not w.smallest_margin(still) > 0.0
