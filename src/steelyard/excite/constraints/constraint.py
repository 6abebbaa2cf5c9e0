"""Limits and constraints of a motion: their margins, and what is proven of them at all times."""

from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np

from steelyard.base.arrays import Array, frozen
from steelyard.base.progress import Progress, silent
from steelyard.excite.trajectories.trajectory import ExactTrajectory
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
    speeds = [_speed_limit(c, assumed) for c in robot.coordinates]
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


def _speed_limit(joint: Coordinate, assumed: dict[str, list[str]]) -> float:
    """Speed limit of a joint."""
    if np.isfinite(joint.limits.velocity) and joint.limits.velocity > 0.0:
        return joint.limits.velocity
    speed = DEFAULT_VELOCITY[joint.kind]
    what = f"without a speed limit, moved at {speed:.3g} {joint.unit}/s at most"
    assumed.setdefault(what, []).append(joint.name)
    return speed


class Gap(str):
    """A note on something that was not looked at, though it may matter."""

    __slots__ = ()


class Declined(Gap):
    """A note on something that was not checked at the user's request."""

    __slots__ = ()


@dataclass(frozen=True, eq=False)
class Margins:
    """Margins at samples, and how they change; a derivative that is zero by structure is `None`.

    Attributes:
        values: Shape `(N, k)`, in the constraint's unit; positive is kept.
        by_q: Shape `(N, k, n)`.
        by_dq: Shape `(N, k, n)`.
        by_ddq: Shape `(N, k, n)`.
    """

    values: Array
    by_q: Array | None = None
    by_dq: Array | None = None
    by_ddq: Array | None = None


class Constraint(Protocol):
    """Something that must hold at all times and is not linear in the motion.

    Attributes:
        name: For certificates and messages, such as `tool box`.
        labels: What each of the `k` margins is, such as `x of 'flange' above -0.75 m`.
        unit: Of the margins.
        activation_distance: Shape `(k,)`: the barrier acts on margins below it.
    """

    @property
    def name(self) -> str:
        """For certificates and messages."""
        ...

    @property
    def labels(self) -> tuple[str, ...]:
        """What each margin is."""
        ...

    @property
    def unit(self) -> str:
        """Of the margins."""
        ...

    @property
    def activation_distance(self) -> Array:
        """How far from zero a margin begins to matter, shape `(k,)`."""
        ...

    def margins(self, q: Array, dq: Array, ddq: Array) -> Margins:
        """Margins at states of shape `(N, n)`."""
        ...

    def proven(self, trajectory: ExactTrajectory, progress: Progress = silent) -> Array:
        """A lower bound of every margin that holds at all times of the trajectory, shape `(k,)`.

        Raises:
            Stopped: `progress` requested a stop.
        """
        ...


PROOF_SAMPLES = 1000
"""Samples of a motion whose least margins stand beside the proven ones."""

PROOF_BY_BOUNDS = "bounds over time intervals that cover the whole motion"
"""How a constraint is proven that does not say more."""


@runtime_checkable
class Explained(Protocol):
    """A constraint that says how it is proven."""

    @property
    def how(self) -> str:
        """One sentence."""


@runtime_checkable
class Scoped(Protocol):
    """A constraint that says what of the robot it is about."""

    @property
    def scope(self) -> str:
        """Such as `tool point only`."""


@runtime_checkable
class Scaled(Protocol):
    """A constraint of quantities that have a limit other than zero."""

    @property
    def scale(self) -> Array:
        """The limit behind every margin, shape `(k,)`."""


@dataclass(frozen=True)
class Proof:
    """Margins of one constraint.

    Attributes:
        name: Of the constraint.
        unit: Of the margins.
        how: How they were proven, in one sentence.
        labels: What each margin is.
        proven: A lower bound of each that holds at all times.
        sampled: The least of each at samples; from the constraint's `activation_distance` on it may
            be less, as the constraint computes no more there, but it is never less than `proven`.
        activation_distance: Activation distance of each.
        scope: What of the robot the constraint is about, if it says so.
        scale: What each margin is a share of: the limit of an effort or power; of a distance, whose
            least value is no measure of it, the activation distance.
    """

    name: str
    unit: str
    how: str
    labels: tuple[str, ...]
    proven: tuple[float, ...]
    sampled: tuple[float, ...]
    activation_distance: tuple[float, ...]
    scope: str = ""
    scale: tuple[float, ...] = ()

    @property
    def used(self) -> tuple[float, ...]:
        """Share of each limit that is used: 1 where nothing is left, more where it is violated."""
        scale = self.scale or self.activation_distance
        return tuple(1.0 - own / size for own, size in zip(self.proven, scale, strict=True))

    def to_dict(self) -> dict[str, Any]:
        """As values for JSON; a margin without a bound is `None`."""
        margins = [
            {"label": label, "proven": least if np.isfinite(least) else None, "sampled": seen}
            for label, least, seen in zip(self.labels, self.proven, self.sampled, strict=True)
        ]
        for values, distance in zip(margins, self.activation_distance, strict=True):
            values["room"] = distance
        head = {"name": self.name, "unit": self.unit, "how": self.how, "scope": self.scope}
        return {**head, "margins": margins}


def proof_of(
    trajectory: ExactTrajectory,
    constraint: Constraint,
    progress: Progress,
    known: Array | None = None,
) -> Proof:
    """What is proven of a motion, or was before (`known`, `(k,)`), beside what samples show."""
    proven = constraint.proven(trajectory, progress) if known is None else known
    motion = trajectory.sample(np.linspace(0.0, trajectory.duration, PROOF_SAMPLES))
    sampled = constraint.margins(motion.q, motion.dq, motion.ddq).values.min(axis=0)
    sampled = np.where(
        sampled >= constraint.activation_distance, np.maximum(sampled, proven), sampled
    )
    distances = tuple(float(x) for x in constraint.activation_distance)
    return Proof(
        constraint.name,
        constraint.unit,
        constraint.how if isinstance(constraint, Explained) else PROOF_BY_BOUNDS,
        tuple(constraint.labels),
        tuple(float(x) for x in proven),
        tuple(float(x) for x in sampled),
        distances,
        constraint.scope if isinstance(constraint, Scoped) else "",
        tuple(map(float, constraint.scale)) if isinstance(constraint, Scaled) else distances,
    )
