"""Criteria of information matrices, against NumPy on regressors and 60-digit arithmetic."""

import math
from collections.abc import Callable, Sequence
from decimal import Decimal, localcontext
from typing import Any

import numpy as np
import pytest

from steelyard.base.arrays import Array
from steelyard.excite.optimality_criteria import CRITERIA, Criterion, measure, worst

C = 7
"""Columns where digits are many."""
CHOSEN = (5, 0, 3)
SIZES = np.array([3.0, 0.2, 1.0, 40.0, 0.5, 7.0, 0.05])


def regressor(seed: int, columns: int, condition: float, units: float = 1.0) -> Array:
    """With a condition number before columns are multiplied with up to `units`, or divided."""
    rng = np.random.default_rng(seed)
    left, _ = np.linalg.qr(rng.normal(size=(4 * columns, columns)))
    right, _ = np.linalg.qr(rng.normal(size=(columns, columns)))
    spread = condition ** rng.permutation(np.linspace(-0.5, 0.5, columns))
    scales = units ** rng.permutation(np.linspace(-1.0, 1.0, columns))
    result: Array = (left * spread) @ right * scales
    return result


def gram(seed: int, columns: int, condition: float, units: float = 1.0) -> Array:
    w = regressor(seed, columns, condition, units)
    result: Array = w.T @ w
    return result


PRIOR = gram(9, C, 10.0)
MEASURES: dict[str, Callable[[Criterion], Criterion]] = {
    "all": lambda kind: kind,
    "prior": lambda kind: measure(kind, prior=PRIOR),
    "chosen": lambda kind: measure(kind, chosen=CHOSEN),
    "sizes": lambda kind: measure(kind, sizes=SIZES),
    "everything": lambda kind: measure(kind, PRIOR, CHOSEN, SIZES),
}


# What the criteria say, in decimal numbers and by other formulas: traces of powers, and the
# inverse of a block of the inverse.


def decimal(values: Array) -> Any:
    return np.array([Decimal(float(v)) for v in values.ravel()], object).reshape(values.shape)


def inverse_and_det(matrix: Any) -> tuple[Any, Decimal]:
    """By Gauss and Jordan; a positive definite matrix needs no pivoting."""
    n, det = len(matrix), Decimal(1)
    rows = np.concatenate((matrix, decimal(np.eye(n))), axis=1)
    for k in range(n):
        det *= rows[k, k]
        rows[k] = rows[k] / rows[k, k]
        for i in set(range(n)) - {k}:
            rows[i] = rows[i] - rows[i, k] * rows[k]
    return rows[:, n:], det


def p_norm(matrix: Any, p: int) -> Decimal:
    """Logarithm of the trace of a power, by `p`; `p` is a power of two."""
    power = matrix
    for _ in range(p.bit_length() - 1):
        power = power @ power
    return Decimal(np.trace(power)).ln() / p


def decimal_criterion(kind: str, matrix: Any, p: int) -> Decimal:
    if kind == "normalised_condition":
        d = np.array([1 / v.sqrt() for v in np.diagonal(matrix)], object)
        return decimal_criterion("condition", matrix * d[:, None] * d, p)
    covariance, det = inverse_and_det(matrix)
    if kind == "condition":
        return (p_norm(matrix, p) + p_norm(covariance, p)) / 2
    if kind == "e_optimal":
        return p_norm(covariance, p)
    return -det.ln() / len(matrix) if kind == "d_optimal" else Decimal(np.trace(covariance)).ln()


def decimal_measure(kind: str, measure: str, matrix: Any, p: int) -> Decimal:
    if measure in ("prior", "everything"):
        matrix = matrix + decimal(PRIOR)
    if measure in ("sizes", "everything"):
        matrix = matrix * decimal(SIZES)[:, None] * decimal(SIZES)
    if measure in ("chosen", "everything"):
        block = inverse_and_det(matrix)[0][np.ix_(CHOSEN, CHOSEN)]
        matrix = inverse_and_det(block)[0]
    return decimal_criterion(kind, matrix, p)


def directions(g: Array) -> list[Array]:
    """Symmetric changes: one that treats all eigenvalues alike, one that mostly hits the least."""
    rng = np.random.default_rng(1)
    draws = [d + d.T for d in rng.normal(size=(2, len(g), len(g)))]
    lower = np.linalg.cholesky(g)
    least = np.linalg.eigvalsh(g)[0]
    alike = lower @ draws[0] @ lower.T
    return [0.5 * (alike + alike.T), least * draws[1]]


GRAMS = {
    "well conditioned": gram(0, C, 3.0),
    "ill conditioned": gram(1, C, 1e4),
    "mixed units": gram(2, C, 10.0, units=1e4),
}


@pytest.mark.parametrize("which", GRAMS)
@pytest.mark.parametrize("measure", MEASURES)
@pytest.mark.parametrize("kind", CRITERIA)
def test_smooth_values_and_slopes_are_exact(kind: str, measure: str, which: str) -> None:
    g = GRAMS[which]
    criterion = MEASURES[measure](CRITERIA[kind])
    for p in (4, 64):
        value, slope = criterion.smooth(g, p)
        assert np.array_equal(slope, slope.T) or np.allclose(slope, slope.T, rtol=1e-12, atol=0.0)
        with localcontext() as context:
            context.prec = 60
            h = Decimal(10) ** -15
            assert value == pytest.approx(
                float(decimal_measure(kind, measure, decimal(g), p)), abs=1e-7
            )
            for e in directions(g):
                up, down = (
                    decimal_measure(kind, measure, decimal(g) + side * decimal(e), p)
                    for side in (h, -h)
                )
                assert np.sum(slope * e) == pytest.approx(float((up - down) / (2 * h)), rel=1e-6)


@pytest.mark.parametrize("condition", [5.0, 1e2, 1e4])
def test_values_are_those_of_numpy_on_the_regressor(condition: float) -> None:
    w = regressor(3, 57, condition)
    g = w.T @ w
    covariance = np.linalg.inv(g)
    wanted = {
        "condition": np.linalg.cond(w),
        "normalised_condition": np.linalg.cond(w / np.linalg.norm(w, axis=0)),
        "d_optimal": np.exp(-np.linalg.slogdet(g)[1] / 57),
        "a_optimal": np.trace(covariance),
        "e_optimal": np.linalg.svd(w, compute_uv=False)[-1] ** -2,
    }
    assert wanted.keys() == CRITERIA.keys()
    for name, kind in CRITERIA.items():
        assert kind.value(g) == pytest.approx(wanted[name], rel=1e-6), name


def test_measures_are_those_of_numpy() -> None:
    w, earlier = regressor(4, 20, 30.0), regressor(5, 20, 8.0)
    g, prior, sizes = w.T @ w, earlier.T @ earlier, np.geomspace(0.1, 30.0, 20)
    chosen = (7, 2, 19)
    both = np.concatenate((w, earlier)) * sizes
    inverse = np.linalg.inv(both.T @ both)[np.ix_(chosen, chosen)]
    measured = measure(CRITERIA["a_optimal"], prior, chosen, sizes)
    assert measured.value(g) == pytest.approx(np.trace(inverse), rel=1e-9)
    assert measure(CRITERIA["condition"], prior, None, sizes).value(g) == pytest.approx(
        np.linalg.cond(both), rel=1e-9
    )


def test_raw_condition_of_mixed_units_is_exact() -> None:
    w = regressor(6, 30, 5.0, units=1e5)
    assert np.linalg.cond(w) > 1e9
    assert CRITERIA["condition"].value(w.T @ w) == pytest.approx(np.linalg.cond(w), rel=1e-5)


@pytest.mark.parametrize("measure", MEASURES)
@pytest.mark.parametrize("kind", CRITERIA)
def test_smooth_falls_to_the_logarithm(kind: str, measure: str) -> None:
    criterion = MEASURES[measure](CRITERIA[kind])
    for g in GRAMS.values():
        value = math.log(criterion.value(g))
        smooth = [criterion.smooth(g, p)[0] for p in (1.0, 4.0, 16.0, 64.0, 1e6)]
        assert all(a >= b - 1e-9 for a, b in zip(smooth, smooth[1:], strict=False))
        assert all(
            value - 1e-9 <= s <= value + math.log(C) / p + 1e-9
            for s, p in zip(smooth, (1.0, 4.0, 16.0, 64.0, 1e6), strict=True)
            if kind not in ("d_optimal", "a_optimal")
        )
        assert smooth[-1] == pytest.approx(value, abs=1e-5)


def test_normalised_condition_is_free_of_column_scales() -> None:
    kind = CRITERIA["normalised_condition"]
    g, d = gram(7, 12, 50.0), np.geomspace(1e-4, 1e4, 12)
    scaled = g * d[:, None] * d
    assert kind.value(scaled) == pytest.approx(kind.value(g), rel=1e-9)
    (value, slope), (same, other) = kind.smooth(g, 8.0), kind.smooth(scaled, 8.0)
    assert same == pytest.approx(value, abs=1e-9)
    assert other * d[:, None] * d == pytest.approx(slope, rel=1e-6, abs=1e-9 * abs(slope).max())
    assert CRITERIA["condition"].value(scaled) > 100.0 * CRITERIA["condition"].value(g)


def test_d_optimal_ranks_alike_in_all_coordinates() -> None:
    kind = CRITERIA["d_optimal"]
    change = regressor(8, 12, 20.0)[:12]
    motions = [(1.0 + seed) * gram(seed, 12, 30.0) for seed in range(5)]
    before = [kind.smooth(g, 4.0)[0] for g in motions]
    after = [kind.smooth(change.T @ g @ change, 4.0)[0] for g in motions]
    assert np.ptp(np.subtract(after, before)) < 1e-9
    assert np.ptp(before) > 1.0


def unknown() -> dict[str, Array]:
    w = regressor(10, C, 4.0)
    still, twin = w.copy(), w.copy()
    still[:, 2] = 0.0
    twin[:, 4] = twin[:, 1] * -3.0
    broken = w.T @ w
    broken[2, 3] = broken[3, 2] = np.nan
    endless = w.T @ w
    endless[1, 1] = np.inf
    few = w[: C - 1]
    return {
        "nothing": np.zeros((C, C)),
        "a column at rest": still.T @ still,
        "twins": twin.T @ twin,
        "few rows": few.T @ few,
        "not a number": broken,
        "endless": endless,
    }


@pytest.mark.parametrize("which", unknown())
@pytest.mark.parametrize("measure", ["all", "chosen", "sizes"])
@pytest.mark.parametrize("kind", CRITERIA)
def test_what_is_not_shown_is_infinitely_bad(kind: str, measure: str, which: str) -> None:
    criterion = MEASURES[measure](CRITERIA[kind])
    g = unknown()[which]
    value, slope = criterion.smooth(g, 16.0)
    assert value == math.inf
    assert criterion.value(g) == math.inf
    assert np.array_equal(slope, np.zeros((C, C)))


@pytest.mark.parametrize("which", ["nothing", "a column at rest", "twins", "few rows"])
@pytest.mark.parametrize("kind", CRITERIA)
def test_earlier_runs_show_what_this_one_does_not(kind: str, which: str) -> None:
    criterion = MEASURES["prior"](CRITERIA[kind])
    g = unknown()[which]
    value, slope = criterion.smooth(g, 16.0)
    assert math.isfinite(value)
    assert math.isfinite(criterion.value(g))
    with localcontext() as context:
        context.prec = 60
        h = Decimal(10) ** -15
        e = directions(PRIOR)[0]
        up, down = (
            decimal_measure(kind, "prior", decimal(g) + side * decimal(e), 16) for side in (h, -h)
        )
    assert np.sum(slope * e) == pytest.approx(float((up - down) / (2 * h)), rel=1e-9)


@pytest.mark.parametrize("kind", CRITERIA)
def test_more_information_is_better_for_variances(kind: str) -> None:
    """All but condition numbers, which may grow with information."""
    g, more = gram(11, C, 20.0), gram(12, C, 20.0)
    if kind in ("a_optimal", "d_optimal", "e_optimal"):
        assert CRITERIA[kind].value(g + 0.1 * more) < CRITERIA[kind].value(g)
        slope = CRITERIA[kind].smooth(g, 16.0)[1]
        assert np.linalg.eigvalsh(slope)[-1] <= 1e-12 * abs(slope).max()
    else:
        assert CRITERIA[kind].value(5.0 * g) == pytest.approx(CRITERIA[kind].value(g), rel=1e-12)


def test_nuisances_cost_information() -> None:
    g = gram(13, C, 50.0)
    kind = CRITERIA["e_optimal"]
    alone = kind.value(g[np.ix_(CHOSEN, CHOSEN)])
    assert measure(kind, chosen=CHOSEN).value(g) > alone
    assert measure(kind, chosen=tuple(range(C))).value(g) == pytest.approx(kind.value(g), rel=1e-9)
    known = np.zeros((C, C))
    for k in set(range(C)) - set(CHOSEN):
        known[k, k] = 1e9
    assert measure(kind, known, CHOSEN).value(g) == pytest.approx(alone, rel=1e-6)


def cases(grams: Sequence[Array]) -> list[tuple[Criterion, Array]]:
    kinds = [
        CRITERIA["condition"],
        measure(CRITERIA["condition"], prior=PRIOR),
        CRITERIA["condition"],
    ]
    return list(zip(kinds, grams, strict=True))


def test_the_worst_case_is_what_counts() -> None:
    grams = [gram(seed, C, 20.0 + seed) for seed in (14, 15, 16)]
    values = [kind.value(g) for kind, g in cases(grams)]
    assert math.exp(worst(cases(grams), math.inf)[0]) == pytest.approx(max(values), rel=1e-13)
    value, slopes = worst(cases(grams), 32.0)
    assert math.log(max(values)) <= value <= math.log(max(values)) + math.log(3 * C) / 32.0
    for k, g in enumerate(grams):
        for e in directions(g):
            with localcontext() as context:
                context.prec = 60
                h = Decimal(10) ** -15
                up, down = (decimal_worst(grams, k, side * decimal(e)) for side in (h, -h))
            assert np.sum(slopes[k] * e) == pytest.approx(float((up - down) / (2 * h)), rel=1e-8)


def decimal_worst(grams: Sequence[Array], changed: int, change: Any) -> Decimal:
    total = Decimal(0)
    for k, g in enumerate(grams):
        matrix = decimal(g) + change if k == changed else decimal(g)
        value = decimal_measure("condition", "prior" if k == 1 else "all", matrix, 32)
        total += (32 * value).exp()
    return total.ln() / 32


def test_the_worst_of_one_is_itself() -> None:
    g = gram(17, C, 9.0)
    (value, slope), (same, slopes) = (
        CRITERIA["condition"].smooth(g, 8.0),
        worst([(CRITERIA["condition"], g)], 8.0),
    )
    assert same == value
    assert np.array_equal(slopes[0], slope)


def test_one_case_that_shows_nothing_is_enough() -> None:
    some = [(CRITERIA["d_optimal"], gram(18, C, 9.0)), (CRITERIA["d_optimal"], np.zeros((C, C)))]
    value, slopes = worst(some, 8.0)
    assert value == worst(some, math.inf)[0] == math.inf
    assert not any(np.any(slope) for slope in slopes)


def test_measures_say_what_they_are_of() -> None:
    assert MEASURES["everything"](CRITERIA["condition"]).name == (
        "condition number (raw), of 3 chosen parameters, with earlier runs, "
        "relative to expected values"
    )
    assert measure(CRITERIA["condition"]).name == CRITERIA["condition"].name
    assert len({kind.name for kind in CRITERIA.values()}) == len(CRITERIA)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"prior": np.ones((3, 4))}, "expected an array of 3 x 3"),
        ({"sizes": np.ones((2, 2))}, "expected an array"),
    ],
)
def test_measures_that_make_no_sense_are_refused(wrong: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        measure(CRITERIA["condition"], **wrong)


def test_a_measure_owns_its_arrays() -> None:
    prior = PRIOR.copy()
    measured = measure(CRITERIA["condition"], prior=prior)
    prior[0, 0] = np.nan
    assert math.isfinite(measured.value(np.zeros((C, C))))
