"""The plant: a MuJoCo robot that is moved by joint torques and braked by our laws."""

import numpy as np
from numpy.typing import ArrayLike

from steelyard.base.arrays import Array, frozen
from steelyard.base.errors import DataError, ModelError
from steelyard.robot.robot import Frame, Robot
from steelyard.simulate.ground_truth import Truth
from steelyard.simulate.laws_beside_mujoco import Laws, LawsInUse, stable_timestep
from steelyard.simulate.mujoco_model import (
    ADVANCE,
    MujocoModel,
    body_name,
    body_pose,
    build,
    new_data,
    push,
)
from steelyard.simulate.payloads_and_wrenches import Payload
from steelyard.simulate.typical_torques_and_masses import closed

_UNREACHED_SIZE = 1e4  # size of positions and of velocities, as vectors, that no robot reaches


class MujocoPlant:
    r"""A robot in MuJoCo.

    MuJoCo steps $v' = v + h\,a(x, v)$, $x' = x + h\,v'$. Read as $x = q + \tfrac h2 \dot q$ this
    is the position Verlet scheme: torques act exactly while they are held, and the error in
    gravity and inertia is of second order in `h`; read as $x = q$ the motion would lead the torque
    by half a step. Coulomb friction by the plain sign is implicit: within a step it stops a joint
    that it can stop. The other laws are evaluated at every step, and the memory of friction takes
    the same exact steps as along a log. The step is 0.125 ms, 0.1 ms for friction with memory, and
    finer where a law is so stiff for its inertia that such a step would not be stable.

    Attributes:
        model: The MuJoCo model, with the truth's inertias.
        timestep: Step of the integration [s].
    """

    def __init__(self, robot: Robot, truth: Truth, payload: Payload | None = None) -> None:
        _check_robot(robot, truth)
        self.model: MujocoModel = build(robot, truth.inertial, truth.rotors, truth.brakes)
        self._laws = Laws(robot, truth.laws, truth.law_values, truth.smoothing, self.model)
        self.timestep = stable_timestep(self._laws)
        self._compiled = [self.model.compiled]
        if payload is not None:
            loaded = payload.added(robot, truth.inertial)
            self._compiled.append(build(robot, loaded, truth.rotors, truth.brakes).compiled)
        for compiled in self._compiled:
            compiled.opt.timestep = self.timestep
        self._robot, self._loaded = robot, False
        self._behind = np.reshape(
            [b.motor * np.array(b.row[: robot.n]) for b in truth.brakes if b.level > 0.0],
            (-1, robot.n),
        )
        self._before_gears = bool(self._behind.any())
        self._carriers = np.array(self.model.carriers[: robot.n])
        self._ratios = self.model.map[self._carriers, np.arange(robot.n)]
        self._starts = self.model.offset[self._carriers]
        self._place(robot.assembly)

    def place(self, q: ArrayLike) -> None:
        """Put the robot at rest at posture `q`, shape `(n,)`; passive joints close the loops."""
        wanted = frozen(q, (self._robot.n,))
        full = closed(self._robot, wanted)
        if full is None:
            raise DataError(
                "the loops cannot close at positions " + " ".join(f"{x:.4g}" for x in wanted),
                where=f"robot '{self._robot.name}'",
                fix="start from a posture that the robot can take",
            )
        self._place(full)

    def _place(self, q: Array) -> None:
        self._data = new_data(self.model)
        self._data.qpos[:] = self.model.map @ q + self.model.offset
        data = self._data
        self._x, self._v, self._forces = data.qpos, data.qvel, data.qfrc_applied
        self._used = LawsInUse(self._laws, self._x, self._v, data.qacc)

    def load(self, loaded: bool) -> None:
        """Take the payload, or let it go; motion goes on from the same velocities."""
        self._loaded = loaded

    def push(self, frame: Frame, wrench: Array, in_base: bool) -> Array:
        """Let a wrench act at a frame's origin until the next call.

        Args:
            frame: A frame of a moving body, see `moved_frame`.
            wrench: Force and torque, shape `(6,)` [N, Nm].
            in_base: Whether it is along the axes of the base, not of the frame.

        Returns:
            The wrench along the axes of the frame, shape `(6,)`.
        """
        name = body_name(self._robot, frame.body)
        compiled = self._compiled[self._loaded]
        axes, origin = body_pose(compiled, self._data, name)
        turned = axes @ frame.rotation
        given = wrench.reshape(2, 3)
        base, own = (given, given @ turned) if in_base else (given @ turned.T, given)
        push(compiled, self._data, name, base.ravel(), origin + axes @ frame.position)
        return own.ravel()

    def state(self) -> tuple[Array, Array]:
        """Position and velocity of the independent joints, each `(n,)`."""
        dq = self._v[self._carriers] / self._ratios
        ahead = (self._x[self._carriers] - self._starts) / self._ratios
        return ahead - 0.5 * self.timestep * dq, dq

    def motor_friction(self) -> Array:
        """Torque of the terms that act on motors, at the last step, shape `(n,)`."""
        brakes = self._used.brakes()
        if not self._before_gears:
            return brakes
        friction = self._data.efc_force[self._data.ne :][: self._data.nf]
        return np.asarray(brakes - friction @ self._behind)

    def step(self, tau: Array, duration: float) -> tuple[Array, Array]:
        """Hold joint torques `tau`, shape `(n,)`, for a multiple of the time step."""
        count = round(duration / self.timestep)
        if count < 1 or abs(count * self.timestep - duration) > 1e-9:
            raise ValueError(f"{duration} s is not a multiple of the step of {self.timestep} s")
        compiled, data, used = self._compiled[self._loaded], self._data, self._used
        used.applied[:] = tau
        forces, dofs, advance = self._forces, used.dofs, ADVANCE
        for _ in range(count):
            forces[dofs] = used.step()
            advance(compiled, data)
        q, dq = self.state()
        if not (q @ q < _UNREACHED_SIZE**2 and dq @ dq < _UNREACHED_SIZE**2):
            raise DataError(
                "the simulation diverged",
                where=f"robot '{self._robot.name}'",
                fix="give smaller torques, or a true robot with more inertia",
            )
        return q, dq


def _check_robot(robot: Robot, truth: Truth) -> None:
    got, wanted = (
        ([b.name for b in r.bodies], [c.name for c in r.joints]) for r in (truth.robot, robot)
    )
    if got != wanted:
        raise ModelError(
            f"the truth has {len(got[0])} links and {len(got[1])} joints, the robot "
            f"{len(wanted[0])} and {len(wanted[1])}, or they differ in names",
            where=f"truth for robot '{robot.name}'",
            fix="take the truth that was made for this robot",
        )
