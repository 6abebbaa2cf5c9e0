"""Scales of the efforts, with their covariance, that a model's gains count already."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from steelyard.base.arrays import Z95, Array, frozen


@dataclass(frozen=True, eq=False, repr=False)
class KnownScales:
    """Scales that a model's gains count already."""

    joints: tuple[str, ...]
    values: Array  # logged effort over that of the model, shape `(rows,)`
    covariance: Array  # of their logarithms, shape `(rows, rows)`

    def __post_init__(self) -> None:
        n = len(self.joints)
        if self.values.shape != (n,) or self.covariance.shape != (n, n):
            raise ValueError(
                f"{n} joints need {n} scales of efforts with a covariance of shape ({n}, {n})"
            )

    @property
    def half_width(self) -> Array:
        """Half-widths of the 95 % intervals, shape `(rows,)`."""
        return Z95 * np.sqrt(np.diag(self.covariance)) * self.values

    @property
    def words(self) -> str:
        """Like `joint1 0.90, joint2 1.10`."""
        return ", ".join(
            f"{name} {x:.2f}" for name, x in zip(self.joints, self.values, strict=True)
        )

    def __repr__(self) -> str:
        """Each joint's scale with its 95 % interval."""
        known = zip(self.joints, self.values, self.half_width, strict=True)
        return ", ".join(f"{joint} {x:.3f} ± {half:.2g}" for joint, x, half in known)

    def to_dict(self) -> dict[str, Any]:
        """As JSON values; exact."""
        return {"values": self.values.tolist(), "covariance": self.covariance.tolist()}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any], joints: Sequence[str]) -> "KnownScales":
        """What `to_dict` wrote, of these joints."""
        return cls(tuple(joints), frozen(data["values"]), frozen(data["covariance"]))
