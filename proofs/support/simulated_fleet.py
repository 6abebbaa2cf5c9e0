"""Fleets of simulated robots: a Panda's bodies by Pinocchio, friction of each robot's own.

Every robot has its own friction and offsets (10 % apart), which scatter from day to day (2 %) and
fall with temperature (0.8 % a kelvin). Days are logs of a minute at 100 Hz of one of a few motions,
with epoch time, noise of sensors, and a column of temperature. Faults begin on a day: friction of a
joint is multiplied, a gain drops (the logged effort rises), a body is left on the last link.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import numpy as np
import pinocchio as pin
import polars as pl
from proofs.support.claims import data_folder

from steelyard.base.arrays import Array

RATE, SECONDS, MOTIONS = 100.0, 60.0, 6
EPOCH = 1.78e9  # of day 0 [s]
COULOMB, VISCOUS = (1.5, 1.8, 1.2, 1.5, 0.9, 0.8, 0.7), (2.0, 2.5, 1.6, 1.8, 1.0, 0.9, 0.8)
LINKS_OFF, CENTRES_OFF = 0.2, 0.01
ROBOTS_APART, DAYS_APART, PER_KELVIN = 0.10, 0.02, -0.008
NOISE = (2e-5, 2e-3, 0.25)  # standard deviations of positions, velocities, efforts

ROBOT_FILE = """[robot]
urdf = "{urdf}"
[signals]
time = "t"
position = "q{{}}"
velocity = "dq{{}}"
[signals.effort]
columns = "tau{{}}"
kind = "joint_torque"
unit = "Nm"
[model]
terms = ["rigid_body", "coulomb", "viscous", "offset"]
"""


@dataclass(frozen=True)
class Fault:
    """From a day on: a factor on dry friction of a joint, one on its gain, or a mass [kg]."""

    day: int
    joint: int = 0
    friction: float = 1.0
    gain: float = 1.0
    mass: float = 0.0


@dataclass(frozen=True)
class Fleet:
    """Robots, days, faults by robot, and the swing of temperature [K]."""

    robots: int
    days: int
    faults: Mapping[int, Fault] = field(default_factory=dict)
    swing: float = 10.0
    seed: int = 0


def urdf() -> Path:
    return data_folder() / "panda" / "panda_arm.urdf"


@cache
def bodies() -> pin.Model:
    """The Panda, its links not those of the URDF: masses 20 % off, centres of mass 1 cm."""
    model, rng = pin.buildModelFromUrdf(str(urdf())), np.random.default_rng(3)
    for k in range(1, model.njoints):
        own, factor = model.inertias[k], float(np.exp(LINKS_OFF * rng.normal()))
        centre = own.lever + CENTRES_OFF * rng.normal(size=3)
        model.inertias[k] = pin.Inertia(factor * own.mass, centre, factor * own.inertia)
    return model


def true_bodies() -> dict[str, float]:
    """The ten numbers of every link by the names of parameters; links are called by joints."""
    kinds = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
    model, found = bodies(), dict[str, float]()
    for k in range(1, model.njoints):
        values = model.inertias[k].toDynamicParameters()
        link = model.names[k].replace("joint", "link")
        found |= {f"{kind}.{link}": float(x) for kind, x in zip(kinds, values, strict=True)}
    return found


@cache
def motion(number: int) -> tuple[Array, Array, Array, Array]:
    """Time, positions, velocities and accelerations of one motion, `(N,)` and `(N, 7)`."""
    rng = np.random.default_rng(70 + number)
    t, n = np.arange(0.0, SECONDS, 1.0 / RATE), 7
    middle = np.array([0.0, 0.0, 0.0, -1.6, 0.0, 1.8, 0.0])
    w = 2.0 * np.pi * rng.integers(2, 28, (n, 5)) / SECONDS
    size = rng.uniform(0.4, 1.0, (n, 5)) * np.array([1.2, 0.8, 1.2, 0.7, 1.2, 0.8, 1.2])[:, None]
    size /= 1.0 + 2.0 * w
    phase = rng.uniform(0.0, 2.0 * np.pi, (n, 5))
    a = w[:, :, None] * t + phase[:, :, None]
    q = middle[:, None] + (size[:, :, None] * np.sin(a)).sum(axis=1)
    dq = ((size * w)[:, :, None] * np.cos(a)).sum(axis=1)
    ddq = -((size * w**2)[:, :, None] * np.sin(a)).sum(axis=1)
    return t, q.T, dq.T, ddq.T


@cache
def torque(number: int, mass: float) -> Array:
    """Torque of the bodies along a motion, with a mass on the last link, `(N, 7)`."""
    model = bodies().copy()
    if mass:
        plate = pin.Inertia(mass, np.array([0.0, 0.0, 0.12]), mass * 0.002 * np.eye(3))
        model.inertias[7] = model.inertias[7] + plate
    data, (_, q, dq, ddq) = model.createData(), motion(number)
    return np.array([pin.rnea(model, data, *x) for x in zip(q, dq, ddq, strict=True)])


def temperature(fleet: Fleet, robot: int, day: int) -> float:
    """Of a robot's day [°C]: the season of a hall, and the robot's own load."""
    rng = np.random.default_rng([fleet.seed, 5, robot, day])
    season = np.sin(2.0 * np.pi * (day / 17.0 + 0.13 * (robot % 4)))
    return float(25.0 + fleet.swing * (0.8 * season + 0.2 * rng.uniform(-1.0, 1.0)))


def day_of(fleet: Fleet, robot: int, day: int) -> dict[str, Array]:
    """The log of one robot's day."""
    own = np.random.default_rng([fleet.seed, 1, robot])
    rng = np.random.default_rng([fleet.seed, 2, robot, day])
    coulomb = np.array(COULOMB) * np.exp(ROBOTS_APART * own.normal(size=7))
    viscous = np.array(VISCOUS) * np.exp(ROBOTS_APART * own.normal(size=7))
    offset = 0.15 * own.normal(size=7)
    warm = temperature(fleet, robot, day)
    both = np.exp(PER_KELVIN * (warm - 25.0))
    coulomb = coulomb * both * np.exp(DAYS_APART * rng.normal(size=7))
    viscous = viscous * both * np.exp(DAYS_APART * rng.normal(size=7))
    fault = fleet.faults.get(robot)
    mass, gain = 0.0, np.ones(7)
    if fault is not None and day >= fault.day:
        coulomb[fault.joint] *= fault.friction
        gain[fault.joint], mass = fault.gain, fault.mass
    number = int(rng.integers(MOTIONS))
    t, q, dq, _ = motion(number)
    tau = torque(number, mass) + coulomb * np.sign(dq) + viscous * dq + offset
    tau = tau / gain
    signals = (q, dq, tau)
    found = {"t": EPOCH + 86400.0 * day + 3600.0 * (robot % 8) + t}
    for name, x, size in zip(("q", "dq", "tau"), signals, NOISE, strict=True):
        noisy = x + size * rng.normal(size=x.shape)
        found |= {f"{name}{j + 1}": noisy[:, j] for j in range(7)}
    return found | {"temp": np.full(len(t), warm)}


def write(fleet: Fleet, folder: Path, days: range | None = None) -> None:
    """Robot file and logs, `robot003/2026-05-12.parquet`."""
    (folder / "arm.toml").write_text(ROBOT_FILE.format(urdf=urdf()))
    for day in range(fleet.days) if days is None else days:
        name = np.datetime64("2026-05-01") + day
        for robot in range(fleet.robots):
            place = folder / "logs" / f"robot{robot:03d}"
            place.mkdir(parents=True, exist_ok=True)
            pl.DataFrame(day_of(fleet, robot, day)).write_parquet(place / f"{name}.parquet")
