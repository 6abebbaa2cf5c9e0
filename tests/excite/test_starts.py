"""Where searches begin: strictly inside, whatever the seed, as long as there is room."""

from dataclasses import dataclass

import numpy as np
import pytest

from designing import END, FAMILIES, MIDDLE, START, box, limits, problem, random_starts, torques
from steelyard.base.arrays import Array
from steelyard.base.errors import DataError
from steelyard.excite.constraints.constraint_and_limits import Constraint, Margins
from steelyard.excite.search.feasibility import (
    POSTURE_ATTEMPTS,
    lacks_at,
    nearest_free,
    postures,
    widened,
)
from steelyard.excite.trajectories.exact_trajectories import ExactTrajectory

CONSTRAINTS: dict[str, list[Constraint]] = {
    "none": [],
    "box": [box(0.6)],
    "box and torque": [box(0.8), torques()],
    "tight box": [box(0.12)],
}


@dataclass(frozen=True, eq=False)
class Nowhere(Constraint):
    """Nothing keeps it; it says nothing of where to go."""

    name: str = "nowhere"
    labels: tuple[str, ...] = ("less bad", "worse")
    unit: str = "m"

    @property
    def activation_distance(self) -> Array:
        return np.ones(2)

    def margins(self, q: Array, dq: Array, ddq: Array) -> Margins:
        return Margins(np.tile([-1.0, -2.0], (len(q), 1)))

    def proven(self, trajectory: ExactTrajectory) -> Array:
        return np.array([-1.0, -2.0])


def test_helpers_are_what_they_say() -> None:
    """The middle posture satisfies all constraints; so do prescribed start and end postures."""
    for kept in CONSTRAINTS.values():
        assert not lacks_at(kept, MIDDLE)
    for posture in (START, END):
        assert not lacks_at(CONSTRAINTS["box and torque"], posture)


ROOMS = {name: ["none", "box", "box and torque"] for name in FAMILIES if "from" in name}
"""Start and end postures are outside of the tight box."""

PAIRS = [
    (name, rooms[k % len(rooms)])
    for k, name in enumerate(FAMILIES)
    for rooms in [ROOMS.get(name, list(CONSTRAINTS))]
]
PAIRS += [("rest", room) for room in CONSTRAINTS if ("rest", room) not in PAIRS]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "constrained"), PAIRS)
def test_starts_are_strictly_inside(name: str, constrained: str) -> None:
    inequalities = problem(FAMILIES[name], CONSTRAINTS[constrained]).inequalities
    starts = random_starts(inequalities, np.random.default_rng(len(name) % 2), 4)
    assert 1 <= len(starts) <= 4 and (constrained == "tight box" or len(starts) == 4)
    for x in starts:
        assert x.shape == (3, inequalities.basis.count)
        assert inequalities.smallest_margin(x) > 0.0 and inequalities.barrier(x) is not None
        motion = inequalities.basis.motion(x)
        swing = np.subtract(*motion.extremes(1)[::-1])
        assert np.all(swing > 0.0), "every joint moves"


@pytest.mark.parametrize("seed", range(8))
def test_many_seeds_in_a_tight_box(seed: int) -> None:
    """Hardly a random posture is free there: descents find the ways in."""
    inequalities = problem(FAMILIES["rest"], CONSTRAINTS["tight box"], jerk=True).inequalities
    drawn = np.random.default_rng(seed).uniform(
        inequalities.limits.lower, inequalities.limits.upper, (200, 3)
    )
    still = np.zeros_like(drawn)
    values = CONSTRAINTS["tight box"][0].margins(drawn, still, still).values
    assert (values > 0.0).all(axis=1).mean() < 0.1
    starts = random_starts(inequalities, np.random.default_rng(seed), 3)
    assert len(starts) == 3
    assert all(inequalities.smallest_margin(x) > 0.0 for x in starts)
    begins = np.array([inequalities.state(x)[0][0] for x in starts])
    assert np.ptp(begins, axis=0).max() > 1e-3, "not the same place three times"


@pytest.mark.parametrize("constrained", CONSTRAINTS)
def test_the_same_seed_starts_the_same(constrained: str) -> None:
    inequalities = problem(FAMILIES["rest"], CONSTRAINTS[constrained]).inequalities
    one, two, other = (random_starts(inequalities, np.random.default_rng(s), 2) for s in (7, 7, 8))
    for mine, theirs in zip(one, two, strict=True):
        np.testing.assert_array_equal(mine, theirs)
    assert not np.array_equal(one[0], other[0])


@pytest.mark.parametrize("name", ["rest", "rest, from to", "quintic, from", "reaching", "raw"])
def test_widened_motions_use_the_room_there_is(name: str) -> None:
    """Without other constraints every joint goes four fifths of the way to its nearest limit."""
    inequalities = problem(FAMILIES[name]).inequalities
    still = inequalities.basis.still(MIDDLE)
    change = np.random.default_rng(0).standard_normal(still.shape)
    moved = widened(inequalities, still, change)
    assert moved is not None
    furthest = still + (moved - still) / 0.8
    np.testing.assert_allclose(inequalities.limit_margins(furthest).min(axis=1), 0.0, atol=1e-9)
    constrained = problem(FAMILIES[name], [box(0.7)]).inequalities
    smaller = widened(constrained, still, change)
    assert smaller is not None
    ratio = (smaller - still) / (moved - still)
    np.testing.assert_allclose(ratio, ratio[0, 0], rtol=1e-9)
    assert 0.0 < ratio[0, 0] <= 1.0


def test_without_room_there_is_no_motion() -> None:
    shut = problem(FAMILIES["rest"], [box(0.0)]).inequalities
    still = shut.basis.still(MIDDLE)
    assert widened(shut, still, np.ones_like(still)) is None
    none = problem(FAMILIES["rest"], [Nowhere()]).inequalities
    with pytest.raises(DataError) as caught:
        random_starts(none, np.random.default_rng(0), 5)
    assert caught.value.wrong.startswith("no motion about any of 35 random postures keeps all")
    assert "start posture farther from the limits" in caught.value.fix


def test_standing_names_what_is_lacking_worst_first() -> None:
    constraint = box(0.5)
    assert lacks_at([constraint, torques()], MIDDLE) == ()
    posture = MIDDLE + np.array([1.0, 0.5, 0.0])
    found = lacks_at([torques(), constraint, Nowhere()], posture)
    still = np.zeros((1, 3))
    values = constraint.margins(posture[None], still, still).values[0]
    broken = {constraint.labels[k]: float(v) for k, v in enumerate(values) if v <= 0.0}
    assert broken
    assert {label: v for c, label, v in found if c is constraint} == broken
    assert [label for c, label, _ in found if isinstance(c, Nowhere)] == ["worse", "less bad"]
    sizes = [value for _, _, value in found]
    assert sizes == sorted(sizes) and found[0][1] == "worse"


def test_a_free_posture_is_its_own_nearest() -> None:
    here = nearest_free(limits(), [box(0.6)], MIDDLE)
    np.testing.assert_array_equal(here, MIDDLE)
    np.testing.assert_array_equal(nearest_free(limits(), [], MIDDLE + 0.5), MIDDLE + 0.5)


@pytest.mark.parametrize("seed", range(10))
def test_descents_end_free_and_inside_the_limits(seed: int) -> None:
    constraint, bounds = box(0.4), limits()
    random = np.random.default_rng(seed)
    posture = MIDDLE + random.uniform(-0.7, 0.7, 3)
    found = nearest_free(bounds, [constraint, torques()], posture)
    assert np.all(found > bounds.lower) and np.all(found < bounds.upper)
    assert lacks_at([constraint, torques()], found) == ()


def test_what_can_nowhere_be_kept_is_reported() -> None:
    found = nearest_free(limits(), [Nowhere()], MIDDLE)
    assert [(label, value) for _, label, value in lacks_at([Nowhere()], found)] == [
        ("worse", -2.0),
        ("less bad", -1.0),
    ]


def test_postures_are_drawn_near_the_middle_and_then_everywhere() -> None:
    bounds = limits()
    middle, half = 0.5 * (bounds.lower + bounds.upper), 0.5 * (bounds.upper - bounds.lower)
    drawn = list(postures(bounds, [], np.random.default_rng(0), 400))
    reach = np.abs((np.array(drawn) - middle) / half)
    assert reach[:200].max() < 0.4 < 0.9 < reach[200:].max() <= 0.95
    assert reach[:200].max() > 0.39
    constrained = list(postures(bounds, [box(0.3)], np.random.default_rng(0)))
    assert len(constrained) == POSTURE_ATTEMPTS
    free = [place for place in constrained if not lacks_at([box(0.3)], place)]
    assert len(free) > POSTURE_ATTEMPTS // 2
