"""Gauss–Newton in log-Cholesky coordinates against the convex program and known truths."""

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from invented import tree
from steelyard.errors import DataError
from steelyard.estimation.consistent.consistent import Consistent
from steelyard.estimation.consistent.log_cholesky import LogCholesky
from steelyard.estimation.consistent.log_cholesky_body import entries
from steelyard.estimation.consistent.log_cholesky_criterion import Criterion
from steelyard.estimation.consistent.log_cholesky_fields import fit_jointly
from steelyard.estimation.consistent.physics import Pullback
from steelyard.estimation.consistent.unknowns import BASIS
from steelyard.estimation.estimate import Estimate, Standard
from steelyard.estimation.fields.fields import find_fields
from steelyard.estimation.knowledge import Knowledge, Row
from steelyard.estimation.least_squares.whitened import whitened
from steelyard.estimation.prior.prior import default_knowledge
from steelyard.identification.compare_inputs import rivals_of
from steelyard.model import Model
from steelyard.progress import Stopped, silent
from steelyard.regression.accumulate import Accumulator, Stretch
from steelyard.regression.information import Information, Stamp, Window
from steelyard.regression.regressor import Regressor, base_regressor, standard_regressor
from steelyard.robot.inertia import Inertia
from steelyard.terms.laws.coulomb import Coulomb
from steelyard.terms.laws.rigid_body import RigidBody
from steelyard.terms.laws.stribeck import Stribeck
from steelyard.terms.laws.viscous import Viscous
from steelyard.terms.open_fields import Find

ROBOT = tree()
FRICTION = ("coulomb", "viscous", "stribeck")
PLAIN = Model(ROBOT, (RigidBody(), Coulomb(), Viscous()))
SPEEDS = (0.05, 0.1, 0.2, 0.08)
Said = Callable[[Regressor], Information]


def with_speed(speed: object) -> Model:
    return Model(ROBOT, (RigidBody(), Coulomb(), Viscous(), Stribeck(speed=speed)))  # type: ignore[arg-type]


def logged(
    model: Model, noise: float, count: int = 300, friction: float = 1.0
) -> tuple[Said, np.ndarray]:
    """What a log of the model says, and the true standard parameters: a prior off by a quarter."""
    rng, known = np.random.default_rng(1), default_knowledge(model)
    truth = np.zeros(len(model.names))
    for body, prior in enumerate(known.priors):
        assert prior is not None
        factor = np.linalg.cholesky(prior.pseudo)
        x = np.tensordot(entries(0.25 * rng.normal(size=10))[0], BASIS, 1)
        truth[known.tens(body)] = Inertia.from_pseudo(factor @ x @ factor.T).ten
    for k, name in enumerate(model.names):
        if name.split(".")[0] in FRICTION:
            truth[k] = friction * rng.uniform(0.5, 1.5)
    q, dq, ddq = rng.normal(size=(3, 4, count))
    dq = dq * rng.choice([1.0, 0.1], size=dq.shape)
    effort = standard_regressor(model).dense(q, dq, ddq) @ truth
    effort = effort + noise * effort.std(axis=1, keepdims=True) * rng.normal(size=effort.shape)

    def said(regressor: Regressor) -> Information:
        channels = regressor.model.scan()(q, dq, ddq)
        sums = Accumulator(regressor)(Stretch(q, dq, ddq, effort, None, channels))
        columns = regressor.layout.columns
        return Information(
            regressor.layout,
            Stamp(regressor.model.fingerprint, columns, ("Nm",) * 4, "none"),
            (Window("run", 0.0, 1.0),),
            sums.grams[None],
            sums.absolute[None],
            sums.counts[None],
        )

    return said, truth


def standard_of(estimate: Estimate) -> Standard:
    assert estimate.standard is not None
    return estimate.standard


def smallest_eigenvalue(estimate: Estimate, known: Knowledge) -> float:
    """Of all bodies' pseudo-inertias in the scale of their prior."""
    values, found = estimate.values.values, []
    for body, prior in enumerate(known.priors):
        assert prior is not None
        factor = np.linalg.inv(np.linalg.cholesky(prior.pseudo))
        pseudo = Inertia.from_ten(values[known.tens(body)]).pseudo
        found.append(np.linalg.eigvalsh(factor @ pseudo @ factor.T)[0])
    return float(min(found))


def differences(function: Callable[[np.ndarray], np.ndarray], x: np.ndarray) -> np.ndarray:
    step = 1e-6
    sides = [(function(x + step * e), function(x - step * e)) for e in np.eye(len(x))]
    return np.array([(a - b) / (2.0 * step) for a, b in sides]).T


@pytest.mark.parametrize("size", [1e-6, 0.5])
def test_coordinates_and_their_derivatives(size: float) -> None:
    y = size * np.random.default_rng(0).normal(size=10)
    numbers, slopes = entries(y)
    assert np.allclose(slopes, differences(lambda z: entries(z)[0], y), atol=1e-8)
    assert np.linalg.eigvalsh(np.tensordot(numbers, BASIS, 1))[0] > 0.0
    assert np.allclose(np.tensordot(entries(np.zeros(10))[0], BASIS, 1), np.eye(4))


@pytest.mark.parametrize("gamma", [1.0, 30.0, None])
def test_it_finds_the_optimum_of_the_convex_program(gamma: float | None) -> None:
    said, _ = logged(PLAIN, 0.3)
    regressor, known = base_regressor(PLAIN), default_knowledge(PLAIN)
    information = said(regressor)
    wanted = Consistent(regressor.base, known, gamma=gamma)(information)
    found = LogCholesky(regressor.base, known, gamma=gamma)(information)
    assert found.estimator == "log-Cholesky Gauss-Newton"
    scale = np.maximum(np.abs(wanted.values.values), standard_of(wanted).std)
    assert np.abs((found.values.values - wanted.values.values) / scale).max() < 1e-4
    assert np.allclose(found.covariance, wanted.covariance, rtol=1e-3, atol=1e-9)
    assert np.allclose(standard_of(found).learned, standard_of(wanted).learned, atol=1e-4)
    assert smallest_eigenvalue(found, known) > 1e-3


def test_bodies_exist_and_friction_brakes_where_least_squares_says_neither() -> None:
    said, _ = logged(PLAIN, 1.0, count=60, friction=0.02)
    regressor, known = base_regressor(PLAIN), default_knowledge(PLAIN)
    information = said(regressor)
    found = LogCholesky(regressor.base, known, gamma=1.0)(information)
    assert smallest_eigenvalue(found, known) > 0.0
    friction = [found.values[n] for n in PLAIN.names if n.split(".")[0] in FRICTION]
    wanted = Consistent(regressor.base, known, gamma=1.0)(information)
    theirs = [wanted.values[n] for n in PLAIN.names if n.split(".")[0] in FRICTION]
    assert min(friction) >= 0.0
    assert min(theirs) < 1e-4
    assert np.abs(np.subtract(friction, theirs)).max() < 1e-4


def test_a_given_parameter_keeps_its_value() -> None:
    said, _ = logged(PLAIN, 0.1)
    regressor, known = base_regressor(PLAIN), default_knowledge(PLAIN)
    place = known.names.index("viscous.slider_joint")
    lower, upper = known.lower.copy(), known.upper.copy()
    lower[place] = upper[place] = 0.25
    given = replace(known, lower=lower, upper=upper)
    found = LogCholesky(regressor.base, given, gamma=10.0)(said(regressor))
    assert found.values["viscous.slider_joint"] == pytest.approx(0.25, rel=1e-9)


def test_wishes_that_it_breaks_are_named() -> None:
    said, _ = logged(PLAIN, 0.1)
    regressor, known = base_regressor(PLAIN), default_knowledge(PLAIN)
    rows = (
        Row("left is heavier than 50 kg", {"m.left": 1.0}, lower=50.0),
        Row("trunk and left weigh less than 100 kg", {"m.trunk": 1.0, "m.left": 1.0}, upper=100.0),
    )
    found = LogCholesky(regressor.base, replace(known, rows=rows), gamma=10.0)(said(regressor))
    assert found.notes[-2:] == (
        "2 wishes of [[knowledge]] about bodies or ties count for nothing in this estimator",
        "wishes that this estimate does not keep: left is heavier than 50 kg",
    )
    plain = LogCholesky(regressor.base, known, gamma=10.0)(said(regressor))
    assert np.array_equal(found.values.values, plain.values.values)
    assert np.array_equal(found.covariance, plain.covariance)


def test_a_tie_that_it_does_not_keep_makes_nothing_certain() -> None:
    said, _ = logged(PLAIN, 0.1)
    regressor, known = base_regressor(PLAIN), default_knowledge(PLAIN)
    pair = ("viscous.slider_joint", "coulomb.slider_joint")
    tie = Row("they are alike", {pair[0]: 1.0, pair[1]: -1.0}, 0.0, 0.0)
    wished = replace(known, rows=(tie,))
    found = LogCholesky(regressor.base, wished, gamma=10.0)(said(regressor))
    plain = LogCholesky(regressor.base, known, gamma=10.0)(said(regressor))
    assert np.array_equal(standard_of(found).std, standard_of(plain).std)
    assert np.array_equal(standard_of(found).learned, standard_of(plain).learned)
    assert any(note.startswith("1 wish of [[knowledge]]") for note in found.notes)


@pytest.mark.parametrize("coefficient", [1.0, -2.0])
def test_a_wish_about_a_single_friction_is_kept(coefficient: float) -> None:
    said, _ = logged(PLAIN, 0.1)
    regressor, known = base_regressor(PLAIN), default_knowledge(PLAIN)
    name, end = "viscous.slider_joint", 3.0 * coefficient
    wished = replace(known, rows=(Row("it is 3", {name: coefficient}, end, end),))
    found = LogCholesky(regressor.base, wished, gamma=10.0)(said(regressor))
    wanted = Consistent(regressor.base, wished, gamma=10.0)(said(regressor))
    place = found.values.names.index(name)
    assert found.values[name] == pytest.approx(3.0, rel=1e-9)
    assert standard_of(found).std[place] == pytest.approx(0.0, abs=1e-9)
    assert standard_of(found).learned[place] == 0.0
    assert np.allclose(standard_of(found).std, standard_of(wanted).std, rtol=1e-3, atol=1e-9)
    assert not any("for nothing" in note for note in found.notes)


def test_it_never_says_solved_when_it_is_not() -> None:
    said, _ = logged(PLAIN, 0.1)
    regressor, known = base_regressor(PLAIN), default_knowledge(PLAIN)
    with pytest.raises(DataError, match="did not reach the optimum in 3 steps") as caught:
        LogCholesky(regressor.base, known, gamma=10.0, steps=3)(said(regressor))
    assert "consistent estimate" in caught.value.mend


def criteria(estimator: LogCholesky, information: Information, gamma: float) -> tuple[float, float]:
    """The convex program's criterion at its own optimum and at that of the coordinates."""
    convex = Consistent(estimator.base, estimator.knowledge)
    data = whitened(information)
    program = convex.program(data)
    found = estimator.solve(estimator.program(data), gamma)
    return program.cost(convex.solve(program, gamma), gamma), program.cost(found, gamma)


@pytest.mark.parametrize("prior", [True, False])
def test_slope_and_curvature_along_a_move(prior: bool) -> None:
    said, _ = logged(PLAIN, 1.0, count=60)
    regressor, known = base_regressor(PLAIN), default_knowledge(PLAIN)
    known = known if prior else replace(known, priors=(None,) * len(known.priors))
    program = LogCholesky(regressor.base, known).program(whitened(said(regressor)))
    criterion = replace(Criterion.of(program, 40.0), barrier=20.0)
    rng = np.random.default_rng(4)
    x = np.clip(0.3 * rng.normal(size=len(criterion.lower)), criterion.lower, criterion.upper)
    step = 0.05 * rng.normal(size=len(x))
    residuals, slopes = criterion.near(x)

    def along(part: float) -> float:
        there = criterion.moved(x, step, part)
        assert there is not None
        return criterion.cost(there)

    size = 1e-3
    low, here, high = along(-size), along(0.0), along(size)
    assert here == pytest.approx(criterion.cost(x), rel=1e-12)
    assert (high - low) / (2.0 * size) == pytest.approx(residuals @ slopes @ step, rel=1e-6)
    bend = float(np.square(slopes @ step).sum())
    assert (high - 2.0 * here + low) / size**2 == pytest.approx(bend, rel=1e-4)
    assert criterion.moved(x, -1e3 * step, 1.0) is None


@pytest.mark.parametrize("gamma", [1e-3, 1.0, 1e4])
@pytest.mark.parametrize("noise", [1e-4, 1.0])
def test_every_weight_is_solved_sharp_data_and_dull_ones(gamma: float, noise: float) -> None:
    said, _ = logged(PLAIN, noise, count=60, friction=0.02)
    regressor = base_regressor(PLAIN)
    solver = LogCholesky(regressor.base, default_knowledge(PLAIN))
    wanted, found = criteria(solver, said(regressor), gamma)
    assert found == pytest.approx(wanted, rel=1e-6)


def test_bodies_without_prior_stop_at_the_margin() -> None:
    said, _ = logged(PLAIN, 1.0, count=60)
    regressor, known = base_regressor(PLAIN), default_knowledge(PLAIN)
    bare = replace(known, priors=(None,) * len(known.priors))
    solver = LogCholesky(regressor.base, bare)
    wanted, found = criteria(solver, said(regressor), 0.0)
    assert found == pytest.approx(wanted, rel=1e-6)
    u = solver.solve(solver.program(whitened(said(regressor))), 0.0)
    sizes = np.linalg.eigvalsh(np.tensordot(u[: 10 * len(known.bodies)].reshape(-1, 10), BASIS, 1))
    assert sizes.min() == pytest.approx(solver.form.margin, rel=1e-2)


@pytest.mark.parametrize(
    ("name", "log", "prior"),
    [
        ("rokae_ar5", "rokae_ar5/ar5_run1_rows0_2300.parquet", ""),
        ("tiago", "tiago/tiago_run1_rows0_5600.parquet", ""),
        ("tiago", "tiago/tiago_run1_rows0_5600.parquet", '\n[prior]\nsource = "none"\n'),
    ],
)
def test_real_robots(name: str, log: str, prior: str, tmp_path: Path) -> None:
    if "STEELYARD_DATA" not in os.environ:
        pytest.skip("STEELYARD_DATA is not set: no data")
    path = Path(os.environ["STEELYARD_DATA"]) / log
    text = (Path(__file__).parents[2] / f"examples/{name}.toml").read_text("utf-8")
    (tmp_path / "robot.toml").write_text(text + prior, "utf-8")
    rivals = rivals_of(str(tmp_path / "robot.toml"), [str(path)], False, 1, silent)
    information, context = rivals.parts.information, rivals.context
    mine = LogCholesky(context.regressor.base, context.knowledge, per_run=context.per_run)
    theirs = Consistent(mine.base, mine.knowledge, per_run=mine.per_run)
    found, wanted = mine(information), theirs(information)
    spread = np.maximum(standard_of(wanted).std, 1e-9)
    assert np.abs((found.values.values - wanted.values.values) / spread).max() < 2e-2
    for gamma in (0.0,) if prior else (1e-3, mine.weight(information)):
        optimum, reached = criteria(mine, information, gamma)
        assert reached == pytest.approx(optimum, rel=1e-6)


def test_other_forms_of_the_prior_are_refused() -> None:
    with pytest.raises(ValueError, match="entropic"):
        LogCholesky(base_regressor(PLAIN).base, default_knowledge(PLAIN), form=Pullback())


def test_bodies_friction_and_stribeck_speeds_are_found_together() -> None:
    said, truth = logged(with_speed(SPEEDS), 0.02, count=3000)
    model = with_speed(Find(1e-3, 1.0, shared=False))
    known = default_knowledge(model)
    fit = fit_jointly(model, said, known)
    assert [finding.joint for finding in fit.findings] == list(ROBOT.joint_names)
    for finding, speed in zip(fit.findings, SPEEDS, strict=True):
        half = np.log(finding.interval[1] / finding.interval[0]) / 2.0
        assert abs(np.log(finding.value / speed)) < 1.5 * half
    for mine, theirs in zip(fit.findings, find_fields(model, said, starts=2).findings, strict=True):
        width = np.log(theirs.interval[1] / theirs.interval[0])
        assert abs(np.log(mine.value / theirs.value)) < 0.05 * width
        assert np.log(mine.interval[1] / mine.interval[0]) == pytest.approx(width, rel=0.1)
    standard = standard_of(fit.estimate)
    assert fit.estimate.values.names == model.names == fit.model.names
    assert np.mean(np.abs(standard.parameters.values - truth) <= 1.96 * standard.std) > 0.9
    assert smallest_eigenvalue(fit.estimate, known) > 0.0
    assert len(fit.estimate.parameters) == len(base_regressor(fit.model).layout.columns)
    assert any("found from the data" in note for note in fit.estimate.notes)
    assert 3 < fit.passes < 20


def test_one_speed_for_all_joints() -> None:
    said, _ = logged(with_speed(0.1), 1e-4, count=1500)
    model = with_speed(Find(1e-3, 1.0))
    fit = fit_jointly(model, said, default_knowledge(model), gamma=1.0)
    assert len(fit.findings) == 1
    assert fit.findings[0].joint is None
    assert fit.findings[0].value == pytest.approx(0.1, rel=2e-3)
    assert fit.model.terms[3] == Stribeck(speed=fit.findings[0].value)
    assert any("as stated" in note for note in fit.estimate.notes)


def test_it_is_at_the_joint_optimum() -> None:
    said, _ = logged(with_speed(SPEEDS), 0.05, count=1500)
    model = with_speed(Find(1e-3, 1.0, shared=False))
    known = default_knowledge(model)
    fit = fit_jointly(model, said, known, gamma=10.0)

    def cost(speeds: tuple[float, ...]) -> float:
        regressor = base_regressor(with_speed(speeds))
        estimate = LogCholesky(regressor.base, known, gamma=10.0)(said(regressor))
        values = regressor.base.base_values(estimate.values.values)
        squares = said(regressor).residual_squares(values) / fit.estimate.sigma**2
        found = estimate.values.values
        penalty = 0.0
        for body, prior in enumerate(known.priors):
            assert prior is not None
            x = np.linalg.solve(prior.pseudo, Inertia.from_ten(found[known.tens(body)]).pseudo)
            penalty += float(np.trace(x) - np.linalg.slogdet(x)[1] - 4.0)
        return 0.5 * float(squares.sum()) + 10.0 * penalty

    speeds = tuple(finding.value for finding in fit.findings)
    least = cost(speeds)
    for k, factor in ((0, 0.9), (1, 1.05), (2, 0.95), (3, 1.02)):
        moved = tuple(s * (factor if j == k else 1.0) for j, s in enumerate(speeds))
        assert cost(moved) > least


def test_fields_that_keep_moving_are_an_error() -> None:
    said, _ = logged(with_speed(SPEEDS), 0.02)
    model = with_speed(Find(1e-3, 1.0, shared=False))
    with pytest.raises(DataError, match="do not stand still after 2 passes") as caught:
        fit_jointly(model, said, default_knowledge(model), gamma=10.0, passes=2)
    assert "log stribeck speed." in caught.value.where
    with pytest.raises(Stopped):
        fit_jointly(
            model, said, default_knowledge(model), gamma=10.0, progress=lambda e: e.done < 1
        )
