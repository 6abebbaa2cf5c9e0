"""Friction that grows with a power of speed."""

from abc import abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from steelyard.base.arrays import Parameter
from steelyard.model.equations.inverse_dynamics import JointState, Scalar
from steelyard.model.terms.axes import each, spread
from steelyard.model.terms.model_files import Place, as_one, curve_over_speed
from steelyard.model.terms.term import ActsOnAxes, Cause, Columns, Dissipation
from steelyard.robot.robot import Robot

CREEP = 1e-12
"""Speed up to which the root is a straight line, so that its slope stays finite [rad/s; m/s]."""


class _OfSpeed(ActsOnAxes):
    """One parameter per coordinate, not negative, times a function of its speed."""

    dissipation: ClassVar[Dissipation] = "together"
    cause: ClassVar[Cause] = "friction"
    shown_by: ClassVar[str] = "motion at several speeds of"
    per: ClassVar[str]
    """Unit of the function, with `{}` for that of speed."""

    def parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        """One per coordinate, not negative."""
        axes = self.axes(robot)
        return each(axes, self.law, lambda x: x.effort_per(self.per.format(x.speed_unit)), 0.0)

    def columns(self, robot: Robot, state: JointState) -> Columns:
        """The function of each coordinate's speed."""
        return spread(self.axes(robot), lambda _, axis: self.curve(axis.of(state.dq)))

    @abstractmethod
    def curve(self, speed: Scalar) -> Scalar:
        """Friction per unit of the parameter; odd."""


@dataclass(frozen=True)
class Quadratic(_OfSpeed):
    r"""Friction with the square of speed, $f = f_2\,|v|\,v$: turbulent oil, fans."""

    law: ClassVar[str] = "quadratic"
    in_model_files: ClassVar[Place] = as_one("quadratic")
    per: ClassVar[str] = "({})²"

    def curve(self, speed: Scalar) -> Scalar:
        """The square with the speed's sign."""
        return np.abs(speed) * speed


@dataclass(frozen=True)
class Cubic(_OfSpeed):
    r"""Friction with the cube of speed, $f = f_3\,v^3$."""

    law: ClassVar[str] = "cubic"
    in_model_files: ClassVar[Place] = as_one("cubic")
    per: ClassVar[str] = "({})³"

    def curve(self, speed: Scalar) -> Scalar:
        """The cube."""
        return speed * speed * speed


@dataclass(frozen=True)
class Root(_OfSpeed):
    r"""Friction with the root of speed, $f = f_{1/2}\,\sqrt{|v|}\,\mathrm{sign}(v)$: grease."""

    law: ClassVar[str] = "root"
    in_model_files: ClassVar[Place] = curve_over_speed("friction with the root of speed")
    per: ClassVar[str] = "√({})"

    def curve(self, speed: Scalar) -> Scalar:
        """The root with the speed's sign."""
        return speed / np.sqrt(np.maximum(np.abs(speed), CREEP))
