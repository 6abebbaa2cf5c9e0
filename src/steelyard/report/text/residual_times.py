"""Where in time the residuals of fitted runs are concentrated, if those runs fit clearly worse."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from steelyard.arrays import Array
from steelyard.report.text.words import percent
from steelyard.validation.headline import pooled

if TYPE_CHECKING:
    from steelyard.validation.score import RunScore

LARGER = 1.5
"""Error of fitted over unseen runs from which on it is explained."""

WINDOW = 2.0
"""Width of the windows of time [s]."""

HALF = 0.5
"""Share of the squared residuals that is located."""

SHORT = 0.25
"""Share of the time up to which that half counts as concentrated."""


def fitted_larger(fitted: Sequence[RunScore], unseen: Sequence[RunScore]) -> str:
    """Why the error of fitted runs may be clearly above that of unseen ones; else nothing."""
    fresh = [run for run in unseen if not run.repeats]
    own, other = (pooled(run.errors for run in runs) for runs in (fitted, fresh))
    if len(own) != 1 or len(other) != 1:
        return ""
    error, reference = own[0].percent_of_used, other[0].percent_of_used
    if not error > LARGER * reference:
        return ""
    worst = max(fitted, key=lambda run: pooled([run.errors])[0].percent_of_used)
    return (
        f"The error on the fitted runs ({percent(error)}) is larger than on unseen motion "
        f"({percent(reference)}): {_where(worst)}"
    )


def _where(run: RunScore) -> str:
    """The times that hold half of a run's squared residuals, if these are few."""
    starts, squares = _windows(run)
    order = np.argsort(-squares)
    total = np.cumsum(squares[order])
    count = int(np.searchsorted(total, HALF * total[-1])) + 1
    if count > max(SHORT * len(starts), 1.0):
        return f"in {run.run} residuals are spread over the whole time"
    times = ", ".join(f"{a:.0f} to {b:.0f} s" for a, b in _merged(np.sort(starts[order[:count]])))
    return (
        f"in {run.run} {percent(100.0 * float(total[count - 1] / total[-1]))} of the squared "
        f"residuals lie in {percent(100.0 * count / len(starts))} of the time: {times}"
    )


def _windows(run: RunScore) -> tuple[Array, Array]:
    """Starts of windows of time, and squared residuals in each, in the unit of the errors."""
    traces = run.traces
    counts = np.ones(traces.moving.shape) if run.errors.at_rest else traces.moving.astype(float)
    squares = counts * (traces.measured - traces.predicted) ** 2
    mean = squares.sum(axis=0) / np.maximum(counts.sum(axis=0), 1.0)
    errors = np.array([joint.error if joint.counted else 0.0 for joint in run.errors.joints])
    weights = np.divide(errors**2, mean, out=np.zeros(len(mean)), where=mean > 0.0)
    number = ((traces.t - traces.t[0]) // WINDOW).astype(int)
    total = np.asarray(np.bincount(number, squares @ weights), dtype=np.float64)
    return np.asarray(float(traces.t[0]) + WINDOW * np.arange(len(total))), total


def _merged(starts: Array) -> list[tuple[float, float]]:
    """Windows as intervals, neighbours as one."""
    found: list[tuple[float, float]] = []
    for start in starts.tolist():
        if found and start - found[-1][1] < 0.5 * WINDOW:
            found[-1] = (found[-1][0], start + WINDOW)
        else:
            found.append((start, start + WINDOW))
    return found
