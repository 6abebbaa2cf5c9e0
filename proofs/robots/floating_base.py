"""Legged robots with a floating base: torques, contacts and ranks are those of two other programs.

Models of MuJoCo Menagerie and a URDF, in `models` beside the data. Go2 and Spot are not among them:
an A1 that carries an arm stands for a Spot with its arm.
Both oracles read the files themselves: Pinocchio with a free flyer as root, MuJoCo with the file's
free joint. Errors are relative to the largest torque.
"""

import re
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Protocol

import mujoco
import numpy as np
import pinocchio as pin
from proofs.support.claims import Claim, data_folder, main_of
from proofs.support.mujoco_oracle import compiled, without_meshes

from steelyard.base.arrays import Array
from steelyard.base.motion import Motion
from steelyard.estimate.information.base_parameters_and_regressor import base_parameters
from steelyard.model.laws.laws_without_friction import RigidBody
from steelyard.model.model import Model
from steelyard.robot.file.model_reading_and_loaded_robot import read_mechanism
from steelyard.robot.robot import Robot
from steelyard.robot.robot_from_mechanism import reduced

ROBOTS = {
    "A1": "menagerie/unitree_a1/a1.xml",
    "G1": "menagerie/unitree_g1/g1.xml",
    "G1 with hands": "menagerie/unitree_g1/g1_with_hands.xml",
    "TALOS": "menagerie/pal_talos/talos.xml",
    "simple humanoid": "simple_humanoid_description/urdf/simple_humanoid.urdf",
}
STATES, CONTACTS = 30, 4
ROUNDING = 1e-10
RANK = 1e-9  # least singular value over the largest that counts, columns of one norm

Wrench = tuple[str, Array]
"""A link, and the force and the moment about its origin that act on it, in its axes, `(6,)`."""


class Oracle(Protocol):
    """Another program's torques of a state, in the robot's rows."""

    def torque(self, turn: Array, q: Array, dq: Array, ddq: Array, wrenches: list[Wrench]) -> Array:
        """Of axes of the base `(3, 3)`, of states as the robot has them `(n,)`, and of contacts."""


def followers(robot: Robot, places: dict[str, int], size: int) -> tuple[Array, Array]:
    """Another program's velocities of the robot's, `(size, n)`, and positions at zero `(size,)`."""
    matrix, offsets = np.zeros((size, robot.n)), np.zeros(size)
    matrix[:6, :6] = np.eye(6)
    for body in robot.bodies[1:]:
        matrix[places[body.joint], body.coordinate] = body.ratio
        offsets[places[body.joint]] = body.offset
    return matrix, offsets


class Pinocchio:
    """A tree of Pinocchio, its root a free flyer."""

    def __init__(self, path: Path, robot: Robot) -> None:
        read = pin.buildModelFromMJCF if path.suffix == ".xml" else _free_urdf
        self.model = read(str(path))
        self.model.armature = np.zeros(self.model.nv)  # rotors are a term of their own here
        self.data = self.model.createData()
        places = {
            name: j.idx_v for name, j in zip(self.model.names, self.model.joints, strict=True)
        }
        self.robot = robot
        self.matrix, self.offsets = followers(robot, places, self.model.nv)

    def state(self, turn: Array, q: Array, dq: Array, ddq: Array) -> tuple[Array, Array, Array]:
        """Its position, velocity and acceleration; that of the base is spatial, without gravity."""
        at, x = pin.neutral(self.model), self.matrix @ q + self.offsets
        at[3:7] = pin.Quaternion(turn).coeffs()
        for joint in list(self.model.joints)[2:]:
            angle = x[joint.idx_v]
            turning = [np.cos(angle), np.sin(angle)]
            at[joint.idx_q : joint.idx_q + joint.nq] = [angle] if joint.nq == 1 else turning
        speed, acceleration = self.matrix @ dq, self.matrix @ ddq
        gravity = np.array(self.model.gravity.linear)
        acceleration[:3] += turn.T @ gravity - np.cross(dq[3:6], dq[:3])
        return at, speed, acceleration

    def torque(self, turn: Array, q: Array, dq: Array, ddq: Array, wrenches: list[Wrench]) -> Array:
        """Recursive Newton-Euler with external forces."""
        forces = [pin.Force.Zero() for _ in range(self.model.njoints)]
        for link, wrench in wrenches:
            frame = self.model.frames[self.model.getFrameId(link)]
            forces[frame.parentJoint] += frame.placement.act(pin.Force(wrench))
        state = self.state(turn, q, dq, ddq)
        return np.asarray(self.matrix.T @ pin.rnea(self.model, self.data, *state, forces))

    def rank(self, states: Iterator[tuple[Array, ...]]) -> int:
        """Of the regressor of all bodies on states."""
        rows = [
            self.matrix.T
            @ pin.computeJointTorqueRegressor(self.model, self.data, *self.state(*x)).copy()
            for x in states
        ]
        stacked = np.vstack(rows)
        norms = np.linalg.norm(stacked, axis=0)
        seen = norms > RANK * norms.max()
        sizes = np.linalg.svd(stacked[:, seen] / norms[seen], compute_uv=False)
        return int((sizes > RANK * sizes[0]).sum())


def _free_urdf(path: str) -> Any:
    return pin.buildModelFromUrdf(path, pin.JointModelFreeFlyer())


class Mujoco:
    """The tree of an MJCF, its root a free joint."""

    def __init__(self, path: Path, robot: Robot) -> None:
        self.model, _ = compiled(path)
        self.data = mujoco.MjData(self.model)
        names = [self.model.joint(k).name for k in range(1, self.model.njnt)]
        places = {name: int(self.model.joint(name).dofadr[0]) for name in names}
        self.matrix, self.offsets = followers(robot, places, self.model.nv)

    def torque(self, turn: Array, q: Array, dq: Array, ddq: Array, wrenches: list[Wrench]) -> Array:
        """Its `mj_rne`, minus what `mj_applyFT` makes of the contacts; the force in base axes."""
        model, data = self.model, self.data
        data.qpos[3:7] = pin.Quaternion(turn).coeffs()[[3, 0, 1, 2]]
        data.qpos[7:] = (self.matrix @ q + self.offsets)[6:]
        data.qvel[:], data.qacc[:] = self.matrix @ dq, self.matrix @ ddq
        data.qvel[:3], data.qacc[:3] = turn @ dq[:3], turn @ ddq[:3] + model.opt.gravity
        for step in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_comVel):
            step(model, data)
        found, pushed = np.zeros((2, model.nv))
        mujoco.mj_rne(model, data, 1, found)
        for link, wrench in wrenches:
            body = model.body(link).id
            axes, at = data.xmat[body].reshape(3, 3), data.xpos[body]
            mujoco.mj_applyFT(model, data, axes @ wrench[:3], axes @ wrench[3:], at, body, pushed)
        found -= pushed
        found[:3] = turn.T @ found[:3]
        return np.asarray(self.matrix.T @ found)


def random_states(robot: Robot, count: int, seed: int) -> Iterator[tuple[Array, ...]]:
    """Axes of the base, positions, velocities and accelerations."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        quaternion = rng.normal(size=4)
        turn = pin.Quaternion(quaternion / np.linalg.norm(quaternion)).toRotationMatrix()
        yield turn, *(rng.normal(size=(3, robot.n)) * [[1.0], [2.0], [5.0]])


def errors(robot: Robot, oracle: Oracle) -> tuple[float, float]:
    """Of regressor times parameters, without contacts and with contacts at the ends of limbs."""
    model = Model(robot, (RigidBody(),)).prior
    assert model is not None
    ends = sorted({*range(1, len(robot.bodies))} - {b.parent for b in robot.bodies})
    links = [robot.bodies[k].name for k in ends if not robot.bodies[k].massless]
    rng = np.random.default_rng(5)
    free, touched, largest = 0.0, 0.0, 0.0
    for turn, q, dq, ddq in random_states(robot, STATES, 0):
        found = model.regressor(q, dq, ddq) @ model.values.values
        wanted = oracle.torque(turn, q, dq, ddq, [])
        wrenches = [
            (str(link), rng.normal(size=6) * [50.0, 50.0, 200.0, 5.0, 5.0, 5.0])
            for link in rng.choice(links, CONTACTS)
        ]
        pushed = oracle.torque(turn, q, dq, ddq, wrenches)
        free = max(free, float(np.abs(found - wanted).max()))
        for link, wrench in wrenches:
            along = np.kron(np.eye(2), model.pose(q, link)[1]) @ wrench
            found = found - model.jacobian(q, link).T @ along
        touched = max(touched, float(np.abs(found - pushed).max()))
        largest = max(largest, float(np.abs(wanted).max()))
    return free / largest, touched / largest


def claims_of(name: str, path: Path) -> Iterator[Claim]:
    """Of one robot."""
    robot, _ = reduced(read_mechanism(path), base="floating", snap=False)
    oracle = Pinocchio(path, robot)
    oracles: dict[str, Oracle] = {"Pinocchio": oracle}
    if path.suffix == ".xml":
        oracles["MuJoCo"] = Mujoco(path, robot)
    for program, other in oracles.items():
        for kind, error in zip(("", ", contacts"), errors(robot, other), strict=True):
            claim = f"{name}, {robot.n - 6} joints, {program}{kind}"
            yield Claim(claim, f"{error:.1e}", f"<= {ROUNDING:g}", error <= ROUNDING)
    wanted = oracle.rank(random_states(robot, 12 * len(robot.bodies) * 10 // robot.n, 1))
    count = len(base_parameters(Model(robot, (RigidBody(),))))
    yield Claim(f"{name}, base parameters", str(count), f"= {wanted} (Pinocchio)", count == wanted)


def at_rest(path: Path, link: str) -> float:
    """Difference of the joints' torques on a base at rest from those on a fixed base."""
    mechanism = read_mechanism(path)
    fixed, floating = (reduced(mechanism, base=base)[0] for base in (link, "floating"))
    models = [Model(robot, (RigidBody(),)).prior for robot in (fixed, floating)]
    q, dq, ddq = np.random.default_rng(2).normal(size=(3, STATES, fixed.n))
    rest = np.zeros((STATES, 3))
    motion = Motion.floating(
        np.arange(float(STATES)), q, dq, ddq, proper_acceleration=rest - fixed.gravity,
        angular_velocity=rest, angular_acceleration=rest,
    )  # fmt: skip
    wanted, found = models[0].torque(q, dq, ddq), models[1].torque(motion)[:, 6:]
    return float(np.abs(found - wanted).max() / np.abs(wanted).max())


def with_arm(menagerie: Path, place: Path) -> Path:
    """An A1 with a Z1 on its back, as an MJCF without meshes at `place`."""
    dog, arm = (
        without_meshes(mujoco.MjSpec.from_file(str(menagerie / name)))
        for name in ("unitree_a1/a1.xml", "unitree_z1/z1.xml")
    )
    for spec in (dog, arm):
        for key in spec.keys:
            spec.delete(key)
    arm.option.integrator = dog.option.integrator
    arm.worldbody.bodies[0].pos = [0.15, 0.0, 0.06]
    dog.worldbody.bodies[0].add_frame().attach_body(arm.worldbody.bodies[0], "arm_", "")
    dog.compile()
    place.write_text(re.sub(r"\s*</?frame[^>]*>", "", dog.to_xml()))  # Pinocchio reads none
    return place


def main() -> list[Claim]:
    """All robots."""
    models = data_folder().parent / "models"
    found = [x for name, path in ROBOTS.items() for x in claims_of(name, models / path)]
    with tempfile.TemporaryDirectory() as folder:
        carrying = with_arm(models / "menagerie", Path(folder) / "a1_z1.xml")
        found += claims_of("A1 with a Z1", carrying)
    error = at_rest(models / ROBOTS["A1"], "trunk")
    name = "A1, floating base at rest against fixed base"
    return [*found, Claim(name, f"{error:.1e}", f"<= {ROUNDING:g}", error <= ROUNDING)]


if __name__ == "__main__":
    main_of(main)
