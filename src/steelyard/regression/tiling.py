"""Tiles in which the Gram matrices of all rows are summed up."""

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from steelyard.kernel.native.native_loops import TILE_COLUMNS, TILE_ROWS
from steelyard.regression.regressor import Layout


@dataclass(frozen=True, eq=False)
class Tiling:
    """Tiles that cover the lower triangles of all rows' Gram matrices.

    Attributes:
        firsts: First rows `(a, b)` of each tile, shape `(tiles, 2)`.
        cells: Where each packed Gram entry lies among the tiles' sums.
    """

    firsts: NDArray[np.int64]
    cells: NDArray[np.int64]

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
