"""Terms that act along coordinates."""

from dataclasses import dataclass

from steelyard.robot.robot import Robot
from steelyard.terms.axes import Along, Axis, coordinates
from steelyard.terms.term import Term


@dataclass(frozen=True, kw_only=True)
class ActsOnAxes(Term):
    """Where a term acts; every law that acts along coordinates has these fields.

    Attributes:
        joints: Names of the joints it acts on, or one name; all independent ones if nothing is
            named.
        motors: Names of motors of the robot's transmission, or one name.
        along: Coordinates of its own, by name: `{wrist = {joint_5 = 1.0, joint_6 = 1.0}}`; sizes of
            coefficients from 1e-6 to 1e6.
        per_run: Whether every run has parameters of its own.
    """

    joints: tuple[str, ...] | str | None = None
    motors: tuple[str, ...] | str | None = None
    along: Along | None = None
    per_run: bool = False

    def axes(self, robot: Robot) -> tuple[Axis, ...]:
        """The coordinates it acts along.

        Raises:
            ModelError: The robot has no joint or motor of a name, or a coordinate is none.
        """
        return coordinates(robot, self.joints, self.motors, self.along)

    @property
    def on_motors(self) -> bool:
        """Whether it names motors."""
        return self.motors is not None
