r"""Computed torque control, eq. 29 of [WangC]."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from steelyard.arrays import Array
from steelyard.control.feedforward import friction_torque
from steelyard.control.protocol import ControlTask
from steelyard.dynamics.quantity import TORQUE
from steelyard.errors import ModelError
from steelyard.model import ValuedModel
from steelyard.motion import Motion

FRICTIONLESS = replace(
    TORQUE, name="torque without friction", enters=lambda term: term.cause != "friction"
)
"""Torque of everything but friction."""

MOST_POSTURES = 2000
"""Postures of a motion at which the mass matrix is examined."""


@dataclass(frozen=True, eq=False)
class ComputedTorque:
    r"""$\tau = M(q)(\ddot q_d + k_v \dot e + k_p e) + b(q, \dot q) + \tau_f(\dot q_d)$.

    $b$ is everything that depends on the measured position and velocity but friction: Coriolis and
    centrifugal torque, gravity, springs. Friction is that of the desired velocity, because that of
    the measured one chatters; the law as printed in [WangC] has none.

    Attributes:
        model: Model with values.
        kp: Stiffness per inertia [1/s²].
        kv: Damping per inertia [1/s].
        friction: Whether friction is part of the law.

    Raises:
        ModelError: The mass matrix of the model is not positive definite along the motion.
    """

    kind: ClassVar[str] = "computed_torque"
    needs_model: ClassVar[bool] = True
    model: ValuedModel
    kp: float = 400.0
    kv: float = 40.0
    friction: bool = True

    def start(self, task: ControlTask) -> "ComputedTorqueLoop":
        """A loop at its first tick."""
        refuse_indefinite(self.model, task.motion)
        return ComputedTorqueLoop(self, task)


class ComputedTorqueLoop:
    """Computed torque control at work."""

    def __init__(self, control: ComputedTorque, task: ControlTask) -> None:
        self._compared, self._ddq = task.compared, task.motion.ddq
        self._kp, self._kv = control.kp, control.kv
        self._stepper = control.model.start()
        self._friction = np.zeros_like(self._ddq)
        if control.friction:
            self._friction = friction_torque(control.model, task.motion)

    def torque(self, k: int, q: Array, dq: Array) -> Array:
        """Commanded joint torques at tick `k`, shape `(n,)`."""
        goal = self._compared
        feedback = self._kv * (goal.dq[k] - dq) + self._kp * (goal.q[k] - q)
        torque = self._stepper.evaluate(FRICTIONLESS, q, dq, self._ddq[k] + feedback)
        return np.asarray(torque + self._friction[k])


def refuse_indefinite(model: ValuedModel, motion: Motion) -> None:
    """The mass matrix is positive definite along a motion.

    Raises:
        ModelError: It is not, at the posture and time that the message names.
    """
    rows = np.unique(np.linspace(0, len(motion) - 1, MOST_POSTURES).round().astype(int))
    least = np.linalg.eigvalsh(model.mass_matrix(motion.q[rows]))[:, 0]
    worst = int(least.argmin())
    if least[worst] > 0.0:
        return
    k = rows[worst]
    joints = zip(model.model.robot.coordinates, motion.q[k], strict=True)
    posture = ", ".join(f"{joint.name} {q:.4g} {joint.unit}" for joint, q in joints)
    raise ModelError(
        f"the mass matrix of the model is not positive definite at {posture}: its least "
        f"eigenvalue is {least[worst]:.3g}, so the computed torque would accelerate the wrong way",
        where=f"model of '{model.model.robot.name}', {motion.t[k]:.4g} s of the motion",
        fix='identify with physically consistent bodies (method "consistent"), or use torque '
        "feedforward, which needs no mass matrix",
    )
