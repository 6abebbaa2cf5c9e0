"""Whether the data ask for a scale of each joint's efforts, and whether one predicts better.

They ask where all scales being 1 is further from the estimate than chance explains: that tells
scales from chance. Whether they serve is judged by leaving one run out, one stretch of a single
run: scales are found without it, and its efforts predicted, in both cases with the weight of the
prior that all data give. Found anew for each part, that weight scatters more than the gain.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from steelyard.arrays import Array, frozen
from steelyard.errors import DataError
from steelyard.estimation.consistent.consistent import Consistent
from steelyard.estimation.effort_scales import DEVIATION, Scaled, Scales
from steelyard.estimation.estimate import Z95
from steelyard.estimation.fold_errors import FEWEST, FOLDS, logarithms
from steelyard.estimation.known_scales import KnownScales
from steelyard.progress import Progress, report_progress, silent
from steelyard.regression.information import Information
from steelyard.validation.cross import LEAST

BEFORE = f"known to ± {100.0 * Z95 * DEVIATION:.0f} % a priori (95 % interval)"
"""How well a scale is known without them, for people to read."""

CHANCE = 1e-3
"""Probability of such a distance, or a greater one, below which the data ask for scales."""


@dataclass(frozen=True, eq=False)
class EffortScales:
    """Scales of the logged efforts, estimated together with the parameters.

    Attributes:
        joints: Names of the effort rows.
        found: The scales.
        error: Relative error on what was left out, mean over parts: the geometric mean of a
            typical joint's and of all joints' together [%].
        without: The same with all scales 1 [%].
        scaled: Estimates with scales.
    """

    joints: tuple[str, ...]
    found: Scales
    error: float
    without: float
    scaled: Scaled

    @property
    def known(self) -> KnownScales:
        """What an identified model keeps of them."""
        return KnownScales(self.joints, frozen(self.found.values), frozen(self.found.covariance))

    @property
    def half_width(self) -> Array:
        """Half-widths of the 95 % intervals, shape `(rows,)`."""
        return self.known.half_width

    @property
    def note(self) -> str:
        """Scales with their intervals and what they gain, for people to read."""
        values = zip(self.joints, self.found.values, self.half_width, strict=True)
        listed = ", ".join(f"{joint} {x:.2f} ± {half:.2f}" for joint, x, half in values)
        return (
            f"a scale of the efforts is estimated per joint (logged over model, {BEFORE}): "
            f"{listed}; "
            f"error on left-out motion {self.error:.3g} % instead of {self.without:.3g} %; masses "
            'are as uncertain as the scales; effort_scales = "off" in [estimation] keeps the given '
            "gains"
        )

    def to_dict(self) -> dict[str, Any]:
        """As JSON values."""
        return {
            "joints": list(self.joints),
            "values": self.found.values.tolist(),
            "half_width": self.half_width.tolist(),
            "left_out_error_percent": self.error,
            "left_out_error_without_percent": self.without,
        }


def effort_scales(
    estimator: Consistent, information: Information, *, progress: Progress = silent
) -> EffortScales | None:
    """Scales, where the data ask for them and predict better with them.

    Args:
        estimator: The estimate without scales.
        information: What the runs say, efforts in the model's units.
        progress: Told about every part that is left out.

    Returns:
        `None` where scales are not requested, gain nothing, or cannot be judged.

    Raises:
        Stopped: `progress` requested a stop.
    """
    scaled = Scaled(estimator, information.layout.rows)
    try:
        start = scaled.unscaled(information)
        first = scaled.step(information, start)
        if not _significant(first):
            return None
        found = scaled.converged(information, first, weigh=True)
    except DataError:
        return None
    if not _significant(found):
        return None
    several = len({window.run for window in information.windows}) > 1
    folds = information.merged(1 if several else FOLDS)
    errors = []
    for fold in range(len(folds.windows)):
        report_progress(progress, "judging effort scales", fold, len(folds.windows))
        rest = folds.of([k for k in range(len(folds.windows)) if k != fold])
        left_out = folds.of([fold])
        try:
            plain = scaled.unscaled(rest, start.gamma)
            with_scales = scaled.converged(rest, found)
        except DataError:
            continue
        sizes = left_out.effort_squares()
        errors.append([_errors(left_out, scales, sizes) for scales in (plain, with_scales)])
    if len(errors) < FEWEST:
        return None
    plain_errors, scaled_errors = np.array(errors).T
    if (plain_errors - scaled_errors).mean() <= LEAST:
        return None
    mean = np.exp([scaled_errors.mean(), plain_errors.mean()])
    return EffortScales(information.layout.rows, found, float(mean[0]), float(mean[1]), scaled)


def _significant(scales: Scales) -> bool:
    """Whether scales of 1 are further away than chance explains."""
    from scipy.special import chdtrc

    return bool(chdtrc(len(scales.values), scales.distance) < CHANCE)


def _errors(left_out: Information, scales: Scales, sizes: Array) -> float:
    """Logarithm of the error on what was left out, efforts as logged."""
    logged = left_out.scaled(1.0 / scales.values, left_out.signature.effort)
    squares = logged.residual_squares(scales.parameters) * np.square(scales.values)
    shares = 100.0 * np.sqrt(squares / np.where(sizes > 0.0, sizes, np.inf))
    return float(logarithms(shares[None], sizes[None])[0])
