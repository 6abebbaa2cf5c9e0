"""Arms of one to three joints under position servos that MuJoCo simulates; files and logs."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
import polars as pl
from mujoco import rollout

URDF = """<robot name="servos">
  <link name="base"/>
  <link name="upper"><inertial><origin xyz="0.06 0 0.01"/><mass value="0.25"/>
    <inertia ixx="1e-4" iyy="4e-4" izz="4e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="lower"><inertial><origin xyz="0.08 0.005 0"/><mass value="0.2"/>
    <inertia ixx="1e-4" iyy="3e-4" izz="3e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/>
    <axis xyz="0 1 0"/><limit lower="-1.8" upper="1.8" velocity="6" effort="10"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/>
    <origin xyz="0.12 0 0"/><axis xyz="0 1 0"/>
    <limit lower="-1.8" upper="1.8" velocity="6" effort="10"/></joint>
</robot>
"""
MJCF = """<mujoco><option timestep="{step}" integrator="implicitfast" gravity="0 0 -9.81"/>
<worldbody><body><joint name="shoulder" axis="0 1 0" {joints[0]}/>
<inertial pos="0.06 0 0.01" mass="0.25" diaginertia="1e-4 4e-4 4e-4"/>
<body pos="0.12 0 0"><joint name="elbow" axis="0 1 0" {joints[1]}/>
<inertial pos="0.08 0.005 0" mass="0.2" diaginertia="1e-4 3e-4 3e-4"/></body></body></worldbody>
<actuator>{motors}</actuator></mujoco>"""
BENCH_URDF = """<robot name="bench">
  <link name="base"/>
  <link name="pendulum"><inertial><origin xyz="0.15 0 0"/><mass value="0.5"/>
    <inertia ixx="1e-4" iyy="5e-4" izz="5e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="motor" type="revolute"><parent link="base"/><child link="pendulum"/>
    <axis xyz="0 1 0"/><limit lower="-1.8" upper="1.8" velocity="9" effort="10"/></joint>
</robot>
"""
BENCH_MJCF = """<mujoco><option timestep="{step}" integrator="implicitfast" gravity="0 0 -9.81"/>
<worldbody><body><joint name="motor" axis="0 1 0" {joints[0]}/>
<inertial pos="0.15 0 0" mass="0.5" diaginertia="1e-4 5e-4 5e-4"/></body></worldbody>
<actuator>{motors}</actuator></mujoco>"""
WAIST_URDF = URDF.replace(
    '<link name="base"/>',
    """<link name="base"/>
  <link name="turret"><inertial><origin xyz="0.01 0 0.04"/><mass value="0.3"/>
    <inertia ixx="4e-4" iyy="4e-4" izz="3e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="waist" type="revolute"><parent link="base"/><child link="turret"/>
    <axis xyz="0 0 1"/><limit lower="-1.8" upper="1.8" velocity="6" effort="10"/></joint>""",
).replace(
    '<parent link="base"/><child link="upper"/>',
    '<parent link="turret"/><child link="upper"/><origin xyz="0 0 0.08"/>',
)
WAIST_MJCF = """<mujoco><option timestep="{step}" integrator="implicitfast" gravity="0 0 -9.81"/>
<worldbody><body><joint name="waist" axis="0 0 1" {joints[0]}/>
<inertial pos="0.01 0 0.04" mass="0.3" diaginertia="4e-4 4e-4 3e-4"/>
<body pos="0 0 0.08"><joint name="shoulder" axis="0 1 0" {joints[1]}/>
<inertial pos="0.06 0 0.01" mass="0.25" diaginertia="1e-4 4e-4 4e-4"/>
<body pos="0.12 0 0"><joint name="elbow" axis="0 1 0" {joints[2]}/>
<inertial pos="0.08 0.005 0" mass="0.2" diaginertia="1e-4 3e-4 3e-4"/>
</body></body></body></worldbody>
<actuator>{motors}</actuator></mujoco>"""
ARMS = {1: BENCH_MJCF, 2: MJCF, 3: WAIST_MJCF}
JOINTS = {1: ("motor",), 2: ("shoulder", "elbow"), 3: ("waist", "shoulder", "elbow")}
URDFS = {1: BENCH_URDF, 2: URDF, 3: WAIST_URDF}
STIFF = 'solreffriction="0.0005 1" solimpfriction="0.999 0.9999 0.001 0.5 2"'

ROBOT_FILE = """[robot]
urdf = "servos.urdf"
[signals]
time = "time"
position = "q{}"
target = "target{}"
"""
BENCH_FILE = ROBOT_FILE.replace("servos", "bench")


@dataclass(frozen=True)
class Servos:
    """What the servos really are, a value per joint; the delay is common [s]."""

    stiffness: tuple[float, ...] = (12.0, 8.0)
    damping: tuple[float, ...] = (0.5, 0.3)
    coulomb: tuple[float, ...] = (0.12, 0.06)
    armature: tuple[float, ...] = (0.02, 0.012)
    torque_limit: tuple[float, ...] = (1e3, 1e3)
    delay: float = 0.012
    back_emf: tuple[float, ...] = (0.0, 0.0)
    stribeck: tuple[float, ...] = (0.0, 0.0)
    stribeck_speed: tuple[float, ...] = (1.0, 1.0)
    load_friction: tuple[float, ...] = (0.0, 0.0)
    integral: tuple[float, ...] | float = 0.0

    @property
    def n(self) -> int:
        """Number of joints: one of the bench, two of the arm, three with a waist."""
        return len(self.stiffness)

    def model(self, step: float = 0.001) -> mujoco.MjModel:
        """MuJoCo's model of the arm."""
        joints = [
            f'armature="{a}" frictionloss="{f}" damping="{e}" {STIFF}'
            for a, f, e in zip(self.armature, self.coulomb, self.back_emf, strict=True)
        ]
        motors = "".join(
            f'<position joint="{name}" kp="{kp}" kv="{kd}" forcerange="-{limit} {limit}"/>'
            for name, kp, kd, limit in zip(
                JOINTS[self.n],
                self.stiffness,
                self.damping,
                self.torque_limit,
                strict=True,
            )
        )
        text = ARMS[self.n].format(step=step, joints=joints, motors=motors)
        torques = "".join(f'<jointactuatorfrc joint="{name}"/>' for name in JOINTS[self.n])
        text = text.replace("</mujoco>", f"<sensor>{torques}</sensor></mujoco>")
        return mujoco.MjModel.from_xml_string(text)

    def friction(self, v: np.ndarray, torque: np.ndarray) -> np.ndarray:
        """Size of dry friction at speeds and torques of the motors, `(n,)`."""
        slow = np.exp(-((v / np.array(self.stribeck_speed)) ** 2))
        load = np.array(self.load_friction) * np.abs(torque)
        return np.array(self.coulomb) + np.array(self.stribeck) * slow + load


def targets(
    seconds: float, seed: int, rate: float = 50.0, joints: int = 2
) -> tuple[np.ndarray, np.ndarray]:
    """Ramps with rests, and sines, at the rows of a log `(N,)`, `(N, joints)`."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, seconds, 1.0 / rate)
    found = np.zeros((len(t), joints))
    for j in range(joints):
        knots, places = [0.0], [rng.uniform(-0.8, 0.8)]
        while knots[-1] < seconds:
            knots += [knots[-1] + rng.uniform(0.3, 1.5)]
            places += [rng.uniform(-1.2, 1.2)]
            if rng.random() < 0.4:
                knots += [knots[-1] + rng.uniform(0.2, 0.8)]
                places += [places[-1]]
        found[:, j] = np.interp(t, knots, places)
        fast = rng.uniform(1.0, 3.0)
        found[:, j] += 0.08 * np.sin(2.0 * np.pi * fast * t) * (np.sin(0.7 * t) > 0.0)
    return t, found


def moved(
    servos: Servos, t: np.ndarray, target: np.ndarray, step: float = 1e-4, start: object = None
) -> np.ndarray:
    """Positions at the rows, `(N, n)`, with each target held until the next row."""
    return simulated(servos, t, target, step, start)[0]


def simulated(
    servos: Servos,
    t: np.ndarray,
    target: np.ndarray,
    step: float = 1e-4,
    start: object = None,
    supply: Callable[[float], float] | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Positions and torques of the motors at the rows, `(N, n)` each.

    Stiffness and torque limits are proportional to the `supply` at a time, if there is one. With
    integral gains, without torque limits, the arm begins at rest.
    """
    model = servos.model(step)
    data = mujoco.MjData(model)
    data.qpos[:] = target[0] if start is None else start
    first = np.array(data.qpos)
    state = np.zeros((1, mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)))
    mujoco.mj_getState(model, data, state[0], mujoco.mjtState.mjSTATE_FULLPHYSICS)
    times = np.arange(round((t[-1] + 1e-9) / step) + 1) * step
    rows = np.clip(np.searchsorted(t, times - servos.delay + 1e-9, side="right") - 1, 0, None)
    at = np.searchsorted(times, t - 0.5 * step)
    ki = np.broadcast_to(servos.integral, servos.n)
    if any(servos.stribeck) or any(servos.load_friction) or supply or ki.any():
        q, torque = [first], []
        mujoco.mj_forward(model, data)
        held = data.qfrc_bias - np.array(servos.stiffness) * (target[0] - first)
        held = np.where(ki > 0.0, held, 0.0)
        for row, now in zip(rows, times, strict=True):
            model.dof_frictionloss[:] = servos.friction(data.qvel, data.actuator_force)
            if supply:
                fed = supply(now)
                model.actuator_gainprm[:, 0] = fed * np.array(servos.stiffness)
                model.actuator_biasprm[:, 1] = -model.actuator_gainprm[:, 0]
                model.actuator_forcerange.T[:] = fed * np.outer((-1, 1), servos.torque_limit)
            data.ctrl[:] = target[row]
            data.qfrc_applied[:] = held = held + step * ki * (target[row] - data.qpos)
            mujoco.mj_step(model, data)
            q.append(data.qpos.copy())
            torque.append(data.sensordata + held)
        return np.array(q)[at], np.array(torque)[at]
    states, sensed = rollout.rollout(model, data, state, target[rows][None])
    q = np.vstack([first, states[0, :, 1 : 1 + servos.n]])
    return np.asarray(q[at]), np.asarray(sensed[0][at])


def log(
    servos: Servos,
    seconds: float = 60.0,
    seed: int = 0,
    rate: float = 50.0,
    resolution: float = 2.0 * np.pi / 4096.0,
    noise: float = 1e-3,
    jitter: float = 0.0,
    step: float = 1e-4,
    supply: Callable[[float], float] | None = None,
    torques: bool = False,
) -> Mapping[str, np.ndarray]:
    """Columns of a log by an encoder with steps and noise [rad], on a clock with jitter [s].

    With torques of the motors where they are wanted, and the supply.
    """
    t, target = targets(seconds, seed, rate, servos.n)
    rng = np.random.default_rng(seed + 1000)
    t = t + np.clip(jitter * rng.standard_normal(len(t)), -0.4 / rate, 0.4 / rate)
    t = np.round(t - t[0], 4)
    q, torque = simulated(servos, t, target, step, supply=supply)
    q = np.round((q + noise * rng.standard_normal(q.shape)) / resolution) * resolution
    columns = {"time": t}
    columns |= {f"target{j + 1}": target[:, j] for j in range(servos.n)}
    columns |= {f"tau{j + 1}": torque[:, j] for j in range(servos.n) if torques}
    columns |= {"supply": np.array([supply(x) for x in t])} if supply else {}
    return columns | {f"q{j + 1}": q[:, j] for j in range(servos.n)}


def made(folder: Path, servos: Servos = Servos(), seconds: float = 60.0) -> Path:
    """Robot file and two logs in a folder; the robot file."""
    (folder / "servos.urdf").write_text(URDF)
    (folder / "servos.toml").write_text(ROBOT_FILE)
    for seed, name in enumerate(("fit", "other")):
        pl.DataFrame(log(servos, seconds, seed)).write_csv(folder / f"servo_{name}.csv")
    return folder / "servos.toml"
