"""Sums of a run in windows of time: a run of any length has a bounded number of them."""

import numpy as np

from steelyard.arrays import Array
from steelyard.regression.accumulate import Accumulator, Sums
from steelyard.regression.information import Window

MOST_WINDOWS = 128
"""Windows kept per run; beyond that neighbours are merged."""


class Windows:
    """Sums of a run that may be of any length: when windows get too many, neighbours merge."""

    def __init__(self, accumulator: Accumulator) -> None:
        layout = accumulator.regressor.layout
        size = sum(w * (w + 1) // 2 for w in layout.widths)
        self.windows: list[Window] = []
        self._rows = [
            np.empty((MOST_WINDOWS + 1, k))
            for k in (size, accumulator.width, len(layout.rows), size)
        ]
        self._size, self._filled = 1, 1

    def add(self, window: Window, sums: Sums) -> None:
        """Take one more piece."""
        pieces = (sums.grams, sums.absolute, sums.counts, sums.beside)
        if self.windows and self._filled < self._size:
            self.windows[-1] = _spanning(self.windows[-1], window)
            for rows, piece in zip(self._rows, pieces, strict=True):
                rows[len(self.windows) - 1] += piece
            self._filled += 1
            return
        for rows, piece in zip(self._rows, pieces, strict=True):
            rows[len(self.windows)] = piece
        self.windows.append(window)
        self._filled = 1
        if len(self.windows) > MOST_WINDOWS:
            self._merge()

    def _merge(self) -> None:
        """Pair the windows; the last one, new and alone, begins a pair."""
        half = MOST_WINDOWS // 2
        pairs = zip(self.windows[:-1:2], self.windows[1::2], strict=True)
        self.windows = [*(_spanning(a, b) for a, b in pairs), self.windows[-1]]
        for rows in self._rows:
            for k in range(half):
                rows[k] = rows[2 * k] + rows[2 * k + 1]
            rows[half] = rows[MOST_WINDOWS]
        self._size *= 2

    @property
    def sums(self) -> tuple[Array, Array, Array, Array | None]:
        """Gram matrices, sums of |value|, samples, and what is beside rests, one row a window."""
        grams, absolute, counts, beside = (rows[: len(self.windows)] for rows in self._rows)
        return grams, absolute, counts, beside if beside.any() else None


def _spanning(first: Window, second: Window) -> Window:
    return Window(first.run, first.start, second.stop)
