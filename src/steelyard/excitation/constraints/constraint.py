"""What a motion must keep at all times, as margins that may not become negative."""

from dataclasses import dataclass
from typing import Protocol

from steelyard.arrays import Array
from steelyard.excitation.trajectories.exact import ExactTrajectory
from steelyard.progress import Progress, silent


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
