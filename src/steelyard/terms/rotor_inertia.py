"""Inertia of rotors and gears, seen at the joint."""

from dataclasses import dataclass
from typing import ClassVar

from steelyard.kernel.dynamics import JointState
from steelyard.parameters import Parameter
from steelyard.robot.robot import Robot
from steelyard.terms.term import Columns, acting_on, diagonal, inertia_unit, per_joint


@dataclass(frozen=True)
class RotorInertia:
    r"""Reflected rotor inertia, $\tau_j = I_{a,j}\,\ddot q_j$ [kg m²; kg on a prismatic joint].

    Gyroscopic effects of the spinning rotors are neglected, as is customary above a gear ratio
    of about 30 [Khalil2002, ch. 9].
    """

    law: ClassVar[str] = "rotor_inertia"
    joints: tuple[str, ...] | None = None

    def parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        """One per joint, not negative."""
        return per_joint(robot, self.joints, self.law, inertia_unit, lower=0.0)

    def columns(self, robot: Robot, state: JointState) -> Columns:
        """The joint's acceleration."""
        return diagonal(acting_on(robot, self.joints), lambda j: state.ddq[j])
