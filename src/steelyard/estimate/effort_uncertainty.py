"""How certain predicted efforts are: covariance over the joints, from parameters and residuals.

$$S = Y C Y^T + D R D$$

with the regressor $Y$ and the covariance $C$ of its parameters, residuals of the standard
deviations $D$ by joint and speed, as left-out motions have them, and their correlation $R$. A
joint at rest has friction anywhere in its dead zone.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Z95, Array
from steelyard.estimate.effort_band_factors import Calibration


@dataclass(frozen=True, eq=False)
class EffortUncertainty:
    """Uncertainty of the efforts that a model predicts.

    Its functions take regressor entries `(B, n, c)`, velocities `(n, B)` [rad/s; m/s] and whether
    each joint moves, `(n, B)`.
    """

    factor: Array  # `F`, with `F @ F.T` the covariance of the columns' parameters, shape `(c, k)`
    sigma: Array  # standard deviation of residuals behind the observer, shape `(n,)` [Nm; N]
    dead_zone: Array  # half of the friction's dead zone at rest, shape `(n,)` [Nm; N]
    calibration: Calibration | None  # how much wider residuals of left-out motions are

    def factor_of(self, speed: Array, moving: NDArray[np.bool_]) -> Array:
        """How much wider residuals of left-out motions are than those of the fit, `(n, B)`."""
        if self.calibration is None:
            return np.ones(speed.shape)
        return np.asarray(self.calibration.factor(speed, moving) / Z95)

    def covariance(self, columns: Array, speed: Array, moving: NDArray[np.bool_]) -> Array:
        """Covariance of the efforts that the model predicts wrongly, shape `(B, n, n)`."""
        spread, noise = self.spread(columns, speed, moving), self.noise(speed, moving)
        noise_part = noise[:, :, None] * self.correlation * noise[:, None, :]
        return np.asarray(spread @ spread.swapaxes(1, 2) + noise_part)

    def spread(self, columns: Array, speed: Array, moving: NDArray[np.bool_]) -> Array:
        """Efforts per standard deviation of independent combinations of parameters, `(B, n, k)`.

        As in prediction bands, factors below 1 do not make parameters surer.
        """
        factor = np.maximum(self.factor_of(speed, moving), 1.0)
        return np.asarray(factor.T[:, :, None] * (columns @ self.factor))

    def noise(self, speed: Array, moving: NDArray[np.bool_]) -> Array:
        """Standard deviations of residuals, shape `(B, n)` [Nm; N]."""
        noise = self.factor_of(speed, moving) * self.sigma[:, None]
        return np.asarray(np.where(moving, noise, np.maximum(noise, self.at_rest[:, None])).T)

    @cached_property
    def at_rest(self) -> Array:
        """Standard deviation of a joint that rests in the dead zone of its friction, `(n,)`."""
        return np.asarray(np.hypot(self.sigma, self.dead_zone / np.sqrt(3.0)))

    @cached_property
    def correlation(self) -> Array:
        """Correlation of residuals between joints, shape `(n, n)`; none if nothing is known."""
        known = None if self.calibration is None else self.calibration.correlation
        return np.eye(len(self.sigma)) if known is None else known


def covariance_root(covariance: Array) -> Array:
    """A factor of a covariance that rounding may have made slightly indefinite."""
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    scale = np.where(std > 0.0, std, 1.0)
    values, vectors = np.linalg.eigh(covariance / scale[:, None] / scale)
    return np.asarray(scale[:, None] * vectors * np.sqrt(np.maximum(values, 0.0)))
