r"""Joint controllers: PD, PID, cascade, torque feedforward and computed torque control."""

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from math import isfinite, pi, sqrt
from typing import Any, ClassVar, Protocol

import numpy as np

from steelyard.base.arrays import Array, frozen, set_fields
from steelyard.base.errors import ModelError, named, refuse_unknown
from steelyard.base.motion import Motion
from steelyard.model.model import ValuedModel
from steelyard.model.torque_and_quantities import FRICTION, TORQUE
from steelyard.uses.control.feedforward import SIGN_SMOOTHING, feedforward_torque

BANDWIDTH = 20.0  # natural frequency of the error of a joint under default gains [Hz]


@dataclass(frozen=True, eq=False)
class ControlTask:
    """What a controller is to do, and what it knows of its robot without an identified model."""

    motion: Motion  # desired motion at every tick, `N` samples of `n` joints
    # the same as late as measured values are: what the loop would see on the desired motion, so
    # that delay alone is no error
    compared: Motion
    tick: float
    # mean inertia of each joint over its postures, shape `(n,)` [kg m²; kg]; gains are multiplied
    # with it
    inertia: Array
    # natural frequency up to which joint gains are stable [rad/s]: coupling of the joints, lag and
    # delay of the drives are counted
    fastest: float
    limits: Array  # largest torque of each joint, shape `(n,)` [Nm; N]

    def __post_init__(self) -> None:
        shape = (self.motion.n_joints,)
        set_fields(self, inertia=frozen(self.inertia, shape), limits=frozen(self.limits, shape))


ControlLoop = Callable[[int, Array, Array], Array]
"""A controller at work, which may have state: commanded joint torques `(n,)` [Nm; N] at a tick, of
its number, and of positions [rad; m] and velocities that the loop sees; ticks come one after
another."""


class Control(Protocol):
    """A kind of controller with its gains."""

    kind: ClassVar[str]  # its name in options
    needs_model: ClassVar[bool]  # whether it computes with a model of the robot

    def start(self, task: ControlTask) -> ControlLoop:
        """A loop at its first tick."""


@dataclass(frozen=True)
class PD:
    r"""Proportional and derivative feedback, $\tau_j = m_j (k_p e_j + k_d \dot e_j)$.

    $e = q_d - q$, and $m_j$ is the mean inertia of the joint.
    """

    kind: ClassVar[str] = "pd"
    needs_model: ClassVar[bool] = False
    # stiffness per inertia [1/s²]; if `None` that of 20 Hz, or lower where the joints are coupled
    # strongly
    kp: float | None = None
    kd: float | None = None  # damping per inertia [1/s]; critical damping if `None`

    def start(self, task: ControlTask) -> ControlLoop:
        """A loop at its first tick; it has no state."""
        omega, goal = natural_frequency(self.kp, task), task.compared
        stiffness = (omega**2 if self.kp is None else self.kp) * task.inertia
        damping = (2.0 * omega if self.kd is None else self.kd) * task.inertia
        desired, rates = goal.q, goal.dq

        def torque(k: int, q: Array, dq: Array) -> Array:
            return np.asarray(stiffness * (desired[k] - q) + damping * (rates[k] - dq))

        return torque


def natural_frequency(kp: float | None, task: ControlTask) -> float:
    """Natural frequency of a stiffness per inertia, or the default one [rad/s]."""
    return min(2.0 * pi * BANDWIDTH, task.fastest) if kp is None else sqrt(kp)


_INTEGRAL_FREQUENCY_SHARE = 0.2  # of the natural frequency, at which the default integral gain acts


@dataclass(frozen=True)
class PID:
    r"""$\tau_j = m_j (k_p e_j + k_d \dot e_j + k_i \int e_j\,dt)$, the integral within limits."""

    kind: ClassVar[str] = "pid"
    needs_model: ClassVar[bool] = False
    kp: float | None = None  # stiffness per inertia [1/s²], as of `PD`
    kd: float | None = None  # damping per inertia [1/s], as of `PD`
    ki: float | None = None  # per inertia [1/s³]; if `None`, a fifth of `kp` times its root

    def start(self, task: ControlTask) -> ControlLoop:
        """A loop at its first tick; its state is the integral part of the torque."""
        omega = natural_frequency(self.kp, task)
        ki = _INTEGRAL_FREQUENCY_SHARE * omega**3 if self.ki is None else self.ki
        proportional, desired = PD(self.kp, self.kd).start(task), task.compared.q
        step, limits, integral = ki * task.inertia * task.tick, task.limits, 0.0 * task.inertia

        def torque(k: int, q: Array, dq: Array) -> Array:
            np.clip(integral + step * (desired[k] - q), -limits, limits, out=integral)
            return np.asarray(proportional(k, q, dq) + integral)

        return torque


POSITION_GAIN, SPEED_GAIN, INTEGRAL_TIME = 30.0, 150.0, 0.03
"""Usual of industrial drives with a torque loop of some milliseconds [1/s], [1/s], [s]."""


@dataclass(frozen=True)
class Cascade:
    r"""P position loop and PI speed loop, with the desired speed fed forward.

    $w = \dot q_d + k_v (q_d - q)$, $\tau_j = m_j k_s (e + \tfrac1{T_n}\int e\,dt)$ with
    $e = w - \dot q$; the integral part stays within the limits of the torque.
    """

    kind: ClassVar[str] = "cascade"
    needs_model: ClassVar[bool] = False
    kv: float = POSITION_GAIN  # gain of the position loop [1/s]
    # gain of the speed loop per inertia [1/s]; 150, or lower where the joints are coupled strongly,
    # if `None`
    ks: float | None = None
    tn: float = INTEGRAL_TIME  # integral time of the speed loop [s]

    def start(self, task: ControlTask) -> ControlLoop:
        """A loop at its first tick; its state is the integral part of the torque."""
        ks = min(SPEED_GAIN, 2.0 * task.fastest) if self.ks is None else self.ks
        gain, goal, kv, limits = ks * task.inertia, task.compared, self.kv, task.limits
        step, integral = gain * (task.tick / self.tn), 0.0 * task.inertia

        def torque(k: int, q: Array, dq: Array) -> Array:
            error = goal.dq[k] + kv * (goal.q[k] - q) - dq
            np.clip(integral + step * error, -limits, limits, out=integral)
            return np.asarray(gain * error + integral)

        return torque


@dataclass(frozen=True, eq=False)
class TorqueFeedforward:
    """A controller, and torques of a model along the desired motion."""

    kind: ClassVar[str] = "feedforward"
    needs_model: ClassVar[bool] = True
    inner: Control
    model: ValuedModel
    smoothing: float = SIGN_SMOOTHING  # speed in which the sign of friction turns [rad/s; m/s]

    def start(self, task: ControlTask) -> ControlLoop:
        """A loop at its first tick."""
        ahead = feedforward_torque(self.model, task.motion, self.smoothing)
        inner = self.inner.start(task)
        return lambda k, q, dq: np.asarray(inner(k, q, dq) + ahead[k])


FRICTIONLESS = replace(
    TORQUE, name="torque without friction", enters=lambda term: term.cause != "friction"
)

MOST_POSTURES = 2000  # postures of a motion at which the mass matrix is examined


@dataclass(frozen=True, eq=False)
class ComputedTorque:
    r"""$\tau = M(q)(\ddot q_d + k_v \dot e + k_p e) + b(q, \dot q) + \tau_f(\dot q_d)$.

    $b$ is everything that depends on the measured position and velocity but friction: Coriolis and
    centrifugal torque, gravity, springs. Friction is that of the desired velocity, because that of
    the measured one chatters; the law as printed in [WangC] has none.

    Raises:
        ModelError: The mass matrix of the model is not positive definite along the motion.
    """

    kind: ClassVar[str] = "computed_torque"
    needs_model: ClassVar[bool] = True
    model: ValuedModel
    kp: float = 400.0  # stiffness per inertia [1/s²]
    kv: float = 40.0  # damping per inertia [1/s]
    friction: bool = True

    def start(self, task: ControlTask) -> ControlLoop:
        """A loop at its first tick."""
        refuse_indefinite(self.model, task.motion)
        goal, ddq, stepper = task.compared, task.motion.ddq, self.model.start()
        friction = np.zeros_like(ddq)
        if self.friction:
            friction = feedforward_torque(self.model, task.motion, quantity=FRICTION)

        def torque(k: int, q: Array, dq: Array) -> Array:
            feedback = self.kv * (goal.dq[k] - dq) + self.kp * (goal.q[k] - q)
            return np.asarray(
                stepper.evaluate(FRICTIONLESS, q, dq, ddq[k] + feedback) + friction[k]
            )

        return torque


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
    kind = named(name, kinds, "controller", "controllers", "--control")
    gains = dict(_gain(one, kind, text) for one in given)
    if not kind.needs_model:
        control: Control = kind(**gains)
        return control if model is None else TorqueFeedforward(control, model)
    if model is None:
        wrong = f"controller '{name}' computes with a model, and none is given"
        fix = "add --model MODEL, or use pd, pid or cascade"
        raise ModelError(wrong, where="--control", fix=fix)
    found: Control = kind(model, **gains)
    return found


def _gain(text: str, kind: type[Any], whole: str) -> tuple[str, float | bool]:
    name, _, number = text.partition("=")
    known = [field.name for field in fields(kind) if field.name != "model"]
    wrong = f"controller '{kind.kind}' has no gain '{name}'"
    refuse_unknown(name, known, wrong, f"--control {whole}", "gains")
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
