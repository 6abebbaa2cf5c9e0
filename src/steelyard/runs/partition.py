"""A log in parts that are processed in memory, each by itself, by the functions for whole logs.

A part is samples of a segment, and the rows that these depend on: with its margins, which filters
look at, it gives what the whole log gives at its samples. Parts do not depend on each other.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from steelyard.base.arrays import Array
from steelyard.runs.rows.clock import RowPiece
from steelyard.runs.rows.row_checks import Segment

SAMPLES_OF_PART = 8192
"""Samples of a part; more where margins are long."""


@dataclass(frozen=True)
class Margin:
    """What a sample depends on.

    Attributes:
        samples: Samples around it; `None`: all of its segment.
        before: How much further back rows are needed [s].
        after: How much further on rows are needed [s].
        rows: Rows around these.
        rows_per_sample: Rows that are brought to one sample, at least.
    """

    samples: int | None
    before: float
    after: float
    rows: int
    rows_per_sample: int = 1


@dataclass(frozen=True)
class Part:
    """Samples `first` to `stop` of a segment.

    Attributes:
        segment: The segment.
        first: Number of its first sample.
        stop: Number of the one after its last.
        begin: Time from which on rows are its own and not of the part before [s].
        end: Time from which on they are those of the next part [s].
        since: Time from which on rows are needed, its margin included [s].
        until: Time up to which they are needed [s].
        rows: Rows needed around these.
    """

    segment: Segment
    first: int
    stop: int
    begin: float
    end: float
    since: float
    until: float
    rows: int


def partition(segments: Sequence[Segment], rate: float, margin: Margin) -> list[Part]:
    """The parts of a log, in order of time; a segment is one part where samples need all of it."""
    parts, around = [], margin.samples or 0
    for segment in segments:
        size = max(SAMPLES_OF_PART // margin.rows_per_sample, 4 * around, 1)
        if margin.samples is None:
            size = segment.samples
        for first in range(0, segment.samples, size):
            stop = min(first + size, segment.samples)
            begin, end = segment.start + first / rate, segment.start + stop / rate
            since = begin - around / rate - margin.before
            until = end + (around - 1) / rate + margin.after
            if first == 0:
                begin = since = -np.inf
            if stop == segment.samples:
                end = until = np.inf
            parts.append(Part(segment, first, stop, begin, end, since, until, margin.rows))
    return parts


@dataclass(frozen=True, eq=False)
class Window:
    """The rows of a part: time `(N,)` [s] and channels `(N, C)`.

    Rows of the margin that the segment does not have, before and behind, are `lacking`.
    """

    part: Part
    t: Array
    x: Array
    lacking: tuple[int, int]


def windows(pieces: Iterable[RowPiece], parts: Sequence[Part]) -> Iterator[Window]:
    """The rows of each part, of rows that are read from front to back."""
    waiting = {n: list(group) for n, group in groupby(parts, key=lambda p: p.segment.number)}
    for number, of_segment in groupby(pieces, key=lambda piece: piece.segment):
        if number in waiting:
            yield from _of_segment(of_segment, waiting.pop(number))
        if not waiting:
            return


def _of_segment(pieces: Iterator[RowPiece], parts: Sequence[Part]) -> Iterator[Window]:
    held = [next(pieces)]
    for part in parts:
        while sum(len(p.t) - np.searchsorted(p.t, part.until) for p in held) <= part.rows:
            if (piece := next(pieces, None)) is None:
                break
            held.append(piece)
        t, x = held[0].t, held[0].x
        if len(held) > 1:
            t, x = np.concatenate([p.t for p in held]), np.concatenate([p.x for p in held])
        start = int(np.searchsorted(t, part.since, side="right")) - 1 - part.rows
        stop = int(np.searchsorted(t, part.until)) + 1 + part.rows
        lacking = max(0, -start), max(0, stop - len(t))
        start = max(0, start)
        yield Window(part, t[start:stop], x[start:stop], lacking)
        held = [RowPiece(part.segment.number, t[start:], x[start:])]
