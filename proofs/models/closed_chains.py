"""Closed chains: p5's parallelogram, a general five-bar against MuJoCo, and its identification.

The parallelogram's regressor is compared with equation 13 of Wang et al. (p5) with its three
inertial parameters; the paper puts every centre of mass on its bar. The general five-bar has
unequal bars, centres of mass anywhere and gravity in its plane; MuJoCo closes it by a `connect`
constraint. It is simulated in MuJoCo, logged with noise, and identified from that log.
"""

import sys
import time
from pathlib import Path

import numpy as np
from proofs.support.claims import Claim, main_of

from steelyard.base.arrays import Array
from steelyard.estimate.information.base_parameters_and_regressor import (
    base_regressor,
    full_regressor,
    standard_regressor,
)
from steelyard.estimate.information.gather import gather
from steelyard.estimate.least_squares.weighted_robust_and_whitened import WeightedLeastSquares
from steelyard.excite.trajectories.fourier import random_fourier
from steelyard.model.equations.passive_joints import Follower
from steelyard.model.laws.friction_over_speed import Coulomb, Viscous
from steelyard.model.laws.laws_without_friction import Offset, RigidBody, RotorInertia
from steelyard.model.model import Model
from steelyard.robot.file.signals import Signals
from steelyard.robot.inertia_and_placement import Inertia
from steelyard.robot.robot import Limits, Robot
from steelyard.runs.prepare import prepare
from steelyard.runs.recording import LogInMemory, Recording
from steelyard.simulate.drives_sensors_and_loads import Reading, Sensors
from steelyard.simulate.ground_truth import random_truth
from steelyard.simulate.mujoco_model import build
from steelyard.simulate.typical_torques_and_masses import typical_torque
from steelyard.simulate.virtual_robot import VirtualRobot

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))
from closed_chains import Oracle, five_bar, parallelogram  # noqa: E402

TIMED = True  # nothing else may run beside it

L1, L2 = 0.25, 0.35
TORQUE_NOISE = 0.02
"""White torque noise over the typical torque of each joint."""

TRUTHS, DRAWS = 2, 20
"""Invented robots, and draws of the noise on the run of each."""

ENCODER = 2.0 * np.pi / 2**20
TERMS = (RigidBody(), RotorInertia(), Coulomb(smoothing=0.02), Viscous(), Offset())


def paper_bars() -> tuple[Inertia, Inertia, Inertia, Inertia]:
    """Bars with their centres of mass on the line between their hinges."""
    numbers = ((1.1, 0.10, 0.008), (0.9, 0.16, 0.011), (0.7, 0.13, 0.006), (0.8, 0.21, 0.009))
    one, two, three, four = (
        Inertia.about_com(mass, (com, 0.0, 0.0), np.diag([1e-4, about, about]))
        for mass, com, about in numbers
    )
    return one, two, three, four


def paper_regressor(q: Array, dq: Array, ddq: Array) -> Array:
    """The inertial part of equation 13, shape `(2, N, 3)`, of motions `(2, N)`."""
    apart = q[1] - q[0]
    result = np.zeros((2, q.shape[1], 3))
    result[0, :, 0] = ddq[0]
    result[0, :, 1] = ddq[1] * np.cos(apart) - dq[1] ** 2 * np.sin(apart)
    result[1, :, 1] = ddq[0] * np.cos(apart) + dq[0] ** 2 * np.sin(apart)
    result[1, :, 2] = ddq[1]
    return result


def paper_parameters(names: tuple[str, ...]) -> Array:
    """The paper's three inertial parameters as rows over the standard ones, shape `(3, p)`."""
    groups = (
        {"Izz.link1": 1.0, "Izz.link3": 1.0, "m.link4": L1**2},
        {"mx.link3": L2, "mx.link4": L1},
        {"Izz.link2": 1.0, "m.link3": L2**2, "Izz.link4": 1.0},
    )
    return np.array([[group.get(name, 0.0) for name in names] for group in groups])


def parallelogram_claims() -> list[Claim]:
    """Our regressor against the paper's, over states all around."""
    model = Model(parallelogram(paper_bars(), L1, L2), (RigidBody(),))
    rng = np.random.default_rng(0)
    q = np.stack([rng.uniform(-1.0, 1.0, 500), rng.uniform(0.6, 2.5, 500)])
    q[1] += q[0]
    dq, ddq = 2.0 * rng.normal(size=(2, 2, 500))
    ours = standard_regressor(model).dense(q, dq, ddq)
    straight = [k for k, name in enumerate(model.names) if not name.startswith("my.")]
    wanted = paper_regressor(q, dq, ddq) @ paper_parameters(model.names)
    error = float(np.abs(ours - wanted)[:, :, straight].max())
    regressor = full_regressor(model)
    counts = [
        int(np.linalg.matrix_rank(x, 1e-9 * float(np.linalg.norm(x, 2))))
        for x in (regressor[:, straight], regressor)
    ]
    return [
        Claim("parallelogram: regressor is p5's eq 13", f"{error:.1e}", "<= 1e-12", error <= 1e-12),
        Claim(
            "parallelogram: base parameters, centres on the bars",
            f"{counts[0]}",
            "3, as in p5",
            counts[0] == 3,
        ),
        Claim(
            "parallelogram: base parameters, centres anywhere",
            f"{counts[1]}",
            "4: cos and sin of q2 - q1",
            counts[1] == 4,
        ),
    ]


def robot() -> Robot:
    """The general five-bar, with ranges in which its loop closes."""
    made = five_bar()
    ranges = ((1.9, 2.9), (0.1, 1.1))
    return made.changed(
        coordinates=tuple(
            type(c)(c.name, c.kind, Limits(*limits, 4.0, 60.0))
            for c, limits in zip(made.coordinates, ranges, strict=True)
        )
    )


def mujoco_claims() -> list[Claim]:
    """Inverse dynamics of the general five-bar, and how fast its passive joints are found."""
    five = robot()
    oracle, model = Oracle(five), Model(five, (RigidBody(),))
    rng = np.random.default_rng(1)
    q = np.array([rng.uniform(c.limits.lower, c.limits.upper, 200) for c in five.coordinates])
    dq, ddq = 3.0 * rng.normal(size=(2, 2, 200))
    passive, closed = Follower(five)(q)
    code = model.torque_code([q, dq, ddq, passive, five.nominal.ravel()])
    wanted = np.array(
        [
            oracle.torque(np.concatenate([q[:, k], passive[:, k]]), dq[:, k], ddq[:, k])[0]
            for k in range(200)
        ]
    ).T
    error = float(np.abs(code - wanted).max() / np.abs(wanted).max())
    t = np.linspace(0.0, 20.0, 20000)
    path = np.stack([2.4 + 0.4 * np.sin(2.0 * t), 0.6 + 0.4 * np.sin(3.0 * t)])
    start = time.perf_counter()
    good = bool(Follower(five)(path)[1].all() and closed.all())
    took = time.perf_counter() - start
    return [
        Claim("five-bar: torque is MuJoCo's", f"{error:.1e}", "<= 1e-06", error <= 1e-6),
        Claim("five-bar: 20 000 samples closed", f"{took:.2f} s", "<= 2 s", good and took <= 2.0),
    ]


def recording_of(reading: Reading, name: str) -> Recording:
    """A log in memory."""
    names, ones = ("t", "q1", "q2", "tau1", "tau2"), np.ones(2)
    signals = Signals(
        time="t",
        time_scale=1.0,
        position=names[1:3],
        position_scale=ones,
        velocity=None,
        velocity_scale=None,
        effort=names[3:],
        effort_scale=ones,
        effort_kind="joint_torque",
        effort_units=("Nm", "Nm"),
        gains=ones,
    )
    table = np.column_stack([reading.t, reading.q, reading.effort])
    return Recording(LogInMemory(Path(name), names, table), signals)


def identification_claims() -> list[Claim]:
    """Do the stated intervals hold the truth of a five-bar that MuJoCo moved?"""
    five = robot()
    regressor = base_regressor(Model(five, TERMS))
    base, inside, total, errors = regressor.base, 0, 0, []
    for seed in range(TRUTHS):
        truth = random_truth(five, seed, terms=TERMS)
        noise = TORQUE_NOISE * typical_torque(five, build(five, truth.inertial, truth.rotors))
        sensors = Sensors(torque_noise=noise, resolution=ENCODER)
        motion = random_fourier(five, seed=seed, period=10.0, periods=2)
        happened = VirtualRobot(five, truth, sensors).follow(motion)
        true = dict(zip(base.base_names, base.base_values(truth.values.values), strict=True))
        for draw in range(DRAWS):
            reading = sensors.measure(happened, np.random.default_rng(100 * seed + draw))
            run = prepare(recording_of(reading, f"truth {seed}, draw {draw}"))
            estimate = WeightedLeastSquares()(gather(regressor, run))
            wanted = np.array([true[name] for name in estimate.parameters.names])
            error = np.abs(estimate.parameters.values - wanted)
            inside, total = inside + int(np.sum(error <= estimate.half_width)), total + len(error)
            errors.append(error / np.maximum(np.abs(wanted), 0.02))
    share, typical = 100.0 * inside / total, 100.0 * float(np.median(errors))
    return [
        Claim(
            f"five-bar in MuJoCo: 95 % intervals hold, {total} pairs",
            f"{share:.1f} %",
            ">= 90 %",
            share >= 90.0,
        ),
        Claim("five-bar in MuJoCo: typical error", f"{typical:.2f} %", "reported", True),
    ]


def main() -> list[Claim]:
    """All of them."""
    return [*parallelogram_claims(), *mujoco_claims(), *identification_claims()]


if __name__ == "__main__":
    main_of(main)
