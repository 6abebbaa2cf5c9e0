r"""Base parameters, their groupings and customary symbols; the regressor as machine code.

Calibrated model files have joint axes that are parallel to 1e-4 rad. Natural order alone then takes
columns whose new part is no more than 1e-8, and the rounding errors of everything after it, blown
up by 1e8, look like new parts as well. Here the rank stands at the largest gap of the singular
values. A column is taken in natural order only if a good part of it is new; the columns that are
then missing are those that add most (QR with column pivoting [Businger1965, Gautier1991]).

The regressor of *all* linear terms is evaluated on random states. A column that is zero, or that
is a combination of others, has no parameter of its own: its parameter is grouped with others,
$\phi_\mathrm{base} = \phi_b + K \phi_d$ [Gautier1991]. Natural order is kept where that is
well-conditioned, so groupings come out the customary way: a link's mass joins the moments of the
links before it.

Letters name the number of a body's ten (`M, MX, MY, MZ, XX, XY, YY, XZ, YZ, ZZ`, about the link
frame's origin) or the law, the figure the link or joint (0: a floating base), and `R` says that
others are grouped with it [Khalil2002, ch. 9].
"""

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import qr, solve_triangular

from steelyard.base.arrays import Array, Parameters, frozen, json_values
from steelyard.base.checked_arguments import checked
from steelyard.base.errors import ModelError
from steelyard.model.equations.passive_joints import random_positions
from steelyard.model.laws.laws_without_friction import RigidBody
from steelyard.model.laws.register import TERMS
from steelyard.model.model import Model
from steelyard.model.terms.term import Term
from steelyard.robot.inertia_and_placement import INERTIAL_NAMES
from steelyard.robot.robot import Robot
from steelyard.symbolic.native import cache
from steelyard.symbolic.native.compiled_programs import Code, compiled
from steelyard.symbolic.program_and_softening import InputArray as Input
from steelyard.symbolic.program_and_softening import Program, Step, run

NEW = 1e-2  # part of a column's norm that must be new for it to be taken in natural order
UNSEEN = 1e-9  # norm of a column, over the largest, that is zero but for rounding
GAP = 1e-3  # singular values above this part of the largest one count in any case
ROUNDING = 1e-14  # singular values below this part of the largest one are rounding errors


def seen_columns(matrix: Array) -> list[int]:
    """Indices of the columns of a `(rows, p)` matrix that are not zero."""
    norms = np.linalg.norm(matrix, axis=0)
    return [int(k) for k in np.flatnonzero(norms > UNSEEN * norms.max(initial=0.0))]


def independent_columns(matrix: Array) -> list[int]:
    """Ascending indices of columns that span a matrix `(rows, p)` with `rows >= p`."""
    seen = seen_columns(matrix)
    if not seen:
        return []
    unit = matrix[:, seen] / np.linalg.norm(matrix[:, seen], axis=0)
    triangle = np.asarray(np.linalg.qr(unit, mode="r"))
    basis, natural = np.empty((len(triangle), min(triangle.shape)), order="F"), list[int]()
    for k, rest in enumerate(triangle.T):
        before = basis[:, : len(natural)]
        for _ in range(2):
            rest = rest - before @ (before.T @ rest)
        new = float(np.linalg.norm(rest))
        if new > NEW:
            basis[:, len(natural)] = rest / new
            natural.append(k)
    basis = basis[:, : len(natural)]
    values: Array = np.linalg.svd(triangle, compute_uv=False)
    missing = rank(values) - len(natural)
    others = [k for k in range(len(seen)) if k not in set(natural)]
    if missing > 0:
        rest = triangle[:, others]
        for _ in range(2):
            rest = rest - basis @ (basis.T @ rest)
        _, order = cast(tuple[Array, Array], qr(rest, mode="r", pivoting=True))
        natural += [others[int(k)] for k in order[:missing]]
    return sorted(seen[k] for k in natural)


def rank(values: Array) -> int:
    """How many descending singular values stand before their largest gap."""
    sizes = np.maximum(np.append(values / values[0], 0.0), ROUNDING)
    first = max(1, int((sizes >= GAP).sum()))
    return first + int(np.argmax(sizes[first - 1 : -1] / sizes[first:]))


FAINT = 1e-3
"""Part of a column that others do not explain, over the norm of the largest one of its unit, below
which motions are not designed for it."""

ENGINE = 3  # raised whenever the choice of columns changes: old cache entries are then not used


@dataclass(frozen=True, eq=False, repr=False)
class BaseMap:
    r"""Standard parameters to base parameters, $\phi_\mathrm{base} = \phi_b + K \phi_d$."""

    names: tuple[str, ...]  # names of the standard parameters, `p` of them
    units: tuple[str, ...]  # their units
    # indices of the parameters that lead a group, one per base parameter
    independent: tuple[int, ...]
    dependent: tuple[int, ...]  # indices of the parameters that are grouped with those
    unseen: tuple[int, ...]  # indices of the parameters that no motion can show
    coefficients: Array  # $K$, `(len(independent), len(dependent))`

    def __repr__(self) -> str:
        return f"BaseMap({len(self)} base parameters of {len(self.names)})"

    def __len__(self) -> int:
        return len(self.independent)

    @property
    def base_names(self) -> tuple[str, ...]:
        """Each base parameter has the name of the standard parameter that leads its group."""
        return tuple(self.names[k] for k in self.independent)

    @property
    def base_units(self) -> tuple[str, ...]:
        """Units of the base parameters."""
        return tuple(self.units[k] for k in self.independent)

    def base_values(self, standard: ArrayLike) -> Array:
        """Base parameters of standard ones, shape `(p,)` to `(b,)`."""
        values = np.asarray(standard, dtype=np.float64)
        return values[list(self.independent)] + self.coefficients @ values[list(self.dependent)]

    def values_of(self, names: Iterable[str], standard: ArrayLike) -> Array:
        """Base parameters of these names, of standard ones `(p,)`; zero where there is none."""
        values = self.lift @ np.asarray(standard, dtype=np.float64)
        return Parameters(self.base_names, self.base_units, values).named(names)

    @property
    def lift(self) -> Array:
        """The matrix of `base_values`, shape `(b, p)`."""
        matrix = np.zeros((len(self), len(self.names)))
        matrix[range(len(self)), list(self.independent)] = 1.0
        matrix[:, list(self.dependent)] += self.coefficients
        return matrix

    def beside(self, names: Sequence[str], units: Sequence[str]) -> "BaseMap":
        """The map with further parameters that are base parameters by themselves."""
        p, n = len(self.names), len(names)
        return BaseMap(
            (*self.names, *names),
            (*self.units, *units),
            (*self.independent, *range(p, p + n)),
            self.dependent,
            self.unseen,
            np.vstack([self.coefficients, np.zeros((n, len(self.dependent)))]),
        )

    def without(self, names: Collection[str]) -> "BaseMap":
        """The map of a model whose base parameters of these names are zero."""
        left = [k for k, name in enumerate(self.base_names) if name not in names]
        return replace(
            self,
            independent=tuple(self.independent[k] for k in left),
            coefficients=frozen(self.coefficients[left]),
        )

    def grouping(self, base: int) -> str:
        """A base parameter in full, like `Izz.link1 + Iyy.link2 + 0.25 m.link3`."""
        text = self.names[self.independent[base]]
        for coefficient, k in zip(self.coefficients[base], self.dependent, strict=True):
            if coefficient:
                size = "" if abs(coefficient) == 1.0 else f"{abs(coefficient):.4g} "
                text += f" {'-' if coefficient < 0 else '+'} {size}{self.names[k]}"
        return text

    def to_dict(self) -> dict[str, Any]:
        """As JSON values; exact."""
        return dict(json_values(self))

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> "BaseMap":
        """The map that `to_dict` wrote."""
        tuples = {k: tuple(x) for k, x in data.items() if k != "coefficients"}
        shape = len(tuples["independent"]), len(tuples["dependent"])
        return cls(**tuples, coefficients=frozen(np.reshape(data["coefficients"], shape)))


@checked()
def base_parameters(model: Model) -> BaseMap:
    """The structural base parameters of a model, from the cache where possible.

    Example:
        >>> base = base_parameters(model_of("arm.toml"))
        >>> base.base_names[:2]
        ('mx.upper', 'mz.upper')
    """
    return _found("base", model, _with_low_thresholds(model), independent_columns)


def clear_map(model: Model) -> BaseMap:
    """The base parameters for which motions are designed: those that change torque by themselves.

    Where all others explain a column up to less than `FAINT` of the largest one of its unit, as
    behind axes that are parallel or upright to 1e-4 rad, its parameter is grouped with them: no
    motion shows it beside them, and a criterion that includes it would see nothing else. Of robots
    with loops all are kept: how much they show depends on where the loops are.
    """
    if model.robot.passive:
        return base_parameters(model)
    return _found("clear base", model, model, lambda regressor: _clear(model, regressor))


def _found(kind: str, model: Model, shown: Model, choose: Callable[[Array], list[int]]) -> BaseMap:
    """The base parameters that are chosen from the regressor of the model as it is shown."""
    key = cache.key_of([kind, FAINT, ENGINE, model.program_key])
    entry = cache.load(key)
    if entry is not None:
        return BaseMap.from_dict(entry[0])
    regressor = full_regressor(shown)
    independent, seen = choose(regressor), set(seen_columns(regressor))
    columns = range(regressor.shape[1])
    dependent = [k for k in columns if k in seen and k not in set(independent)]
    solved = np.linalg.lstsq(regressor[:, independent], regressor[:, dependent], rcond=None)[0]
    for exact in (0.0, 1.0, -1.0):  # by structure
        solved[np.abs(solved - exact) < 1e-8] = exact
    unseen = tuple(k for k in columns if k not in seen)
    found = BaseMap(
        model.names, model.units, tuple(independent), tuple(dependent), unseen, frozen(solved)
    )
    cache.store(key, found.to_dict(), b"")
    return found


HIGHEST = 0.1  # highest threshold of friction on random states [rad/s; m/s]


def _with_low_thresholds(model: Model) -> Model:
    """The model with friction that most random speeds show, whatever speeds it begins above.

    All thresholds are lowered by one factor: which columns are zero or combinations of others does
    not depend on it.
    """
    thresholds = [np.max(getattr(term, "threshold", 0.0)) for term in model.terms]
    highest = float(max(thresholds, default=0.0))
    if highest <= HIGHEST:
        return model
    factor = HIGHEST / highest

    def lowered(term: Term) -> Term:
        given = getattr(term, "threshold", 0.0)
        if not np.any(given):
            return term
        low = tuple(factor * x for x in given) if isinstance(given, tuple) else factor * given
        return cast(Term, replace(cast(Any, term), threshold=low))

    return Model(model.robot, tuple(map(lowered, model.terms)))


def _clear(model: Model, regressor: Array) -> list[int]:
    """Independent columns without the least one, as long as that is no more than faint."""
    norms = np.linalg.norm(regressor, axis=0)
    largest = {unit: norms[[u == unit for u in model.units]].max() for unit in model.units}
    columns = independent_columns(regressor)
    sizes = np.array([largest[model.units[k]] for k in columns])
    triangle = np.asarray(np.linalg.qr(regressor[:, columns] / sizes, mode="r"))
    while columns:
        inverse = solve_triangular(triangle, np.eye(len(columns)))
        own = 1.0 / np.linalg.norm(inverse, axis=1)
        least = int(np.argmin(own))
        if own[least] >= FAINT:
            break
        columns = columns[:least] + columns[least + 1 :]
        triangle = np.asarray(np.linalg.qr(np.delete(triangle, least, axis=1), mode="r"))
    return columns


def full_regressor(
    model: Model, seed: int = 0, n_samples: int | None = None, slow: float = 0.3
) -> Array:
    """Regressor of all standard parameters on random states, shape `(n * N, p)`.

    Speeds and accelerations are normally distributed with a standard deviation of 1 rad/s and 1
    rad/s² (m/s, m/s²); a share `slow` of the speeds are much smaller, as laws that fade with speed
    show only there. There are as many states as determine all columns, if no number is given. Loops
    are closed in all states.
    """
    n, p = model.robot.n, len(model.parameters)
    program, places = model.columns_program
    n_samples = 3 * p // n + 10 if n_samples is None else n_samples
    rng = np.random.default_rng(seed)
    q, passive = random_positions(model.robot, n_samples, rng)
    dq, ddq = rng.normal(size=(2, n, n_samples))
    dq *= 10.0 ** (rng.uniform(-4.0, 0.0, dq.shape) * (rng.uniform(size=dq.shape) < slow))
    channels = rng.uniform(-1.0, 1.0, (model.n_channels, n_samples))
    channels[: len(passive)] = passive
    values = run(program, [q, dq, ddq, channels])
    regressor = np.zeros((n, n_samples, p))
    for (row, column), entries in zip(places, values, strict=True):
        regressor[row, :, column] = entries
    return regressor.reshape(n * n_samples, p)


def refuse_twins(model: Model, base: BaseMap) -> None:
    """Causes of torque that no motion distinguishes, bodies aside, are a mistake.

    A rotor's inertia may join a link's: then only their sum is known, and named as such. Two
    frictions that are one leave no such doubt.
    """
    bodies = {p.name for p in RigidBody().parameters(model.robot)}
    for place, k in enumerate(base.dependent):
        if base.names[k] in bodies:
            continue
        others = [
            base.names[base.independent[row]] for row in np.flatnonzero(base.coefficients[:, place])
        ]
        if others and not bodies.intersection(others):
            raise ModelError(
                f"'{base.names[k]}' is not distinguishable from {' and '.join(map(repr, others))}: "
                "no motion separates these torque terms",
                where=f"list of terms of robot '{model.robot.name}'",
                fix="leave one of the terms out, or restrict it to other joints (`joints`)",
            )


TEN = ("M", "MX", "MY", "MZ", "XX", "XY", "YY", "XZ", "YZ", "ZZ")
LETTERS = {
    **dict(zip(INERTIAL_NAMES, TEN, strict=True)),
    **{law: term.symbol for law, term in TERMS.items() if term.symbol},
}
"""Letters of a parameter by what stands before the dot of its name."""


def symbols(robot: Robot, base: BaseMap) -> tuple[str, ...]:
    """The customary symbols of base parameters; their own names where none is customary."""
    found = []
    for name, others in zip(base.base_names, base.coefficients, strict=True):
        kind, _, of = name.partition(".")
        bodies = [b.name for b in robot.bodies]
        inertial = kind in INERTIAL_NAMES
        owners = bodies if inertial else list(robot.joint_names)[robot.n_base :]
        first = 0 if inertial and robot.floating else 1
        place = str(owners.index(of) + first) if of in owners else f"_{of}"
        known = f"{LETTERS[kind]}{place}{'R' if others.any() else ''}" if kind in LETTERS else name
        found.append(known)
    return tuple(found)


@dataclass(frozen=True)
class Layout:
    """Which columns each effort row sees; the measured effort is the last of each row.

    With `mixed` rows are combinations of all rows of a sample, such as those without the unknown
    forces of contacts: errors of one row are in others too.
    """

    columns: tuple[str, ...]
    units: tuple[str, ...]
    rows: tuple[str, ...]
    # per row the indices of the columns that can be nonzero in it, ascending
    sees: tuple[tuple[int, ...], ...]
    mixed: bool = False

    def mixing(self) -> "Layout":
        """The same columns, all of which every row sees."""
        every = tuple(range(len(self.columns)))
        return replace(self, sees=(every,) * len(self.rows), mixed=True)

    def seen_through(self, transform: Array) -> tuple[tuple[int, ...], ...]:
        """What each row sees of parameters that a transform `(columns, new)` leads to these."""
        parts = (np.any(transform[list(seen)] != 0.0, axis=0) for seen in self.sees)
        return tuple(tuple(np.flatnonzero(part).tolist()) for part in parts)

    @cached_property
    def widths(self) -> tuple[int, ...]:
        """Columns seen by each row, the effort included."""
        return tuple(len(seen) + 1 for seen in self.sees)

    @cached_property
    def packed_sizes(self) -> tuple[int, ...]:
        """Entries of the lower triangle of each row's Gram matrix."""
        return tuple(width * (width + 1) // 2 for width in self.widths)

    @cached_property
    def starts(self) -> tuple[int, ...]:
        """Where each row's columns begin when all rows' columns stand one after another."""
        return tuple(int(x) for x in np.cumsum((0, *self.widths))[:-1])


@dataclass(frozen=True, eq=False)
class Regressor:
    """Columns of a model over samples."""

    model: Model
    base: BaseMap
    layout: Layout  # names, and what each row sees
    code: Code  # inputs `q`, `dq`, `ddq`, `channels`, `effort`; outputs as `Layout.starts` says

    def dense(self, q: Array, dq: Array, ddq: Array) -> Array:
        """All entries along a motion of `(n, N)` states: shape `(n, N, columns)`."""
        values = self.code([q, dq, ddq, self.model.scan()(q, dq, ddq), np.zeros_like(q)])
        result = np.zeros((len(self.layout.rows), q.shape[1], len(self.layout.columns)))
        for row, (start, seen) in enumerate(zip(self.layout.starts, self.layout.sees, strict=True)):
            result[row][:, list(seen)] = values[start : start + len(seen)].T
        return result


def base_regressor(model: Model) -> Regressor:
    """The regressor of the structural base parameters."""
    base = base_parameters(model)
    return chosen_regressor(model, base, base.independent)


def standard_regressor(model: Model) -> Regressor:
    """The regressor of all standard parameters."""
    return chosen_regressor(model, base_parameters(model), range(len(model.parameters)))


def chosen_regressor(model: Model, base: BaseMap, columns: Sequence[int]) -> Regressor:
    """The regressor of some standard parameters by their indices, whatever structure says.

    The base parameters may be those of other columns, such as of the terms that are not compared.
    """
    place = {column: k for k, column in enumerate(columns)}

    def build() -> tuple[Program, dict[str, Any]]:
        program, places = model.columns_program
        step_of = dict(zip(places, program.outputs, strict=True))
        inputs = (*program.inputs, Input("effort", model.robot.n))
        efforts = [Step("input", (len(program.inputs), row)) for row in range(model.robot.n)]
        sees: list[list[int]] = [[] for _ in range(model.robot.n)]
        for row, column in places:
            if column in place:
                sees[row].append(place[column])
        outputs: list[int] = []
        for row, seen in enumerate(sees):
            seen.sort()
            outputs += [step_of[row, columns[k]] for k in seen] + [len(program.steps) + row]
        chosen = Program(inputs, (*program.steps, *efforts), tuple(outputs))
        return chosen.pruned(), {"sees": sees}

    code = compiled(["regressor", model.program_key, list(columns)], build)
    layout = Layout(
        columns=tuple(model.names[c] for c in columns),
        units=tuple(model.units[c] for c in columns),
        rows=model.robot.joint_names,
        sees=tuple(tuple(seen) for seen in code.about["sees"]),
    )
    return Regressor(model, base, layout, code)
