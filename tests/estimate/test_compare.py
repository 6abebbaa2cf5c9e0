"""Estimators beside each other: errors against dense fits, failures, stops, and the advice."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from invented import single, tree
from steelyard.base.arrays import Parameters
from steelyard.base.errors import DataError
from steelyard.base.progress import Event, Stopped, report_progress
from steelyard.estimate.consistent.convex_estimator import Consistent
from steelyard.estimate.estimate import Estimate, StandardEstimate
from steelyard.estimate.estimator_register import ESTIMATORS, Context, Offer
from steelyard.estimate.information.base_parameters_and_regressor import base_regressor
from steelyard.estimate.information.filter_and_gram import Accumulator, Stretch
from steelyard.estimate.information.gather import gather
from steelyard.estimate.information.information import Information, Signature, Window
from steelyard.estimate.least_squares.weighted_robust_and_whitened import (
    OrdinaryLeastSquares,
    WeightedLeastSquares,
)
from steelyard.estimate.prior.body_priors import default_knowledge
from steelyard.estimate.scores.cross_validation import longest_window
from steelyard.estimate.scores.estimator_comparison import (
    Comparison,
    EstimatorScore,
    Parts,
    compare,
    impossible_bodies,
    recommended,
)
from steelyard.model.model import Model
from steelyard.robot.file.signals import Signals
from steelyard.runs.prepare import prepare
from steelyard.runs.processing_choices import Processing
from steelyard.runs.recording import LogInMemory, Recording
from steelyard.runs.run import Run

MODEL = Model(tree())
REGRESSOR = base_regressor(MODEL)
COLUMNS = REGRESSOR.layout.columns
CONTEXT = Context(REGRESSOR, default_knowledge(MODEL))
NOISE = np.array([[0.5], [1.0], [2.0], [0.1]])


def motion_of(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return tuple(np.random.default_rng(seed).normal(size=(3, 4, 150)))  # type: ignore[return-value]


def measured(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Dense regressor `(4, 150, p)` and noisy efforts `(4, 150)` of the robot's own bodies."""
    dense = REGRESSOR.dense(*motion_of(seed))
    prior = [p.prior or 0.0 for p in MODEL.parameters]
    noise = NOISE * np.random.default_rng(100 + seed).normal(size=(4, 150))
    return dense, dense @ REGRESSOR.base.base_values(prior) + noise


def parts_of(count: int = 4, **more: Any) -> Parts:
    found: list[Information] = []
    for seed in range(count):
        sums = Accumulator(REGRESSOR)(Stretch(*motion_of(seed), measured(seed)[1]))
        pieces = (x[None] for x in (sums.grams, sums.absolute, sums.counts))
        signature = Signature(MODEL.fingerprint, COLUMNS, ("Nm",) * 4, "none")
        window = Window(f"run{seed}", 0.0, 1.0)
        found.append(Information(REGRESSOR.layout, signature, (window,), *pieces))
    whole = sum(found[1:], found[0])
    names = tuple(f"run{seed}" for seed in range(count))
    windows = tuple((seed,) for seed in range(count))
    return Parts(names, "run", whole, windows, more.get("others", {}))


def offer(name: str, make: Callable[[Information], Estimate], **more: Any) -> Offer:
    return Offer(name, "invented", lambda _: make, **more)


LEAST = offer("OLS", OrdinaryLeastSquares())
WEIGHTED = offer("WLS", WeightedLeastSquares())


def score(comparison: Comparison, name: str) -> EstimatorScore:
    (found,) = [one for one in comparison.scores if one.name == name]
    return found


def test_errors_are_those_of_dense_fits_to_the_other_runs() -> None:
    found = score(compare([LEAST], CONTEXT, parts_of()), "OLS")
    assert found.errors.shape == (4, 4) and not found.failures
    for left in range(4):
        others = [measured(k) for k in range(4) if k != left]
        matrix = np.concatenate([dense.reshape(-1, len(COLUMNS)) for dense, _ in others])
        effort = np.concatenate([tau.ravel() for _, tau in others])
        values = np.linalg.lstsq(matrix, effort, rcond=None)[0]
        dense, tau = measured(left)
        gap = tau - dense @ values
        wanted = 100.0 * np.linalg.norm(gap, axis=1) / np.linalg.norm(tau, axis=1)
        np.testing.assert_allclose(found.errors[left], wanted, rtol=1e-7)
        pooled = 100.0 * np.linalg.norm(gap) / np.linalg.norm(tau)
        assert found.pooled[left] == pytest.approx(pooled, rel=1e-7)
    means = found.errors.mean(axis=1)
    assert found.mean == pytest.approx(means.mean())
    assert found.standard_error == pytest.approx(means.std(ddof=1) / 2.0)


def test_figures_of_the_fit_to_all_data() -> None:
    comparison = compare([LEAST, WEIGHTED], CONTEXT, parts_of())
    plain, weighted = score(comparison, "OLS"), score(comparison, "WLS")
    assert weighted.chi_square == pytest.approx(1.0, abs=1e-3)
    assert plain.chi_square is not None and plain.chi_square > weighted.chi_square
    assert weighted.parameters == len(COLUMNS) and weighted.impossible is None
    assert weighted.seconds is not None and 0.0 < weighted.seconds < 5.0
    assert weighted.condition is not None and weighted.condition > 1.0


def singular(data: Information) -> Estimate:
    raise np.linalg.LinAlgError("Singular matrix")


def short(data: Information) -> Estimate:
    raise DataError("the data are too few", where="here", fix="log longer")


def broken(data: Information) -> Estimate:
    if "run2" not in {window.run for window in data.windows}:
        raise ZeroDivisionError("division by zero\nand more")
    return OrdinaryLeastSquares()(data)


def blown(data: Information) -> Estimate:
    found = OrdinaryLeastSquares()(data)
    undefined = found.parameters.values * np.nan
    return replace(found, parameters=replace(found.parameters, values=undefined))


def test_an_estimator_that_fails_says_why_and_stops_no_other() -> None:
    failing = {"singular": singular, "short": short, "broken": broken, "blown": blown}
    offers = [offer(name, make) for name, make in failing.items()]
    comparison = compare([*offers, LEAST], CONTEXT, parts_of())
    assert [one.name for one in comparison.scores] == [*failing, "OLS"]
    reasons = {one.name: {f.reason for f in one.failures} for one in comparison.scores}
    assert reasons["singular"] == {"a matrix cannot be solved with (singular matrix)"}
    assert reasons["short"] == {"the data are too few"}
    assert score(comparison, "short").failures[0].fix == "log longer"
    assert reasons["broken"] == {"it failed: ZeroDivisionError: division by zero"}
    assert [f.left_out for f in score(comparison, "broken").failures] == ["run2"]
    assert reasons["blown"] == {"its values are not finite"}
    assert reasons["OLS"] == set()
    assert score(comparison, "short").mean is None
    assert score(comparison, "short").mean_text == "no error"
    known = np.delete(score(comparison, "OLS").means, 2).mean()
    assert score(comparison, "broken").mean == pytest.approx(known)
    advice = comparison.advice
    assert advice is not None and advice.name == "OLS"
    assert compare([offers[0]], CONTEXT, parts_of()).advice is None


def test_data_that_cannot_be_had_are_a_reason() -> None:
    recording_offers = [
        offer("of samples", OrdinaryLeastSquares(), needs="samples"),
        offer("of experiments", OrdinaryLeastSquares(), needs="experiment"),
    ]

    def refuse(information: Information) -> None:
        raise DataError("there is but one run", where="here", fix="give two")

    parts = parts_of(others={"samples": lambda given: given, "experiment": refuse})
    comparison = compare(recording_offers, CONTEXT, parts)
    samples, experiment = comparison.scores
    assert not samples.failures
    assert {(f.reason, f.fix) for f in experiment.failures} == {
        ("there is but one run", "give two")
    }


def test_other_data_come_from_the_same_runs() -> None:
    folds: list[tuple[int, ...]] = []

    def samples(information: Information) -> Information:
        folds.append(tuple(int(window.run[-1]) for window in information.windows))
        return information

    parts = parts_of(others={"samples": samples})
    looking = offer("of samples", OrdinaryLeastSquares(), needs="samples")
    comparison = compare([looking, LEAST], CONTEXT, parts)
    assert folds == [(0, 1, 2, 3), (1, 2, 3), (0, 2, 3), (0, 1, 3), (0, 1, 2)]
    mine, others = (score(comparison, name) for name in ("of samples", "OLS"))
    np.testing.assert_array_equal(mine.errors, others.errors)


def test_the_cheap_come_first_and_a_stop_keeps_what_is_done() -> None:
    slow = offer("slow", OrdinaryLeastSquares(), slow=True)
    looking = offer("of samples", OrdinaryLeastSquares(), needs="samples")
    parts = parts_of(others={"samples": lambda given: given})
    seen: list[str] = []

    def watch(event: Event) -> bool:
        seen.append(event.phase)
        return "slow" not in event.phase

    comparison = compare([slow, looking, LEAST], CONTEXT, parts, progress=watch)
    assert [one.name for one in comparison.scores] == ["OLS", "of samples"]
    assert comparison.untried == ("slow",)
    assert seen[0] == "fitting with OLS" and seen[-1] == "fitting with slow"


def test_an_estimator_that_is_stopped_has_not_failed() -> None:
    def searching(data: Information) -> Estimate:
        report_progress(lambda _: False, "searching", 1, 2)
        raise AssertionError

    offers = [LEAST, offer("search", searching, slow=True)]
    assert compare(offers, CONTEXT, parts_of()).untried == ("search",)
    with pytest.raises(Stopped):
        compare(offers[1:], CONTEXT, parts_of())


def with_bodies(masses: float) -> Estimate:
    """The robot's nominal bodies with scaled masses, inertias as they are."""
    values = np.array([p.prior or 0.0 for p in MODEL.parameters])
    for k, name in enumerate(MODEL.names):
        values[k] *= masses if name.startswith("m.") else 1.0
    plain = OrdinaryLeastSquares()(parts_of().information)
    size = len(values)
    standard = StandardEstimate(
        Parameters(MODEL.names, MODEL.units, values), np.zeros((size, size)), np.zeros(size)
    )
    return replace(plain, standard=standard)


def test_bodies_that_cannot_exist_are_named() -> None:
    knowledge = CONTEXT.knowledge
    assert impossible_bodies(with_bodies(1.0), knowledge) == ()
    assert impossible_bodies(with_bodies(-1.0), knowledge) == knowledge.bodies
    assert impossible_bodies(OrdinaryLeastSquares()(parts_of().information), knowledge) is None


def test_an_estimate_with_bodies_is_judged_by_them() -> None:
    found = score(
        compare([offer("nominal", lambda _: with_bodies(1.0))], CONTEXT, parts_of()), "nominal"
    )
    assert found.valid and found.parameters == len(MODEL.names)
    for left in range(4):
        _, tau = measured(left)
        noise = NOISE * np.random.default_rng(100 + left).normal(size=(4, 150))
        wanted = 100.0 * np.linalg.norm(noise, axis=1) / np.linalg.norm(tau, axis=1)
        np.testing.assert_allclose(found.errors[left], wanted, rtol=1e-6)


def score_of(name: str, means: list[float], **more: Any) -> EstimatorScore:
    """A score of one joint with given errors."""
    errors = np.array(means)[:, None]
    plain = EstimatorScore(
        name, "invented", "information", False, errors, errors[:, 0], 0.01, 9, 5.0, 1.0, None
    )
    return replace(plain, **more)


def test_a_possible_model_is_preferred_to_one_that_is_better_by_chance() -> None:
    best = score_of("WLS", [3.0, 4.0, 2.0, 3.0])
    possible = score_of("consistent", [3.2, 3.9, 2.3, 2.9], impossible=())
    advice = recommended([best, possible])
    assert advice is not None and advice.name == "consistent"
    assert advice.why == (
        "WLS: 3.00 ± 0.41 %; consistent: 3.07 ± 0.33 %, within one standard error of the "
        "difference, and its inertias are valid: consistent is recommended"
    )


def test_what_is_worse_on_every_run_is_not_taken_however_the_runs_differ() -> None:
    best = score_of("WLS", [3.0, 30.0, 2.0, 9.0])
    possible = score_of("plain", [3.3, 33.1, 2.2, 9.8], impossible=())
    advice = recommended([best, possible])
    assert advice is not None and advice.name == "WLS"
    assert advice.why == "WLS: 11.0 ± 6.5 %, the least error"


def test_what_is_hardly_worse_is_as_good() -> None:
    best = score_of("WLS", [3.00, 4.00, 2.00])
    possible = score_of("consistent", [3.03, 4.03, 2.03], impossible=())
    advice = recommended([best, possible])
    assert advice is not None and advice.name == "consistent"


def test_among_alike_ones_the_cheap_is_taken() -> None:
    best = score_of("search", [3.0, 4.0, 2.0], slow=True)
    samples = score_of("robust", [3.0, 4.1, 2.0], needs="samples")
    cheap = score_of("WLS", [3.1, 4.0, 2.0])
    advice = recommended([best, samples, cheap])
    assert advice is not None and advice.name == "WLS"
    assert "it is simpler" in advice.why
    broken_body = score_of("plain", [2.9, 3.9, 1.9], impossible=("link 2",))
    assert recommended([broken_body, cheap]) is not None
    assert not broken_body.valid


def test_of_equals_the_first_is_taken_however_small_the_gain_of_another() -> None:
    first, second = score_of("WLS", [3.0, 4.0, 2.0]), score_of("RLS", [2.99, 3.99, 1.99])
    advice = recommended([first, second])
    assert advice is not None and advice.name == "WLS" and "it is simpler" in advice.why
    better = score_of("bounded", [2.8, 3.8, 1.7])
    advice = recommended([first, better])
    assert advice is not None and advice.name == "bounded"


def test_a_great_loss_counts_however_it_scatters() -> None:
    best = score_of("WLS", [3.0, 4.0, 2.0])
    wild = score_of("consistent", [9.0, 3.9, 1.9], impossible=())
    advice = recommended([best, wild])
    assert advice is not None and advice.name == "WLS"


def test_a_joint_that_does_not_move_has_no_error(monkeypatch: pytest.MonkeyPatch) -> None:
    parts = parts_of()
    whole = score(compare([LEAST], CONTEXT, parts), "OLS")
    sizes, kept = Information.effort_squares, parts.information

    def still(self: Information) -> np.ndarray:
        moving = np.array([1.0, 0.0, 1.0, 1.0]) if self.windows == kept.windows[1:2] else 1.0
        return sizes(self) * moving

    monkeypatch.setattr(Information, "effort_squares", still)
    found = score(compare([LEAST], CONTEXT, parts), "OLS")
    assert np.argwhere(np.isnan(found.errors)).tolist() == [[1, 1]]
    assert found.means[1] == pytest.approx(np.delete(whole.errors[1], 1).mean())
    assert found.by_joint[1] == pytest.approx(np.delete(whole.errors[:, 1], 1).mean())
    assert found.whole and found.mean == pytest.approx(found.means.mean())
    assert found.to_dict()["errors_percent"][1][1] is None
    assert found.to_dict()["pooled_percent"] == pytest.approx(found.pooled.mean())


def test_a_part_in_which_nothing_moves_counts_nowhere() -> None:
    quiet = score_of("WLS", [3.0, np.nan, 5.0])
    assert quiet.mean == 4.0 and quiet.whole and not quiet.failed.any()
    assert not score_of("WLS", [np.nan, np.nan]).whole
    assert score_of("WLS", [np.nan, np.nan]).mean_text == "no error"
    advice = recommended([quiet, score_of("OLS", [30.0, np.nan, 50.0])])
    assert advice is not None and advice.name == "WLS" and "two parts are few" in advice.why


def test_predictions_that_are_not_finite_are_a_failure() -> None:
    def huge(data: Information) -> Estimate:
        found = OrdinaryLeastSquares()(data)
        values = found.parameters.values * 1e300
        return replace(found, parameters=replace(found.parameters, values=values))

    found = score(compare([offer("huge", huge)], CONTEXT, parts_of()), "huge")
    assert {f.reason for f in found.failures} == {"its predictions are not finite"}
    assert found.failed.all() and not found.whole and found.mean is None


def test_what_is_worse_than_predicting_zero_is_not_recommended() -> None:
    advice = recommended(
        [score_of("WLS", [130.0, 110.0, 120.0]), score_of("OLS", [200.0, 150.0, 300.0])]
    )
    assert advice is not None and advice.name is None
    assert "WLS: 120" in advice.why and "nothing is better than predicting zero" in advice.why
    enough = recommended([score_of("WLS", [90.0, 110.0, 95.0])])
    assert enough is not None and enough.name == "WLS" and "parts are few" not in enough.why


@pytest.mark.slow
def test_equal_weights_reach_the_consistent_estimates() -> None:
    data, by_name = parts_of().information, {o.name: o for o in ESTIMATORS}
    for name in ("consistent", "pullback", "SDP"):
        noise, equal = (
            by_name[name].make(replace(CONTEXT, equal=one))(data).values.values
            for one in (False, True)
        )
        assert not np.allclose(noise, equal, rtol=1e-4), name
    wanted = Consistent(REGRESSOR.base, CONTEXT.knowledge, equal=True)(data).values.values
    made = by_name["consistent"].make(replace(CONTEXT, equal=True))(data).values.values
    np.testing.assert_array_equal(made, wanted)


def test_what_keeps_no_parameters_of_single_runs_says_so() -> None:
    context = replace(CONTEXT, per_run=(COLUMNS[-1],))
    refusing = {"RLS", "IV", "DIDIM", "CLOE", "EKF", "reduced", "genetic"}
    for one in ESTIMATORS:
        if one.name in refusing:
            with pytest.raises(DataError, match="does not estimate parameters per run") as caught:
                one.make(context)
            assert caught.value.where == COLUMNS[-1] and "per_run = true" in caught.value.fix
        else:
            one.make(context)
    (rls,) = compare([o for o in ESTIMATORS if o.name == "RLS"], context, parts_of()).scores
    assert {f.reason for f in rls.failures} == {"it does not estimate parameters per run"}


def test_a_trial_with_a_failure_is_never_taken() -> None:
    partly = score_of("partly", [1.0, np.inf, 1.0])
    sound = score_of("sound", [3.0, 3.0, 3.5])
    advice = recommended([partly, sound])
    assert advice is not None and advice.name == "sound"
    assert partly.mean == 1.0


def test_json_has_no_value_that_json_lacks() -> None:
    import json

    comparison = compare([LEAST, offer("broken", broken)], CONTEXT, parts_of())
    found = json.loads(json.dumps(comparison.to_dict(), allow_nan=False))
    assert found["recommended"]["name"] == "OLS" and found["stopped_before"] == []
    one = found["estimators"][1]
    assert one["errors_percent"][2] == [None] * 4 and one["pooled_percent"] is None
    assert one["failures"][0]["left_out"] == "run2"


@pytest.mark.slow
def test_every_registered_estimator_of_information_can_be_compared() -> None:
    offers = [o for o in ESTIMATORS if o.needs == "information" and not o.slow]
    for one in compare(offers, CONTEXT, parts_of()).scores:
        assert one.whole, (one.name, one.failures)
        assert one.mean is not None and one.mean < 100.0


def test_a_part_without_windows_is_refused() -> None:
    run = swing("short", 6.0)
    with pytest.raises(DataError, match="too short to leave a part of it out") as caught:
        Parts.of([run], parts_of().information.of([0]), {})
    assert caught.value.where == "short" and caught.value.fix == "log longer, or several runs"


def test_stretches_of_one_run_are_named_by_their_time() -> None:
    run = swing("one", 30.0)
    regressor = base_regressor(Model(single()))
    parts = Parts.of([run], gather(regressor, run, longest=longest_window([run])), {})
    assert parts.left_out == "segment" and len(parts.names) == 5
    starts = [float(name.split()[0]) for name in parts.names]
    np.testing.assert_allclose(np.diff(starts), (run.span[1] - run.span[0]) / 5.0, atol=0.1)
    assert sorted(k for part in parts.windows for k in part) == list(
        range(len(parts.information.windows))
    )


def swing(name: str, duration: float) -> Run:
    t = np.arange(0.0, duration, 0.01)
    q, effort = np.sin(2.0 * t), np.cos(2.0 * t) + 0.1 * np.sin(5.0 * t)
    one = np.ones(1)
    signals = Signals("t", 1.0, ("q",), one, None, None, ("e",), one, "joint_torque", ("Nm",), one)
    log = LogInMemory(Path(name), ("t", "q", "e"), np.column_stack([t, q, effort]))
    return prepare(Recording(log, signals), Processing(20.0, 8.0))
