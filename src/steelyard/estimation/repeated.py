r"""Scatter of repeated estimations: mean and relative standard deviation of every parameter.

Of $N$ estimates $X_i$ with the mean $\bar X$ [Wang, eq. 13], the sample standard deviation is
$\sqrt{\sum_i (X_i - \bar X)^2 / (N - 1)}$; that of the population divides by $N$. (Eq. 14 of [Wang]
divides the root by $N$; the numbers of its table I are those of the population.)
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from steelyard.arrays import Array, frozen
from steelyard.errors import DataError
from steelyard.estimation.estimate import Estimate


@dataclass(frozen=True, eq=False)
class RepeatedEstimates:
    """Several estimates of the same parameters.

    Attributes:
        labels: Name of each estimation.
        names: Parameters that at least one of them identifies, `p` of them.
        units: Their units.
        values: NaN where an estimation does not identify a parameter, shape `(N, p)`.
        stated: Stated standard deviations, likewise.
        population: Whether standard deviations are those of the population, not of the sample.
    """

    labels: tuple[str, ...]
    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Array
    stated: Array
    population: bool = False

    @classmethod
    def of(
        cls, estimates: Mapping[str, Estimate], *, population: bool = False
    ) -> "RepeatedEstimates":
        """The scatter of estimates by their labels, parameters in the order of their appearance.

        Raises:
            DataError: There are fewer than two.
        """
        if len(estimates) < 2:
            raise DataError(
                f"{len(estimates)} estimation has no scatter",
                where="repeated estimations",
                fix="give two or more",
            )
        units = {
            name: unit
            for estimate in estimates.values()
            for name, unit in zip(estimate.parameters.names, estimate.parameters.units, strict=True)
        }
        values = [estimate.parameters.as_dict() for estimate in estimates.values()]
        stated = [
            dict(zip(estimate.parameters.names, estimate.std.tolist(), strict=True))
            for estimate in estimates.values()
        ]
        return cls(
            tuple(estimates),
            tuple(units),
            tuple(units.values()),
            _table(values, units),
            _table(stated, units),
            population,
        )

    @property
    def count(self) -> Array:
        """Number of estimations that identify each parameter, shape `(p,)`."""
        return np.asarray(np.isfinite(self.values).sum(axis=0), dtype=np.float64)

    @property
    def mean(self) -> Array:
        """Mean of each parameter, shape `(p,)`."""
        return np.asarray(np.nanmean(self.values, axis=0))

    @property
    def std(self) -> Array:
        """Standard deviation of each parameter, NaN of a single value, shape `(p,)`."""
        squares = np.nansum(np.square(self.values - self.mean), axis=0)
        divisor = self.count - (0 if self.population else 1)
        single = self.count < 2
        return np.where(single, np.nan, np.sqrt(squares / np.where(single, 1, divisor)))

    @property
    def relative_percent(self) -> Array:
        """Standard deviation over the size of the mean [%], NaN at zero, shape `(p,)`."""
        size = np.abs(self.mean)
        known = size > 0.0
        return np.where(known, 100.0 * self.std / np.where(known, size, 1.0), np.nan)

    @property
    def stated_std(self) -> Array:
        """Root mean square of the stated standard deviations, shape `(p,)`."""
        return np.asarray(np.sqrt(np.nanmean(np.square(self.stated), axis=0)))

    @property
    def deviation(self) -> str:
        """Which standard deviation it is, in words."""
        return "population (1/N)" if self.population else "sample (1/(N - 1))"

    def rows(self) -> list[dict[str, Any]]:
        """One row per parameter, `None` where there is no number; `values` by estimation."""
        columns = {
            "mean": self.mean,
            "std": self.std,
            "relative_percent": self.relative_percent,
            "stated_std": self.stated_std,
        }
        return [
            {
                "name": name,
                "unit": unit,
                "count": int(count),
                **{key: _number(column[k]) for key, column in columns.items()},
                "values": [_number(value) for value in self.values[:, k]],
            }
            for k, (name, unit, count) in enumerate(
                zip(self.names, self.units, self.count, strict=True)
            )
        ]

    def to_dict(self) -> dict[str, Any]:
        """As JSON values."""
        return {
            "estimations": list(self.labels),
            "deviation": "population" if self.population else "sample",
            "parameters": self.rows(),
        }


def _table(numbers: Sequence[Mapping[str, float]], names: Mapping[str, str]) -> Array:
    """Numbers by estimation and name, NaN where there is none, shape `(N, p)`."""
    return frozen([[row.get(name, np.nan) for name in names] for row in numbers])


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
