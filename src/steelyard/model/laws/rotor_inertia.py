"""Inertia of rotors and gears."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from steelyard.base.arrays import Array
from steelyard.model.equations.inverse_dynamics import JointState, Scalars
from steelyard.model.terms.axes import Axes, Axis
from steelyard.model.terms.term import ActsOnAxes, Cause, Dissipation, Role
from steelyard.model.terms.terms_in_model_files import Place, as_one
from steelyard.robot.robot import Robot


@dataclass(frozen=True)
class RotorInertia(ActsOnAxes):
    r"""Rotor inertia, $f = I_a\,a$ with the coordinate's acceleration $a$ [kg m²; kg].

    On a joint it is the inertia reflected through the gear. Gyroscopic effects of the spinning
    rotors are neglected, as is customary above a gear ratio of about 30 [Khalil2002, ch. 9].
    """

    law: ClassVar[str] = "rotor_inertia"
    dissipation: ClassVar[Dissipation] = "none"
    cause: ClassVar[Cause] = "inertia"
    shown_by: ClassVar[str] = "stronger acceleration of"
    in_model_files: ClassVar[Place] = as_one("rotor")
    units: ClassVar[Mapping[str, str]] = {"": "{inertia}"}
    symbol: ClassVar[str] = "IA"
    role: ClassVar[Role] = "rotor"
    on_motors: ClassVar[bool] = True
    """Rotors turn before the gears, whatever coordinates they are given along."""
    shares: ClassVar[Mapping[str, tuple[float, float]]] = {"rotor_inertia": (0.2, 0.6)}

    def efforts(self, axes: Axes, state: JointState) -> Scalars:
        """The coordinate's acceleration."""
        return [axis.of(state.ddq) for axis in axes]

    def typical_values(
        self, robot: Robot, at_torque: Array, inertia: Callable[[Axis], float]
    ) -> Array:
        """The inertia that each coordinate moves."""
        return np.array([inertia(axis) for axis in self.axes(robot)])
