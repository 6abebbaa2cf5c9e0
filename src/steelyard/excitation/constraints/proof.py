"""Margins of one constraint over all times of a motion, as a value."""

from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np

from steelyard.arrays import Array
from steelyard.excitation.constraints.constraint import Constraint
from steelyard.excitation.trajectories.exact import ExactTrajectory
from steelyard.progress import Progress

SAMPLES = 1000
"""Samples of a motion whose least margins stand beside the proven ones."""

BOUNDS = "bounds over time intervals that cover the whole motion"
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
    motion = trajectory.sample(np.linspace(0.0, trajectory.duration, SAMPLES))
    sampled = constraint.margins(motion.q, motion.dq, motion.ddq).values.min(axis=0)
    sampled = np.where(
        sampled >= constraint.activation_distance, np.maximum(sampled, proven), sampled
    )
    distances = tuple(float(x) for x in constraint.activation_distance)
    return Proof(
        constraint.name,
        constraint.unit,
        constraint.how if isinstance(constraint, Explained) else BOUNDS,
        tuple(constraint.labels),
        tuple(float(x) for x in proven),
        tuple(float(x) for x in sampled),
        distances,
        constraint.scope if isinstance(constraint, Scoped) else "",
        tuple(map(float, constraint.scale)) if isinstance(constraint, Scaled) else distances,
    )
