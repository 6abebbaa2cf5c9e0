"""The pass over runs: stretches of samples to information, by windows, on several threads."""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from itertools import chain
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from steelyard.base.errors import LogError
from steelyard.base.progress import Progress, report_progress, silent
from steelyard.estimate.information.base_parameters_and_regressor import Regressor
from steelyard.estimate.information.filter_and_gram import (
    Accumulator,
    ParallelFilter,
    Stretch,
    Sums,
)
from steelyard.estimate.information.information import Information, Signature, Window
from steelyard.model.model import Model
from steelyard.runs.run import Block, Run, closed_parts

MOST_WINDOWS = 128  # windows kept per run; beyond that neighbours are merged
PIECE = 1024  # least number of samples of a piece
HALOS = 8  # least length of a piece in halos of the filter, which are evaluated twice
AHEAD = 2  # pieces read ahead per thread
LEAST_WINDOWS = 8  # windows that even a short run is cut into, for the correlation of residuals
SHORTEST = 2  # least length of such a window in halos of the filter

Piece = tuple[Window, Stretch]  # a short stretch of a run, the filter's halo included


def gather(
    regressor: Regressor,
    run: Run,
    *,
    rests: bool = False,
    longest: float = np.inf,
    threads: int = 1,
    progress: Progress = silent,
) -> Information:
    """What one run says about the columns of a regressor, in windows.

    Columns and effort go through the run's parallel filter. With `rests` samples count where a
    joint rests; its friction then lies anywhere in a dead zone, which only friction with memory
    knows. Windows should not be longer than `longest` [s]; merged ones may. A `LogError` says that
    no stretch of the run is as long as the filter, or that an effort never changes.
    """
    accumulator, pieces, signature = start_pass(regressor, run, rests, longest)
    found = accumulate(accumulator, pieces, signature, threads, run.duration, progress)
    if not found.windows:
        raise too_short(accumulator, run)
    return found.with_effective_samples(accumulator.matched.inflation)


def too_short(accumulator: Accumulator, run: Run) -> LogError:
    """What to say if nothing came out: no stretch as long as the filter, or joints rest."""
    taps, model = len(accumulator.matched.taps), accumulator.regressor.model
    lengths, moving, warm = Counter[int](), 0, 0
    for block in blocks_with_channels(run.blocks(), model, lambda block, own: own):
        lengths[block.segment] += len(block.t)
        warm += int(block.moving.any(axis=0).sum())
    for block in run.blocks():
        moving += int(block.moving.any(axis=0).sum())
    longest = max(lengths.values(), default=0)
    if longest < taps:
        return LogError(
            f"no segment of the log is as long as its filter ({taps / run.rate:.2f} s): the "
            f"longest has {longest / run.rate:.2g} s",
            where=run.name,
            fix="log for longer, or raise matched_cutoff in [processing] of the robot file",
        )
    forgotten = f", and friction with memory has forgotten its unknown start in {warm}"
    return LogError(
        f"no sample of the log counts: of {lengths.total()} samples a joint moves in {moving}"
        + (forgotten if model.has_memory else ""),
        where=run.name,
        fix="record a longer and faster motion"
        + (f" (the filter needs {taps / run.rate:.2g} s of it)" if taps > 1 else ""),
    )


def start_pass(
    regressor: Regressor, run: Run, rests: bool, longest: float = np.inf
) -> tuple[Accumulator, Iterator[Piece], Signature]:
    """A pass over a run that has not read anything yet, and what its sums mean; see `gather`."""
    signals = run.recording.signals
    steps = enumerate(zip(signals.effort, run.quality.effort_resolution, strict=True))
    if dead := [c for j, (c, step) in steps if step == 0 and j not in signals.unactuated]:
        # it would be fitted exactly, at the cost of all other joints
        raise LogError(
            f"column '{dead[0]}' never changes: it holds no measured effort",
            where=run.name,
            fix="name the right column in [signals.effort], or leave its joint out of "
            "[robot] joints and lock it; if the joint has no motor, name it as unactuated = "
            "[...] in [signals.effort]",
        )
    matched = ParallelFilter.design(run.matched_cutoff, run.rate)
    base = signals.base
    accumulator = Accumulator(regressor, matched, base is not None and bool(base.touches))
    # samples before the start is forgotten do not count; nor do rests, unless they are wanted
    logged = (replace(x, resting=~x.moving) if rests else x for x in run.blocks())
    blocks = blocks_with_channels(
        logged, regressor.model, lambda block, warm: warm if rests else block.moving & warm
    )
    apart = max(run.duration * run.rate / LEAST_WINDOWS, SHORTEST * accumulator.halo)
    pieces = cut_pieces(blocks, run.name, accumulator, int(min(longest * run.rate, apart)))
    signature = Signature(
        model=regressor.model.fingerprint,
        columns=regressor.layout.columns,
        effort=run.effort_units,
        filters=f"motion {run.motion_cutoff:g} Hz, matched {matched.cutoff:g} Hz",
    )
    return accumulator, pieces, signature


Mask = NDArray[np.bool_]


def blocks_with_channels(
    blocks: Iterable[Block],
    model: Model,
    marked: Callable[[Block, Mask], Mask] = lambda block, warm: block.moving,
) -> Iterator[Block]:
    """The blocks with the model's channels; every segment begins without memory.

    Where open loops are dropped, segments end at them. `marked` gives what takes the place of
    `Block.moving`, for a block and which of its samples the scan has forgotten the start at,
    `(n, B)`.
    """
    drop, number = model.robot.open_loops == "drop", 0
    segment, scan = None, model.scan(drop)
    for block in blocks:
        if block.segment != segment:
            segment, scan, number = block.segment, model.scan(drop), number + 1
        channels = scan(block.q, block.dq, block.ddq, block.t)
        whole = replace(block, segment=number, channels=channels, moving=marked(block, scan.warm))
        yield from closed_parts(whole, scan.closed)
        number += int(np.sum(~scan.closed))


def cut_pieces(
    blocks: Iterable[Block], name: str, accumulator: Accumulator, longest: int = 2**62
) -> Iterator[Piece]:
    """Pieces of a run with the halo they need, from blocks of any size."""
    unit, halo = accumulator.matched.decimation, max(accumulator.halo, 0)
    length = -(-max(1, min(longest, max(PIECE, HALOS * halo))) // unit) * unit
    need, buffered = length + halo, list[Block]()
    for block in chain(blocks, [None]):
        ended = block is None or (len(buffered) > 0 and block.segment != buffered[0].segment)
        if buffered and (ended or sum(len(b.t) for b in buffered) >= need):
            joined = buffered[0] if len(buffered) == 1 else Block.joined(buffered)
            size, start = len(joined.t), 0
            while size - start >= need or (ended and start < size):
                part = joined.part(start, min(start + need, size))
                weights = None if part.moving.all() else part.moving.astype(np.float64)
                if part.weights is not None:
                    weights = part.weights if weights is None else part.weights * weights
                stop = float(part.t[min(length, len(part.t)) - 1])
                motion = part.q, part.dq, part.ddq
                stretch = Stretch(
                    *motion, part.effort, weights, part.channels, part.touching, part.resting
                )
                yield Window(name, float(part.t[0]), stop), stretch
                start += length
            buffered = [] if ended else [joined.part(start, size)]
        if block is not None:
            buffered.append(block)


def accumulate(
    accumulator: Accumulator,
    pieces: Iterable[Piece],
    signature: Signature,
    threads: int = 1,
    duration: float = 0.0,
    progress: Progress = silent,
) -> Information:
    """Sum up pieces, in order, on threads; where windows get too many, neighbours merge."""
    windows, sums, size, filled = list[Window](), list[Sums](), 1, 1
    for (window, _), result in in_order(accumulator, pieces, threads):
        report_progress(progress, f"gathering {window.run}", window.stop, duration)
        if not result.counts.any():
            continue
        if windows and filled < size:
            windows[-1] = replace(windows[-1], stop=window.stop)
            sums[-1] += result
            filled += 1
            continue
        windows.append(window)
        sums.append(result)
        filled = 1
        if len(windows) > MOST_WINDOWS:  # the last one, new and alone, begins a pair
            pairs = zip(windows[:-1:2], windows[1::2], strict=True)
            windows = [*(replace(a, stop=b.stop) for a, b in pairs), windows[-1]]
            for first, second in zip(sums[:-1:2], sums[1::2], strict=True):
                first += second
            sums = [*sums[:-1:2], sums[-1]]
            size *= 2
    layout, beside = accumulator.layout, [x.beside for x in sums]
    return Information(
        layout,
        signature,
        tuple(windows),
        np.reshape([x.grams for x in sums], (len(sums), sum(layout.packed_sizes))),
        np.reshape([x.absolute for x in sums], (len(sums), accumulator.width)),
        np.reshape([x.counts for x in sums], (len(sums), len(layout.rows))),
        np.array(beside) if np.any(beside) else None,
    )


Result = TypeVar("Result")


def in_order(
    work: Callable[[Stretch], Result], pieces: Iterable[Piece], threads: int
) -> Iterator[tuple[Piece, Result]]:
    """Pieces with what was made of them on some threads, in order, a few read ahead."""
    with ThreadPoolExecutor(threads) as pool:
        waiting: list[tuple[Piece, Future[Result]]] = []
        for piece in pieces:
            waiting.append((piece, pool.submit(work, piece[1])))
            if len(waiting) > AHEAD * threads:
                first, future = waiting.pop(0)
                yield first, future.result()
        for first, future in waiting:
            yield first, future.result()
