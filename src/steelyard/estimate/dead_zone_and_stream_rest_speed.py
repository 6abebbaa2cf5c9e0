"""Joints at rest: up to which speed they are, and the dead zone in which friction holds them."""

import numpy as np
from numpy.typing import ArrayLike

from steelyard.base.arrays import Array, frozen
from steelyard.estimate.covariance_and_band_widths import EDGES, Calibration
from steelyard.model.model import ValuedModel
from steelyard.model.torque_and_quantities import FRICTION
from steelyard.robot.loop_closures import loop_equations

SLOW = 0.02  # speed at which the dead zone is taken [rad/s; m/s]
SAMPLES = 64  # samples of the motion that lets friction with memory forget its start


def dead_zone(valued: ValuedModel) -> Array:
    """Half the range of efforts in which friction holds joints at rest, `(n,)` [Nm; N].

    Friction that depends on the load is taken at the reference posture.
    """
    robot = valued.robot
    posture = loop_equations(robot).assembly[: robot.n] if robot.loops else np.zeros(robot.n)
    travel = 1.5 * valued.model.scan().warm_up[: robot.n, 0]
    way = np.linspace(-1.0, 0.0, SAMPLES)[:, None] * travel
    speed, still = np.full_like(way, SLOW), np.zeros_like(way)
    efforts = [
        valued.evaluate(FRICTION, posture + sign * way, sign * speed, still)[-1]
        for sign in (1.0, -1.0)
    ]
    return np.asarray(0.5 * np.abs(efforts[0] - efforts[1]))


REST_SPEED_SHARE = 0.02  # rest speed over the root mean square of a joint's speed while fitting
LOWEST_REST_SPEED = 1e-3  # rest speed of a joint of which nothing is known [rad/s; m/s]


def rest_speed_of(n: int, known: Calibration | None, given: ArrayLike | None) -> Array:
    """Rest speed on a stream, `(n,)`: of the robot file, else a share of speeds while fitting."""
    if given is not None:
        return frozen(np.broadcast_to(np.asarray(given, dtype=np.float64), (n,)))
    if known is None:
        return np.full(n, LOWEST_REST_SPEED)
    return np.maximum(REST_SPEED_SHARE * known.edges[:, 0] / EDGES[0], LOWEST_REST_SPEED)
