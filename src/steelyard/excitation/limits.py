"""What a motion may ask of the joints, with a stated guess where the robot does not say."""

from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array, frozen
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
    ranges = [_range(c, assumed) for c in robot.coordinates]
    speeds = [_speed(c, assumed) for c in robot.coordinates]
    notes = [f"{what}: {', '.join(joints)}" for what, joints in assumed.items()]
    bounds = [DEFAULT_ACCELERATION[c.kind] for c in robot.coordinates]
    lower, upper = np.array(ranges).reshape(-1, 2).T
    return MotionLimits(lower, upper, frozen(speeds), frozen(bounds), tuple(notes))


def _range(joint: Coordinate, assumed: dict[str, list[str]]) -> tuple[float, float]:
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


def _speed(joint: Coordinate, assumed: dict[str, list[str]]) -> float:
    """Speed limit of a joint."""
    if np.isfinite(joint.limits.velocity) and joint.limits.velocity > 0.0:
        return joint.limits.velocity
    speed = DEFAULT_VELOCITY[joint.kind]
    what = f"without a speed limit, moved at {speed:.3g} {joint.unit}/s at most"
    assumed.setdefault(what, []).append(joint.name)
    return speed
