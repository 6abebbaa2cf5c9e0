"""A robot with gears and frames, motions on it, and the torque of one term along them."""

import numpy as np

from invented import tree
from steelyard.base.arrays import Array
from steelyard.model.equations.inverse_dynamics import JointState
from steelyard.model.model import Model
from steelyard.model.terms.term import Term
from steelyard.robot.robot import Frame, Robot, Transmission


def geared() -> Robot:
    """The tree with motors, the last two coupled, and frames on its base and its tip."""
    robot = tree()
    matrix = np.diag([50.0, 30.0, -80.0, 60.0])
    matrix[3, 2] = 60.0
    gears = Transmission(("motor1", "motor2", "motor3", "motor4"), matrix)
    bodies = [Frame(b.name, k, np.eye(3), np.zeros(3)) for k, b in enumerate(robot.bodies)]
    turned = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    ends = [Frame("base", -1, np.eye(3), np.zeros(3)), Frame("tool", 3, turned, [0.1, 0.0, 0.2])]
    return robot.changed(transmission=gears, frames=(*ends, *bodies))


def cycles(n: int, count: int = 2, per_cycle: int = 2000, seed: int = 5) -> Array:
    """Closed motions of a second each, `q`, `dq` and `ddq` stacked: `(3, n, count * per_cycle)`."""
    rng = np.random.default_rng(seed)
    t = np.arange(1, count * per_cycle + 1) / per_cycle
    result = np.zeros((3, n, len(t)))
    for harmonic in (1, 2, 3):
        size = rng.normal(size=(2, n, 1)) * 0.4 / harmonic
        w = 2.0 * np.pi * harmonic
        s, c = np.sin(w * t), np.cos(w * t)
        result[0] += size[0] * s + size[1] * c
        result[1] += w * (size[0] * c - size[1] * s)
        result[2] -= w * w * (size[0] * s + size[1] * c)
    return result


def channels(term: Term, robot: Robot, state: Array, cuts: tuple[int, ...] = ()) -> Array:
    """A term's channels along a motion `(3, n, N)`, block by block."""
    scan = Model(robot, (term,)).scan()
    return np.concatenate([scan(*part) for part in np.split(state, cuts, axis=2)], axis=1)


def torque(term: Term, robot: Robot, state: Array, values: Array | float = 1.0) -> Array:
    """Torque of a term along a motion by its columns over arrays, shape `(n, N)`."""
    numbers = np.broadcast_to(values, (len(term.parameters(robot)),))
    seen = JointState(*(list(x) for x in state), list(channels(term, robot, state)))
    result = np.zeros(state.shape[1:])
    for (row, column), value in term.columns(robot, seen).items():
        result[row] += numbers[column] * value
    return result
