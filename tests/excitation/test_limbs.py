"""Limbs on one base: what each shows is its own, and searches make use of it."""

from contextlib import suppress
from dataclasses import replace
from functools import cache
from itertools import count, islice

import numpy as np
import pytest

from invented import ball, tree, turned
from steelyard.arrays import Array
from steelyard.excitation.criteria import KINDS
from steelyard.excitation.fourier_bases import RestFourier
from steelyard.excitation.limbs import Limb, composed, limbs_of
from steelyard.excitation.limits import motion_limits
from steelyard.excitation.methods import Gradient, seeded
from steelyard.excitation.objective import Case
from steelyard.excitation.problem import Problem
from steelyard.excitation.starts import each_start, random_starts
from steelyard.model import Model
from steelyard.progress import Stopped
from steelyard.regression.gradient import Shows
from steelyard.robot.robot import Body, Coordinate, Robot
from steelyard.terms.coulomb import Coulomb
from steelyard.terms.rigid_body import RigidBody
from steelyard.terms.viscous import Viscous

LEFT, RIGHT = (0, 2), (1, 3)


def two_limbs() -> Robot:
    """Two arms of two joints on one base, their joints not side by side in the list."""
    axis = np.array([0.3, -0.5, 0.8]) / np.linalg.norm([0.3, -0.5, 0.8])
    rows = [("upper_left", -1), ("upper_right", -1), ("lower_left", 0), ("lower_right", 1)]
    bodies = tuple(
        Body(n, f"{n}_joint", "revolute", p, turned(i), [0.1, 0.2, -0.3], axis, i, 1.0, 0.0)
        for i, (n, p) in enumerate(rows)
    )
    named = tuple(replace(body, inertia=ball(i), known=True) for i, body in enumerate(bodies))
    return Robot("two", named, tuple(Coordinate(f"{n}_joint", "revolute") for n, _ in rows))


def shows(robot: Robot) -> Shows:
    model = Model(robot, (RigidBody(), Coulomb(), Viscous()))
    return Shows(model, np.ones(robot.n), np.full(robot.n, 0.02))


@cache
def design() -> Problem:
    robot = two_limbs()
    case = Case(shows(robot), KINDS["d_optimal"])
    return Problem(robot, RestFourier(4, 8.0, 4), motion_limits(robot), (), (case,))


def test_branches_on_the_base_are_limbs() -> None:
    limbs = design().limbs
    assert [limb.joints for limb in limbs] == [LEFT, RIGHT]
    every = sorted(column for limb in limbs for column in limb.columns)
    assert every == list(range(len(design().cases[0].shows.base)))


def test_joints_that_carry_branches_make_one_limb_of_them() -> None:
    assert [limb.joints for limb in limbs_of(shows(tree()))] == [(0, 1, 2, 3)]


def test_information_of_limbs_is_block_diagonal() -> None:
    """Exactly zero between them, and a limb's own block is the same whatever the others do."""
    problem = design()
    first, second = random_starts(problem.walls, np.random.default_rng(0), 2)
    mixed = first.copy()
    mixed[list(RIGHT)] = second[list(RIGHT)]
    left, right = (list(limb.columns) for limb in problem.limbs)
    one, other = (problem.objective.seen(x)[0].gram for x in (first, mixed))
    assert not one[np.ix_(left, right)].any() and one[np.ix_(left, left)].any()
    np.testing.assert_array_equal(one[np.ix_(left, left)], other[np.ix_(left, left)])
    assert np.abs(one - other)[np.ix_(right, right)].max() > 0.0


def test_every_limb_takes_its_own_best_start() -> None:
    problem = design()
    starts = random_starts(problem.walls, np.random.default_rng(2), 12)
    starts.sort(key=lambda x: problem.objective.value(x, 4.0))
    x = composed(problem.objective, problem.walls, problem.limbs, starts)
    assert problem.walls.worst(x) > 0.0
    assert problem.objective.value(x, 4.0) < problem.objective.value(starts[0], 4.0)

    def value(x: Array, limb: Limb) -> float:
        own = np.ix_(limb.columns, limb.columns)
        return KINDS["d_optimal"].smooth(problem.objective.seen(x)[0].gram[own], 4.0)[0]

    for limb in problem.limbs:
        assert value(x, limb) == pytest.approx(min(value(y, limb) for y in starts), rel=1e-12)


def found(problem: Problem, steps: int, seed: int) -> list[Array]:
    """What searches end with, one after another, as long as so many steps are left."""
    left, ends = [steps], list[Array]()

    def watch(_: Array) -> None:
        left[0] -= 1
        if left[0] < 0:
            raise Stopped("so many steps are enough")

    with suppress(Stopped):
        for number in count():
            ends.append(Gradient().search(problem, seeded(seed, number), watch))
    return sorted(ends, key=lambda x: problem.objective.value(x, 64.0))


def test_limbs_are_found_better_with_as_many_steps_than_all_joints_at_once() -> None:
    limbs, whole = design(), replace(design())
    whole.__dict__["limbs"] = (Limb((0, 1, 2, 3), tuple(range(len(limbs.cases[0].shows.base)))),)
    values = []
    for problem in (limbs, whole):
        ends = [found(problem, 400, seed) for seed in range(3)]
        best = [composed(problem.objective, problem.walls, problem.limbs, one) for one in ends]
        values.append([problem.objective.value(x, 64.0) for x in best])
    assert np.mean(values[0]) < np.mean(values[1])


def test_a_search_that_is_ended_has_the_best_start_so_far() -> None:
    problem, told = design(), list[Array]()

    def watch(x: Array) -> None:
        told.append(x)
        if len(told) == 5:
            raise Stopped("five starts are enough")

    with pytest.raises(Stopped):
        Gradient().search(problem, seeded(5, 0), watch)
    starts = list(islice(each_start(problem.walls, seeded(5, 0), 30), 5))
    values = [problem.objective.value(x, 4.0) for x in starts]
    best = [problem.objective.value(x, 4.0) for x in told]
    np.testing.assert_array_equal(best, np.minimum.accumulate(values))
