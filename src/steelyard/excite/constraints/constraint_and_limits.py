"""What a constraint of motions is, margins and a proof; limits of the joints, given or assumed."""

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from steelyard.base.arrays import Array, frozen, set_fields
from steelyard.excite.trajectories.exact_trajectories import ExactTrajectory
from steelyard.robot.robot import Coordinate, Robot


class Gap(str):
    """A note on something that was not looked at, though it may matter."""


class Declined(Gap):
    """A note on something that was not checked at the user's request."""


@dataclass(frozen=True, eq=False)
class Margins:
    """Margins at samples, `(N, k)`, and how they change, `(N, k, n)` each.

    Positive is kept. A derivative that is zero by structure is `None`.
    """

    values: Array
    by_q: Array | None = None
    by_dq: Array | None = None
    by_ddq: Array | None = None


PROOF_SAMPLES = 1000  # samples of a motion whose least margins stand beside the proven ones

PROOF_BY_BOUNDS = "bounds over time intervals that cover the whole motion"


class Constraint(ABC):
    """Something that must hold at all times and is not linear in the motion.

    Its labels say what each of the `k` margins is, such as `x of 'flange' above -0.75 m`; the
    barrier acts on margins below `activation_distance`, `(k,)`; the scope is what of the robot it
    is about, such as `tool point only`, and `how` the way of its proof, in one sentence.
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
    def proven(self, trajectory: ExactTrajectory) -> Array:
        """A lower bound of every margin that holds at all times of the trajectory, shape `(k,)`."""

    def reaches(self, lower: Array, upper: Array) -> Array | None:
        """Change of every margin per change of each joint within bounds, `(k, n)` [m/rad; 1].

        `None` if the margins depend on more than positions.
        """
        return None


DEFAULT_ACCELERATION = {"revolute": 5.0, "prismatic": 1.0}
DEFAULT_VELOCITY = {"revolute": 1.5, "prismatic": 0.3}
DEFAULT_RANGE = {"revolute": 1.5, "prismatic": 0.2}
ACCELERATIONS_ASSUMED = "accelerations are kept below 5 rad/s² (prismatic joints: 1 m/s²)"


@dataclass(frozen=True, eq=False)
class MotionLimits:
    """Bounds of a motion, all finite, shape `(n,)` each; of jerk `None` for any.

    [rad; m], [rad/s; m/s], [rad/s²; m/s²] and [rad/s³; m/s³]. Notes say what was assumed. Speeds,
    accelerations and jerks are the `share` of the limits that were given or assumed; `assumed` are
    quantity and joint of every limit that nobody has given.
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
        for name in ("lower", "upper", "velocity", "acceleration", "jerk"):
            if (values := getattr(self, name)) is not None:
                set_fields(self, **{name: frozen(values, (np.size(self.lower),))})

    @property
    def greatest(self) -> list[Array]:
        """Greatest speed, acceleration and, where limited, jerk."""
        return [self.velocity, self.acceleration] + ([] if self.jerk is None else [self.jerk])

    @property
    def bounds(self) -> list[tuple[Array, Array]]:
        """Lower and upper bound of position, speed, acceleration and, where limited, jerk."""
        return [(self.lower, self.upper), *((-most, most) for most in self.greatest)]


def motion_limits(robot: Robot) -> MotionLimits:
    """Limits of the robot's joints; what it does not state is assumed.

    Notes name assumed ranges and speeds; accelerations are those of `ACCELERATIONS_ASSUMED`.
    """
    narrowed, slowed = dict[str, list[str]](), dict[str, list[str]]()
    assumed = {("acceleration", name) for name in robot.joint_names}
    ranges, speeds = list[tuple[float, float]](), list[float]()
    for joint in robot.coordinates:
        lower, upper = joint.limits.lower, joint.limits.upper
        if not (np.isfinite([lower, upper]).all() and lower < upper):
            lower, upper = _assumed_range(joint)
            what = f"without a complete range, moved within {lower:.3g} .. {upper:.3g} {joint.unit}"
            narrowed.setdefault(what, []).append(joint.name)
            assumed.add(("position", joint.name))
        ranges.append((lower, upper))
        speed = joint.limits.velocity
        if not 0.0 < speed < np.inf:
            speed = DEFAULT_VELOCITY[joint.kind]
            what = f"without a speed limit, moved at {speed:.3g} {joint.unit}/s at most"
            slowed.setdefault(what, []).append(joint.name)
            assumed.add(("velocity", joint.name))
        speeds.append(speed)
    notes = tuple(f"{what}: {', '.join(joints)}" for what, joints in (narrowed | slowed).items())
    bounds = np.array([DEFAULT_ACCELERATION[c.kind] for c in robot.coordinates])
    low, high = np.array(ranges).reshape(-1, 2).T
    return MotionLimits(low, high, np.array(speeds), bounds, notes, assumed=frozenset(assumed))


def _assumed_range(joint: Coordinate) -> tuple[float, float]:
    """Position range where an end is missing: a set distance from the other, or from zero."""
    lower, upper, span = joint.limits.lower, joint.limits.upper, DEFAULT_RANGE[joint.kind]
    if np.isfinite(lower) and not np.isfinite(upper):
        return lower, lower + 2.0 * span
    if np.isfinite(upper) and not np.isfinite(lower):
        return upper - 2.0 * span, upper
    return -span, span
