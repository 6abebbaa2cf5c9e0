"""How large torques and masses are for a robot: what gains, friction and noise are measured by."""

from dataclasses import dataclass
from functools import lru_cache, partial

import numpy as np

from steelyard.base.arrays import Array, frozen
from steelyard.base.errors import ModelError
from steelyard.excite.constraints.constraint_and_limits import motion_limits
from steelyard.model.equations.inverse_dynamics import JointState
from steelyard.model.model import Model
from steelyard.model.terms.axes_and_fields import Axis
from steelyard.model.terms.term import StatefulTerm, Term, TermSamples
from steelyard.robot.loop_closures import CLOSED, closest, gaps, residual
from steelyard.robot.robot import Coordinate, Robot
from steelyard.simulate.mujoco_model import MujocoModel, build, inverse_dynamics, mass_matrices

_STATES = 64
_SEED = 20_210_917
_LEAST_TORQUE = 0.03
_LEAST_INERTIA = 0.01
_FASTEST_FACTOR = 2.0


@dataclass(frozen=True, eq=False)
class ScalePostures:
    """Random postures within the limits, loops closed."""

    q: Array  # all joints, shape `(K, n_joints)`
    full: Array  # all joints' velocities per independent ones, shape `(K, n_joints, n)`

    def all_joints(self, rates: Array) -> Array:
        """Velocities of all joints, `(K, n_joints)`, from independent ones, `(K, n)`."""
        return np.asarray(np.einsum("kij,kj->ki", self.full, rates))


@dataclass(frozen=True, eq=False)
class Scales:
    """Sizes of a robot's joints at random states within half of its limits."""

    robot: Robot
    postures: ScalePostures
    torque: Array  # typical torque of the bodies on each joint, shape `(n_joints,)` [Nm; N]
    inertia: Array  # typical inertia that each joint moves, shape `(n_joints,)` [kg m²; kg]
    masses: Array  # mass matrices of all joints, shape `(K, n_joints, n_joints)`

    def inertia_along(self, axis: Axis) -> float:
        """Inertia that a rotor along a coordinate is measured by: the least of its joints'."""
        row = np.array(axis.row)
        moving = row != 0.0
        return float(np.min(self.inertia[moving] / row[moving] ** 2))

    def peaks(self, term: Term) -> Array:
        """Largest torque on each joint per unit of each parameter, `(n_joints, parameters)`."""
        limits = motion_limits(self.robot)
        rng = np.random.default_rng(_SEED + 1)
        shape = len(self.postures.q), self.robot.n
        dq, ddq = (
            self.postures.all_joints(rng.uniform(-1.0, 1.0, shape) * bound)
            for bound in (np.minimum(limits.velocity, _FASTEST_FACTOR), 0.5 * limits.acceleration)
        )
        return np.asarray(np.abs(self._columns(term, dq, ddq)).max(axis=2))

    def jumps(self, term: Term, speed: Array) -> Array:
        """Half the change from minus to plus `speed`, `(n_joints, parameters)`."""
        dq = np.tile(speed, (len(self.postures.q), 1))
        still = np.zeros_like(dq)
        ahead, back = (self._columns(term, s * dq, still) for s in (1.0, -1.0))
        return np.asarray(0.5 * np.abs(ahead - back).max(axis=2))

    def _columns(self, term: Term, dq: Array, ddq: Array) -> Array:
        q, dq, ddq = self.postures.q.T, dq.T, ddq.T
        channels = np.empty((0, q.shape[1]))
        if isinstance(term, StatefulTerm):
            loads = partial(Model(self.robot).rigid_torque, q, dq, ddq)
            channels = term.remember(self.robot, TermSamples(q, dq, ddq, loads), None)[0]
        columns = np.zeros((self.robot.n_joints, len(term.parameters(self.robot)), q.shape[1]))
        state = JointState(list(q), list(dq), list(ddq), list(channels))
        for place, values in term.columns(self.robot, state).items():
            columns[place] = values
        return columns


def scales_of(robot: Robot, inertial: Array) -> Scales:
    """Sizes of a robot with given bodies, ten numbers each, and no rotors."""
    model, postures = build(robot, inertial), postures_of(robot)
    masses = mass_matrices(model, postures.q)
    torque = np.sqrt(np.mean(_torques(robot, model, postures) ** 2, axis=0))
    torque = _floored(robot.joints, torque, _LEAST_TORQUE)
    own = np.median(np.diagonal(masses, axis1=1, axis2=2), axis=0)
    return Scales(robot, postures, torque, _floored(robot.joints, own, _LEAST_INERTIA), masses)


def typical_torque(robot: Robot, model: MujocoModel) -> Array:
    """Root mean square torque over random states at half of the limits, shape `(n,)` [Nm; N].

    At least 3 % of the largest one of the same kind: no drive is built for next to nothing.
    """
    postures = postures_of(robot)
    torque = np.einsum("kij,ki->kj", postures.full, _torques(robot, model, postures))
    return _floored(robot.coordinates, np.sqrt(np.mean(torque**2, axis=0)), _LEAST_TORQUE)


def typical_masses(robot: Robot, model: MujocoModel) -> Array:
    """Mass matrices of the independent joints at random postures, shape `(K, n, n)`."""
    postures = postures_of(robot)
    masses = mass_matrices(model, postures.q)
    return np.asarray(np.einsum("kia,kij,kjb->kab", postures.full, masses, postures.full))


@lru_cache(maxsize=8)
def postures_of(robot: Robot) -> ScalePostures:
    """Random postures within the limits; those at which the loops cannot close are left out."""
    limits, rng = motion_limits(robot), np.random.default_rng(_SEED)
    wanted = rng.uniform(limits.lower, limits.upper, (_STATES, robot.n))
    if not robot.loops:
        return ScalePostures(wanted, np.tile(np.eye(robot.n), (_STATES, 1, 1)))
    centre = 0.5 * (limits.lower + limits.upper)
    found = [closed(robot, q) for q in (robot.assembly[: robot.n], centre, *wanted)]
    q = np.array([x for x in found if x is not None]).reshape(-1, robot.n_joints)
    if not len(q):
        raise ModelError(
            "the loops close nowhere within the limits of the joints",
            where=f"robot '{robot.name}'",
            fix="correct the pins' points, the limits or [robot.assembly]",
        )
    return ScalePostures(q, np.array([passive_slopes(robot, x) for x in q]))


def closed(robot: Robot, q: Array, near: Array | None = None) -> Array | None:
    """All joints with the loops closed, `(n_joints,)`; `None` where they cannot close.

    The search begins at all joints of a closed posture `near`, by default the assembly.
    """
    if not robot.loops:
        return np.array(q, dtype=np.float64)
    passive = list(range(robot.n, robot.n_joints))
    full = np.array(robot.assembly if near is None else near)
    steps = max(1, int(np.ceil(np.abs(q - full[: robot.n]).max() / 0.1)))
    start = full[: robot.n].copy()
    for k in range(1, steps + 1):
        full[: robot.n] = start + (q - start) * k / steps
        full = closest(robot, full, passive)
    return full if gaps(robot, full).max() <= CLOSED else None


def passive_slopes(robot: Robot, q: Array) -> Array:
    """Velocities of all joints per independent ones at a closed posture, `(n_joints, n)`."""
    slope = residual(robot, q)[1]
    found = np.linalg.lstsq(slope[:, robot.n :], -slope[:, : robot.n], rcond=1e-9)[0]
    return np.vstack((np.eye(robot.n), found))


def _torques(robot: Robot, model: MujocoModel, postures: ScalePostures) -> Array:
    """Torques on all joints of the tree, shape `(K, n_joints)`."""
    limits, rng = motion_limits(robot), np.random.default_rng(_SEED)
    rng.uniform(size=(_STATES, robot.n))
    shape = len(postures.q), robot.n
    dq, ddq = (
        postures.all_joints(0.5 * rng.uniform(-1.0, 1.0, shape) * bound)
        for bound in (limits.velocity, limits.acceleration)
    )
    return inverse_dynamics(model, postures.q, dq, ddq)


def _floored(joints: tuple[Coordinate, ...], values: Array, share: float) -> Array:
    """Values per joint, raised to a share of the largest one among joints of the same kind."""
    kinds = np.array([c.kind for c in joints])
    largest = [values[kinds == kind].max() for kind in kinds]
    return frozen(np.maximum(values, share * np.array(largest)))
