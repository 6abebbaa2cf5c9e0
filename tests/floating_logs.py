"""A dog with two legs, moved by a hand on its back: exact logs of motion, sensors and contacts."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import polars as pl

from steelyard.base.arrays import Array
from steelyard.base.motion import Motion
from steelyard.model.laws.laws_without_friction import RigidBody
from steelyard.model.model import Model
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.inertia_and_placement import rpy_rotation, turn

BALL = '<geom type="sphere" size=".05" pos=".1 .02 0" mass="{}"/>'
LEG = """
<body name="{0}_thigh" pos="{1} 0 -.1">
  <joint name="{0}_hip" axis="1 0 0" frictionloss="0"/>{2}
  <body name="{0}_calf" pos="0 0 -.2"><joint name="{0}_knee" axis="0 1 0"/>{3}
    <body name="{0}_foot" pos="0 .01 -.2" quat=".9 .1 .3 -.2"/>
  </body>
</body>"""
LEGS = "".join(
    LEG.format(name, x, BALL.format(0.7), BALL.format(0.4))
    for name, x in (("fore", 0.2), ("hind", -0.2))
)
DOG = f"""<mujoco><worldbody><body name="trunk" pos="0 0 .5"><freejoint/>
  <geom type="box" size=".2 .1 .05" pos=".01 0 .02" mass="5"/>
  <body name="imu" pos=".1 .05 .02" quat=".8 .1 -.3 .2"/>
  <body name="handle" pos="0 0 .1" quat=".9 .3 .1 -.2"/>{LEGS}</body></worldbody></mujoco>"""

JOINTS = ("fore_hip", "fore_knee", "hind_hip", "hind_knee")

IMU = '[signals.base]\nframe = "imu"\nacceleration = "acc_{}"\nangular_velocity = "gyro_{}"\n'
TRACKED = (
    '[signals.base]\nframe = "imu"\nposition = "marker_{}"\norientation = "marker_q{}"\n'
    'orientation_kind = "xyzw"\n'
)
TOE = (0.02, 0.01, -0.03)  # what touches, in the frame of a foot [m]
FLAG = (
    f'[[signals.base.contacts]]\nframe = "fore_foot"\ntouching = "fore_load"\nthreshold = 2.0\n'
    f"position = {list(TOE)}\n"
)
HAND = '[[signals.base.contacts]]\nframe = "handle"\nforce = "hand_f{}"\nmoment = "hand_m{}"\n'


def dog(folder: Path, base: str, more: str = "") -> Path:
    """The robot file, with tables of the base."""
    (folder / "dog.xml").write_text(DOG)
    listed = ", ".join(f'"{name}"' for name in JOINTS)
    path = folder / "dog.toml"
    path.write_text(
        f"""[robot]
mjcf = "dog.xml"
base = "floating"
joints = [{listed}]
{more}
[signals]
time = "t"
position = "q_{{joint}}"
[signals.effort]
columns = "tau_{{joint}}"
kind = "joint_torque"
unit = "Nm"
{base}"""
    )
    return path


def waves(t: Array, seed: int, count: int, size: float) -> Array:
    """Sums of sines up to 1.3 Hz, and two derivatives, `(3, N, count)`."""
    rng = np.random.default_rng(seed)
    w = 2.0 * np.pi * rng.uniform(0.2, 1.3, (4, count))
    a, phase = rng.uniform(-1.0, 1.0, (4, count)) * size, rng.uniform(0.0, 6.0, (4, count))
    x = w * t[:, None, None] + phase
    return np.stack(
        [(a * np.sin(x)).sum(1), (a * w * np.cos(x)).sum(1), (-a * w**2 * np.sin(x)).sum(1)]
    )


def axes_at(t: Array, seed: int) -> Array:
    """Axes of the base link in the world, `(N, 3, 3)`."""
    angles = waves(t, seed + 100, 3, 0.15)[0]
    return np.array(
        [turn([0.0, 0.0, 1.0], 0.5 * x) @ rpy_rotation(*a) for x, a in zip(t, angles, strict=True)]
    )


def spun(t: Array, seed: int) -> tuple[Array, Array]:
    """Angular velocity and acceleration along the base's axes `(N, 3)`, by differences."""
    h = 1e-4

    def rate(at: Array) -> Array:
        change = (axes_at(at + h, seed) - axes_at(at - h, seed)) / (2.0 * h)
        s = axes_at(at, seed).transpose(0, 2, 1) @ change
        return np.column_stack([s[:, 2, 1], s[:, 0, 2], s[:, 1, 0]])

    return rate(t), (rate(t + 1e-3) - rate(t - 1e-3)) / 2e-3


def quaternion(axes: Array) -> Array:
    """Of axes `(N, 3, 3)`, `w, x, y, z`, `(N, 4)`, of either sign."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_matrix(axes).as_quat()[:, [3, 0, 1, 2]]


def columns_of(names: str, values: Array, parts: str = "xyz") -> Mapping[str, Array]:
    """Columns of values `(N, k)`."""
    return {names.format(p): values[:, k] for k, p in enumerate(parts)}


def record(
    folder: Path,
    name: str = "log",
    seed: int = 0,
    seconds: float = 20.0,
    noise: float = 0.0,
    push: float = 0.0,
) -> tuple[Path, Motion]:
    """A log of the dog, in a hand's grip that makes its base move so; and the true motion.

    A `push` is the size of a force on the toe of its fore foot, half of the time [N].
    """
    robot = load_robot(dog(folder, IMU)).robot
    model = Model(robot, (RigidBody(),)).prior
    assert model is not None
    t = np.arange(0.0, seconds, 0.004)
    q, dq, ddq = waves(t, seed, len(JOINTS), 0.3)
    _, velocity, acceleration = waves(t, seed + 50, 3, 0.05)
    place = waves(t, seed + 50, 3, 0.05)[0]
    axes, (omega, alpha) = axes_at(t, seed), spun(t, seed)
    proper = np.einsum("nji,nj->ni", axes, acceleration - robot.gravity)
    motion = Motion.floating(
        t, q, dq, ddq, proper_acceleration=proper, angular_velocity=omega,
        angular_acceleration=alpha, velocity=np.einsum("nji,nj->ni", axes, velocity),
    )  # fmt: skip
    torque, jacobian = model.torque(motion), model.jacobian(motion.q, "handle")
    at, turned = model.pose(motion.q, "handle")
    pushed = push * (np.sin(1.3 * t) > 0.0)[:, None] * (1.0 + waves(t, seed + 9, 3, 0.5)[0])
    foot_axes, foot = model.pose(motion.q, "fore_foot")[1], model.jacobian(motion.q, "fore_foot")
    toe = np.cross(foot[:, 3:], (foot_axes @ np.array(TOE))[:, :, None], axis=1) + foot[:, :3]
    torque = torque - np.einsum("nij,ni->nj", toe, pushed)
    along = np.linalg.solve(jacobian[:, :, :6].transpose(0, 2, 1), torque[:, :6, None])
    efforts = torque - (jacobian.transpose(0, 2, 1) @ along)[..., 0]
    hand = along[..., 0].reshape(-1, 2, 3)
    of_frame = np.einsum("nji,nkj->nki", turned, hand)
    in_world = np.einsum("nij,nkj->nki", axes, hand)
    sensor = {frame.name: frame for frame in robot.frames}["imu"]
    swing = np.cross(omega, sensor.position)
    felt = proper + np.cross(alpha, sensor.position) + np.cross(omega, swing)
    marker = axes @ sensor.rotation
    rng = np.random.default_rng(seed)
    frame = {"t": t, "fore_load": np.linalg.norm(pushed, axis=1)}
    frame |= {f"q_{name}": q[:, j] for j, name in enumerate(JOINTS)}
    frame |= {
        f"tau_{name}": efforts[:, 6 + j] + noise * rng.normal(size=len(t))
        for j, name in enumerate(JOINTS)
    }
    frame |= columns_of("acc_{}", (felt @ sensor.rotation) + noise * rng.normal(size=felt.shape))
    frame |= columns_of("gyro_{}", omega @ sensor.rotation)
    frame |= columns_of("marker_{}", place + (axes @ sensor.position))
    frame |= columns_of("marker_q{}", quaternion(marker), "wxyz")
    frame |= columns_of("q{}", quaternion(axes), "wxyz")
    for what, values in (("hand", of_frame), ("world", in_world)):
        frame |= columns_of(what + "_f{}", values[:, 0] + noise * rng.normal(size=(len(t), 3)))
        frame |= columns_of(what + "_m{}", values[:, 1])
    path = folder / f"{name}.parquet"
    pl.DataFrame(frame).write_parquet(path)
    return path, motion
