"""Rigid bodies: gravity, inertia, Coriolis and centrifugal torques; inertia of the rotors."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from steelyard.base.arrays import Array, Parameter
from steelyard.model.equations.inverse_dynamics import JointState, Scalar, Scalars, inverse_dynamics
from steelyard.model.terms.axes import Axes, Axis
from steelyard.model.terms.term import (
    ActsOnAxes,
    Cause,
    Columns,
    Dissipation,
    Place,
    Placed,
    Role,
    Term,
    Values,
    as_one,
)
from steelyard.robot.inertia_and_placement import INERTIAL_NAMES, INERTIAL_UNITS
from steelyard.robot.robot import Robot


def body_efforts(robot: Robot, state: JointState, numbers: Scalars) -> list[Scalar]:
    """Efforts of the bodies, from their numbers one after another; frames have none."""
    tens = [
        [0.0] * 10 if body.massless else numbers[10 * k : 10 * k + 10]
        for k, body in enumerate(robot.bodies)
    ]
    return inverse_dynamics(robot, state, tens)


@dataclass(frozen=True)
class RigidBody(Term):
    r"""Newton-Euler torques of all bodies, $\tau = Y(q, \dot q, \ddot q)\,\phi$.

    Ten numbers per body, about the origin of its link frame, in Pinocchio's order; those of a frame
    between the joints of one body are zero and have no columns. The columns are
    the reverse derivative of the inverse dynamics, so they exist over symbols only; arrays go
    through the traced program.
    """

    law: ClassVar[str] = "rigid_body"
    dissipation: ClassVar[Dissipation] = "none"
    cause: ClassVar[Cause] = "inertia"
    role: ClassVar[Role] = "body"
    shown_by: ClassVar[str] = "acceleration, one by one and together, of the joints up to"

    def parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        """Ten per body, named like `Izz.forearm`."""
        return tuple(
            Parameter(
                f"{name}.{body.name}",
                unit,
                lower=0.0 if name in ("m", "Ixx", "Iyy", "Izz") else float("-inf"),
                prior=float(value) if body.known else None,
            )
            for body in robot.bodies
            for name, unit, value in zip(
                INERTIAL_NAMES, INERTIAL_UNITS, body.inertia.ten, strict=True
            )
        )

    def columns(self, robot: Robot, state: JointState) -> Columns:
        """Reverse derivative of the inverse dynamics, without what is zero by structure."""
        from steelyard.symbolic.symbols_and_tracing import Symbol, number_of
        from steelyard.symbolic.tape_and_derivatives import Tape, backward, edges

        tape = Tape.current()
        numbers = [tape.variable() for _ in range(10 * len(robot.bodies))]
        flat: list[Scalar] = [Symbol(tape, number) for number in numbers]
        efforts = [number_of(tape, x) for x in body_efforts(robot, state, flat)]
        between, one = edges(tape, numbers), tape.constant(1.0)
        entries: dict[tuple[int, int], Scalar] = {}
        for row, effort in enumerate(efforts):
            slopes = backward(tape, between, {effort: one})
            for column, number in enumerate(numbers):
                if number in slopes and tape.known.get(slopes[number]) != 0.0:
                    entries[row, column] = Symbol(tape, slopes[number])
        return entries

    @staticmethod
    def numbers_of(robot: Robot, values: Mapping[str, float]) -> Array:
        """Ten numbers per body from those that are named, others zero, shape `(10 n_bodies,)`."""
        return np.array([values.get(p.name, 0.0) for p in RigidBody().parameters(robot)])

    def in_model_files(self, robot: Robot, values: Values) -> Placed:
        """Nothing beside the bodies, which every format holds."""
        return Placed()


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
