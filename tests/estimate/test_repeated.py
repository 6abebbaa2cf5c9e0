"""Mean and relative standard deviation of repeated estimations, against a printed table."""

import numpy as np
import pytest

from steelyard.base.arrays import Parameters
from steelyard.base.errors import DataError
from steelyard.estimate.estimate import Estimate
from steelyard.estimate.parameter_status_bootstrap_and_sensitivity import RepeatedEstimates

WANG = {
    "p2": ([13.8238, 14.0202, 13.7847, 13.8903, 13.8968], 13.8831, 0.5783),
    "p5": ([0.0120, 0.0122, 0.0119, 0.0120, 0.0117], 0.0120, 1.4498),
    "p6": ([-2.3991, -2.2644, -2.4859, -2.4584, -2.4552], -2.4126, 3.2857),
    "p8": ([43.9145, 40.8640, 45.6607, 38.2915, 41.7885], 42.1038, 6.0180),
    "p9": ([38.6113, 31.2062, 38.5468, 28.1294, 33.0645], 33.9116, 12.1614),
    "p11": ([0.2772, 0.2668, 0.2750, 0.2751, 0.2739], 0.2736, 1.3063),
}
"""Rows of table I of [Wang]: five estimates, their mean, their relative standard deviation [%]."""


def estimate(values: dict[str, float], std: float = 0.1) -> Estimate:
    names = tuple(values)
    known = Parameters(names, ("Nm",) * len(names), list(values.values()))
    return Estimate(
        "some", known, std**2 * np.eye(len(names)), (), np.ones(1), np.ones(1), 1.0, 1.0
    )


def five(**options: bool) -> RepeatedEstimates:
    rows = [{name: row[0][k] for name, row in WANG.items()} for k in range(5)]
    estimates = {f"run{k}": estimate(row, 0.1 * (k + 1)) for k, row in enumerate(rows)}
    return RepeatedEstimates.of(estimates, **options)


def test_the_table_of_wang_is_of_the_population() -> None:
    found = five(population=True)
    for k, (_, mean, relative) in enumerate(WANG.values()):
        assert found.mean[k] == pytest.approx(mean, abs=6e-5)
        rounding = 100.0 * 5e-5 / abs(mean)
        assert found.relative_percent[k] == pytest.approx(relative, rel=1e-3, abs=rounding)
    assert found.deviation == "population (1/N)"


def test_the_sample_divides_by_one_less() -> None:
    found, population = five(), five(population=True)
    np.testing.assert_allclose(found.std, np.std(found.values, axis=0, ddof=1))
    np.testing.assert_allclose(found.std, population.std * np.sqrt(5.0 / 4.0))
    np.testing.assert_allclose(found.stated_std, np.sqrt(np.mean(np.square(0.1 * np.arange(1, 6)))))
    assert found.to_dict()["deviation"] == "sample"
    assert population.to_dict()["deviation"] == "population"


def test_parameters_that_some_do_not_identify() -> None:
    estimates = {
        "a": estimate({"x": 1.0, "y": 2.0, "z": 1.0}),
        "b": estimate({"x": 3.0, "z": -1.0}),
        "c": estimate({"w": 5.0, "x": 5.0}),
    }
    found = RepeatedEstimates.of(estimates)
    assert found.names == ("x", "y", "z", "w") and found.labels == ("a", "b", "c")
    assert found.count.tolist() == [3, 1, 2, 1]
    rows = {row["name"]: row for row in found.rows()}
    assert rows["x"]["std"] == pytest.approx(2.0)
    assert rows["x"]["relative_percent"] == pytest.approx(200.0 / 3.0)
    assert rows["y"]["std"] is None and rows["y"]["mean"] == 2.0
    assert rows["y"]["values"] == [2.0, None, None]
    assert rows["z"]["mean"] == 0.0 and rows["z"]["relative_percent"] is None
    assert rows["w"]["stated_std"] == pytest.approx(0.1)


def test_a_single_estimation_has_no_scatter() -> None:
    with pytest.raises(DataError, match="1 estimation has no scatter"):
        RepeatedEstimates.of({"a": estimate({"x": 1.0})})
