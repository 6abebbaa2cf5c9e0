"""What an estimator returns: named numbers, their uncertainty, and what the data did not see."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from steelyard.arrays import Array, frozen
from steelyard.parameters import Parameters
from steelyard.regression.information import Information

Estimator = Callable[[Information], "Estimate"]
"""From information to parameters."""

Z95 = 1.959963984540054
"""Half-width of a 95 % interval in standard deviations."""


@dataclass(frozen=True)
class Blind:
    """A base parameter that the data do not show.

    Attributes:
        name: The parameter.
        tied_to: Parameters that its column cannot be told from; empty if its column is zero.
    """

    name: str
    tied_to: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class OfRun:
    """Parameters that one run has for itself.

    Attributes:
        run: The run.
        parameters: Their values.
        std: Their standard deviations, shape `(l,)`.
    """

    run: str
    parameters: Parameters
    std: Array


@dataclass(frozen=True, eq=False)
class Estimate:
    """Estimated base parameters.

    Attributes:
        estimator: What made it, for people to read.
        parameters: The parameters that the data see.
        covariance: Shape `(p, p)`, corrected for the filter's correlation of residuals.
        blind: What the data do not see; such parameters are left at zero.
        sigma: Standard deviation of the filtered residuals per effort row, shape `(rows,)`.
        n_samples: Filtered samples per effort row, shape `(rows,)`.
        condition: Condition number of the whitened regressor, columns as they are.
        condition_normalised: The same with columns scaled to unit length.
        per_run: Parameters of single runs; `parameters` then holds what a new run is to be
            expected to have, their mean, with the variance between runs.
    """

    estimator: str
    parameters: Parameters
    covariance: Array
    blind: tuple[Blind, ...]
    sigma: Array
    n_samples: Array
    condition: float
    condition_normalised: float
    per_run: tuple[OfRun, ...] = ()

    @property
    def std(self) -> Array:
        """Standard deviation of each parameter, shape `(p,)`."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def half_width(self) -> Array:
        """Half-width of the 95 % intervals, shape `(p,)`."""
        return Z95 * self.std

    def to_dict(self) -> dict[str, Any]:
        """As JSON values; exact."""
        return {
            "estimator": self.estimator,
            "names": list(self.parameters.names),
            "units": list(self.parameters.units),
            "values": self.parameters.values.tolist(),
            "covariance": self.covariance.tolist(),
            "blind": [{"name": b.name, "tied_to": list(b.tied_to)} for b in self.blind],
            "sigma": self.sigma.tolist(),
            "n_samples": self.n_samples.tolist(),
            "condition": self.condition,
            "condition_normalised": self.condition_normalised,
            "per_run": [
                {
                    "run": own.run,
                    "names": list(own.parameters.names),
                    "units": list(own.parameters.units),
                    "values": own.parameters.values.tolist(),
                    "std": own.std.tolist(),
                }
                for own in self.per_run
            ],
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> "Estimate":
        """The estimate that `to_dict` wrote."""
        size = len(data["names"])
        covariance = frozen(np.reshape(data["covariance"], (size, size)))
        values = frozen(data["values"])
        if not np.isfinite(values).all() or not (np.diag(covariance) >= 0.0).all():
            raise ValueError("an estimated value is not finite, or a variance is negative")
        return cls(
            estimator=data["estimator"],
            parameters=Parameters(data["names"], data["units"], values),
            covariance=covariance,
            blind=tuple(Blind(b["name"], tuple(b["tied_to"])) for b in data["blind"]),
            sigma=frozen(data["sigma"]),
            n_samples=frozen(data["n_samples"]),
            condition=data["condition"],
            condition_normalised=data["condition_normalised"],
            per_run=tuple(
                OfRun(
                    own["run"],
                    Parameters(own["names"], own["units"], own["values"]),
                    frozen(own["std"]),
                )
                for own in data["per_run"]
            ),
        )
