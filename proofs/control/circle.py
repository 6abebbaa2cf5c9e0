"""Computed torque on the circle of [WangC], eq. 29, on its five-bar arm.

The arm, its friction and its minimum-jerk reaches are those of `proofs/estimation/parallel_arm.py`.
Eleven parameters are identified from reaches to targets 1 to 4, with the paper's torque noise.
The tip then follows a circle of 0.2 m radius in 7.2 s, Kp 100 and Kv 5, at 1 kHz, with encoders of
20 bits; ramps before and behind the lap that counts bring it up to speed and to rest. Joint PD
control has the same gains times the mean inertia of each joint. The paper shows pictures and no
number. Its printed parameters (tables II to IV) are those of no body: the law refuses them.
"""

import numpy as np
from proofs.estimation.parallel_arm import (
    CENTRE,
    FRICTION,
    L2,
    MODELS,
    RADIUS,
    TIP,
    Log,
    arm,
)
from proofs.support.claims import Claim, main_of

from steelyard.arrays import Array
from steelyard.control.computed_torque import ComputedTorque, refuse_indefinite
from steelyard.control.pd import PD
from steelyard.control.protocol import Control
from steelyard.errors import ModelError
from steelyard.estimation.least_squares.least_squares import OrdinaryLeastSquares
from steelyard.excitation.limits import motion_limits
from steelyard.excitation.planned.along_path import along_path
from steelyard.excitation.planned.tool_paths import Circle
from steelyard.excitation.trajectories.exact import ExactTrajectory
from steelyard.model import Model, ValuedModel
from steelyard.parameters import Parameters
from steelyard.regression.regressor import base_regressor
from steelyard.robot.robot import Coordinate, Limits
from steelyard.virtual.drives import Drives
from steelyard.virtual.tracking import TrackedRun, tracking
from steelyard.virtual.truth import Truth

PERIOD, KP, KV = 7.2, 100.0, 5.0
PRINTED = {
    "table II": (0.0593, 0.1609, 0.2380),
    "table III": (0.0744, 0.1843, 0.2390),
    "table IV": (0.0776, 0.1843, 0.2297),
}
"""Their inertial parameters [kg m²]."""


def circle() -> ExactTrajectory:
    """The circle: a lap at constant speed after one turn of two ramps, half before, half behind."""
    path = Circle(
        centre=np.array([0.0, CENTRE, 0.0]),
        radius=RADIUS,
        period=PERIOD,
        laps=2,
        ramp=PERIOD,
        normal=np.array([0.0, 0.0, 1.0]),
    )
    robot = five_bar(11).robot
    return along_path(robot, motion_limits(robot), TIP, path).trajectory


def five_bar(terms: int) -> Model:
    """The arm, its joints' ranges wide enough for the circle.

    The paper's table I has -20 to 80 and 80 to 190 degrees. It does not print the lengths of the
    bars; with those of `parallel_arm` the circle needs -27 to 61 and 104 to 167 degrees.
    """
    model = arm(MODELS[terms])
    ranges = ((-0.5, 1.39), (1.4, 3.3))
    joints = tuple(
        Coordinate(c.name, c.kind, Limits(low, high, 3.0, 20.0))
        for c, (low, high) in zip(model.robot.coordinates, ranges, strict=True)
    )
    return Model(model.robot.changed(coordinates=joints), model.terms)


def truth() -> Truth:
    """The true arm, with the friction of table III."""
    model = five_bar(11)
    values = {p.name: p.prior or 0.0 for p in model.parameters}
    for law, sizes in FRICTION.items():
        values |= {f"{law}.link{k}_joint": size for k, size in enumerate(sizes, start=1)}
    known = Parameters(model.names, model.units, [values[name] for name in model.names])
    return Truth(model, known, np.full(model.robot.n_joints, 0.005))


def identified() -> ValuedModel:
    """Eleven parameters by least squares, from reaches to targets 1 to 4."""
    model = arm(MODELS[11])
    regressor = base_regressor(model)
    log = Log.drawn(range(1, 5), np.random.default_rng(1))
    estimate = OrdinaryLeastSquares()(log.information_of(regressor))
    return five_bar(11).at(estimate.parameters)


def refused(values: tuple[float, float, float]) -> str:
    """What the law says of inertial parameters that are printed; empty if it accepts them.

    In the order of eq. 14: of the first joint, of the coupling, of the second joint. The law finds
    them as inertias of links 1 and 2 and a first moment of link 3.
    """
    first, coupled, second = values
    names = ("Izz.link1", "Izz.link2", "mx.link3")
    known = Parameters(names, ("kg m²", "kg m²", "kg m"), (first, second, coupled / L2))
    model = five_bar(11).at(known)
    try:
        motion = circle()
        refuse_indefinite(model, motion.sample(np.linspace(0.0, motion.duration, 500)))
    except ModelError as error:
        return error.wrong
    return ""


def lap(run: TrackedRun, t: Array) -> float:
    """Root mean square distance of the tip over the lap at constant speed [mm]."""
    rows = (t >= PERIOD) & (t <= 2.0 * PERIOD)
    return float(1e3 * np.sqrt(np.mean(run.deviation[rows] ** 2)))


def main() -> list[Claim]:
    """PD alone, the law as printed, the law with friction; parameters that are refused."""
    real, model = truth(), identified()
    controllers: dict[str, Control] = {
        "PD alone": PD(KP, KV),
        "the law as printed, without friction": ComputedTorque(model, KP, KV, friction=False),
        "with friction in the law": ComputedTorque(model, KP, KV),
    }
    robot = real.robot
    drives = Drives(resolution=2.0 * np.pi / 2**20)
    found = tracking(robot, real, circle(), controllers, TIP, drives)
    claims = [
        Claim(
            f"circle, RMS of the tip: {run.name} [mm]",
            f"{lap(run, found.t):.2f}",
            "<= 1.00" if run is found.runs[-1] else "printed",
            run is not found.runs[-1] or lap(run, found.t) <= 1.0,
        )
        for run in found.runs
    ]
    for name, values in PRINTED.items():
        words = refused(values)
        stated = words.split(":")[0] or "accepted"
        claims.append(Claim(f"printed parameters, {name}", stated, "refused", bool(words)))
    return claims


if __name__ == "__main__":
    main_of(main)
