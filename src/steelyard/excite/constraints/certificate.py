"""The certificate of a motion: constraints, limits, jumps and standstills at all times."""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import compress
from pathlib import Path
from typing import Any

import numpy as np

from steelyard.base.arrays import Array, finite_json, records, stretches
from steelyard.base.files import write_json
from steelyard.excite.constraints.constraint_and_limits import (
    PROOF_SAMPLES,
    Constraint,
    Declined,
    Gap,
    MotionLimits,
)
from steelyard.excite.trajectories.exact_trajectories import (
    ORDERS,
    ExactTrajectory,
)
from steelyard.robot.robot import Robot

ROUNDING_JUMP_SHARE = 1e-9  # changes of velocity below this share of its limit are rounding

_JUMP_STEP_ULPS = 8.0


@dataclass(frozen=True)
class Jump:
    """A velocity that differs by `size` before and after a `time` [s]: infinite acceleration."""

    joint: str
    unit: str
    size: float
    time: float

    def __str__(self) -> str:
        """One line for people."""
        return (
            f"velocity of '{self.joint}' jumps by {self.size:.3g} {self.unit} "
            f"at t = {self.time:.6g} s"
        )


def velocity_jumps(robot: Robot, trajectory: ExactTrajectory, limit: Array) -> tuple[Jump, ...]:
    """The greatest jump of each joint that has one; velocities are limited to `limit`, `(n,)`."""
    end = trajectory.duration
    times = np.asarray(trajectory.breaks)
    times = times[(times > 0.0) & (times < end)]
    if not len(times):
        return ()
    # so far apart that times which are rounded within parts of the motion stay on their side
    step = _JUMP_STEP_ULPS * np.spacing(end)
    before = trajectory.derivative(np.maximum(times - step, 0.0), 1)
    after = trajectory.derivative(np.minimum(times + step, end), 1)
    sizes = np.abs(after - before)
    steepest = np.max(np.abs(trajectory.extremes(2)), axis=0)
    beyond = sizes - ROUNDING_JUMP_SHARE * limit - 2.0 * step * steepest
    worst = np.argmax(beyond, axis=0)
    return tuple(
        Jump(joint.name, f"{joint.unit}/s", float(sizes[worst[j], j]), float(times[worst[j]]))
        for j, joint in enumerate(robot.coordinates)
        if beyond[worst[j], j] > 0.0
    )


UNREST = (
    "the motion does not start at rest: the robot must already be moving",
    "the motion does not end at rest: the robot must be stopped afterwards",
)

HOLD_TEST_PLACES = (0.1, 0.5, 0.9)  # between two breaks, at which a hold is tested
STILL_SPEED_SHARE = 1e-9  # speed below which all joints stand still, over the motion's highest
SHORTEST_HOLD = 1e-3  # shortest time that counts as a hold [s]


def holds(motion: ExactTrajectory) -> Array:
    """Times for which all joints stand still, in their order [s]."""
    starts, ends = motion.breaks[:-1], motion.breaks[1:]
    fastest = max(float(np.max(np.abs(side))) for side in motion.extremes(1))
    times = starts[:, None] + np.outer(ends - starts, HOLD_TEST_PLACES)
    speeds = np.abs(motion.derivative(times.ravel(), 1)).reshape(*times.shape, -1)
    still = np.all(speeds <= STILL_SPEED_SHARE * fastest, axis=(1, 2))
    lengths = np.array([motion.breaks[b] - motion.breaks[a] for a, b in stretches(still)])
    return lengths[lengths >= SHORTEST_HOLD]


def holds_note(motion: ExactTrajectory) -> tuple[str, ...]:
    """One note on how often and how long a motion stands still; none if it never does."""
    found = holds(motion)
    if not len(found):
        return ()
    least, most = float(found.min()), float(found.max())
    same = most - least <= 1e-6 * most
    each = f"{most:.3g} s each time" if same else f"{least:.3g} to {most:.3g} s each time"
    times = "once" if len(found) == 1 else f"{len(found)} times"
    return (f"all joints are at standstill {times}: {each}, {found.sum():.3g} s in all",)


@dataclass(frozen=True)
class Proof:
    """Margins of one constraint, see there.

    What is `proven` is a lower bound of each that holds at all times, `sampled` the least of each
    at samples: from the `activation_distance` on it may be less, as the constraint computes no more
    there, but it is never less than `proven`. The `scale` is what each is a share of: the limit of
    an effort or power; of a distance, whose least value is no measure of it, the activation
    distance.
    """

    name: str
    unit: str
    how: str
    labels: tuple[str, ...]
    proven: tuple[float, ...]
    sampled: tuple[float, ...]
    activation_distance: tuple[float, ...]
    scope: str
    scale: tuple[float, ...]

    @property
    def used(self) -> tuple[float, ...]:
        """Share of each limit that is used: 1 where nothing is left, more where it is violated."""
        return tuple(1.0 - own / size for own, size in zip(self.proven, self.scale, strict=True))

    def to_dict(self) -> dict[str, Any]:
        """As values for JSON; a margin without a bound is `None`."""
        margins = records(
            label=self.labels,
            proven=finite_json(self.proven),
            sampled=self.sampled,
            room=self.activation_distance,
        )
        head = {"name": self.name, "unit": self.unit, "how": self.how, "scope": self.scope}
        return {**head, "margins": margins}


def proof_of(
    trajectory: ExactTrajectory, constraint: Constraint, known: Array | None = None
) -> Proof:
    """What is proven of a motion, or was before (`known`, `(k,)`), beside what samples show."""
    proven = constraint.proven(trajectory) if known is None else known
    motion = trajectory.sample(np.linspace(0.0, trajectory.duration, PROOF_SAMPLES))
    sampled = constraint.margins(motion.q, motion.dq, motion.ddq).values.min(axis=0)
    sampled = np.where(
        sampled >= constraint.activation_distance, np.maximum(sampled, proven), sampled
    )
    numbers = (proven, sampled, constraint.activation_distance, constraint.scale)
    least, seen, distance, scale = (tuple(map(float, one)) for one in numbers)
    c = constraint
    return Proof(c.name, c.unit, c.how, tuple(c.labels), least, seen, distance, c.scope, scale)


EXTREMES = (
    "extremes over all times from the motion's polynomials, enlarged by a bound of the rounding "
    "error"
)

COVERS = (
    "the motion from start to end; not covered are the approach to the start posture, and "
    "accelerations and torques that a controller adds between the points of a file"
)


@dataclass(frozen=True)
class Extreme:
    """How far one derivative of one joint goes over all times.

    It may go from `lower` to `upper`; both `None` for any.
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
        if self.lower is None or self.upper is None:
            return None
        return min(self.least - self.lower, self.upper - self.greatest)

    @property
    def used(self) -> float | None:
        """Share of the way from the middle between two limits to the nearer one that is used."""
        if self.margin is None or self.lower is None or self.upper is None:
            return None
        half = 0.5 * (self.upper - self.lower)
        return 1.0 - self.margin / half if half > 0.0 else None


@dataclass(frozen=True)
class Certificate:
    """What is proven of one motion, given by its `trajectory_hash`, of one robot.

    Extremes are joint by joint the four quantities of each, found as `how` says in one sentence;
    notes say what was assumed and not looked at.
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
    notes: Sequence[str] = (),
    proven: Sequence[Array] | None = None,
) -> Certificate:
    """Find out what holds of a motion at all times.

    Notes say what was assumed and not looked at; motions that do not rest at their ends add some.
    What was `proven` of this motion before, margins of each constraint, `(k,)` each, is not proven
    again.
    """
    units, anything = ("", "/s", "/s²", "/s³"), [None] * robot.n
    allowed = [*([low.tolist(), high.tolist()] for low, high in limits.bounds), [anything] * 2]
    reached = [[x.tolist() for x in trajectory.extremes(order)] for order in range(len(ORDERS))]
    extremes = [
        Extreme(joint.name, quantity, joint.unit + power, least[j], most[j], lower[j], upper[j])
        for j, joint in enumerate(robot.coordinates)
        for quantity, power, (least, most), (lower, upper) in zip(
            ORDERS, units, reached, allowed[: len(ORDERS)], strict=True
        )
    ]
    before = [None] * len(constraints) if proven is None else proven
    speeds = np.abs(trajectory.derivative([0.0, trajectory.duration], 1))
    moving = np.any(speeds > ROUNDING_JUMP_SHARE * limits.velocity, axis=1)
    return Certificate(
        robot=robot.name,
        trajectory=trajectory_hash(trajectory),
        duration=trajectory.duration,
        how=EXTREMES,
        extremes=tuple(extremes),
        proofs=tuple(proof_of(trajectory, *one) for one in zip(constraints, before, strict=True)),
        jumps=velocity_jumps(robot, trajectory, limits.velocity),
        notes=(*notes, *compress(UNREST, moving)),
    )


def trajectory_hash(trajectory: ExactTrajectory) -> str:
    """SHA-256 of the motion's JSON with sorted keys."""
    return hashlib.sha256(json.dumps(trajectory.to_dict(), sort_keys=True).encode()).hexdigest()
