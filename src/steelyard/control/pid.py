r"""Joint PID control."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from steelyard.arrays import Array
from steelyard.control.pd import PD, PDLoop, natural_frequency
from steelyard.control.protocol import ControlTask

_SLOWER = 0.2
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
        ki = _SLOWER * omega**3 if self.ki is None else self.ki
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
