"""The convex program against Gauss–Newton in log-Cholesky coordinates, an oracle without cones."""

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from invented import tree
from log_cholesky_oracle import Criterion, LogCholesky, entries
from steelyard.base.progress import silent
from steelyard.estimate.consistent.conic_solver_and_scaled_parameters import BASIS
from steelyard.estimate.consistent.convex_estimator import Consistent
from steelyard.estimate.estimate import Estimate, StandardEstimate
from steelyard.estimate.information.base_parameters_and_regressor import (
    Regressor,
    base_regressor,
    standard_regressor,
)
from steelyard.estimate.information.filter_and_gram import Accumulator, Stretch
from steelyard.estimate.information.information import Information, Signature, Window
from steelyard.estimate.least_squares.weighted_robust_and_whitened import whitened
from steelyard.estimate.prior.body_priors import Knowledge, Row, default_knowledge
from steelyard.identify.comparison.compare import comparison_inputs
from steelyard.model.laws.friction_over_speed import Coulomb, Viscous
from steelyard.model.laws.laws_without_friction import RigidBody
from steelyard.model.model import Model
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.inertia_and_placement import Inertia

ROBOT = tree()
FRICTION = ("coulomb", "viscous")
PLAIN = Model(ROBOT, (RigidBody(), Coulomb(), Viscous()))
InformationOf = Callable[[Regressor], Information]


def logged(
    model: Model, noise: float, count: int = 300, friction: float = 1.0
) -> tuple[InformationOf, np.ndarray]:
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

    def information_of(regressor: Regressor) -> Information:
        channels = regressor.model.scan()(q, dq, ddq)
        sums = Accumulator(regressor)(Stretch(q, dq, ddq, effort, None, channels))
        columns = regressor.layout.columns
        return Information(
            regressor.layout,
            Signature(regressor.model.fingerprint, columns, ("Nm",) * 4, "none"),
            (Window("run", 0.0, 1.0),),
            sums.grams[None],
            sums.absolute[None],
            sums.counts[None],
        )

    return information_of, truth


def standard_of(estimate: Estimate) -> StandardEstimate:
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
    information_of, _ = logged(PLAIN, 0.3)
    regressor, known = base_regressor(PLAIN), default_knowledge(PLAIN)
    information = information_of(regressor)
    wanted = Consistent(regressor.base, known, gamma=gamma)(information)
    found = LogCholesky(regressor.base, known, gamma=gamma)(information)
    scale = np.maximum(np.abs(wanted.values.values), standard_of(wanted).std)
    assert np.abs((found.values.values - wanted.values.values) / scale).max() < 1e-4
    assert np.allclose(found.covariance, wanted.covariance, rtol=1e-3, atol=1e-9)
    assert np.allclose(standard_of(found).learned, standard_of(wanted).learned, atol=1e-4)
    assert smallest_eigenvalue(found, known) > 1e-3


def test_bodies_exist_and_friction_brakes_where_least_squares_says_neither() -> None:
    information_of, _ = logged(PLAIN, 1.0, count=60, friction=0.02)
    regressor, known = base_regressor(PLAIN), default_knowledge(PLAIN)
    information = information_of(regressor)
    found = LogCholesky(regressor.base, known, gamma=1.0)(information)
    assert smallest_eigenvalue(found, known) > 0.0
    friction = [found.values[n] for n in PLAIN.names if n.split(".")[0] in FRICTION]
    wanted = Consistent(regressor.base, known, gamma=1.0)(information)
    theirs = [wanted.values[n] for n in PLAIN.names if n.split(".")[0] in FRICTION]
    assert min(friction) >= 0.0
    assert min(theirs) < 1e-4
    assert np.abs(np.subtract(friction, theirs)).max() < 1e-4


def test_a_given_parameter_keeps_its_value() -> None:
    information_of, _ = logged(PLAIN, 0.1)
    regressor, known = base_regressor(PLAIN), default_knowledge(PLAIN)
    place = known.names.index("viscous.slider_joint")
    lower, upper = known.lower.copy(), known.upper.copy()
    lower[place] = upper[place] = 0.25
    given = replace(known, lower=lower, upper=upper)
    found = LogCholesky(regressor.base, given, gamma=10.0)(information_of(regressor))
    assert found.values["viscous.slider_joint"] == pytest.approx(0.25, rel=1e-9)


@pytest.mark.parametrize("coefficient", [1.0, -2.0])
def test_a_constraint_about_a_single_friction_is_kept(coefficient: float) -> None:
    information_of, _ = logged(PLAIN, 0.1)
    regressor, known = base_regressor(PLAIN), default_knowledge(PLAIN)
    name, end = "viscous.slider_joint", 3.0 * coefficient
    constrained = replace(known, rows=(Row("it is 3", {name: coefficient}, end, end),))
    found = LogCholesky(regressor.base, constrained, gamma=10.0)(information_of(regressor))
    wanted = Consistent(regressor.base, constrained, gamma=10.0)(information_of(regressor))
    place = found.values.names.index(name)
    assert found.values[name] == pytest.approx(3.0, rel=1e-9)
    assert standard_of(found).std[place] == pytest.approx(0.0, abs=1e-9)
    assert standard_of(found).learned[place] == 0.0
    assert np.allclose(standard_of(found).std, standard_of(wanted).std, rtol=1e-3, atol=1e-9)


def criteria(estimator: LogCholesky, information: Information, gamma: float) -> tuple[float, float]:
    """The convex program's criterion at its own optimum and at that of the coordinates."""
    convex = Consistent(estimator.base, estimator.knowledge)
    data = whitened(information)
    program = convex.program(data)
    found = estimator.solve(estimator.program(data), gamma)
    return program.cost(convex.solve(program, gamma), gamma), program.cost(found, gamma)


@pytest.mark.parametrize("prior", [True, False])
def test_slope_and_curvature_along_a_move(prior: bool) -> None:
    information_of, _ = logged(PLAIN, 1.0, count=60)
    regressor, known = base_regressor(PLAIN), default_knowledge(PLAIN)
    known = known if prior else replace(known, priors=(None,) * len(known.priors))
    program = LogCholesky(regressor.base, known).program(whitened(information_of(regressor)))
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
    information_of, _ = logged(PLAIN, noise, count=60, friction=0.02)
    regressor = base_regressor(PLAIN)
    solver = LogCholesky(regressor.base, default_knowledge(PLAIN))
    wanted, found = criteria(solver, information_of(regressor), gamma)
    assert found == pytest.approx(wanted, rel=1e-6)


def test_bodies_without_prior_stop_at_the_margin() -> None:
    information_of, _ = logged(PLAIN, 1.0, count=60)
    regressor, known = base_regressor(PLAIN), default_knowledge(PLAIN)
    bare = replace(known, priors=(None,) * len(known.priors))
    solver = LogCholesky(regressor.base, bare)
    wanted, found = criteria(solver, information_of(regressor), 0.0)
    assert found == pytest.approx(wanted, rel=1e-6)
    u = solver.solve(solver.program(whitened(information_of(regressor))), 0.0)
    sizes = np.linalg.eigvalsh(np.tensordot(u[: 10 * len(known.bodies)].reshape(-1, 10), BASIS, 1))
    assert sizes.min() == pytest.approx(solver.form.margin, rel=1e-2)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "log", "prior"),
    [
        ("rokae_ar5", "rokae_ar5/ar5_run1_rows0_2300.parquet", ""),
        ("tiago", "tiago/tiago_run1_rows0_5600.parquet", '\n[prior]\nsource = "none"\n'),
    ],
)
def test_real_robots(name: str, log: str, prior: str, tmp_path: Path) -> None:
    if "STEELYARD_DATA" not in os.environ:
        pytest.skip("STEELYARD_DATA is not set: no data")
    path = Path(os.environ["STEELYARD_DATA"]) / log
    text = (Path(__file__).parents[2] / f"examples/{name}.toml").read_text("utf-8")
    (tmp_path / "robot.toml").write_text(text + prior, "utf-8")
    file = load_robot(tmp_path / "robot.toml")
    context, parts, *_ = comparison_inputs(file, [str(path)], False, 1, silent)
    information = parts.information
    mine = LogCholesky(context.regressor.base, context.knowledge, per_run=context.per_run)
    theirs = Consistent(mine.base, mine.knowledge, per_run=mine.per_run)
    found, wanted = mine(information), theirs(information)
    spread = np.maximum(standard_of(wanted).std, 1e-9)
    assert np.abs((found.values.values - wanted.values.values) / spread).max() < 2e-2
    for gamma in (0.0,) if prior else (1e-3, 1.0):
        optimum, reached = criteria(mine, information, gamma)
        assert reached == pytest.approx(optimum, rel=1e-6)
