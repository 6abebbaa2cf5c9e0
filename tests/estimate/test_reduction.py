"""Model reduction on data whose truth is known, against dense least squares."""

from collections.abc import Callable
from dataclasses import replace
from functools import reduce as joined
from operator import add

import numpy as np
import pytest

from drawn import motion_of, samples_of
from invented import dh_arm
from steelyard.base.arrays import Array
from steelyard.base.errors import DataError, ModelError, SteelyardError
from steelyard.estimate.estimate import Estimate
from steelyard.estimate.information.base_parameters_and_regressor import base_regressor
from steelyard.estimate.information.kept_filtered_samples import FilteredSamples
from steelyard.estimate.least_squares.weighted_robust_and_whitened import WeightedLeastSquares
from steelyard.estimate.reduction.backward_elimination_and_left_out_errors import (
    CRITERIA,
    Criterion,
    FullModel,
    State,
    backward,
    folds_of,
    left_out_errors,
)
from steelyard.estimate.reduction.stopping_rules_and_reduction import (
    ONE_STANDARD_ERROR,
    RULES,
    StoppingRule,
    condition_limit,
    count,
    criterion_of,
    deviation_ratio,
    reduce,
    reduced,
    rule_of,
    within_tolerance,
)
from steelyard.identify.page.reduction_and_removals import _joints_judged
from steelyard.model.model import Model
from steelyard.report.words import significant

REGRESSOR = base_regressor(Model(dh_arm()))
JOINTS = len(REGRESSOR.layout.rows)
NAMES = REGRESSOR.layout.columns
ZERO = NAMES[1::3]
LOSS, CONTRIBUTION, MEAN_COLUMN, DEVIATION = CRITERIA


def truth_of(seed: int = 0) -> Array:
    values = np.random.default_rng(seed).uniform(0.5, 1.5, len(NAMES))
    values[[NAMES.index(name) for name in ZERO]] = 0.0
    return values


def samples(runs: int = 4, noise: float = 0.3, seed: int = 0, count: int = 240) -> FilteredSamples:
    """Runs of an arm some of whose parameters are zero."""
    parts = []
    for run in range(runs):
        motion = motion_of(JOINTS, count, seed + run)
        drawn = np.random.default_rng([seed, run]).normal(size=(JOINTS, count))
        effort = (
            REGRESSOR.dense(*motion) @ truth_of() + noise * np.array([[1.0], [3.0], [0.2]]) * drawn
        )
        parts.append(samples_of(REGRESSOR, motion, effort, f"run{run}"))
    return joined(add, parts)


DATA = samples().information()
FULL = FullModel.of(DATA)


def dense(some: FilteredSamples) -> tuple[Array, Array, Array]:
    """Regressor, efforts and weights of all rows, one below the other."""
    blocks, efforts, weights = [], [], []
    for row, seen in enumerate(some.layout.sees):
        block = np.zeros((len(some.rows[row]), len(NAMES)))
        block[:, list(seen)] = some.rows[row][:, :-1]
        blocks.append(block)
        efforts.append(some.rows[row][:, -1])
        weights.append(np.full(len(block), 1.0 / FULL.variances[row]))
    return np.vstack(blocks), np.concatenate(efforts), np.concatenate(weights)


A, B, W = dense(samples())
ROWS = [len(rows) for rows in samples().rows]


def fitted(columns: list[int]) -> tuple[Array, float]:
    """Weighted least squares of some columns, and its squares."""
    root = np.sqrt(W)
    found, *_ = np.linalg.lstsq(A[:, columns] * root[:, None], B * root, rcond=None)
    return found, float(np.sum(W * np.square(B - A[:, columns] @ found)))


def test_every_state_is_the_refit_with_the_weights_of_the_full_model() -> None:
    for state in backward(FULL, LOSS).states:
        wanted, squares = fitted(list(state.active))
        np.testing.assert_allclose(state.values, wanted, rtol=1e-7, atol=1e-9)
        assert np.sum(state.squares / FULL.variances) == pytest.approx(squares, rel=1e-9)
        some = A[:, list(state.active)] * np.sqrt(W)[:, None]
        unit = np.linalg.svd(some / np.linalg.norm(some, axis=0), compute_uv=False)
        assert state.condition == pytest.approx(unit[0] / unit[-1], rel=1e-6)


def test_the_loss_is_the_rise_of_chi_squared_where_residuals_are_white() -> None:
    white = replace(FULL, scores=FULL.matrix)
    state = State(white, tuple(range(len(NAMES))))
    _, before = fitted(list(range(len(NAMES))))
    for column, loss in enumerate(state.losses):
        _, after = fitted([k for k in range(len(NAMES)) if k != column])
        assert loss == pytest.approx(after - before, rel=1e-5, abs=1e-6)
        assert state.ratios[column] ** 2 == pytest.approx(loss, rel=1e-9)


def test_contributions_and_mean_columns_are_those_of_the_papers() -> None:
    state = State(FULL, tuple(range(len(NAMES))))
    torques = np.linalg.norm(A * state.values, axis=0)
    np.testing.assert_allclose(CONTRIBUTION.worth(state), torques / torques.sum(), rtol=1e-9)
    np.testing.assert_allclose(MEAN_COLUMN.worth(state), np.abs(A).mean(axis=0), rtol=1e-9)


@pytest.mark.parametrize("criterion", [CONTRIBUTION, MEAN_COLUMN], ids=lambda c: c.name)
def test_the_criterion_of_every_parameter_is_that_of_the_model_it_last_was_in(
    criterion: Criterion,
) -> None:
    found = reduce(DATA, criterion, count(len(NAMES) - 3), drop=NAMES[:1])
    rows = {row["name"]: row for row in found.worth()}
    assert list(rows)[:3] == [one.name for one in found.estimate.removed]
    assert rows.keys() == set(NAMES)

    def by_hand(columns: list[int]) -> Array:
        if criterion is MEAN_COLUMN:
            return np.asarray(np.abs(A[:, columns]).mean(axis=0))
        torques = np.linalg.norm(A[:, columns] * fitted(columns)[0], axis=0)
        return np.asarray(torques / torques.sum())

    left = list(range(len(NAMES)))
    np.testing.assert_allclose([rows[name]["before"] for name in NAMES], by_hand(left), rtol=1e-7)
    for one in found.estimate.removed:
        place = left.index(NAMES.index(one.name))
        assert rows[one.name]["last"] == one.worth == pytest.approx(by_hand(left)[place], rel=1e-7)
        assert rows[one.name]["step"] == one.step
        assert one.step == 1 or by_hand(left).argmin() == place
        del left[place]
    kept = [rows[NAMES[k]] for k in left]
    np.testing.assert_allclose([row["last"] for row in kept], by_hand(left), rtol=1e-7)
    assert all(row["step"] is None for row in kept)
    again = Estimate.from_dict(found.estimate.to_dict())
    assert again.removed == found.estimate.removed


def test_joints_that_weigh_the_same_are_ordinary_least_squares() -> None:
    found = reduce(DATA, CONTRIBUTION, count(len(NAMES) - 2), equal=True)
    left = list(range(len(NAMES)))
    for one in found.estimate.removed:
        torques = np.linalg.norm(A[:, left] * np.linalg.lstsq(A[:, left], B)[0], axis=0)
        place = int(torques.argmin())
        assert one.name == NAMES[left[place]]
        assert one.worth == pytest.approx(torques[place] / torques.sum(), rel=1e-7)
        del left[place]
    wanted = np.linalg.lstsq(A[:, left], B)[0]
    np.testing.assert_allclose(found.estimate.parameters.values, wanted, rtol=1e-7)
    np.testing.assert_allclose(found.state.values, wanted, rtol=1e-7)
    assert found.estimate.estimator.startswith("reduced ordinary least squares")
    # losses are of the variance that each row's own noise has: of A⁺ R A⁺ᵀ
    state = State(FullModel.of(DATA, equal=True), tuple(range(len(NAMES))))
    noise, inverse = np.repeat(FULL.variances * FULL.factors, ROWS), np.linalg.pinv(A)
    variances = np.sum(np.square(inverse) * noise, axis=1)
    np.testing.assert_allclose(state.losses, np.square(inverse @ B) / variances, rtol=1e-6)


def test_algorithm_1_on_a_case_by_hand() -> None:
    """Columns alike but for their size, one row: what a removal costs is known in closed form.

    The columns are orthogonal to each other and to residuals of root mean square 1, with mean
    absolute values 1, 2, 3 and 4, so that they are tried in this order. Without a column of value
    v and mean absolute value m the error rises to sqrt(1 + c v² m²) with c near pi / 2: for values
    0, 0.01, 10 and 0.1 by 0, 0.03, 4000 and 12 %. Those above 5 % become essential, and the loop
    goes on to the next.
    """
    rng = np.random.default_rng(5)
    count = 4000
    q, _ = np.linalg.qr(np.column_stack([rng.normal(size=(count, 4)), rng.normal(size=count)]))
    columns = q[:, :4] / np.abs(q[:, :4]).mean(axis=0) * np.array([1.0, 2.0, 3.0, 4.0])
    noise = q[:, 4] * np.sqrt(count)
    effort = columns @ np.array([0.0, 0.01, 10.0, 0.1]) + noise
    path = backward(_by_hand(columns, effort), MEAN_COLUMN, accepts=within_tolerance(0.05).accepts)
    assert [step.name for step in path.steps] == ["a", "b"]
    assert path.essential == ("c", "d")
    kept = backward(
        _by_hand(columns, effort), MEAN_COLUMN, keep=("a",), accepts=within_tolerance(0.05).accepts
    )
    assert [step.name for step in kept.steps] == ["b"]
    assert kept.essential == ("a", "c", "d")


def _by_hand(columns: Array, effort: Array) -> FullModel:
    from steelyard.estimate.information.base_parameters_and_regressor import Layout
    from steelyard.estimate.information.information import Information, Signature, Window

    joined_columns = np.column_stack([columns, effort])
    gram = joined_columns.T @ joined_columns
    layout = Layout(tuple("abcd"), ("Nm",) * 4, ("joint",), ((0, 1, 2, 3),))
    return FullModel.of(
        Information(
            layout,
            Signature("by hand", layout.columns, ("Nm",), "none"),
            (Window("run", 0.0, 1.0),),
            gram[np.tril_indices(5)][None],
            np.abs(joined_columns).sum(axis=0)[None],
            np.array([[float(len(effort))]]),
        )
    )


def test_parameters_that_are_zero_go_first_and_no_others() -> None:
    found = reduce(DATA)
    removed = {one.name for one in found.estimate.removed}
    assert removed <= set(ZERO) and len(removed) >= len(ZERO) - 2
    assert found.estimate.removed[0].cost < 15.0
    assert set(found.estimate.parameters.names) == set(NAMES) - removed
    assert [one.step for one in found.estimate.removed] == list(range(1, len(removed) + 1))


def test_left_out_errors_are_those_of_a_path_of_the_other_runs() -> None:
    found = left_out_errors(DATA, lambda full: backward(full, LOSS))
    assert found.folds == ("run0", "run1", "run2", "run3")
    some = samples()
    for fold, size in ((0, len(NAMES)), (2, len(NAMES) - 4), (3, 5)):
        others = [k for k, w in enumerate(DATA.windows) if w.run != f"run{fold}"]
        path = backward(FullModel.of(DATA.of(others)), LOSS)
        state = path.states[path.sizes.index(size)]
        at = some.of(some.source == fold)
        for row, seen in enumerate(at.layout.sees):
            values = state.all_values[list(seen)]
            rest = at.rows[row][:, -1] - at.rows[row][:, :-1] @ values
            wanted = 100.0 * np.linalg.norm(rest) / np.linalg.norm(at.rows[row][:, -1])
            got = found.errors[fold, found.sizes.index(size), row]
            assert got == pytest.approx(wanted, rel=1e-9)
    assert found.rise[found.best] == 0.0 and found.spread[found.best] == 0.0


def loud_and_quiet() -> FilteredSamples:
    """Two runs; only the quiet one shows parameters a tenth of the others."""
    values, parts = truth_of(70), []
    values[np.random.default_rng(70).choice(len(NAMES), 6, replace=False)] *= 0.1
    for run, noise in enumerate((0.3, 0.02)):
        motion = motion_of(JOINTS, 240, 70 + run)
        drawn = np.random.default_rng([70, run]).normal(size=(JOINTS, 240))
        effort = REGRESSOR.dense(*motion) @ values + noise * drawn
        parts.append(samples_of(REGRESSOR, motion, effort, f"run{run}"))
    return joined(add, parts)


@pytest.mark.parametrize(
    "rule", [ONE_STANDARD_ERROR, within_tolerance()], ids=lambda rule: rule.name
)
def test_no_joint_is_made_worse_on_left_out_runs(rule: StoppingRule) -> None:
    found = reduce(loud_and_quiet().information(), rule=rule)
    left = found.left_out
    assert left is not None and left.folds == ("run0", "run1")
    chosen = left.sizes.index(len(found.state.active))
    errors = np.exp(np.log(left.errors).mean(axis=0))
    assert found.estimate.removed and (errors[chosen] <= 1.05 * errors[0]).all()
    # one fewer would be within the standard error of both runs, or the tolerance of fitted motion
    smaller = found.path.states[found.chosen + 1]
    assert left.worse(len(smaller.active), 0.05)
    assert (smaller.rms <= 1.05 * found.path.states[0].rms).all()


def test_a_joint_that_triples_is_named_by_motion() -> None:
    found = reduce(DATA, rule=count(3))
    left = found.left_out
    assert left is not None
    errors = np.exp(np.log(left.errors).mean(axis=0))
    rise = errors[left.sizes.index(3)] / errors[0] - 1.0
    assert rise.max() > 2.0
    words = _joints_judged(found)
    named = f"{DATA.layout.rows[int(rise.argmax())]} {significant(100.0 * rise.max())} %"
    assert "on left-out motion (run0, run1, run2, run3 in turn)" in words and named in words
    assert "the error of no joint rises by more than 5 %" in _joints_judged(reduce(DATA))
    fitted = _joints_judged(replace(reduce(DATA), left_out=None))
    assert "on fitted motion, as none is left out" in fitted


def test_one_run_is_left_out_by_stretches() -> None:
    one = samples(runs=1, count=600).information()
    folds = folds_of(one)
    assert len(folds) == 5 and sorted(k for _, mine in folds for k in mine) == list(
        range(len(one.windows))
    )
    assert len(reduce(one).estimate.removed) > 0


@pytest.mark.parametrize("name", RULES)
def test_every_rule_by_its_name(name: str) -> None:
    rule = rule_of("count=9" if name == "count" else name)
    assert rule.name == name
    found = reduce(DATA, rule=rule)
    assert 0 <= found.chosen < len(found.path.states)
    assert len(found.estimate.parameters) == len(found.state.active)


def test_rules_take_what_they_say() -> None:
    path = backward(FULL, LOSS)
    conditions = [state.condition for state in path.states]
    limit = 0.5 * (conditions[0] + conditions[4])
    place = condition_limit(limit).choose(path, None)
    assert conditions[place] <= limit < min(conditions[:place])
    ratios = [state.ratios.max() / state.ratios.min() for state in path.states]
    place = deviation_ratio(20.0).choose(path, None)
    assert ratios[place] <= 20.0 < min(ratios[:place])
    assert len(path.states[count(7).choose(path, None)].active) == 7
    assert rule_of("one_fewer").choose(path, None) == 1
    assert rule_of("refit").choose(path, None) == 0
    sizes = np.array(path.sizes)
    costs = [s.chi_square + len(s.active) * np.log(DATA.n_samples.sum()) for s in path.states]
    factors = np.maximum(FULL.factors, 1.0)
    if np.all(factors == 1.0):
        assert sizes[rule_of("bic").choose(path, None)] == sizes[int(np.argmin(costs))]
    errors = left_out_errors(DATA, lambda full: backward(full, LOSS))
    size = len(path.states[ONE_STANDARD_ERROR.choose(path, errors)].active)
    near = errors.rise <= errors.spread
    assert size == min(np.array(errors.sizes)[near])


def test_tolerance_of_mean_absolute_errors() -> None:
    some = samples()
    state = State(FULL, tuple(range(len(NAMES))))
    values = np.zeros(len(NAMES))
    values[list(state.active)] = state.values
    wanted = [
        np.abs(rows[:, -1] - rows[:, :-1] @ values[list(seen)]).mean()
        for rows, seen in zip(some.rows, some.layout.sees, strict=True)
    ]
    rule = within_tolerance(0.05, some)
    np.testing.assert_allclose(rule.errors(state), wanted, rtol=1e-12)
    found = reduce(DATA, MEAN_COLUMN, rule)
    before, after = (rule.errors(s) for s in (state, found.state))
    assert np.all(after <= 1.05 * before)
    assert len(found.state.active) < len(NAMES)


def test_algorithm_1_of_volkmann_against_dense_least_squares() -> None:
    """Mean absolute errors and no essential parameters: the printed loop, by plain arrays."""
    included, essential = list(range(len(NAMES))), set[int]()
    rows = np.repeat(np.arange(JOINTS), [len(x) for x in samples().rows])

    def errors(columns: list[int]) -> Array:
        rest = np.abs(B - A[:, columns] @ fitted(columns)[0])
        return np.array([rest[rows == row].mean() for row in range(JOINTS)])

    first = errors(included)
    while free := [k for k in included if k not in essential]:
        least = min(free, key=lambda k: float(np.abs(A[:, k]).sum()))
        fewer = [k for k in included if k != least]
        if np.all(errors(fewer) <= 1.05 * first):
            included = fewer
        else:
            essential.add(least)
    found = reduce(DATA, MEAN_COLUMN, within_tolerance(0.05, samples()))
    assert found.state.names == tuple(NAMES[k] for k in included)
    words = _joints_judged(replace(found, left_out=None))
    assert "on fitted motion, as none is left out the error of no joint rises" in words
    rows_of = found.joint_errors()
    efforts = [np.abs(B[rows == row]).mean() for row in range(JOINTS)]
    for label, wanted in (("full", first), ("reduced", errors(included))):
        np.testing.assert_allclose([row[label] for row in rows_of], wanted, rtol=1e-9)
        percent = [row[f"{label}_percent"] for row in rows_of]
        np.testing.assert_allclose(percent, 100.0 * wanted / efforts, rtol=1e-9)


def test_folds_are_judged_by_their_own_samples() -> None:
    some = samples()
    rule = within_tolerance(0.05, some)
    part = DATA.of(range(24))
    assert part.windows_of_runs.keys() == {"run0"}
    assert rule.during(part.windows).samples.runs[0] == "run0"
    assert len(rule.during(part.windows).samples) == len(samples(runs=1))


def test_what_is_kept_stays_and_what_is_dropped_goes_first() -> None:
    found = reduce(DATA, rule=count(len(NAMES) - 3), keep=ZERO[:2], drop=(NAMES[0], NAMES[2]))
    names = [one.name for one in found.estimate.removed]
    assert set(names[:2]) == {NAMES[0], NAMES[2]} and len(names) == 3
    assert set(ZERO[:2]) <= set(found.estimate.parameters.names)
    again = reduce(DATA, rule=rule_of("one_fewer"), drop=(NAMES[0], NAMES[2]))
    assert len(again.estimate.removed) == 3
    assert len(reduce(DATA, rule=rule_of("refit"), drop=(NAMES[0],)).estimate.removed) == 1


def test_what_the_data_do_not_show_has_no_value_and_is_not_removed() -> None:
    parts = []
    for run in range(2):
        motion = motion_of(JOINTS, 300, run, still=(JOINTS - 1,))
        effort = REGRESSOR.dense(*motion) @ truth_of()
        effort = effort + 0.1 * np.random.default_rng(run).normal(size=effort.shape)
        parts.append(samples_of(REGRESSOR, motion, effort, f"run{run}"))
    found = reduce(joined(add, parts).information()).estimate
    hidden = {one.name for one in found.blind}
    assert hidden
    assert not hidden & {one.name for one in found.removed}
    assert not hidden & set(found.parameters.names)


def test_the_estimate_is_weighted_least_squares_of_what_is_left_and_is_read_again() -> None:
    estimate = reduced(DATA)
    plain = WeightedLeastSquares()(DATA.select(estimate.parameters.names))
    np.testing.assert_array_equal(estimate.parameters.values, plain.parameters.values)
    np.testing.assert_array_equal(estimate.covariance, plain.covariance)
    again = Estimate.from_dict(estimate.to_dict())
    assert again.removed == estimate.removed != ()


@pytest.mark.parametrize(
    ("make", "kind", "words"),
    [
        (lambda: rule_of("tolerance=0"), ModelError, "is no number"),
        (lambda: rule_of("count"), ModelError, "is no number"),
        (lambda: rule_of("count=2.5"), ModelError, "is no number"),
        (lambda: rule_of("bic=3"), ModelError, "takes no number"),
        (lambda: rule_of("bik"), ModelError, "there is no stopping rule"),
        (lambda: criterion_of("los"), ModelError, "there is no criterion"),
        (lambda: reduce(DATA, rule=count(99)), DataError, "no model has 99 parameters"),
        (lambda: reduce(DATA, rule=condition_limit(0.5)), DataError, "the least is 1"),
        (lambda: reduce(DATA, rule=deviation_ratio(0.5)), DataError, "the least is 1"),
        (lambda: reduce(DATA.of([0])), DataError, "too"),
        (
            lambda: reduce(DATA, rule=rule_of("one_fewer"), keep=NAMES),
            DataError,
            "no parameter is left",
        ),
    ],
)
def test_bad_input(make: Callable[[], object], kind: type[SteelyardError], words: str) -> None:
    with pytest.raises(kind) as found:
        make()
    assert words in found.value.wrong
    assert found.value.fix
