r"""Joint controllers: what closes the loop in a simulation."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from steelyard.arrays import Array, frozen


class Controller(Protocol):
    """Feedback of a robot's joint controller, without memory."""

    def torque(self, error: Array, rate: Array) -> Array:
        """Joint torques from the errors of position and velocity, wanted minus true.

        All are of shape `(..., n)`: many robots may be controlled side by side.
        """
        ...


@dataclass(frozen=True, eq=False)
class JointPD:
    """Proportional and derivative feedback per joint.

    Attributes:
        stiffness: Shape `(n,)` [Nm/rad; N/m].
        damping: Shape `(n,)` [Nm s/rad; N s/m].
    """

    stiffness: Array
    damping: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "stiffness", frozen(self.stiffness, (None,)))
        object.__setattr__(self, "damping", frozen(self.damping, self.stiffness.shape))

    def torque(self, error: Array, rate: Array) -> Array:
        """Joint torques from the errors of position and velocity, each `(..., n)`."""
        return np.asarray(self.stiffness * error + self.damping * rate)


def tuned_pd(masses: Array, bandwidth: float = 20.0, rate: float = 1000.0) -> JointPD:
    r"""Critically damped gains.

    $k_p = \omega^2 m_j$ and $k_d = 2 \omega m_j$ with $m_j$ the mean of $M_{jj}$. The bandwidth is
    lowered where joints are coupled so strongly that one tick would not be stable:
    $\lambda_{max}(M^{-1} K_d) / f \le 1/2$ at all postures.

    Args:
        masses: Mass matrices at some postures, shape `(K, n, n)`.
        bandwidth: Natural frequency of a joint's error [Hz].
        rate: Ticks of the controller per second, `f` [1/s].
    """
    own, fastest = joint_inertia(masses, rate)
    omega = min(2.0 * np.pi * bandwidth, fastest)
    return JointPD(omega**2 * own, 2.0 * omega * own)


def joint_inertia(masses: Array, rate: float = 1000.0) -> tuple[Array, float]:
    """Mean inertia of each joint, `(n,)`, and the largest stable natural frequency [rad/s].

    Args:
        masses: Mass matrices at some postures, shape `(K, n, n)`.
        rate: Ticks of the controller per second [1/s].
    """
    own = np.diagonal(masses, axis1=1, axis2=2).mean(axis=0)
    coupling = float(np.abs(np.linalg.eigvals(np.linalg.solve(masses, np.diag(own)[None]))).max())
    return own, rate / (4.0 * coupling)
