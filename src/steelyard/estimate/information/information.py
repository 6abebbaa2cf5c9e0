"""What data say about parameters: sums of products, additive and of constant size.

Per effort row the Gram matrix of `[columns that row sees | effort]`, the sums of |column| and
|effort|, and the number of samples; kept per window of time.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array, by_key, frozen
from steelyard.base.errors import DataError
from steelyard.estimate.information.base_parameters_and_regressor import Layout


@dataclass(frozen=True)
class Signature:
    """What must be equal before two pieces of information can be added."""

    model: str
    columns: tuple[str, ...]
    effort: tuple[str, ...]  # unit of the effort per row
    filters: str  # description of the filters

    def refuse_unlike(self, other: "Signature", where: str) -> None:
        """Refuse to add what means something else: a `DataError` says in what they differ."""
        for field in ("model", "columns", "effort", "filters"):
            mine, theirs = getattr(self, field), getattr(other, field)
            if mine != theirs:
                wrong = f"information of unequal {field} cannot be added ({mine} and {theirs})"
                fix = "gather both with the same robot file and the same cut-offs"
                raise DataError(wrong, where=where, fix=fix)


@dataclass(frozen=True)
class Window:
    """A stretch of one run [s]."""

    run: str
    start: float
    stop: float


@dataclass(frozen=True, eq=False, repr=False)
class Information:
    """Sums over samples, per window.

    Attributes:
        layout: Names, and what each row sees.
        signature: What the sums mean.
        windows: One label per window, `w` of them.
        grams: Lower triangles of all rows' Gram matrices one after another, shape `(w, size)`.
        absolute: Sums of |column| and |effort| of all rows, shape `(w, width)`.
        counts: Samples per window and row, shape `(w, rows)`; behind a filter, which makes
            neighbours alike, as many as there are independent ones; of rows without the forces of
            contacts, as much as is left of them.
        beside: Of `grams`, the part of samples beside rests, see `Sums`; `None` if there are none.

    Example:
        >>> runs = load_runs("arm.toml", ["fit.csv", "other.csv"])
        >>> first, second = (information(model_of("arm.toml"), [run]) for run in runs)
        >>> len((first + second).windows) == len(first.windows) + len(second.windows)
        True
    """

    layout: Layout
    signature: Signature
    windows: tuple[Window, ...]
    grams: Array
    absolute: Array
    counts: Array
    beside: Array | None = None

    def __repr__(self) -> str:
        columns, runs = len(self.layout.columns), len(self.windows_of_runs)
        return f"Information({columns} columns, {len(self.windows)} windows of {runs} runs)"

    def __add__(self, other: "Information") -> "Information":
        """All windows of both; a `DataError` says in what they differ."""
        self.signature.refuse_unlike(other.signature, f"runs {self.runs} and {other.runs}")
        parts = [np.zeros_like(x.grams) if x.beside is None else x.beside for x in (self, other)]
        beside = None if self.beside is other.beside is None else np.concatenate(parts)
        return replace(
            self,
            windows=self.windows + other.windows,
            grams=np.concatenate([self.grams, other.grams]),
            absolute=np.concatenate([self.absolute, other.absolute]),
            counts=np.concatenate([self.counts, other.counts]),
            beside=beside,
        )

    def _changed(
        self, change: Callable[[Array], Array], windows: tuple[Window, ...]
    ) -> "Information":
        """The same with all sums changed, which are then those of some windows."""
        return replace(
            self,
            windows=windows,
            grams=change(self.grams),
            absolute=change(self.absolute),
            counts=change(self.counts),
            beside=None if self.beside is None else change(self.beside),
        )

    def without_beside(self) -> "Information":
        """The same data without the part beside rests; counts stay what they are."""
        rest = self.grams if self.beside is None else self.grams - self.beside
        return replace(self, grams=rest, beside=None)

    @property
    def windows_of_runs(self) -> dict[str, list[int]]:
        """Numbers of the windows of every run, by its name."""
        return by_key((window.run, number) for number, window in enumerate(self.windows))

    @property
    def runs(self) -> str:
        """Names of the runs, for messages."""
        return ", ".join(self.windows_of_runs)

    @property
    def n_samples(self) -> Array:
        """Samples per row, shape `(rows,)`."""
        return np.asarray(self.counts.sum(axis=0))

    def of(self, windows: Sequence[int]) -> "Information":
        """Some of the windows."""
        chosen = list(windows)
        return self._changed(lambda sums: sums[chosen], tuple(self.windows[k] for k in chosen))

    def merged(self, most: int) -> "Information":
        """Neighbouring windows of each run joined until every run has at most `most`."""
        groups: list[list[int]] = []
        for mine in self.windows_of_runs.values():
            size = -(-len(mine) // most)
            groups += [mine[k : k + size] for k in range(0, len(mine), size)]
        return self.grouped(groups)

    def grouped(self, groups: Sequence[Sequence[int]]) -> "Information":
        """Windows joined, one per group of at least one; windows in no group are left out."""
        labels = tuple(
            Window(self.windows[g[0]].run, self.windows[g[0]].start, self.windows[g[-1]].stop)
            for g in groups
        )

        def joined(sums: Array) -> Array:
            parts = [sums[list(g)].sum(axis=0) for g in groups]
            return np.reshape(parts, (len(groups), sums.shape[1]))

        return self._changed(joined, labels)

    def row_gram(self, row: int) -> Array:
        """Gram matrix of one row's own columns and effort, shape `(k + 1, k + 1)`."""
        return self._whole[row]

    def row_grams(self, row: int) -> Array:
        """The same of every window, shape `(w, k + 1, k + 1)`."""
        return self._matrices(self.grams, row)

    def normal(self, weights: Array | None = None) -> tuple[Array, Array, float]:
        r"""Normal equations of weighted least squares over all rows.

        Args:
            weights: One weight per row, usually $1/\sigma_j^2$; ones if `None`.

        Returns:
            $\sum_j w_j A_j^T A_j$ `(p, p)`, $\sum_j w_j A_j^T b_j$ `(p,)`, $\sum_j w_j b_j^T b_j$.
        """
        p = len(self.layout.columns)
        w = np.ones(len(self.layout.rows)) if weights is None else weights
        matrix, vector, square = np.zeros((p, p)), np.zeros(p), 0.0
        for row, seen in enumerate(self.layout.sees):
            gram = w[row] * self.row_gram(row)
            index, cells = _cells(tuple(seen))
            matrix[cells] += gram[:-1, :-1]
            vector[index] += gram[:-1, -1]
            square += float(gram[-1, -1])
        return matrix, vector, square

    def residual_squares(self, values: Array) -> Array:
        """Sum of squared residuals per row for given parameters `(p,)`, shape `(rows,)`."""
        result = np.empty(len(self.layout.rows))
        for row, seen in enumerate(self.layout.sees):
            weights = np.append(-values[list(seen)], 1.0)
            result[row] = weights @ self.row_gram(row) @ weights
        return np.maximum(result, 0.0)

    def effort_squares(self) -> Array:
        """Sum of squared efforts per row, shape `(rows,)`."""
        return np.array([self.row_gram(row)[-1, -1] for row in range(len(self.layout.rows))])

    def relative_errors(self, values: Array) -> Array:
        r"""$100\,\|y - A\phi\| / \|y\|$ per row for parameters `(p,)`, 0 without effort [%]."""
        sizes = self.effort_squares()
        shares = self.residual_squares(values) / np.where(sizes > 0.0, sizes, np.inf)
        return np.asarray(100.0 * np.sqrt(shares))

    def absolute_sums(self) -> Array:
        """Sum of |column| over all rows and samples, shape `(p,)`."""
        total = self.absolute.sum(axis=0)
        result = np.zeros(len(self.layout.columns))
        for start, seen in zip(self.layout.starts, self.layout.sees, strict=True):
            result[list(seen)] += total[start : start + len(seen)]
        return result

    def select(self, names: Sequence[str]) -> "Information":
        """The same data, seen by some of the columns only, in the order given."""
        for name in names:
            if name not in self.layout.columns:
                wrong = f"there is no column '{name}'"
                fix = f"its columns are {', '.join(self.layout.columns[:12])}, ..."
                raise DataError(wrong, where=f"information of runs {self.runs}", fix=fix)
        old = [self.layout.columns.index(name) for name in names]
        transform = np.zeros((len(self.layout.columns), len(old)))
        transform[old, range(len(old))] = 1.0
        chosen = self.map(transform, names, [self.layout.units[k] for k in old])
        sums = np.zeros((len(self.windows), sum(chosen.layout.widths)))
        for row in range(len(self.layout.rows)):
            mine = {c: k for k, c in enumerate(self.layout.sees[row])}
            source = [mine[old[c]] for c in chosen.layout.sees[row]] + [len(mine)]
            start, width = chosen.layout.starts[row], chosen.layout.widths[row]
            sums[:, start : start + width] = self.absolute[
                :, [self.layout.starts[row] + k for k in source]
            ]
        return replace(chosen, absolute=sums)

    def map(
        self,
        transform: Array,
        names: Sequence[str],
        units: Sequence[str],
        given: Array | None = None,
        sees: tuple[tuple[int, ...], ...] | None = None,
    ) -> "Information":
        """The same data for other parameters: old ones = `transform` `(old, new)` @ new ones.

        What is `given` is added to these; each row `sees` what the transform has for it, if it does
        not say. Sums of |column| are not a number in the result.
        """
        sees = self.layout.seen_through(transform) if sees is None else sees
        parts = []
        for old, new in zip(self.layout.sees, sees, strict=True):
            part = np.zeros((len(old) + 1, len(new) + 1))
            part[:-1, :-1] = transform[np.ix_(old, new)]
            part[:-1, -1] = 0.0 if given is None else -given[list(old)]
            part[-1, -1] = 1.0
            parts.append(part)
        return self.mapped(
            Layout(tuple(names), tuple(units), self.layout.rows, sees, self.layout.mixed), parts
        )

    def mapped(self, layout: Layout, parts: Sequence[Array]) -> "Information":
        """The same data in a layout; `parts` `(old + 1, new + 1)` map columns and effort."""

        def of(sums: Array) -> Array:
            grams = [
                packed(part.T @ self._matrices(sums, row) @ part) for row, part in enumerate(parts)
            ]
            return np.concatenate(grams, axis=1)

        return replace(
            self,
            layout=layout,
            signature=replace(self.signature, columns=layout.columns),
            grams=of(self.grams),
            absolute=np.full((len(self.windows), sum(layout.widths)), np.nan),
            beside=None if self.beside is None else of(self.beside),
        )

    def with_predicted(
        self, values: Array, names: Sequence[str], added: Array, factors: Array | None = None
    ) -> "Information":
        """The same data with one column per row, in that row alone: its effort as predicted.

        Values `(p,)` of the data's columns make the predicted efforts, of which `added` is the
        share that is added to each row's effort, `(rows,)`; other columns of a row are multiplied
        by its factor, `(rows,)`. Sums of |column| are not a number in the result.
        """
        old, p = self.layout, len(self.layout.columns)
        sees = tuple((*seen, p + row) for row, seen in enumerate(old.sees))
        columns, units = (*old.columns, *names), (*old.units, *["1"] * len(names))
        parts = []
        for row, seen in enumerate(old.sees):
            k, mine = len(seen), values[list(seen)]
            part = np.zeros((k + 1, k + 2))
            part[:k, :k] = (1.0 if factors is None else factors[row]) * np.eye(k)
            part[:k, k], part[:k, k + 1] = mine, added[row] * mine
            part[k, k + 1] = 1.0
            parts.append(part)
        return self.mapped(Layout(columns, units, old.rows, sees, old.mixed), parts)

    def with_effective_samples(self, factor: float) -> "Information":
        """The same data counted as so many times fewer samples: all sums divided by `factor`."""
        return self._changed(lambda sums: sums / factor, self.windows)

    def scaled(self, gains: Array, units: Sequence[str]) -> "Information":
        """The same data with each row's effort multiplied by a gain, in its new unit."""
        if np.all(np.asarray(gains) == 1.0) and tuple(units) == self.signature.effort:
            return self
        ratios, absolute = np.ones(self.grams.shape[1]), self.absolute.copy()
        for row, gain in enumerate(gains):
            width = self.layout.widths[row]
            factors = np.ones(width)
            factors[-1] = gain
            ratios[self._packed(row)] = packed(factors[:, None] * factors)
            absolute[:, self.layout.starts[row] + width - 1] *= abs(gain)
        return replace(
            self,
            signature=replace(self.signature, effort=tuple(units)),
            grams=frozen(self.grams * ratios),
            absolute=frozen(absolute),
            beside=None if self.beside is None else frozen(self.beside * ratios),
        )

    @cached_property
    def _whole(self) -> tuple[Array, ...]:
        sums = self.grams.sum(axis=0)
        return tuple(frozen(self._matrices(sums, row)) for row in range(len(self.layout.rows)))

    def _matrices(self, sums: Array, row: int) -> Array:
        """One row's matrices `(..., k + 1, k + 1)` of packed ones `(..., size)`."""
        return np.take(sums[..., self._packed(row)], _places(self.layout.widths[row]), axis=-1)

    def _packed(self, row: int) -> slice:
        sizes = self.layout.packed_sizes
        start = sum(sizes[:row])
        return slice(start, start + sizes[row])


@lru_cache(maxsize=256)
def _places(width: int) -> NDArray[np.intp]:
    """Where each entry of a symmetric matrix stands in its lower triangle, `(width, width)`."""
    places = np.zeros((width, width), dtype=np.intp)
    rows, columns = np.tril_indices(width)
    places[rows, columns] = places[columns, rows] = np.arange(len(rows))
    return places


def packed(matrices: Array) -> Array:
    """Lower triangles `(..., size)` of symmetric matrices `(..., width, width)`."""
    width = matrices.shape[-1]
    flat = matrices.reshape(*matrices.shape[:-2], width * width)
    return np.take(flat, _lower(width), axis=-1)


@lru_cache(maxsize=256)
def _lower(width: int) -> NDArray[np.intp]:
    """Where the entries of the lower triangle stand in a matrix, `(size,)`."""
    rows, columns = np.tril_indices(width)
    return np.asarray(rows * width + columns)


@lru_cache(maxsize=1024)
def _cells(seen: tuple[int, ...]) -> tuple[NDArray[np.intp], tuple[NDArray[np.intp], ...]]:
    """Columns that a row sees, and where their products stand in a matrix of all columns."""
    index = np.array(seen, dtype=np.intp)
    return index, np.ix_(index, index)
