"""Friction that falls when motion begins, by another amount in each direction."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from steelyard.base.arrays import Parameter
from steelyard.model.equations.inverse_dynamics import JointState, Scalar
from steelyard.model.laws.stribeck import Stribeck
from steelyard.model.terms.axes import directions, each, per_axis, spread
from steelyard.model.terms.model_files import Place, mean_curve_of_directions
from steelyard.model.terms.term import Columns
from steelyard.robot.robot import Robot


@dataclass(frozen=True)
class DirectionalStribeck(Stribeck):
    r"""Stribeck friction of its own in each direction.

    $$ f = \bigl(f_+ s_+(v) + f_- s_-(v)\bigr)\,e^{-|v/v_s|^\beta}, \qquad s_\pm = (s \pm |s|)/2 $$

    To be added to `directional_coulomb`, or to `coulomb` and `offset`. Its fields are those of
    `Stribeck`.
    """

    law: ClassVar[str] = "directional_stribeck"
    in_model_files: ClassVar[Place] = mean_curve_of_directions("excess of friction at breakaway")

    def parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        """The excess forward and backward per coordinate, not negative."""
        axes = self.axes(robot)
        return (
            *each(axes, f"{self.law}_forward", lambda axis: axis.effort_unit, lower=0.0),
            *each(axes, f"{self.law}_backward", lambda axis: axis.effort_unit, lower=0.0),
        )

    def columns(self, robot: Robot, state: JointState) -> Columns:
        """The direction of motion, its positive and its negative part, fading with speed."""
        axes = self.axes(robot)
        sense = directions(axes, state.dq, self.smoothing, self.law, self.shape)
        scales = per_axis(self.speed, axes, self.law)
        fading: list[Scalar] = []
        for axis, scale in zip(axes, scales, strict=True):
            relative = np.abs(axis.of(state.dq) / scale)
            fading.append(np.exp(-(relative if self.exponent == 1 else relative * relative)))
        return {
            **spread(axes, lambda k, _: 0.5 * (sense[k] + np.abs(sense[k])) * fading[k]),
            **spread(axes, lambda k, _: 0.5 * (sense[k] - np.abs(sense[k])) * fading[k], len(axes)),
        }
