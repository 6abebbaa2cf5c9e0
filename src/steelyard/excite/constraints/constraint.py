"""Limits of a motion, and what a constraint is: margins with gradients, and their lower bounds."""

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from steelyard.base.arrays import Array, frozen
from steelyard.base.progress import Progress, silent
from steelyard.excite.trajectories.trajectory import (
    ExactTrajectory,
)
from steelyard.robot.robot import Coordinate, Robot

DEFAULT_ACCELERATION = {"revolute": 5.0, "prismatic": 1.0}
DEFAULT_VELOCITY = {"revolute": 1.5, "prismatic": 0.3}
DEFAULT_RANGE = {"revolute": 1.5, "prismatic": 0.2}
ACCELERATIONS_ASSUMED = "accelerations are kept below 5 rad/s² (prismatic joints: 1 m/s²)"


@dataclass(frozen=True, eq=False)
class MotionLimits:
    """Bounds of a motion, all finite.

    Attributes:
        lower: Lowest positions, shape `(n,)` [rad; m].
        upper: Highest positions, shape `(n,)` [rad; m].
        velocity: Highest speeds, shape `(n,)` [rad/s; m/s].
        acceleration: Highest accelerations, shape `(n,)` [rad/s²; m/s²].
        notes: One line for everything that was assumed.
        jerk: Highest jerks, shape `(n,)` [rad/s³; m/s³]; `None` for any.
        share: What speeds, accelerations and jerks are of the limits that were given or assumed.
        assumed: Quantity and joint of every limit that nobody has given.
    """

    lower: Array
    upper: Array
    velocity: Array
    acceleration: Array
    notes: tuple[str, ...] = ()
    jerk: Array | None = None
    share: float = 1.0
    assumed: frozenset[tuple[str, str]] = frozenset()

    def __post_init__(self) -> None:
        object.__setattr__(self, "lower", frozen(self.lower, (None,)))
        for name in ("upper", "velocity", "acceleration"):
            object.__setattr__(self, name, frozen(getattr(self, name), self.lower.shape))
        if self.jerk is not None:
            object.__setattr__(self, "jerk", frozen(self.jerk, self.lower.shape))
        if not np.all(self.lower < self.upper):
            raise ValueError("a lower position limit is not below its upper one")


def motion_limits(robot: Robot) -> MotionLimits:
    """Limits of the robot's joints; what it does not state is assumed.

    Notes name assumed ranges and speeds; accelerations, which no robot states, are those of
    `ACCELERATIONS_ASSUMED`.
    """
    assumed: dict[str, list[str]] = {}
    ranges = [_position_range(c, assumed) for c in robot.coordinates]
    speeds = []
    for joint in robot.coordinates:
        speed = joint.limits.velocity
        if not (np.isfinite(speed) and speed > 0.0):
            speed = DEFAULT_VELOCITY[joint.kind]
            what = f"without a speed limit, moved at {speed:.3g} {joint.unit}/s at most"
            assumed.setdefault(what, []).append(joint.name)
        speeds.append(speed)
    notes = [f"{what}: {', '.join(joints)}" for what, joints in assumed.items()]
    bounds = [DEFAULT_ACCELERATION[c.kind] for c in robot.coordinates]
    lower, upper = np.array(ranges).reshape(-1, 2).T
    return MotionLimits(lower, upper, frozen(speeds), frozen(bounds), tuple(notes))


def _position_range(joint: Coordinate, assumed: dict[str, list[str]]) -> tuple[float, float]:
    """Position range of a joint; a missing end is a set distance from the other, or from zero."""
    lower, upper = joint.limits.lower, joint.limits.upper
    if np.isfinite(lower) and np.isfinite(upper) and lower < upper:
        return lower, upper
    span = DEFAULT_RANGE[joint.kind]
    if np.isfinite(lower) and not np.isfinite(upper):
        lower, upper = lower, lower + 2.0 * span
    elif np.isfinite(upper) and not np.isfinite(lower):
        lower, upper = upper - 2.0 * span, upper
    else:
        lower, upper = -span, span
    what = f"without a complete range, moved within {lower:.3g} .. {upper:.3g} {joint.unit}"
    assumed.setdefault(what, []).append(joint.name)
    return lower, upper


class Gap(str):
    """A note on something that was not looked at, though it may matter."""

    __slots__ = ()


class Declined(Gap):
    """A note on something that was not checked at the user's request."""

    __slots__ = ()


@dataclass(frozen=True, eq=False)
class Margins:
    """Margins at samples, `(N, k)`, and how they change, `(N, k, n)` each.

    Positive is kept. A derivative that is zero by structure is `None`.
    """

    values: Array
    by_q: Array | None = None
    by_dq: Array | None = None
    by_ddq: Array | None = None


PROOF_SAMPLES = 1000
"""Samples of a motion whose least margins stand beside the proven ones."""

PROOF_BY_BOUNDS = "bounds over time intervals that cover the whole motion"
"""How a constraint is proven that does not say more."""


class Constraint(ABC):
    """Something that must hold at all times and is not linear in the motion.

    Attributes:
        name: For certificates and messages, such as `tool box`.
        labels: What each of the `k` margins is, such as `x of 'flange' above -0.75 m`.
        activation_distance: Shape `(k,)`: the barrier acts on margins below it.
        scope: What of the robot it is about, such as `tool point only`.
        how: How it is proven, in one sentence.
    """

    name: str
    labels: tuple[str, ...]
    unit: str
    activation_distance: Array
    scope: str = ""
    how: str = PROOF_BY_BOUNDS

    @property
    def scale(self) -> Array:
        """What each margin is a share of, shape `(k,)`; the limit, if that is not zero."""
        return self.activation_distance

    @abstractmethod
    def margins(self, q: Array, dq: Array, ddq: Array) -> Margins:
        """Margins at states of shape `(N, n)`."""

    @abstractmethod
    def proven(self, trajectory: ExactTrajectory, progress: Progress = silent) -> Array:
        """A lower bound of every margin that holds at all times of the trajectory, shape `(k,)`."""

    def reaches(self, lower: Array, upper: Array) -> Array | None:
        """Change of every margin per change of each joint within bounds, `(k, n)` [m/rad; 1].

        `None` if the margins depend on more than positions.
        """
        return None
