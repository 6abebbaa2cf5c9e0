"""Laws that every term keeps; a new term joins by its line in the register."""

import json
from collections.abc import Iterable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from law_cases import CASES, LawCase, name_of
from moving import channels, cycles, geared, torque
from steelyard.base.arrays import Parameters
from steelyard.base.errors import ModelError
from steelyard.base.motion import Motion
from steelyard.model.equations.inverse_dynamics import JointState
from steelyard.model.laws.laws_without_friction import RigidBody
from steelyard.model.laws.register import TERMS, description_of, term_of
from steelyard.model.model import Model
from steelyard.model.terms.axes_and_fields import Axis
from steelyard.model.terms.term import ActsOnAxes, StatefulTerm, Term
from steelyard.robot.robot import JointKind
from steelyard.symbolic import program_and_softening as numpy_backend
from steelyard.symbolic.program_and_softening import InputArray
from steelyard.symbolic.symbols_and_tracing import symbolic

ROBOT = geared()
ON: dict[LawCase, Term] = {case: case.on(ROBOT) for case in CASES}
REMEMBERING = [case for case in CASES if isinstance(ON[case], StatefulTerm)]
STATIC = [case for case in CASES if case not in REMEMBERING and case.law != "rigid_body"]
SPEED_LAWS = [case for case in STATIC if case.energy == "taken"]


def each(cases: Iterable[LawCase]) -> pytest.MarkDecorator:
    """A test for every case on the robot."""
    return pytest.mark.parametrize("term", [ON[case] for case in cases], ids=name_of)


def both(cases: Iterable[LawCase]) -> pytest.MarkDecorator:
    """The same, with what is true of the case."""
    return pytest.mark.parametrize("case", list(cases), ids=name_of)


def some_speeds(count: int = 400) -> np.ndarray:
    """Speeds of four joints `(4, count)`: anything up to 20, and the edges of laws beside it."""
    rng = np.random.default_rng(0)
    edges = rng.choice([0.0, 0.1, -0.1, 1e-9, 20.0, -20.0], (4, count))
    return np.where(rng.random((4, count)) < 0.4, edges, rng.uniform(-20.0, 20.0, (4, count)))


SPEEDS = some_speeds()


def at_speeds(term: Term, dq: Any, values: Any = 1.0) -> np.ndarray:
    """Torque of a memoryless term over `(4, N)` speeds, positions and accelerations at zero."""
    speeds = np.array(dq, dtype=float).reshape(4, -1)
    still = np.zeros_like(speeds)
    return torque(term, ROBOT, np.stack([still, speeds, still]), values)


def drawn(term: Term, seed: int = 0) -> np.ndarray:
    """Values of the parameters that their bounds allow."""
    return np.random.default_rng(seed).uniform(0.5, 2.0, len(term.parameters(ROBOT)))


def test_every_term_of_the_register_is_tested_here() -> None:
    assert {case.law for case in CASES} == set(TERMS)


@each(CASES)
def test_columns_fit_parameters(term: Term) -> None:
    parameters = term.parameters(ROBOT)
    places: list[tuple[int, int]] = []
    count = Model(ROBOT, (term,)).n_channels

    def build(q: Any, dq: Any, ddq: Any, known: Any) -> list[Any]:
        columns = term.columns(ROBOT, JointState(q, dq, ddq, known))
        places.extend(columns)
        return list(columns.values())

    inputs = [InputArray(name, ROBOT.n) for name in ("q", "dq", "ddq")]
    program = symbolic(build, [*inputs, InputArray("channels", count)])
    assert {column for _, column in places} <= set(range(len(parameters)))
    assert all(0 <= row < ROBOT.n for row, _ in places)
    assert len({p.name for p in parameters}) == len(parameters)
    assert all(p.unit and " " not in p.name for p in parameters)
    if isinstance(term, RigidBody):
        return  # symbols only; tests/kernel compares it with Pinocchio
    rng = np.random.default_rng(0)
    state = rng.normal(size=(3, ROBOT.n, 17)) * 0.2
    state[1, :, :3] = 0.0
    known = rng.normal(size=(count, 17))
    traced = numpy_backend.run(program, [*state, known])
    arrays = term.columns(ROBOT, JointState(*(list(x) for x in state), list(known)))
    for number, place in enumerate(places):
        expected = np.broadcast_to(arrays[place], (17,))
        assert np.allclose(traced[number], expected, rtol=1e-13, atol=1e-15)


@each(CASES)
def test_description_round_trips(term: Term) -> None:
    assert term_of(json.loads(json.dumps(description_of(term))), "here") == term


@pytest.mark.slow
@both(CASES)
def test_energy_over_a_closed_motion(case: LawCase) -> None:
    """No friction law gives energy; springs, gravity and inertia give back what they took."""
    per_cycle, term = 2000, ON[case]
    state = cycles(ROBOT.n, 2, per_cycle)
    model = Model(ROBOT, (term,))
    values = model.at(Parameters(model.names, model.units, drawn(term)))
    motion = Motion(np.arange(state.shape[2]), *(x.T for x in state))
    found = values.torque(motion).T
    if not isinstance(term, RigidBody):
        by_arrays = torque(term, ROBOT, state, drawn(term))
        assert np.allclose(found, by_arrays, rtol=1e-11, atol=1e-11 * np.abs(found).max())
    power = np.sum(found * state[1], axis=0)[per_cycle:]
    through = np.abs(found * state[1])[:, per_cycle:].sum()
    if case.energy == "kept":
        assert abs(power.sum()) < 1e-9 * through
    elif case.energy == "taken":
        assert power.sum() > 0.05 * through


@each(SPEED_LAWS)
def test_friction_never_gives_energy(term: Term) -> None:
    effort = at_speeds(term, SPEEDS, drawn(term))
    assert np.all(np.sum(effort * SPEEDS, axis=0) >= -1e-12 * np.abs(effort).max(axis=0))
    assert np.all(np.array([p.lower for p in term.parameters(ROBOT)]) == 0.0)


@each(case for case in STATIC if case.odd)
def test_both_directions_are_alike(term: Term) -> None:
    forward, backward = (at_speeds(term, x, drawn(term)) for x in (SPEEDS, -SPEEDS))
    assert np.allclose(backward, -forward, rtol=1e-13, atol=1e-12)


@each(case for case in REMEMBERING if case.odd)
def test_memory_of_both_directions_is_alike(term: Term) -> None:
    state = cycles(ROBOT.n)
    forward, backward = (torque(term, ROBOT, x, drawn(term)) for x in (state, -state))
    assert np.abs(backward + forward).max() < 1e-12 * np.abs(forward).max()


@both(STATIC)
def test_continuity_is_as_claimed(case: LawCase) -> None:
    step, term = 1e-9, ON[case]
    edges = [1e-6, -1e-6, 0.1, -0.1, 0.1 / 56.0]  # the last: motor 3 at 0.1 rad/s
    grid = np.concatenate([np.linspace(-0.5, 0.5, 401), edges])
    speeds = np.tile(grid, (4, 1)) * np.array([[1.0], [-1.0], [0.7], [0.3]])
    apart = np.abs(at_speeds(term, speeds + step) - at_speeds(term, speeds - step)).max()
    assert apart < 1e-2 if case.continuous else apart > 0.05


@each(REMEMBERING)
def test_memory_is_continuous_along_the_position(term: Term) -> None:
    state = cycles(ROBOT.n, 1, 40_000)
    steps = np.abs(np.diff(channels(term, ROBOT, state), axis=1)).max(axis=1)
    coarse = np.abs(np.diff(channels(term, ROBOT, state[:, :, ::4]), axis=1)).max(axis=1)
    assert np.all(steps < 0.5 * coarse)


@each(REMEMBERING)
@settings(max_examples=15, deadline=None)
@given(cuts=st.lists(st.integers(0, 150), min_size=1, max_size=6))
def test_any_split_into_blocks_gives_the_same(term: Term, cuts: list[int]) -> None:
    state = cycles(ROBOT.n, 1, 150)
    whole = channels(term, ROBOT, state)
    parts = channels(term, ROBOT, state, tuple(sorted({c for c in cuts if 0 < c < 150})))
    assert np.abs(parts - whole).max() < 1e-12 * np.abs(whole).max()


@each(REMEMBERING)
def test_a_warm_start_is_forgotten(term: Term) -> None:
    """After the travel that `warm_up` states, what was before has decayed to exp(-3)."""
    state = cycles(ROBOT.n, 1, 4000)
    model = Model(ROBOT, (term,))
    late = state[:, :, 900:]
    scan = model.scan()
    known, warm = scan(*late), scan.warm
    other = channels(term, ROBOT, state)[:, 900:]
    sample = int(np.argmax(np.all(warm, axis=0)))
    assert np.all(warm[:, sample]) and sample < 3000
    size = np.abs(other).max(axis=1)
    assert np.all(np.abs(known - other)[:, sample] <= 2.0 * 2.0 * np.exp(-3.0) * size + 1e-12)


AXIAL = pytest.mark.parametrize("law", [n for n in TERMS if issubclass(TERMS[n], ActsOnAxes)])


@AXIAL
@pytest.mark.parametrize(
    ("key", "name"), [("joints", ROBOT.joint_names[1]), ("motors", ROBOT.transmission.motors[0])]
)
def test_one_name_is_a_list_of_one(law: str, key: str, name: str) -> None:
    one, listed = TERMS[law](**{key: name}), TERMS[law](**{key: (name,)})
    assert one.parameters(ROBOT) == listed.parameters(ROBOT)
    assert one.axes(ROBOT) == listed.axes(ROBOT)
    assert [axis.name for axis in one.axes(ROBOT)] == [name]
    with pytest.raises(ModelError, match="'gripper'"):
        TERMS[law](**{key: "gripper"}).axes(ROBOT)


@AXIAL
def test_units_follow_the_joint(law: str) -> None:
    stated = [case.units for case in CASES if case.law == law and case.units is not None]
    assert len(stated) == 1, f"one case of {law} in law_cases.py states its units"
    (units,) = stated
    assert tuple(p.unit for p in term_of(law, "here").parameters(ROBOT)[:2]) == units


def test_every_law_is_recovered_by_a_proof() -> None:
    recovered = {case.law for case in CASES if case.simulated == "recovered"}
    assert recovered == set(TERMS) - {"rigid_body"}


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
def test_units_of_an_axis(kind: JointKind) -> None:
    axis = Axis("a", (1.0,), kind)
    assert (axis.speed_unit, axis.unit("{force}/x")) == {
        "revolute": ("rad/s", "N m/x"),
        "prismatic": ("m/s", "N/x"),
    }[kind]
