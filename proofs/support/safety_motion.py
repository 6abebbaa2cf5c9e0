"""A motion's file evaluated anew, from its numbers alone: positions to jerks, of every kind."""

from math import comb
from typing import Any

import numpy as np
from numpy.polynomial import polynomial

RISE = [0.0, 0.0, 0.0, 10.0, -15.0, 6.0]
"""The smooth step with which amplitudes rise, by powers of the share of its time."""


def duration(motion: dict[str, Any]) -> float:
    """Length in time [s]."""
    match motion["kind"]:
        case "fourier":
            return motion["period_s"] * motion["periods"]
        case "piecewise":
            return motion["breaks_s"][-1]
        case "chained":
            return motion["times"] * sum(duration(part) for part in motion["parts"])
        case "trended" | "windowed":
            return duration(motion["series"])
    raise KeyError(motion["kind"])


def breaks(motion: dict[str, Any]) -> list[float]:
    """Where one formula ends and the next begins [s]."""
    match motion["kind"]:
        case "piecewise":
            return motion["breaks_s"]
        case "chained":
            return list(np.cumsum([0.0] + [duration(part) for part in motion["parts"]]))
        case "trended":
            return motion["trend"]["breaks_s"]
        case "windowed":
            end, ramp = duration(motion), motion["ramp_s"]
            return [0.0, ramp, end - ramp, end]
    return [0.0, duration(motion)]


def derivative(motion: dict[str, Any], t: np.ndarray, order: int) -> np.ndarray:
    """Position (0) to jerk (3) at times, shape `(N, n)`."""
    return _KINDS[motion["kind"]](motion, t, order)


def fine_times(motion: dict[str, Any], count: int) -> np.ndarray:
    """Even times, and some just before and behind every break."""
    end = duration(motion)
    near = np.add.outer(breaks(motion), [-1e-5, -1e-9, 0.0, 1e-9, 1e-5]).ravel()
    return np.union1d(np.linspace(0.0, end, count), np.clip(near, 0.0, end))


def _fourier(motion: dict[str, Any], t: np.ndarray, order: int) -> np.ndarray:
    sine, cosine = np.array(motion["sine"]), np.array(motion["cosine"])
    rate = 2.0 * np.pi / motion["period_s"] * np.arange(1, sine.shape[1] + 1)
    wave = (sine + 1j * cosine) * (1j * rate) ** order
    values = np.imag(np.exp(1j * np.outer(t, rate)) @ wave.T)
    if order == 0:
        values = values + np.array(motion["start"]) - cosine.sum(axis=1)
    return values


def _piecewise(motion: dict[str, Any], t: np.ndarray, order: int) -> np.ndarray:
    edges, coefficients = np.array(motion["breaks_s"]), np.array(motion["coefficients"])
    piece = np.clip(np.searchsorted(edges, t, side="right") - 1, 0, len(coefficients) - 1)
    values = np.zeros((len(t), coefficients.shape[2]))
    for k in np.unique(piece):
        width, here = edges[k + 1] - edges[k], piece == k
        slope = polynomial.polyder(coefficients[k], order, axis=0) / width**order
        values[here] = polynomial.polyval((t[here] - edges[k]) / width, slope).T
    return values


def _chained(motion: dict[str, Any], t: np.ndarray, order: int) -> np.ndarray:
    ends = np.cumsum([duration(part) for part in motion["parts"]] * motion["times"])
    which = np.clip(np.searchsorted(ends, t, side="right"), 0, len(ends) - 1)
    parts = []
    for k in np.unique(which):
        part = motion["parts"][k % len(motion["parts"])]
        start = ends[k] - duration(part)
        parts.append(derivative(part, t[which == k] - start, order))
    return np.concatenate(parts)


def _trended(motion: dict[str, Any], t: np.ndarray, order: int) -> np.ndarray:
    return derivative(motion["series"], t, order) + derivative(motion["trend"], t, order)


def _windowed(motion: dict[str, Any], t: np.ndarray, order: int) -> np.ndarray:
    end, ramp = duration(motion), motion["ramp_s"]
    share = np.clip(np.minimum(t, end - t) / ramp, 0.0, 1.0)
    side = np.where(t < end - t, 1.0, -1.0)
    values = np.zeros((len(t), len(motion["posture"])))
    for k in range(order + 1):
        slope = polynomial.polyval(share, polynomial.polyder(RISE, k)) * (side / ramp) ** k
        slope = np.where((k > 0) & (share == 1.0), 0.0, slope)
        inner = derivative(motion["series"], t, order - k)
        values += comb(order, k) * slope[:, None] * inner
    return values + (np.array(motion["posture"]) if order == 0 else 0.0)


_KINDS = {
    "fourier": _fourier,
    "piecewise": _piecewise,
    "chained": _chained,
    "trended": _trended,
    "windowed": _windowed,
}
