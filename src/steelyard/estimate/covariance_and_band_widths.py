"""How certain predicted efforts are: covariance, half-widths of 95 % bands, joints at rest.

$$S = Y C Y^T + D R D$$

with the regressor $Y$ and the covariance $C$ of its parameters, residuals of the standard
deviations $D$ by joint and speed, as left-out motions have them, and their correlation $R$. A
joint at rest has friction anywhere in its dead zone.

Noise gives a predicted effort the standard deviation $s$. What a model lacks adds to it, and only
motion that was not fitted shows how much: the 95 % quantile of $|e| / s$ over left-out samples, per
joint and per range of its speed, takes the place of 1.96 (split conformal prediction, every run
left out in turn [Vovk2005] [Barber2021]).
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.base.arrays import Z95, Array, frozen, of_json_values, set_fields
from steelyard.estimate.external.contact_thresholds import ResidualPeaks
from steelyard.model.model import ValuedModel
from steelyard.model.torque_and_quantities import FRICTION
from steelyard.robot.loop_closures import loop_equations

Kind = Literal["runs", "stretches"]

EDGES = (0.25, 1.0)  # where slow, medium, fast meet, in rms of a joint's speed while fitting
BINS = 2 + len(EDGES)  # ranges of speed: at rest, slow, medium, fast


@dataclass(frozen=True, eq=False)
class Calibration:
    """Half-widths of 95 % bands in standard deviations, by joint and speed.

    What parameters leave open counts with 1.96 at least.
    """

    kind: Kind  # whether whole runs were left out, or stretches of one motion
    count: int  # how many of them
    edges: Array  # speeds at which slow, medium and fast meet, shape `(n, 2)` [rad/s; m/s]
    factors: Array  # at rest, slow, medium, fast, `(n, 4)`; 1.96 where nothing left out tests
    peaks: ResidualPeaks | None = None  # left-out, for thresholds of contact; none in old models
    correlation: Array | None = None  # of left-out errors between joints, `(n, n)`

    def __post_init__(self) -> None:
        n = len(self.edges)
        edges, factors = frozen(self.edges, (n, len(EDGES))), frozen(self.factors, (n, BINS))
        set_fields(self, edges=edges, factors=factors)
        if self.correlation is not None:
            set_fields(self, correlation=frozen(self.correlation, (n, n)))

    @property
    def text(self) -> str:
        """What it rests on, for people to read."""
        what = "runs" if self.kind == "runs" else "segments of one motion"
        return f"calibrated on {self.count} left-out {what}"

    def factor(self, speed: Array, moving: NDArray[np.bool_]) -> Array:
        """Half-width in standard deviations, shape `(n, B)`, as `speed` and `moving` are."""
        return np.take_along_axis(self.factors, bins(speed, moving, self.edges), axis=1)

    def to_dict(self) -> dict[str, Any]:
        """As JSON values."""
        return {
            "left_out": self.kind,
            "count": self.count,
            "speed_edges": self.edges.tolist(),
            "factors": self.factors.tolist(),
            "peaks": None if self.peaks is None else self.peaks.to_dict(),
            "correlation": None if self.correlation is None else self.correlation.tolist(),
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> "Calibration":
        """The calibration that `to_dict` wrote."""
        found = of_json_values(
            cls, {**data, "kind": data["left_out"], "edges": data["speed_edges"], "peaks": None}
        )
        if not (np.isfinite(found.factors).all() and (found.factors > 0.0).all()):
            raise ValueError("a factor of the band's calibration is not a number above zero")
        if found.kind not in ("runs", "stretches"):
            raise ValueError(f"a band cannot be calibrated on left-out '{found.kind}'")
        correlation, peaks = found.correlation, data.get("peaks")
        if correlation is not None and not (np.linalg.eigvalsh(correlation) > 0.0).all():
            raise ValueError("the correlation of left-out errors is not positive definite")
        return replace(found, peaks=None if peaks is None else ResidualPeaks.from_dict(peaks))


def bins(speed: Array, moving: NDArray[np.bool_], edges: Array) -> NDArray[np.intp]:
    """Range of speed of every sample: 0 at rest, then 1 to 3, shape `(n, B)`."""
    found = 1 + np.sum(np.abs(speed)[:, None, :] > edges[:, :, None], axis=1)
    return np.asarray(np.where(moving, found, 0), dtype=np.intp)


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
    """Factors `(..., c, c)` of covariances that rounding may have made slightly indefinite."""
    std = np.sqrt(np.maximum(np.diagonal(covariance, axis1=-2, axis2=-1), 0.0))
    scale = np.where(std > 0.0, std, 1.0)[..., None]
    values, vectors = np.linalg.eigh(covariance / scale / scale.swapaxes(-1, -2))
    return np.asarray(scale * vectors * np.sqrt(np.maximum(values, 0.0))[..., None, :])


SLOW = 0.02  # speed at which the dead zone is taken [rad/s; m/s]
SAMPLES = 64  # samples of the motion that lets friction with memory forget its start


def dead_zone(valued: ValuedModel) -> Array:
    """Half the range of efforts in which friction holds joints at rest, `(n,)` [Nm; N].

    Friction that depends on the load is taken at the reference posture.
    """
    robot = valued.robot
    posture = loop_equations(robot).assembly[: robot.n] if robot.loops else np.zeros(robot.n)
    travel = 1.5 * valued.model.scan().warm_up[: robot.n, 0]
    way = np.linspace(-1.0, 0.0, SAMPLES)[:, None] * travel
    speed, still = np.full_like(way, SLOW), np.zeros_like(way)
    efforts = [
        valued.evaluate(FRICTION, posture + sign * way, sign * speed, still)[-1]
        for sign in (1.0, -1.0)
    ]
    return np.asarray(0.5 * np.abs(efforts[0] - efforts[1]))


REST_SPEED_SHARE = 0.02  # rest speed over the root mean square of a joint's speed while fitting
LOWEST_REST_SPEED = 1e-3  # rest speed of a joint of which nothing is known [rad/s; m/s]


def rest_speed_of(n: int, known: Calibration | None, given: ArrayLike | None) -> Array:
    """Rest speed on a stream, `(n,)`: of the robot file, else a share of speeds while fitting."""
    if given is not None:
        return frozen(np.broadcast_to(np.asarray(given, dtype=np.float64), (n,)))
    if known is None:
        return np.full(n, LOWEST_REST_SPEED)
    return np.maximum(REST_SPEED_SHARE * known.edges[:, 0] / EDGES[0], LOWEST_REST_SPEED)
