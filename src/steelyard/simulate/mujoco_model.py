r"""A MuJoCo model with exactly the bodies of a `Robot`.

MuJoCo has one joint per body, so its positions are $x = G q + o$ with one row of $G$ per body
(`Body.ratio`, `Body.offset`), and joint torques are $\tau = G^T \tau_x$. MuJoCo adds nothing of
its own: no contacts, no damping, no joint stops. Rotor inertia is MuJoCo's *armature*, put on the
first body that a coordinate moves, or on a tendon where it turns with several joints. Coulomb
friction is MuJoCo's *frictionloss* of a tendon along its coordinate: an implicit step finds the
force that stops the coordinate, within its size, so that joints stick and slip. In simulation,
further bodies of the same coordinate (mimic joints) are held to the first, and pins of loops are
held together, by stiff equality constraints.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from steelyard.base.arrays import Array, frozen
from steelyard.base.errors import ModelError
from steelyard.robot.inertia_and_placement import Inertia
from steelyard.robot.robot import Body, Frame, LoopClosure, Robot

LEAST_INERTIA = 1e-12  # of a massless body [kg; kg m²]: MuJoCo refuses moving bodies without
TIMESTEP = 1.25e-4  # default step of the integration [s]
STIFFEST = (2.0 * TIMESTEP, 1.0), (0.99999, 0.99999, 1e-3, 0.5, 2.0)
"""MuJoCo's `solref` and `solimp` of a constraint that a step fulfils."""
ADVANCE = mujoco.mj_step  # one step of the integration of a model, under `data.qfrc_applied`


class Brake(NamedTuple):
    """Coulomb friction against the motion of `row` times the joints, of size `level` [Nm; N].

    `motor` says whether it acts before the gears.
    """

    row: tuple[float, ...]
    level: float
    motor: bool = False


class Rotor(NamedTuple):
    """Inertia of a rotor that turns with `row` times the joints' velocities [kg m²; kg]."""

    row: tuple[float, ...]
    inertia: float


@dataclass(frozen=True, eq=False)
class MujocoModel:
    """A compiled MuJoCo model and the map between its joints and those of the robot."""

    compiled: Any  # the `mujoco.MjModel`
    map: Array  # `G`, shape `(n_bodies, n_joints)`, positions of MuJoCo's joints per joint
    offset: Array  # positions of MuJoCo's joints at joint positions zero, shape `(n_bodies,)`
    carriers: tuple[int, ...]  # per joint MuJoCo's joint of the first body that it moves


def build(
    robot: Robot,
    inertial: ArrayLike | None = None,
    rotors: Sequence[Rotor] = (),
    brakes: Sequence[Brake] = (),
) -> MujocoModel:
    """The MuJoCo model of a robot, under its gravity.

    Bodies have the ten numbers `inertial`, shape `(n_bodies, 10)`, by default the nominal ones;
    rotors and brakes act along rows over all joints.
    """
    tens = robot.nominal if inertial is None else frozen(inertial, (len(robot.bodies), 10))
    carriers = _carriers(robot)
    spec = _spec(robot)
    placed = [spec.worldbody]
    for index, (body, ten) in enumerate(zip(robot.bodies, tens, strict=True)):
        placed.append(_add_body(placed[body.parent + 1], index, body, Inertia.from_ten(ten)))
        if carriers[body.coordinate] != index:
            _tie(spec, robot, index, carriers[body.coordinate])
    for loop in robot.loops:
        _pin(spec, loop, [placed[body + 1] for body in loop.bodies])
    for number, rotor in enumerate(rotors):
        _turn(spec, robot, number, rotor, carriers)
    for number, brake in enumerate(brakes):
        _brake(spec, robot, number, brake, carriers)
    matrix = np.zeros((len(robot.bodies), robot.n_joints))
    for index, body in enumerate(robot.bodies):
        matrix[index, body.coordinate] = body.ratio
    offset = np.array([body.offset for body in robot.bodies])
    try:
        compiled = spec.compile()
    except ValueError as error:
        raise ModelError(
            f"MuJoCo cannot use this robot: {error}",
            where=f"robot '{robot.name}'",
            fix="check the masses, inertias and joint axes in the model file",
        ) from error
    # MuJoCo goes through a tree depth first: the bodies in the order of its joints
    order = [int(compiled.joint(k).name.split()[0]) for k in range(compiled.njnt)]
    carried = tuple(order.index(carrier) for carrier in carriers)
    return MujocoModel(compiled, frozen(matrix[order]), frozen(offset[order]), carried)


def inverse_dynamics(model: MujocoModel, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike) -> Array:
    """Torques of all joints by `mj_inverse`: rigid bodies and rotors of the tree, no friction.

    Args:
        model: The model; pins of loops are taken out.
        q: Positions of all joints, shape `(N, n_joints)`.
        dq: Velocities, shape `(N, n_joints)`.
        ddq: Accelerations, shape `(N, n_joints)`.

    Returns:
        Shape `(N, n_joints)` [Nm; N].
    """
    q, dq, ddq = (np.asarray(a, dtype=np.float64) @ model.map.T for a in (q, dq, ddq))
    data = new_data(model)
    free = model.compiled.__copy__()
    free.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    torque = np.empty_like(q)
    for k in range(len(q)):
        data.qpos[:], data.qvel[:], data.qacc[:] = q[k] + model.offset, dq[k], ddq[k]
        mujoco.mj_inverse(free, data)
        torque[k] = data.qfrc_inverse
    return np.asarray(torque @ model.map)


def mass_matrices(model: MujocoModel, q: ArrayLike) -> Array:
    """Mass matrices `(N, n_joints, n_joints)` of all joints of the tree, rotors included."""
    q = np.asarray(q, dtype=np.float64)
    count, n = q.shape
    still, unit = np.zeros((count, n)), np.eye(n)
    gravity = inverse_dynamics(model, q, still, still)
    columns = [inverse_dynamics(model, q, still, still + unit[j]) - gravity for j in range(n)]
    return np.stack(columns, axis=2)


def new_data(model: MujocoModel) -> Any:
    """The state of a simulation (`mujoco.MjData`), all joints of MuJoCo at zero and at rest."""
    return mujoco.MjData(model.compiled)


def push(
    compiled: Any, data: Any, robot: Robot, frame: Frame, wrench: Array, in_base: bool
) -> Array:
    """Let a wrench act at the origin of a frame of a moving body until the next call.

    Args:
        compiled: The `mujoco.MjModel`.
        data: Its state.
        robot: The robot.
        frame: A frame of a moving body, see `moved_frame`.
        wrench: Force and torque, shape `(6,)` [N, Nm].
        in_base: Whether it is along the axes of the base, not of the frame.

    Returns:
        The wrench along the axes of the frame, shape `(6,)`.
    """
    mujoco.mj_kinematics(compiled, data)
    number = compiled.body(f"{frame.body} {robot.bodies[frame.body].name}").id
    axes = data.xmat[number].reshape(3, 3)
    turned, given = axes @ frame.rotation, wrench.reshape(2, 3)
    base, own = (given, given @ turned) if in_base else (given @ turned.T, given)
    arm = data.xpos[number] + axes @ frame.position - data.xipos[number]
    data.xfrc_applied[number] = *base[0], *(base[1] + np.cross(arm, base[0]))
    return np.asarray(own.ravel())


def _carriers(robot: Robot) -> tuple[int, ...]:
    """Per joint the first body that it moves."""
    first: dict[int, int] = {}
    for index, body in enumerate(robot.bodies):
        if body.ratio != 0.0:
            first.setdefault(body.coordinate, index)
    for index, coordinate in enumerate(robot.joints):
        if index not in first:
            raise ModelError(
                f"joint '{coordinate.name}' moves no body",
                where=f"robot '{robot.name}'",
                fix="lock the joint or leave it out",
            )
    return tuple(first[index] for index in range(robot.n_joints))


def _spec(robot: Robot) -> Any:
    """An empty model: gravity and the integrator, everything else off."""
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    spec.compiler.autolimits = False
    spec.compiler.balanceinertia = False
    spec.option.gravity = robot.gravity
    spec.option.timestep = TIMESTEP
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_EULER
    spec.option.disableflags = (
        mujoco.mjtDisableBit.mjDSBL_CONTACT
        | mujoco.mjtDisableBit.mjDSBL_LIMIT
        | mujoco.mjtDisableBit.mjDSBL_AUTORESET
    )
    return spec


def _add_body(parent: Any, index: int, body: Body, inertia: Inertia) -> Any:
    added = parent.add_body(name=f"{index} {body.name}", pos=body.position)
    mujoco.mju_mat2Quat(added.quat, np.ascontiguousarray(body.rotation).ravel())
    mass, com, moments, axes = _principal(body, inertia)
    added.explicitinertial = True
    added.mass, added.ipos, added.inertia = mass, com, moments
    mujoco.mju_mat2Quat(added.iquat, np.ascontiguousarray(axes).ravel())
    kinds = {"revolute": mujoco.mjtJoint.mjJNT_HINGE, "prismatic": mujoco.mjtJoint.mjJNT_SLIDE}
    added.add_joint(name=f"{index} {body.joint}", type=kinds[body.kind], axis=body.axis)
    return added


def _principal(body: Body, inertia: Inertia) -> tuple[float, Array, Array, Array]:
    """Mass, centre, principal moments `(3,)` and principal axes `(3, 3)` of a body."""
    flaw = inertia.flaw()
    if flaw is not None:
        raise ModelError(
            f"link '{body.name}' is not physically consistent: {flaw}",
            where=f"mass properties of link '{body.name}'",
            fix="correct the <inertial> of this link, or simulate with a truth of your own",
        )
    moments, axes = np.linalg.eigh(inertia.inertia_com)
    moments = np.maximum(moments, LEAST_INERTIA)
    moments[2] = min(moments[2], moments[0] + moments[1])
    axes[:, 0] *= np.sign(np.linalg.det(axes))
    return max(inertia.mass, LEAST_INERTIA), inertia.com, moments, axes


def _tie(spec: Any, robot: Robot, index: int, carrier: int) -> None:
    """Hold the joint of a mimic body to that of its coordinate's first body."""
    body, master = robot.bodies[index], robot.bodies[carrier]
    slope = body.ratio / master.ratio
    tie = spec.add_equality(type=mujoco.mjtEq.mjEQ_JOINT, objtype=mujoco.mjtObj.mjOBJ_JOINT)
    tie.name1, tie.name2 = f"{index} {body.joint}", f"{carrier} {master.joint}"
    tie.data[:2] = body.offset - slope * master.offset, slope
    tie.solref, tie.solimp = STIFFEST


def _pin(spec: Any, loop: LoopClosure, bodies: Sequence[Any]) -> None:
    """Hold a point of one body to a point of another; sites stand at the points."""
    pin = spec.add_equality(type=mujoco.mjtEq.mjEQ_CONNECT, objtype=mujoco.mjtObj.mjOBJ_SITE)
    names = [f"{end} of {loop.name}" for end in ("first end", "second end")]
    for body, name, point in zip(bodies, names, loop.points, strict=True):
        body.add_site(name=name, pos=point)
    pin.name1, pin.name2 = names
    pin.solref, pin.solimp = STIFFEST


def _brake(spec: Any, robot: Robot, number: int, brake: Brake, carriers: Sequence[int]) -> None:
    """Add Coulomb friction along a tendon of the joints that it brakes."""
    tendon = spec.add_tendon(name=f"brake {number}", frictionloss=brake.level)
    tendon.solref_friction, tendon.solimp_friction = STIFFEST
    for name, slope in _slopes(robot, brake.row, carriers).items():
        tendon.wrap_joint(name, slope)


def _turn(spec: Any, robot: Robot, number: int, rotor: Rotor, carriers: Sequence[int]) -> None:
    """Add a rotor: armature of its joint, or of a tendon of all joints that it turns with."""
    slopes = _slopes(robot, rotor.row, carriers)
    if len(slopes) == 1:
        ((name, slope),) = slopes.items()
        spec.joint(name).armature += rotor.inertia * slope**2
        return
    _check_chain(robot, [carriers[j] for j, coefficient in enumerate(rotor.row) if coefficient])
    tendon = spec.add_tendon(name=f"rotor {number}", armature=rotor.inertia)
    for name, slope in slopes.items():
        tendon.wrap_joint(name, slope)


def _slopes(robot: Robot, row: Sequence[float], carriers: Sequence[int]) -> dict[str, float]:
    """Coefficients of MuJoCo's joints, by name, of a row over the robot's joints."""
    bodies = [robot.bodies[carrier] for carrier in carriers]
    return {
        f"{carrier} {body.joint}": coefficient / body.ratio
        for carrier, body, coefficient in zip(carriers, bodies, row, strict=True)
        if coefficient
    }


def _check_chain(robot: Robot, bodies: Iterable[int]) -> None:
    """Raise unless the bodies carry each other: MuJoCo couples inertia along chains only."""
    last, *before = sorted(bodies, reverse=True)
    for other in set(before).difference(robot.carriers(last)):
        names = robot.bodies[other].joint, robot.bodies[last].joint
        raise ModelError(
            f"a rotor turns with joints '{names[0]}' and '{names[1]}' of different branches",
            where=f"robot '{robot.name}'",
            fix="the virtual robot couples rotors along one chain of joints only: put the "
            "rotor inertia on the joints",
        )
