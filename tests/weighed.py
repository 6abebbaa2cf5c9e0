"""Identified models with all standard parameters, made up instead of identified."""

from collections.abc import Sequence

import numpy as np

from steelyard.base.arrays import Parameters
from steelyard.estimate.estimate import Estimate, StandardEstimate
from steelyard.estimate.identified_model import Cutoffs, IdentifiedModel, Provenance
from steelyard.estimate.information.base_parameters_and_regressor import BaseMap
from steelyard.model.laws.laws_without_friction import RigidBody
from steelyard.model.laws.register import DEFAULT_TERMS
from steelyard.model.model import Model
from steelyard.model.terms.term import Term
from steelyard.robot.file.signals import Signals
from steelyard.robot.robot import Robot


def identified_of(
    robot: Robot,
    terms: Sequence[Term] = DEFAULT_TERMS,
    values: dict[str, float] | None = None,
    seed: int = 0,
) -> IdentifiedModel:
    """The robot's nominal bodies, and invented numbers of everything else.

    Args:
        robot: The robot; its nominal bodies can exist.
        terms: Causes of torque.
        values: Parameters that are to have these values.
        seed: Same seed, same numbers.
    """
    model, rng = Model(robot, tuple(terms)), np.random.default_rng(seed)
    numbers = {
        name: float(x) for name, x in zip(model.names, rng.uniform(0.1, 1.0, 9999), strict=False)
    }
    bodies = [p.name for p in RigidBody().parameters(robot)]
    numbers |= dict(zip(bodies, robot.nominal.ravel().tolist(), strict=True)) | (values or {})
    known = Parameters(model.names, model.units, [numbers[name] for name in model.names])
    size = len(known)
    estimate = Estimate(
        "consistent",
        Parameters((), (), ()),
        np.zeros((0, 0)),
        (),
        np.ones(robot.n),
        np.full(robot.n, 100.0),
        10.0,
        2.0,
        standard=StandardEstimate(known, np.zeros((size, size)), np.ones(size)),
    )
    base = BaseMap(model.names, model.units, tuple(range(size)), (), (), np.zeros((size, 0)))
    inputs = {"robot arm.toml": "ab12", "identification a--b.csv": "cd34"}
    origin = Provenance("9.9.9", inputs, ("a--b@1:2",), ())
    return IdentifiedModel(
        model, base, estimate, (), _signals(robot), Cutoffs(20.0, 8.0, 8.0), origin
    )


def _signals(robot: Robot) -> Signals:
    names, ones = tuple(f"c{k}" for k in range(2 * robot.n)), np.ones(robot.n)
    position, effort = names[: robot.n], names[robot.n :]
    units = robot.effort_units
    return Signals("t", 1.0, position, ones, None, None, effort, ones, "joint_torque", units, ones)
