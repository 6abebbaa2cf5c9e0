"""Least squares as papers print it, $(W^T W)^{-1} W^T \\tau$, against Pinocchio and `lstsq`.

The robots are those of the studies, the signals those that the robot file requests; efforts are
drawn, as the solution holds for any.
"""

import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

sys.path.append(str(Path(__file__).parents[2]))
from studies.support.robots import ROBOTS as STUDIED
from studies.support.robots import TORQUE, robot_file

import steelyard
from oracles import pinocchio_model
from steelyard.base.arrays import Array
from steelyard.base.motion import Motion
from steelyard.robot.robot import Robot

PRINTED = """
[estimation]
method = "least_squares"
weights = "equal"
[processing]
matched_cutoff = "off"
rest_speed = "off"
rate = 33.333
motion = { method = "moving_average", span = 5 }
effort = { method = "moving_average", span = 9 }
outliers = "keep"
saturation = "keep"
"""

Columns = Callable[[Motion], list[Array]]
"""Columns of a robot's other terms, each `(N, n)`, in the order of its file."""


def each(values: Array) -> list[Array]:
    """A column per joint of values `(N, n)`, zero in the rows of other joints."""
    n = values.shape[1]
    return [values * (np.arange(n) == j) for j in range(n)]


def plain(m: Motion) -> list[Array]:
    return [*each(m.dq), *each(np.sign(m.dq))]


def of_leg(m: Motion) -> list[Array]:
    both = np.sum(m.dq, axis=1, keepdims=True) * np.ones(2)
    return [*each(np.sign(m.dq)), *each(m.dq), np.sign(both), both]


def of_rx160(m: Motion) -> list[Array]:
    ones = np.ones(m.dq.shape)
    return [*each(m.ddq), *each(np.sign(m.dq)), *each(m.dq), *each(ones)]


def of_five_bar(m: Motion) -> list[Array]:
    sides = np.maximum(np.sign(m.dq), 0.0), np.minimum(np.sign(m.dq), 0.0)
    columns = [*sides, *(m.dq * np.abs(side) for side in sides)]
    return [one for side in columns for one in each(side)]


FOLLOW = np.array([[1.0, 0.0], [0.0, 1.0], [1.0, -1.0], [-1.0, 1.0]])
"""Joints of the parallelogram per motor."""
ROBOTS: dict[str, tuple[Columns, Array | None]] = {
    "p1_leg": (of_leg, None),
    "p2_arm": (plain, None),
    "p3_rx160": (of_rx160, None),
    "p4_arm": (plain, None),
    "p5_arm": (of_five_bar, FOLLOW),
}


def rigid(robot: Robot, m: Motion, follow: Array | None) -> Array:
    """Pinocchio's columns of all bodies, shape `(N, n, 10 bodies)`."""
    model, s = pinocchio_model(robot), np.eye(robot.n) if follow is None else follow
    s = s[[body.coordinate for body in robot.bodies]]
    data = model.createData()
    return np.array(
        [
            s.T @ pin.computeJointTorqueRegressor(model, data, *(s @ x for x in state))
            for state in zip(m.q, m.dq, m.ddq, strict=True)
        ]
    )


def drawn_log(robot: Robot, path: Path, seconds: float = 20.0) -> Path:
    """Motion of sines within the limits and drawn efforts, with a rest, every 30 ms."""
    rng, n = np.random.default_rng(7), robot.n
    t = np.arange(0.0, seconds, 0.03)
    limits = [c.limits for c in robot.coordinates]
    low, high = np.array([(one.lower, one.upper) for one in limits]).T
    middle, half = 0.5 * (low + high), np.minimum(0.5 * (high - low), 0.6)
    part = np.clip((t - 3.0) / 2.0, 0.0, 1.0)[:, None]
    waves = [np.sin(2.0 * np.pi * rng.uniform(0.1, 0.5, n) * t[:, None] + k) for k in range(2)]
    q = middle + 0.4 * half * part**3 * sum(waves)
    tau = 5.0 * rng.standard_normal((len(t), n)) + 20.0 * np.cos(q)
    names = (name.format(j + 1) for name in ("q{}_rad", "dq_{}", "tau{}_Nm") for j in range(n))
    rows = np.column_stack((t, q, np.gradient(q, t, axis=0), tau))
    header = ",".join(["time_s", *names])
    np.savetxt(path, rows, delimiter=",", header=header, comments="", fmt="%.12g")
    return path


@pytest.mark.parametrize("name", ROBOTS)
def test_it_is_lstsq_of_pinocchios_regressor(name: str, tmp_path: Path) -> None:
    others, follow = ROBOTS[name]
    path = robot_file(name, tmp_path / "robot.toml", TORQUE + PRINTED)
    shutil.copy(STUDIED / "p5_arm.urdf", tmp_path)
    model = steelyard.model_of(path)
    log = drawn_log(model.robot, tmp_path / "log.csv")
    found = steelyard.identify(path, log, check=False).model
    (run,) = steelyard.load_runs(path, log)
    data = run.whole()
    assert data.moving.all() and len(data.t) > 600
    columns = np.concatenate(
        (rigid(model.robot, data.motion, follow), np.stack(others(data.motion), axis=-1)), axis=-1
    )
    base = steelyard.base_parameters(model)
    chosen = columns[..., base.independent].reshape(-1, len(base.independent))
    wanted = np.linalg.lstsq(chosen, data.effort.ravel(), rcond=None)[0]
    values = [found.estimate.parameters[one] for one in base.base_names]
    sizes = np.linalg.norm(chosen, axis=0)
    np.testing.assert_allclose(
        values * sizes, wanted * sizes, rtol=0.0, atol=1e-9 * np.max(np.abs(wanted * sizes))
    )
