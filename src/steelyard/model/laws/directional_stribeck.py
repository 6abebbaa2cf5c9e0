"""Friction that falls when motion begins, by another amount in each direction."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from steelyard.model.equations.inverse_dynamics import JointState
from steelyard.model.laws.stribeck import Stribeck
from steelyard.model.terms.axes import directions, spread
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
    ways: ClassVar[tuple[str, ...]] = ("_forward", "_backward")

    def columns(self, robot: Robot, state: JointState) -> Columns:
        """The direction of motion, its positive and its negative part, fading with speed."""
        axes = self.axes(robot)
        sense = directions(axes, state.dq, self.smoothing, self.law, self.shape)
        fading = self.fading(axes, state.dq)
        return {
            **spread(axes, lambda k, _: 0.5 * (sense[k] + np.abs(sense[k])) * fading[k]),
            **spread(axes, lambda k, _: 0.5 * (sense[k] - np.abs(sense[k])) * fading[k], len(axes)),
        }
