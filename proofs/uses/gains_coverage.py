"""What 95 % intervals of drive gains hold: simulated arms with other masses, friction and gains.

Each of the robots (60, or as many as the argument says) runs one motion without and another one
with a payload of known mass, on which its friction is another one. Disturbances take turns. What
a payload does not fix, a known gain of one joint does: a gain is then covered or called assumed.
`python -m proofs.uses.gains_coverage 200`.
"""

import sys
from functools import cache

import numpy as np
from proofs.support.claims import Claim, main_of
from proofs.support.coverage_cases import NOISE, ROWS, Row, noise, robot_file

from steelyard.base.arrays import Array
from steelyard.estimate.friction.friction_mixes_and_curves import with_any_speed
from steelyard.estimate.information.base_parameters_and_regressor import Regressor, base_regressor
from steelyard.estimate.information.filter_and_gram import Accumulator, Stretch
from steelyard.estimate.information.information import Information, Signature, Window
from steelyard.estimate.payload.drive_gains import GainEstimate, identified_gains
from steelyard.excite.trajectories.fourier import random_fourier
from steelyard.model.model import model_with_open_friction
from steelyard.robot.inertia_and_placement import INERTIAL_NAMES, Inertia
from steelyard.simulate.ground_truth import Truth, random_truth
from steelyard.simulate.mujoco_model import build
from steelyard.simulate.virtual_robot import typical_torque

RATE, PERIODS, HARMONICS = 50.0, 2, 5  # samples per second, periods of 10 s
WINDOW = 2.5  # length of a window of time [s]
GAINS, MASSES, DRIFT = (5.0, 15.0), (1.0, 4.0), (0.8, 1.25)  # [Nm/A], [kg], of friction
CHOSEN = ("white noise", "noise correlated over 0.5 s", "Stribeck friction outside the model")
BAND = (93.0, 97.0)  # share of all gains that are in their intervals [%]
KNOWN = 1  # the joint whose gain is known where no payload is


@cache
def regressor() -> Regressor:
    """Of what is fitted, friction any function of speed as `identify` does it."""
    return base_regressor(with_any_speed(model_with_open_friction(robot_file())))


def said(truth: Truth, row: Row, gains: Array, seed: int) -> Information:
    """What a run of one robot says, efforts in amperes."""
    robot, rng = robot_file().robot, np.random.default_rng(seed)
    motion = random_fourier(robot, seed=seed, period=10.0, periods=PERIODS, harmonics=HARMONICS)
    t = np.arange(0.0, motion.duration, 1.0 / RATE)
    along = motion.sample(t)
    scale = typical_torque(robot, build(robot, truth.inertial, truth.rotors))
    torque = truth.model.at(truth.values).torque(along)
    torque = torque + NOISE * scale * noise(rng, torque.shape, row)
    signals = (along.q.T, along.dq.T, along.ddq.T, (torque / gains).T)
    size = round(WINDOW * RATE)
    windows = [slice(k, k + size) for k in range(0, len(t) - size + 1, size)]
    sums = [Accumulator(regressor())(Stretch(*(x[:, at] for x in signals))) for at in windows]
    return Information(
        regressor().layout,
        Signature(
            regressor().model.fingerprint, regressor().layout.columns, ("A",) * robot.n, "none"
        ),
        tuple(Window(f"run{seed}", t[at][0], t[at][-1]) for at in windows),
        np.array([one.grams for one in sums]),
        np.array([one.absolute for one in sums]),
        np.array([one.counts for one in sums]),
    )


def drawn(row: Row, seed: int) -> tuple[Array, float, Information, Information]:
    """Gains of one robot, the payload's mass, what its runs without and with payload say."""
    robot, rng = robot_file().robot, np.random.default_rng(seed)
    gains, mass = rng.uniform(*GAINS, robot.n), float(rng.uniform(*MASSES))
    truth = random_truth(robot, seed, terms=row.terms)
    load = Inertia.about_com(mass, rng.normal((0.0, 0.0, 0.1), 0.05), 2e-3 * mass * np.eye(3))
    names = [f"{name}.{robot.bodies[-1].name}" for name in INERTIAL_NAMES]
    carrying = Inertia.from_ten([truth.values[name] for name in names]) + load
    other = truth.changed(**dict(zip(names, carrying.ten.tolist(), strict=True)))
    other = other.drifted(float(rng.uniform(*DRIFT)))
    first, second = (said(x, row, gains, 2 * seed + k) for k, x in enumerate((truth, other)))
    return gains, mass, first, second


def inside(found: GainEstimate, gains: Array) -> tuple[int, int]:
    """How many of the gains that were found are in their intervals, and of how many."""
    open_ = ~np.array(found.known) & ~np.array(found.assumed)
    held = np.abs(found.gains - gains) <= found.half_width
    return int(held[open_].sum()), int(open_.sum())


def main(robots: int = 60) -> list[Claim]:
    """Shares of the gains in their intervals, with a payload and with one known gain."""
    rows = [row for row in ROWS if row.name in CHOSEN]
    counts = np.zeros((2, len(rows), 2), dtype=int)
    model = regressor().model
    for seed in range(robots):
        kind = seed % len(rows)
        gains, mass, first, second = drawn(rows[kind], seed)
        known = {model.robot.joint_names[KNOWN]: float(gains[KNOWN])}
        counts[0, kind] += inside(identified_gains(model, [first], [second], mass=mass), gains)
        counts[1, kind] += inside(identified_gains(model, [first], known=known), gains)
    claims = []
    for name, mine in zip(("with a payload", "one gain known"), counts, strict=True):
        held, every = mine.sum(axis=0)
        share = 100.0 * held / every
        each = ", ".join(
            f"{row.name} {100.0 * a / b:.1f} %" for row, (a, b) in zip(rows, mine, strict=True)
        )
        figure = f"{share:.1f} % of {every} ({each})"
        bound = f"{BAND[0]:g} to {BAND[1]:g} %"
        claims.append(
            Claim(
                f"gains in their intervals, {name}, {robots} robots",
                figure,
                bound,
                BAND[0] <= share <= BAND[1],
            )
        )
    return claims


if __name__ == "__main__":
    main_of(lambda: main(*map(int, sys.argv[1:2])))
