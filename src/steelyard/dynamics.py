r"""Quantities of a model with values: gravity, bias, mass matrix and friction.

Each is a part of $\tau = M(q)\ddot q + b(q, \dot q) + \tau_f(q, \dot q)$, taken from the torque
of the terms that make it: bodies for $b$ and for gravity $b(q, 0)$, bodies and rotors for $M$.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from steelyard.arrays import Array
from steelyard.model import Model, ValuedModel
from steelyard.motion import Motion, numbers
from steelyard.parameters import Parameters
from steelyard.terms.term import Term


def gravity(valued: ValuedModel, q: ArrayLike) -> Array:
    """Efforts that hold the bodies at rest against gravity.

    Args:
        valued: The model.
        q: Positions, shape `(n,)` or `(N, n)` [rad; m].

    Returns:
        Shape of `q` [Nm; N].
    """
    q = _configurations(valued, "q", q)
    return bias(valued, q, np.zeros_like(q))


def bias(valued: ValuedModel, q: ArrayLike, dq: ArrayLike) -> Array:
    """Coriolis, centrifugal and gravity efforts of the bodies.

    Args:
        valued: The model.
        q: Positions, shape `(n,)` or `(N, n)` [rad; m].
        dq: Velocities, likewise.

    Returns:
        Shape of `q` [Nm; N].
    """
    q = _configurations(valued, "q", q)
    dq = numbers("dq", dq, [q.shape])
    bodies = part(valued, lambda term: term.role == "body")
    efforts = bodies.torque(_samples(q, dq, np.zeros_like(q)))
    return efforts.reshape(q.shape)


def mass_matrix(valued: ValuedModel, q: ArrayLike) -> Array:
    """Inertia of bodies and rotors as the joints feel it, symmetric.

    Args:
        valued: The model.
        q: Positions, shape `(n,)` or `(N, n)` [rad; m].

    Returns:
        Shape `(n, n)` or `(N, n, n)` [kg m²; kg m; kg].
    """
    q = _configurations(valued, "q", q)
    many, n = np.atleast_2d(q), q.shape[-1]
    masses = part(valued, lambda term: term.cause == "inertia")
    postures = np.repeat(many, n + 1, axis=0)
    rest, unit = np.zeros_like(postures), np.tile(np.eye(n + 1, n, -1), (len(many), 1))
    efforts = masses.torque(_samples(postures, rest, unit)).reshape(len(many), n + 1, n)
    matrix = (efforts[:, 1:] - efforts[:, :1]).swapaxes(1, 2)
    matrix = 0.5 * (matrix + matrix.swapaxes(1, 2))
    return matrix.reshape(*q.shape, n)


def friction(valued: ValuedModel, motion: Motion) -> Array:
    """Efforts of the friction laws along a motion, shape `(N, n)` [Nm; N]."""
    return part(valued, lambda term: term.cause == "friction").torque(motion)


def part(valued: ValuedModel, chosen: Callable[[Term], bool]) -> ValuedModel:
    """The model with some of its terms only."""
    terms = tuple(term for term in valued.model.terms if chosen(term))
    model = Model(valued.model.robot, terms)
    values = valued.values.as_dict()
    return model.at(Parameters(model.names, model.units, [values[name] for name in model.names]))


def _configurations(valued: ValuedModel, name: str, q: ArrayLike) -> Array:
    """One configuration, or one a row."""
    n = valued.model.robot.n
    return numbers(name, q, [(n,), (None, n)])


def _samples(q: Array, dq: Array, ddq: Array) -> Motion:
    q, dq, ddq = (np.atleast_2d(x) for x in (q, dq, ddq))
    return Motion(np.zeros(len(q)), q, dq, ddq)
