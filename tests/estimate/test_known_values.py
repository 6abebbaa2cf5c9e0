"""Least squares with known parameters against NumPy's on the other columns."""

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from estimate.test_least_squares import ESTIMATORS, MODEL, NOISE, REGRESSOR, data
from steelyard.estimate.estimate import Estimate
from steelyard.estimate.estimator_register import Context, offer_of
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.estimate.least_squares.known_bounded_and_ridge import WithKnownValues, fixed_values
from steelyard.estimate.least_squares.weighted_robust_and_whitened import (
    OrdinaryLeastSquares,
    WeightedLeastSquares,
)
from steelyard.estimate.payload.runs_with_payload import LoadCase
from steelyard.estimate.prior.body_priors import Knowledge, Row, default_knowledge
from steelyard.uses.payload.payload_fit import _knowledge

COLUMNS = REGRESSOR.layout.columns
LEAST = OrdinaryLeastSquares | WeightedLeastSquares


@pytest.mark.parametrize("estimator", ESTIMATORS, ids=lambda e: type(e).__name__)
def test_the_others_are_those_of_the_remaining_columns(estimator: LEAST) -> None:
    information, truth, dense, effort = data(NOISE)
    given = [1, 4, len(COLUMNS) - 1]
    known = {COLUMNS[k]: float(truth[k]) for k in given}
    found = WithKnownValues(estimator, known)(information)
    assert found.parameters.names == COLUMNS and set(found.known) == set(known)
    values, std = found.parameters.as_dict(), dict(zip(COLUMNS, found.std, strict=True))
    assert {name: values[name] for name in known} == known
    assert all(std[name] == 0.0 for name in known)
    left = [k for k in range(len(COLUMNS)) if k not in given]
    rest = effort - dense[:, :, given] @ truth[given]
    weighted = isinstance(estimator, WeightedLeastSquares)
    scale = 1.0 / found.sigma if weighted else np.ones(len(found.sigma))
    stacked = (dense[:, :, left] * scale[:, None, None]).reshape(-1, len(left))
    wanted, *_ = np.linalg.lstsq(stacked, (rest * scale[:, None]).ravel(), rcond=None)
    np.testing.assert_allclose(found.parameters.values[left], wanted, rtol=1e-6, atol=1e-9)
    inverse = np.linalg.inv(stacked.T @ stacked)
    noise = np.repeat((found.sigma * scale) ** 2, dense.shape[1])
    sandwich = inverse @ (stacked.T * noise) @ stacked @ inverse
    covariance = found.covariance[np.ix_(left, left)]
    np.testing.assert_allclose(covariance, sandwich, rtol=1e-5, atol=1e-12)


def test_true_values_leave_the_truth_and_wrong_ones_do_not() -> None:
    information, truth, _, _ = data(np.zeros(4))
    right = {COLUMNS[k]: float(truth[k]) for k in (0, 3)}
    found = WithKnownValues(WeightedLeastSquares(), right)(information)
    np.testing.assert_allclose(found.parameters.values, truth, atol=1e-9)
    wrong = {COLUMNS[0]: float(truth[0]) + 1.0}
    moved = WithKnownValues(WeightedLeastSquares(), wrong)(information)
    assert moved.parameters[COLUMNS[0]] == wrong[COLUMNS[0]]
    assert np.abs(moved.parameters.values[1:] - truth[1:]).max() > 0.01


def test_a_known_value_makes_a_tied_one_identifiable() -> None:
    """A joint that stands still shows sums of parameters only."""
    information, truth, _, _ = data(np.zeros(4), still=2)
    blind = WeightedLeastSquares()(information).blind
    tied = next(one for one in blind if one.tied_to)
    known = {tied.name: float(truth[COLUMNS.index(tied.name)])}
    found = WithKnownValues(WeightedLeastSquares(), known)(information)
    assert tied.name not in {one.name for one in found.blind}
    assert found.parameters[tied.name] == known[tied.name]


def rows(**values: float) -> tuple[Row, ...]:
    return tuple(Row(f"{name} is known", {name: 1.0}, x, x) for name, x in values.items())


def test_values_come_from_constraints_on_all_members_of_a_group() -> None:
    base = REGRESSOR.base
    sizes = [np.count_nonzero(row) for row in base.lift]
    alone, group = sizes.index(1), int(np.argmax(sizes))
    members = [base.names[k] for k in np.flatnonzero(base.lift[group])]
    assert len(members) > 1
    single = base.base_names[alone]
    knowledge = default_knowledge(MODEL)

    def fixed(*given: Row) -> tuple[dict[str, float], tuple[str, ...]]:
        values, unused = fixed_values(base, replace(knowledge, rows=given))
        return dict(values), unused

    assert fixed(Row("2 x = 3", {single: 2.0}, 3.0, 3.0)) == ({single: 1.5}, ())
    assert fixed(Row("bounded", {single: 1.0}, 0.0, 3.0)) == ({}, ("bounded",))
    part = rows(**{members[0]: 1.0})
    assert fixed(*part) == ({}, (part[0].label,))
    whole = rows(**dict.fromkeys(members, 2.0))
    values, unused = fixed(*whole)
    factors = base.lift[group][np.flatnonzero(base.lift[group])]
    assert unused == () and values == pytest.approx({base.base_names[group]: 2.0 * factors.sum()})
    tie = Row("tied", {members[0]: 1.0, members[1]: -1.0}, 0.0, 0.0)
    assert fixed(*part, tie)[1] == (part[0].label, "tied")


@pytest.mark.parametrize("name", ["OLS", "WLS"])
def test_plain_least_squares_is_offered_with_them(name: str) -> None:
    information, *_ = data(NOISE)
    single = next(
        n for n, row in zip(COLUMNS, REGRESSOR.base.lift, strict=True) if np.count_nonzero(row) == 1
    )
    knowledge: Knowledge = replace(default_knowledge(MODEL), rows=rows(**{single: 0.25}))
    found: Estimate = offer_of(name, "").make(Context(REGRESSOR, knowledge))(information)
    assert found.known == (single,) and found.parameters[single] == 0.25
    again = Estimate.from_dict(found.to_dict())
    assert again.known == found.known
    plain: Estimate = offer_of(name, "").make(Context(REGRESSOR, default_knowledge(MODEL)))(
        information
    )
    assert plain.known == () and plain.parameters[single] != 0.25


def test_weighing_a_payload_takes_them_as_known() -> None:
    """Their precision is far above that of the estimated ones, which keep theirs."""
    information, *_ = data(NOISE)
    known = {COLUMNS[0]: 0.0, COLUMNS[2]: 5.0}
    found = WithKnownValues(WeightedLeastSquares(), known)(information)
    identified = cast(IdentifiedModel, SimpleNamespace(estimate=found))
    case = cast(LoadCase, SimpleNamespace(information=information, n_arm=len(COLUMNS)))
    values, precision = _knowledge(identified, case)
    np.testing.assert_array_equal(values, found.parameters.values)
    left = [k for k in range(len(COLUMNS)) if k not in (0, 2)]
    covariance = found.covariance[np.ix_(left, left)]
    others = precision[np.ix_(left, left)]
    np.testing.assert_allclose(others, np.linalg.inv(covariance), rtol=1e-6, atol=1e-6)
    assert precision[0, 0] == pytest.approx(1e12) and precision[2, 2] == pytest.approx(4e10)
