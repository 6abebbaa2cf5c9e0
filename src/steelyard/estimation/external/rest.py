"""Friction of joints that rest, and the speed up to which they do."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from steelyard.arrays import Array, frozen
from steelyard.dynamics.quantity import FRICTION
from steelyard.estimation.calibration import EDGES, Calibration
from steelyard.model import ValuedModel
from steelyard.robot.loop_equations import loop_equations

SLOW = 0.02
"""Speed at which the dead zone is taken [rad/s; m/s]."""

SAMPLES = 64
"""Samples of the motion that lets friction with memory forget its start."""

SHARE = 0.02
"""Rest speed over the root mean square of a joint's speed while fitting."""

LOWEST = 1e-3
"""Rest speed of a joint of which nothing is known [rad/s; m/s]."""


def dead_zone(valued: ValuedModel) -> Array:
    """Half of the range of efforts in which friction holds each joint, shape `(n,)` [Nm; N].

    Args:
        valued: The model; friction that depends on the load is taken at the reference posture.
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


def rest_speed_of(n: int, known: Calibration | None, given: ArrayLike | None) -> Array:
    """Speed up to which joints rest on a stream, shape `(n,)` [rad/s; m/s].

    Args:
        n: Number of joints.
        known: Speeds while fitting.
        given: The rest speeds that the robot file states.
    """
    if given is not None:
        return frozen(np.broadcast_to(np.asarray(given, dtype=np.float64), (n,)))
    if known is None:
        return np.full(n, LOWEST)
    return np.maximum(SHARE * known.edges[:, 0] / EDGES[0], LOWEST)


def rest_speed_of_runs(speeds: Sequence[Array], usual: Array) -> Array:
    """Speed up to which joints rest in all of some runs, shape `(n,)` [rad/s; m/s].

    Args:
        speeds: That of each run, shape `(n,)`; infinite where nothing moves.
        usual: What it is of a run without motion, shape `(n,)`.
    """
    return np.asarray(np.max([np.where(np.isfinite(one), one, usual) for one in speeds], axis=0))
