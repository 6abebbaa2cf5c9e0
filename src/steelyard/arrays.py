"""Owned, read-only arrays: what frozen values keep inside."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def frozen(values: ArrayLike, shape: Sequence[int | None] | None = None) -> Array:
    """A read-only float64 copy of `values`.

    Args:
        values: Anything NumPy can turn into an array.
        shape: Expected shape; `None` entries are free.

    Raises:
        ValueError: The shape is another one.
    """
    array = np.array(values, dtype=np.float64, order="C")
    if shape is not None and (
        array.ndim != len(shape)
        or any(want not in (None, got) for want, got in zip(shape, array.shape, strict=True))
    ):
        wanted = " x ".join("any" if n is None else str(n) for n in shape)
        raise ValueError(f"expected an array of {wanted} numbers, got shape {array.shape}")
    array.flags.writeable = False
    return array
