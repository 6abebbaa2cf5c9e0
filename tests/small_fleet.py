"""A small fleet: an arm of two joints, five robots over eight days, with two faults."""

from pathlib import Path

import numpy as np
import polars as pl

import steelyard
from steelyard.base.arrays import Array, Parameters
from steelyard.robot.inertia_and_placement import INERTIAL_NAMES

ROBOTS, DAYS, RATE, SECONDS = 5, 8, 100.0, 25.0
EPOCH = 1.8e9
MEANS = {"coulomb": (1.2, 0.8), "viscous": (0.8, 0.6), "offset": (0.1, -0.1)}
ROBOT_FILE = """[robot]
urdf = "arm.urdf"
[signals]
time = "t"
position = "q{}"
velocity = "dq{}"
[signals.effort]
columns = "tau{}"
kind = "joint_torque"
unit = "Nm"
[model]
terms = ["rigid_body", "coulomb", "viscous", "offset"]
"""


def log(
    robot: int,
    day: int,
    *,
    friction: float = 1.0,
    gain: float = 1.0,
    mass: float = 0.0,
    motion: tuple[float, float] = (1.0, 1.0),
) -> dict[str, Array]:
    """A day's log by column; friction of joint 2 and gain of joint 1 may be others."""
    model, rng = steelyard.model_of("arm.toml"), np.random.default_rng([robot, day])
    own = np.random.default_rng(robot)
    values = {
        f"{kind}.{body.name}": value
        for body, ten in zip(model.robot.bodies, model.robot.nominal, strict=True)
        for kind, value in zip(INERTIAL_NAMES, ten, strict=True)
    }
    last = model.robot.bodies[-1].name
    values[f"m.{last}"] += mass
    values[f"mx.{last}"] += 0.3 * mass
    values[f"Iyy.{last}"] += 0.09 * mass
    values[f"Izz.{last}"] += 0.09 * mass
    for kind, means in MEANS.items():
        for joint, mean in zip(model.robot.joint_names, means, strict=True):
            apart = np.exp(0.1 * own.normal() + 0.02 * rng.normal())
            values[f"{kind}.{joint}"] = mean * apart
    values["coulomb.joint2"] *= friction
    t = np.arange(0.0, SECONDS, 1.0 / RATE)
    w = 2.0 * np.pi * np.array([[0.12, 0.31, 0.52], [0.17, 0.26, 0.61]])
    size, phase = np.outer(motion, [0.7, 0.3, 0.12]), rng.uniform(0.0, 6.28, (2, 3))
    a = w[:, :, None] * t + phase[:, :, None]
    q = (size[:, :, None] * np.sin(a)).sum(axis=1)
    dq = (size[:, :, None] * w[:, :, None] * np.cos(a)).sum(axis=1)
    ddq = -(size[:, :, None] * w[:, :, None] ** 2 * np.sin(a)).sum(axis=1)
    named = Parameters(
        model.names, model.units, np.array([values.get(name, 0.0) for name in model.names])
    )
    motion_of = steelyard.Motion(t, q.T, dq.T, ddq.T)
    tau = np.asarray(model.at(named).torque(motion_of)).T
    tau[0] /= gain
    found = {"t": EPOCH + 86400.0 * day + t, "temp": np.full(len(t), 20.0 + day)}
    for name, x, std in (("q", q, 1e-5), ("dq", dq, 1e-3), ("tau", tau, 0.05)):
        noisy = x + std * rng.normal(size=x.shape)
        found |= {f"{name}{j + 1}": noisy[j] for j in range(2)}
    return found


def place_of(folder: Path, robot: int, day: int) -> Path:
    return folder / "logs" / f"r{robot}" / f"2026-03-{day + 1:02d}.parquet"


def write(path: Path, table: dict[str, Array]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    pl.DataFrame(table).write_parquet(path)


def write_all(folder: Path, days: range) -> None:
    """Logs of all robots; joint 2 of robot 3 has twice its friction from day 5, robot 1 carries
    0.5 kg from day 4, and the gain of joint 1 of robot 4 is 5 % lower from day 3."""
    for robot in range(ROBOTS):
        for day in days:
            table = log(
                robot,
                day,
                friction=2.0 if robot == 3 and day >= 5 else 1.0,
                mass=0.5 if robot == 1 and day >= 4 else 0.0,
                gain=0.95 if robot == 4 and day >= 3 else 1.0,
            )
            write(place_of(folder, robot, day), table)
