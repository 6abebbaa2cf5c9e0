"""Friction that grows with a power of speed."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from steelyard.kernel.dynamics import JointState
from steelyard.parameters import Parameter
from steelyard.robot.robot import Robot
from steelyard.terms.axes import Acting, each, spread
from steelyard.terms.term import Columns

CREEP = 1e-12
"""Speed up to which the root is a straight line, so that its slope stays finite [rad/s; m/s]."""


@dataclass(frozen=True)
class Quadratic(Acting):
    r"""Friction with the square of speed, $f = f_2\,|v|\,v$: turbulent oil, fans."""

    law: ClassVar[str] = "quadratic"

    def parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        """One per coordinate, not negative."""
        axes = self.axes(robot)
        return each(axes, self.law, lambda x: x.effort_per(f"({x.speed_unit})²"), lower=0.0)

    def columns(self, robot: Robot, state: JointState) -> Columns:
        """The speed's square, with its sign."""
        speeds = [axis.of(state.dq) for axis in self.axes(robot)]
        return spread(self.axes(robot), lambda k, _: np.abs(speeds[k]) * speeds[k])


@dataclass(frozen=True)
class Cubic(Acting):
    r"""Friction with the cube of speed, $f = f_3\,v^3$."""

    law: ClassVar[str] = "cubic"

    def parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        """One per coordinate, not negative."""
        axes = self.axes(robot)
        return each(axes, self.law, lambda x: x.effort_per(f"({x.speed_unit})³"), lower=0.0)

    def columns(self, robot: Robot, state: JointState) -> Columns:
        """The speed's cube."""
        speeds = [axis.of(state.dq) for axis in self.axes(robot)]
        return spread(self.axes(robot), lambda k, _: speeds[k] * speeds[k] * speeds[k])


@dataclass(frozen=True)
class Root(Acting):
    r"""Friction with the root of speed, $f = f_{1/2}\,\sqrt{|v|}\,\mathrm{sign}(v)$: grease."""

    law: ClassVar[str] = "root"

    def parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        """One per coordinate, not negative."""
        axes = self.axes(robot)
        return each(axes, self.law, lambda x: x.effort_per(f"√({x.speed_unit})"), lower=0.0)

    def columns(self, robot: Robot, state: JointState) -> Columns:
        """The speed's root, with its sign."""
        speeds = [axis.of(state.dq) for axis in self.axes(robot)]
        return spread(
            self.axes(robot),
            lambda k, _: speeds[k] / np.sqrt(np.maximum(np.abs(speeds[k]), CREEP)),
        )
