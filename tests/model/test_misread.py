"""Columns of errors of how efforts are read, against the torque that they scale."""

import numpy as np

from invented import dh_arm
from steelyard.base.arrays import Parameters
from steelyard.model.equations.inverse_dynamics import JointState
from steelyard.model.laws.friction_over_speed import Viscous
from steelyard.model.laws.laws_without_friction import RigidBody
from steelyard.model.model import Model
from steelyard.model.terms.geometry_and_effort_errors import HYSTERESIS, EffortReadingErrors

ROBOT = dh_arm()


def test_columns_are_those_of_the_torque_in_their_own_joint() -> None:
    motion = np.cumsum(np.random.default_rng(3).normal(size=(3, ROBOT.n, 20)), axis=2) / 20.0
    bodies = Model(ROBOT, (RigidBody(), Viscous()))
    values = np.append(ROBOT.nominal.ravel(), (0.1, 0.2, 0.3))
    torque = bodies.at(Parameters(bodies.names, bodies.units, values)).block(*motion)
    friction = np.array([0.1, 0.2, 0.3])[:, None] * motion[1]
    reference = tuple(zip(bodies.names, values.tolist(), strict=True))
    term = EffortReadingErrors(reference, (2.0, 4.0, 8.0), ((Viscous(), (0.1, 0.2, 0.3)),))
    model = Model(ROBOT, (term,))
    scan, cut = model.scan(), 7
    channels = np.hstack([scan(*motion[:, :, :cut]), scan(*motion[:, :, cut:])])
    columns = term.columns(ROBOT, JointState(*map(list, motion), list(channels)))
    assert len(columns) == 3 * ROBOT.n + ROBOT.n * (ROBOT.n - 1)
    for (row, k), column in columns.items():
        kind, _, joint = model.names[k].partition(".")
        assert joint == ROBOT.joint_names[row]
        scale = (2.0, 4.0, 8.0)[row]
        wanted = {
            "gain": torque[row] - friction[row],
            "saturation": torque[row] * np.abs(torque[row]) / scale,
            "hysteresis": scale * followed(torque[row] / (HYSTERESIS * scale)),
            "crosstalk": torque[int(kind[-1]) - 1] if kind[-1].isdigit() else None,
        }[kind.partition("_")[0]]
        np.testing.assert_allclose(column, wanted, atol=1e-12)


def followed(torque: np.ndarray) -> np.ndarray:
    """The state that follows a torque, by the exact solution of its equation over each step."""
    found, z = [], 0.0
    for step in np.diff(torque, prepend=torque[:1]):
        z = np.sign(step) + (z - np.sign(step)) * np.exp(-abs(step)) if step else z
        found.append(z)
    return np.array(found)


def test_a_closed_chain_has_no_columns() -> None:
    closed = ROBOT.changed(
        coordinates=ROBOT.coordinates[:2], passive=ROBOT.coordinates[2:], assembly=np.zeros(3)
    )
    assert (
        EffortReadingErrors().parameters(closed) == ()
        and EffortReadingErrors().n_channels(closed) == 0
    )
