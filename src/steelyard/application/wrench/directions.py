"""Directions of a wrench that efforts do not show, and their names."""

import numpy as np

from steelyard.arrays import Array
from steelyard.estimation.external.smoothing import OBSERVABLE
from steelyard.estimation.external.wrench import Expected

COMPONENTS = (
    "force along x", "force along y", "force along z",
    "moment about x", "moment about y", "moment about z",
)  # fmt: skip

MINOR = 0.3
"""Share of a direction's largest component below which another one is not named."""


def unobservable_directions(learned: Array, expected: Expected) -> tuple[Array, ...]:
    """Directions with less than `OBSERVABLE` from data, each of shape `(6,)` and length 1.

    Components are shares of the expected size. Of several directions, as many components as
    there are directions stand in one of them each, so that they are as simple as can be.

    Args:
        learned: See `learned_of`, shape `(6, 6)`.
        expected: What was expected; components that are expected to be zero are in no direction.
    """
    from scipy.linalg import qr

    known = expected.variances > 0.0
    values, vectors = np.linalg.eigh(learned[np.ix_(known, known)])
    unobservable = vectors[:, values < OBSERVABLE]
    if not unobservable.size:
        return ()
    pivots = qr(unobservable.T, mode="r", pivoting=True)[1][: unobservable.shape[1]]
    simple = unobservable @ np.linalg.inv(unobservable[np.sort(pivots)])
    found = np.zeros((6, unobservable.shape[1]))
    found[known] = simple / np.linalg.norm(simple, axis=0)
    return tuple(found.T)


def name_of(direction: Array) -> str:
    """A direction for people to read, such as `force along z − moment about y`.

    Args:
        direction: Shares of the expected size, shape `(6,)`.
    """
    sizes = np.abs(direction)
    order = [int(k) for k in np.argsort(-sizes, kind="stable") if sizes[k] > MINOR * sizes.max()]
    sign = np.sign(direction[order[0]])
    words = [COMPONENTS[order[0]]]
    for k in order[1:]:
        words += ["+" if sign * direction[k] > 0.0 else "−", COMPONENTS[k]]
    return " ".join(words)
