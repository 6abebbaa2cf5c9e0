"""A designed motion and all that is reported of it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from steelyard.arrays import Array
from steelyard.excitation.advice import Advice
from steelyard.excitation.constraints.certificate import Certificate
from steelyard.excitation.constraints.constraint import Constraint
from steelyard.excitation.constraints.markers import Marker
from steelyard.excitation.limits import MotionLimits
from steelyard.excitation.predicted_accuracy import PredictedAccuracy
from steelyard.excitation.trajectories.exact import ExactTrajectory
from steelyard.excitation.uncovered import Gap
from steelyard.robot.robot import Robot


@dataclass(frozen=True, eq=False)
class Designed:
    """A designed motion.

    Attributes:
        robot: The robot.
        trajectory: The motion.
        kind: Which motion it is, in a few words.
        limits: What the joints had to keep.
        certificate: What is proven of it.
        criterion: Name of the criterion that was minimised.
        shown: What the motion shows.
        course: Time [s] and criterion of every improvement of the search; empty if it was planned.
        searches: Searches that came to their end.
        seconds: What the design took [s].
        stopped: Whether the user ended it early.
        noise: Standard deviations of effort that predictions assume, shape `(n,)` [Nm; N].
        noise_from: Where they come from, for people.
        prior: Information of earlier runs about the base parameters, if it counts.
        values: Values of base parameters, as far as they are known.
        advice: What else would help.
        tool: The point whose path is shown.
        notes: What was assumed and decided, one sentence each.
        constraints: What the certificate's proofs are of, in their order.
        chosen: Base parameters that matter; all if `None`.
        faint: How many base parameters no motion shows apart from others: they are left out.
        absent: Base parameters that the model does without.
    """

    robot: Robot
    trajectory: ExactTrajectory
    kind: str
    limits: MotionLimits
    certificate: Certificate
    criterion: str
    shown: PredictedAccuracy
    course: tuple[tuple[float, float], ...]
    searches: int
    seconds: float
    stopped: bool
    noise: Array
    noise_from: str
    prior: Array | None
    values: Mapping[str, float]
    advice: tuple[Advice, ...]
    tool: Marker
    notes: tuple[str, ...]
    constraints: tuple[Constraint, ...] = ()
    chosen: tuple[int, ...] | None = None
    faint: int = 0
    absent: tuple[str, ...] = ()

    @property
    def chosen_parameters(self) -> tuple[int, ...]:
        """The base parameters that were to be shown: those chosen, or all."""
        return tuple(range(len(self.shown.names))) if self.chosen is None else self.chosen

    def with_gaps(self, gaps: Sequence[Gap]) -> "Designed":
        """The same with more that is not covered."""
        more = replace(self.certificate, notes=(*self.certificate.notes, *gaps))
        return replace(self, certificate=more, notes=(*self.notes, *gaps))
