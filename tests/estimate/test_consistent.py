"""The consistent estimate: validity, optimality, weights of the prior, constraints, failures."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from at_prior import at_prior
from cvxpy_oracle import cvxpy_problem, solved
from invented import tree
from steelyard.base.errors import DataError
from steelyard.estimate.consistent.conic_solver_and_scaled_parameters import (
    Entropic,
    Form,
    Free,
    Pullback,
)
from steelyard.estimate.consistent.convex_estimator import Consistent
from steelyard.estimate.estimate import Estimate
from steelyard.estimate.information.base_parameters_and_regressor import base_regressor
from steelyard.estimate.information.filter_and_gram import Accumulator, Stretch
from steelyard.estimate.information.information import Information, Signature, Window
from steelyard.estimate.least_squares.weighted_robust_and_whitened import (
    OrdinaryLeastSquares,
    WeightedLeastSquares,
    whitened,
)
from steelyard.estimate.prior.body_priors import Knowledge, Row, default_knowledge
from steelyard.model.model import Model
from steelyard.robot.inertia_and_placement import INERTIAL_NAMES, Inertia

MODEL = Model(tree())
REGRESSOR = base_regressor(MODEL)
FORMS: list[Form] = [Entropic(), Pullback(), Free()]
TRUTH = {p.name: p.prior if p.prior is not None else 0.4 for p in MODEL.parameters}


def information_of(
    noise: float,
    *,
    seed: int = 0,
    count: int = 600,
    still: int | None = None,
    truth: Mapping[str, float] = TRUTH,
) -> Information:
    """What a random motion of the invented arm says; its truth is its model file's."""
    rng = np.random.default_rng(seed)
    q, dq, ddq = rng.normal(size=(3, 4, count))
    if still is not None:
        q[still], dq[still], ddq[still] = 0.3, 0.0, 0.0
    values = REGRESSOR.base.base_values([truth[name] for name in MODEL.names])
    effort = REGRESSOR.dense(q, dq, ddq) @ values
    effort = effort + noise * np.sqrt(np.square(effort).mean(axis=1))[:, None] * rng.normal(
        size=effort.shape
    )
    sums = Accumulator(REGRESSOR)(Stretch(q, dq, ddq, effort))
    signature = Signature(MODEL.fingerprint, REGRESSOR.layout.columns, ("Nm",) * 4, "none")
    window = (Window("run", 0.0, 1.0),)
    parts = (sums.grams[None], sums.absolute[None], sums.counts[None])
    return Information(REGRESSOR.layout, signature, window, *parts)


def known(**changes: object) -> Knowledge:
    return replace(default_knowledge(MODEL), **changes)


def heavier(factor: float) -> Knowledge:
    """Priors that are all off by a factor."""
    knowledge = default_knowledge(MODEL)
    priors = [Inertia.from_ten(factor * p.ten) for p in knowledge.priors if p is not None]
    return replace(knowledge, priors=tuple(priors))


def bodies(estimate: Estimate) -> list[Inertia]:
    assert estimate.standard is not None
    values = estimate.standard.parameters
    return [
        Inertia.from_ten([values[f"{n}.{b.name}"] for n in INERTIAL_NAMES])
        for b in MODEL.robot.bodies
    ]


@pytest.mark.parametrize("form", FORMS, ids=lambda f: f.name)
def test_every_body_can_exist_and_base_parameters_are_its_own(form: Form) -> None:
    estimate = Consistent(REGRESSOR.base, heavier(1.7), form)(information_of(0.3, count=60))
    assert all(np.linalg.eigvalsh(body.pseudo)[0] > 0.0 for body in bodies(estimate))
    assert estimate.standard is not None
    base = dict(
        zip(
            REGRESSOR.base.base_names,
            REGRESSOR.base.base_values(estimate.standard.parameters.values),
            strict=True,
        )
    )
    mine = estimate.parameters.as_dict()
    assert mine == pytest.approx({name: base[name] for name in mine})
    friction = [v for n, v in mine.items() if n.startswith(("coulomb", "viscous"))]
    assert min(friction) > -1e-9


@pytest.mark.slow
def test_a_true_prior_and_clean_data_give_the_truth() -> None:
    estimate = Consistent(REGRESSOR.base, known())(information_of(1e-9))
    assert estimate.standard is not None
    error = [estimate.standard.parameters[name] - TRUTH[name] for name in MODEL.names]
    seen = [n.startswith(("coulomb", "viscous", "offset")) for n in MODEL.names]
    assert np.abs(np.array(error)[seen]).max() < 1e-5


@pytest.mark.parametrize("form", [Entropic(), Pullback()], ids=lambda f: f.name)
def test_the_optimum_is_stationary(form: Form) -> None:
    consistent = Consistent(REGRESSOR.base, heavier(1.3), form)
    program = consistent.program(whitened(information_of(0.05)))
    u = consistent.solve(program, 5.0)
    best = program.cost(u, 5.0)
    rng = np.random.default_rng(0)
    size = 10 * len(MODEL.robot.bodies)
    for _ in range(40):
        step = np.zeros(len(u))
        step[:size] = 1e-4 * rng.normal(size=size)
        around = 0.5 * (program.cost(u + step, 5.0) + program.cost(u - step, 5.0))
        slope = program.cost(u + step, 5.0) - program.cost(u - step, 5.0)
        assert around > best
        assert abs(slope) < 1e-5 * max(1.0, best)


def test_the_optimum_is_that_of_cvxpy() -> None:
    consistent = Consistent(REGRESSOR.base, heavier(1.3))
    data = whitened(information_of(0.05))
    program = consistent.program(data)
    problem, squares = cvxpy_problem(data, consistent, 5.0)
    solved(problem, 1e-12)
    mine = program.unknowns.chi_squared(consistent.solve(program, 5.0))
    assert 0.5 * mine == pytest.approx(0.5 * float(squares.value), abs=1e-6)


@pytest.mark.parametrize("form", [Entropic(), Pullback()], ids=lambda f: f.name)
def test_precision_is_the_second_derivative_of_the_penalty(form: Form) -> None:
    program = Consistent(REGRESSOR.base, known(), form).program(whitened(information_of(0.05)))
    rng = np.random.default_rng(1)
    u = at_prior(program.unknowns)
    u[:10] += 0.05 * rng.normal(size=10)
    known_ = program.unknowns
    bare = replace(known_, matrix=0.0 * known_.matrix, vector=0.0 * known_.vector)
    free = replace(program, unknowns=bare)
    step = np.zeros(len(u))
    step[:10] = rng.normal(size=10)
    h = 1e-4
    parts = [free.cost(u + s * h * step, 3.0) for s in (-1.0, 0.0, 1.0)]
    numeric = (parts[0] - 2.0 * parts[1] + parts[2]) / h**2
    assert step @ program.precision(u, 3.0) @ step == pytest.approx(numeric, rel=1e-4)


def test_a_stated_uncertainty_is_taken_and_reported() -> None:
    estimate = Consistent(REGRESSOR.base, known(uncertainty=0.2))(information_of(0.05))
    assert "prior uncertainty of link inertias 20 % (as stated)" in estimate.notes[-1]
    found = Consistent(REGRESSOR.base, known())(information_of(0.05))
    assert "estimated from the data in" in found.notes[-1]


def test_a_wide_prior_leaves_the_intervals_of_least_squares() -> None:
    """Base parameters are sums of standard ones that the data leave unknown."""
    information = information_of(0.01)
    found = Consistent(REGRESSOR.base, known(uncertainty=1e4))(information)
    plain = WeightedLeastSquares()(information)
    expected = dict(zip(plain.parameters.names, plain.std, strict=True))
    np.testing.assert_allclose(found.std, [expected[n] for n in found.parameters.names], rtol=1e-5)


def test_a_wrong_prior_is_given_less_weight() -> None:
    def weight(knowledge: Knowledge) -> float:
        consistent = Consistent(REGRESSOR.base, knowledge)
        data = whitened(information_of(0.05))
        return consistent.weighed(data, consistent.program(data)).gamma

    assert weight(known()) > 10.0 * weight(heavier(3.0))


def test_poor_data_stay_near_the_prior_and_say_so() -> None:
    estimate = Consistent(REGRESSOR.base, known())(information_of(0.05, still=3))
    assert estimate.standard is not None
    learned = dict(zip(estimate.standard.parameters.names, estimate.standard.learned, strict=True))
    assert "viscous.tip_joint" in [blind.name for blind in estimate.blind]
    assert estimate.standard.parameters["viscous.tip_joint"] == 0.0
    assert learned["viscous.tip_joint"] < 1e-9
    assert learned["viscous.trunk_joint"] > 0.99
    std = dict(zip(estimate.standard.parameters.names, estimate.standard.std, strict=True))
    assert std["viscous.tip_joint"] > 10.0  # nothing tells it
    assert std["viscous.trunk_joint"] < 0.1


def of(estimate: Estimate) -> dict[str, float]:
    assert estimate.standard is not None
    return estimate.standard.parameters.as_dict()


def test_prior_constraints_about_what_the_data_do_not_see_hold_and_harm_nothing() -> None:
    information = information_of(0.05, still=3)
    tied = Row("twin", {"viscous.tip_joint": 1.0, "viscous.trunk_joint": -0.5}, 0.0, 0.0)
    least = Row("least", {"coulomb.tip_joint": 1.0}, lower=0.2)
    given = Row("given", {"rotor_inertia.tip_joint": 1.0}, lower=3.0, upper=3.0)
    with_them = Consistent(REGRESSOR.base, known(rows=(tied, least, given)))(information)
    without = of(Consistent(REGRESSOR.base, known())(information))
    values = of(with_them)
    assert values["viscous.trunk_joint"] == pytest.approx(without["viscous.trunk_joint"], rel=1e-4)
    assert values["viscous.tip_joint"] == pytest.approx(0.5 * values["viscous.trunk_joint"])
    assert values["coulomb.tip_joint"] == 0.2
    assert values["rotor_inertia.tip_joint"] == pytest.approx(3.0)
    assert not any("contradict" in note for note in with_them.notes)


def test_what_a_bound_holds_is_at_it_and_reported() -> None:
    rows = (Row("smooth trunk (file, line 7)", {"viscous.trunk_joint": 1.0}, upper=0.1),)
    estimate = Consistent(REGRESSOR.base, known(rows=rows))(information_of(0.05))
    assert estimate.at_bound == ("viscous.trunk_joint",)
    assert of(estimate)["viscous.trunk_joint"] == 0.1
    (note,) = (note for note in estimate.notes if "contradict" in note)
    assert "smooth trunk (file, line 7): 0.3" in note and "without it" in note
    assert not any("physically consistent bodies" in note for note in estimate.notes)
    free = Consistent(REGRESSOR.base, known())(information_of(0.05))
    assert free.at_bound == () and not any("contradict" in note for note in free.notes)


def test_a_prior_that_is_stated_too_sure_is_called_that() -> None:
    knowledge = replace(heavier(2.0), uncertainty=0.01)
    estimate = Consistent(REGRESSOR.base, knowledge)(information_of(0.01))
    assert any("a prior with this uncertainty" in note for note in estimate.notes)


def test_prior_constraints_of_absurd_size_are_named_where_the_solver_gives_up() -> None:
    rows = (Row("a mountain", {"m.tip": 1.0}, lower=1e9, upper=1e9),)
    with pytest.raises(DataError) as caught:
        Consistent(REGRESSOR.base, known(rows=rows))(information_of(0.05))
    assert "a mountain" in caught.value.fix or "a mountain" in caught.value.wrong


def test_bounds_beyond_all_reach_do_no_harm() -> None:
    rows = tuple(Row("wide", {name: 1.0}, lower=-1e12, upper=1e12) for name in MODEL.names)
    wide, plain = (
        Consistent(REGRESSOR.base, known(rows=some))(information_of(0.05)).parameters.values
        for some in (rows, ())
    )
    assert np.allclose(wide, plain, rtol=0.0, atol=1e-7 * np.abs(plain).max())


def test_equal_weights_do_not_make_rows_equally_noisy() -> None:
    ours = Consistent(REGRESSOR.base, known(uncertainty=30.0), equal=True)(information_of(0.05))
    plain = OrdinaryLeastSquares()(information_of(0.05))
    own = [name.startswith(("coulomb", "viscous", "offset")) for name in ours.parameters.names]
    ratio = ours.std[own] / plain.std[own]
    assert sum(own) > 10
    assert np.all((ratio > 0.8) & (ratio < 1.05))


def test_intervals_are_no_wider_than_those_of_least_squares() -> None:
    information = information_of(0.05)
    plain, ours = (
        estimator(information)
        for estimator in (WeightedLeastSquares(), Consistent(REGRESSOR.base, known()))
    )
    assert plain.parameters.names == ours.parameters.names
    assert np.all(ours.std <= plain.std * (1.0 + 1e-6))
    assert ours.learned is not None
    assert np.all((ours.learned >= 0.0) & (ours.learned <= 1.0))


@pytest.mark.slow
def test_prior_constraints_hold() -> None:
    rows = (
        Row("mass of tip", {"m.tip": 1.0}, lower=2.5, upper=2.5),
        Row("twins", {"m.left": 1.0, "m.slider": -1.0}, lower=0.0, upper=0.0),
        Row("at most", {"coulomb.trunk_joint": 1.0}, upper=0.1),
    )
    estimate = Consistent(REGRESSOR.base, known(rows=rows))(information_of(0.05))
    assert estimate.standard is not None
    values = estimate.standard.parameters
    assert values["m.tip"] == pytest.approx(2.5, abs=1e-7)
    assert values["m.left"] == pytest.approx(values["m.slider"], abs=1e-7)
    assert values["coulomb.trunk_joint"] <= 0.1 + 1e-7
    learned = dict(zip(values.names, estimate.standard.learned, strict=True))
    assert learned["m.tip"] == 0.0
    assert estimate.standard.std[values.names.index("m.tip")] < 1e-6


def test_prior_constraints_that_only_physics_forbids_are_named() -> None:
    rows = (
        Row("light tip", {"m.tip": 1.0}, upper=0.1),
        Row("far centre", {"mx.tip": 1.0}, lower=1.0, upper=1.0),
        Row("slender tip", {"Izz.tip": 1.0}, upper=0.1),
        Row("mass of left", {"m.left": 1.0}, lower=1.0),
    )
    with pytest.raises(DataError, match="are infeasible together") as caught:
        Consistent(REGRESSOR.base, known(rows=rows))(information_of(0.05))
    assert "far centre" in caught.value.wrong
    assert "mass of left" not in caught.value.wrong


def test_contradictory_constraints_are_named() -> None:
    rows = (
        Row("heavy tip", {"m.tip": 1.0}, lower=5.0),
        Row("light arm", {f"m.{b.name}": 1.0 for b in MODEL.robot.bodies}, upper=3.0),
        Row("mass of left", {"m.left": 1.0}, lower=0.1),
    )
    with pytest.raises(DataError, match="are infeasible together") as caught:
        Consistent(REGRESSOR.base, known(rows=rows))(information_of(0.05))
    assert "heavy tip" in caught.value.wrong
    assert "light arm" in caught.value.wrong
    assert "left" not in caught.value.wrong


def test_prior_constraints_far_from_the_data_hold() -> None:
    total = {f"m.{b.name}": 1.0 for b in MODEL.robot.bodies}
    rows = (Row("total mass", total, upper=2.0),)
    estimate = Consistent(REGRESSOR.base, known(rows=rows, uncertainty=0.3))(information_of(1e-3))
    assert estimate.standard is not None
    assert sum(estimate.standard.parameters[name] for name in total) <= 2.0 + 1e-6


def test_a_solver_that_stops_early_is_never_called_solved() -> None:
    with pytest.raises(DataError, match="stopped before the optimum") as caught:
        Consistent(REGRESSOR.base, known(), iterations=4)(information_of(0.05))
    assert "MaxIterations" in caught.value.wrong


def test_too_few_samples_are_refused() -> None:
    with pytest.raises(DataError, match=r"too few samples: .* more than \d+ are needed") as caught:
        Consistent(REGRESSOR.base, known())(information_of(0.05, count=8))
    assert "matched_cutoff" in caught.value.fix


def test_the_estimate_survives_json() -> None:
    estimate = Consistent(REGRESSOR.base, known())(information_of(0.05))
    again = Estimate.from_dict(estimate.to_dict())
    assert again.to_dict() == estimate.to_dict()
    assert again.values.as_dict() == estimate.values.as_dict()


def test_active_bounds_of_friction_are_named_with_what_they_cost() -> None:
    friction = {name: -1.0 for name in MODEL.names if name.startswith("coulomb.")}
    notes = Consistent(REGRESSOR.base, known())(information_of(0.1, truth=TRUTH | friction)).notes
    note = next(note for note in notes if "physical constraints" in note)
    assert "active: bounds of" in note and "coulomb.*" in note and "inertia of" not in note
    some = dict(list(friction.items())[:1])
    notes = Consistent(REGRESSOR.base, known())(information_of(0.1, truth=TRUTH | some)).notes
    note = next(note for note in notes if "physical constraints" in note)
    assert next(iter(some)) in note and "coulomb.*" not in note


@pytest.mark.slow
def test_bodies_that_cannot_be_are_named_with_what_they_cost() -> None:
    body = MODEL.robot.bodies[-1].name
    light = {f"Ixx.{body}": -1.0, f"Iyy.{body}": -1.0, f"Izz.{body}": -1.0}
    notes = Consistent(REGRESSOR.base, known())(information_of(0.1, truth=TRUTH | light)).notes
    note = next(note for note in notes if "physical constraints" in note)
    assert "active: valid inertia of" in note and body in note and "coulomb" not in note


def test_data_that_fit_say_nothing_of_constraints() -> None:
    notes = Consistent(REGRESSOR.base, known())(information_of(0.05)).notes
    assert not any("physical constraints" in note for note in notes)
