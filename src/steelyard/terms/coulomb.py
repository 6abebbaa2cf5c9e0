"""Dry friction: a constant torque against the direction of motion."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from steelyard.errors import ModelError
from steelyard.kernel.dynamics import JointState, Scalar
from steelyard.parameters import Parameter
from steelyard.robot.robot import Robot
from steelyard.terms.axes import Acting, each, spread
from steelyard.terms.term import Columns


@dataclass(frozen=True)
class Coulomb(Acting):
    r"""Coulomb joint friction, $\tau_j = f_{c,j}\,s(\dot q_j)$ [Nm; N on a prismatic joint].

    $s$ is the sign of the velocity, zero up to `threshold` (Walker arm, eq. 3), or
    $\tanh(\dot q / w)$ with `smoothing` $w$.

    Attributes:
        threshold: Speed up to which the friction is zero [rad/s; m/s].
        smoothing: Speed scale of the smooth law [rad/s; m/s]; zero for the sign.
    """

    law: ClassVar[str] = "coulomb"
    threshold: float = 0.0
    smoothing: float = 0.0

    def __post_init__(self) -> None:
        if self.threshold < 0.0 or self.smoothing < 0.0 or (self.threshold and self.smoothing):
            raise ModelError(
                f"Coulomb friction with threshold {self.threshold} and smoothing {self.smoothing}",
                where="list of terms",
                mend="give one of the two, as a positive speed, or none for the plain sign",
            )

    def parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        """One per joint, not negative."""
        return each(self.axes(robot), self.law, lambda axis: axis.effort_unit, lower=0.0)

    def columns(self, robot: Robot, state: JointState) -> Columns:
        """Direction of motion."""
        return spread(self.axes(robot), lambda _, axis: self._direction(axis.of(state.dq)))

    def _direction(self, speed: Scalar) -> Scalar:
        if self.smoothing:
            return np.tanh(speed / self.smoothing)
        if self.threshold:
            return np.sign(speed) * (np.abs(speed) > self.threshold)
        return np.sign(speed)
