"""Columns of errors of how efforts are read, against the torque that they scale."""

import numpy as np

from invented import dh_arm
from steelyard.base.arrays import Parameters
from steelyard.model.equations.inverse_dynamics import JointState
from steelyard.model.laws.rigid_body import RigidBody
from steelyard.model.model import Model
from steelyard.model.terms.geometry_and_effort_errors import EffortReadingErrors

ROBOT = dh_arm()


def test_gain_and_saturation_scale_the_torque_of_their_own_joint() -> None:
    motion = np.random.default_rng(3).normal(size=(3, ROBOT.n, 20))
    bodies = Model(ROBOT, (RigidBody(),))
    nominal = ROBOT.nominal.ravel()
    torque = bodies.at(Parameters(bodies.names, bodies.units, nominal)).block(*motion)
    reference = tuple(zip(bodies.names, nominal.tolist(), strict=True))
    term = EffortReadingErrors(reference, scale=(2.0, 4.0, 8.0))
    model = Model(ROBOT, (term,))
    channels = model.scan()(*motion)
    columns = term.columns(ROBOT, JointState(*map(list, motion), list(channels)))
    assert len(columns) == 2 * ROBOT.n
    for (row, k), column in columns.items():
        kind, _, joint = model.names[k].partition(".")
        assert joint == ROBOT.joint_names[row]
        scale = (2.0, 4.0, 8.0)[row]
        wanted = torque[row] if kind == "gain" else torque[row] * np.abs(torque[row]) / scale
        np.testing.assert_allclose(column, wanted)


def test_a_closed_chain_has_no_columns() -> None:
    closed = ROBOT.changed(
        coordinates=ROBOT.coordinates[:2], passive=ROBOT.coordinates[2:], assembly=np.zeros(3)
    )
    assert (
        EffortReadingErrors().parameters(closed) == ()
        and EffortReadingErrors().n_channels(closed) == 0
    )
