"""From samples to all times: exact scaling, proofs, and the message when nothing is left."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import pytest

from designing import FAMILIES, START, box, limits, problem, random_starts, torques
from steelyard.base.arrays import Array
from steelyard.base.errors import DataError
from steelyard.excite.constraints.constraint_and_limits import Constraint, Margins
from steelyard.excite.design_problem_and_information import Problem
from steelyard.excite.search import repair_until_proven as finish
from steelyard.excite.search.repair_until_proven import LEAST_MOTION_SHARE, finished, scaled
from steelyard.excite.trajectories.exact_trajectories import ExactTrajectory
from steelyard.excite.trajectories.motion_families import rest_fourier

ALL = pytest.mark.parametrize("name", FAMILIES)
ROUNDING = 1e-12


def excess(design: Problem, x: Array) -> Array:
    """By how much dense samples are beyond the limits, per joint, in units of limits."""
    motion = design.basis.motion(x)
    t = np.union1d(np.linspace(0.0, motion.duration, 4001), motion.breaks)
    worst = np.full(len(x), -np.inf)
    for order, (lower, upper) in enumerate(design.limits.bounds):
        half = 0.5 * (upper - lower)
        values = motion.derivative(t, order)
        beyond = np.maximum(values - upper, lower - values).max(axis=0) / half
        worst = np.maximum(worst, beyond)
    return worst


def exact_excess(design: Problem, x: Array) -> Array:
    """The same by the motion's own extremes."""
    motion = design.basis.motion(x)
    parts = []
    for order, (lower, upper) in enumerate(design.limits.bounds):
        least, most = motion.extremes(order)
        parts += [most - upper, lower - least]
    return np.max(parts, axis=0)


def wild(design: Problem, seed: int, size: float) -> Array:
    shape = (design.basis.joints, design.basis.count)
    return size * np.random.default_rng(seed).standard_normal(shape)


@pytest.mark.slow
@ALL
@pytest.mark.parametrize(("jerk", "size"), [(False, 1e4), (True, 3.0)])
def test_wild_motions_keep_all_limits_at_all_times(name: str, jerk: bool, size: float) -> None:
    design = problem(FAMILIES[name], jerk=jerk)
    x = wild(design, 0, size)
    assert excess(design, x).max() > 0.0
    kept = scaled(design, x)
    assert kept is not None and kept.shape == x.shape
    assert excess(design, kept).max() <= ROUNDING
    assert exact_excess(design, kept).max() <= 0.0


@ALL
@pytest.mark.parametrize("jerk", [False, True])
def test_scaling_takes_no_more_than_it_must(name: str, jerk: bool) -> None:
    """Every joint that was shrunk is at one of its limits, to a thousandth."""
    design = problem(FAMILIES[name], jerk=jerk)
    x = design.basis.still(np.array([0.1, 0.1, 0.4])) + wild(design, 5, 3.0)
    kept = scaled(design, x)
    assert kept is not None
    assert np.all(exact_excess(design, x) > 0.0)
    assert np.all(excess(design, kept) > -1e-3)


@ALL
def test_motions_within_their_limits_stay_as_they_are(name: str) -> None:
    design = problem(FAMILIES[name])
    x = design.basis.still(np.array([0.1, 0.1, 0.4]))
    x = x + 1e-3 * wild(design, 1, 1.0)
    assert exact_excess(design, x).max() < 0.0
    np.testing.assert_array_equal(scaled(design, x), x)


@ALL
def test_joints_are_scaled_one_by_one(name: str) -> None:
    design = problem(FAMILIES[name])
    x = design.basis.still(np.array([0.1, 0.1, 0.4])) + 1e-3 * wild(design, 2, 1.0)
    x[1] += wild(design, 3, 50.0)[1]
    kept = scaled(design, x)
    assert kept is not None
    np.testing.assert_array_equal(kept[[0, 2]], x[[0, 2]])
    assert not np.allclose(kept[1], x[1]) and exact_excess(design, kept).max() <= 0.0


@pytest.mark.parametrize("share", [0.5, 0.9, 0.99, 0.999])
def test_a_way_that_needs_nearly_all_of_a_limit(share: float) -> None:
    """The move from start to end takes most of the speed; there is little left for the series."""
    design = problem(rest_fourier(3, 8.0, 4))
    way = share * 8.0 * 8.0 / 15.0 * design.limits.velocity
    way = np.minimum(way, 0.9 * (design.limits.upper - design.limits.lower))
    start = 0.5 * (design.limits.upper + design.limits.lower - way)
    design = problem(rest_fourier(3, 8.0, 4, start, start + way))
    kept = scaled(design, wild(design, 0, 10.0))
    assert kept is not None and np.all(np.abs(kept).max(axis=1) > 0.0)
    assert excess(design, kept).max() <= ROUNDING
    first, last = design.basis.motion(kept).derivative([0.0, 8.0], 0)
    np.testing.assert_allclose([first, last], [start, start + way], atol=1e-12)


def test_a_way_beyond_the_limits_cannot_be_scaled() -> None:
    lower, upper = limits().lower, limits().upper
    design = problem(rest_fourier(3, 1.5, 4, lower + 0.1, upper - 0.1))
    x = wild(design, 0, 1.0)
    assert scaled(design, x) is None
    with pytest.raises(DataError, match="no motion was found that can be proven"):
        finished(design, [x])


def test_a_start_outside_is_brought_inside() -> None:
    design = problem(FAMILIES["raw"])
    x = design.basis.still(np.array([9.0, 0.1, -9.0])) + 0.1 * wild(design, 0, 1.0)
    kept = scaled(design, x)
    assert kept is not None and exact_excess(design, kept).max() <= 0.0
    assert np.all(np.abs(kept - design.basis.still(kept[:, -1])).max(axis=1) > 1e-6)


@dataclass(frozen=True, eq=False)
class Reach(Constraint):
    """A constraint whose proof looks at the first joint's swing, and counts how often."""

    most: float
    name: str = "reach"
    labels: tuple[str, ...] = ("swing of the first joint",)
    unit: str = "rad"
    ranges: list[float] = field(default_factory=list)

    @property
    def activation_distance(self) -> Array:
        return np.array([0.1])

    def margins(self, q: Array, dq: Array, ddq: Array) -> Margins:
        """Blind: only the proof sees it."""
        return Margins(np.ones((len(q), 1)))

    def proven(self, trajectory: ExactTrajectory) -> Array:
        least, most = trajectory.extremes(0)
        self.ranges.append(float(most[0] - least[0]))
        return np.array([self.most - self.ranges[-1]])


def swinging(constraints: Sequence[Reach]) -> tuple[Problem, Array]:
    """A motion within the limits, its first joint swinging through 1 rad."""
    design = problem(FAMILIES["rest, from"], constraints)
    x = 0.3 * wild(design, 4, 1.0)
    kept = scaled(design, x)
    assert kept is not None
    swing = np.ptp(np.array(design.basis.motion(kept).extremes(0)), axis=0)[0]
    return design, kept / swing if swing > 1.0 else kept


@pytest.mark.parametrize("share", [0.9995, 0.997, 0.9, 0.6, 0.3, 0.1, 0.03])
def test_what_is_not_proven_is_shrunk_until_it_is(share: float) -> None:
    plain, x = swinging(())
    whole = np.ptp(np.array(plain.basis.motion(x).extremes(0)), axis=0)[0]
    reach = Reach(share * whole)
    design = problem(plain.basis, [reach])
    best = finished(design, [x], deadline=time.monotonic() - 1.0)
    swing = np.ptp(np.array(best.trajectory.extremes(0)), axis=0)[0]
    assert swing <= reach.most
    assert swing >= reach.most - 2.5e-3 * whole
    np.testing.assert_allclose(best.trajectory.derivative([0.0], 0)[0], START, atol=1e-12)
    assert len(reach.ranges) < 20
    assert best.criterion_value == design.criterion_value(best.x)


@dataclass(frozen=True, eq=False)
class Slab(Constraint):
    """Positions of the first joint that are forbidden, so few that samples may step over them."""

    at: float
    half: float
    name: str = "slab"
    labels: tuple[str, ...] = ("first joint off the slab",)
    unit: str = "rad"

    @property
    def activation_distance(self) -> Array:
        return np.array([0.3])

    def margins(self, q: Array, dq: Array, ddq: Array) -> Margins:
        by_q = np.zeros((len(q), 1, q.shape[1]))
        by_q[:, 0, 0] = np.sign(q[:, 0] - self.at)
        return Margins(np.abs(q[:, :1] - self.at) - self.half, by_q)

    def proven(self, trajectory: ExactTrajectory) -> Array:
        low, high = (float(ends[0]) for ends in trajectory.extremes(0))
        return np.array([max(low - self.at, self.at - high) - self.half])


@pytest.mark.slow
def test_what_samples_step_over_is_optimised_again_at_closer_ones() -> None:
    plain, x = swinging(())
    places = np.sort(plain.inequalities.state(x)[0][:, 0])
    widest = int(np.argmax(np.diff(places)[-20:])) + len(places) - 21
    gap = places[widest + 1] - places[widest]
    slab = Slab(0.5 * (places[widest] + places[widest + 1]), 0.2 * gap)
    design = problem(plain.basis, [slab])
    assert design.inequalities.smallest_margin(x) > 0.0 > slab.proven(design.basis.motion(x))[0]
    again, smaller = (
        finished(design, [x], deadline)
        for deadline in (time.monotonic() + 60.0, time.monotonic() - 1.0)
    )
    for one in (again, smaller):
        assert slab.proven(one.trajectory)[0] >= 0.0
    assert again.criterion_value < 0.05 * smaller.criterion_value


def test_closer_samples_lie_between() -> None:
    inequalities = problem(FAMILIES["rest, from"]).inequalities
    closer = inequalities.refined()
    np.testing.assert_array_equal(closer.t[::2], inequalities.t)
    np.testing.assert_allclose(closer.t[1::2] - inequalities.t, 0.5 * inequalities.t[1])
    assert closer.t[-1] < inequalities.basis.duration


def test_what_needs_no_shrinking_is_not_shrunk() -> None:
    plain, x = swinging(())
    reach = Reach(10.0)
    best = finished(problem(plain.basis, [reach]), [x], deadline=time.monotonic() - 1.0)
    np.testing.assert_array_equal(best.x, x)
    assert len(reach.ranges) == 1


def test_nothing_proven_is_reported() -> None:
    plain, x = swinging(())
    whole = np.ptp(np.array(plain.basis.motion(x).extremes(0)), axis=0)[0]
    for most in (-1.0, 0.5 * LEAST_MOTION_SHARE * whole):
        with pytest.raises(DataError) as caught:
            finished(problem(plain.basis, [Reach(most)]), [x, 0.5 * x], time.monotonic() - 1.0)
        assert (
            caught.value.wrong == "no motion was found that can be proven to keep all constraints"
        )
        assert caught.value.where == "excitation"
        assert caught.value.fix.startswith("widen the boxes or the margins")


def test_the_second_best_counts_if_the_best_is_not_proven() -> None:
    plain, x = swinging(())
    quiet = x.copy()
    quiet[0] *= 1e-3
    whole = np.ptp(np.array(plain.basis.motion(x).extremes(0)), axis=0)[0]
    reach = Reach(0.5 * LEAST_MOTION_SHARE * whole)
    best = finished(problem(plain.basis, [reach]), [x, quiet], deadline=time.monotonic() - 1.0)
    np.testing.assert_array_equal(best.x, quiet)


def test_after_the_deadline_one_motion_is_finished_and_no_more(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    design = problem(FAMILIES["rest, from"])
    tried: list[Array] = []
    polished = finish._polished_motions
    monkeypatch.setattr(
        finish, "_polished_motions", lambda *of: tried.extend(made := polished(*of)) or made
    )
    candidates = [wild(design, seed, 1.0) for seed in range(4)]
    one = finished(design, candidates, deadline=time.monotonic() - 1.0)
    assert len(tried) == 1, "neither polished nor followed by others"
    tried.clear()
    best = finished(design, candidates)
    assert len(tried) == 8
    assert best.criterion_value < one.criterion_value


@pytest.mark.slow
@pytest.mark.parametrize("name", ["rest, from to", "quintic, from", "reaching"])
def test_real_walls_are_kept_at_all_times(name: str) -> None:
    inequalities = [box(0.7), torques()]
    design = problem(FAMILIES[name], inequalities)
    starts = random_starts(design.inequalities, np.random.default_rng(0), 2)
    best = finished(design, starts)
    assert exact_excess(design, best.x).max() <= 0.0
    t = np.linspace(0.0, best.trajectory.duration, 20_001)
    states = [best.trajectory.derivative(t, order) for order in range(3)]
    for constraint in inequalities:
        assert constraint.margins(*states).values.min() >= 0.0
        assert np.all(constraint.proven(best.trajectory) >= 0.0)
    begun = min(design.criterion_value(x) for x in starts)
    assert best.criterion_value < begun
    assert best.criterion_value == design.criterion_value(best.x)
