"""Legged robots on the floor, simulated in MuJoCo: their logs, and what is true of them.

Joints follow scripted targets: sways on all feet, and a trot; a robot that would fall hangs on a
hoist, which moves it. Bodies are others than in the model file. A log has means over its rows'
intervals, as sensors with a low-pass give them, with noise.
`python -m proofs.support.legged_robots A1 FOLDER` writes logs of four gaits, the last one with 2 kg
on the back, and robot files: `measured.toml` with forces of the feet, `flags.toml` without.
"""

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import polars as pl
from proofs.support.claims import data_folder
from proofs.support.mujoco_oracle import without_meshes

from steelyard.base.arrays import Array
from steelyard.robot.inertia_and_placement import INERTIAL_NAMES, Inertia, rpy_rotation
from steelyard.robot.robot import Robot

STEP, ROWS = 5e-4, 4  # step of the simulation [s], steps that a row is the mean of
IMU = (0.05, -0.02, 0.03)  # place of the inertial sensor on the base link [m]
TURNED = (10.0, -5.0, 30.0)  # how it is turned there: roll, pitch, yaw [deg]
SPREAD, SHIFT = 0.15, 0.01  # of true masses, relative, and of centres of mass [m]
HARD = [0.005, 1.0], [0.9, 0.95, 0.001]  # constraint by which MuJoCo makes contacts
TOUCHING = 4.0  # measured force above which a foot touches for sure [N]
STIFF = 0.999  # impedance of the constraint by which MuJoCo makes dry friction of joints
NOISE = {"q": 2e-5, "tau": 0.05, "acc": 0.05, "gyro": 2e-3, "force": 0.5, "moment": 0.02}
"""Standard deviations of a row [rad, Nm, m/s², rad/s, N, Nm]."""

GAITS = (
    ("sways", 15.0, 0.0, 0.0), ("trot", 15.0, 2.0, 0.0), ("fast_trot", 15.0, 3.0, 0.0),
    ("carrying", 15.0, 2.0, 2.0),
)  # fmt: skip
"""Of the tutorial: name, duration [s], steps [Hz] and load on the back [kg]."""
ICE = 0.02  # coefficient of friction

Targets = Callable[[float], Array]


@dataclass(frozen=True, eq=False)
class Legged:
    """A robot, links that its contacts are on, amplitudes of sways by the ends of joints' names.

    One that hangs is held by its base instead. Feet are balls on these links: place and radius.
    """

    file: str
    key: str  # keyframe that it stands in
    feet: tuple[str, ...]
    sways: dict[str, float]
    axes: str  # that forces of the feet are measured along
    bent: dict[str, float] | None = (
        None  # by how much joints are bent where it hangs; else it stands
    )
    ball: tuple[tuple[float, float, float], float] | None = None  # [m]

    @property
    def hung(self) -> bool:
        """Whether it hangs."""
        return self.bent is not None


LEGGED = {
    "A1": Legged(
        "menagerie/unitree_a1/a1.xml",
        "home",
        ("FR_calf", "FL_calf", "RR_calf", "RL_calf"),
        {"hip_joint": 0.07, "thigh_joint": 0.12, "calf_joint": 0.15},
        "world",
        ball=((0.0, 0.0, -0.2), 0.02),
    ),
    "A1 on a hoist": Legged(
        "menagerie/unitree_a1/a1.xml",
        "home",
        ("trunk",),
        {"hip_joint": 0.25, "thigh_joint": 0.5, "calf_joint": 0.5},
        "frame",
        {},
    ),
    "G1": Legged(
        "menagerie/unitree_g1/g1.xml",
        "stand",
        ("pelvis",),
        {
            "hip_pitch_joint": 0.4, "hip_roll_joint": 0.1, "hip_yaw_joint": 0.3,
            "knee_joint": 0.4, "ankle_pitch_joint": 0.25, "ankle_roll_joint": 0.12,
            "waist_yaw_joint": 0.4, "waist_roll_joint": 0.2, "waist_pitch_joint": 0.2,
            "shoulder_pitch_joint": 0.5, "shoulder_roll_joint": 0.2, "shoulder_yaw_joint": 0.4,
            "elbow_joint": 0.5, "wrist_roll_joint": 0.8, "wrist_pitch_joint": 0.6,
            "wrist_yaw_joint": 0.6,
        },
        "frame",
        {"knee_joint": 0.8},
    ),
}  # fmt: skip


class Simulation:
    """A robot with other bodies than its file's on a floor, or hung up, and its sensors."""

    def __init__(
        self,
        path: Path,
        robot: Legged,
        seed: int,
        load: float = 0.0,
        mirrored: bool = False,
        slippery: str = "",
    ) -> None:
        """Of a model file; with a load [kg] on its back, and ice under one of its feet."""
        spec = without_meshes(mujoco.MjSpec.from_file(str(path)))
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1])
        base = spec.worldbody.bodies[0]
        turn = np.zeros(4)
        mujoco.mju_mat2Quat(turn, rpy_rotation(*np.deg2rad(TURNED)).ravel())
        base.add_site(name="imu", pos=IMU, quat=turn)
        for name, kind in (
            ("acc", mujoco.mjtSensor.mjSENS_ACCELEROMETER),
            ("gyro", mujoco.mjtSensor.mjSENS_GYRO),
            ("quat", mujoco.mjtSensor.mjSENS_FRAMEQUAT),
        ):
            spec.add_sensor(
                name=f"own_{name}", type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname="imu"
            )
        spec.option.timestep = STEP
        # implicit damping makes joints heavier than their equation of motion says
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_EULER
        spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_EULERDAMP
        self.robot, self.model = robot, spec.compile()
        # by default friction is a damper up to 0.1 rad/s and more, not the law's constant
        self.model.dof_solref[:] = [2.0 * STEP, 1.0]
        self.model.dof_solimp[:, :2] = STIFF
        # hard balls touch the floor at a point and take no moment; the file's give by 6 to 15 mm
        self.model.geom_condim[:] = 3
        self.model.geom_solref[:], self.model.geom_solimp[:, :3] = HARD
        self._disturb(np.random.default_rng(seed), load, mirrored)
        if slippery:
            on = self.model.geom_bodyid == self.model.body(slippery).id
            self.model.geom_friction[on, 0] = ICE
            self.model.geom_priority[on] = 10  # its friction counts, not that of the floor
        self.data = mujoco.MjData(self.model)
        mujoco.mj_resetDataKeyframe(self.model, self.data, self.model.key(robot.key).id)
        self.data.qpos[2] += 1.0 if robot.hung else 0.0
        self.held = self.data.qpos[:3].copy()
        self.joints = [self.model.joint(k).name for k in range(1, self.model.njnt)]

    def _disturb(self, rng: Any, load: float, mirrored: bool) -> None:
        """Other masses, inertias and centres, alike on both sides if mirrored; a load [kg]."""
        model = self.model
        for body in range(1, model.nbody):
            factor = np.exp(SPREAD * rng.normal())
            model.body_mass[body] *= factor
            model.body_inertia[body] *= factor
            model.body_ipos[body] += SHIFT * rng.normal(size=3)
        for body in range(1, model.nbody) if mirrored else ():
            name = model.body(body).name
            if name[1:3] == "R_":
                left = model.body(f"{name[0]}L_{name[3:]}").id
                model.body_mass[left] = model.body_mass[body]
                model.body_inertia[left] = model.body_inertia[body]
                model.body_ipos[left] = model.body_ipos[body] * [1.0, -1.0, 1.0]
                model.body_iquat[left] = model.body_iquat[body] * [1.0, -1.0, 1.0, -1.0]
        if load:
            self._carry(load)
        mujoco.mj_setConst(model, mujoco.MjData(model))

    def _carry(self, load: float) -> None:
        """A small heavy ball on the base, in its mass and centre."""
        model, at = self.model, np.array([-0.05, 0.0, 0.1])
        mass, ball = model.body_mass[1], Inertia.about_com(load, at, 0.002 * load * np.eye(3))
        matrix = np.zeros(9)
        mujoco.mju_quat2Mat(matrix, model.body_iquat[1])
        axes = matrix.reshape(3, 3)
        about = axes @ np.diag(model.body_inertia[1]) @ axes.T
        whole = Inertia.about_com(mass, model.body_ipos[1], about) + ball
        sizes, turned = np.linalg.eigh(whole.inertia_com)
        turned[:, 0] *= np.linalg.det(turned)
        model.body_mass[1], model.body_ipos[1] = whole.mass, whole.com
        model.body_inertia[1] = sizes
        mujoco.mju_mat2Quat(model.body_iquat[1], turned.ravel())

    def truth(self, robot: Robot) -> dict[str, float]:
        """Standard parameters by name: bodies, rotors and friction."""
        model, frames = self.model, {frame.name: frame for frame in robot.frames}
        bodies = [Inertia.zero() for _ in robot.bodies]
        for k in range(1, model.nbody):
            matrix = np.zeros(9)
            mujoco.mju_quat2Mat(matrix, model.body_iquat[k])
            axes = matrix.reshape(3, 3)
            about = axes @ np.diag(model.body_inertia[k]) @ axes.T
            own = Inertia.about_com(model.body_mass[k], model.body_ipos[k], about)
            frame = frames[model.body(k).name]
            bodies[frame.body] += own.moved(frame.rotation, frame.position)
        found = {
            f"{name}.{body.name}": float(x)
            for body, inertia in zip(robot.bodies, bodies, strict=True)
            for name, x in zip(INERTIAL_NAMES, inertia.ten, strict=True)
        }
        for name in self.joints:
            at = int(model.joint(name).dofadr[0])
            damping = float(model.dof_damping[at])
            # damping is of the velocity half a step ago, which acts as less inertia
            found[f"rotor_inertia.{name}"] = float(model.dof_armature[at]) - 0.5 * STEP * damping
            found[f"coulomb.{name}"] = float(model.dof_frictionloss[at])
            found[f"viscous.{name}"] = damping
        return found

    def log(self, path: Path, seconds: float, seed: int, trot: float = 0.0) -> None:
        """Follow targets and write a log; settles for 2 s before."""
        targets, rng = self._targets(seed, trot), np.random.default_rng(seed)
        count = int(round(seconds / STEP / ROWS)) * ROWS
        rows, settle = [], int(2.0 / STEP)
        for k in range(-settle, count):
            t = max(k, 0) * STEP
            mujoco.mj_step1(self.model, self.data)
            self.data.ctrl[:] = targets(t)
            if self.robot.hung:
                self._hold(t, seed)
            positions = self.data.qpos[7:].copy()
            mujoco.mj_step2(self.model, self.data)  # all but positions is still that of before
            if k >= 0:
                rows.append(np.concatenate([positions, self._reading()]))
        # velocities of the integration are those half a step before its accelerations
        names, found = self._names(), np.array(rows)
        late = np.array([not name.startswith("gyro") for name in names])
        found[1:, late] = 0.5 * (found[1:, late] + found[:-1, late])
        means = found.reshape(-1, ROWS, len(names)).mean(axis=1)
        sizes = [NOISE.get(name.split("_")[0], 0.0) for name in names]
        means += np.array(sizes) * rng.normal(size=means.shape)
        t = STEP * ROWS * np.arange(len(means))
        columns = {"t": t, **dict(zip(names, means.T, strict=True))}
        for foot in self.robot.feet:
            force = [columns[f"force_{foot}_{axis}"] for axis in "xyz"]
            columns[f"load_{foot}"] = np.linalg.norm(force, axis=0)
        pl.DataFrame(columns).write_parquet(path)

    def _hold(self, t: float, seed: int) -> None:
        """The hoist: springs and dampers from the base to a frame that sways."""
        data, rng = self.data, np.random.default_rng(seed + 1000)
        w, phase = 2.0 * np.pi * rng.uniform(0.2, 0.9, (2, 6)), rng.uniform(0.0, 6.0, (2, 6))
        sway = np.array([0.05, 0.05, 0.08, 0.3, 0.3, 0.4]) * np.sin(w * t + phase).sum(axis=0)
        sway *= 0.5 * min(1.0, t)
        aim, turn = np.zeros(4), np.zeros(3)
        mujoco.mju_mat2Quat(aim, rpy_rotation(*sway[3:]).ravel())
        mujoco.mju_subQuat(turn, aim, data.qpos[3:7])
        axes = data.xmat[1].reshape(3, 3)
        force = 2e4 * (self.held + sway[:3] - data.qpos[:3]) - 1e3 * data.qvel[:3]
        moment = axes @ (1e3 * turn - 50.0 * data.qvel[3:6])
        data.xfrc_applied[1, :3] = force
        data.xfrc_applied[1, 3:] = moment - np.cross(data.xipos[1] - data.xpos[1], force)
        self.pull = np.concatenate([axes.T @ force, axes.T @ moment])

    def _targets(self, seed: int, trot: float) -> Targets:
        """Sums of sines about where it stands; with `trot` [Hz] diagonal legs lift in turn."""
        rng, home = np.random.default_rng(seed), self.model.key(self.robot.key).ctrl.copy()
        driven = (int(self.model.actuator(k).trnid[0]) for k in range(self.model.nu))
        joints = [self.model.joint(k).name for k in driven]
        size, bent = (
            np.array([_of_end(name, each or {}) for name in joints])
            for each in (self.robot.sways, self.robot.bent)
        )
        w = 2.0 * np.pi * rng.uniform(0.2, 1.2, (3, len(size)))
        a, phase = rng.uniform(0.2, 0.6, w.shape), rng.uniform(0.0, 2.0 * np.pi, w.shape)
        lift = np.array([_lift(name) for name in joints])
        side = np.array([1.0 if name[:2] in ("FR", "RL") else -1.0 for name in joints])

        def at(t: float) -> Array:
            ease = min(1.0, t)
            sway = size * (a * np.sin(w * t + phase)).sum(axis=0)
            up = np.maximum(0.0, side * np.sin(2.0 * np.pi * trot * t)) if trot else 0.0
            return np.asarray(home + bent + ease * ((0.4 if trot else 1.0) * sway + lift * up))

        return at

    def _names(self) -> list[str]:
        names = [f"{kind}_{joint}" for kind in ("q", "tau") for joint in self.joints]
        names += [f"{kind}_{axis}" for kind in ("acc", "gyro") for axis in "xyz"]
        names += [f"quat_{axis}" for axis in "wxyz"]
        for foot in self.robot.feet:
            names += [f"{kind}_{foot}_{axis}" for kind in ("force", "moment") for axis in "xyz"]
        return names

    def _reading(self) -> Array:
        data = self.data
        own = [data.sensor(f"own_{name}").data for name in ("acc", "gyro", "quat")]
        feet = [self.pull] if self.robot.hung else [self._wrench(f) for f in self.robot.feet]
        return np.concatenate([data.qfrc_actuator[6:], *own, *feet])

    def _wrench(self, link: str) -> Array:
        """What the floor does to a link, about its origin, along the axes that are measured."""
        model, data, body = self.model, self.data, self.model.body(link).id
        force, moment, six = np.zeros(3), np.zeros(3), np.zeros(6)
        for k in range(data.ncon):
            contact = data.contact[k]
            bodies = [int(model.geom_bodyid[g]) for g in contact.geom]
            if body not in bodies:
                continue
            mujoco.mj_contactForce(model, data, k, six)
            sign = 1.0 if bodies[1] == body else -1.0
            axes = contact.frame.reshape(3, 3).T
            pushed, twisted = sign * axes @ six[:3], sign * axes @ six[3:]
            force += pushed
            moment += twisted + np.cross(contact.pos - data.xpos[body], pushed)
        axes = np.eye(3) if self.robot.axes == "world" else data.xmat[body].reshape(3, 3)
        return np.concatenate([axes.T @ force, axes.T @ moment])

    def robot_file(self, folder: Path, path: Path, more: str = "", measured: bool = True) -> Path:
        """The robot file for its logs; of contacts with their wrenches, or only sizes of forces."""
        roll, pitch, yaw = TURNED
        known = (
            'force = "force_{0}_{{}}"\nmoment = "moment_{0}_{{}}"\n' + f'axes = "{self.robot.axes}"'
        )
        if not measured and self.robot.ball is not None:
            place, radius = self.robot.ball
            known = f'touching = "load_{{0}}"\nthreshold = {TOUCHING}\n'
            known += f"position = {list(place)}\nradius = {radius}"
        feet = "".join(
            f'[[signals.base.contacts]]\nframe = "{foot}"\n{known.format(foot)}\n'
            for foot in self.robot.feet
        )
        file = folder / f"{'measured' if measured else 'flags'}.toml"
        file.write_text(
            f"""[robot]
mjcf = "{path}"
base = "floating"
[signals]
time = "t"
position = "q_{{joint}}"
[signals.effort]
columns = "tau_{{joint}}"
kind = "joint_torque"
unit = "Nm"
[signals.base]
acceleration = "acc_{{}}"
angular_velocity = "gyro_{{}}"
orientation = "quat_{{}}"
mounting = {{roll = {roll}, pitch = {pitch}, yaw = {yaw}, position = {list(IMU)}}}
{feet}{more}"""
        )
        return file


def _lift(joint: str) -> float:
    """How far a leg's joint goes where the foot is lifted [rad]."""
    return 0.35 if joint.endswith("thigh_joint") else -0.7 if joint.endswith("calf_joint") else 0.0


def _of_end(joint: str, given: dict[str, float]) -> float:
    """The value of the end of a joint's name; zero if there is none."""
    return next((x for end, x in given.items() if joint.endswith(end)), 0.0)


def main() -> None:
    """Logs of one robot, and its robot files, for the tutorial."""
    name, folder = sys.argv[1], Path(sys.argv[2])
    robot = LEGGED[name]
    path = data_folder().parent / "models" / robot.file
    folder.mkdir(parents=True)
    for gait, seconds, trot, load in GAITS:
        simulation = Simulation(path, robot, 0, load)
        simulation.log(folder / f"{gait}.parquet", seconds, len(gait), trot)
        print(f"{folder / gait}.parquet")
    for measured in (True,) if robot.hung else (True, False):
        print(simulation.robot_file(folder, path, measured=measured))


if __name__ == "__main__":
    main()
