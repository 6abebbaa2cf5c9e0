"""What a constraint of motions is: margins and a proof; what is not checked of a motion."""

from abc import ABC, abstractmethod
from dataclasses import dataclass

from steelyard.base.arrays import Array
from steelyard.excite.trajectories.exact_slowed_and_chained_trajectories import ExactTrajectory


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
