"""The parallel low-pass of a regression, and Gram matrices of stretches of samples behind it.

Filtering both sides of `effort = columns · parameters` alike leaves the parameters what they are
and removes the noise above the motion's band. Where contacts touch whose forces are unknown, both
sides are first multiplied by a matrix that takes these forces out of a sample's rows.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, cached_property
from math import lcm
from typing import cast

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array, frozen
from steelyard.estimate.information.base_parameters_and_regressor import Layout, Regressor
from steelyard.model.compiled_quantity import check_angles
from steelyard.runs.contact_projection import Touching
from steelyard.runs.smoothing.smoothing_methods_and_zero_phase_filters import kaiser_lowpass
from steelyard.symbolic.native.compiled_programs import FIR_OUTPUTS, TILE_COLUMNS, TILE_ROWS, loops

SUPPRESSION = 60.0  # attenuation above twice the cut-off [dB]
ALL_PASSES = 0.5  # cut-off over sampling rate from which on nothing is filtered
FINE = 40.0  # sampling rate over cut-off at which the noise bandwidth is taken


@dataclass(frozen=True, eq=False)
class ParallelFilter:
    """A symmetric FIR low-pass that keeps every `decimation`-th sample."""

    cutoff: float  # half-amplitude frequency [Hz]
    rate: float  # sampling rate it was made for [Hz]
    taps: Array  # odd number of coefficients, sum 1
    # samples per kept sample; kept samples come at four times the cut-off or faster
    decimation: int

    @classmethod
    def design(cls, cutoff: float, rate: float) -> "ParallelFilter":
        """Kaiser-windowed low-pass, `SUPPRESSION` dB down from twice the cut-off on.

        The cut-off [Hz] is below a quarter of the rate [Hz]; at half the rate or above, every
        sample passes unchanged.
        """
        if cutoff >= ALL_PASSES * rate:
            return cls(cutoff, rate, frozen(np.ones(1)), 1)
        taps = kaiser_lowpass(SUPPRESSION, 2.0 * cutoff / rate, 2.0 * cutoff / rate)
        return cls(cutoff, rate, frozen(taps), max(1, int(rate / (4.0 * cutoff))))

    @property
    def inflation(self) -> float:
        r"""Variance of an estimate per variance if the filtered residuals were uncorrelated.

        White noise through the filter has autocorrelation $r$; a slowly varying column meets its
        sum over the kept samples, $\sum_k r(kD) / r(0)$.
        """
        full = np.correlate(self.taps, self.taps, mode="full")
        centre = len(self.taps) - 1
        kept = full[centre % self.decimation :: self.decimation]
        return float(kept.sum() / full[centre])


def noise_bandwidth(cutoff: float) -> float:
    """Bandwidth of an ideal low-pass that leaves as much of white noise as the filter [Hz]."""
    filter_ = ParallelFilter.design(cutoff, FINE * cutoff)
    return float(0.5 * FINE * cutoff * np.sum(np.square(filter_.taps)))


@dataclass(frozen=True, eq=False)
class Tiling:
    """Tiles that cover the lower triangles of all rows' Gram matrices."""

    firsts: NDArray[np.int64]  # first rows `(a, b)` of each tile, `(tiles, 2)`
    cells: NDArray[np.int64]  # where each packed Gram entry lies among the tiles' sums

    @classmethod
    @cache
    def of(cls, layout: Layout) -> "Tiling":
        """The last tile of a row of tiles reaches back over its neighbour, not beyond."""
        firsts: list[tuple[int, int]] = []
        cells: list[int] = []
        for start, width in zip(layout.starts, layout.widths, strict=True):
            cell: dict[tuple[int, int], int] = {}
            for a in _edges(width, TILE_ROWS):
                for b in _edges(min(a + TILE_ROWS, width), TILE_COLUMNS):
                    for k in range(TILE_ROWS * TILE_COLUMNS):
                        i, j = a + k // TILE_COLUMNS, b + k % TILE_COLUMNS
                        cell[i, j] = len(firsts) * TILE_ROWS * TILE_COLUMNS + k
                    firsts.append((start + a, start + b))
            cells += [cell[i, j] for i in range(width) for j in range(i + 1)]
        return cls(np.array(firsts, dtype=np.int64), np.array(cells, dtype=np.int64))


def _edges(width: int, size: int) -> list[int]:
    return sorted({max(0, min(start, width - size)) for start in range(0, width, size)})


BLOCK = 256  # samples per inner block: its rows stay in the second-level cache

MOVING = 0.1
"""Filtered weight above which a filtered sample counts: only a rest as long as the filter is left
out, a reversal of the motion is not a rest."""

LEAST_WORTH = 0.02  # part of a row that is left without contact forces from which on it counts
RESTING = 0.02  # share of left out samples from which on a filtered sample is beside rests
PADDING = 8  # extra samples per row, so that rows do not start a power of two apart


@dataclass(frozen=True, eq=False)
class Stretch:
    """Consecutive samples of one run, joint-major."""

    q: Array  # `(n, N)`; likewise `dq`, `ddq` and `effort`
    dq: Array
    ddq: Array
    effort: Array
    # weight of each sample in each effort row, `(n, N)`; all ones if `None`. A filtered sample
    # counts if samples of weight 0 leave more than `MOVING` of its filter; then its weight is the
    # inverse of the variances $1 / w$ behind the filter
    weights: Array | None = None
    channels: Array | None = None  # `(n_channels, N)`, see `model.Scan`; without channels if `None`
    # contacts of unknown force, which the rows are made without. Samples of weight 0 then are in no
    # filtered sample, and others count alike
    touching: Touching | None = None
    resting: NDArray[np.bool_] | None = None  # samples at rest that count all the same, `(n, N)`

    def __post_init__(self) -> None:
        if self.channels is None:
            object.__setattr__(self, "channels", np.empty((0, np.shape(self.q)[1])))
        for name in ("q", "dq", "ddq", "effort", "channels"):
            values = np.asarray(getattr(self, name), dtype=np.float64)
            if values.strides[1] != 8:
                values = np.ascontiguousarray(values)
            object.__setattr__(self, name, values)
        like = (self.q, self.dq, self.ddq, self.effort)
        if not all(x.shape == self.q.shape for x in like):
            raise ValueError("q, dq, ddq and effort differ in shape")
        check_angles(self.q)

    def projection(self) -> Array | None:
        """What takes contacts of unknown force out of its rows, `(N, n, n)`, if there are any."""
        if self.touching is None:
            return None
        counted = None if self.weights is None else self.weights > 0.0
        return self.touching.projection(self.q, counted)

    @property
    def inputs(self) -> tuple[Array, ...]:
        """What the kernel reads."""
        return self.q, self.dq, self.ddq, cast(Array, self.channels), self.effort


@dataclass(frozen=True, eq=False)
class Sums:
    """Sums over samples."""

    grams: Array  # packed Gram matrices, `(size,)`
    absolute: Array  # sums of |value|, `(width,)`
    counts: Array  # samples per row, `(rows,)`
    # of `grams`, the part of filtered samples at rests or beside: those in which samples at rest or
    # of weight 0 have a share above `RESTING`
    beside: Array

    def __iadd__(self, other: "Sums") -> "Sums":
        for mine, theirs in zip(vars(self).values(), vars(other).values(), strict=True):
            mine += theirs
        return self


@dataclass(frozen=True, eq=False)
class Accumulator:
    """Turns stretches into sums; holds no state, so threads share it."""

    regressor: Regressor
    matched: ParallelFilter = ParallelFilter.design(1.0, 1.0)  # every sample unchanged
    mixed: bool = False  # whether rows are made without the forces of contacts

    @cached_property
    def layout(self) -> Layout:
        """Which columns the rows see."""
        return self.regressor.layout.mixing() if self.mixed else self.regressor.layout

    @property
    def width(self) -> int:
        """Columns of all rows, efforts included."""
        return sum(self.layout.widths)

    @cached_property
    def taps(self) -> Array:
        """The filter's taps, padded with zeros to whole vectors."""
        taps = self.matched.taps
        return np.concatenate([taps, np.zeros(-len(taps) % self.regressor.code.lanes)])

    @property
    def halo(self) -> int:
        """Samples that a stretch needs beyond those that it answers for."""
        return len(self.matched.taps) - self.matched.decimation

    def outputs(self, n_samples: int) -> int:
        """Filtered samples that a stretch of `n_samples` yields."""
        return max(0, (n_samples - len(self.matched.taps)) // self.matched.decimation + 1)

    def __call__(self, stretch: Stretch) -> Sums:
        """Sums over one stretch: kernel, filter, weights and Gram, a native call each per block."""
        work, projection = _Workspace(self, sum(self._steps)), stretch.projection()
        if projection is not None:
            worth = self._worth(projection)
            for first, count, block in self._blocks(stretch, work, projection):
                work.add(block, count)
                work.counts += worth[:, first : first + count].sum(axis=1) - count
            return work.result()
        weights, beside = self._weights(stretch), self._beside(stretch)
        for first, count, block in self._blocks(stretch, work):
            part = slice(first, first + count)
            work.add(block, count, None if weights is None else weights[:, part])
            if beside is not None:
                work.weigh(block, beside[:, part])
                work.add_grams(block, count, work.beside)
        return work.result()

    def rows(self, stretch: Stretch) -> tuple[Array, Array]:
        """Filtered samples `(width, outputs)`, see `Layout.starts`, and weights `(n, outputs)`.

        Rows without the forces of contacts have errors as large as others; what is left of them is
        their weight.
        """
        n_outputs, projection = self.outputs(stretch.q.shape[1]), stretch.projection()
        result, work = np.empty((self.width, n_outputs)), _Workspace(self, sum(self._steps))
        for first, count, block in self._blocks(stretch, work, projection):
            result[:, first : first + count] = block[: self.width, :count]
        if projection is not None:
            worth = self._worth(projection)
            worth = np.where(worth > LEAST_WORTH, worth, 0.0)
            roots = np.sqrt(np.divide(1.0, worth, out=np.zeros(worth.shape), where=worth > 0.0))
            return result * np.repeat(roots, self.layout.widths, axis=0), worth
        weights = self._weights(stretch)
        return result, np.ones((len(stretch.q), n_outputs)) if weights is None else weights

    def _worth(self, projection: Array) -> Array:
        """How much of each row is left behind a projection `(N, n, n)`, shape `(n, outputs)`."""
        left, shares = np.diagonal(projection, axis1=1, axis2=2).T, np.square(self.matched.taps)
        if not self.outputs(len(projection)):
            return np.zeros((len(left), 0))
        return self.over_taps(np.ascontiguousarray(left), shares / shares.sum())

    @property
    def _steps(self) -> tuple[int, int]:
        """Samples kept of the block before, and samples a block goes on by."""
        lanes, decimation = self.regressor.code.lanes, self.matched.decimation
        step = lcm(decimation, lanes)
        return -(-self.halo // lanes) * lanes, step * max(1, BLOCK // step)

    def _blocks(
        self, stretch: Stretch, work: "_Workspace", projection: Array | None = None
    ) -> Iterator[tuple[int, int, Array]]:
        """First filtered sample, how many there are, and their rows, which may be written to."""
        history, step = self._steps
        n_outputs, per_step = self.outputs(stretch.q.shape[1]), step // self.matched.decimation
        known = 0
        for first in range(0, n_outputs, per_step):
            count = min(per_step, n_outputs - first)
            start = first * self.matched.decimation + known
            work.evaluate(stretch, start, history + step - known, known, projection)
            yield first, count, work.filtered(count)
            work.y[:, :history] = work.y[:, step : step + history]
            known = history

    def _weights(self, stretch: Stretch) -> Array | None:
        """Weights of the filtered samples, shape `(n, outputs)`."""
        n_outputs = self.outputs(stretch.q.shape[1])
        if stretch.weights is None or n_outputs == 0 or np.all(stretch.weights == 1.0):
            return None
        counted = stretch.weights > 0.0
        kept = self.over_taps(counted.astype(np.float64), self.matched.taps) > MOVING
        if np.isin(stretch.weights, (0.0, 1.0)).all():
            return kept.astype(np.float64)
        shares = np.square(self.matched.taps)
        variance = np.divide(1.0, stretch.weights, where=counted, out=np.zeros(counted.shape))
        mean = self.over_taps(variance, shares)
        known = self.over_taps(counted.astype(np.float64), shares)
        return np.divide(known, mean, where=kept & (mean > 0.0), out=np.zeros(mean.shape))

    def _beside(self, stretch: Stretch) -> Array | None:
        """Ones of filtered samples beside rests, `(n, outputs)`; `None` if there are none."""
        resting = np.zeros(stretch.q.shape, dtype=np.bool_)
        if stretch.weights is not None:
            resting |= stretch.weights == 0.0
        if stretch.resting is not None:
            resting |= stretch.resting
        if self.outputs(stretch.q.shape[1]) == 0 or not resting.any():
            return None
        sizes = np.abs(self.matched.taps)
        share = self.over_taps(resting.astype(np.float64), sizes / sizes.sum())
        return (share > RESTING).astype(np.float64)

    def over_taps(self, values: Array, taps: Array) -> Array:
        """Values `(n, N)` summed over the taps at every filtered sample, shape `(n, outputs)`."""
        windows = np.lib.stride_tricks.sliding_window_view(values, len(taps), axis=1)
        kept = windows[:, :: self.matched.decimation][:, : self.outputs(values.shape[1])]
        return np.asarray(kept @ taps)


class _Workspace:
    """Buffers of one call: rows over samples, filtered rows, and the sums as they grow."""

    def __init__(self, accumulator: Accumulator, samples: int) -> None:
        self.accumulator = accumulator
        lanes = accumulator.regressor.code.lanes
        rows = accumulator.width + TILE_ROWS
        decimation = accumulator.matched.decimation
        spare = FIR_OUTPUTS * decimation + len(accumulator.taps)
        self.y = np.zeros((rows, -(-(samples + spare) // lanes) * lanes + PADDING))
        outputs = samples // decimation + FIR_OUTPUTS + lanes
        self.z = np.zeros((rows, -(-outputs // lanes) * lanes + PADDING))
        self.tiling = Tiling.of(accumulator.layout)
        self.unmixed = np.zeros((0, 0))
        if accumulator.mixed:
            self.unmixed = np.zeros((sum(accumulator.regressor.layout.widths), self.y.shape[1]))
        self.sums = np.zeros((len(self.tiling.firsts), TILE_ROWS * TILE_COLUMNS, lanes))
        self.beside = np.zeros_like(self.sums)
        self.absolute = np.zeros((accumulator.width, lanes))
        self.counts = np.zeros(len(accumulator.layout.rows))

    def evaluate(
        self, stretch: Stretch, start: int, count: int, column: int, projection: Array | None
    ) -> None:
        """Write rows of samples `start...` into the buffer from `column` on."""
        code, y = self.accumulator.regressor.code, self.y if projection is None else self.unmixed
        count = min(count, stretch.q.shape[1] - start)
        if count <= 0:
            return
        whole = count - count % code.lanes
        if whole:
            addresses = (
                number
                for x in stretch.inputs
                for number in (x.ctypes.data + 8 * start, x.strides[0] // 8)
            )
            code.raw(whole, *addresses, y.ctypes.data + 8 * column, y.shape[1])
        if whole < count:
            part = slice(start + whole, start + count)
            values = code([x[:, part] for x in stretch.inputs])
            y[: values.shape[0], column + whole : column + count] = values
        if projection is not None and stretch.touching is not None:
            own = projection[start : start + count]
            self.mix(own, stretch.touching.gains, slice(column, column + count))

    def mix(self, projection: Array, gains: Array, at: slice) -> None:
        """Rows of some samples multiplied by a matrix each, `(count, n, n)`, of joints' efforts."""
        layout, n = self.accumulator.regressor.layout, len(gains)
        columns = len(layout.columns)
        dense = np.zeros((len(projection), n, columns + 1))
        for row, (start, seen) in enumerate(zip(layout.starts, layout.sees, strict=True)):
            values = self.unmixed[start : start + len(seen) + 1, at].T
            dense[:, row, list(seen)] = values[:, :-1]
            dense[:, row, -1] = gains[row] * values[:, -1]
        mixed = projection @ dense
        mixed[:, :, -1] /= gains
        self.y[: n * (columns + 1), at] = mixed.reshape(len(projection), -1).T

    def filtered(self, count: int) -> Array:
        """The first `count` filtered samples of the buffer; itself where all pass unchanged."""
        if len(self.accumulator.matched.taps) == 1:
            return self.y
        width, decimation = self.accumulator.width, self.accumulator.matched.decimation
        taps, outputs = self.accumulator.taps, -(-count // FIR_OUTPUTS) * FIR_OUTPUTS
        filter_ = taps.ctypes.data, len(taps), decimation
        loops().fir(*_place(self.y), width, *filter_, outputs, *_place(self.z))
        return self.z

    def add(self, block: Array, count: int, weights: Array | None = None) -> None:
        """Add the first `count` samples of a block of rows, weighted per effort row."""
        if weights is not None:
            self.weigh(block, weights)
        self.add_grams(block, count, self.sums)
        width, absolute = self.accumulator.width, self.absolute.ctypes.data
        loops().absolute(*_place(block), self._padded(count), width, absolute)
        self.counts += count if weights is None else np.count_nonzero(weights, axis=1)

    def weigh(self, block: Array, weights: Array) -> None:
        """Multiply rows by the roots of their weights, shape `(n, count)`."""
        roots = np.repeat(np.sqrt(weights), self.accumulator.layout.widths, axis=0)
        block[: len(roots), : weights.shape[1]] *= roots

    def add_grams(self, block: Array, count: int, sums: Array) -> None:
        """Add the products of the first `count` samples."""
        padded, firsts = self._padded(count), self.tiling.firsts
        block[:, count:padded] = 0.0
        tiles = firsts.ctypes.data, len(firsts)
        loops().gram(*_place(block), padded, *tiles, sums.ctypes.data)

    def _padded(self, count: int) -> int:
        lanes = self.accumulator.regressor.code.lanes
        return -(-count // lanes) * lanes

    def result(self) -> Sums:
        places = self.tiling.cells
        grams, beside = (x.sum(axis=2).ravel()[places] for x in (self.sums, self.beside))
        return Sums(grams, self.absolute.sum(axis=1), self.counts, beside)


def _place(rows: Array) -> tuple[int, int]:
    """Address and row stride of a buffer, as the machine code takes them."""
    return rows.ctypes.data, rows.shape[1]
