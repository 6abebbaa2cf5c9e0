"""Files of named arrays as one table: which arrays are its columns, and what those are called."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Protocol

from steelyard.arrays import Array
from steelyard.errors import LogError
from steelyard.formats.log import PART, Rows, require_columns

WIDEST = 4096
"""Columns that one array may have."""

LEAST_ROWS = 2

BUDGET = 1 << 23
"""Bytes of a part, about."""


@dataclass(frozen=True)
class Member:
    """An array of numbers in a file.

    Attributes:
        name: Its name in the file, with the path to it.
        shape: One axis or two.
        labels: Names of its columns, if it knows them; it has one axis then.
        left_out: Why it is no part of any table; empty if it may be.
    """

    name: str
    shape: tuple[int, ...]
    labels: tuple[str, ...] = ()
    left_out: str = ""

    def axis(self, rows: int) -> int | None:
        """Which axis has that many rows; `None` if none has."""
        return next((axis for axis, length in enumerate(self.shape) if length == rows), None)

    def width(self, axis: int) -> int:
        """Number of columns if the rows lie along `axis`."""
        if self.labels:
            return len(self.labels)
        return self.shape[1 - axis] if len(self.shape) == 2 else 1

    def columns(self, axis: int) -> tuple[str, ...]:
        """`q` alone, or `q_1` to `q_k`."""
        if self.labels:
            return self.labels
        width = self.width(axis)
        if width == 1:
            return (self.name,)
        return tuple(f"{self.name}_{number}" for number in range(1, width + 1))


@dataclass(frozen=True)
class Place:
    """Where a column is: a component of an array.

    Attributes:
        member: Number of the array.
        axis: The array's axis that the rows lie along.
        component: Index along the other axis, or of the label.
    """

    member: int
    axis: int
    component: int


class Reader(Protocol):
    """Reads components of a file's arrays side by side."""

    def __call__(
        self, places: Sequence[Place], rows: tuple[int, int], size: int
    ) -> Iterator[Array]:
        """Rows from the first to before the second, in arrays `(at most size, len(places))`.

        Raises:
            LogError: The file turns out to be broken.
        """
        ...


@dataclass(frozen=True)
class ArraysLog:
    """Arrays of one length as a table.

    A vector `t` is the column `t`; a matrix `q` of k columns, or of k rows, is `q_1` to `q_k`. The
    length that most numbers have in common is that of the table. Arrays of other lengths, and what
    is not made of real numbers, are left out.

    Attributes:
        path: Where the file is.
        columns: Names of its columns.
        places: Where each column is.
        n_rows: Number of rows.
        left_out: Name and reason of each array that is no part of the table.
        read: Reads some of the columns.
    """

    path: Path
    columns: tuple[str, ...]
    places: tuple[Place, ...]
    n_rows: int
    left_out: tuple[tuple[str, str], ...]
    read: Reader

    @classmethod
    def of(cls, path: Path, members: Sequence[Member], read: Reader) -> "ArraysLog":
        """The table in a file.

        Raises:
            LogError: There is none.
        """
        n_rows = _common_length(members)
        columns: list[tuple[str, ...]] = []
        places: list[tuple[Place, ...]] = []
        left_out = []
        for number, member in enumerate(members):
            axis = None if member.left_out else member.axis(n_rows)
            if axis is None or n_rows < LEAST_ROWS:
                left_out.append((member.name, member.left_out or _other(member, n_rows)))
            elif member.width(axis) > WIDEST:
                left_out.append((member.name, f"more than {WIDEST} columns"))
            else:
                columns.append(member.columns(axis))
                width = range(len(columns[-1]))
                places.append(tuple(Place(number, axis, component) for component in width))
        if not columns:
            raise _nothing(path, left_out)
        names, where = tuple(chain(*columns)), tuple(chain(*places))
        return cls(path, names, where, n_rows, tuple(left_out), read)

    def parts(
        self, columns: Sequence[str], rows: Rows = (0, None), size: int = PART
    ) -> Iterator[Array]:
        """The requested rows, in parts; see `Log`."""
        for column in columns:
            self._require(column)
        require_columns(self.path, self.columns, columns)
        wanted = [self.places[self.columns.index(column)] for column in columns]
        start, stop = rows[0], self.n_rows if rows[1] is None else min(rows[1], self.n_rows)
        widths = Counter((place.member, place.axis) for place in self.places)
        used = {(place.member, place.axis) for place in wanted}
        row = 8 * (len(wanted) + sum(widths[key] for key in used))
        if start < stop:
            yield from self.read(wanted, (start, stop), max(1, min(size, BUDGET // row)))

    def _require(self, column: str) -> None:
        for name, why in self.left_out:
            if column == name and column not in self.columns:
                raise LogError(
                    f"'{name}' is no column of the table: {why}",
                    where=str(self.path),
                    fix=f"its columns are {', '.join(self.columns[:8])}"
                    f"{', ...' if len(self.columns) > 8 else ''}",
                )


def _common_length(members: Sequence[Member]) -> int:
    """The length that most numbers share, along the longer axis of each array."""
    votes: Counter[int] = Counter()
    for member in members:
        if member.shape and not member.left_out:
            axis = max(range(len(member.shape)), key=lambda a: member.shape[a])
            votes[member.shape[axis]] += member.shape[axis] * min(member.width(axis), WIDEST)
    return max(votes, key=lambda length: (votes[length], length), default=0)


def _other(member: Member, n_rows: int) -> str:
    shape = " x ".join(map(str, member.shape))
    return f"its size is {shape}, where the table has {n_rows} rows" if shape else "one number"


def _nothing(path: Path, left_out: Sequence[tuple[str, str]]) -> LogError:
    found = "; ".join(f"'{name}': {why}" for name, why in left_out[:4])
    return LogError(
        f"the file holds no table of numbers{f' ({found})' if found else ''}",
        where=str(path),
        fix="store time and the joints' signals as arrays with one row per sample, such as "
        "t (N), q (N x joints), tau (N x joints)",
    )
