"""Inertia of rotors and gears."""

from dataclasses import dataclass
from typing import ClassVar

from steelyard.kernel.equations.dynamics import JointState
from steelyard.parameters import Parameter
from steelyard.robot.robot import Robot
from steelyard.terms.axes import Acting, each, spread
from steelyard.terms.term import Columns


@dataclass(frozen=True)
class RotorInertia(Acting):
    r"""Rotor inertia, $f = I_a\,a$ with the coordinate's acceleration $a$ [kg m²; kg].

    On a joint it is the inertia reflected through the gear. Gyroscopic effects of the spinning
    rotors are neglected, as is customary above a gear ratio of about 30 [Khalil2002, ch. 9].
    """

    law: ClassVar[str] = "rotor_inertia"

    def parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        """One per coordinate, not negative."""
        return each(self.axes(robot), self.law, lambda axis: axis.inertia_unit, lower=0.0)

    def columns(self, robot: Robot, state: JointState) -> Columns:
        """The coordinate's acceleration."""
        return spread(self.axes(robot), lambda _, axis: axis.of(state.ddq))
