r"""Joint controllers: gains, running loops with state, PD, PID and cascade control."""

from dataclasses import dataclass
from math import pi, sqrt
from typing import ClassVar, Protocol

import numpy as np

from steelyard.base.arrays import Array, frozen
from steelyard.base.motion import Motion

BANDWIDTH = 20.0
"""Natural frequency of the error of a joint under default gains [Hz]."""


@dataclass(frozen=True, eq=False)
class ControlTask:
    """What a controller is to do, and what it knows of its robot without an identified model.

    Attributes:
        motion: Desired motion at every tick, `N` samples of `n` joints.
        compared: The same as late as measured values are: what the loop would see on the desired
            motion, so that delay alone is no error.
        tick: Time between two ticks [s].
        inertia: Mean inertia of each joint over its postures, shape `(n,)` [kg m²; kg]; gains
            are multiplied with it.
        fastest: Natural frequency up to which joint gains are stable [rad/s]: coupling of the
            joints, lag and delay of the drives are counted.
        limits: Largest torque of each joint, shape `(n,)` [Nm; N].
    """

    motion: Motion
    compared: Motion
    tick: float
    inertia: Array
    fastest: float
    limits: Array

    def __post_init__(self) -> None:
        shape = (self.motion.n_joints,)
        object.__setattr__(self, "inertia", frozen(self.inertia, shape))
        object.__setattr__(self, "limits", frozen(self.limits, shape))


class ControlLoop(Protocol):
    """A controller at work; it may have state."""

    def torque(self, k: int, q: Array, dq: Array) -> Array:
        """Commanded joint torques at tick `k`, shape `(n,)` [Nm; N].

        Args:
            k: Number of the tick; ticks come one after another.
            q: Positions that the loop sees, shape `(n,)` [rad; m].
            dq: Velocities that it sees, likewise.
        """
        ...


class Control(Protocol):
    """A kind of controller with its gains.

    Attributes:
        kind: Its name in options.
        needs_model: Whether it computes with a model of the robot.
    """

    kind: ClassVar[str]
    needs_model: ClassVar[bool]

    def start(self, task: ControlTask) -> ControlLoop:
        """A loop at its first tick."""
        ...


@dataclass(frozen=True)
class PD:
    r"""Proportional and derivative feedback, $\tau_j = m_j (k_p e_j + k_d \dot e_j)$.

    $e = q_d - q$, and $m_j$ is the mean inertia of the joint.

    Attributes:
        kp: Stiffness per inertia [1/s²]; if `None` that of 20 Hz, or lower where the joints are
            coupled strongly.
        kd: Damping per inertia [1/s]; critical damping if `None`.
    """

    kind: ClassVar[str] = "pd"
    needs_model: ClassVar[bool] = False
    kp: float | None = None
    kd: float | None = None

    def start(self, task: ControlTask) -> "PDLoop":
        """A loop at its first tick."""
        omega = natural_frequency(self.kp, task)
        stiffness = omega**2 if self.kp is None else self.kp
        damping = 2.0 * omega if self.kd is None else self.kd
        return PDLoop(task, stiffness * task.inertia, damping * task.inertia)


def natural_frequency(kp: float | None, task: ControlTask) -> float:
    """Natural frequency of a stiffness per inertia, or the default one [rad/s]."""
    return min(2.0 * pi * BANDWIDTH, task.fastest) if kp is None else sqrt(kp)


class PDLoop:
    """PD control at work; it has no state."""

    def __init__(self, task: ControlTask, stiffness: Array, damping: Array) -> None:
        """Gains of shape `(n,)` [Nm/rad; N/m] and [Nm s/rad; N s/m]."""
        self._q, self._dq = task.compared.q, task.compared.dq
        self._stiffness, self._damping = stiffness, damping

    def torque(self, k: int, q: Array, dq: Array) -> Array:
        """Commanded joint torques at tick `k`, shape `(n,)`."""
        error, rate = self._q[k] - q, self._dq[k] - dq
        return np.asarray(self._stiffness * error + self._damping * rate)


_INTEGRAL_FREQUENCY_SHARE = 0.2
"""Share of the natural frequency at which the default integral gain acts."""


@dataclass(frozen=True)
class PID:
    r"""$\tau_j = m_j (k_p e_j + k_d \dot e_j + k_i \int e_j\,dt)$, the integral within the limits.

    Attributes:
        kp: Stiffness per inertia [1/s²], as of `PD`.
        kd: Damping per inertia [1/s], as of `PD`.
        ki: Integral gain per inertia [1/s³]; a fifth of the natural frequency times `kp` if `None`.
    """

    kind: ClassVar[str] = "pid"
    needs_model: ClassVar[bool] = False
    kp: float | None = None
    kd: float | None = None
    ki: float | None = None

    def start(self, task: ControlTask) -> "PIDLoop":
        """A loop at its first tick."""
        omega = natural_frequency(self.kp, task)
        ki = _INTEGRAL_FREQUENCY_SHARE * omega**3 if self.ki is None else self.ki
        return PIDLoop(task, PD(self.kp, self.kd).start(task), ki * task.inertia)


class PIDLoop:
    """PID control at work; its state is the integral part of the torque."""

    def __init__(self, task: ControlTask, proportional: PDLoop, integral_gain: Array) -> None:
        """An integral gain of shape `(n,)` [Nm/(rad s); N/(m s)]."""
        self._proportional, self._q = proportional, task.compared.q
        self._step, self._limits = integral_gain * task.tick, task.limits
        self._integral = np.zeros_like(task.inertia)

    def torque(self, k: int, q: Array, dq: Array) -> Array:
        """Commanded joint torques at tick `k`, shape `(n,)`."""
        integral = self._integral + self._step * (self._q[k] - q)
        self._integral = np.clip(integral, -self._limits, self._limits)
        return np.asarray(self._proportional.torque(k, q, dq) + self._integral)


POSITION_GAIN, SPEED_GAIN, INTEGRAL_TIME = 30.0, 150.0, 0.03
"""Usual of industrial drives with a torque loop of some milliseconds [1/s], [1/s], [s]."""


@dataclass(frozen=True)
class Cascade:
    r"""P position loop and PI speed loop, with the desired speed fed forward.

    $w = \dot q_d + k_v (q_d - q)$, $\tau_j = m_j k_s (e + \tfrac1{T_n}\int e\,dt)$ with
    $e = w - \dot q$; the integral part stays within the limits of the torque.

    Attributes:
        kv: Gain of the position loop [1/s].
        ks: Gain of the speed loop per inertia [1/s]; 150, or lower where the joints are
            coupled strongly, if `None`.
        tn: Integral time of the speed loop [s].
    """

    kind: ClassVar[str] = "cascade"
    needs_model: ClassVar[bool] = False
    kv: float = POSITION_GAIN
    ks: float | None = None
    tn: float = INTEGRAL_TIME

    def start(self, task: ControlTask) -> "CascadeLoop":
        """A loop at its first tick."""
        ks = min(SPEED_GAIN, 2.0 * task.fastest) if self.ks is None else self.ks
        return CascadeLoop(task, self.kv, ks * task.inertia, self.tn)


class CascadeLoop:
    """Cascade control at work; its state is the integral part of the torque."""

    def __init__(self, task: ControlTask, kv: float, speed_gain: Array, tn: float) -> None:
        """A speed gain of shape `(n,)` [Nm s/rad; N s/m]."""
        self._motion, self._kv, self._ks = task.compared, kv, speed_gain
        self._step, self._limits = speed_gain * (task.tick / tn), task.limits
        self._integral = np.zeros_like(task.inertia)

    def torque(self, k: int, q: Array, dq: Array) -> Array:
        """Commanded joint torques at tick `k`, shape `(n,)`."""
        speed = self._motion.dq[k] + self._kv * (self._motion.q[k] - q)
        error = speed - dq
        self._integral = np.clip(self._integral + self._step * error, -self._limits, self._limits)
        return np.asarray(self._ks * error + self._integral)
