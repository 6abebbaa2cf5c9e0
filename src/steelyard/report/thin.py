"""Fewer points for the eye: every stretch of a signal keeps its lowest and its highest sample."""

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array


def thin(signal: Array, most: int) -> NDArray[np.intp]:
    """Indices of the samples to draw, in order.

    The first and last sample stay, and so do the lowest and the highest of each of about `most / 2`
    stretches of equal length. Values that are not finite are passed over where a stretch has
    others.

    Args:
        signal: Shape `(N,)`.
        most: Largest number of indices; at least 4.

    Returns:
        Shape `(min(N, most),)` or shorter.
    """
    size = len(signal)
    if size <= most:
        return np.arange(size)
    length = -(-size // ((most - 2) // 2))
    padded = np.full(-(-size // length) * length, np.nan)
    padded[:size] = signal
    stretches = np.where(np.isfinite(padded), padded, np.nan).reshape(-1, length)
    starts = np.arange(len(stretches)) * length
    lowest = starts + np.where(np.isnan(stretches), np.inf, stretches).argmin(axis=1)
    highest = starts + np.where(np.isnan(stretches), -np.inf, stretches).argmax(axis=1)
    return np.unique(np.concatenate([[0], lowest, highest, [size - 1]]))


def gaps(t: Array, factor: float = 5.0) -> NDArray[np.intp]:
    """Indices of the samples after which time `t`, shape `(N,)`, jumps by many usual steps."""
    steps = np.diff(t)
    if not len(steps):
        return np.empty(0, dtype=np.intp)
    return np.flatnonzero(steps > factor * np.median(steps))


def drawn(t: Array, signal: Array, most: int) -> tuple[Array, Array]:
    """Points of a line that is broken where time jumps; at most `most`, breaks included.

    Args:
        t: Shape `(N,)` [s].
        signal: Shape `(N,)`.
        most: Largest number of points.

    Returns:
        Time and value, equally long; a break has value NaN.
    """
    breaks = gaps(t)
    breaks = breaks[: most // 4]
    chosen = thin(signal, most - len(breaks))
    after = np.searchsorted(breaks, chosen, side="left")
    places = np.flatnonzero(np.diff(after)) + 1
    values = np.where(np.isfinite(signal[chosen]), signal[chosen], np.nan)
    return np.insert(t[chosen], places, t[chosen[places - 1]]), np.insert(values, places, np.nan)


def outline(t: Array, lower: Array, upper: Array, most: int) -> tuple[Array, Array]:
    """Outline of an area between two lines, one closed piece between jumps of time.

    Args:
        t: Shape `(N,)` [s].
        lower: Shape `(N,)`.
        upper: Shape `(N,)`.
        most: Largest number of points.

    Returns:
        Time and value, equally long; NaN in both between pieces.
    """
    breaks = gaps(t)[: max(most // 8, 1)]
    chosen = thin(upper, max((most - len(breaks)) // 2, 4))
    pieces_t: list[Array] = []
    pieces: list[Array] = []
    pause = np.array([np.nan])
    for part in np.split(chosen, np.searchsorted(chosen, breaks, side="right")):
        pieces_t += [t[part], t[part[::-1]], pause]
        pieces += [upper[part], lower[part[::-1]], pause]
    return np.concatenate(pieces_t)[:-1], np.concatenate(pieces)[:-1]
