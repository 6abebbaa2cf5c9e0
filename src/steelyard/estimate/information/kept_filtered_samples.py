"""Filtered samples, bounded in number, and the pass over a run that keeps them."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array, frozen
from steelyard.base.progress import Progress, report_progress, silent
from steelyard.estimate.information.base_parameters_and_regressor import Layout, Regressor
from steelyard.estimate.information.filter_and_gram import Accumulator
from steelyard.estimate.information.gather import Piece, in_order, start_pass, too_short
from steelyard.estimate.information.information import Information, Signature, Window, packed
from steelyard.runs.motion_error_from_noise import MotionError, motion_error
from steelyard.runs.run import Run

Index = NDArray[np.intp]
Mask = NDArray[np.bool_]

_AT_INSTANTS = ("t", "q", "dq", "ddq", "channels")

WINDOWS = 24  # windows that a run's samples are summed up in


@dataclass(frozen=True, eq=False)
class SampledRun:
    """A run that samples come from, and the noise of its motion behind the filters."""

    run: str
    share: float  # independent samples that a stored one is worth
    error: MotionError


@dataclass(frozen=True, eq=False)
class FilteredSamples:
    """Instants of some runs, and per effort row what it saw at those of them that count for it."""

    layout: Layout  # names, and what each row sees
    signature: Signature  # what the samples mean
    sources: tuple[SampledRun, ...]  # the runs, in any order
    source: Index  # number of the run of each instant, `(N,)`
    t: Array  # time of each instant from its log's start, `(N,)` [s]
    q: Array  # positions at the instants, not behind the parallel filter, `(N, n)` [rad; m]
    dq: Array  # velocities, the same shape [rad/s; m/s]
    ddq: Array  # accelerations, the same shape [rad/s²; m/s²]
    channels: Array  # what the model computed along the motion, `(N, n_channels)`
    # per effort row `[columns that row sees | effort]` behind the parallel filter, `(N_j, k_j + 1)`
    rows: tuple[Array, ...]
    weights: tuple[Array, ...]  # per effort row the weight of each of its samples, `(N_j,)`
    # per effort row the number of the instant of each of its samples, `(N_j,)`
    at: tuple[Index, ...]

    def __len__(self) -> int:
        return len(self.t)

    def __add__(self, other: "FilteredSamples") -> "FilteredSamples":
        """The samples of both; a `DataError` says in what they differ."""
        mine, theirs = ", ".join(self.runs), ", ".join(other.runs)
        self.signature.refuse_unlike(other.signature, f"runs {mine} and {theirs}")
        at = tuple(
            np.concatenate([a, b + len(self)]) for a, b in zip(self.at, other.at, strict=True)
        )
        joined: dict[str, Any] = {
            name: np.concatenate([getattr(self, name), getattr(other, name)])
            for name in _AT_INSTANTS
        }
        return replace(
            self,
            sources=self.sources + other.sources,
            source=np.concatenate([self.source, other.source + len(self.sources)]),
            rows=_joined(self.rows, other.rows),
            weights=_joined(self.weights, other.weights),
            at=at,
            **joined,
        )

    @property
    def runs(self) -> tuple[str, ...]:
        """Names of the runs."""
        return tuple(dict.fromkeys(source.run for source in self.sources))

    @cached_property
    def shares(self) -> tuple[Array, ...]:
        """Per effort row what each sample is worth in independent ones, shape `(N_j,)`."""
        shares = np.array([source.share for source in self.sources])
        return tuple(shares[self.source[at]] for at in self.at)

    def of(self, kept: Mask) -> "FilteredSamples":
        """Some of the instants, marked by `kept`, shape `(N,)`."""
        number = np.cumsum(kept) - 1
        mine = [kept[at] for at in self.at]
        return replace(
            self,
            source=self.source[kept],
            **{name: getattr(self, name)[kept] for name in _AT_INSTANTS},
            rows=tuple(x[k] for x, k in zip(self.rows, mine, strict=True)),
            weights=tuple(x[k] for x, k in zip(self.weights, mine, strict=True)),
            at=tuple(number[at[k]] for at, k in zip(self.at, mine, strict=True)),
        )

    def during(self, windows: Sequence[Window]) -> "FilteredSamples":
        """The samples in some windows of their runs."""
        kept = np.zeros(len(self), dtype=np.bool_)
        for window in windows:
            mine = [k for k, source in enumerate(self.sources) if source.run == window.run]
            inside = (self.t >= window.start) & (self.t <= window.stop)
            kept |= inside & np.isin(self.source, mine)
        return self.of(kept)

    def scaled(self, gains: Array, units: Sequence[str]) -> "FilteredSamples":
        """The same samples with each row's effort multiplied by a gain, in its new unit."""
        rows = []
        for row, gain in zip(self.rows, gains, strict=True):
            changed = row.copy()
            changed[:, -1] *= gain
            rows.append(frozen(changed))
        return replace(
            self, rows=tuple(rows), signature=replace(self.signature, effort=tuple(units))
        )

    def residuals(self, values: Array) -> tuple[Array, ...]:
        """Effort not explained by parameters `(p,)`, per row, shape `(N_j,)`."""
        return tuple(
            row[:, -1] - row[:, :-1] @ values[list(seen)]
            for row, seen in zip(self.rows, self.layout.sees, strict=True)
        )

    def information(self, weights: Sequence[Array] | None = None) -> Information:
        """Sums over the samples, counted as what they are worth, in some windows per run.

        Further weights of each row's samples are `(N_j,)`; a sample of weight 0 does not count.
        """
        given = [np.ones(len(w)) for w in self.weights] if weights is None else weights
        total = [w * g for w, g in zip(self.weights, given, strict=True)]
        worth = [np.ones(len(w)) for w in self.weights]
        if self.layout.mixed:
            worth = list(self.weights)
        windows, sums = [], []
        for number, source in enumerate(self.sources):
            order = np.flatnonzero(self.source == number)
            order = order[np.argsort(self.t[order], kind="stable")]
            for part in filter(len, np.array_split(order, WINDOWS)):
                windows.append(Window(source.run, float(self.t[part[0]]), float(self.t[part[-1]])))
                sums.append(self._sums(source.share, part, total, worth))
        grams, absolute, counts = zip(*sums, strict=True) if sums else ((), (), ())
        return Information(
            self.layout,
            self.signature,
            tuple(windows),
            np.reshape(grams, (len(sums), sum(self.layout.packed_sizes))),
            np.reshape(absolute, (len(sums), sum(self.layout.widths))),
            np.reshape(counts, (len(sums), len(self.rows))),
        )

    def _sums(
        self, share: float, instants: Index, weights: Sequence[Array], worth: Sequence[Array]
    ) -> tuple[Array, Array, Array]:
        """Packed Gram matrices, sums of |value| and counts of some instants of a run.

        A sample of a weight counts as what it is worth, `(N_j,)`.
        """
        mine = np.zeros(len(self), dtype=np.bool_)
        mine[instants] = True
        grams, absolute, counts = [], [], []
        for row, weight, one, at in zip(self.rows, weights, worth, self.at, strict=True):
            here = mine[at]
            part = row[here] * np.sqrt(weight[here])[:, None]
            grams.append(share * packed(part.T @ part))
            absolute.append(share * np.abs(part).sum(axis=0))
            counts.append(share * float(one[here][weight[here] > 0.0].sum()))
        return np.concatenate(grams), np.concatenate(absolute), np.array(counts)


def _joined(first: tuple[Array, ...], second: tuple[Array, ...]) -> tuple[Array, ...]:
    return tuple(np.concatenate([a, b]) for a, b in zip(first, second, strict=True))


MOST_SAMPLES_PER_ROW = 20_000  # samples kept per effort row of a run


def gather_samples(
    regressor: Regressor,
    run: Run,
    *,
    rests: bool | None = None,
    most: int = MOST_SAMPLES_PER_ROW,
    threads: int = 1,
    progress: Progress = silent,
) -> FilteredSamples:
    """Filtered samples of one run: every one of a short run, every 2nd, 4th, ... of a longer one.

    At most `most` samples are kept per effort row; memory holds twice as many. Samples at rest
    count where the model has memory, if `rests` does not say. Other arguments and errors are those
    of `gather`.
    """
    wanted = regressor.model.has_memory if rests is None else rests
    accumulator, pieces, signature = start_pass(regressor, run, wanted)
    layout, n = accumulator.layout, len(regressor.layout.rows)
    kept = _Kept(max(1, most), n)
    for piece, found in in_order(accumulator.rows, pieces, threads):
        kept.add(_instants(accumulator, piece, run.rate, *found))
        report_progress(progress, f"gathering {run.name}", piece[0].stop, run.duration)
    if not kept.parts:
        raise too_short(accumulator, run)
    chosen = accumulator.matched
    share = 1.0 / replace(chosen, decimation=chosen.decimation * kept.step).inflation
    error = motion_error(run, chosen.taps)
    ends = np.cumsum([1, 1, n, n, n, regressor.model.n_channels, accumulator.width])
    _, (t,), *motion, rows, weights = np.split(np.concatenate(kept.parts, axis=1), ends)
    q, dq, ddq, channels = (frozen(x.T) for x in motion)
    at = tuple(np.flatnonzero(weight) for weight in weights)
    return FilteredSamples(
        layout=layout,
        signature=signature,
        sources=(SampledRun(run.name, share, error),),
        source=np.zeros(len(t), dtype=np.intp),
        t=frozen(t),
        q=q,
        dq=dq,
        ddq=ddq,
        channels=channels,
        rows=tuple(
            frozen(rows[start : start + width, k].T)
            for start, width, k in zip(layout.starts, layout.widths, at, strict=True)
        ),
        weights=tuple(frozen(w[k]) for w, k in zip(weights, at, strict=True)),
        at=at,
    )


def in_units_of_joints(
    regressor: Regressor, runs: Sequence[Run], threads: int, progress: Progress
) -> Iterator[FilteredSamples]:
    """Filtered samples of each run, efforts in the joints' units."""
    units = regressor.model.robot.effort_units
    for run in runs:
        samples = gather_samples(regressor, run, threads=threads, progress=progress)
        yield samples.scaled(run.recording.signals.gains, units)


class _Kept:
    """Parts of a run of any length; beyond `most` samples in a row, every other one goes.

    A part has a column per instant: its number, what the run has there, the weights of `n` rows.
    """

    def __init__(self, most: int, n: int) -> None:
        self.parts: list[Array] = []
        self.step = 1
        self._most, self._n, self._seen, self._counts = most, n, 0, np.zeros(n)

    def add(self, part: Array) -> None:
        """Take in the next samples; kept are those whose number is a multiple of the step."""
        part[0] += self._seen
        self._seen += part.shape[1]
        self._hold(part)
        while self._counts.max(initial=0) > self._most:
            self.step *= 2
            buffered, self.parts, self._counts = self.parts, [], np.zeros(self._n)
            for old in buffered:
                self._hold(old)

    def _hold(self, part: Array) -> None:
        counted = (part[0] % self.step == 0) & part[-self._n :].any(axis=0)
        if counted.any():
            self.parts.append(part[:, counted])
            self._counts += np.count_nonzero(self.parts[-1][-self._n :], axis=1)


def _instants(
    accumulator: Accumulator, piece: Piece, rate: float, rows: Array, weights: Array
) -> Array:
    """Filtered samples with the motion in the middle of the filter, a column each."""
    window, stretch = piece
    middle = (len(accumulator.matched.taps) - 1) // 2
    numbers = np.arange(rows.shape[1])
    at = middle + accumulator.matched.decimation * numbers
    motion = (x[:, at] for x in stretch.inputs[:-1])
    return np.vstack([numbers, window.start + at / rate, *motion, rows, weights])
