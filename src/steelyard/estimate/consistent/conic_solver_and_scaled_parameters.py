r"""Conic programs, solved by Clarabel; standard parameters in the scale of their prior, penalties.

Programs are handed to Clarabel as they are, without a modelling layer between:
$\min \tfrac12 x^T P x + q^T x$ with $b - A x$ in a product of cones.

A body's pseudo-inertia is $J = L X L^T$ with $J_0 = L L^T$ that of its prior: the prior is
$X = 1$, and margins have no unit [Wensing2018]. A body's unknowns are the ten entries of the upper
triangle of $X$, column by column; every other parameter is counted in the standard deviation that
is known of it, else in the size that would make all of the effort, or, where the data do not see
it, in what is wide in its SI unit.

Every form keeps $X \succeq \delta 1$: a body with margin.
"""

from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array, frozen, places_of
from steelyard.base.errors import DataError
from steelyard.estimate.information.base_parameters_and_regressor import BaseMap
from steelyard.estimate.least_squares.weighted_robust_and_whitened import Whitened
from steelyard.estimate.prior.body_priors import Knowledge
from steelyard.robot.inertia_and_placement import Inertia

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


ORDER = 4  # rows of a pseudo-inertia
ENTRIES = tuple((i, j) for j in range(ORDER) for i in range(j + 1))  # upper triangle by columns
WIDEST = 10.0  # standard deviation of a wholly unknown cause of torque, in that of the whole effort
UNSEEN = 1e-9  # effort of a parameter over that of the strongest that the data do not see
UNKNOWN = 100.0  # standard deviation of a parameter that the data do not see, in its SI unit

SCALE_WITHOUT_PRIOR = Inertia.about_com(1.0, np.zeros(3), 0.01 * np.eye(3))
"""Scale of a body without prior."""

ROWS, COLUMNS = np.array(ENTRIES).T

ONE = np.where(ROWS == COLUMNS, 1.0, 0.0)  # entries of the unit matrix

BASIS = np.zeros((10, ORDER, ORDER))
BASIS[range(10), ROWS, COLUMNS] = BASIS[range(10), COLUMNS, ROWS] = 1.0
BASIS.flags.writeable = False

_TENS = np.array([Inertia.from_pseudo(e).ten for e in BASIS]).T  # ten numbers per entry, `(10, 10)`


@dataclass(frozen=True, eq=False)
class Unknowns:
    r"""Standard parameters as unknowns of a program, $\phi = c + T u$."""

    names: tuple[str, ...]
    # per body whether it has a prior; its unknowns are `u[10 k : 10 k + 10]`
    priors: tuple[bool, ...]
    # indices in `names` of the other unknowns, which follow those of the bodies
    terms: tuple[int, ...]
    scale: Array  # $T$, `(p, m)`
    weak: Array  # precision of each unknown that keeps what no data show near zero, `(m,)`
    matrix: Array  # whitened data over the unknowns, `(rank, m)`
    vector: Array  # `(rank,)`

    def pseudo(self, u: Array) -> Array:
        """`X` of every body, shape `(bodies, 4, 4)`."""
        return np.tensordot(u[: 10 * len(self.priors)].reshape(-1, 10), BASIS, axes=1)

    def standard(self, u: Array) -> Array:
        """Standard parameters, shape `(p,)`; unseen ones of terms are zero but for constraints."""
        return np.asarray(self.scale @ u)

    def of_standard(self, standard: Array) -> Array:
        """The unknowns of standard parameters, shape `(m,)`; the reverse of `standard`."""
        return np.asarray(np.linalg.solve(self.scale, standard))

    def chi_squared(self, u: Array) -> float:
        """Rise of the weighted squares over those of weighted least squares."""
        residual = self.matrix @ u - self.vector
        return float(residual @ residual)


def unknowns(data: Whitened, base: BaseMap, knowledge: Knowledge) -> Unknowns:
    """The unknowns of a problem."""
    first = 10 * len(knowledge.bodies)
    lift = base.lift[places_of(data.names, base.base_names)]
    scale, terms = scale_of(knowledge)
    strength = np.linalg.norm(data.matrix @ lift, axis=0)
    least = UNSEEN * float(strength.max(initial=0.0))
    strength = strength[list(terms)]
    sizes = np.divide(
        data.effort, strength, out=np.full(len(terms), UNKNOWN), where=strength > least
    )
    stated = np.array([knowledge.deviations.get(base.names[k], np.nan) for k in terms])
    scale[:, first:] *= np.where(np.isfinite(stated), stated, sizes)
    matrix = data.matrix @ lift @ scale
    matrix[:, first + np.flatnonzero(strength <= least)] = 0.0
    weak = np.full(scale.shape[1], WIDEST**-2)
    weak[:first] = 0.0
    weak[first + np.flatnonzero((strength <= least) | np.isfinite(stated))] = 1.0
    return Unknowns(
        base.names,
        tuple(prior is not None for prior in knowledge.priors),
        terms,
        frozen(scale),
        frozen(weak),
        frozen(matrix),
        data.vector,
    )


def scale_of(knowledge: Knowledge) -> tuple[Array, tuple[int, ...]]:
    """Parameters per entry of every `X`, then the others, which are given, as they are."""
    tens = [knowledge.tens(body) for body in range(len(knowledge.bodies))]
    terms = np.flatnonzero(~knowledge.of_bodies).tolist()
    scale = np.zeros((len(knowledge.names), 10 * len(tens) + len(terms)))
    for body, ten in enumerate(tens):
        part = ten_map(knowledge.priors[body] or SCALE_WITHOUT_PRIOR)
        scale[ten, 10 * body : 10 * body + 10] = part
    scale[terms, 10 * len(tens) + np.arange(len(terms))] = 1.0
    return scale, tuple(terms)


def ten_map(prior: Inertia) -> Array:
    """Ten numbers of a body per entry of its `X`, shape `(10, 10)`."""
    factor = np.linalg.cholesky(prior.pseudo)
    return np.asarray(_TENS @ (factor @ BASIS @ factor.T)[:, ROWS, COLUMNS].T)


_TWICE = 2.0 - ONE

FAINT = 1e-6  # weight that keeps bodies without prior bounded


@dataclass(frozen=True)
class Entropic:
    r"""$\mathrm{tr}\,X - \log\det X - 4$, the divergence of two mass distributions [Lee2020].

    In cones: $\log\det X \ge \sum_k t_k$ where $\begin{pmatrix} X & Z \\ Z^T & D
    \end{pmatrix} \succeq 0$, $Z$ lower triangular, $D$ its diagonal, $t_k \le \log D_{kk}$.
    """

    name: ClassVar[str] = "entropic"
    penalises: ClassVar[bool] = True
    margin: float = 1e-3  # least eigenvalue of `X`

    def part(self, weight: float) -> Conic:
        """Cost and cones of one body's ten unknowns, then of helpers: entries of `Z`, logarithms.

        The penalty counts `weight` times.
        """
        linear = weight * np.concatenate([ONE, np.zeros(10), -np.ones(4)])
        logarithms = (
            Block(
                "exponential",
                np.array([20 + k, 10 + diagonal]),
                np.array([[-1.0, 0.0], [0.0, 0.0], [0.0, -1.0]]),
                np.array([0.0, 1.0, 0.0]),
            )
            for k, diagonal in enumerate(np.flatnonzero(ONE))
        )
        return Conic(np.zeros(24), linear, (_bordered(), *logarithms, apart(self.margin)))

    def cost(self, x: Array) -> float:
        """The divergence of one `X`, shape `(4, 4)`; zero at the prior."""
        return float(np.trace(x) - np.linalg.slogdet(x)[1] - ORDER)

    def slope(self, x: Array) -> Array:
        r"""Derivative by the ten entries of `X`, $\mathrm{tr}((1 - X^{-1}) E_a)$."""
        return np.asarray(np.tensordot(BASIS, np.eye(ORDER) - np.linalg.inv(x), axes=2))

    def curvature(self, x: Array) -> Array:
        r"""Second derivative by them, $\mathrm{tr}(X^{-1} E_a X^{-1} E_b)$."""
        turned = np.linalg.solve(x, BASIS)
        return np.asarray(np.einsum("aij,bji->ab", turned, turned))


@dataclass(frozen=True)
class Pullback:
    r"""$\tfrac12 \|X - 1\|_F^2$: the divergence to second order, a quadratic [Lee2018]."""

    name: ClassVar[str] = "quadratic"
    penalises: ClassVar[bool] = True
    size: ClassVar[float] = 1.0
    centre: ClassVar[Array] = ONE
    margin: float = 1e-3

    def part(self, weight: float) -> Conic:
        """A quadratic around a centre; no helpers."""
        size = weight * self.size
        return Conic(size * _TWICE, -size * self.centre, (apart(self.margin),))

    def cost(self, x: Array) -> float:
        """Half the squared distance."""
        return 0.5 * self.size * float(_TWICE @ np.square(x[ROWS, COLUMNS] - self.centre))

    def slope(self, x: Array) -> Array:
        r"""$\mathrm{tr}((X - 1) E_a)$."""
        return np.asarray(self.size * _TWICE * (x[ROWS, COLUMNS] - self.centre))

    def curvature(self, x: Array) -> Array:
        """The same everywhere."""
        return np.diag(self.size * _TWICE)


@dataclass(frozen=True)
class Free(Pullback):
    """No penalty beyond physical consistency.

    What no data show is kept from growing without bound: 1000 times the prior costs one half.
    """

    name: ClassVar[str] = "free"
    penalises: ClassVar[bool] = False
    size: ClassVar[float] = FAINT
    centre: ClassVar[Array] = np.zeros(10)


Form = Entropic | Pullback  # a penalty on a body's distance from its prior


def apart(margin: float) -> Block:
    """`X - margin` is positive semidefinite."""
    return Block("semidefinite", np.arange(10), -np.diag(np.sqrt(_TWICE)), -margin * ONE, ORDER)


def _bordered() -> Block:
    """`X` bordered by `Z` and its diagonal is positive semidefinite."""
    places = [(i, j) for j in range(2 * ORDER) for i in range(j + 1)]
    matrix = np.zeros((len(places), 20))
    for k, (i, j) in enumerate(ENTRIES):
        # Z is lower triangular: its entry (j, i) is the upper triangle's (i, j)
        matrix[places.index((i, j)), k] = 1.0 if i == j else np.sqrt(2.0)
        matrix[places.index((j, ORDER + i)), 10 + k] = np.sqrt(2.0)
        if i == j:
            matrix[places.index((ORDER + i, ORDER + i)), 10 + k] = 1.0
    return Block("semidefinite", np.arange(20), -matrix, np.zeros(len(matrix)), 2 * ORDER)
