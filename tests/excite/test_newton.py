"""Newton's method under inequality constraints, against a closed form and CVXPY."""

from dataclasses import dataclass, field, replace

import cvxpy as cp
import numpy as np
import pytest

from designing import FAMILIES, box, problem, random_starts, torques
from steelyard.base.arrays import Array
from steelyard.base.progress import Stopped
from steelyard.excite.search.margins_barrier_and_newton import (
    STAGES,
    InequalityConstraints,
    minimised,
)
from steelyard.excite.trajectories.motion_families import reaching

MIDDLE = np.array([-0.1, 0.1, 0.3])
SHARP = tuple((1.0, 10.0**-k) for k in range(1, 9))


@dataclass(frozen=True, eq=False)
class Bowl:
    """A convex quadratic, $\\frac12 (x - c)^T A (x - c)$; remembers where it was evaluated.

    Attributes:
        shape: Of the coefficients.
        centre: The lowest point.
        stretch: Largest over smallest curvature.
    """

    shape: tuple[int, int]
    centre: Array
    stretch: float = 10.0
    evaluated: list[Array] = field(default_factory=list)

    @property
    def matrix(self) -> Array:
        size = self.shape[0] * self.shape[1]
        turned, _ = np.linalg.qr(np.random.default_rng(0).normal(size=(size, size)))
        return np.asarray((turned * np.geomspace(1.0, self.stretch, size)) @ turned.T)

    def value(self, x: Array) -> float:
        away = (x - self.centre).ravel()
        return float(0.5 * away @ self.matrix @ away)

    def __call__(self, x: Array, sharpness: float) -> tuple[float, Array]:
        self.evaluated.append(x)
        gradient = self.matrix @ (x - self.centre).ravel()
        return self.value(x), gradient.reshape(self.shape)


def bowl(inequalities: InequalityConstraints, reach: float, seed: int = 0) -> Bowl:
    still = inequalities.basis.still(MIDDLE)
    away = np.random.default_rng(seed).standard_normal(still.shape)
    return Bowl((still.shape[0], still.shape[1]), still + reach * away / np.linalg.norm(away))


def test_a_lowest_point_inside_is_reached() -> None:
    inequalities = problem(FAMILIES["rest"]).inequalities
    objective = bowl(inequalities, 0.1)
    assert inequalities.smallest_margin(objective.centre) > 0.1
    x = minimised(
        objective,
        inequalities,
        inequalities.basis.still(MIDDLE),
        stages=SHARP,
        tolerance=1e-12,
        between=False,
    )
    np.testing.assert_allclose(x, objective.centre, atol=1e-5)


def oracle(objective: Bowl, inequalities: InequalityConstraints) -> Array:
    """The lowest point within the limits, by Clarabel."""
    x = cp.Variable(objective.shape)
    flat = cp.reshape(x - objective.centre, (objective.centre.size,), order="C")
    cost = 0.5 * cp.quad_form(flat, cp.psd_wrap(objective.matrix))
    kept = []
    for shape, offset, (lower, upper) in zip(
        inequalities.shapes, inequalities.offsets, inequalities.limits.bounds, strict=True
    ):
        values = x @ shape.T + offset.T
        kept += [values <= upper[:, None], values >= lower[:, None]]
    cp.Problem(cp.Minimize(cost), kept).solve(solver=cp.CLARABEL)
    assert x.value is not None
    return np.asarray(x.value)


@pytest.mark.parametrize("name", ["rest", "rest, from to", "quintic, from", "reaching"])
@pytest.mark.parametrize("seed", range(2))
def test_a_lowest_point_outside_is_sought_along_the_walls(name: str, seed: int) -> None:
    inequalities = problem(FAMILIES[name], jerk=True).inequalities
    start = inequalities.basis.still(MIDDLE)
    objective = bowl(inequalities, 6.0, seed)
    assert inequalities.smallest_margin(objective.centre) < 0.0
    x = minimised(
        objective, inequalities, start, stages=SHARP, tolerance=1e-10, steps=100, between=False
    )
    best = oracle(objective, inequalities)
    assert objective.value(x) == pytest.approx(objective.value(best), rel=1e-4)
    np.testing.assert_allclose(x, best, atol=2e-3)
    assert inequalities.smallest_margin(x) > 0.0


def test_two_coefficients_in_a_box_end_in_its_corner() -> None:
    """Reaching moves so slow that only positions bind: the corner is known."""
    basis = reaching(3, 2, 60.0)
    inequalities = problem(basis).inequalities
    upper, lower = inequalities.limits.upper, inequalities.limits.lower
    beyond = np.stack([upper + 1.0, lower - 1.0], axis=1)
    objective = Bowl((3, 2), beyond, 1.0)
    x = minimised(
        objective, inequalities, basis.still(MIDDLE), stages=SHARP, tolerance=1e-10, between=False
    )
    assert inequalities.smallest_margin(x) > 0.0
    np.testing.assert_allclose(x, np.stack([upper, lower], axis=1), atol=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "reach"), [("rest", 1e6), ("quintic, from", 1e3), ("blended", 1.0)]
)
def test_the_walls_are_never_left(name: str, reach: float) -> None:
    """The criterion is only ever evaluated, and watchers called, inside."""
    inequalities = problem(FAMILIES[name], [box(0.6), torques()]).inequalities
    objective = bowl(inequalities, reach, 1)
    start = random_starts(inequalities, np.random.default_rng(0), 1)[0]
    seen: list[Array] = []
    x = minimised(objective, inequalities, start, watch=seen.append)
    assert len(seen) > 5 and len(objective.evaluated) > 5
    assert all(inequalities.smallest_margin(y) > 0.0 for y in [x, *seen, *objective.evaluated])
    assert objective.value(x) < objective.value(start)


@pytest.mark.parametrize(("kind", "constrained"), [("condition", True), ("d_optimal", False)])
def test_the_criterion_falls_from_stage_to_stage(kind: str, constrained: bool) -> None:
    design = problem(FAMILIES["rest"], [box(0.7), torques()] if constrained else [], kind=kind)
    x = random_starts(design.inequalities, np.random.default_rng(1), 1)[0]
    figures = [design.objective(x, STAGES[-1][0])[0]]
    for stop in range(1, len(STAGES) + 1):
        ended = minimised(design.objective, design.inequalities, x, stages=STAGES[:stop])
        figures.append(design.objective(ended, STAGES[-1][0])[0])
    assert figures[0] - figures[1] > 0.3
    assert all(b < a + 0.02 for a, b in zip(figures[1:], figures[2:], strict=False))
    assert figures[-1] < figures[1]


def test_nothing_near_the_end_is_better() -> None:
    """No small random feasible step lowers criterion and barrier by more than a trace."""
    design = problem(FAMILIES["rest"], [box(0.7), torques()])
    sharpness, weight = 16.0, 1e-2
    x = random_starts(design.inequalities, np.random.default_rng(2), 1)[0]
    x = minimised(
        design.objective,
        design.inequalities,
        x,
        stages=((4.0, 1e-1), (sharpness, weight)),
        between=False,
        steps=200,
        tolerance=1e-9,
    )

    def total(y: Array) -> float:
        barrier = design.inequalities.barrier(y)
        return (
            np.inf
            if barrier is None
            else design.objective(y, sharpness)[0] + weight * barrier.value
        )

    best, random = total(x), np.random.default_rng(0)
    for size in (1e-4, 1e-3, 1e-2):
        for _ in range(60):
            step = random.standard_normal(x.shape)
            assert total(x + size * step / np.linalg.norm(step)) > best - 1e-6


def test_a_watcher_can_stop_it() -> None:
    design = problem(FAMILIES["rest"])
    seen: list[Array] = []

    def third(x: Array) -> None:
        seen.append(x)
        if len(seen) == 3:
            raise Stopped("enough")

    start = random_starts(design.inequalities, np.random.default_rng(0), 1)[0]
    with pytest.raises(Stopped, match="enough"):
        minimised(design.objective, design.inequalities, start, watch=third)
    assert len(seen) == 3
    np.testing.assert_array_equal(seen[0], start)


def test_outside_or_without_information_nothing_is_done() -> None:
    design = problem(FAMILIES["rest"])
    still = design.basis.still(MIDDLE)
    np.testing.assert_array_equal(minimised(design.objective, design.inequalities, still), still)
    outside = still + 100.0
    np.testing.assert_array_equal(
        minimised(design.objective, design.inequalities, outside), outside
    )


@pytest.mark.slow
def test_room_is_kept_for_what_margins_dip_between_samples() -> None:
    """On a grid much finer than the samples nothing is lacking, which without it there is."""
    design = problem(FAMILIES["rest"], [box(0.7), torques()])
    start = random_starts(design.inequalities, np.random.default_rng(4), 1)[0]
    fine = replace(design.inequalities, t=np.linspace(0.0, design.basis.duration, 8001))
    kept, bare = (
        fine.smallest_margin(
            minimised(design.objective, design.inequalities, start, between=between)
        )
        for between in (True, False)
    )
    assert kept > 0.0 > bare


@pytest.mark.slow
def test_what_is_to_be_kept_on_top_is_nearly_kept() -> None:
    design = problem(FAMILIES["rest"], [box(0.7)])
    start = random_starts(design.inequalities, np.random.default_rng(5), 1)[0]
    (constraint,) = design.constraints
    extra = np.full(len(constraint.labels), 0.004)
    x = minimised(design.objective, design.inequalities, start, extra=[extra])
    assert constraint.margins(*design.inequalities.state(x)).values.min() > 0.003
