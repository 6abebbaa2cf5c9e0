"""A humanoid with a floating base: regressor and solution, beside a loop over Pinocchio.

Solving takes us some 80 ms for any number of samples, so that many are taken; their stored matrix
grows with the samples, of which as many are taken as fit into 200 MB.
"""

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
from robots import LINK, limbs

from oracles import pinocchio_model
from steelyard.base.arrays import Array
from steelyard.estimate.information.base_parameters_and_regressor import Regressor, base_regressor
from steelyard.estimate.information.filter_and_gram import Accumulator, Stretch
from steelyard.estimate.information.information import Information, Signature, Window
from steelyard.estimate.least_squares.weighted_robust_and_whitened import WeightedLeastSquares
from steelyard.model.laws.friction_over_speed import Coulomb, Viscous
from steelyard.model.laws.laws_without_friction import RigidBody
from steelyard.model.model import Model
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.robot import BASE_COORDINATES, Body, Robot

BLOCK, SAMPLES, STORED = 256, 50_000, 2_000
Best = Callable[[Callable[[], object], int], float]
Row = tuple[str, str, str, bool]


def humanoid() -> Robot:
    """The G1 of MuJoCo Menagerie beside the data folder, or without it limbs on a trunk."""
    data = os.environ.get("STEELYARD_DATA")
    file = Path(data or "").parent / "models/menagerie/unitree_g1/g1.xml"
    if data and file.exists():
        return load_robot(file, base="floating").robot
    fixed, n = limbs(29), len(BASE_COORDINATES)
    still = np.eye(3), np.zeros(3), [0.0, 0.0, 1.0]
    trunk = Body("trunk", "floating", "floating", -1, *still, 0, inertia=LINK)
    moved = (
        replace(b, parent=b.parent + 1, coordinate=b.coordinate + n, inertia=LINK)
        for b in fixed.bodies
    )
    return fixed.changed(
        bodies=(trunk, *moved),
        coordinates=(*BASE_COORDINATES, *fixed.coordinates),
        assembly=np.zeros(fixed.n + n),
    )


def floating_rows(best: Best) -> list[Row]:
    """The regressor of all base parameters alone, and samples to weighted least squares."""
    robot = humanoid()
    found = base_regressor(Model(robot, (RigidBody(), Coulomb(), Viscous())))
    joints = f"humanoid of {robot.n - 6} joints, floating"
    alone, looped = _regressor(best, found), _pinocchio(best, found)
    solved, stored = _solution(best, found), _stored(best, found)
    return [
        (f"{joints}: regressor", f"{1e6 * alone:.2f} µs a sample", "", True),
        ("Python loop over Pinocchio", f"{1e6 * looped:.1f} µs a sample", "", True),
        ("floating, regressor: ratio", f"{looped / alone:.0f}", ">= 40", looped / alone >= 40.0),
        (f"floating, {SAMPLES} samples to WLS", f"{1e6 * solved:.1f} µs a sample", "", True),
        ("Pinocchio loop, stored, lstsq", f"{1e6 * stored:.0f} µs a sample", "", True),
        ("floating, to solution: ratio", f"{stored / solved:.0f}", ">= 40", stored >= 40 * solved),
    ]


def _motion(robot: Robot, count: int) -> tuple[Array, ...]:
    """Motion and efforts, joint-major."""
    return tuple(np.random.default_rng(0).normal(size=(4, robot.n, count)))


def _regressor(best: Best, found: Regressor) -> float:
    """Seconds a sample, one block."""
    q, dq, ddq, effort = _motion(found.model.robot, BLOCK)
    rows = np.empty((found.code.n_outputs, BLOCK + 8))
    arrays = (q, dq, ddq, np.empty((0, BLOCK)), effort)
    arguments = [v for x in arrays for v in (x.ctypes.data, BLOCK)]
    out = rows.ctypes.data, BLOCK + 8
    return best(lambda: found.code.raw(BLOCK, *arguments, *out), 100) / BLOCK


def _solution(best: Best, found: Regressor) -> float:
    """Seconds a sample, from samples to parameters."""
    accumulator, stretch = Accumulator(found), Stretch(*_motion(found.model.robot, SAMPLES))
    units = found.model.robot.effort_units
    signature = Signature("bench", found.layout.columns, units, "none")

    def solve() -> None:
        sums, window = accumulator(stretch), (Window("run", 0.0, 1.0),)
        parts = (x[None] for x in (sums.grams, sums.absolute, sums.counts))
        WeightedLeastSquares()(Information(found.layout, signature, window, *parts))

    return best(solve, 3) / SAMPLES


def _pinocchio(best: Best, found: Regressor, stored: Array | None = None) -> float:
    """Seconds a sample of Pinocchio's regressor, whose rows with friction may be stored."""
    robot = found.model.robot
    model, count, n = pinocchio_model(robot), STORED if stored is not None else BLOCK, robot.n
    data, columns = model.createData(), list(found.base.independent)
    q, dq, ddq, _ = _motion(robot, count)
    upright = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (count, 1))
    states = [np.hstack([upright, q[6:].T]), *(np.ascontiguousarray(x.T) for x in (dq, ddq))]
    joints = np.eye(n)[:, 6:]

    def loop() -> None:
        for k in range(count):
            rigid = pin.computeJointTorqueRegressor(model, data, *(x[k] for x in states))
            if stored is not None:
                speed = states[1][k][6:]
                full = np.hstack([rigid, joints * np.sign(speed), joints * speed])
                stored[n * k : n * k + n] = full[:, columns]

    return best(loop, 3) / count


def _stored(best: Best, found: Regressor) -> float:
    """Seconds a sample of the loop, and of least squares of all that it stored."""
    matrix = np.empty((STORED * found.model.robot.n, len(found.base)))
    looped = _pinocchio(best, found, matrix)
    effort = _motion(found.model.robot, STORED)[3].T.ravel()
    return looped + best(lambda: np.linalg.lstsq(matrix, effort, rcond=None), 1) / STORED
