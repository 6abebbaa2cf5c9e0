"""Operations with a halo, applied to signals that come in parts of any size.

An operation declares its halo: how many samples of context it needs on each side. At the ends of a
segment the signal is continued by odd reflection, $2 x_0 - x_k$, which keeps value and slope.
"""

from collections.abc import Iterable, Iterator
from typing import Protocol

import numpy as np

from steelyard.arrays import Array

CHUNK = 8192
"""Samples that an operation is given at a time, at least."""


class Operation(Protocol):
    """A local operation on uniformly sampled channels."""

    @property
    def halo(self) -> int:
        """Samples of context needed on each side."""
        ...

    def __call__(self, extended: Array) -> Array:
        """Channels with context, shape `(C, N + 2 halo)`, to results, shape `(D, N)`."""
        ...


def apply(operation: Operation, parts: Iterable[Array], chunk: int = CHUNK) -> Iterator[Array]:
    """The results for one segment, in order, in parts; the split changes nothing.

    Args:
        operation: What to do.
        parts: Channels of the segment, shapes `(C, any)`.
        chunk: Least number of samples to work on at once.
    """
    halo = operation.halo
    length = max(chunk, 4 * halo)
    buffer: Array | None = None
    begun = False
    for part in parts:
        buffer = part if buffer is None else np.concatenate((buffer, part), axis=-1)
        if not begun:
            if buffer.shape[-1] <= 2 * halo:
                continue
            buffer, begun = continued(buffer, halo, 0), True
        while buffer.shape[-1] >= length + 2 * halo:
            yield operation(buffer[..., : length + 2 * halo])
            buffer = buffer[..., length:]
    if buffer is not None and buffer.shape[-1]:
        buffer = continued(buffer, 0 if begun else halo, halo)
        if buffer.shape[-1] > 2 * halo:
            yield operation(buffer)


def continued(channels: Array, before: int, after: int) -> Array:
    """Channels `(C, N)` continued by odd reflection, repeatedly if they are short."""
    if before == after == 0:
        return channels
    pad = [(0, 0)] * (channels.ndim - 1) + [(before, after)]
    return np.pad(channels, pad, mode="reflect", reflect_type="odd")
