"""Bounds over stretches of time hold what the motion does there."""

import numpy as np
import pytest

from exact_motions import MAKERS, piecewise
from steelyard.base.arrays import Array
from steelyard.excite.constraints.bounds_in_time_and_effort_limits import (
    MOST_STRETCHES,
    Course,
    Stretches,
    proven_minimum,
)
from steelyard.excite.trajectories.fourier import FourierMotion
from steelyard.symbolic.program_and_softening import InputArray as Input
from steelyard.symbolic.program_and_softening import Program, Step

KIND = pytest.mark.parametrize("make", MAKERS, ids=lambda make: make.__name__)


def slow() -> FourierMotion:
    """Three joints that move gently for ten seconds."""
    free = 0.2 * np.random.default_rng(5).standard_normal((3, 6))
    return FourierMotion.from_free(np.zeros(3), free, 10.0)


@KIND
@pytest.mark.parametrize("count", [3, 60])
def test_states_stay_within_their_bounds(make, count: int) -> None:
    motion = make(np.random.default_rng(7))
    course = Course(motion)
    edges = course.edges(count)
    assert edges[0] == 0.0 and edges[-1] == motion.duration
    assert np.isin(motion.breaks, edges).all() and np.all(np.diff(edges) > 0.0)
    stretches = course.stretches(edges[:-1], edges[1:])
    for share in np.random.default_rng(8).uniform(-1.0, 1.0, 40):
        t = stretches.middle + 0.999999 * share * stretches.half
        for order in range(4):
            x = motion.derivative(t, order).T
            assert np.all(x >= stretches.lower[order]) and np.all(x <= stretches.upper[order])


def test_bounds_close_in_on_the_motion() -> None:
    course = Course(slow())
    widths = []
    for count in (1000, 2000):
        edges = course.edges(count)
        found = course.stretches(edges[:-1], edges[1:])
        widths.append([(found.upper[k] - found.lower[k]).max() for k in range(3)])
    np.testing.assert_allclose(np.array(widths[1]) / widths[0], 0.5, atol=0.02)


def first_joint(stretches: Stretches) -> tuple[Array, Array]:
    """How far the first joint is above -1 rad, and below 1 rad."""
    program = Program(
        (Input("q", 3),),
        (
            Step("input", (0, 0)),
            Step("constant", value=1.0),
            Step("add", (1, 0)),
            Step("sub", (1, 0)),
        ),
        (2, 3),
    )
    return stretches.middles(program)[0], stretches.throughout(program)[0]


@KIND
@pytest.mark.parametrize("tolerance", [1e-1, 1e-4])
def test_a_proven_minimum_is_below_and_near_the_least(make, tolerance: float) -> None:
    motion = make(np.random.default_rng(9))
    proven = proven_minimum(motion, first_joint, np.full(2, tolerance))
    least, greatest = motion.extremes(0)
    exact = np.array([1.0 + least[0], 1.0 - greatest[0]])
    assert np.all(proven <= exact + 1e-9 * np.abs(exact))
    assert np.all(exact - proven <= tolerance * (1.0 + 1e-6) + 1e-9)


def test_one_stretch_is_enough_to_begin_with() -> None:
    motion = slow()
    fine = proven_minimum(motion, first_joint, np.full(2, 1e-3))
    rough = proven_minimum(motion, first_joint, np.full(2, 1e-3), count=1)
    np.testing.assert_allclose(fine, rough, atol=1e-3)


def test_a_proof_that_cannot_close_ends_with_what_it_has() -> None:
    counts = []

    def hopeless(stretches: Stretches) -> tuple[Array, Array]:
        counts.append(len(stretches.middle))
        return np.zeros((1, counts[-1])), np.full((1, counts[-1]), -3.0)

    proven = proven_minimum(piecewise(np.random.default_rng(1)), hopeless, np.array([0.1]))
    assert proven.tolist() == [-3.0] and MOST_STRETCHES / 10 < sum(counts) <= MOST_STRETCHES
