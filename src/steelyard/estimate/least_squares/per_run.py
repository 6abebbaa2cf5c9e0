r"""Parameters that every run has for itself, eliminated run by run.

With shared parameters $x$ and those of one run $l$, its normal equations are
$\begin{pmatrix} A & B \\ B^T & C \end{pmatrix}$; what they say about $x$ is the Schur complement
$A - B C^+ B^T$, and these add over runs, however many there are.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import DataError
from steelyard.estimate.estimate import Unidentifiable
from steelyard.estimate.information.information import Information
from steelyard.model.model import Model

SEEN = 1e-10
"""Eigenvalue of a run's own normal matrix, columns of unit length, below which it is not seen."""

TIED = 1e-3
"""Share of a column's length that another must have in it to be named as its twin."""


def own_columns(model: Model) -> tuple[str, ...]:
    """Parameters that every run of a model has for itself."""
    return tuple(
        p.name
        for term in model.terms
        if getattr(term, "per_run", False)
        for p in term.parameters(model.robot)
    )


@dataclass(frozen=True, eq=False)
class Eliminated:
    """One run's own parameters.

    Attributes:
        offset: Their values where all shared ones are zero.
        slopes: Their change per shared column, shape `(l, p)`.
        inverse: Inverse of their own normal matrix, shape `(l, l)`.
        values: Their values; zero until `solved`.
    """

    run: str
    columns: tuple[int, ...]
    offset: Array
    slopes: Array
    inverse: Array
    values: Array

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
        slopes = self.slopes[:, list(kept)]
        cross = slopes @ inverse
        own = self.covariance(kept, inverse)
        return [*kept, *self.columns], np.block([[inverse, cross.T], [cross, own]])


@dataclass(frozen=True, eq=False)
class Runs:
    """Information as an estimator with parameters of single runs sees it.

    Attributes:
        runs: One part per run; a single part if no column is a run's own.
        local: Indices of the columns that every run has for itself.
    """

    whole: Information
    runs: tuple[Information, ...]
    local: tuple[int, ...]

    @classmethod
    def of(cls, information: Information, per_run: Sequence[str]) -> "Runs":
        """Split information where columns belong to single runs.

        Raises:
            DataError: There is no column of a name.
        """
        columns = information.layout.columns
        for name in per_run:
            if name not in columns:
                raise DataError(
                    f"there is no column '{name}' that could be estimated per run",
                    where="parameters per run",
                    fix=f"its columns are {', '.join(columns[:12])}, ...",
                )
        if not per_run:
            return cls(information, (information,), ())
        groups = information.windows_of_runs.values()
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
            squares += np.diag(matrix)
            own = self._eliminated(run, matrix, vector)
            across = matrix[:, list(own.columns)]
            total += matrix + across @ own.slopes
            right += vector - across @ own.offset
            eliminated.append(own)
        own_columns = list(self.local)
        total[own_columns], total[:, own_columns], right[own_columns] = 0.0, 0.0, 0.0
        return 0.5 * (total + total.T), right, tuple(eliminated), squares

    def _eliminated(self, run: Information, matrix: Array, vector: Array) -> Eliminated:
        """The run's own columns that it sees, as a function of the shared ones."""
        sizes = np.diag(matrix)
        columns = [k for k in self.local if sizes[k] > 1e-24 * sizes.max(initial=1e-300)]
        own = matrix[np.ix_(columns, columns)]
        lengths = np.sqrt(np.diag(own))
        inverse = np.linalg.pinv(own / lengths[:, None] / lengths, rcond=SEEN, hermitian=True)
        inverse = inverse / lengths[:, None] / lengths
        slopes = -inverse @ matrix[columns]
        slopes[:, list(self.local)] = 0.0
        name = run.windows[0].run if run.windows else ""
        zeros = np.zeros(len(columns))
        return Eliminated(name, tuple(columns), inverse @ vector[columns], slopes, inverse, zeros)


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
        k = names.index(one.name)
        hiding = (
            names[column]
            for own in eliminated
            for column, slope in zip(own.columns, own.slopes[:, k], strict=True)
            if abs(slope) * lengths[column] > TIED * lengths[k]
        )
        tied = tuple(dict.fromkeys((*one.tied_to, *hiding)))
        result += [] if one.name in seen else [Unidentifiable(one.name, tied)]
    return tuple(result)
