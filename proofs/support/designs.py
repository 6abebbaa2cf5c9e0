"""Designs run as a user runs them, and judged by Pinocchio alone."""

import json
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin
from proofs.support.claims import data_folder

PROBLEMS = Path(__file__).parents[1] / "problems"
CORES = "2"


@dataclass(frozen=True)
class Run:
    """One design.

    Attributes:
        seconds: From the command to its end, start-up included.
        result: What the command says, JSON.
        coefficients: The motion's file, JSON.
    """

    seconds: float
    result: dict
    coefficients: dict


def designed(problem: Path, *options: str) -> Run:
    """`steelyard excite` on a problem file, timed from outside, on two processes."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "design"
        command = [Path(sys.executable).with_name("steelyard"), "excite", str(problem), "--json"]
        start = time.perf_counter()
        done = subprocess.run(
            [*map(str, command), "--processes", CORES, "-o", str(folder), *options],
            capture_output=True,
            text=True,
            env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
        )
        seconds = time.perf_counter() - start
        if done.returncode not in (0, 3):  # 3: no floor is given, or no search ended
            sys.exit(done.stderr)
        motion = json.loads((folder / "trajectory.json").read_text())
        return Run(seconds, json.loads(done.stdout), motion)


@dataclass(frozen=True)
class Judge:
    """A robot as Pinocchio sees it, with the limits that the problem states in numbers.

    Attributes:
        model: The robot.
        columns: First independent columns of the rigid bodies, in natural order.
        frame: Whose origin stays in the box.
        box: Least and greatest x, y, z, shape `(2, 3)` [m].
        velocity: Highest speeds.
        acceleration: Highest accelerations.
        lower: Lowest positions.
        upper: Highest positions.
    """

    model: pin.Model
    columns: list
    frame: str
    box: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    lower: np.ndarray
    upper: np.ndarray

    def value(self, motion: dict) -> tuple[float, float]:
        """Condition of the regressor on 1 000 samples, raw and with columns of unit norm."""
        t = np.linspace(0.0, motion["period_s"], 1000, endpoint=False)
        rows = regressor(self.model, *series(motion, t))[:, self.columns]
        dq = series(motion, t)[1]
        n = dq.shape[1]
        viscous, coulomb = np.zeros((2, len(t), n, n))
        viscous[:, range(n), range(n)] = dq
        coulomb[:, range(n), range(n)] = sign(dq)
        whole = np.hstack([rows, viscous.reshape(-1, n), coulomb.reshape(-1, n)])
        return np.linalg.cond(whole), np.linalg.cond(whole / np.linalg.norm(whole, axis=0))

    def worst(self, motion: dict, count: int = 100_000) -> float:
        """Least margin on a grid a hundred times finer, in units of each limit's half range."""
        t = np.linspace(0.0, motion["period_s"], count)
        q, dq, ddq = series(motion, t)
        half = 0.5 * (self.upper - self.lower)
        margins = [
            ((q - self.lower) / half).min(),
            ((self.upper - q) / half).min(),
            (1.0 - np.abs(dq) / self.velocity).min(),
            (1.0 - np.abs(ddq) / self.acceleration).min(),
        ]
        data = self.model.createData()
        number = self.model.getFrameId(self.frame)
        places = np.empty((count, 3))
        for k, posture in enumerate(q):
            pin.framesForwardKinematics(self.model, data, posture)
            places[k] = data.oMf[number].translation
        size = 0.5 * (self.box[1] - self.box[0])
        margins += [((places - self.box[0]) / size).min(), ((self.box[1] - places) / size).min()]
        return float(min(margins))


def series(motion: dict, t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Position, velocity and acceleration of a series from its coefficients."""
    sine, cosine = np.array(motion["sine"]), np.array(motion["cosine"])
    rate = 2.0 * np.pi / motion["period_s"] * np.arange(1, sine.shape[1] + 1)
    s, c = np.sin(np.outer(t, rate)), np.cos(np.outer(t, rate))
    q = np.array(motion["start"]) + s @ sine.T + (c - 1.0) @ cosine.T
    dq = (c * rate) @ sine.T - (s * rate) @ cosine.T
    return q, dq, -(s * rate**2) @ sine.T - (c * rate**2) @ cosine.T


def sign(dq: np.ndarray) -> np.ndarray:
    """Direction of motion; what rounding leaves of a speed at rest has none."""
    return np.sign(np.where(np.abs(dq) < 1e-9, 0.0, dq))


def regressor(model: pin.Model, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
    """Rows of all samples and joints, ten columns a body."""
    data = model.createData()
    rows = [
        pin.computeJointTorqueRegressor(model, data, *state).copy()
        for state in zip(q, dq, ddq, strict=True)
    ]
    return np.concatenate(rows)


def independent(model: pin.Model, rigid: int) -> list[int]:
    """The first independent columns in natural order, from random states."""
    random = np.random.default_rng(0)
    rows = regressor(model, *random.uniform(-3.0, 3.0, (3, 60, model.nv)))
    chosen: list[int] = []
    basis = np.zeros((len(rows), 0))
    largest = np.linalg.norm(rows, axis=0).max()
    for column in range(rows.shape[1]):
        left = rows[:, column] - basis @ (basis.T @ rows[:, column])
        left -= basis @ (basis.T @ left)
        if np.linalg.norm(left) > 1e-8 * largest:
            basis = np.column_stack([basis, left / np.linalg.norm(left)])
            chosen.append(column)
    if len(chosen) != rigid:
        sys.exit(f"{len(chosen)} base columns, not {rigid}")
    return chosen


def panda() -> Judge:
    """The Panda with its fingers locked."""
    path = data_folder().parent / "models/panda_description/urdf/panda.urdf"
    whole = pin.buildModelFromUrdf(str(path))
    locked = [whole.getJointId(f"panda_finger_joint{k}") for k in (1, 2)]
    model = pin.buildReducedModel(whole, locked, pin.neutral(whole))
    return Judge(
        model,
        independent(model, 43),
        "panda_hand_tcp",
        np.array([[-0.75, -0.75, 0.10], [0.75, 0.75, 1.20]]),
        0.95 * np.array([2.175] * 4 + [2.61] * 3),
        0.95 * np.array([15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0]),
        model.lowerPositionLimit + 0.05,
        model.upperPositionLimit - 0.05,
    )


def ur10() -> Judge:
    """The UR10."""
    path = data_folder().parent / "models/ur_description/urdf/ur10_robot.urdf"
    model = pin.buildModelFromUrdf(str(path))
    return Judge(
        model,
        independent(model, 36),
        "tool0",
        np.array([[-1.3, -1.3, 0.10], [1.3, 1.3, 1.70]]),
        0.95 * np.array([2.0944] * 2 + [3.1416] * 4),
        np.full(6, 0.95 * 5.0),
        model.lowerPositionLimit + 0.05,
        model.upperPositionLimit - 0.05,
    )
