"""Limits and constraints of a motion: their margins, and what is proven of them at all times."""

import hashlib
import json
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from steelyard.base.arrays import Array, frozen
from steelyard.base.files import write_json
from steelyard.base.progress import Progress, report_progress, silent
from steelyard.excite.trajectories.trajectory import (
    ORDERS,
    ExactTrajectory,
    Jump,
    unrest,
    velocity_jumps,
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


@dataclass(frozen=True)
class Proof:
    """Margins of one constraint.

    Attributes:
        how: How they were proven, in one sentence.
        proven: A lower bound of each that holds at all times.
        sampled: The least of each at samples; from the constraint's `activation_distance` on it may
            be less, as the constraint computes no more there, but it is never less than `proven`.
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
    return Proof(
        constraint.name,
        constraint.unit,
        constraint.how,
        tuple(constraint.labels),
        tuple(float(x) for x in proven),
        tuple(float(x) for x in sampled),
        tuple(float(x) for x in constraint.activation_distance),
        constraint.scope,
        tuple(float(x) for x in constraint.scale),
    )


EXTREMES = (
    "extremes over all times from the motion's polynomials, enlarged by a bound of the rounding "
    "error"
)
"""How limits of single joints are proven."""

COVERS = (
    "the motion from start to end; not covered are the approach to the start posture, and "
    "accelerations and torques that a controller adds between the points of a file"
)
"""What a certificate is about."""


@dataclass(frozen=True)
class Extreme:
    """How far one derivative of one joint goes over all times.

    It may go from `lower` to `upper`; `None` for any.
    """

    joint: str
    quantity: str
    unit: str
    least: float
    greatest: float
    lower: float | None
    upper: float | None

    @property
    def margin(self) -> float | None:
        """What is left to the nearer limit, negative beyond it; `None` without limits."""
        below = None if self.lower is None else self.least - self.lower
        above = None if self.upper is None else self.upper - self.greatest
        return min((x for x in (below, above) if x is not None), default=None)


@dataclass(frozen=True)
class Certificate:
    """What is proven of one motion of one robot.

    Attributes:
        trajectory: SHA-256 of the motion's JSON, see `trajectory_hash`.
        duration: Length in time [s].
        how: How the extremes were found, in one sentence.
        extremes: Joint by joint, the four quantities of each.
        notes: What was assumed and not looked at, one sentence each.
    """

    robot: str
    trajectory: str
    duration: float
    how: str
    extremes: tuple[Extreme, ...]
    proofs: tuple[Proof, ...]
    jumps: tuple[Jump, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def holds(self) -> bool:
        """Whether no limit is passed, no velocity jumps, and no proven margin is negative."""
        return not self.failures

    @property
    def gaps(self) -> tuple[str, ...]:
        """What is not covered, though not left out by request, one sentence each."""
        return tuple(n for n in self.notes if isinstance(n, Gap) and not isinstance(n, Declined))

    @property
    def declined(self) -> tuple[str, ...]:
        """What is not covered by the user's request, one sentence each."""
        return tuple(n for n in self.notes if isinstance(n, Declined))

    @property
    def uncovered(self) -> tuple[str, ...]:
        """What is not covered, for whatever reason, one sentence each."""
        return (*self.gaps, *self.declined)

    @property
    def failures(self) -> tuple[str, ...]:
        """What is not proven, and by how much, one line each."""
        beyond = [
            f"{x.quantity} of '{x.joint}' exceeds its limit by {-x.margin:.3g} {x.unit}"
            for x in self.extremes
            if x.margin is not None and not x.margin >= 0.0
        ]
        negative = [
            f"{proof.name}: {label}: "
            + (f"violated by {-seen:.3g} {proof.unit}" if seen < 0.0 else "not proven")
            for proof in self.proofs
            for label, least, seen in zip(proof.labels, proof.proven, proof.sampled, strict=True)
            if not least >= 0.0
        ]
        return (*beyond, *(str(jump) for jump in self.jumps), *negative)

    def to_dict(self) -> dict[str, Any]:
        """As values for JSON; a margin without a bound is `None`."""
        return {
            "kind": "certificate",
            "holds": self.holds,
            "robot": self.robot,
            "trajectory_sha256": self.trajectory,
            "duration_s": self.duration,
            "covers": COVERS,
            "not_covered": list(self.gaps),
            "not_covered_as_asked": list(self.declined),
            "how": self.how,
            "extremes": [{**vars(x), "margin": x.margin} for x in self.extremes],
            "jumps": [dict(vars(x)) for x in self.jumps],
            "constraints": [proof.to_dict() for proof in self.proofs],
            "notes": list(self.notes),
        }

    def write(self, path: Path) -> None:
        """Write as JSON."""
        write_json(path, self.to_dict())


def certify(
    robot: Robot,
    trajectory: ExactTrajectory,
    limits: MotionLimits,
    constraints: Sequence[Constraint] = (),
    progress: Progress = silent,
    notes: Sequence[str] = (),
    proven: Sequence[Array] | None = None,
) -> Certificate:
    """Find out what holds of a motion at all times.

    Args:
        robot: Gives names and units.
        trajectory: The motion.
        limits: Of single joints.
        constraints: What else it must keep.
        progress: Told of every constraint and of its proof.
        notes: What was assumed and not looked at; motions that do not rest at their ends add some.
        proven: Margins of each constraint, `(k,)` each, where they were proven of this motion
            before; proven here if `None`.
    """
    allowed: list[tuple[Array, Array] | None] = [
        (limits.lower, limits.upper),
        (-limits.velocity, limits.velocity),
        (-limits.acceleration, limits.acceleration),
        None if limits.jerk is None else (-limits.jerk, limits.jerk),
    ]
    reached = [trajectory.extremes(order) for order in range(len(ORDERS))]
    units = ("", "/s", "/s²", "/s³")
    extremes = [
        Extreme(
            joint.name,
            quantity,
            joint.unit + power,
            float(least[j]),
            float(greatest[j]),
            None if ends is None else float(ends[0][j]),
            None if ends is None else float(ends[1][j]),
        )
        for j, joint in enumerate(robot.coordinates)
        for quantity, power, (least, greatest), ends in zip(
            ORDERS, units, reached, allowed, strict=True
        )
    ]
    proofs = []
    for number, constraint in enumerate(constraints):
        report_progress(progress, "certificate", number, len(constraints))
        known = None if proven is None else proven[number]
        proofs.append(proof_of(trajectory, constraint, progress, known))
    return Certificate(
        robot=robot.name,
        trajectory=trajectory_hash(trajectory),
        duration=trajectory.duration,
        how=EXTREMES,
        extremes=tuple(extremes),
        proofs=tuple(proofs),
        jumps=velocity_jumps(robot, trajectory, limits.velocity),
        notes=(*notes, *unrest(trajectory, limits.velocity)),
    )


def trajectory_hash(trajectory: ExactTrajectory) -> str:
    """SHA-256 of the motion's JSON with sorted keys."""
    return hashlib.sha256(json.dumps(trajectory.to_dict(), sort_keys=True).encode()).hexdigest()
