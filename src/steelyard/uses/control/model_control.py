r"""Torque feedforward and computed torque control, and all controllers by their names."""

from dataclasses import dataclass, fields, replace
from math import isfinite
from typing import Any, ClassVar

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import ModelError, advice
from steelyard.base.motion import Motion
from steelyard.model.model import ValuedModel
from steelyard.model.quantity import TORQUE
from steelyard.uses.control.joint_control import PD, PID, Cascade, Control, ControlLoop, ControlTask
from steelyard.uses.control.model_torques import SIGN_SMOOTHING, feedforward_torque, friction_torque


@dataclass(frozen=True, eq=False)
class TorqueFeedforward:
    """A controller, and torques of a model along the desired motion.

    Attributes:
        smoothing: Speed within which friction by the plain sign turns [rad/s; m/s].
    """

    kind: ClassVar[str] = "feedforward"
    needs_model: ClassVar[bool] = True
    inner: Control
    model: ValuedModel
    smoothing: float = SIGN_SMOOTHING

    def start(self, task: ControlTask) -> "TorqueFeedforwardLoop":
        """A loop at its first tick."""
        torque = feedforward_torque(self.model, task.motion, self.smoothing)
        return TorqueFeedforwardLoop(self.inner.start(task), torque)


class TorqueFeedforwardLoop:
    """A controller at work, with the torques to be added, shape `(N, n)`."""

    def __init__(self, inner: ControlLoop, torque: Array) -> None:
        self._inner, self._torque = inner, torque

    def torque(self, k: int, q: Array, dq: Array) -> Array:
        """Commanded joint torques at tick `k`, shape `(n,)`."""
        return np.asarray(self._inner.torque(k, q, dq) + self._torque[k])


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
    """The mass matrix is positive definite along a motion."""
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


CONTROLS: tuple[type[Any], ...] = (PD, PID, Cascade, ComputedTorque)
"""All controllers. Their numbers are gains, above zero; `friction` is 0 or 1."""


def control_of(text: str, model: ValuedModel | None = None) -> Control:
    """The controller of a text such as `cascade` or `computed_torque,kp=100,kv=5`.

    With a model, controllers that do not compute with it get its torques as feedforward.
    """
    name, *given = text.split(",")
    kinds = {kind.kind: kind for kind in CONTROLS}
    if name not in kinds:
        raise ModelError(
            f"there is no controller '{name}'",
            where="--control",
            fix=advice(name, kinds, "controllers"),
        )
    kind = kinds[name]
    gains = dict(_gain(one, kind, text) for one in given)
    if not kind.needs_model:
        control: Control = kind(**gains)
        return control if model is None else TorqueFeedforward(control, model)
    if model is None:
        raise ModelError(
            f"controller '{name}' computes with a model, and none is given",
            where="--control",
            fix="add --model MODEL, or use pd, pid or cascade",
        )
    found: Control = kind(model, **gains)
    return found


def _gain(text: str, kind: type[Any], whole: str) -> tuple[str, float | bool]:
    """Name and value of one gain."""
    name, _, number = text.partition("=")
    known = [field.name for field in fields(kind) if field.name != "model"]
    if name not in known:
        wrong, fix = f"controller '{kind.kind}' has no gain '{name}'", advice(name, known, "gains")
        raise ModelError(wrong, where=f"--control {whole}", fix=fix)
    if name == "friction" and number in ("0", "1"):
        return name, number == "1"
    try:
        value = float(number)
    except ValueError:
        value = float("nan")
    if name == "friction" or not (isfinite(value) and value > 0.0):
        above = f"give a number above zero, such as {name}=100"
        raise ModelError(
            f"'{number}' is no value of '{name}'",
            where=f"--control {whole}",
            fix="give friction=0 or friction=1" if name == "friction" else above,
        )
    return name, value
