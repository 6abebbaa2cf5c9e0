"""Slopes of what a motion shows against central differences of the regressor, for all terms."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import pytest

from closed_chains import CHAINS, independent_path, parallelogram
from invented import ball, mimic, tree
from law_cases import memoryless, name_of, spanning
from moving import geared
from steelyard.base.arrays import Array
from steelyard.estimate.information.base_parameters_and_regressor import Regressor, base_regressor
from steelyard.excite.design_problem_and_information import Case, InformationEvaluator, Objective
from steelyard.excite.optimality_criteria import CRITERIA, measure, worst
from steelyard.excite.trajectories.motion_families import Basis, rest_fourier, splines
from steelyard.model.laws.friction_over_speed import Coulomb, Coupled, Cubic, Root, Viscous
from steelyard.model.laws.laws_without_friction import Offset, RigidBody
from steelyard.model.laws.register import DEFAULT_TERMS
from steelyard.model.model import Model
from steelyard.model.terms.term import Term
from steelyard.robot.robot import Robot

CHOSEN = ("slider_joint", "tip_joint")
WRIST = (("wrist", (("left_joint", 1.0), ("tip_joint", -2.0))),)
PULL = (("from", "trunk_joint"), ("to", "slider_joint"))
PUSH = (("from", "motor4"), ("to", "left_joint"))
ENDS = ((0.3, -0.4, 1.2), (0.1, 0.2, 0.0))
CASES = memoryless(geared(), spanning())
WEIGHTS = np.array([0.7, 3.0, 0.2, 1.6])
SHARP = 1e-9
State = tuple[Array, Array, Array]


def shows(robot: Robot, terms: Sequence[Term], width: float) -> InformationEvaluator:
    return InformationEvaluator(
        Model(robot, tuple(terms)), WEIGHTS[: robot.n], np.full(robot.n, width)
    )


def drawn_state(n: int, count: int = 12, seed: int = 0) -> State:
    """Random states whose speeds, and their combinations here, are away from every jump."""
    random = np.random.default_rng(seed)
    q, dq, ddq = random.normal(size=(3, n, 8 * count))
    far = np.abs(dq).min(axis=0) > 0.15
    if n == 4:
        motor4 = 60.0 * (dq[2] + dq[3])
        far &= (np.abs(dq[2] - 2.0 * dq[3]) > 0.15) & (np.abs(motor4) > 5.0)
    chosen = np.flatnonzero(far)[:count]
    assert len(chosen) == count
    return q[:, chosen], dq[:, chosen], ddq[:, chosen]


def symmetric(size: int, seed: int = 1) -> Array:
    drawn = np.random.default_rng(seed).normal(size=(size, size))
    return np.asarray(drawn + drawn.T)


def differences(function: Callable[[State], Array], state: State, h: float = 2e-3) -> list[Array]:
    """Sixth-order central differences by every entry; the function is `(N,)`, sample by sample."""

    def slope(order: int, joint: int, step: float) -> Array:
        moved = []
        for side in (step, -step):
            arrays = [x.copy() for x in state]
            arrays[order][joint] += side
            moved.append(function((arrays[0], arrays[1], arrays[2])))
        return np.asarray((moved[0] - moved[1]) / (2.0 * step))

    def fine(order: int, joint: int) -> Array:
        first, second, third = (slope(order, joint, h / k) for k in (1.0, 2.0, 4.0))
        low, high = (4.0 * second - first) / 3.0, (4.0 * third - second) / 3.0
        return np.asarray((16.0 * high - low) / 15.0)

    n = len(state[0])
    return [np.array([fine(order, j) for j in range(n)]) for order in range(3)]


@dataclass(frozen=True)
class Oracle:
    """Sums of weighted squares of the regressor as identification computes it."""

    shows: InformationEvaluator

    @cached_property
    def regressor(self) -> Regressor:
        return base_regressor(self.shows.model)

    def rows(self, state: State) -> Array:
        """Shape `(n, N, c)`."""
        return self.regressor.dense(*state)

    def gram(self, state: State) -> Array:
        y = self.rows(state)
        return np.asarray(np.einsum("r,rta,rtb->ab", self.shows.weights, y, y))

    def seen_by(self, slope: Array, state: State) -> Array:
        """What every sample adds to `sum(slope * gram)`, shape `(N,)`."""
        y = self.rows(state)
        return np.asarray(np.einsum("r,rta,ab,rtb->t", self.shows.weights, y, slope, y))


def compare(found: Sequence[Array], expected: Sequence[Array], rtol: float = 1e-6) -> None:
    size = max(float(np.abs(x).max()) for x in expected)
    for mine, theirs in zip(found, expected, strict=True):
        np.testing.assert_allclose(mine, theirs, rtol=rtol, atol=1e-8 * (size + 1e-9))


@pytest.mark.slow
@pytest.mark.parametrize("term", CASES, ids=name_of)
def test_information_and_slopes_of_every_term(term: Term) -> None:
    sharp = shows(geared(), [term], SHARP)
    oracle, state = Oracle(sharp), drawn_state(4)
    seen = sharp.at(*state, step=0.3)
    gram = oracle.gram(state)
    size = np.abs(gram).max()
    assert size > 0.0 and len(gram) == len(sharp.base)
    np.testing.assert_allclose(seen.gram, 0.3 * gram, rtol=1e-12, atol=1e-13 * size)
    slope = symmetric(len(gram))
    expected = differences(lambda s: 0.3 * oracle.seen_by(slope, s), state)
    compare(sharp.pull(seen, slope), expected)


SOFT = [t for t in CASES if not getattr(t, "threshold", 0.0)]
"""With a threshold the law jumps away from zero speed, where nothing is softened."""


@pytest.mark.slow
@pytest.mark.parametrize("term", SOFT, ids=name_of)
def test_softened_laws_have_slopes_at_low_speed(term: Term) -> None:
    soft = shows(geared(), [term], 0.5)
    q, dq, ddq = drawn_state(4, count=4, seed=3)
    state = (q, 0.2 * dq, ddq)
    slope = symmetric(len(soft.base))

    def total(s: State) -> Array:
        one = [soft.at(*(x[:, [k]] for x in s)).gram for k in range(s[0].shape[1])]
        return np.array([np.sum(slope * gram) for gram in one])

    seen = soft.at(*state)
    assert np.sum(slope * seen.gram) == pytest.approx(total(state).sum(), rel=1e-12)
    compare(soft.pull(seen, slope), differences(total, state))


@pytest.mark.parametrize("term", CASES, ids=name_of)
def test_standing_still_has_finite_slopes(term: Term) -> None:
    """Every motion from rest has a sample at zero speed."""
    q = np.random.default_rng(0).normal(size=(4, 5))
    for width in (SHARP, 0.5):  # as above, where their programs are compiled
        still = shows(geared(), [term], width)
        seen = still.at(q, np.zeros_like(q), np.zeros_like(q))
        slopes = still.pull(seen, symmetric(len(still.base)))
        assert np.all(np.isfinite(seen.gram))
        assert all(np.all(np.isfinite(x)) for x in slopes)


def test_terms_together() -> None:
    terms = [*DEFAULT_TERMS, Root(), Cubic(along=WRIST), Coupled(pairs=(PULL,), kind="coulomb")]
    sharp = shows(geared(), terms, SHARP)
    oracle, state = Oracle(sharp), drawn_state(4, seed=5)
    seen = sharp.at(*state)
    np.testing.assert_allclose(seen.gram, oracle.gram(state), rtol=1e-11, atol=1e-11)
    slope = symmetric(len(sharp.base))
    expected = differences(lambda s: oracle.seen_by(slope, s), state)
    compare(sharp.pull(seen, slope), expected)


def test_a_body_that_follows_another_joint(tmp_path: Path) -> None:
    sharp = shows(mimic(tmp_path), DEFAULT_TERMS, SHARP)
    oracle, state = Oracle(sharp), drawn_state(1)
    slope = symmetric(len(sharp.base))
    expected = differences(lambda s: oracle.seen_by(slope, s), state)
    compare(sharp.pull(sharp.at(*state), slope), expected)


CLOSED = {
    **CHAINS,
    "parallelogram": lambda: parallelogram(tuple(ball(k) for k in range(4)), 0.3, 0.4),
}


@pytest.mark.slow
@pytest.mark.parametrize("chain", CLOSED)
def test_passive_joints_move_with_the_independent_ones(chain: str) -> None:
    robot = CLOSED[chain]()
    sharp = shows(robot, [RigidBody(), Viscous(), Offset()], SHARP)
    oracle = Oracle(sharp)
    q = independent_path(robot, 40, 0.15)
    dq, ddq = np.random.default_rng(2).normal(size=(2, *q.shape))
    state = (q, dq, ddq)
    seen = sharp.at(*state)
    size = np.abs(seen.gram).max()
    np.testing.assert_allclose(seen.gram, oracle.gram(state), rtol=1e-9, atol=1e-11 * size)
    slope = symmetric(len(sharp.base))
    expected = differences(lambda s: oracle.seen_by(slope, s), state)
    compare(sharp.pull(seen, slope), expected)
    assert np.abs(expected[0]).max() > 1e-3, "positions matter here, or nothing is tested"


# Criteria of whole motions, by the coefficients of a basis.

BASES: dict[str, Basis] = {
    "rest": rest_fourier(4, 6.0, 4),
    "start and end": rest_fourier(4, 6.0, 4, [0.1, 0.2, 0.3, 0.4], [0.4, 0.0, -0.3, 0.2]),
    "spline": splines(4, 6.0, 14, 5),
}
FEW = (RigidBody(), Coulomb(), Viscous())


def sixth(function: Callable[[float], float], h: float) -> float:
    a, b, c = ((function(h / k) - function(-h / k)) / (2.0 * h / k) for k in (1.0, 2.0, 4.0))
    return (16.0 * (4.0 * c - b) / 3.0 - (4.0 * b - a) / 3.0) / 15.0


def check_objective(objective: Objective, x: Array, sharpness: float, reach: float) -> None:
    """The slope along its own direction, and along random ones."""
    value, slope = objective(x, sharpness)
    assert np.isfinite(value) and slope.shape == x.shape
    random = np.random.default_rng(4)
    directions = [slope / np.linalg.norm(slope), *random.normal(size=(4, *x.shape))]
    for direction in directions:
        unit = direction / np.linalg.norm(direction)
        expected = sixth(lambda s, u=unit: objective(x + s * u, sharpness)[0], reach)
        found = float(np.sum(slope * unit))
        assert found == pytest.approx(expected, rel=1e-6, abs=1e-6 * np.linalg.norm(slope))


@pytest.mark.parametrize("basis", BASES)
@pytest.mark.parametrize("kind", CRITERIA)
def test_criteria_by_coefficients(kind: str, basis: str) -> None:
    soft = shows(tree(), FEW, 0.3)
    chosen = BASES[basis]
    t = np.linspace(0.0, chosen.duration, 60, endpoint=False)
    objective = Objective(chosen, [Case(soft, CRITERIA[kind])], t)
    x = 0.6 * np.random.default_rng(7).normal(size=(4, chosen.count))
    check_objective(objective, x, 8.0, 4e-3)


def test_the_worst_of_several_loads_with_earlier_runs() -> None:
    soft = shows(tree(), FEW, 0.3)
    count, basis = len(soft.base), BASES["rest"]
    random = np.random.default_rng(0)
    prior = np.diag(random.uniform(0.5, 2.0, count))
    cases = [
        Case(soft, measure(CRITERIA["a_optimal"], prior, None, random.uniform(0.5, 2.0, count))),
        Case(
            soft, measure(CRITERIA["a_optimal"], prior, (0, 3, 5), random.uniform(0.5, 2.0, count))
        ),
        Case(shows(tree(), FEW, 0.1), CRITERIA["e_optimal"]),
    ]
    t = np.linspace(0.0, basis.duration, 60, endpoint=False)
    x = 0.6 * random.normal(size=(4, basis.count))
    objective = Objective(basis, cases, t)
    check_objective(objective, x, 1.0, 4e-3)
    grams = [
        (case.criterion, seen.gram) for case, seen in zip(cases, objective.seen(x), strict=True)
    ]
    values = [kind.smooth(gram, 1.0)[0] for kind, gram in grams]
    assert np.ptp(values) > 0.01 and objective(x, 1.0)[0] == worst(grams, 1.0)[0] > max(values)


def test_information_does_not_depend_on_how_densely_it_is_sampled() -> None:
    soft, basis = shows(tree(), FEW, 0.3), BASES["rest"]
    x = 0.6 * np.random.default_rng(7).normal(size=(4, basis.count))
    grams = []
    for samples in (200, 800):
        t = np.linspace(0.0, basis.duration, samples, endpoint=False)
        grams.append(Objective(basis, [Case(soft, CRITERIA["condition"])], t).seen(x)[0].gram)
    np.testing.assert_allclose(grams[0], grams[1], rtol=1e-3, atol=1e-3 * np.abs(grams[1]).max())


def test_a_motion_that_shows_nothing() -> None:
    basis = BASES["rest"]
    t = np.linspace(0.0, basis.duration, 60, endpoint=False)
    objective = Objective(basis, [Case(shows(tree(), FEW, 0.3), CRITERIA["condition"])], t)
    value, slope = objective(basis.still(np.full(4, 0.2)), 8.0)
    assert value == np.inf and not np.any(slope)
