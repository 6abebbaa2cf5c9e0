r"""How far a controller may leave a motion between the points of a file, joint by joint.

With points a step $h$ apart, straight lines stay within $h^2 \max|\ddot q| / 8$, and lines whose
corners are rounded from half step to half step within $h^2 \max|\ddot q| / 4$. The error of a cubic
spline is taken at times $\delta$ apart; between them it is greater by at most
$\delta^2 \max|\ddot s - \ddot q| / 8$, and $\ddot s$ is greatest at a point.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from steelyard.arrays import Array
from steelyard.excitation.collision.room import RESERVE
from steelyard.excitation.export.export import EXPORTS, Export
from steelyard.excitation.export.points import even_times
from steelyard.excitation.result import Designed
from steelyard.excitation.trajectories.exact import ExactTrajectory
from steelyard.excitation.uncovered import Gap

_FINE = 64
_FASTER = 1.15
_MOST = 2000.0
_SPLINES = 1e-6


@runtime_checkable
class Reaching(Protocol):
    """A constraint that bounds how its margins change with the joints."""

    def reaches(self, lower: Array, upper: Array) -> Array:
        """Change of every margin per change of each joint within bounds, `(k, n)` [m/rad; 1]."""
        ...


@dataclass(frozen=True, eq=False)
class Distances:
    """The proven margins of a motion that depend on where the robot is.

    Attributes:
        labels: What each of the `k` margins is.
        proven: Shape `(k,)` [m].
        reaches: Their change per change of each joint, shape `(k, n)` [m/rad; 1].
    """

    labels: tuple[str, ...]
    proven: Array
    reaches: Array

    @classmethod
    def of(cls, designed: Designed, error: Array) -> "Distances":
        """Those of a design, for a robot that is at most `error` from the motion, `(n,)`."""
        lower, upper = designed.trajectory.extremes(0)
        pairs = zip(designed.constraints, designed.certificate.proofs, strict=True)
        kept = [(c, proof) for c, proof in pairs if isinstance(c, Reaching)]
        reaches = [c.reaches(lower - error, upper + error) for c, _ in kept]
        return cls(
            tuple(label for _, proof in kept for label in proof.labels),
            np.array([x for _, proof in kept for x in proof.proven]),
            np.concatenate([np.zeros((0, designed.robot.n)), *reaches]),
        )

    def short(self, error: Array) -> tuple[str, float] | None:
        """The margin that lacks most, and how much [m], if that is more than 0.05 mm."""
        left = self.proven - self.reaches @ error
        k = int(np.argmin(left)) if len(left) else -1
        return (self.labels[k], -float(left[k])) if k >= 0 and left[k] < -RESERVE else None


def error_between(trajectory: ExactTrajectory, between: str, rate: float) -> Array:
    """Bound of what a controller leaves a motion by between points, shape `(n,)` [rad; m].

    Args:
        trajectory: The motion.
        between: What the controller does there: `lines`, `rounded lines`, `cubic spline` or
            `quintic splines`, of which there are as many as they need.
        rate: Points a second.
    """
    if between == "quintic splines":
        return np.full(len(trajectory.extremes(0)[0]), _SPLINES)
    steepest = np.maximum(*(np.abs(x) for x in trajectory.extremes(2)))
    if between != "cubic spline":
        return np.asarray(steepest / rate**2 / (4.0 if between == "rounded lines" else 8.0))
    from scipy.interpolate import CubicSpline

    times = even_times(trajectory.duration, rate)
    spline = CubicSpline(times, trajectory.derivative(times, 0), bc_type="clamped")
    fine = np.linspace(0.0, trajectory.duration, _FINE * (len(times) - 1) + 1)
    seen = np.abs(spline(fine) - trajectory.derivative(fine, 0)).max(axis=0)
    bend = np.abs(spline(times, 2)).max(axis=0) + steepest
    return np.asarray(seen + bend * fine[1] ** 2 / 8.0)


def gaps_of_files(designed: Designed, forms: Sequence[str], rate: float | None) -> list[Gap]:
    """What is not proven of files for controllers, one sentence each.

    Args:
        designed: The motion; none of one whose certificate does not hold.
        forms: Names of formats.
        rate: Points a second; each format's own if `None`.
    """
    if not designed.certificate.holds:
        return []
    return [
        Gap(text)
        for export in (EXPORTS[form] for form in forms)
        if export.between is not None
        for text in _lacks(designed, export, export.between, rate or export.rate)
    ]


def _lacks(designed: Designed, export: Export, between: str, rate: float) -> list[str]:
    """What the way between the points of one file lacks, none or one sentence."""
    error = error_between(designed.trajectory, between, rate)
    kept = Distances.of(designed, error)
    lacking = kept.short(error)
    if lacking is None:
        return []
    enough = rate
    while enough <= _MOST and kept.short(error) is not None:
        enough = float(np.ceil(_FASTER * enough))
        error = error_between(designed.trajectory, between, enough)
    fix = f"; --rate {enough:g} is enough" if enough <= _MOST else ""
    label, lack = lacking
    return [
        f"{export.file} has {rate:g} points per second; between them ({between}) a controller may "
        f"violate a constraint by up to {_digits(1e3 * lack)} mm: {label}{fix}"
    ]


def _digits(value: float) -> str:
    """Two digits, without an exponent."""
    return f"{value:.0f}" if value >= 10.0 else f"{value:.2g}"
