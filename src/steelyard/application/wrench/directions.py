"""Directions of a wrench that efforts do not show, and their names."""

import numpy as np

from steelyard.arrays import Array
from steelyard.estimation.external.smoothing import OBSERVABLE
from steelyard.estimation.external.wrench import Expected

COMPONENTS = (
    "force along x", "force along y", "force along z",
    "moment about x", "moment about y", "moment about z",
)  # fmt: skip

KINDS = ("force along", "moment about")

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
    """A direction for people to read, such as `moment about the axis (−1, 1, 0)`.

    Args:
        direction: Shares of the expected size, shape `(6,)`.
    """
    sizes = np.abs(direction)
    sign = np.sign(direction[np.argmax(sizes)])
    named = np.where(sizes > MINOR * sizes.max(), sign * direction, 0.0).reshape(2, 3)
    parts = [_axis_name(kind, axis) for kind, axis in zip(KINDS, named, strict=True) if axis.any()]
    return " with ".join(parts)


def _axis_name(kind: str, axis: Array) -> str:
    """A force or moment along an axis; coordinates are relative to the largest, shape `(3,)`."""
    if np.count_nonzero(axis) == 1:
        sign = "−" if axis.sum() < 0.0 else ""
        return f"{kind} {sign}{'xyz'[int(np.argmax(np.abs(axis)))]}"
    figures = (f"{one:.2g}" for one in axis / np.abs(axis).max() + 0.0)
    return f"{kind} the axis ({', '.join(figures)})".replace("-", "−")
