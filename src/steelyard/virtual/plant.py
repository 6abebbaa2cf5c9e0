"""The physics: a MuJoCo robot that is moved by joint torques and braked by our friction."""

import numpy as np
from numpy.typing import ArrayLike

from steelyard.arrays import Array, frozen
from steelyard.errors import ModelError
from steelyard.robot.robot import Robot
from steelyard.virtual.mujoco_model import TIMESTEP, MujocoModel, advance, build, new_data
from steelyard.virtual.scales import typical_masses
from steelyard.virtual.truth import Truth

_FINEST = TIMESTEP / 16.0


class MujocoPlant:
    r"""A robot in MuJoCo: implements `Plant`.

    MuJoCo steps $v' = v + h\,a(x, v)$, $x' = x + h\,v'$. Read as $x = q + \tfrac h2 \dot q$ this
    is the position Verlet scheme: torques act exactly while they are held, and the error in
    gravity and inertia is of second order in `h`; read as $x = q$ the motion would lead the torque
    by half a step. The step is 0.125 ms, finer where friction is so stiff for its inertia that such
    a step would not be stable. Friction is evaluated at every step.

    Attributes:
        model: The MuJoCo model, with the truth's inertias.
        timestep: Step of the integration [s].
    """

    def __init__(self, robot: Robot, truth: Truth) -> None:
        _check_shapes(robot, truth)
        self.model: MujocoModel = build(robot, truth.inertial, truth.rotor_inertia)
        self.timestep = _stable_timestep(robot, truth, self.model)
        self.model.compiled.opt.timestep = self.timestep
        self._truth = truth
        self._carriers = np.array(self.model.carriers)
        self._ratios = self.model.map[self._carriers, np.arange(robot.n)]
        self._starts = self.model.offset[self._carriers]
        self.place(np.zeros(robot.n))

    def place(self, q: ArrayLike) -> None:
        """Put the robot at rest at posture `q`, shape `(n,)`."""
        self._data = new_data(self.model)
        self._data.qpos[:] = self.model.map @ frozen(q, (len(self._ratios),)) + self.model.offset

    def state(self) -> tuple[Array, Array]:
        """Position and velocity of the joints, each `(n,)`."""
        dq = self._data.qvel[self._carriers] / self._ratios
        ahead = (self._data.qpos[self._carriers] - self._starts) / self._ratios
        return ahead - 0.5 * self.timestep * dq, dq

    def step(self, tau: Array, duration: float) -> tuple[Array, Array]:
        """Hold joint torques `tau`, shape `(n,)`, for a multiple of the time step."""
        count = round(duration / self.timestep)
        if count < 1 or abs(count * self.timestep - duration) > 1e-9:
            raise ValueError(f"{duration} s is not a multiple of the step of {self.timestep} s")
        data, carriers = self._data, self._carriers
        for _ in range(count):
            dq = data.qvel[carriers] / self._ratios
            data.qfrc_applied[carriers] = (tau - self._truth.friction(dq)) / self._ratios
            advance(self.model, data)
        return self.state()


def _stable_timestep(robot: Robot, truth: Truth, model: MujocoModel) -> float:
    r"""The step `h`, halved until $h\,\lambda_{max}(M^{-1} D) \le 1$.

    `D` is the damping of friction at its steepest, $f_c / v_s + f_v$.
    """
    masses = typical_masses(robot, model)
    least = np.diagonal(masses, axis1=1, axis2=2).min(axis=0)
    for joint, mass in zip(robot.joint_names, least, strict=True):
        if mass < 1e-9:
            raise ModelError(
                f"joint '{joint}' moves next to no inertia ({mass:.2g})",
                where="truth of the virtual robot",
                mend="give the links beyond this joint a mass, or the joint a rotor inertia",
            )
    damping = np.diag(truth.coulomb / truth.smoothing + truth.viscous)
    steepest = float(np.abs(np.linalg.eigvals(np.linalg.solve(masses, damping[None]))).max())
    timestep = TIMESTEP
    while timestep * steepest > 1.0:
        timestep *= 0.5
        if timestep < _FINEST:
            raise ModelError(
                "friction is too stiff to be simulated",
                where="truth of the virtual robot",
                mend="give it larger smoothing speeds, more rotor inertia or less friction",
            )
    return timestep


def _check_shapes(robot: Robot, truth: Truth) -> None:
    """Raise unless the truth is one of this robot."""
    got = (len(truth.inertial), len(truth.coulomb))
    if got != (len(robot.bodies), robot.n):
        raise ModelError(
            f"the truth has {got[0]} links and {got[1]} joints, "
            f"the robot {len(robot.bodies)} and {robot.n}",
            where=f"truth for robot '{robot.name}'",
            mend="take the truth that was made for this robot",
        )
