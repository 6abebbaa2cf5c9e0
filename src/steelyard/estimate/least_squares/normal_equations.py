r"""Normal equations solved: what is seen, what is not, residual variances and covariance.

Shared by all estimators that come down to weighted sums of products. Parameters that every run has
for itself are eliminated run by run: with shared parameters $x$ and those of one run $l$, its
normal equations are $\begin{pmatrix} A & B \\ B^T & C \end{pmatrix}$; what they say about $x$ is
the Schur complement $A - B C^+ B^T$, and these add over runs, however many there are.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from steelyard.base.arrays import Array, Parameters, frozen
from steelyard.base.errors import DataError
from steelyard.estimate.estimate import Estimate, RunParameters, Unidentifiable
from steelyard.estimate.information.information import Information

SEEN = 1e-10
"""Squared sine of the angle to earlier columns below which the data do not see a column; eigenvalue
of a run's own normal matrix, columns of unit length, below which it is not seen."""

TIED = 1e-3  # share of a column's length that another must have in it to be named as its twin


@dataclass(frozen=True, eq=False)
class Eliminated:
    """One run's own parameters."""

    run: str
    columns: tuple[int, ...]
    offset: Array  # their values where all shared ones are zero
    slopes: Array  # their change per shared column, `(l, p)`
    inverse: Array  # inverse of their own normal matrix, `(l, l)`
    values: Array  # their values; zero until `solved`

    def solved(self, shared: Array) -> "Eliminated":
        """The same with values, for those of all shared columns, shape `(p,)`."""
        return replace(self, values=self.offset + self.slopes @ shared)

    def among(self, shared: Array) -> Array:
        """Values of all columns, `(p,)`: shared ones, and the run's own in their places."""
        values = shared.copy()
        values[list(self.columns)] = self.values
        return values

    def covariance(self, kept: Sequence[int], inverse: Array) -> Array:
        """Covariance of the run's own parameters, given that of the shared ones `kept`."""
        slopes = self.slopes[:, list(kept)]
        return np.asarray(self.inverse + slopes @ inverse @ slopes.T)

    def joined(self, kept: Sequence[int], inverse: Array) -> tuple[list[int], Array]:
        """Shared and own columns, and the covariance of all of them."""
        cross = self.slopes[:, list(kept)] @ inverse
        own = self.covariance(kept, inverse)
        return [*kept, *self.columns], np.block([[inverse, cross.T], [cross, own]])


@dataclass(frozen=True, eq=False)
class Runs:
    """Information as an estimator with parameters of single runs sees it."""

    whole: Information
    runs: tuple[Information, ...]  # one part per run; a single part if no column is a run's own
    local: tuple[int, ...]  # indices of the columns that every run has for itself

    @classmethod
    def of(cls, information: Information, per_run: Sequence[str]) -> "Runs":
        """Split information where columns belong to single runs."""
        if not per_run:
            return cls(information, (information,), ())
        groups, columns = information.windows_of_runs.values(), information.layout.columns
        runs = tuple(information.grouped([group]) for group in groups)
        return cls(information, runs, tuple(columns.index(name) for name in per_run))

    def without_beside(self) -> "Runs":
        """The same without samples beside rests."""
        runs = tuple(run.without_beside() for run in self.runs)
        return Runs(self.whole.without_beside(), runs, self.local)

    def normal(self, weights: Array) -> tuple[Array, Array, tuple[Eliminated, ...], Array]:
        """Normal equations of the shared columns, and what was eliminated, with one weight per row.

        Returns the matrix `(p, p)` and vector `(p,)`, zero in the columns of single runs; one value
        per run; and the squared lengths of all columns before, `(p,)`.
        """
        p = len(self.whole.layout.columns)
        total, right, squares = np.zeros((p, p)), np.zeros(p), np.zeros(p)
        eliminated = []
        for run in self.runs:
            matrix, vector, _ = run.normal(weights)
            sizes = np.diag(matrix)
            squares += sizes
            # the run's own columns that it sees, as a function of the shared ones
            columns = [k for k in self.local if sizes[k] > 1e-24 * sizes.max(initial=1e-300)]
            unit, lengths = unit_length(matrix[np.ix_(columns, columns)])
            inverse = np.linalg.pinv(unit, rcond=SEEN, hermitian=True) / lengths[:, None] / lengths
            slopes, offset = -inverse @ matrix[columns], inverse @ vector[columns]
            slopes[:, list(self.local)] = 0.0
            name, zeros = run.windows[0].run if run.windows else "", np.zeros(len(columns))
            own = Eliminated(name, tuple(columns), offset, slopes, inverse, zeros)
            across = matrix[:, list(own.columns)]
            total += matrix + across @ own.slopes
            right += vector - across @ own.offset
            eliminated.append(own)
        own_columns = list(self.local)
        total[own_columns], total[:, own_columns], right[own_columns] = 0.0, 0.0, 0.0
        return 0.5 * (total + total.T), right, tuple(eliminated), squares


def explained(
    blind: tuple[Unidentifiable, ...],
    eliminated: tuple[Eliminated, ...],
    lengths: Array,
    names: tuple[str, ...],
) -> tuple[Unidentifiable, ...]:
    """What is not seen, with the parameters of single runs that hide it, or that no run sees."""
    seen = {names[column] for own in eliminated for column in own.columns}
    result = []
    for one in blind:
        if one.name in seen:
            continue
        k = names.index(one.name)
        hiding = (
            names[column]
            for own in eliminated
            for column, slope in zip(own.columns, own.slopes[:, k], strict=True)
            if abs(slope) * lengths[column] > TIED * lengths[k]
        )
        tied = tuple(dict.fromkeys((*one.tied_to, *hiding)))
        result.append(Unidentifiable(one.name, tied))
    return tuple(result)


@dataclass(frozen=True, eq=False)
class Fit:
    """Values of all columns (unseen ones zero), the information they are from, and what it sees."""

    data: Runs
    values: Array  # shared columns, `(p,)`; columns of single runs are zero here
    kept: list[int]  # shared columns that the data see
    inverse: Array  # inverse of the normal matrix of `kept`
    locals: tuple[Eliminated, ...]  # per run its own columns, see `Runs`
    blind: tuple[Unidentifiable, ...]
    normal: Array  # normal matrix of `kept`
    variances: Array  # residual variances of the rows, `(rows,)`

    def at(self, values: Array) -> "Fit":
        """Other values of the shared columns, `(p,)`, under the same weights of rows."""
        parts = tuple(part.solved(values) for part in self.locals)
        found = replace(self, values=values, locals=parts)
        return replace(found, variances=variances_of(found, 1.0 / self.variances))


def solve(data: Runs, weights: Array, before: Fit | None = None) -> Fit:
    """Least squares over all rows, each with a weight, shape `(rows,)`.

    It begins with the columns of the fit before, with other weights, which mostly sees the
    same; a `DataError` says that the data show no parameter.
    """
    information = data.whole
    matrix, vector, eliminated, squares = data.normal(weights)
    scale = lengths_of(squares)
    scale[list(data.local)] = np.inf
    unit = matrix / scale[:, None] / scale
    if before is not None and _all_new(unit[np.ix_(before.kept, before.kept)]):
        kept, blind = before.kept, before.blind
    else:
        kept, blind = visible(unit, np.isfinite(scale), information.layout.columns)
    lengths = np.sqrt(np.maximum(squares, 0.0))
    blind = explained(blind, eliminated, lengths, information.layout.columns)
    if not kept:
        wrong = "none of the model's parameters is identifiable from the data"
        fix = "log a motion in which the joints move"
        raise DataError(wrong, where=information.runs or "no window", fix=fix)
    refuse_few(information, len(kept), 1.0)
    normal = matrix[np.ix_(kept, kept)]
    reduced, scale = unit_length(normal)
    inverse = np.linalg.inv(reduced)
    values = np.zeros(len(vector))
    first = inverse @ (vector[kept] / scale)
    first += inverse @ (vector[kept] / scale - reduced @ first)
    values[kept] = first / scale
    inverse, parts = inverse / scale[:, None] / scale, [x.solved(values) for x in eliminated]
    fit = Fit(data, values, kept, inverse, tuple(parts), blind, frozen(normal), 1.0 / weights)
    return replace(fit, variances=variances_of(fit, weights))


def refuse_few(information: Information, parameters: int, each: float) -> None:
    """Refuse data without more than `each` independent samples per parameter, for the noise."""
    total = float(information.n_samples.sum())
    if total <= each * parameters:
        raise DataError(
            f"too few samples: {total:.3g} independent ones for {parameters} parameters; more than "
            f"{each * parameters:.4g} are needed",
            where=information.runs or "no window",
            fix="log longer, with more of the time in motion; or leave terms out ([model] terms). "
            "A higher sampling rate adds none because of the low-pass; a higher [processing] "
            "matched_cutoff does, if noise allows it",
        )


def visible(
    unit: Array, nonzero: Array, names: tuple[str, ...]
) -> tuple[list[int], tuple[Unidentifiable, ...]]:
    """Columns that are new to those before them: Cholesky in natural order, the others left out."""
    size = len(unit)
    if nonzero.all() and _all_new(unit):
        return list(range(size)), ()
    factor = np.zeros((size, size))
    kept: list[int] = []
    blind: list[Unidentifiable] = []
    for k in range(size):
        if not nonzero[k]:
            blind.append(Unidentifiable(names[k]))
            continue
        part = np.linalg.solve(factor[np.ix_(kept, kept)], unit[kept, k])
        rest = unit[k, k] - part @ part
        if rest < SEEN:
            weights = np.linalg.solve(unit[np.ix_(kept, kept)], unit[kept, k])
            tied = [names[j] for j, w in zip(kept, weights, strict=True) if abs(w) > TIED]
            blind.append(Unidentifiable(names[k], tuple(tied)))
            continue
        factor[k, kept] = part
        factor[k, k] = np.sqrt(rest)
        kept.append(k)
    return kept, tuple(blind)


def _all_new(unit: Array) -> bool:
    """Whether every column is new; LAPACK answers that at once."""
    try:
        return bool(np.square(np.diag(np.linalg.cholesky(unit))).min() >= SEEN)
    except np.linalg.LinAlgError:
        return False


def variances_of(fit: Fit, weights: Array) -> Array:
    """Residual variance per row; a fit takes from each row the degrees of freedom it used there."""
    data, layout, counts = fit.data, fit.data.whole.layout, fit.data.whole.n_samples
    squares, used = np.zeros(len(layout.rows)), np.zeros(len(layout.rows))
    for run, own in zip(data.runs, fit.locals, strict=True):
        columns, covariance = own.joined(fit.kept, fit.inverse)
        position = {column: k for k, column in enumerate(columns)}
        squares += run.residual_squares(own.among(fit.values))
        for row, seen in enumerate(layout.sees):
            mine = [k for k, column in enumerate(seen) if column in position]
            place = [position[seen[k]] for k in mine]
            gram = run.row_gram(row)[np.ix_(mine, mine)]
            used[row] += weights[row] * np.sum(gram * covariance[np.ix_(place, place)])
    variances = squares / np.maximum(counts - used, 1.0)
    floor = 1e-24 * max(float(data.whole.effort_squares().max()), 1e-300)
    return np.maximum(variances, floor)


def scores_of(
    data: Runs, locals_: Sequence[Eliminated], kept: Sequence[int], weights: Array
) -> Array:
    """Covariance of the shared columns' scores `(k, k)`, of variances per row as weights."""
    total = np.zeros((len(kept), len(kept)))
    for run, own in zip(data.runs, locals_, strict=True):
        matrix, _, _ = run.normal(weights)
        shared = shared_map(own, kept)
        total += shared.T @ matrix @ shared
    return total


def shared_map(own: Eliminated, kept: Sequence[int]) -> Array:
    """All columns per shared column, those of the run itself fitted, shape `(p, len(kept))`."""
    shared = np.zeros((own.slopes.shape[1], len(kept)))
    shared[list(kept), range(len(kept))] = 1.0
    shared[list(own.columns)] = own.slopes[:, list(kept)]
    return shared


def described(
    name: str, fit: Fit, shared: Array, locals_: Sequence[Array] | None = None
) -> Estimate:
    """The estimate of a fit, under the estimator's name, with covariances.

    That of the shared parameters, and per run that of its own; as the former makes it if `None`.
    """
    layout = fit.data.whole.layout
    if locals_ is None:
        locals_ = [part.covariance(fit.kept, shared) for part in fit.locals]
    values, covariance, own = _with_locals(fit, shared, locals_)
    columns = [*fit.kept, *own]
    order = np.argsort(columns)

    def named(some: Sequence[int], values: Array) -> Parameters:
        return Parameters(
            [layout.columns[k] for k in some], [layout.units[k] for k in some], values
        )

    return Estimate(
        estimator=name,
        parameters=named([columns[k] for k in order], values[order]),
        covariance=frozen(covariance[np.ix_(order, order)]),
        blind=fit.blind,
        sigma=frozen(np.sqrt(fit.variances)),
        n_samples=frozen(fit.data.whole.n_samples),
        condition=condition_of(fit.normal),
        condition_normalised=condition_of(unit_length(fit.normal)[0]),
        per_run=tuple(
            RunParameters(
                part.run, named(part.columns, part.values), frozen(np.sqrt(np.diag(covariance)))
            )
            for part, covariance in zip(fit.locals, locals_, strict=True)
            if part.columns
        ),
    )


def _with_locals(
    fit: Fit, shared: Array, locals_: Sequence[Array]
) -> tuple[Array, Array, list[int]]:
    """Shared values and covariance, joined by what a new run is to be expected to have.

    Of a column that every run has for itself that is the mean over runs, with the variance
    between runs (of one run alone: its own).
    """
    own = sorted({column for part in fit.locals for column in part.columns})
    means, variances = [], []
    for column in own:
        parts = [
            (part.values[k], covariance[k, k])
            for part, covariance in zip(fit.locals, locals_, strict=True)
            for k, mine in enumerate(part.columns)
            if mine == column
        ]
        found = np.array([value for value, _ in parts])
        means.append(found.mean())
        variances.append(found.var(ddof=1) if len(found) > 1 else parts[0][1])
    size = len(shared)
    total = np.zeros((size + len(own), size + len(own)))
    total[:size, :size] = (shared + shared.T) / 2.0
    total[range(size, len(total)), range(size, len(total))] = variances
    return np.concatenate([fit.values[fit.kept], means]), total, own


def unit_length(gram: Array) -> tuple[Array, Array]:
    """A Gram matrix with columns of unit length, and the lengths that they had."""
    lengths = np.sqrt(np.diag(gram))
    return gram / lengths[:, None] / lengths, lengths


def lengths_of(squares: Array) -> Array:
    """Lengths of columns by their squares; infinite where they are zero but for rounding."""
    lengths = np.sqrt(np.maximum(squares, 0.0))
    return np.where(lengths > 1e-12 * lengths.max(initial=1e-300), lengths, np.inf)


def inverse_of_gram(gram: Array) -> Array:
    """Inverse of a Gram matrix, found with columns of unit length."""
    unit, lengths = unit_length(gram)
    return np.asarray(np.linalg.inv(unit) / lengths[:, None] / lengths)


def condition_of(gram: Array) -> float:
    """Root of the ratio of a Gram matrix's extreme eigenvalues, as far as rounding shows it."""
    eigenvalues = np.linalg.eigvalsh(gram)
    rounding = np.finfo(np.float64).eps * eigenvalues[-1]
    return float(np.sqrt(eigenvalues[-1] / max(eigenvalues[0], rounding)))
