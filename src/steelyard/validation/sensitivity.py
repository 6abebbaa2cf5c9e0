"""How much a result hangs on the cut-offs: the same model fitted with other ones."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from steelyard.arrays import Array
from steelyard.parameters import Parameters

FACTORS = (0.5, 0.71, 1.41, 2.0)
"""What both cut-offs are multiplied with, one fit each."""


@dataclass(frozen=True, eq=False)
class Variation:
    """A fit with other cut-offs.

    Attributes:
        factor: Both cut-offs over those of the result.
        motion: Cut-off of the motion [Hz].
        matched: Matched cut-off [Hz].
        values: Its parameters, in the result's order, shape `(p,)`; `None` if it failed.
        fitted: Error on the runs that were fitted, of the headline's kind [%].
        unseen: The same on runs that were not; `None` without any.
        failed: Why there is no fit; empty if there is one.
    """

    factor: float
    motion: float
    matched: float
    values: Array | None
    fitted: float | None = None
    unseen: float | None = None
    failed: str = ""


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """Fits with other cut-offs beside the result.

    Attributes:
        parameters: The result's.
        std: Their standard deviations, shape `(p,)`.
        result: The result itself, with factor 1.
        variations: By factor.
    """

    parameters: Parameters
    std: Array
    result: Variation
    variations: Sequence[Variation]

    @property
    def spread(self) -> Array:
        """How far any of the fits has each parameter from the result, in standard deviations."""
        farthest: Array = np.max([self.shift(v) for v in self.variations], axis=0, initial=0.0)
        return farthest

    @property
    def rows(self) -> tuple[Variation, ...]:
        """The result among its variations, by factor."""
        return tuple(sorted((self.result, *self.variations), key=lambda v: v.factor))

    def shift(self, variation: Variation) -> Array:
        """How far one fit has each parameter from the result, in standard deviations."""
        if variation.values is None:
            return np.zeros(len(self.std))
        known = np.where(self.std > 0.0, self.std, np.inf)
        shift: Array = np.abs(variation.values - self.parameters.values) / known
        return shift

    def to_dict(self) -> dict[str, Any]:
        """As JSON values."""
        return {
            "fits": [
                {
                    "factor": v.factor,
                    "motion_cutoff": v.motion,
                    "matched_cutoff": v.matched,
                    "identification_percent": v.fitted,
                    "validation_percent": v.unseen,
                    "median_shift_in_std": (
                        None if v.values is None else float(np.median(self.shift(v)))
                    ),
                    "failed": v.failed or None,
                }
                for v in self.rows
            ],
            "parameters": [
                {"name": name, "largest_shift_in_std": float(spread)}
                for name, spread in zip(self.parameters.names, self.spread, strict=True)
            ],
        }
