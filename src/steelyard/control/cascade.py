r"""Cascade control of drives: a position loop around a speed loop."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from steelyard.arrays import Array
from steelyard.control.protocol import ControlTask

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
