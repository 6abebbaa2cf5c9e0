"""Invented robots, drives, motions and sensors; torques of bodies are Pinocchio's.

Six families of robots with masses, friction, rotors, gears and elasticity of their own. What is
drawn is the robot as it is; model files that are off, and mistakes, come on top of it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
from proofs.support.mistakes import Log
from proofs.support.safety_robots import Arm, Link, Vector, arm_urdf

from steelyard.base.arrays import Array

Random = np.random.Generator
FAMILIES = {
    "6R": """8  Rz 0 0 .18 3.1 2; Ry 0 .17 0 2.5 2; Ry 0 -.13 .61 2.6 2.5; Ry 0 0 .57 3 3;
        Rz 0 .12 0 3 3; Ry 0 0 .12 3 3""",
    "SCARA": "6  Rz 0 0 .4 2.3 4; Rz .3 0 .05 2.5 6; Pz .25 0 0 .12 .8; Rz 0 0 -.1 3.1 9",
    "gantry": """30  Px 0 0 1 .8 1.2; Py .1 0 .1 .5 1.2; Pz 0 .1 0 .3 .8; Rz 0 0 -.3 3.1 3;
        Ry 0 0 -.15 1.9 3""",
    "7R": """4  Rz 0 0 .33 2.9 1.7; Ry 0 0 0 1.9 1.7; Rz 0 0 .32 2.9 1.7; Ry .08 0 0 2 1.7;
        Rz -.08 0 .38 2.9 2.3; Ry 0 0 0 2 2.3; Rz .09 0 .1 2.9 2.3""",
    "heavy": """300  Rz 0 0 .5 3 1.6; Ry .35 0 .25 1.2 1.5; Ry 0 0 1.1 1.5 1.6; Rx .3 0 .15 3.1 2.5;
        Ry .9 0 0 2 2.5; Rx .2 0 0 3.1 3.5""",
    "low-cost": """.25  Rz 0 0 .08 2.6 3; Ry 0 0 .03 1.8 3; Ry .02 0 .15 1.8 3; Ry .14 0 0 1.8 4;
        Rx .07 0 0 2.6 4""",
}
"""Mass of the first link [kg]; of each joint its kind and axis, its place in the link before [m],
its greatest position either way [rad; m] and its greatest speed [rad/s; m/s]."""
DOWN = np.array([0.0, 0.0, -9.81])
MOST_SPEED = 1.875  # of a quintic move, over its mean speed


@dataclass(frozen=True, eq=False)
class Plant:
    """A robot as it is; arrays have one entry per joint, but for gravity and push."""

    family: str
    arm: Arm  # its bodies and joints
    ratios: Array  # turns of the motor per turn of the joint
    motors: bool  # whether positions are logged at the motors' side of the gears too
    rotor: Array  # inertia of rotors, at the joint [kg m²; kg]
    coulomb: Array  # friction [Nm; N]
    viscous: Array  # friction [Nm s/rad; N s/m]
    law: str  # `plain`, or one that the robot file lacks: `stribeck`, `load`, `hysteresis`
    presliding: Array  # length of hysteresis [rad; m]
    compliance: Array  # of gears; encoders are before them [rad/Nm; m/N]
    compensates: str  # what the drive leaves out of its efforts: nothing, `friction` or `gravity`
    gravity: Array  # in the base frame [m/s²]
    push: Array  # passing force at the last link in its frame, over its share of time [N]

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.arm.links)

    @property
    def turning(self) -> Array:
        """Which joints are revolute, shape `(n,)`."""
        return np.array([link.kind == "revolute" for link in self.arm.links])

    def of_joints(self, key: str) -> Array:
        """A number of each joint, such as `velocity`."""
        return np.array([getattr(link, key) for link in self.arm.links])


def drawn_plant(rng: Random) -> Plant:
    """A robot of any family."""
    family = str(rng.choice(list(FAMILIES)))
    arm = _arm(rng, family)
    n, one = len(arm.links), np.zeros(len(arm.links))
    plant = Plant(family, arm, one + 1.0, False, one, one, one, "", one, one, "", DOWN, np.zeros(3))
    _, q, dq, ddq = drawn_motion(rng, plant, 10.0, 50.0, moves=False)
    bodies = body_torque(arm, DOWN, q, dq, ddq)
    size = bodies.std(axis=0) + 0.02 * np.max(bodies.std(axis=0))
    model = pin.buildModelFromXML(arm_urdf(arm))
    coulomb, most = rng.uniform(0.03, 0.5, n) * size, np.abs(bodies).max(axis=0)
    return replace(
        plant,
        ratios=rng.integers(100, 301, n) * 1.0 if family == "heavy" else one + 1.0,
        motors=family == "heavy" and bool(rng.random() < 0.4),
        rotor=np.diag(pin.crba(model, model.createData(), q[0])) * rng.uniform(0.05, 1.0, n),
        coulomb=coulomb,
        viscous=rng.uniform(0.1, 1.2, n) * coulomb / plant.of_joints("velocity"),
        law=str(rng.choice(["plain"] * 3 + ["stribeck", "load", "hysteresis"])),
        presliding=np.exp(rng.uniform(np.log(2e-4), np.log(5e-3), n)),
        compliance=rng.uniform(0.3e-3, 3e-3, n) * (rng.random() < 0.3) / (size + most),
        compensates="friction" if rng.random() < 0.12 else "",
    )


def _arm(rng: Random, family: str) -> Arm:
    heaviest, joints = FAMILIES[family].split(maxsplit=1)
    size, mass = rng.uniform(0.7, 1.4), float(heaviest) * np.exp(rng.uniform(-0.5, 0.5))
    rows, links = [row.split() for row in joints.split(";")], []
    places = [size * np.array(row[1:4], dtype=float) for row in rows]
    places.append(size * np.array([0.03, 0.0, 0.05]))
    reach = sum(float(np.linalg.norm(p)) for p in places)
    for k, (kind, *_, most, fast) in enumerate(rows):
        own = float(mass * 0.68**k * np.exp(0.3 * rng.standard_normal()))
        long = max(float(np.linalg.norm(places[k + 1])), 0.08 * reach)
        com = 0.45 * places[k + 1] + 0.12 * long * rng.standard_normal(3)
        sides = (long * rng.uniform(0.2, 1.0, 3)) ** 2
        turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
        inertia = turn @ np.diag(own / 12.0 * (sides.sum() - sides)) @ turn.T
        name = "revolute" if kind[0] == "R" else "prismatic"
        axis, straight = np.eye(3)["xyz".index(kind[1])], (0.0, 0.0, 0.0)
        limits = -float(most), float(most), float(fast), 1e5
        body = own, _vector(com), _six(inertia), ()
        links.append(Link(name, _vector(places[k]), straight, _vector(axis), *limits, *body))
    return Arm((), tuple(links), _vector(places[-1]), ())


def _vector(x: Array) -> Vector:
    return float(x[0]), float(x[1]), float(x[2])


def _six(m: Array) -> tuple[float, ...]:
    return tuple(float(m[i, j]) for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))


def carrying(arm: Arm, mass: float, com: Array) -> Arm:
    """The arm with a ball at its last link."""
    last = arm.links[-1]
    xx, yy, zz, xy, xz, yz = last.moments
    own = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    both = pin.Inertia(last.mass, np.array(last.com), own)
    both += pin.Inertia(mass, com, np.eye(3) * 0.01 * mass * float(com @ com))
    link = replace(last, mass=both.mass, com=_vector(both.lever), moments=_six(both.inertia))
    return replace(arm, links=(*arm.links[:-1], link))


def body_torque(
    arm: Arm, gravity: Array, q: Array, dq: Array, ddq: Array, push: Array | None = None
) -> Array:
    """Torques of bodies, less those of a force at the last link `(N, 3)` [N], `(N, n)` [Nm; N]."""
    model = pin.buildModelFromXML(arm_urdf(arm))
    model.gravity.linear = gravity
    data = model.createData()
    found = np.array([pin.rnea(model, data, *one) for one in zip(q, dq, ddq, strict=True)])
    for k in () if push is None else np.flatnonzero(push.any(axis=1)):
        found[k] -= pin.computeJointJacobian(model, data, q[k], model.njoints - 1)[:3].T @ push[k]
    return found


def drawn_motion(
    rng: Random, plant: Plant, seconds: float, rate: float, *, moves: bool
) -> tuple[Array, Array, Array, Array]:
    """Time `(N,)`, positions, velocities, accelerations `(N, n)`: a Fourier series, or moves."""
    t = np.arange(round(seconds * rate)) / rate
    high, fast = plant.of_joints("upper"), plant.of_joints("velocity")
    if moves:
        return t, *_moves(rng, t, rng.uniform(0.4, 0.9) * high, rng.uniform(0.3, 0.9) * fast)
    w = 2.0 * np.pi / rng.uniform(8.0, 20.0) * np.arange(1, 7)
    a, b = rng.standard_normal((2, 6, len(high))) / np.arange(1, 7)[:, None] ** 0.7
    s, c = np.sin(np.outer(t, w)), np.cos(np.outer(t, w))
    q, dq, ddq = s @ a + c @ b, (c * w) @ a - (s * w) @ b, -(s * w**2) @ a - (c * w**2) @ b
    share = rng.uniform(0.25, 0.9)
    scale = share * np.minimum(high / np.abs(q).max(axis=0), fast / np.abs(dq).max(axis=0))
    return t, scale * q, scale * dq, scale * ddq


def _moves(rng: Random, t: Array, most: Array, fast: Array) -> tuple[Array, Array, Array]:
    """Quintic moves between twelve places with rests, as a robot that picks and places."""
    q, dq, ddq = np.zeros((3, len(t), len(most)))
    places = most * rng.uniform(-1.0, 1.0, (12, len(most)))
    begin, start = 0.0, places[0]
    while begin < t[-1]:
        goal = places[int(rng.integers(12))]
        way, rest = goal - start, float(rng.choice([0.0, 0.2, 0.8]))
        long = float(np.max(MOST_SPEED * np.abs(way) / fast)) + 0.05
        rows = (t >= begin) & (t < begin + long)
        x = ((t[rows] - begin) / long)[:, None]
        q[rows] = start + way * (10.0 * x**3 - 15.0 * x**4 + 6.0 * x**5)
        dq[rows] = way * (30.0 * x**2 - 60.0 * x**3 + 30.0 * x**4) / long
        ddq[rows] = way * (60.0 * x - 180.0 * x**2 + 120.0 * x**3) / long**2
        q[(t >= begin + long) & (t < begin + long + rest)] = goal
        begin, start = begin + long + rest, goal
    return q, dq, ddq


def friction(plant: Plant, t: Array, dq: Array, load: Array) -> Array:
    """Friction at joints that turn so and carry a torque, shape `(N, n)`."""
    fast = plant.of_joints("velocity")
    sign, level = np.tanh(dq / (2e-3 * fast)), np.ones_like(dq)
    if plant.law == "stribeck":
        level = 1.0 + 0.6 * np.exp(-((dq / (0.05 * fast)) ** 2))
    elif plant.law == "load":
        level = 0.6 + 0.8 * np.abs(load) / (np.abs(load).max(axis=0) + 1e-9)
    elif plant.law == "hysteresis":
        z, step = np.zeros(len(fast)), float(t[1] - t[0])
        for k, v in enumerate(dq):
            z = np.clip(z + step * (v - np.abs(v) * z) / plant.presliding, -1.0, 1.0)
            sign[k] = z
    return plant.coulomb * sign * level + plant.viscous * dq


@dataclass(frozen=True)
class Sensors:
    """What writes a log."""

    rate: float  # rows per second
    encoder: float  # steps of positions per turn, or per 0.2 m
    noise: float  # of efforts, over their standard deviation
    velocities: bool  # whether they are logged
    jitter: float  # of the clock, over its step
    lost: float  # share of rows that are lost
    coarse: int  # efforts are whole counts, at most so many; 0: they are not


def drawn_sensors(rng: Random, family: str) -> Sensors:
    """Those of a family."""
    cheap = family == "low-cost"
    return Sensors(
        float(rng.choice([50.0, 80.0, 100.0] if cheap else [100.0, 125.0, 200.0, 250.0])),
        4096.0 if cheap else 2.0 ** int(rng.integers(15, 21)),
        float(np.exp(rng.uniform(np.log(0.005), np.log(0.04)))),
        bool(rng.random() < 0.6),
        float(rng.choice([0.0, 0.02, 0.1])),
        float(rng.choice([0.0, 0.0, 0.003])),
        int(rng.integers(100, 400)) if cheap else 0,
    )


def logged(
    plant: Plant, sensors: Sensors, motion: Sequence[Array], largest: Array | None, rng: Random
) -> Log:
    """What is measured of a robot along a motion, at the joints; largest counts are as given."""
    t, q, dq, ddq = motion
    start, long = rng.uniform(0.2, 0.7) * t[-1], rng.uniform(0.8, 2.5)
    share = np.clip((t - start) / long, 0.0, 1.0)[:, None]
    bodies = body_torque(plant.arm, plant.gravity, q, dq, ddq, share * (1.0 - share) * plant.push)
    bend = plant.compliance * bodies
    turned, speed = q + bend, dq + np.gradient(bend, t, axis=0)
    tau = bodies + plant.rotor * np.gradient(speed, t, axis=0)
    if plant.compensates != "friction":
        tau = tau + friction(plant, t, speed, bodies)
    if plant.compensates == "gravity":
        tau = tau - body_torque(plant.arm, plant.gravity, q, 0.0 * q, 0.0 * q)
    tau = tau + sensors.noise * tau.std(axis=0) * rng.standard_normal(tau.shape)
    if sensors.coarse:
        count = (np.abs(tau).max(axis=0) if largest is None else largest) / sensors.coarse
        tau = count * np.round(tau / count)
    step = np.where(plant.turning, 2.0 * np.pi, 0.2) / sensors.encoder
    measured = speed + 1e-3 * np.abs(dq).max(axis=0) * rng.standard_normal(dq.shape)
    stamps = t + sensors.jitter / sensors.rate * rng.uniform(-0.5, 0.5, len(t))
    dq_logged = measured if sensors.velocities else None
    whole = Log(stamps, step * np.round(turned / step), tau, dq_logged)
    return whole.rows(rng.random(len(t)) >= sensors.lost)
