"""How large torques and masses are for a robot: what gains, friction and noise are measured by."""

import numpy as np

from steelyard.arrays import Array, frozen
from steelyard.excitation.limits import MotionLimits, motion_limits
from steelyard.robot.robot import Robot
from steelyard.virtual.mujoco_model import MujocoModel, inverse_dynamics, mass_matrices

_STATES = 64
_SEED = 20_210_917
_LEAST_TORQUE = 0.03
_LEAST_INERTIA = 0.01


def typical_torque(robot: Robot, model: MujocoModel) -> Array:
    """Root mean square torque over random states at half of the limits, shape `(n,)` [Nm; N].

    At least 3 % of the largest one of the same kind: no drive is built for next to nothing.
    """
    limits = motion_limits(robot)
    rng = np.random.default_rng(_SEED)
    q = _postures(limits, rng)
    dq, ddq = (
        0.5 * rng.uniform(-1.0, 1.0, q.shape) * bound
        for bound in (limits.velocity, limits.acceleration)
    )
    torque = inverse_dynamics(model, q, dq, ddq)
    return _floored(robot, np.sqrt(np.mean(torque**2, axis=0)), _LEAST_TORQUE)


def typical_inertia(robot: Robot, masses: Array) -> Array:
    """Median inertia that each joint moves, shape `(n,)` [kg m²; kg].

    At least 1 % of the largest one of the same kind.

    Args:
        robot: The robot.
        masses: Mass matrices at some postures, shape `(K, n, n)`.
    """
    own = np.median(np.diagonal(masses, axis1=1, axis2=2), axis=0)
    return _floored(robot, own, _LEAST_INERTIA)


def typical_masses(robot: Robot, model: MujocoModel) -> Array:
    """Mass matrices at random postures within the limits, shape `(K, n, n)`."""
    return mass_matrices(model, _postures(motion_limits(robot), np.random.default_rng(_SEED)))


def _floored(robot: Robot, values: Array, share: float) -> Array:
    """Values per joint, raised to a share of the largest one among joints of the same kind."""
    kinds = np.array([c.kind for c in robot.coordinates])
    largest = [values[kinds == kind].max() for kind in kinds]
    return frozen(np.maximum(values, share * np.array(largest)))


def _postures(limits: MotionLimits, rng: np.random.Generator) -> Array:
    """Random postures, shape `(K, n)`."""
    return rng.uniform(limits.lower, limits.upper, (_STATES, len(limits.lower)))
