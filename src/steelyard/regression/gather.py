"""The pass over runs: stretches of samples to information, on several threads."""

from collections.abc import Generator, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import LogError
from steelyard.measurement.run import Block, Run
from steelyard.progress import Progress, silent, tell
from steelyard.regression.accumulate import Accumulator, Stretch, Sums
from steelyard.regression.information import Information, Stamp, Window
from steelyard.regression.matched import MatchedFilter
from steelyard.regression.regressor import Regressor

MOST_WINDOWS = 256
"""Windows kept per run; longer runs have longer windows."""

SHORTEST_WINDOW = 1024
"""Samples of the shortest window."""

AHEAD = 4
"""Windows read ahead per thread."""


@dataclass(frozen=True, eq=False)
class Piece:
    """One window's samples, the filter's halo included."""

    window: Window
    stretch: Stretch


def gather(
    regressor: Regressor,
    run: Run,
    *,
    matched: bool = True,
    threads: int = 1,
    progress: Progress = silent,
) -> Information:
    """What one run says about the columns of a regressor.

    Args:
        regressor: The columns.
        run: Clean motion and effort on a uniform clock.
        matched: Whether columns and effort go through the run's matched filter.
        threads: Native threads.
        progress: Told about every window.

    Raises:
        Stopped: `progress` asked to stop.
        LogError: No stretch of the run is as long as the filter.
    """
    chosen = MatchedFilter.design(run.matched_cutoff, run.rate) if matched else None
    accumulator = Accumulator(regressor, chosen)
    pieces = cut(run.blocks(), run.name, run.n_samples, accumulator)
    stamp = stamp_of(regressor, run.effort_units, run, chosen)
    found = accumulate(accumulator, pieces, stamp, threads, run.duration, progress)
    if not found.windows:
        need = len(chosen.taps) / run.rate if chosen else 0.0
        raise LogError(
            f"no stretch of the log is as long as its filter ({need:.2f} s)",
            where=run.name,
            mend="log for longer, or raise matched_cutoff in [processing] of the robot file",
        )
    return found


def stamp_of(
    regressor: Regressor, effort: tuple[str, ...], run: Run, matched: MatchedFilter | None
) -> Stamp:
    """What the sums of a run mean."""
    after = "no matched filter" if matched is None else f"matched {matched.cutoff:g} Hz"
    return Stamp(
        model=regressor.model.fingerprint,
        columns=regressor.layout.columns,
        effort=effort,
        filters=f"motion {run.motion_cutoff:g} Hz, {after}",
        inflation=1.0 if matched is None else matched.inflation,
    )


def cut(
    blocks: Iterable[Block], name: str, n_samples: int, accumulator: Accumulator
) -> Iterator[Piece]:
    """Windows of a run with the halo they need, read from blocks of any size."""
    unit = accumulator.decimation
    length = max(SHORTEST_WINDOW, -(-n_samples // MOST_WINDOWS))
    length = -(-length // unit) * unit
    need = length + max(accumulator.halo, 0)
    held: list[Block] = []
    for block in blocks:
        if held and block.segment != held[0].segment:
            yield from _windows(held, name, length, need, last=True)
            held = []
        held.append(block)
        if sum(len(b.t) for b in held) >= need:
            rest = yield from _windows(held, name, length, need, last=False)
            held = [rest]
    if held:
        yield from _windows(held, name, length, need, last=True)


def _windows(
    held: list[Block], name: str, length: int, need: int, last: bool
) -> Generator[Piece, None, Block]:
    """The windows that the samples held suffice for; returns the samples that are left."""
    joined = held[0] if len(held) == 1 else Block.joined(held)
    start = 0
    while len(joined.t) - start >= need or (last and start < len(joined.t)):
        yield _piece(joined.part(start, min(start + need, len(joined.t))), name, length)
        start += length
    return joined.part(start, len(joined.t))


def _piece(block: Block, name: str, length: int) -> Piece:
    weights = None if block.moving.all() else block.moving.astype(np.float64)
    window = Window(name, float(block.t[0]), float(block.t[min(length, len(block.t)) - 1]))
    return Piece(window, Stretch(block.q, block.dq, block.ddq, block.effort, weights))


def accumulate(
    accumulator: Accumulator,
    pieces: Iterable[Piece],
    stamp: Stamp,
    threads: int = 1,
    duration: float = 0.0,
    progress: Progress = silent,
) -> Information:
    """Sum up pieces, in order, on some threads; the result does not depend on their number."""
    windows: list[Window] = []
    sums: list[Sums] = []

    def keep(piece: Piece, result: Sums) -> None:
        if result.counts.any():
            windows.append(piece.window)
            sums.append(result)
        tell(progress, f"gathering {piece.window.run}", piece.window.stop, duration)

    with ThreadPoolExecutor(threads) as pool:
        waiting: list[tuple[Piece, Future[Sums]]] = []
        for piece in pieces:
            waiting.append((piece, pool.submit(accumulator, piece.stretch)))
            if len(waiting) > AHEAD * threads:
                first, future = waiting.pop(0)
                keep(first, future.result())
        for first, future in waiting:
            keep(first, future.result())
    layout = accumulator.regressor.layout
    return Information(
        layout,
        stamp,
        tuple(windows),
        _stacked([s.grams for s in sums], sum(w * (w + 1) // 2 for w in layout.widths)),
        _stacked([s.absolute for s in sums], sum(layout.widths)),
        _stacked([s.counts for s in sums], len(layout.rows)),
    )


def _stacked(rows: list[Array], width: int) -> Array:
    return np.array(rows).reshape(len(rows), width)
