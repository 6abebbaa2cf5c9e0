"""How fine the steps of the integration must be for the laws to be followed."""

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import ModelError
from steelyard.virtual.laws import Laws, LawsInUse
from steelyard.virtual.mujoco_model import TIMESTEP, mass_matrices
from steelyard.virtual.scales import postures_of

MEMORY_TIMESTEP = 1e-4
"""Coarsest step where friction has memory [s]."""

_FINEST = 1.0 / 16.0
_POSTURES = 24
_STIFFEST = 0.5


def stable_timestep(laws: Laws) -> float:
    r"""The step `h`, halved until it follows damping and stiffness of the laws.

    $h\,\lambda_{max}(M^{-1} D) \le 1$ and $h\,\lambda_{max}(M^{-1} K)^{1/2} \le 1/2$ with the
    steepest `D` and `K` found at random postures, at rest, about rest and in motion, and at all
    bends of friction with memory.

    Raises:
        ModelError: A joint moves nothing, or the step would be absurdly fine.
    """
    robot, rng = laws.robot, np.random.default_rng(3)
    postures = postures_of(robot).q[:_POSTURES]
    masses = mass_matrices(laws.model, postures)
    _check_masses(laws, masses)
    probe = _Probe(laws)
    damping = stiffness = 0.0
    for q, mass in zip(postures, masses, strict=True):
        for speed in (0.0, 1.0, 1e3):
            dq = speed * laws.widths * rng.uniform(-1.0, 1.0, robot.n_joints)
            states = rng.choice([-1.0, 0.0, 1.0], laws.n_memory)
            slow, stiff = probe.slopes(q, dq, states)
            damping = max(damping, _fastest(mass, slow))
            stiffness = max(stiffness, _fastest(mass, stiff))
    coarsest = MEMORY_TIMESTEP if laws.n_memory or laws.n_channels else TIMESTEP
    timestep = coarsest
    while timestep * damping > 1.0 or timestep * np.sqrt(stiffness) > _STIFFEST:
        timestep *= 0.5
        if timestep < _FINEST * coarsest:
            raise ModelError(
                f"a law is too stiff to be simulated: it needs steps below {2e6 * timestep:.2g} µs",
                where="truth of the virtual robot",
                fix="give it larger smoothing speeds or presliding lengths, less friction, or the "
                "joints more rotor inertia",
            )
    return timestep


def _fastest(mass: Array, slopes: Array) -> float:
    """Largest eigenvalue of the slopes over the mass, in size."""
    return float(np.abs(np.linalg.eigvals(np.linalg.solve(mass, slopes))).max())


def _check_masses(laws: Laws, masses: Array) -> None:
    least = np.diagonal(masses, axis1=1, axis2=2).min(axis=0)
    for joint, mass in zip(laws.robot.joints, least, strict=True):
        if mass < 1e-9:
            raise ModelError(
                f"joint '{joint.name}' moves almost no inertia ({mass:.2g})",
                where="truth of the virtual robot",
                fix="give the links beyond this joint a mass, or the joint a rotor inertia",
            )


class _Probe:
    """Slopes of the laws by small differences, through the code that the plant runs."""

    def __init__(self, laws: Laws) -> None:
        self._laws, count = laws, len(laws.model.offset)
        self._q, self._dq = np.zeros(count), np.zeros(count)
        self._used = LawsInUse(laws, self._q, self._dq, np.zeros(count))

    def slopes(self, q: Array, dq: Array, states: Array) -> tuple[Array, Array]:
        """Damping and stiffness of all joints, each `(n_joints, n_joints)`."""
        joints = self._laws.robot.n_joints
        base = self._braking(q, dq, q, states)
        slow, stiff = np.empty((2, joints, joints))
        for j, width in enumerate(self._laws.widths):
            turn = np.zeros(joints)
            turn[j] = 1e-3 * width
            slow[:, j] = (self._braking(q, dq + turn, q, states) - base) / turn[j]
            turn[j] = 1e-8
            stiff[:, j] = (self._braking(q + turn, dq, q, states) - base) / turn[j]
        return slow, stiff

    def _braking(self, q: Array, dq: Array, before: Array, states: Array) -> Array:
        model, used = self._laws.model, self._used
        self._q[:], self._dq[:] = model.map @ q + model.offset, model.map @ dq
        used.remember(before, states)
        result = np.zeros(len(model.offset))
        result[used.dofs] = -used.step()
        return np.asarray(model.map.T @ result)
