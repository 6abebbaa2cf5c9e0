"""Errors of what was left out, against fits of stacked samples."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from invented import single, tree
from steelyard.base.errors import DataError
from steelyard.estimate.information.base_parameters_and_regressor import base_regressor
from steelyard.estimate.information.filter_and_gram import Accumulator, Stretch
from steelyard.estimate.information.gather import gather
from steelyard.estimate.information.information import Information, Signature, Window
from steelyard.estimate.least_squares.weighted_robust_and_whitened import (
    OrdinaryLeastSquares,
    WeightedLeastSquares,
)
from steelyard.estimate.scores.cross_validation import (
    FOLDS,
    Folding,
    folding,
    folds_of,
    left_out_errors,
    logarithms,
    longest_window,
    per_fold,
    values_by,
    windows_of_folds,
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


def part(seed: int, run: str) -> tuple[Information, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    q, dq, ddq = rng.normal(size=(3, 4, 150))
    dense = REGRESSOR.dense(q, dq, ddq)
    truth = np.random.default_rng(9).normal(size=len(COLUMNS))
    effort = dense @ truth + np.array([[0.5], [1.0], [2.0], [0.1]]) * rng.normal(size=(4, 150))
    sums = Accumulator(REGRESSOR)(Stretch(q, dq, ddq, effort))
    information = Information(
        REGRESSOR.layout,
        Signature(MODEL.fingerprint, COLUMNS, ("Nm",) * 4, "none"),
        (Window(run, 0.0, 1.0),),
        sums.grams[None],
        sums.absolute[None],
        sums.counts[None],
    )
    return information, dense, effort


def test_errors_are_those_of_dense_fits_to_the_others() -> None:
    parts = [part(k, f"run{k}") for k in range(3)]
    whole = sum((p[0] for p in parts[1:]), parts[0][0])
    found = left_out_errors(whole, whole, values_by(OrdinaryLeastSquares()))
    assert found.shape == (3, 4)
    for fold in range(3):
        others = [p for k, p in enumerate(parts) if k != fold]
        matrix = np.concatenate([p[1].reshape(-1, len(COLUMNS)) for p in others])
        effort = np.concatenate([p[2].ravel() for p in others])
        values = np.linalg.lstsq(matrix, effort, rcond=None)[0]
        _, dense, measured = parts[fold]
        error = np.linalg.norm(measured - dense @ values, axis=1)
        wanted = 100.0 * error / np.linalg.norm(measured, axis=1)
        np.testing.assert_allclose(found[fold], wanted, rtol=1e-8)


def test_what_is_tested_may_be_more_than_what_is_fitted() -> None:
    parts = [part(k, f"run{k}") for k in range(3)]
    extra = [part(10 + k, f"run{k}") for k in range(3)]
    fitted = sum((p[0] for p in parts[1:]), parts[0][0])
    tested = sum((p[0] for p in extra[1:]), extra[0][0])
    found = left_out_errors(fitted, tested, values_by(OrdinaryLeastSquares()))
    matrix = np.concatenate([p[1].reshape(-1, len(COLUMNS)) for p in parts[1:]])
    effort = np.concatenate([p[2].ravel() for p in parts[1:]])
    values = np.linalg.lstsq(matrix, effort, rcond=None)[0]
    error = np.linalg.norm(extra[0][2] - extra[0][1] @ values, axis=1)
    wanted = 100.0 * error / np.linalg.norm(extra[0][2], axis=1)
    np.testing.assert_allclose(found[0], wanted, rtol=1e-8)


def test_columns_that_a_fold_does_not_see_are_left_at_zero_and_dead_rows_have_no_error() -> None:
    parts = [part(k, f"run{k}") for k in range(2)]
    whole = parts[0][0] + parts[1][0]
    some = whole.select(COLUMNS[:4])
    found = left_out_errors(some, some, values_by(WeightedLeastSquares()))
    assert np.all(np.isfinite(found)) and found.min() > 0.0
    dead = whole.scaled(np.array([1.0, 0.0, 1.0, 1.0]), ("Nm",) * 4)
    found = left_out_errors(dead, dead, values_by(OrdinaryLeastSquares()))
    assert np.array_equal(found[:, 1], [0.0, 0.0]) and np.all(found[:, 0] > 0.0)


def swing(name: str, duration: float) -> Run:
    t = np.arange(0.0, duration, 0.01)
    q, effort = np.sin(2.0 * t), np.cos(2.0 * t) + 0.1 * np.sin(5.0 * t)
    one = np.ones(1)
    signals = Signals("t", 1.0, ("q",), one, None, None, ("e",), one, "joint_torque", ("Nm",), one)
    log = LogInMemory(Path(name), ("t", "q", "e"), np.column_stack([t, q, effort]))
    return prepare(Recording(log, signals), Processing(20.0, 8.0))


def test_several_runs_are_a_fold_each() -> None:
    runs = [swing("a", 6.0), swing("b", 6.0), swing("c", 6.0)]
    folds = folds_of(runs)
    windows = [Window("b", 0.0, 1.0), Window("c", 4.0, 5.0), Window("a", 2.0, 3.0)]
    assert [[fold(w) for w in windows] for fold in folds] == [
        [False, False, True],
        [True, False, False],
        [False, True, False],
    ]
    assert longest_window(runs) == float("inf")


def test_one_run_is_cut_into_stretches_of_equal_length() -> None:
    run = swing("a", 30.0)
    folds, longest = folds_of([run]), longest_window([run])
    start, stop = run.span
    assert len(folds) == FOLDS and longest == pytest.approx((stop - start) / 40.0)
    found = gather(base_regressor(Model(single())), run, longest=longest)
    in_folds = [[fold(w) for fold in folds] for w in found.windows]
    assert all(sum(inside) == 1 for inside in in_folds)
    joined = per_fold(found, folds)
    assert len(joined.windows) == FOLDS
    np.testing.assert_allclose(joined.grams.sum(axis=0), found.grams.sum(axis=0))
    counts = joined.counts[:, 0]
    assert counts.max() < 1.4 * counts.min()
    far = Window("a", stop + 5.0, stop + 6.0)
    assert [fold(far) for fold in folds] == [False] * (FOLDS - 1) + [True]


def test_a_fold_with_nothing_in_it_is_refused() -> None:
    found = part(0, "short")[0]
    with pytest.raises(DataError, match="too short to leave a part of it out") as caught:
        per_fold(found, folds_of([swing("a", 6.0)]))
    assert caught.value.where == "short"
    assert 'instead of "auto"' in caught.value.fix


def test_folds_come_in_their_order() -> None:
    parts = [part(k, name) for k, name in enumerate(("b", "a", "b"))]
    whole = sum((p[0] for p in parts[1:]), parts[0][0])
    joined = per_fold(whole, folds_of([swing("a", 6.0), swing("b", 6.0)]))
    assert [w.run for w in joined.windows] == ["a", "b"]
    np.testing.assert_allclose(joined.grams[1], whole.grams[0] + whole.grams[2])
    assert replace(joined).n_samples[0] == 450


def test_runs_of_one_name_are_refused() -> None:
    with pytest.raises(DataError, match="2 runs are called 'a'") as caught:
        folds_of([swing("a", 6.0), swing("b", 6.0), swing("a", 6.0)])
    assert caught.value.fix == "give every run a name of its own"


def test_where_a_joint_moves_in_one_run_only_stretches_are_left_out() -> None:
    both = [swing("a", 20.0), swing("b", 20.0)]
    assert folding(both).left_out == "run"
    still = replace(both[1], quality=replace(both[1].quality, max_speed=np.array([0.01])))
    found = folding([both[0], still])
    assert found.left_out == "segment" and found.longest == longest_window([both[0]])
    regressor = base_regressor(Model(single()))
    moving = gather(regressor, both[0], longest=found.longest)
    moving += gather(regressor, both[1], longest=found.longest)
    parts = found.parts(moving)
    inside = np.array([[part(w) for w in moving.windows] for part in parts])
    assert len(parts) == FOLDS and np.all(inside.sum(axis=0) == 1)
    for part in inside:
        assert {w.run for w, mine in zip(moving.windows, part, strict=True) if mine} == {"a", "b"}


def test_stretches_have_as_much_motion_each() -> None:
    """A long rest at the start is in the first of them."""
    run = swing("a", 40.0)
    moving = gather(base_regressor(Model(single())), run, longest=0.5)
    late = moving.of([k for k, w in enumerate(moving.windows) if w.start > 30.0])
    parts = Folding("segment", 0.5).parts(late)
    counts = per_fold(late, parts).counts[:, 0]
    assert len(parts) == FOLDS and counts.max() < 1.7 * counts.min()
    early = per_fold(moving, parts)
    assert early.windows[0].start == moving.windows[0].start
    np.testing.assert_allclose(early.counts.sum(), moving.counts.sum())


def test_rows_that_do_not_count_have_no_say() -> None:
    errors, sizes = np.array([[5.0, 0.0]]), np.array([[2.0, 0.0]])
    assert np.exp(logarithms(errors, sizes))[0] == pytest.approx(5.0)


@pytest.mark.parametrize(
    ("motion", "sizes"),
    [
        ([100.0] * 8 + [2.0], [200, 200, 200, 202]),  # as runs are cut: eight windows and a rest
        ([100.0] * 40 + [2.0], [800, 800, 800, 800, 802]),
        ([100.0] * 5, [100] * 5),
        ([100.0, 2.0], [100, 2]),
        ([100.0], []),
        ([], []),
    ],
)
def test_what_is_left_at_the_end_of_a_run_is_no_stretch(
    motion: list[float], sizes: list[int]
) -> None:
    one, _, _ = part(1, "a")
    windows = tuple(Window("a", float(k), k + 1.0) for k in range(len(motion)))
    counts = np.repeat(np.array(motion)[:, None], 4, axis=1)
    folds = windows_of_folds(replace(one, windows=windows, counts=counts))
    assert [sum(motion[k] for k in fold) for fold in folds] == sizes
    assert [k for fold in folds for k in fold] == list(range(len(motion) if sizes else 0))
