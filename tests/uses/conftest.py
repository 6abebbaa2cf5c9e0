"""A robot with values, a motion of it, and the task of following it."""

import numpy as np
import pytest

from invented import tree
from steelyard.base.arrays import Parameters
from steelyard.base.motion import Motion
from steelyard.model.laws.friction_over_speed import Coulomb, Viscous
from steelyard.model.laws.laws_without_friction import RigidBody, RotorInertia
from steelyard.model.model import Model, ValuedModel
from steelyard.model.terms.term import Term
from steelyard.uses.control.joint_controllers import ControlTask

TICK = 1e-3


def valued_of(*terms: Term) -> ValuedModel:
    """The bodies of a tree, and other terms with all parameters 0.5."""
    model = Model(tree(), (RigidBody(), *terms))
    known = [0.5 if p.prior is None else p.prior for p in model.parameters]
    return model.at(Parameters(model.names, model.units, known))


@pytest.fixture
def valued() -> ValuedModel:
    return valued_of(RotorInertia(), Coulomb(), Viscous())


@pytest.fixture
def motion(valued: ValuedModel) -> Motion:
    n = valued.model.robot.n
    t = TICK * np.arange(300)[:, None]
    rates, sizes = 5.0 + np.arange(n), np.linspace(0.2, 0.4, n)
    return Motion(
        t[:, 0],
        sizes * np.sin(rates * t),
        sizes * rates * np.cos(rates * t),
        -sizes * rates**2 * np.sin(rates * t),
    )


@pytest.fixture
def task(motion: Motion) -> ControlTask:
    n = motion.n_joints
    return ControlTask(motion, motion, TICK, np.linspace(1.0, 2.0, n), 60.0, np.full(n, 3.0))
