r"""Joint PD control."""

from dataclasses import dataclass
from math import pi, sqrt
from typing import ClassVar

import numpy as np

from steelyard.arrays import Array
from steelyard.control.protocol import BANDWIDTH, ControlTask


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
