"""What an earlier identification of the robot knows: its noise, its values, its information."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from steelyard.arrays import Array, frozen
from steelyard.regression.base import BaseMap
from steelyard.regression.parallel_filter import ParallelFilter

_OVER = 20.0
"""Sampling rate over the cut-off; the independent samples a second do not depend on it."""


@dataclass(frozen=True, eq=False)
class Earlier:
    """What was learnt from an earlier log.

    Attributes:
        noise: Standard deviation of the filtered residuals, shape `(n,)` [Nm; N].
        cutoff: Of the filter that they came through [Hz].
        names: Base parameters that were estimated, `p` of them.
        values: Their values, shape `(p,)`.
        covariance: Shape `(p, p)`.
        standard: Values of standard parameters, by name.
        removed: Base parameters that the earlier model was reduced by: they are zero.
    """

    noise: Array
    cutoff: float
    names: tuple[str, ...]
    values: Array
    covariance: Array
    standard: Mapping[str, float]
    removed: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "noise", frozen(self.noise, (None,)))
        object.__setattr__(self, "names", tuple(self.names))
        object.__setattr__(self, "values", frozen(self.values, (len(self.names),)))
        object.__setattr__(self, "covariance", frozen(self.covariance, (len(self.names),) * 2))

    @property
    def independent_rate(self) -> float:
        """Independent samples a second behind the filter [Hz]."""
        design = ParallelFilter.design(self.cutoff, _OVER * self.cutoff)
        return design.rate / (design.decimation * design.inflation)

    @property
    def weights(self) -> Array:
        """Information that a second holds, per squared regressor entry, shape `(n,)`."""
        return np.asarray(self.independent_rate / self.noise**2)

    def information(self, base: BaseMap, absent: Collection[str] = ()) -> Array:
        """Information on a model's base parameters; none on those that were not estimated.

        Args:
            base: The base parameters.
            absent: Parameters that the model does without; they are known to be zero.

        Returns:
            Shape `(b, b)`.
        """
        place = {name: k for k, name in enumerate(base.base_names)}
        known = [k for k, name in enumerate(self.names) if name in place or name in absent]
        own = np.linalg.pinv(self.covariance[np.ix_(known, known)], hermitian=True)
        left = [k for k, name in enumerate(self.names[j] for j in known) if name in place]
        targets = [place[self.names[known[k]]] for k in left]
        full = np.zeros((len(base), len(base)))
        full[np.ix_(targets, targets)] = own[np.ix_(left, left)]
        return full

    def to_dict(self) -> dict[str, Any]:
        """As JSON values; exact."""
        return {
            "noise": self.noise.tolist(),
            "cutoff_hz": self.cutoff,
            "names": list(self.names),
            "values": self.values.tolist(),
            "covariance": self.covariance.tolist(),
            "standard": dict(self.standard),
            "removed": list(self.removed),
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> "Earlier":
        """The inverse of `to_dict`."""
        return cls(
            data["noise"],
            float(data["cutoff_hz"]),
            tuple(data["names"]),
            data["values"],
            data["covariance"],
            dict(data["standard"]),
            tuple(data["removed"]),
        )
