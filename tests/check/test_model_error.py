"""What residuals say of a model: errors planted into simulated logs are named, noise is not."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
import tomllib

from check.fitted import case, demo_arm, log
from steelyard.base.arrays import Array
from steelyard.check.finding import Finding, Severity
from steelyard.check.fitted import incomplete_model_and_unseen_error as incomplete_model
from steelyard.check.fitted.causes_of_residuals import (
    NO_PERIOD,
    Cause,
    LeftOutGain,
    strongest_period,
)
from steelyard.check.fitted.incomplete_model_and_unseen_error import model_error_check
from steelyard.estimate.consistent.convex_estimator import TERM_MISSING
from steelyard.estimate.information.base_parameters_and_regressor import base_regressor
from steelyard.estimate.information.information import Information
from steelyard.estimate.nonlinear.nonlinear_parameters import information_from
from steelyard.model.laws.friction_over_speed import Stribeck
from steelyard.model.laws.friction_with_memory import LoadDependent
from steelyard.model.laws.laws_without_friction import Cogging
from steelyard.model.laws.register import DEFAULT_TERMS, term_of
from steelyard.model.terms.term import Term
from steelyard.robot.file.robot_file import LoadedRobot
from steelyard.robot.robot import Body, Robot
from steelyard.simulate.ground_truth import random_truth


@pytest.fixture(scope="module")
def loaded(tmp_path_factory: pytest.TempPathFactory) -> LoadedRobot:
    return demo_arm(tmp_path_factory.mktemp("arm"), joints=3)


def found(
    loaded: LoadedRobot,
    folder: Path,
    robot: Robot | None = None,
    terms: Sequence[Term] = DEFAULT_TERMS,
    offset: Sequence[float] = (0.0,),
) -> tuple[Finding, ...]:
    """The check of a plain fit of two runs of a robot that is not what its file says."""
    paths = [folder / f"run{seed}.parquet" for seed in (1, 2)]
    truth = random_truth(loaded.robot if robot is None else robot, 1, terms=terms)
    for seed, path in enumerate(paths, start=1):
        log(path, truth, seed, offset)
    return model_error_check(case(loaded, paths))


Change = Callable[[Array, Array], Array]  # positions and efforts `(n, N)` to other efforts


def of_changed_efforts(loaded: LoadedRobot, folder: Path, change: Change) -> Finding:
    """The one finding of two runs whose efforts are changed after they were logged."""
    paths = [folder / f"run{seed}.parquet" for seed in (1, 2)]
    truth, joints = random_truth(loaded.robot, 1), range(1, loaded.robot.n + 1)
    for seed, path in enumerate(paths, start=1):
        log(path, truth, seed)
        table = pl.read_parquet(path)
        q, tau = (
            table.select(name.format(k) for k in joints).to_numpy().T.copy()
            for name in ("q{}_rad", "tau{}_Nm")
        )
        efforts = {f"tau{k}_Nm": x for k, x in zip(joints, change(q, tau), strict=True)}
        table.with_columns(**efforts).write_parquet(path)
    (finding,) = model_error_check(case(loaded, paths))
    return finding


def changed(tau: Array, joint: int, values: Array) -> Array:
    return np.where(np.arange(len(tau))[:, None] == joint, values, tau)


def play(torque: Array, width: float) -> Array:
    """What a sensor with backlash of this half-width reads."""
    found = torque.copy()
    for k in range(1, len(torque)):
        found[k] = np.clip(found[k - 1], torque[k] - width, torque[k] + width)
    return found


def soft(torque: Array) -> Array:
    most = 1.3 * np.abs(torque).max()
    return np.asarray(most * np.tanh(torque / most))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "says"),
    [
        (
            lambda q, tau: changed(tau, 2, tau[2] + 0.15 * tau[1]),
            "cross-talk of shoulder_lift in the effort of elbow (15 % of it)",
        ),
        (
            lambda q, tau: changed(tau, 2, play(tau[2], 0.06 * np.abs(tau[2]).max())),
            "hysteresis in the effort of elbow (it depends on the way to it)",
        ),
        (
            lambda q, tau: changed(tau, 2, soft(tau[2])),
            "gain of elbow that falls with the torque",
        ),
    ],
)
def test_how_an_effort_is_misread_is_named(
    change: Change, says: str, loaded: LoadedRobot, tmp_path: Path
) -> None:
    finding = of_changed_efforts(loaded, tmp_path, change)
    assert says in finding.brief and "rror on left-out motion" in finding.brief


@pytest.mark.slow
@pytest.mark.parametrize("cycles", [11.0, 60.0])
def test_an_effort_that_is_periodic_in_the_position_is_named(
    cycles: float, loaded: LoadedRobot, tmp_path: Path
) -> None:
    finding = of_changed_efforts(
        loaded, tmp_path, lambda q, tau: changed(tau, 2, tau[2] + 2.0 * np.sin(cycles * q[2] + 1.0))
    )
    says, _, rest = finding.brief.partition(" times per turn (term ")
    assert says.partition("With an effort of elbow that is periodic in its position, ")[2]
    assert float(says.rpartition(" ")[2]) == pytest.approx(cycles, rel=5e-3)
    (term,) = tomllib.loads(f"terms = [{rest.partition(')')[0]}]")["terms"]
    assert term_of(term, "advice") == Cogging(joints=("elbow",), period=term["period"])


@pytest.mark.slow
def test_efforts_of_all_joints_that_are_periodic_are_one_cause(
    loaded: LoadedRobot, tmp_path: Path
) -> None:
    cycles = np.array([40.0, 52.0, 60.0])
    finding = of_changed_efforts(
        loaded, tmp_path, lambda q, tau: tau + 2.0 * np.sin(cycles[:, None] * q + 1.0)
    )
    before, _, rest = finding.brief.partition(" (term ")
    assert "With efforts of " in before and "periodic in their positions" in before
    (term,) = tomllib.loads(f"terms = [{rest.partition(')')[0]}]")["terms"]
    order = [loaded.robot.joint_names.index(joint) for joint in term["joints"]]
    assert sorted(order) == [0, 1, 2]
    assert 2.0 * np.pi / np.array(term["period"]) == pytest.approx(cycles[order], rel=5e-3)
    assert isinstance(term_of(term, "advice"), Cogging)


def test_the_strongest_period_is_found() -> None:
    at, rng = np.arange(2000), np.random.default_rng(1)
    counts = rng.integers(0, 5, len(at)).astype(np.float64)
    sums = counts * (0.3 * at / 2000 + np.sin(at / 7.3)) + np.sqrt(counts) * rng.normal(size=2000)
    assert strongest_period(sums, counts, 0.01) == pytest.approx(0.146 * np.pi, rel=1e-3)
    assert strongest_period(sums[:10], counts[:10], 0.01) == NO_PERIOD


def with_body(robot: Robot, index: int, **fields: Any) -> Robot:
    bodies = [
        Body(**{**vars(body), **(fields if k == index else {})})
        for k, body in enumerate(robot.bodies)
    ]
    return robot.changed(bodies=tuple(bodies))


@pytest.mark.slow
def test_noise_alone_says_nothing(loaded: LoadedRobot, tmp_path: Path) -> None:
    assert found(loaded, tmp_path) == ()


@pytest.mark.slow
def test_a_zero_offset_is_named_with_its_value(loaded: LoadedRobot, tmp_path: Path) -> None:
    (finding,) = found(loaded, tmp_path, offset=(0.0, 0.1, 0.0))
    assert finding.severity == Severity.DOUBTFUL and finding.joints == ("shoulder_lift",)
    assert (
        "zero offset of shoulder_lift 0.099" in finding.says
        and "x the measurement noise" in finding.says
    )
    assert finding.fix is not None
    (edit,) = finding.fix.edits
    assert edit.path == ("signals", "position_offset")
    assert edit.value[1] == pytest.approx(0.1, abs=0.005)
    assert [edit.value[0], edit.value[2]] == [0.0] * 2


@pytest.mark.slow
def test_the_last_joint_turns_its_body_and_nothing_else(
    loaded: LoadedRobot, tmp_path: Path
) -> None:
    assert found(loaded, tmp_path, offset=(0.3, 0.0, 0.3)) == ()


@pytest.mark.slow
def test_a_longer_link_is_named(loaded: LoadedRobot, tmp_path: Path) -> None:
    body = loaded.robot.bodies[2]
    (finding,) = found(loaded, tmp_path, with_body(loaded.robot, 2, position=1.1 * body.position))
    assert finding.severity == Severity.DOUBTFUL
    assert "position of joint elbow" in finding.says


@pytest.mark.slow
def test_a_tilted_axis_is_named(loaded: LoadedRobot, tmp_path: Path) -> None:
    body, tilt = loaded.robot.bodies[2], np.deg2rad(5.0)
    turn = np.array([[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]])
    axes = turn if abs(body.axis[0]) < 0.9 else turn[[1, 2, 0]][:, [1, 2, 0]]
    (finding,) = found(loaded, tmp_path, with_body(loaded.robot, 2, rotation=body.rotation @ axes))
    assert finding.severity == Severity.DOUBTFUL and "axis of joint elbow" in finding.says


@pytest.mark.slow
def test_a_tilted_base_is_named_as_such(loaded: LoadedRobot, tmp_path: Path) -> None:
    down = 9.81 * np.array([np.sin(0.05), 0.0, -np.cos(0.05)])
    (finding,) = found(loaded, tmp_path, loaded.robot.changed(gravity=down))
    assert "tilt of the base (axis of shoulder_turn)" in finding.brief
    assert finding.brief.endswith(
        "Check gravity (or mounting) in [robot], its direction in the frame of the base"
    )


@pytest.mark.slow
@pytest.mark.parametrize("term", [Stribeck(speed=0.1), LoadDependent()], ids=lambda t: t.law)
def test_a_friction_law_that_lacks_is_a_remark(
    term: Term, loaded: LoadedRobot, tmp_path: Path
) -> None:
    (finding,) = found(loaded, tmp_path, terms=(*DEFAULT_TERMS, term))
    assert "(worst joint: " in finding.says and "joints above 1.5 x)" in finding.says
    assert finding.severity == Severity.OK and finding.headline
    causes = finding.says.partition("not additive): ")[2]
    assert f"(term {term.law})" in causes.split(",")[0]
    assert "geometry" not in causes  # many columns explain anything; single causes are named
    assert f"(term {term.law}) the error on left-out motion falls from " in finding.brief
    assert finding.brief.endswith(f" % (least squares, fitted logs){incomplete_model.ADD_TERM}")
    assert 'friction = "auto", which takes no fixed law' in finding.brief
    assert finding.says.endswith(
        ". Errors on left-out motion: least squares without prior, cross-validation over runs"
    )


@pytest.mark.slow
def test_a_gain_on_left_out_motion_is_that_of_a_fit_to_the_other_run(
    loaded: LoadedRobot, tmp_path: Path
) -> None:
    paths = [tmp_path / f"run{seed}.parquet" for seed in (1, 2)]
    term = Stribeck(speed=0.1)
    truth = random_truth(loaded.robot, 1, terms=(*DEFAULT_TERMS, term))
    for seed, path in enumerate(paths, start=1):
        log(path, truth, seed)
    fitted = case(loaded, paths)
    cause, gain = fitted.tested[0]
    assert cause.kind == term.law and gain is not None and gain.confirmed
    model, weights = fitted.identified.model, 1.0 / np.square(fitted.identified.estimate.sigma)
    for terms, error in ((model.terms, gain.before), ((*model.terms, term), gain.after)):
        regressor = base_regressor(replace(model, terms=terms))
        first, second = (information_from([run])(regressor) for run in fitted.fitted)
        assert error == pytest.approx(left_out_error(first, second, weights), rel=0.02)


def left_out_error(first: Information, second: Information, weights: Array) -> float:
    """The error on each run from the other [%], by the normal equations themselves."""
    logs = []
    for fitted, tested in ((first, second), (second, first)):
        matrix, vector, _ = fitted.normal(weights)
        scale = np.sqrt(np.diag(matrix))
        values = np.linalg.solve(matrix / scale[:, None] / scale, vector / scale) / scale
        squares, sizes = tested.residual_squares(values), tested.effort_squares()
        typical = np.exp(np.mean(np.log(np.sqrt(squares / sizes))))
        logs.append(np.log(100.0 * np.sqrt(typical * np.sqrt(squares.sum() / sizes.sum()))))
    return float(np.exp(np.mean(logs)))


@pytest.mark.slow
def test_a_term_that_predicts_other_motion_worse_is_not_recommended(tmp_path: Path) -> None:
    loaded = demo_arm(tmp_path, joints=4)
    paths = [tmp_path / f"run{seed}.parquet" for seed in (1, 2)]
    for stiffness, seed, path in zip((6.0, 0.0), (1, 2), paths, strict=True):
        log(path, random_truth(loaded.robot, 1), seed)
        table = pl.read_parquet(path)
        pulled = [pl.col(f"tau{k}_Nm") + stiffness * pl.col(f"q{k}_rad") for k in range(1, 5)]
        table.with_columns(pulled).write_parquet(path)
    fitted = case(loaded, paths)
    (finding,) = model_error_check(fitted)
    assert "a spring (term spring) would explain most" in finding.brief
    gain = fitted.tested[0][1]
    assert gain is not None and gain.after > gain.before
    larger = f"{100.0 * (gain.after / gain.before - 1.0):.0f} % larger with it"
    assert finding.brief.endswith(f": not confirmed on left-out motion (error {larger})")
    assert "Add it" not in finding.brief and finding.fix is None
    run = fitted.fitted[0]
    (once,) = model_error_check(replace(fitted, fitted=(run, run)))
    assert once.brief.endswith("not tested on left-out motion, the logs are too short")


@pytest.mark.slow
@pytest.mark.parametrize("turns", [(0, 1, -1, 0), (0, 2, 0)])
def test_zeros_that_are_quarter_turns_away_are_found(
    turns: tuple[int, ...], tmp_path: Path
) -> None:
    loaded, offset = demo_arm(tmp_path, joints=len(turns)), [0.5 * np.pi * turn for turn in turns]
    (finding,) = found(loaded, tmp_path, offset=offset)
    assert finding.severity == Severity.DOUBTFUL and finding.fix is not None
    assert "joint zeros other than those of the model file: " in finding.brief
    assert "or the axis of the next joint is turned by as much" in finding.fix.says
    (edit,) = finding.fix.edits
    assert edit.path == ("signals", "position_offset")
    np.testing.assert_allclose(np.cos(np.subtract(edit.value, offset)), 1.0, atol=1e-6)


def test_errors_of_models_with_scales_are_to_be_compared_as_logged() -> None:
    spring = Cause("spring", "", "a spring", ("spring.a",), 100.0, 0.5)
    tested = ((spring, LeftOutGain(3.0, 2.0, True, "run")),)
    falls = "With a spring the error on left-out motion falls from 3 to 2 % "
    falls += "(least squares, fitted logs)"
    assert incomplete_model.term_advice(tested, False) == f"{falls}{incomplete_model.ADD_TERM}"
    assert incomplete_model.term_advice(tested, True).startswith(
        f"{falls} at the present effort scales"
    )
    assert incomplete_model.term_advice(tested, True).endswith(
        "only if the error as logged then falls"
    )


def test_a_term_is_not_recommended_where_another_cause_predicts_better() -> None:
    term = Cause("load_dependent", "", "a term", ("a",), 90.0, 0.5)
    other = Cause("saturation", "elbow", "gain of elbow that falls", ("b",), 99.0, 0.6)
    kept = LeftOutGain(1.0, 0.8, True, "run")
    says = incomplete_model.term_advice([(term, kept)], False)
    assert "Add it to [model] terms" in says
    tested = [(other, LeftOutGain(1.0, 0.75, False, "run")), (term, kept)]
    says = incomplete_model.term_advice(tested, False)
    assert "further with gain of elbow that falls: the logs do not decide" in says
    assert "Add it" not in says


def test_what_only_bounds_and_valid_inertias_show_is_said_of_the_intervals(
    loaded: LoadedRobot, tmp_path: Path
) -> None:
    paths = [tmp_path / f"run{seed}.parquet" for seed in (1, 2)]
    for seed, path in enumerate(paths, start=1):
        log(path, random_truth(loaded.robot, 1), seed)
    plain = case(loaded, paths)
    assert model_error_check(plain) == ()
    note = f"physical constraints raise χ² by 300 even without a prior: {TERM_MISSING}"
    estimate = replace(plain.identified.estimate, notes=("another", note))
    fitted = replace(plain, identified=replace(plain.identified, estimate=estimate))
    (finding,) = model_error_check(fitted)
    assert finding.headline
    assert finding.severity is Severity.OK
    assert finding.says == f"{note}; {incomplete_model.INCOMPLETE}"
    assert model_error_check(replace(fitted, fitted=())) == ()
