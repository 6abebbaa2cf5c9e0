"""Scales of the logged efforts that a model was identified with, and how well they are known."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from steelyard.arrays import Array, frozen


@dataclass(frozen=True, eq=False)
class KnownScales:
    """Scales that a model's gains count already.

    Attributes:
        values: Logged effort over that of the model, shape `(rows,)`.
        covariance: Of their logarithms, shape `(rows, rows)`.
    """

    values: Array
    covariance: Array

    def __post_init__(self) -> None:
        n = len(self.values)
        if self.covariance.shape != (n, n):
            raise ValueError(f"{n} scales of efforts need a covariance of shape ({n}, {n})")

    def words(self, joints: Iterable[str]) -> str:
        """Like `joint1 0.90, joint2 1.10`."""
        return ", ".join(f"{name} {x:.2f}" for name, x in zip(joints, self.values, strict=True))

    def to_dict(self) -> dict[str, Any]:
        """As JSON values; exact."""
        return {"values": self.values.tolist(), "covariance": self.covariance.tolist()}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> "KnownScales":
        """What `to_dict` wrote."""
        return cls(frozen(np.array(data["values"])), frozen(np.array(data["covariance"])))
