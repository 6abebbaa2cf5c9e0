"""Conic programs, handed to Clarabel as they are: no modelling layer between.

A program is $\\min \\tfrac12 x^T P x + q^T x$ with $b - A x$ in a product of cones.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import DataError

Kind = Literal["zero", "nonnegative", "semidefinite", "exponential"]

TOLERANCE = 1e-9
"""Relative gap and infeasibility at which a program counts as solved."""

MOST_ITERATIONS = 200


@dataclass(frozen=True, eq=False)
class Block:
    """Rows `b - A x` that lie in one cone.

    Attributes:
        kind: The cone.
        columns: Variables that the rows look at, `k` of them.
        matrix: Their coefficients, shape `(rows, k)`.
        offset: `b`, shape `(rows,)`.
        order: Of the matrix, for `semidefinite`: its upper triangle column by column, entries off
            the diagonal times the root of two.
    """

    kind: Kind
    columns: Array
    matrix: Array
    offset: Array
    order: int = 0


@dataclass(frozen=True, eq=False)
class Conic:
    """A conic program of `n` variables.

    Attributes:
        square: Diagonal of `P`, shape `(n,)`.
        linear: `q`, shape `(n,)`.
        blocks: The cones.
    """

    square: Array
    linear: Array
    blocks: tuple[Block, ...] = field(default=())


class Infeasible(DataError):
    """Nothing satisfies all cones of a program."""


class Unsolved(DataError):
    """The solver stopped before the optimum."""


def solved(program: Conic, where: str, most_iterations: int = MOST_ITERATIONS) -> Array:
    """The optimum, shape `(n,)`.

    Args:
        program: The program.
        where: What is solved, for messages.
        most_iterations: After which the solver stops.

    Raises:
        Infeasible: There is no point in all cones.
        Unsolved: The solver stopped for another reason than the optimum.
    """
    import clarabel
    from scipy import sparse

    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_iter = most_iterations
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = TOLERANCE
    settings.max_threads = 1
    cones = {
        "zero": clarabel.ZeroConeT,
        "nonnegative": clarabel.NonnegativeConeT,
        "semidefinite": clarabel.PSDTriangleConeT,
    }
    kinds = [
        clarabel.ExponentialConeT()
        if block.kind == "exponential"
        else cones[block.kind](block.order or len(block.offset))
        for block in program.blocks
    ]
    solver = clarabel.DefaultSolver(
        sparse.diags_array(program.square, format="csc"),
        program.linear,
        _stacked(program.blocks, len(program.linear)),
        np.concatenate([block.offset for block in program.blocks]),
        kinds,
        settings,
    )
    solution = solver.solve()
    status = str(solution.status)
    if status == "Solved":
        return np.array(solution.x)
    if "PrimalInfeasible" in status:
        raise Infeasible(
            "no parameters satisfy all that is wished of them",
            where=where,
            mend="loosen or remove wishes that contradict each other",
        )
    raise Unsolved(
        f"the solver stopped before the optimum ({status}, {solution.iterations} iterations)",
        where=where,
        mend="log a motion that shows more, give a prior or a smaller uncertainty of it, "
        "or use least squares",
    )


def _stacked(blocks: Sequence[Block], n: int) -> object:
    """All blocks' coefficients as one sparse matrix, compressed by columns."""
    from scipy import sparse

    rows, columns, values, start = [], [], [], 0
    for block in blocks:
        row, column = np.nonzero(block.matrix)
        rows.append(row + start)
        columns.append(np.asarray(block.columns)[column])
        values.append(block.matrix[row, column])
        start += len(block.offset)
    places = np.concatenate(rows), np.concatenate(columns)
    return sparse.csc_array((np.concatenate(values), places), shape=(start, n))
