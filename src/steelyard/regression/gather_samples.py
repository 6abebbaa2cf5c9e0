"""The pass over a run that keeps samples: as `gather`, but thinned out instead of summed up."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array, frozen
from steelyard.measurement.noise_propagation import motion_error
from steelyard.measurement.run import Run
from steelyard.progress import Progress, report_progress, silent
from steelyard.regression.accumulate import Accumulator, Stretch
from steelyard.regression.gather import Piece, in_order, start_pass
from steelyard.regression.information import Signature
from steelyard.regression.regressor import Layout, Regressor
from steelyard.regression.samples import Samples, Source

MOST = 20_000
"""Samples kept per effort row of a run."""


def gather_samples(
    regressor: Regressor,
    run: Run,
    *,
    matched: bool = True,
    rests: bool = False,
    most: int = MOST,
    threads: int = 1,
    progress: Progress = silent,
) -> Samples:
    """Filtered samples of one run: every one of a short run, every 2nd, 4th, ... of a longer one.

    Args:
        regressor: The columns.
        run: Clean motion and effort on a uniform clock.
        matched: Whether columns and effort go through the run's parallel filter.
        rests: Whether samples count where a joint rests, see `gather`.
        most: Samples kept per effort row; memory holds twice as many.
        threads: Native threads.
        progress: Told about every piece.

    Raises:
        Stopped: `progress` requested a stop.
        LogError: No stretch of the run is as long as the filter, or an effort never changes.
    """
    gram_pass = start_pass(regressor, run, matched, rests)
    accumulator, kept = gram_pass.accumulator, _Kept(max(1, most))
    for piece, found in in_order(accumulator.rows, gram_pass.pieces, threads):
        kept.add(_instants(accumulator, piece, run.rate, *found))
        report_progress(progress, f"gathering {piece.window.run}", piece.window.stop, run.duration)
    if not kept.parts:
        raise gram_pass.too_short()
    chosen = accumulator.matched
    share = 1.0
    if chosen is not None:
        share /= replace(chosen, decimation=chosen.decimation * kept.step).inflation
    error = motion_error(run, None if chosen is None else chosen.taps)
    return _samples(
        regressor.layout, gram_pass.signature, Source(run.name, share, error), kept.parts
    )


def _samples(layout: Layout, signature: Signature, source: Source, parts: "list[_Part]") -> Samples:
    """Parts of one run, and what each row saw at the instants that count for it."""
    whole = _Part.joined(parts)
    at = tuple(np.flatnonzero(weight) for weight in whole.weights)
    return Samples(
        layout=layout,
        signature=signature,
        sources=(source,),
        source=np.zeros(len(whole.t), dtype=np.intp),
        t=frozen(whole.t),
        q=frozen(whole.q.T),
        dq=frozen(whole.dq.T),
        ddq=frozen(whole.ddq.T),
        channels=frozen(whole.channels.T),
        rows=tuple(
            frozen(whole.rows[start : start + width, k].T)
            for start, width, k in zip(layout.starts, layout.widths, at, strict=True)
        ),
        weights=tuple(frozen(w[k]) for w, k in zip(whole.weights, at, strict=True)),
        at=at,
    )


@dataclass(frozen=True, eq=False)
class _Part:
    """Instants of a piece at which any row counts, joint-major.

    Attributes:
        numbers: Which filtered samples of the run they are, shape `(M,)`.
        t: Their times, shape `(M,)` [s].
        q: Shape `(n, M)`; likewise `dq`, `ddq` and `channels`.
        rows: Columns and efforts as `Layout.starts` says, shape `(width, M)`.
        weights: Shape `(n, M)`.
    """

    numbers: NDArray[np.intp]
    t: Array
    q: Array
    dq: Array
    ddq: Array
    channels: Array
    rows: Array
    weights: Array

    @property
    def _arrays(self) -> tuple[NDArray[np.generic], ...]:
        return tuple(vars(self).values())

    def of(self, kept: NDArray[np.bool_]) -> "_Part":
        """Some of the instants."""
        return _Part(*(x[..., kept] for x in self._arrays))  # type: ignore[arg-type]

    @classmethod
    def joined(cls, parts: "list[_Part]") -> "_Part":
        """Parts one after another."""
        columns = zip(*(part._arrays for part in parts), strict=True)
        return cls(*(np.concatenate(column, axis=-1) for column in columns))


class _Kept:
    """Parts of a run of any length; beyond `most` samples in a row, every other one goes."""

    def __init__(self, most: int) -> None:
        self.parts: list[_Part] = []
        self.step = 1
        self._most, self._seen, self._counts = most, 0, np.zeros(1)

    def add(self, part: _Part) -> None:
        """Take in the next samples; kept are those whose number is a multiple of the step."""
        self._seen, first = self._seen + len(part.t), self._seen
        numbered = replace(part, numbers=part.numbers + first)
        self._hold(numbered)
        while self._counts.max(initial=0) > self._most:
            self.step *= 2
            buffered, self.parts, self._counts = self.parts, [], np.zeros(1)
            for old in buffered:
                self._hold(old)

    def _hold(self, part: _Part) -> None:
        counted = (part.numbers % self.step == 0) & part.weights.any(axis=0)
        if counted.any():
            self.parts.append(part.of(counted))
            self._counts = self._counts + np.count_nonzero(self.parts[-1].weights, axis=1)


def _instants(
    accumulator: Accumulator, piece: Piece, rate: float, rows: Array, weights: Array
) -> _Part:
    """Filtered samples with the motion in the middle of the filter."""
    stretch: Stretch = piece.stretch
    count, unit = rows.shape[1], accumulator.decimation
    middle = (len(accumulator.matched.taps) - 1) // 2 if accumulator.matched else 0
    at = middle + unit * np.arange(count)
    q, dq, ddq, channels, _ = (x[:, at] for x in stretch.inputs)
    t = piece.window.start + at / rate
    return _Part(np.arange(count), t, q, dq, ddq, channels, rows, weights)
