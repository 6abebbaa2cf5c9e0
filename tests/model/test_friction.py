"""Memoryless friction against its formulas, by hand, and what it refuses."""

from typing import Any

import numpy as np
import pytest

from invented import tree
from moving import geared, torque
from steelyard.base.errors import ModelError
from steelyard.model.equations.inverse_dynamics import JointState
from steelyard.model.laws.friction_over_speed import (
    Coulomb,
    Coupled,
    Cubic,
    DirectionalCoulomb,
    DirectionalStribeck,
    DirectionalViscous,
    Quadratic,
    Root,
    Stribeck,
    Viscous,
)
from steelyard.model.laws.friction_with_memory import Dahl, LuGre, MaxwellSlip
from steelyard.model.laws.register import term_of
from steelyard.model.model import Model
from steelyard.model.terms.term import Term
from steelyard.symbolic.program_and_softening import InputArray, run
from steelyard.symbolic.symbols_and_tracing import slopes_of, symbolic

SPEEDS = np.array([0.0, 0.05, -0.1, 2.0])
TINY, HUGE = 1e-300, 1e6
SMOOTH: dict[str, Any] = {
    "tanh": np.tanh,
    "arctan": lambda x: 2.0 / np.pi * np.arctan(x),
    "logistic": lambda x: 2.0 / (1.0 + np.exp(-x)) - 1.0,
}


def at(term: Term, dq: Any = SPEEDS, values: Any = 1.0) -> np.ndarray:
    """Torque at one sample of speeds."""
    still = np.zeros((4, 1))
    state = np.stack([still, np.reshape(dq, (4, 1)), still])
    return torque(term, geared(), state, values)[:, 0]


def close(found: np.ndarray, expected: Any) -> bool:
    return np.allclose(found, expected, rtol=1e-14, atol=1e-15)


def test_the_threshold_is_a_dead_zone() -> None:
    assert at(Coulomb(threshold=0.1), [0.0, 0.1, 0.11, -5.0]).tolist() == [0.0, 0.0, 1.0, -1.0]
    each = Coulomb(threshold=(0.1, 0.01, 0.2, 3.0))
    assert at(each, [0.2, 0.02, 0.2, -3.1]).tolist() == [1.0, 1.0, 0.0, -1.0]


def test_coulomb_and_viscous_friction_begin_above_one_threshold() -> None:
    # eq. 3 of [Liu]: f_c sign(v) + f_v v from the threshold on, zero below it
    speeds = np.array([0.099, -0.101, 0.3, -2.0])
    printed = np.where(np.abs(speeds) < 0.1, 0.0, 0.7 * np.sign(speeds) + 0.4 * speeds)
    found = at(Coulomb(threshold=0.1), speeds, 0.7) + at(Viscous(threshold=0.1), speeds, 0.4)
    assert close(found, printed)
    each = Viscous(threshold=(0.1, 0.2, 0.4, 3.0))
    assert at(each, speeds).tolist() == [0.0, 0.0, 0.0, 0.0]
    assert at(each, speeds * 2.0).tolist() == [0.198, -0.202, 0.6, -4.0]


@pytest.mark.parametrize(("shape", "law"), SMOOTH.items())
def test_smooth_coulomb_friction(shape: str, law: Any) -> None:
    assert close(at(Coulomb(smoothing=0.05, shape=shape)), law(SPEEDS / 0.05))
    widths = np.array([0.05, 0.1, 0.2, 4.0])
    assert close(at(Coulomb(smoothing=tuple(widths), shape=shape)), law(SPEEDS / widths))


@pytest.mark.parametrize("shape", ["tanh", "arctan", "logistic"])
def test_extreme_speeds_are_within_one(shape: str) -> None:
    """The logistic law by its own formula would overflow here."""
    found = at(Coulomb(smoothing=1e-3, shape=shape), [HUGE, -HUGE, TINY, -TINY])
    assert np.allclose(found, [1.0, -1.0, 0.0, 0.0], atol=1e-8)


def test_powers_of_speed() -> None:
    assert close(at(Quadratic()), [0.0, 0.0025, -0.01, 4.0])
    assert close(at(Cubic()), [0.0, 0.000125, -0.001, 8.0])
    assert close(at(Root()), [0.0, 0.05**0.5, -(0.1**0.5), 2.0**0.5])


def test_the_root_has_a_slope_at_rest() -> None:
    def slope(dq: Any) -> list[Any]:
        columns = Root().columns(tree(), JointState([0.0] * 4, dq, [0.0] * 4))
        return slopes_of([columns[0, 0]], dq)

    program = symbolic(slope, [InputArray("dq", 4)])
    assert np.isfinite(run(program, [np.zeros((4, 1))])).all()


def test_directions_have_parameters_of_their_own() -> None:
    values = np.arange(1.0, 9.0)
    assert at(DirectionalCoulomb(), [3.0, -3.0, 0.0, 2.0], values).tolist() == [1.0, -6.0, 0.0, 4.0]
    assert at(DirectionalViscous(), [3.0, -3.0, 0.0, 2.0], values).tolist() == [
        3.0,
        -18.0,
        0.0,
        8.0,
    ]
    smooth = at(DirectionalCoulomb(smoothing=0.05), SPEEDS, values)
    assert close(smooth, np.tanh(SPEEDS / 0.05) * [1.0, 2.0, 7.0, 4.0])
    names = [p.name for p in DirectionalCoulomb(joints=("tip_joint",)).parameters(tree())]
    assert names == [
        "directional_coulomb_forward.tip_joint",
        "directional_coulomb_backward.tip_joint",
    ]


@pytest.mark.parametrize("exponent", [1, 2])
def test_stribeck_is_the_excess_over_coulomb(exponent: int) -> None:
    sign, fading = np.sign(SPEEDS), np.exp(-(np.abs(SPEEDS / 0.2) ** exponent))
    assert close(at(Stribeck(speed=0.2, exponent=exponent)), sign * fading)
    smooth = np.tanh(SPEEDS / 0.05)
    assert close(at(Stribeck(speed=0.2, exponent=exponent, smoothing=0.05)), smooth * fading)
    each = np.array([0.1, 0.2, 0.3, 4.0])
    found = at(Stribeck(speed=tuple(each), exponent=exponent))
    assert close(found, sign * np.exp(-(np.abs(SPEEDS / each) ** exponent)))


@pytest.mark.parametrize("shape", SMOOTH)
def test_stribeck_turns_by_any_shape(shape: str) -> None:
    """Beside `coulomb` and `viscous` with `arctan`: eqs 5 and 6 of p3."""
    smooth, fading = SMOOTH[shape](SPEEDS / 0.05), np.exp(-np.abs(SPEEDS / 0.2))
    given: dict[str, Any] = {"smoothing": 0.05, "shape": shape}
    assert close(at(Stribeck(speed=0.2, **given)), smooth * fading)
    values = np.arange(1.0, 9.0)
    sides = np.where(SPEEDS >= 0.0, values[:4], values[4:])
    assert close(at(DirectionalCoulomb(**given), SPEEDS, values), smooth * sides)
    stribeck = DirectionalStribeck(speed=0.2, **given)
    assert close(at(stribeck, SPEEDS, values), smooth * fading * sides)


def test_a_motor_behind_a_differential_brakes_both_joints() -> None:
    """Motor 4 turns with 60 (q3 + q4): its speed, and 60 times its effort on both joints."""
    dq = [0.0, 0.0, 1.0, -0.5]
    assert close(at(Viscous(motors=("motor4",)), dq), [0.0, 0.0, 60.0 * 30.0, 60.0 * 30.0])
    assert close(at(Coulomb(motors=("motor4",)), dq), [0.0, 0.0, 60.0, 60.0])
    wrist = (("wrist", (("left_joint", 1.0), ("tip_joint", 1.0))),)
    assert close(at(Quadratic(along=wrist), dq), [0.0, 0.0, 0.25, 0.25])


def test_coupled_friction_loads_another_joint() -> None:
    pairs = (("trunk_joint", "slider_joint"), ("motor1", "tip_joint"), ("tip_joint", "trunk_joint"))
    dq, values = [0.1, 0.0, 0.0, -2.0], [1.0, 10.0, 100.0]
    found = at(Coupled(pairs=pairs), dq, values)
    assert close(found, [-200.0, 0.1, 0.0, 50.0])
    signs = Coupled(pairs=pairs, kind="coulomb")
    assert close(at(signs, dq, values), [-100.0, 1.0, 0.0, 10.0])
    smooth = Coupled(pairs=pairs, kind="coulomb", smoothing=(0.1, 5.0, 4.0))
    expected = np.tanh([1.0, 1.0, -0.5]) * values
    assert close(at(smooth, dq, values), [expected[2], expected[0], 0.0, expected[1]])
    names = [(p.name, p.unit, p.lower) for p in signs.parameters(geared())]
    assert names[0] == ("coupled_coulomb.trunk_joint>slider_joint", "N", -np.inf)
    units = [p.unit for p in Coupled(pairs=pairs).parameters(geared())]
    assert units == ["N/(rad/s)", "N m/(rad/s)", "N m/(rad/s)"]


@pytest.mark.parametrize(
    "pairs",
    [
        [{"from": "trunk_joint", "to": "tip_joint"}],
        {"from": "trunk_joint", "to": "tip_joint"},
        {"trunk_joint": "tip_joint"},
        [["trunk_joint", "tip_joint"]],
    ],
)
def test_pairs_have_several_spellings(pairs: Any) -> None:
    written = term_of({"law": "coupled", "pairs": pairs}, "here")
    assert written == Coupled(pairs=((("from", "trunk_joint"), ("to", "tip_joint")),))


def test_both_couplings_of_a_pair_fit_into_one_model() -> None:
    pair = ({"from": "trunk_joint", "to": "tip_joint"},)
    terms = [Coupled(pairs=pair, kind=kind) for kind in ("viscous", "coulomb")]
    assert len(Model(tree(), tuple(terms)).parameters) == 2


NOT_ONE_PER_COORDINATE: list[Term] = [
    Coulomb(smoothing=(0.1, 0.2)),
    Coulomb(threshold=(0.1, 0.2, 0.3)),
    Viscous(threshold=(0.1, 0.2, 0.3)),
    Coulomb(smoothing=(0.1, 0.2, 0.0, 0.1)),
    DirectionalCoulomb(smoothing=(0.1,)),
    Stribeck(speed=(0.1, 0.2)),
    Stribeck(smoothing=(0.1, 0.2)),
]


@pytest.mark.parametrize("term", NOT_ONE_PER_COORDINATE, ids=str)
def test_lists_fit_the_coordinates(term: Term) -> None:
    with pytest.raises(ModelError, match=f"term '{term.law}' has .* for 4 coordinates") as caught:
        at(term)
    assert "one per coordinate" in caught.value.fix


def test_lists_fit_the_pairs() -> None:
    pair = (("trunk_joint", "tip_joint"),)
    with pytest.raises(ModelError, match="for 1 coordinates"):
        at(Coupled(pairs=pair, kind="coulomb", smoothing=(0.1, 0.2)))


@pytest.mark.parametrize(
    ("description", "words"),
    [
        ("coulom", "did you mean 'coulomb'"),
        ({"law": "viscous", "speed": 3}, "does not understand 'speed'"),
        ({"law": "coulomb", "threshold": 0.1, "smoothing": 0.1}, "give one of the two"),
        ({"law": "coulomb", "threshold": -0.1}, "threshold = -0.1"),
        ({"law": "viscous", "threshold": -0.1}, "threshold = -0.1"),
        ({"law": "coulomb", "smoothing": [0.1, -0.1]}, "smoothing = -0.1"),
        ({"law": "coulomb", "smoothing": 0.1, "shape": "sine"}, "'tanh', 'arctan', 'logistic'"),
        ({"law": "directional_coulomb", "smoothing": -1.0}, "smoothing = -1.0"),
        ({"law": "coulomb", "shape": "arctan"}, "give `smoothing`"),
        ({"law": "directional_coulomb", "shape": "arctan"}, "give `smoothing`"),
        ({"law": "stribeck", "shape": "logistic"}, "give `smoothing`"),
        ({"law": "stribeck", "smoothing": 0.1, "shape": "sine"}, "'tanh', 'arctan', 'logistic'"),
        ({"law": "stribeck", "exponent": 3}, "exponent = 3"),
        ({"law": "stribeck", "speed": -0.1}, "speed = -0.1"),
        ({"law": "stribeck", "speed": "fast"}, "speed = 'fast'"),
        ({"law": "stribeck", "speed": float("nan")}, "give 'speed' as a positive number"),
        ({"law": "coupled"}, "coupled friction with no pairs"),
        ({"law": "coupled", "pairs": [{"from": "a"}]}, "two joints or motors per pair"),
        ({"law": "coupled", "pairs": [["a", "a"]]}, "two joints or motors per pair"),
        ({"law": "coupled", "pairs": ["a", "b"]}, "two joints or motors per pair"),
        ({"law": "coupled", "pairs": [["a", "b"]], "kind": "dry"}, "'viscous', 'coulomb'"),
        ({"law": "coupled", "pairs": [["a", "b"]], "smoothing": 0.1}, "has no smoothing"),
        ({"law": "dahl", "length": -1.0}, "length = -1.0"),
        ({"law": "maxwell_slip", "lengths": [0.1, -1.0]}, "one length above zero per element"),
        ({"law": "maxwell_slip", "lengths": []}, "one length above zero per element"),
        ({"law": "lugre", "breakaway": 0.9}, "at least 1"),
        ({"law": "lugre", "speed": [-0.1]}, "speed = -0.1"),
        ({"law": "load_dependent", "length": -0.1}, "length = -0.1"),
    ],
)
def test_wrong_descriptions_are_explained(description: Any, words: str) -> None:
    with pytest.raises(ModelError, match=words) as caught:
        term_of(description, "robot.toml, line 7, [model] terms[2]")
    assert caught.value.where == "robot.toml, line 7, [model] terms[2]"


@pytest.mark.parametrize(
    "term",
    [Viscous(joints=("elbow",)), Coupled(pairs=(("trunk_joint", "elbow"),))],
    ids=str,
)
def test_unknown_joints_are_named(term: Term) -> None:
    with pytest.raises(ModelError, match="acts on joint 'elbow'"):
        term.parameters(tree())


@pytest.mark.parametrize(
    "along",
    [
        "wrist",
        {"wrist": "tip_joint"},
        {"wrist": {"tip_joint": "much"}},
        {"wrist": 1.0},
    ],
)
def test_coordinates_of_a_terms_own_have_a_form(along: Any) -> None:
    term = term_of({"law": "viscous", "along": along}, "here")
    with pytest.raises(ModelError, match="a term acts along") as caught:
        term.parameters(tree())
    assert "along = {wrist = {joint_5 = 1.0, joint_6 = 1.0}}" in caught.value.fix


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        ({"tip_joint": 0.0}, "does not move: all its coefficients are zero"),
        ({"tip_joint": 1.0, "trunk_joint": 1e200}, "coefficient of 1e\\+200"),
        ({"tip_joint": -1e-300}, "coefficient of -1e-300"),
        ({"tip_joint": 2e6}, "coefficient of 2e\\+06"),
        ({"tip_joint": 1.0, "slider_joint": 1.0}, "mixes kinds of joints"),
        ({}, "has no joint"),
    ],
)
def test_coordinates_of_a_terms_own_move(parts: dict[str, float], words: str) -> None:
    term = term_of({"law": "quadratic", "along": {"wrist": parts}}, "here")
    with pytest.raises(ModelError, match=words) as caught:
        term.parameters(tree())
    assert "sizes from 1e-06 to 1e+06" in caught.value.fix


@pytest.mark.parametrize("size", [1e-6, -1e6])
def test_coefficients_may_be_small_and_large(size: float) -> None:
    term = term_of({"law": "viscous", "along": {"wrist": {"tip_joint": size}}}, "here")
    assert [p.name for p in term.parameters(tree())] == ["viscous.wrist"]


def test_one_name_needs_no_list() -> None:
    assert at(Viscous(joints="tip_joint")).tolist() == at(Viscous(joints=("tip_joint",))).tolist()
    names = [p.name for p in Viscous(motors="motor3").parameters(geared())]
    assert names == ["viscous.motor3"]


@pytest.mark.parametrize("term", [Dahl(length=(0.1,)), LuGre(speed=(0.1,))])
def test_lists_of_memory_fit_the_coordinates(term: Term) -> None:
    with pytest.raises(ModelError, match="for 4 coordinates"):
        at(term)


def test_maxwell_slip_has_a_parameter_per_element() -> None:
    names = [
        p.name for p in MaxwellSlip(lengths=(0.1, 0.2), joints=("tip_joint",)).parameters(tree())
    ]
    assert names == ["maxwell_slip1.tip_joint", "maxwell_slip2.tip_joint"]
