r"""The residual of a run as an observer sees it: behind a first-order low-pass, with the speeds.

Measured minus predicted effort goes through $\dot r = 2\pi f\,(\tau - \hat\tau - r)$, the filter of
a momentum observer [DeLuca2005]: no sample waits for later efforts. Motion comes from the log's
processing. Where a joint rests, its friction lies anywhere in a dead zone: laws without memory then
predict none, instead of one of either sign by the noise of the velocity.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.errors import DataError, LogError
from steelyard.estimation.identified import IdentifiedModel
from steelyard.estimation.residual_peaks import (
    FEWEST,
    HOLD,
    SETTLED,
    ResidualPeaks,
    peaks_of,
    ranges_of,
)
from steelyard.estimation.rest_changes import changes_at_rest, low_passed
from steelyard.measurement.run import Run
from steelyard.motion import Motion
from steelyard.regression.gather import along
from steelyard.validation.friction.mixes import remembers
from steelyard.validation.torque_parts import PARTS, TorqueSplit

LEAST_RATE = 10.0
"""Least sampling rate over the cut-off of the residual's low-pass."""

GRAVITY, FRICTION = PARTS.index("gravity"), PARTS.index("friction")

FORGOTTEN = 5.0
"""Time constants of the low-pass after which it has forgotten its start."""


@dataclass(frozen=True, eq=False)
class ResidualTrace:
    """Residuals of a run; of a fast log every k-th sample, at `LEAST_RATE` cut-offs or more.

    Attributes:
        run: Name of the run.
        t: Time, shape `(N,)` [s]; steps of more than twice `step` are gaps.
        step: Time between samples [s].
        residual: Measured minus predicted effort, low-passed, shape `(n, N)` [Nm; N].
        slowest: Least speed of each joint in the last `HOLD` seconds, shape `(n, N)` [rad/s; m/s].
        fastest: Greatest speed in the last `SETTLED` seconds, likewise.
        measured: Measured effort, low-passed likewise, shape `(n, N)` [Nm; N].
        parts: Predicted gravity, and friction of joints that move, likewise, shape `(2, n, N)`
            [Nm; N]; what friction with memory is at rest depends on motion before the log.
    """

    run: str
    t: Array
    step: float
    residual: Array
    slowest: Array
    fastest: Array
    measured: Array
    parts: Array

    @property
    def duration(self) -> float:
        """Time without gaps [s]."""
        return len(self.t) * self.step

    def of(self, chosen: NDArray[np.bool_] | slice) -> "ResidualTrace":
        """Some of the samples."""
        names = ("t", "residual", "slowest", "fastest", "measured", "parts")
        return replace(self, **{name: getattr(self, name)[..., chosen] for name in names})

    def without(self, joints: Sequence[int]) -> "ResidualTrace":
        """The same with NaN as the residual of some joints."""
        residual = self.residual.copy()
        residual[list(joints)] = np.nan
        return replace(self, residual=residual)

    def peaks(self, edges: Array, cutoff: float) -> ResidualPeaks:
        """Its largest residuals per visit to a range of speed; see `peaks_of`."""
        return peaks_of(self.t, self.residual, self.ranges(edges), self.step, edges, cutoff)

    def ranges(self, edges: Array) -> NDArray[np.intp]:
        """Range of speed of every joint, shape `(n, N)`; see `ranges_of`."""
        return ranges_of(self.slowest, self.fastest, edges)

    def changes(self, edges: Array) -> Array:
        """Change of the residual where all joints rest, shape `(n, N)`; see `changes_at_rest`."""
        return changes_at_rest(self.t, self.residual, self.ranges(edges), self.step)


def residual_cutoff(identified: IdentifiedModel, runs: Sequence[Run]) -> float:
    """Low-pass of the residual that all runs are sampled fast enough for [Hz]."""
    return min(identified.cutoffs.score, *(run.rate / LEAST_RATE for run in runs))


def residual_trace(
    identified: IdentifiedModel, run: Run, cutoff: float, *, at_rest: bool = True
) -> ResidualTrace:
    """The residual of a run.

    Args:
        identified: The model.
        run: Clean motion and effort.
        cutoff: Of the low-pass [Hz].
        at_rest: Whether to look at the rests before the first and after the last motion too.

    Raises:
        LogError: The run is sampled too slowly for the low-pass, or has no samples.
    """
    if run.rate < LEAST_RATE * cutoff * (1.0 - 1e-6):
        raise LogError(
            f"the log is sampled with {run.rate:.3g} Hz, less than {LEAST_RATE:g} times the "
            f"residual's low-pass of {cutoff:.3g} Hz",
            where=run.name,
            fix=f"log with {LEAST_RATE * cutoff:.0f} Hz or more",
        )
    whole = replace(run, span=(-np.inf, np.inf)) if at_rest else run
    every = max(1, int(run.rate / (LEAST_RATE * cutoff)))
    split, gains = TorqueSplit(identified.valued), identified.signals.gains[:, None]
    found = []
    for _, blocks in groupby(along(whole.blocks(), identified.model), key=lambda b: b.segment):
        parts = []
        for block in blocks:
            predicted = split.block(block)
            predicted[FRICTION] *= block.moving | remembers(identified.model.terms)
            measured = gains * block.effort
            residual = measured - predicted.sum(axis=0)
            sliding = predicted[FRICTION] * block.moving
            kept = np.stack([residual, measured, predicted[GRAVITY], sliding])
            parts.append((block.t, kept, block.dq))
        t, signals, dq = (np.concatenate(some, axis=-1) for some in zip(*parts, strict=True))
        first = int(FORGOTTEN / (2.0 * np.pi * cutoff) * run.rate)
        at = slice(first, None, every)
        slowest = -greatest(-np.abs(dq), round(HOLD * run.rate) + 1)[:, at]
        fastest = greatest(np.abs(dq), round(SETTLED * run.rate) + 1)[:, at]
        low = low_passed(signals, cutoff, run.rate)[..., at]
        found.append((t[at], low, slowest, fastest))
    if not sum(len(one[0]) for one in found):
        raise LogError(
            "no segment of the log is long enough for the residual's low-pass",
            where=run.name,
            fix="log for longer, or give a higher cut-off",
        )
    t, low, slowest, fastest = (np.concatenate(some, axis=-1) for some in zip(*found, strict=True))
    return ResidualTrace(run.name, t, every / run.rate, low[0], slowest, fastest, low[1], low[2:])


def greatest(values: Array, samples: int) -> Array:
    """Greatest of this and the samples before it, `samples` in all."""
    from scipy.ndimage import maximum_filter1d

    return np.asarray(maximum_filter1d(values, samples, axis=1, origin=(samples - 1) // 2))


SLID = 0.1
"""Travel after which friction with memory slides, at least [rad; m]."""


def sliding_friction(identified: IdentifiedModel, speed: Array) -> Array:
    """Largest predicted friction of each joint at a low speed, shape `(n,)` [Nm; N].

    Args:
        identified: The model.
        speed: Of each joint, shape `(n,)` [rad/s; m/s].
    """
    t = np.linspace(0.0, SLID / float(np.min(speed)), 400)
    there = np.concatenate([t, t[::-1]])[:, None] * speed
    dq = np.repeat([1.0, -1.0], len(t))[:, None] * speed
    along = Motion(np.arange(len(there)) * t[1], there, dq, np.zeros_like(there))
    return np.asarray(np.abs(identified.friction(along)).max(axis=0))


def supported_rate(peaks: ResidualPeaks, wanted: float | None, usual: float = 1.0) -> float:
    """False alarms per hour to use: those wanted, or the usual, or the least that is supported.

    Raises:
        DataError: Fewer are wanted than this much free motion supports.
    """
    least = peaks.lowest_rate
    if not (peaks.visits >= FEWEST).any():
        raise DataError(
            f"{peaks.duration:.3g} s of free motion are too short to calibrate thresholds with",
            where="calibration of contact thresholds",
            fix="give longer logs of motion without contact with --calibrate",
        )
    if wanted is None:
        return max(usual, least)
    if wanted < least:
        minutes = peaks.duration / 60.0
        raise DataError(
            f"{wanted:.3g} false alarms per hour cannot be claimed from {minutes:.1f} min of free "
            f"motion: it supports {least:.2g} per hour or more",
            where="--rate",
            fix=f"ask for {least:.2g} or more, or calibrate with "
            f"{minutes * least / wanted:.0f} min of free motion",
        )
    return wanted
