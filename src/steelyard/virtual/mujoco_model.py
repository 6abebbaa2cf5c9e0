r"""A MuJoCo model with exactly the bodies of a `Robot`.

MuJoCo has one joint per body, so its positions are $x = G q + o$ with one row of $G$ per body
(`Body.ratio`, `Body.offset`), and joint torques are $\tau = G^T \tau_x$. MuJoCo adds nothing of
its own: no contacts, no friction, no damping, no joint stops. Rotor inertia is MuJoCo's
*armature*, put on the first body that a coordinate moves. In simulation, further bodies of the
same coordinate (mimic joints) are held to the first by stiff equality constraints.
"""

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from steelyard.arrays import Array, frozen
from steelyard.errors import ModelError
from steelyard.robot.inertia import Inertia
from steelyard.robot.robot import Body, Robot

LEAST_INERTIA = 1e-12
"""What a massless body gets, in kg and kg m²: MuJoCo refuses a moving body without inertia."""

TIMESTEP = 1.25e-4
"""Default step of the integration [s]."""


@dataclass(frozen=True, eq=False)
class MujocoModel:
    """A compiled MuJoCo model and the map between its joints and the robot's coordinates.

    Attributes:
        compiled: The `mujoco.MjModel`.
        map: `G`, shape `(n_bodies, n)`, positions of MuJoCo's joints per coordinate.
        offset: Positions of MuJoCo's joints at coordinates zero, shape `(n_bodies,)`.
        carriers: Per coordinate the joint of the first body that it moves.
    """

    compiled: Any
    map: Array
    offset: Array
    carriers: tuple[int, ...]


def build(
    robot: Robot,
    inertial: ArrayLike | None = None,
    rotor_inertia: ArrayLike | None = None,
    timestep: float = TIMESTEP,
) -> MujocoModel:
    """The MuJoCo model of a robot.

    Args:
        robot: The robot; its gravity is used.
        inertial: Ten numbers per body, shape `(n_bodies, 10)`; by default the nominal ones.
        rotor_inertia: Per coordinate, felt at the joint, shape `(n,)` [kg m²; kg].
        timestep: Step of the integration [s].

    Raises:
        ModelError: A body has mass properties that no body can have.
    """
    shape = (len(robot.bodies), 10)
    tens = robot.nominal if inertial is None else frozen(inertial, shape)
    rotors = np.zeros(robot.n) if rotor_inertia is None else frozen(rotor_inertia, (robot.n,))
    carriers = _carriers(robot)
    spec = _spec(robot, timestep)
    placed = [spec.worldbody]
    for index, (body, ten) in enumerate(zip(robot.bodies, tens, strict=True)):
        carried = carriers[body.coordinate] == index
        armature = rotors[body.coordinate] / body.ratio**2 if carried else 0.0
        placed.append(
            _add_body(placed[body.parent + 1], index, body, Inertia.from_ten(ten), armature)
        )
        if not carried:
            _tie(spec, robot, index, carriers[body.coordinate], timestep)
    matrix = np.zeros((len(robot.bodies), robot.n))
    for index, body in enumerate(robot.bodies):
        matrix[index, body.coordinate] = body.ratio
    offset = [body.offset for body in robot.bodies]
    compiled = _compile(spec, robot)
    order = _order(compiled)
    return MujocoModel(
        compiled,
        frozen(matrix[order]),
        frozen(np.array(offset)[order]),
        tuple(order.index(carrier) for carrier in carriers),
    )


def _order(compiled: Any) -> list[int]:
    """Which body's joint each of MuJoCo's joints is: MuJoCo goes through a tree depth first."""
    return [int(compiled.joint(k).name.split()[0]) for k in range(compiled.njnt)]


def inverse_dynamics(model: MujocoModel, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike) -> Array:
    """Joint torques by `mj_inverse`: rigid bodies and rotor inertia, no friction.

    Args:
        model: The model.
        q: Positions, shape `(N, n)`.
        dq: Velocities, shape `(N, n)`.
        ddq: Accelerations, shape `(N, n)`.

    Returns:
        Shape `(N, n)` [Nm; N].
    """
    q, dq, ddq = (np.asarray(a, dtype=np.float64) @ model.map.T for a in (q, dq, ddq))
    data = new_data(model)
    free = _without_constraints(model.compiled)
    torque = np.empty_like(q)
    for k in range(len(q)):
        data.qpos[:], data.qvel[:], data.qacc[:] = q[k] + model.offset, dq[k], ddq[k]
        mujoco.mj_inverse(free, data)
        torque[k] = data.qfrc_inverse
    return np.asarray(torque @ model.map)


def mass_matrices(model: MujocoModel, q: ArrayLike) -> Array:
    """Joint-space mass matrices, rotor inertia included.

    Args:
        model: The model.
        q: Positions, shape `(N, n)`.

    Returns:
        Shape `(N, n, n)`.
    """
    q = np.asarray(q, dtype=np.float64)
    count, n = q.shape
    still, unit = np.zeros((count, n)), np.eye(n)
    gravity = inverse_dynamics(model, q, still, still)
    columns = [inverse_dynamics(model, q, still, still + unit[j]) - gravity for j in range(n)]
    return np.stack(columns, axis=2)


def new_data(model: MujocoModel) -> Any:
    """The state of a simulation (`mujoco.MjData`), all joints of MuJoCo at zero and at rest."""
    return mujoco.MjData(model.compiled)


def advance(model: MujocoModel, data: Any) -> None:
    """One step of the integration under `data.qfrc_applied`."""
    mujoco.mj_step(model.compiled, data)


def _carriers(robot: Robot) -> tuple[int, ...]:
    """Per coordinate the first body that it moves."""
    first: dict[int, int] = {}
    for index, body in enumerate(robot.bodies):
        if body.ratio != 0.0:
            first.setdefault(body.coordinate, index)
    for index, coordinate in enumerate(robot.coordinates):
        if index not in first:
            raise ModelError(
                f"joint '{coordinate.name}' moves no body",
                where=f"robot '{robot.name}'",
                mend="lock the joint or leave it out",
            )
    return tuple(first[index] for index in range(robot.n))


def _spec(robot: Robot, timestep: float) -> Any:
    """An empty model: gravity and the integrator, everything else off."""
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    spec.compiler.autolimits = False
    spec.compiler.balanceinertia = False
    spec.option.gravity = robot.gravity
    spec.option.timestep = timestep
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_EULER
    spec.option.disableflags = (
        mujoco.mjtDisableBit.mjDSBL_CONTACT
        | mujoco.mjtDisableBit.mjDSBL_LIMIT
        | mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS
        | mujoco.mjtDisableBit.mjDSBL_WARMSTART
    )
    return spec


def _add_body(parent: Any, index: int, body: Body, inertia: Inertia, armature: float) -> Any:
    """Add one body and its joint; the body that was added."""
    added = parent.add_body(name=f"{index} {body.name}", pos=body.position)
    mujoco.mju_mat2Quat(added.quat, np.ascontiguousarray(body.rotation).ravel())
    mass, com, moments, axes = _principal(body, inertia)
    added.explicitinertial = True
    added.mass, added.ipos, added.inertia = mass, com, moments
    mujoco.mju_mat2Quat(added.iquat, np.ascontiguousarray(axes).ravel())
    kinds = {"revolute": mujoco.mjtJoint.mjJNT_HINGE, "prismatic": mujoco.mjtJoint.mjJNT_SLIDE}
    joint = added.add_joint(name=f"{index} {body.joint}", type=kinds[body.kind], axis=body.axis)
    joint.armature = armature
    return added


def _principal(body: Body, inertia: Inertia) -> tuple[float, Array, Array, Array]:
    """Mass, centre, principal moments `(3,)` and principal axes `(3, 3)` of a body."""
    flaw = inertia.flaw()
    if flaw is not None:
        raise ModelError(
            f"link '{body.name}' cannot exist: {flaw}",
            where=f"mass properties of link '{body.name}'",
            mend="correct the <inertial> of this link, or simulate with a truth of your own",
        )
    moments, axes = np.linalg.eigh(inertia.inertia_com)
    moments = np.maximum(moments, LEAST_INERTIA)
    moments[2] = min(moments[2], moments[0] + moments[1])
    axes[:, 0] *= np.sign(np.linalg.det(axes))
    return max(inertia.mass, LEAST_INERTIA), inertia.com, moments, axes


def _tie(spec: Any, robot: Robot, index: int, carrier: int, timestep: float) -> None:
    """Hold the joint of a mimic body to that of its coordinate's first body."""
    body, master = robot.bodies[index], robot.bodies[carrier]
    slope = body.ratio / master.ratio
    tie = spec.add_equality(type=mujoco.mjtEq.mjEQ_JOINT, objtype=mujoco.mjtObj.mjOBJ_JOINT)
    tie.name1, tie.name2 = f"{index} {body.joint}", f"{carrier} {master.joint}"
    tie.data[:2] = body.offset - slope * master.offset, slope
    tie.solref = 2.0 * timestep, 1.0
    tie.solimp = 0.99999, 0.99999, 1e-3, 0.5, 2.0


def _compile(spec: Any, robot: Robot) -> Any:
    """Compile, with MuJoCo's objections put into our words."""
    try:
        return spec.compile()
    except ValueError as error:
        raise ModelError(
            f"MuJoCo cannot use this robot: {error}",
            where=f"robot '{robot.name}'",
            mend="check the masses, inertias and joint axes in the model file",
        ) from error


def _without_constraints(compiled: Any) -> Any:
    """A copy of the model that is free of the mimic ties."""
    free = compiled.__copy__()
    free.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    return free
