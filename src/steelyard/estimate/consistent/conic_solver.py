r"""Conic programs, handed to Clarabel as they are: no modelling layer between.

A program is $\min \tfrac12 x^T P x + q^T x$ with $b - A x$ in a product of cones.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array
from steelyard.base.errors import DataError

Places = NDArray[np.intp]

Kind = Literal["zero", "nonnegative", "semidefinite", "exponential"]

WAYS = (True, False)  # ways to solve a program, in turn: whether rows and columns are scaled before

AIM = 1e-12
"""Relative gap and infeasibility that are required of the solver. A gap moves the weighted squares
by its root: they are good to six digits only with a tiny one."""

GOOD, FAIR = 1e-8, 1e-6
"""Gap and infeasibility at which no other way is tried, and at which a program counts as solved,
as they are measured, whatever the solver calls them."""

MOST_ITERATIONS = 200


@dataclass(frozen=True, eq=False)
class Block:
    """Rows `b - A x` that lie in one cone."""

    kind: Kind  # the cone
    columns: Places  # variables that the rows look at, `k` of them
    matrix: Array  # their coefficients, `(rows, k)`
    offset: Array  # `b`, `(rows,)`
    # of the matrix, for `semidefinite`: its upper triangle column by column, entries off the
    # diagonal times the root of two
    order: int = 0


@dataclass(frozen=True, eq=False)
class Conic:
    """A conic program of `n` variables: diagonal of `P` and `q`, both `(n,)`, and the cones."""

    square: Array
    linear: Array
    blocks: tuple[Block, ...]


class Infeasible(DataError):
    """Nothing satisfies all cones of a program."""


class Unsolved(DataError):
    """The solver stopped before the optimum."""


def solved(
    program: Conic,
    where: str,
    most_iterations: int = MOST_ITERATIONS,
    *,
    aim: float = AIM,
    enough: float = 0.0,
) -> Array:
    """The optimum, shape `(n,)`; `where` says for messages what is solved.

    Gap and infeasibility of at most `aim` are required of the solver; a gap of `enough` counts as
    solved even if it is more than `FAIR`. Raises `Infeasible` where there is no point in all cones,
    and `Unsolved` where the solver stopped for another reason than the optimum.
    """
    infeasible = Infeasible(
        "no parameters satisfy all constraints",
        where=where,
        fix="relax or remove contradicting constraints",
    )
    ends = []
    for scaling in WAYS:
        end = _clarabel(program, scaling, most_iterations, aim)
        if end.status == "PrimalInfeasible":
            raise infeasible
        ends.append(end)
        if end.error <= max(GOOD, aim) or end.status == "MaxIterations":
            break
    best = min(ends, key=lambda end: end.error)
    if best.error <= FAIR or (best.gap <= enough and best.infeasibility <= FAIR):
        return best.x
    if any(end.status == "AlmostPrimalInfeasible" for end in ends):
        raise infeasible
    raise Unsolved(
        f"the solver stopped before the optimum ({best.status}, off by {best.error:.1g})",
        where=where,
        fix="log a more exciting motion, give a prior or a smaller uncertainty of it, "
        "or use least squares",
    )


@dataclass(frozen=True, eq=False)
class _End:
    """Where the solver stopped; `error` is the greater of infeasibility and gap over objective."""

    status: str
    x: Array
    gap: float
    infeasibility: float
    error: float


def _clarabel(program: Conic, scaling: bool, most_iterations: int, aim: float) -> _End:
    import clarabel
    from scipy import sparse

    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_iter = most_iterations
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = aim
    settings.equilibrate_enable = scaling
    settings.max_threads = 1
    rows = np.zeros((sum(len(b.offset) for b in program.blocks), len(program.linear)))
    start = 0
    for block in program.blocks:
        rows[start : start + len(block.offset), block.columns] = block.matrix
        start += len(block.offset)
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
        sparse.csc_array(rows),
        np.concatenate([block.offset for block in program.blocks]),
        kinds,
        settings,
    )
    solution = solver.solve()
    x, status = np.array(solution.x), str(solution.status)
    if "Infeasible" in status or status.startswith("Max"):
        return _End(status, x, np.inf, np.inf, np.inf)
    gap, *rest = np.nan_to_num(
        [abs(solution.obj_val - solution.obj_val_dual), solution.r_prim, solution.r_dual],
        nan=np.inf,
    )
    error = max(gap / max(1.0, abs(solution.obj_val)), *rest)
    return _End(status, x, float(gap), float(max(rest)), float(error))
