"""Evidence made small enough to be drawn."""

from collections.abc import Sequence
from typing import Literal

import numpy as np

from steelyard.arrays import Array
from steelyard.diagnosis.finding import Picture, Trace

POINTS = 2000
"""Points of a trace."""


def trace(name: str, x: Array, y: Array, kind: Literal["line", "points", "bars"] = "line") -> Trace:
    """A trace of at most `POINTS` points."""
    stride = -(-len(x) // POINTS)
    step = max(1, stride)
    return Trace(name, np.array(x[::step], dtype=np.float64), np.array(y[::step]), kind)


def histogram(name: str, values: Array, bins: int = 60) -> Trace:
    """How often values occur; the rarest 0.1 % on each side are counted in the outer bars."""
    low, high = np.quantile(values, [0.001, 0.999])
    spread = max(float(high - low), 1e-3 * abs(float(high)), 1e-12)
    edges = np.linspace(low - 0.1 * spread, high + 0.1 * spread, bins + 1)
    count, _ = np.histogram(np.clip(values, edges[0], edges[-1]), edges)
    return Trace(name, 0.5 * (edges[1:] + edges[:-1]), count.astype(np.float64), "bars")


def of_joints(y: str, traces: Sequence[tuple[str, Array, Literal["bars", "points"]]]) -> Picture:
    """One number per joint, for some names."""
    return Picture(
        "joint",
        y,
        tuple(
            Trace(name, np.arange(1.0, len(values) + 1.0), np.array(values), kind)
            for name, values, kind in traces
        ),
    )
