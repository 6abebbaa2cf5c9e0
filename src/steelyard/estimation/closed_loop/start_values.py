"""Values with which a simulation starts: what cannot move cannot be simulated."""

from collections.abc import Mapping
from typing import cast

import numpy as np

from steelyard.arrays import Array, frozen
from steelyard.errors import DataError
from steelyard.estimation.closed_loop.experiment import Experiment, StartValues
from steelyard.estimation.closed_loop.simulation import along, require_sound
from steelyard.terms.acting import ActsOnAxes
from steelyard.terms.laws.rigid_body import RigidBody

NOTE = (
    "the estimate from the filtered motion cannot be simulated: the search started from the "
    "inertial parameters of the model file"
)


def start_estimate(experiment: Experiment) -> StartValues:
    """Weighted least squares, or the nominal bodies with its friction where that cannot move.

    Raises:
        DataError: Neither can move.
    """
    try:
        return _tried(experiment, experiment.start.parameters.values, ())
    except DataError:
        nominal = _nominal(experiment)
        if nominal is None:
            raise
    return _tried(experiment, nominal, (NOTE,))


def _tried(experiment: Experiment, values: Array, notes: tuple[str, ...]) -> StartValues:
    """The values, if the runs can be simulated with them."""
    dynamics = experiment.dynamics
    widths = dynamics.widths(experiment.postures, values)
    require_sound(
        experiment,
        [
            along(run, loop, dynamics, values, widths)
            for run, loop in zip(experiment.runs, experiment.loops, strict=False)
        ],
    )
    return StartValues(values, widths, notes)


def _nominal(experiment: Experiment) -> Array | None:
    """Bodies of the model file, the other terms as they were found but within their bounds.

    Rotors are customarily matched to what they move, and noise makes inertia seem small: a rotor
    has at least the inertia of the bodies that its joint moves.
    """
    model = experiment.regressor.model
    if not all(body.known for body in model.robot.bodies):
        return None
    bodies = {p.name: p.prior or 0.0 for p in RigidBody().parameters(model.robot)}
    found = experiment.start.parameters.as_dict()
    standard = {p.name: max(found.get(p.name, 0.0), p.lower) for p in model.parameters} | bodies
    rotors = [cast(ActsOnAxes, term) for term in model.terms if term.role == "rotor"]
    alone = standard | {p.name: 0.0 for term in rotors for p in term.parameters(model.robot)}
    q, still = experiment.postures, np.zeros_like(experiment.postures)
    ones = np.ones(model.robot.n)
    mass = experiment.dynamics.mass_and_bias(q, still, _based(experiment, alone), ones)[0]
    moved = np.diagonal(mass, axis1=1, axis2=2).mean(axis=0)
    for term in rotors:
        named = term.parameters(model.robot)
        for axis, parameter in zip(term.axes(model.robot), named, strict=True):
            row = np.array(axis.row)
            size = float(np.min(moved[row != 0.0] / row[row != 0.0] ** 2))
            standard[parameter.name] = max(standard[parameter.name], size)
    return _based(experiment, standard)


def _based(experiment: Experiment, standard: Mapping[str, float]) -> Array:
    """Base parameters that the data see, of standard ones."""
    base = experiment.regressor.base
    values = base.base_values([standard[name] for name in base.names])
    named = dict(zip(base.base_names, values, strict=True))
    return frozen([named[name] for name in experiment.start.parameters.names])
