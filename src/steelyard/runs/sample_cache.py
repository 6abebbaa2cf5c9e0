"""Samples of a run that its first whole pass keeps for the next ones, in memory or on disk."""

import pickle
import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple
from weakref import WeakSet, finalize

import numpy as np

from steelyard.base.arrays import Array
from steelyard.runs.processing_chain import Chain, MotionPart
from steelyard.runs.recording import LeftOut, Recording
from steelyard.runs.rows.bridged_rows_segments_and_quality import Segment

BLOCK_SAMPLES = 4096  # samples that are kept, and handed out, at a time
KEPT = 2**20  # values up to which motion and efforts of a run stay in memory: 8 MiB
LEAST_FREE = 4.0  # free space of the disk over what the samples of a run may take there
MOST_FILES = 128  # temporary files that are open at a time


@dataclass(frozen=True, eq=False)
class Source:
    """What samples are made from."""

    recording: Recording
    chain: Chain
    segments: tuple[Segment, ...]

    def alike(self, other: "Source") -> bool:
        """Whether the other gives the same samples; drive gains do not count."""
        mine, its = self.recording, other.recording
        made = (self.chain, self.segments, mine.log, mine.middles)
        its_own = (other.chain, other.segments, its.log, its.middles)
        same = all(one is another for one, another in zip(made, its_own, strict=True))
        same = same and mine.cut == its.cut and _rows_out(mine) == _rows_out(its)
        return same and mine.signals.reads_alike(its.signals)

    @property
    def size(self) -> int:
        """Number of values, weights of flagged efforts included."""
        channels = self.recording.channels
        rows = (5 if self.chain.flagged else 4) * channels.joints + channels.touches
        return rows * sum(segment.samples for segment in self.segments)


def _rows_out(recording: Recording) -> list[LeftOut]:
    """Stretches of which no row is used; where efforts do not count is said of blocks."""
    return [stretch for stretch in recording.left_out if not stretch.joints]


class _Kept(NamedTuple):
    """A part that can be had again."""

    segment: int
    first: int
    samples: int
    get: Callable[[], MotionPart]


class KeptSamples:
    """What a first whole pass leaves for the next ones; nothing in another process.

    Without a temporary file, such as on a full disk, the next pass reads the log anew.
    """

    def __init__(self) -> None:
        self.source: Source | None = None
        self._parts: list[_Kept] = []

    def __reduce__(self) -> tuple[type["KeptSamples"], tuple[()]]:
        return KeptSamples, ()  # another process reads the log itself

    def of(self, source: Source) -> bool:
        """Whether samples from this source are kept."""
        return self.source is not None and self.source.alike(source)

    def keeping(self, source: Source, made: Iterable[MotionPart]) -> Iterator[MotionPart]:
        """Parts as they are made, in order; they stay once the last is taken."""
        in_memory, found = source.size <= KEPT, list[_Kept]()
        file = None if in_memory else _temporary_file(8 * source.size)
        keeps = in_memory or file is not None
        for part in made:
            for block in _blocks(part) if keeps else ():
                try:
                    get = partial(replace, block) if file is None else file.written(block)
                except OSError:
                    keeps = False
                    break
                found.append(_Kept(part.segment.number, block.first, block.signals.shape[1], get))
            yield part
        if keeps:
            self.source, self._parts = source, found

    def between(self, ranges: Mapping[int, tuple[int, int]]) -> Iterator[MotionPart]:
        """Parts that have some of the samples wanted: from the first to the last, by segment."""
        for kept in self._parts:
            first, last = ranges[kept.segment]
            if kept.first < last and first < kept.first + kept.samples:
                yield kept.get()

    def displaced(self, change: Array, source: Source) -> "KeptSamples":
        """What a run from `source` leaves, with other positions by `change`, shape `(n, 1)`."""

        def moved(get: Callable[[], MotionPart]) -> MotionPart:
            part, n = get(), len(change)
            signals = np.concatenate([part.signals[:n] + change, part.signals[n:]])
            return replace(part, signals=signals)

        found = KeptSamples()
        found.source = source
        found._parts = [kept._replace(get=partial(moved, kept.get)) for kept in self._parts]
        return found


def _blocks(part: MotionPart) -> Iterator[MotionPart]:
    """A part in blocks that hold no more memory than their own."""
    for start in range(0, part.signals.shape[1], BLOCK_SAMPLES):
        inside = slice(start, start + BLOCK_SAMPLES)
        weights = None if part.weights is None else part.weights[:, inside].copy()
        signals = part.signals[:, inside].copy()
        yield replace(part, first=part.first + start, signals=signals, weights=weights)


class _File:
    """A temporary file of parts, closed with the last of those that read it."""

    def __init__(self) -> None:
        self._file = tempfile.TemporaryFile()
        finalize(self, self._file.close)
        _files.add(self)

    def written(self, part: MotionPart) -> Callable[[], MotionPart]:
        """Write a part at the end; how it is read again."""
        start = self._file.seek(0, 2)
        pickle.dump(part, self._file, pickle.HIGHEST_PROTOCOL)
        self._file.flush()

        def read() -> MotionPart:
            self._file.seek(start)
            part: MotionPart = pickle.load(self._file)
            return part

        return read


_files: "WeakSet[_File]" = WeakSet()


def _temporary_file(size: int) -> _File | None:
    """A file with room for that many bytes; `None` if there is none."""
    with suppress(OSError):
        free = shutil.disk_usage(tempfile.gettempdir()).free
        if len(_files) < MOST_FILES and free > LEAST_FREE * size:
            return _File()
    return None
