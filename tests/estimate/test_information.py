"""Information: a value that adds, selects, transforms and knows what it must not be added to."""

from dataclasses import replace

import numpy as np
import pytest

from invented import tree
from steelyard.base.errors import DataError
from steelyard.estimate.information.base_parameters_and_regressor import base_regressor
from steelyard.estimate.information.filter_and_gram import Accumulator, Stretch
from steelyard.estimate.information.information import Information, Signature, Window
from steelyard.estimate.least_squares.weighted_robust_and_whitened import WeightedLeastSquares
from steelyard.model.model import Model

REGRESSOR = base_regressor(Model(tree()))
P = len(REGRESSOR.layout.columns)


def piece(
    seed: int, run: str = "a", count: int = 200
) -> tuple[Information, np.ndarray, np.ndarray]:
    """One window, with the stacked regressor and effort it stands for, row-major by joint."""
    q, dq, ddq, effort = np.random.default_rng(seed).normal(size=(4, 4, count))
    sums = Accumulator(REGRESSOR)(Stretch(q, dq, ddq, effort))
    signature = Signature("model", REGRESSOR.layout.columns, ("A",) * 4, "motion 20 Hz")
    information = Information(
        REGRESSOR.layout,
        signature,
        (Window(run, float(seed), seed + 1.0),),
        sums.grams[None],
        sums.absolute[None],
        sums.counts[None],
    )
    return information, REGRESSOR.dense(q, dq, ddq), effort


def test_normal_equations_are_those_of_the_stacked_regressor() -> None:
    information, dense, effort = piece(0)
    weights = np.array([1.0, 2.0, 0.5, 3.0])
    matrix, vector, square = information.normal(weights)
    wanted = np.einsum("j,jnp,jnq->pq", weights, dense, dense)
    assert np.allclose(matrix, wanted, rtol=1e-11, atol=1e-11)
    assert np.allclose(vector, np.einsum("j,jnp,jn->p", weights, dense, effort), atol=1e-10)
    assert np.isclose(square, np.einsum("j,jn,jn->", weights, effort, effort))
    values = np.random.default_rng(1).normal(size=P)
    residual = effort - dense @ values
    assert np.allclose(information.residual_squares(values), (residual**2).sum(axis=1), rtol=1e-9)
    assert np.allclose(information.absolute_sums(), np.abs(dense).sum(axis=(0, 1)), rtol=1e-12)


def test_sums_add_and_windows_can_be_chosen() -> None:
    first, second, third = (piece(k, run)[0] for k, run in ((0, "a"), (1, "a"), (2, "b")))
    whole = first + second + third
    assert [w.run for w in whole.windows] == ["a", "a", "b"]
    assert np.allclose(whole.normal()[0], sum(x.normal()[0] for x in (first, second, third)))
    assert np.array_equal(whole.of([1]).grams, second.grams)
    merged = whole.merged(1)
    assert merged.windows == (Window("a", 0.0, 2.0), Window("b", 2.0, 3.0))
    assert np.allclose(merged.normal()[0], whole.normal()[0])
    assert np.array_equal(merged.n_samples, whole.n_samples)


def test_windows_of_runs_that_alternate_merge_with_their_own() -> None:
    pieces = [piece(k, run)[0] for k, run in ((0, "a"), (1, "b"), (2, "a"), (3, "a"))]
    merged = sum(pieces[1:], pieces[0]).merged(2)
    assert merged.windows == (Window("a", 0.0, 3.0), Window("a", 3.0, 4.0), Window("b", 1.0, 2.0))
    for k, members in enumerate([(0, 2), (3,), (1,)]):
        wanted = sum(pieces[m].grams[0] for m in members)
        assert np.allclose(merged.grams[k], wanted, rtol=1e-14)


def test_no_windows_are_still_information() -> None:
    none = piece(0)[0].of([])
    assert none.merged(3).windows == ()
    assert none.select([REGRESSOR.layout.columns[0]]).normal()[0].tolist() == [[0.0]]
    assert (none + piece(1)[0]).windows == piece(1)[0].windows


@pytest.mark.parametrize(
    ("field", "value"),
    [("model", "other"), ("effort", ("Nm",) * 4), ("filters", "motion 30 Hz"), ("columns", ("x",))],
)
def test_unequal_information_is_not_added(field: str, value: object) -> None:
    first, second = piece(0)[0], piece(1, "b")[0]
    other = replace(second, signature=replace(second.signature, **{field: value}))
    with pytest.raises(
        DataError, match=f"information of unequal {field} cannot be added"
    ) as caught:
        first + other
    assert "runs a and b" in caught.value.where


def test_select_keeps_what_the_chosen_columns_see() -> None:
    information, dense, effort = piece(0)
    names = [REGRESSOR.layout.columns[k] for k in (7, 2, 0)]
    chosen = information.select(names)
    matrix, vector, _ = chosen.normal()
    part = dense[:, :, [7, 2, 0]]
    assert np.allclose(matrix, np.einsum("jnp,jnq->pq", part, part), atol=1e-10)
    assert np.allclose(vector, np.einsum("jnp,jn->p", part, effort), atol=1e-10)
    assert np.allclose(chosen.absolute_sums(), np.abs(part).sum(axis=(0, 1)))
    with pytest.raises(DataError, match="no column 'nothing'"):
        information.select(["nothing"])


def test_map_is_a_change_of_parameters() -> None:
    information, dense, effort = piece(0)
    transform = np.random.default_rng(2).normal(size=(P, 3))
    mapped = information.map(transform, ["a", "b", "c"], ["", "", ""])
    new = dense @ transform
    assert np.allclose(mapped.normal()[0], np.einsum("jnp,jnq->pq", new, new), rtol=1e-10)
    assert np.allclose(mapped.normal()[1], np.einsum("jnp,jn->p", new, effort), rtol=1e-9)


def test_gains_scale_the_effort_of_each_row() -> None:
    information, dense, effort = piece(0)
    gains = np.array([2.0, -3.0, 0.5, 1.0])
    scaled = information.scaled(gains, ("Nm",) * 4)
    torque = effort * gains[:, None]
    assert np.allclose(scaled.normal()[1], np.einsum("jnp,jn->p", dense, torque), atol=1e-9)
    assert np.allclose(scaled.effort_squares(), (torque**2).sum(axis=1))
    assert scaled.signature.effort == ("Nm",) * 4
    with pytest.raises(DataError, match="unequal effort"):
        information + scaled


def test_runs_of_different_rates_add_to_the_same_in_any_order() -> None:
    slow, fast = piece(0)[0].with_effective_samples(1.5), piece(1)[0].with_effective_samples(4.5)
    one, other = WeightedLeastSquares()(slow + fast), WeightedLeastSquares()(fast + slow)
    assert np.allclose(one.covariance, other.covariance, rtol=1e-6)
    assert np.allclose((slow + fast).n_samples, 200 / 1.5 + 200 / 4.5)


def test_what_is_beside_rests_goes_with_the_sums() -> None:
    def marked(information: Information) -> Information:
        return replace(information, beside=0.3 * information.grams)

    first, second = marked(piece(0)[0]), piece(1)[0]
    whole = first + second
    assert whole.beside is not None and (second + second).beside is None
    assert np.array_equal(whole.beside[:1], first.beside) and not whole.beside[1].any()
    names, units = REGRESSOR.layout.columns, REGRESSOR.layout.units
    transform = np.random.default_rng(2).normal(size=(P, P))
    for changed in (
        first.of([0]),
        first.merged(1),
        first.select(names[3:7]),
        first.map(transform, names, units),
        first.with_effective_samples(2.0),
        first.scaled(np.array([2.0, -1.0, 3.0, 1.0]), ("Nm",) * 4),
        first.with_predicted(np.ones(P), ("a", "b", "c", "d"), np.zeros(4)),
    ):
        assert changed.beside is not None
        assert np.allclose(changed.beside, 0.3 * changed.grams, rtol=1e-9, atol=1e-9)
        rest = changed.without_beside()
        assert rest.beside is None and np.allclose(rest.grams, 0.7 * changed.grams, atol=1e-9)
