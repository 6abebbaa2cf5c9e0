"""Limbs on one base: what each shows is its own, and searches make use of it."""

from contextlib import suppress
from dataclasses import replace
from functools import cache, partial
from itertools import count

import numpy as np
import pytest

from designing import random_starts
from invented import ball, tree, turned
from steelyard.base.arrays import Array
from steelyard.base.progress import Stopped
from steelyard.excite.constraints.constraint_and_limits import motion_limits
from steelyard.excite.constraints.tool_workspace import Marker, points_of, tool_box
from steelyard.excite.design_problem_and_information import (
    Case,
    InformationEvaluator,
    JointGroup,
    Problem,
    composed_motions,
    joint_groups_of,
)
from steelyard.excite.optimality_criteria import CRITERIA
from steelyard.excite.search import search_methods as methods
from steelyard.excite.search.feasibility import each_start
from steelyard.excite.search.search_methods import search_by_gradient, seeded
from steelyard.excite.trajectories.motion_families import rest_fourier
from steelyard.model.laws.friction_over_speed import Coulomb, Viscous
from steelyard.model.laws.laws_without_friction import RigidBody
from steelyard.model.model import Model
from steelyard.robot.robot import Body, Coordinate, Robot

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


def shows(robot: Robot) -> InformationEvaluator:
    model = Model(robot, (RigidBody(), Coulomb(), Viscous()))
    return InformationEvaluator(model, np.ones(robot.n), np.full(robot.n, 0.02))


@cache
def design() -> Problem:
    robot = two_limbs()
    case = Case(shows(robot), CRITERIA["d_optimal"])
    return Problem(robot, rest_fourier(4, 8.0, 4), motion_limits(robot), (), (case,))


def test_branches_on_the_base_are_limbs() -> None:
    limbs = design().limbs
    assert [limb.joints for limb in limbs] == [LEFT, RIGHT]
    every = sorted(column for limb in limbs for column in limb.columns)
    assert every == list(range(len(design().cases[0].shows.base)))


def test_joints_that_carry_branches_make_one_limb_of_them() -> None:
    assert [limb.joints for limb in joint_groups_of(shows(tree()))] == [(0, 1, 2, 3)]


def test_information_of_limbs_is_block_diagonal() -> None:
    """Exactly zero between them, and a limb's own block is the same whatever the others do."""
    problem = design()
    first, second = random_starts(problem.inequalities, np.random.default_rng(0), 2)
    mixed = first.copy()
    mixed[list(RIGHT)] = second[list(RIGHT)]
    left, right = (list(limb.columns) for limb in problem.limbs)
    one, other = (problem.objective.seen(x)[0].gram for x in (first, mixed))
    assert not one[np.ix_(left, right)].any() and one[np.ix_(left, left)].any()
    np.testing.assert_array_equal(one[np.ix_(left, left)], other[np.ix_(left, left)])
    assert np.abs(one - other)[np.ix_(right, right)].max() > 0.0


def test_every_limb_takes_its_own_best_start() -> None:
    problem = design()
    starts = random_starts(problem.inequalities, np.random.default_rng(2), 12)
    reported = list(composed_motions(problem, starts))
    values = [problem.objective.value(x, 4.0) for x in reported]
    assert len(reported) == len(starts) and values == sorted(values, reverse=True)
    assert problem.inequalities.smallest_margin(reported[-1]) > 0.0
    assert values[-1] < min(problem.objective.value(x, 4.0) for x in starts)

    def value(x: Array, limb: JointGroup) -> float:
        own = np.ix_(limb.columns, limb.columns)
        return CRITERIA["d_optimal"].smooth(problem.objective.seen(x)[0].gram[own], 4.0)[0]

    for limb in problem.limbs:
        least = min(value(y, limb) for y in starts)
        assert value(reported[-1], limb) == pytest.approx(least, rel=1e-12)


def test_limbs_that_each_motion_leaves_at_rest_are_put_together() -> None:
    """No motion shows all parameters, so the criterion of each of them is infinite."""
    problem = design()
    x = random_starts(problem.inequalities, np.random.default_rng(3), 1)[0]
    still = problem.basis.still(x[:, -1])
    halves = []
    for joints in (LEFT, RIGHT):
        half = still.copy()
        half[list(joints)] = x[list(joints)]
        halves.append(half)
    assert all(np.isinf(problem.objective.value(half, 4.0)) for half in halves)
    first, both = composed_motions(problem, halves)
    assert first is halves[0]
    assert np.isfinite(problem.objective.value(both, 4.0))


def test_a_start_that_shows_too_little_is_not_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    """A search that is ended while it draws starts ends with one that shows all parameters."""
    problem, reported = design(), list[Array]()
    good = random_starts(problem.inequalities, np.random.default_rng(3), 1)[0]
    starts = [problem.basis.still(good[:, -1]), good]
    monkeypatch.setattr(methods, "each_start", lambda *_: iter(starts))
    search_by_gradient(problem, seeded(0, 0), reported.append)
    np.testing.assert_array_equal(reported[0], good)


def test_a_limb_does_not_shrink_with_the_others() -> None:
    """One arm in a tight box; the other keeps the size that its limits leave it."""
    problem = design()
    mark = Marker(problem.robot.bodies[LEFT[-1]].name)
    place = mark_at(problem, mark)
    constraint = tool_box(problem.robot, mark, list(place - 0.02), list(place + 0.02))
    inequalities = replace(problem, constraints=(constraint,)).inequalities
    joints = [limb.joints for limb in problem.limbs]
    sizes = []
    for limbs in ([], joints):
        start = next(each_start(inequalities, np.random.default_rng(0), 5, limbs))
        assert inequalities.smallest_margin(start) > 0.0
        sizes.append(np.abs(inequalities.shapes[1] @ start[list(RIGHT)].T).max())
    assert sizes[1] > 2.0 * sizes[0]


def mark_at(problem: Problem, mark: Marker) -> Array:
    """Where a marker is in the middle posture, shape `(3,)`."""
    middle = 0.5 * (problem.limits.lower + problem.limits.upper)
    return points_of(problem.robot, mark)(middle[None])[0][0, 0]


def found(problem: Problem, steps: int, seed: int) -> list[Array]:
    """What searches end with, one after another, as long as so many steps are left."""
    left, ends = [steps], list[Array]()

    def watch(_: Array) -> None:
        left[0] -= 1
        if left[0] < 0:
            raise Stopped("so many steps are enough")

    with suppress(Stopped):
        for number in count():
            ends.append(search_by_gradient(problem, seeded(seed, number), watch))
    return sorted(ends, key=lambda x: problem.objective.value(x, 64.0))


@pytest.mark.slow
def test_limbs_are_found_better_with_as_many_steps_than_all_joints_at_once() -> None:
    limbs, whole = design(), replace(design())
    whole.__dict__["limbs"] = (
        JointGroup((0, 1, 2, 3), tuple(range(len(limbs.cases[0].shows.base)))),
    )
    values = []
    for problem in (limbs, whole):
        whole_of = partial(composed_motions, problem)
        best = [list(whole_of(found(problem, 250, seed)))[-1] for seed in range(2)]
        values.append([problem.objective.value(x, 64.0) for x in best])
    assert np.mean(values[0]) < np.mean(values[1])


def test_a_search_that_is_ended_has_the_best_start_so_far() -> None:
    problem, reported = design(), list[Array]()

    def watch(x: Array) -> None:
        reported.append(x)
        if len(reported) == 5:
            raise Stopped("five starts are enough")

    with pytest.raises(Stopped):
        search_by_gradient(problem, seeded(5, 0), watch)
    values = [problem.objective.value(x, 4.0) for x in reported]
    assert values == sorted(values, reverse=True) and values[-1] < values[0]
