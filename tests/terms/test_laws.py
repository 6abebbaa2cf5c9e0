"""Laws that every term keeps; a new term joins by its line in the register."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from invented import tree
from steelyard.errors import ModelError
from steelyard.kernel import numpy_backend
from steelyard.kernel.dynamics import JointState
from steelyard.kernel.program import Array
from steelyard.kernel.trace import symbolic
from steelyard.terms.coulomb import Coulomb
from steelyard.terms.offset import Offset
from steelyard.terms.register import TERMS, description_of, term_of
from steelyard.terms.rigid_body import RigidBody
from steelyard.terms.rotor_inertia import RotorInertia
from steelyard.terms.term import Term
from steelyard.terms.viscous import Viscous

ROBOT = tree()
CHOSEN = ("slider_joint", "tip_joint")
CASES: list[Term] = [
    RigidBody(),
    RotorInertia(),
    RotorInertia(joints=CHOSEN),
    Coulomb(),
    Coulomb(threshold=0.1),
    Coulomb(smoothing=0.05, joints=CHOSEN),
    Viscous(),
    Viscous(joints=CHOSEN),
    Offset(),
    Offset(joints=CHOSEN),
]
DISSIPATIVE: list[Term] = [t for t in CASES if isinstance(t, Coulomb | Viscous)]
SPEEDS = st.lists(
    st.one_of(st.sampled_from([0.0, 0.1, -0.1, 1e-9]), st.floats(-20.0, 20.0)),
    min_size=4,
    max_size=4,
)


def ids(term: Term) -> str:
    return str(description_of(term))


def torque(term: Term, dq: Any, values: float = 1.0) -> np.ndarray:
    """Torque of a term over arrays, with all parameters alike."""
    q = np.zeros((4, 1))
    speeds = np.array(dq, dtype=float).reshape(4, 1)
    result = np.zeros((4, 1))
    for (row, _), value in term.columns(ROBOT, JointState(q, speeds, q)).items():
        result[row] += values * value
    return result[:, 0]


def test_every_term_of_the_register_is_tested_here() -> None:
    assert {type(term) for term in CASES} == set(TERMS.values())


@pytest.mark.parametrize("term", CASES, ids=ids)
def test_columns_fit_parameters(term: Term) -> None:
    parameters = term.parameters(ROBOT)
    places: list[tuple[int, int]] = []

    def build(q: Any, dq: Any, ddq: Any) -> list[Any]:
        columns = term.columns(ROBOT, JointState(q, dq, ddq))
        places.extend(columns)
        return list(columns.values())

    program = symbolic(build, [Array(name, ROBOT.n) for name in ("q", "dq", "ddq")])
    assert {column for _, column in places} <= set(range(len(parameters)))
    assert all(0 <= row < ROBOT.n for row, _ in places)
    assert len({p.name for p in parameters}) == len(parameters)
    assert all(p.unit for p in parameters)
    if isinstance(term, RigidBody):
        return  # symbols only; tests/kernel compares it with Pinocchio
    state = np.random.default_rng(0).normal(size=(3, ROBOT.n, 17)) * 0.2
    state[1, :, :3] = 0.0
    traced = numpy_backend.run(program, list(state))
    arrays = term.columns(ROBOT, JointState(*state))
    for number, place in enumerate(places):
        assert np.array_equal(traced[number], np.broadcast_to(arrays[place], (17,)))


@pytest.mark.parametrize("term", CASES, ids=ids)
def test_description_round_trips(term: Term) -> None:
    assert term_of(description_of(term), "here") == term


@pytest.mark.parametrize("term", DISSIPATIVE, ids=ids)
@settings(max_examples=40, deadline=None)
@given(dq=SPEEDS)
def test_friction_never_gives_energy_and_is_odd(term: Term, dq: list[float]) -> None:
    forward = torque(term, dq)
    assert np.all(forward * np.array(dq) >= 0.0)
    assert np.allclose(torque(term, [-x for x in dq]), -forward, rtol=0, atol=1e-12)
    assert np.all(np.array([p.lower for p in term.parameters(ROBOT)]) == 0.0)


def test_the_threshold_is_a_dead_zone() -> None:
    assert torque(Coulomb(threshold=0.1), [0.0, 0.1, 0.11, -5.0]).tolist() == [0.0, 0.0, 1.0, -1.0]


def test_the_smooth_law_is_tanh() -> None:
    got = torque(Coulomb(smoothing=0.05), [0.0, 0.05, -0.1, 1.0])
    assert np.allclose(got, np.tanh([0.0, 1.0, -2.0, 20.0]), atol=1e-15)


def test_units_follow_the_joint() -> None:
    assert [p.unit for p in Viscous().parameters(ROBOT)][:2] == ["N m s/rad", "N s/m"]
    assert [p.unit for p in RotorInertia().parameters(ROBOT)][:2] == ["kg m²", "kg"]


@pytest.mark.parametrize(
    ("description", "words"),
    [
        ("coulom", "did you mean 'coulomb'"),
        ({"law": "viscous", "speed": 3}, "does not understand 'speed'"),
        ({"law": "coulomb", "threshold": 0.1, "smoothing": 0.1}, "give one of the two"),
    ],
)
def test_wrong_descriptions_are_explained(description: Any, words: str) -> None:
    with pytest.raises(ModelError, match=words):
        term_of(description, "robot.toml, [model] terms")


def test_unknown_joints_are_named() -> None:
    with pytest.raises(ModelError, match="acts on joint 'elbow'"):
        Viscous(joints=("elbow",)).parameters(ROBOT)
