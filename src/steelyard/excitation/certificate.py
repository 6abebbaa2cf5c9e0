"""What is proven of a motion at all times, as a value and as a file."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import DataError
from steelyard.excitation.constraint import Constraint
from steelyard.excitation.exact import ORDERS, ExactTrajectory
from steelyard.excitation.jumps import Jump, unrest, velocity_jumps
from steelyard.excitation.limits import MotionLimits
from steelyard.files import write_json
from steelyard.progress import Progress, silent, tell
from steelyard.robot.robot import Robot

SAMPLES = 1000
"""Samples of a motion whose least margins stand beside the proven ones."""

EXTREMES = (
    "extremes over all times from the motion's own polynomials, enlarged by what rounding may "
    "have taken"
)
"""How limits of single joints are proven."""

BOUNDS = "bounds over stretches of time that leave no time out"
"""How a constraint is proven that does not say more."""


@runtime_checkable
class Explained(Protocol):
    """A constraint that says how it is proven."""

    @property
    def how(self) -> str:
        """One sentence."""


@dataclass(frozen=True)
class Extreme:
    """How far one derivative of one joint goes.

    Attributes:
        joint: Name of the joint.
        quantity: Position, velocity, acceleration or jerk.
        unit: Of all numbers.
        least: Over all times.
        greatest: Over all times.
        lower: What is allowed; `None` for any.
        upper: Likewise.
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
class Proof:
    """Margins of one constraint.

    Attributes:
        name: Of the constraint.
        unit: Of the margins.
        how: How they were proven, in one sentence.
        labels: What each margin is.
        proven: A lower bound of each that holds at all times.
        sampled: The least of each at samples; from the constraint's `room` on it may be less, as
            the constraint tells no more there, but it is never less than `proven`.
    """

    name: str
    unit: str
    how: str
    labels: tuple[str, ...]
    proven: tuple[float, ...]
    sampled: tuple[float, ...]


@dataclass(frozen=True)
class Certificate:
    """What is proven of one motion of one robot.

    Attributes:
        robot: Name of the robot.
        trajectory: SHA-256 of the motion's JSON, see `trajectory_hash`.
        duration: Length in time [s].
        how: How the extremes were found, in one sentence.
        extremes: Joint by joint, the four quantities of each.
        proofs: One per constraint.
        jumps: Where velocities jump.
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
    def failures(self) -> tuple[str, ...]:
        """What is not proven, and by how much, one line each."""
        beyond = [
            f"{x.quantity} of '{x.joint}' goes {-x.margin:.3g} {x.unit} beyond its limit"
            for x in self.extremes
            if x.margin is not None and not x.margin >= 0.0
        ]
        negative = [
            f"{proof.name}: {label}: "
            + (f"missed by {-seen:.3g} {proof.unit}" if seen < 0.0 else "not proven")
            for proof in self.proofs
            for label, least, seen in zip(proof.labels, proof.proven, proof.sampled, strict=True)
            if not least >= 0.0
        ]
        return (*beyond, *(str(jump) for jump in self.jumps), *negative)

    def is_of(self, trajectory: ExactTrajectory) -> bool:
        """Whether it speaks of this very motion."""
        return self.trajectory == trajectory_hash(trajectory)

    def to_dict(self) -> dict[str, Any]:
        """As values for JSON; a margin without a bound is `None`."""
        return {
            "kind": "certificate",
            "holds": self.holds,
            "robot": self.robot,
            "trajectory_sha256": self.trajectory,
            "duration_s": self.duration,
            "how": self.how,
            "extremes": [{**vars(x), "margin": x.margin} for x in self.extremes],
            "jumps": [dict(vars(x)) for x in self.jumps],
            "constraints": [_proof_to_dict(proof) for proof in self.proofs],
            "notes": list(self.notes),
        }

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> "Certificate":
        """The certificate that `to_dict` wrote; what follows from the numbers is not read."""
        return cls(
            robot=values["robot"],
            trajectory=values["trajectory_sha256"],
            duration=float(values["duration_s"]),
            how=values["how"],
            extremes=tuple(
                Extreme(**{key: x for key, x in extreme.items() if key != "margin"})
                for extreme in values["extremes"]
            ),
            proofs=tuple(_proof_from_dict(proof) for proof in values["constraints"]),
            jumps=tuple(Jump(**jump) for jump in values.get("jumps", ())),
            notes=tuple(values.get("notes", ())),
        )

    def write(self, path: Path) -> None:
        """Write as JSON."""
        write_json(path, self.to_dict())


def read_certificate(path: Path) -> Certificate:
    """The certificate in a file.

    Raises:
        DataError: The file is missing or holds none.
    """
    try:
        return Certificate.from_dict(json.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise DataError(
            f"the file is no certificate: {error}",
            where=str(path),
            mend="give a certificate that steelyard wrote beside a trajectory",
        ) from error


def certify(
    robot: Robot,
    trajectory: ExactTrajectory,
    limits: MotionLimits,
    constraints: Sequence[Constraint] = (),
    progress: Progress = silent,
    notes: Sequence[str] = (),
) -> Certificate:
    """Find out what holds of a motion at all times.

    Args:
        robot: Gives names and units.
        trajectory: The motion.
        limits: Of single joints.
        constraints: What else it must keep.
        progress: Told of every constraint and of its proof.
        notes: What was assumed and not looked at; motions that do not rest at their ends add some.

    Raises:
        Stopped: `progress` asked to stop.
    """
    proofs = []
    for number, constraint in enumerate(constraints):
        tell(progress, "certificate", number, len(constraints))
        proofs.append(_proof(trajectory, constraint, progress))
    return Certificate(
        robot=robot.name,
        trajectory=trajectory_hash(trajectory),
        duration=trajectory.duration,
        how=EXTREMES,
        extremes=_extremes(robot, trajectory, limits),
        proofs=tuple(proofs),
        jumps=velocity_jumps(robot, trajectory, limits.velocity),
        notes=(*notes, *unrest(trajectory, limits.velocity)),
    )


def trajectory_hash(trajectory: ExactTrajectory) -> str:
    """SHA-256 of the motion's JSON with sorted keys."""
    return hashlib.sha256(json.dumps(trajectory.to_dict(), sort_keys=True).encode()).hexdigest()


def _extremes(
    robot: Robot, trajectory: ExactTrajectory, limits: MotionLimits
) -> tuple[Extreme, ...]:
    found = [trajectory.extremes(order) for order in range(len(ORDERS))]
    allowed: list[tuple[Array, Array] | None] = [
        (limits.lower, limits.upper),
        (-limits.velocity, limits.velocity),
        (-limits.acceleration, limits.acceleration),
        None if limits.jerk is None else (-limits.jerk, limits.jerk),
    ]
    return tuple(
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
            ORDERS, ("", "/s", "/s²", "/s³"), found, allowed, strict=True
        )
    )


def _proof(trajectory: ExactTrajectory, constraint: Constraint, progress: Progress) -> Proof:
    proven = constraint.proven(trajectory, progress)
    motion = trajectory.sample(np.linspace(0.0, trajectory.duration, SAMPLES))
    sampled = constraint.margins(motion.q, motion.dq, motion.ddq).values.min(axis=0)
    sampled = np.where(sampled >= constraint.room, np.maximum(sampled, proven), sampled)
    return Proof(
        constraint.name,
        constraint.unit,
        constraint.how if isinstance(constraint, Explained) else BOUNDS,
        tuple(constraint.labels),
        tuple(float(x) for x in proven),
        tuple(float(x) for x in sampled),
    )


def _proof_to_dict(proof: Proof) -> dict[str, Any]:
    margins = [
        {"label": label, "proven": least if np.isfinite(least) else None, "sampled": seen}
        for label, least, seen in zip(proof.labels, proof.proven, proof.sampled, strict=True)
    ]
    return {"name": proof.name, "unit": proof.unit, "how": proof.how, "margins": margins}


def _proof_from_dict(values: Mapping[str, Any]) -> Proof:
    margins = values["margins"]
    return Proof(
        values["name"],
        values["unit"],
        values["how"],
        tuple(x["label"] for x in margins),
        tuple(-np.inf if x["proven"] is None else float(x["proven"]) for x in margins),
        tuple(float(x["sampled"]) for x in margins),
    )
