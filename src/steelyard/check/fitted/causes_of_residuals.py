r"""Causes of residuals: what columns that a model lacks explain, and predict of left-out motion.

With weights $1 / \sigma_j^2$ the residuals of a fit have $\chi^2 = \sum_j N_j$; noise accounts
for $\sum_j N_j / r_j^2$ of it, where residuals are $r_j$ times the measurement noise. A cause is a
group of columns $X$ beside those of the model, $A$: the fit of both together lowers $\chi^2$ by
$s^T S^+ s$ with the score $s = X^T W (b - A \hat\phi)$ and $S$ the part of $X^T W X$ that $A$
does not express [Rao1948]. Its share is that over what noise does not account for. Errors of the
geometry enter by the torque's derivatives at the fitted parameters: a large error is found by its
first order.

A term with many parameters explains residuals of the motion it is fitted to, and may predict other
motion worse. Each part of the fitted runs is left out in turn, and predicted by weighted least
squares of all others, without and with the columns of the cause.

Of samples where a joint moves, residuals are also summed up in cells of the position. What is left
of these sums beside a polynomial has the spectrum $|\sum_c r_c e^{-2\pi i f x_c}|$ over frequencies
$f$ per position; near its greatest value, least squares of a polynomial and a sine find the period.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np

from steelyard.base.arrays import Array
from steelyard.estimate.estimate import Estimate
from steelyard.estimate.friction.friction_choice import DIRECTION_LOSS_PROBABILITY, worse
from steelyard.estimate.information.base_parameters_and_regressor import Regressor
from steelyard.estimate.information.information import Information
from steelyard.estimate.least_squares.normal_equations import Runs, lengths_of, solve
from steelyard.estimate.nonlinear.nonlinear_parameters import bodies_of, information_from
from steelyard.estimate.scores.cross_validation import (
    folding,
    left_out_errors,
    logarithms,
    per_fold,
)
from steelyard.estimate.scores.residual_traces_and_band_calibration import residual_blocks
from steelyard.model.laws.friction_over_speed import Quadratic, Stribeck
from steelyard.model.laws.friction_with_memory import Dahl, LoadDependent
from steelyard.model.laws.laws_without_friction import Cogging, Spring
from steelyard.model.model import Model, ValuedModel
from steelyard.model.terms.geometry_and_effort_errors import EffortReadingErrors, GeometryErrors
from steelyard.model.terms.term import StatefulTerm, Term
from steelyard.robot.robot import Robot
from steelyard.runs.run import Run

LEAST_SIZE = 1e-6  # of a joint's typical effort, over the largest
NEW_COLUMN_SHARE = 1e-6  # squared part of a column that the model's must leave for it to count
NAMED_CAUSE_SHARE = 0.2  # share of what noise does not explain from which on a cause is named
GEOMETRY = ("position", "axis")
READING = ("saturation", "hysteresis", "crosstalk")
COMPLEXITY = 0.02  # share of its effect that each further column of a cause costs in the ranking
FRICTION: tuple[tuple[str, Term], ...] = (
    ("Stribeck friction (term stribeck)", Stribeck(speed=0.1)),
    ("friction nonlinear in speed (term quadratic)", Quadratic()),
    ("load-dependent friction (term load_dependent)", LoadDependent()),
    ("presliding friction (term dahl)", Dahl(length=3e-3)),
    ("a spring (term spring)", Spring()),
)
"""Terms that a model may lack, each on all joints."""


@dataclass(frozen=True)
class Cause:
    """One cause, and how much it explains."""

    # `zero_offset`, `gain`, `saturation`, `hysteresis`, `crosstalk`, `compliance`, `position`,
    # `axis`, `tilt` (of the first axis, the same as of gravity), `geometry`, or the law of a term
    kind: str
    joint: str  # empty if it is about all
    says: str  # in a few words
    names: tuple[str, ...]  # of its columns
    chi2: float  # what it takes from chi square
    share: float  # of the chi square that noise does not account for, 0 to 1

    @property
    def columns(self) -> int:
        """Number of its columns."""
        return len(self.names)

    @property
    def rank(self) -> float:
        """What sorts causes: of two that explain alike, the one with fewer columns leads."""
        return self.chi2 * max(0.0, 1.0 - COMPLEXITY * (self.columns - 1))

    @property
    def of_reading(self) -> bool:
        """Whether it is a shape of how an effort is read: many of them are looked for."""
        return self.kind in READING

    @property
    def of_friction(self) -> bool:
        """Whether it is a term of the model's, not an error of the geometry or of the efforts."""
        return self.kind in {Cogging.law, *(term.law for _, term in FRICTION)}


@dataclass(frozen=True, eq=False)
class ResidualShape:
    """Of every joint."""

    size: Array  # root mean square of the predicted effort, shape `(n,)` [Nm; N]
    period: Array  # the period that is strongest in the residual, shape `(n,)` [rad; m]


def wide_model(model: Model, estimate: Estimate, shape: ResidualShape) -> Model:
    """The model with columns of all causes behind its own; those that it has are left out."""
    bodies, values = tuple(bodies_of(estimate).items()), estimate.parameters.as_dict()
    laws = {term.law for term in model.terms}
    periodic = "", Cogging(period=tuple(shape.period.tolist()))
    lacking = [
        term.with_reference(dict(bodies))
        for _, term in (*FRICTION, periodic)
        if term.law not in laws
    ]
    beside = tuple(
        (term, tuple(values.get(p.name, 0.0) for p in term.parameters(model.robot)))
        for term in model.terms
        if term.role != "body" and not isinstance(term, StatefulTerm)
    )
    size = tuple(np.maximum(shape.size, LEAST_SIZE * shape.size.max()).tolist())
    kinds = ("zero_offset", "compliance", *GEOMETRY)
    errors = (GeometryErrors(kinds, bodies), EffortReadingErrors(bodies, size, beside))  # type: ignore[arg-type]
    return replace(model, terms=(*model.terms, *lacking, *errors))


def causes(
    model: Model, information: Information, sigma: Array, ratios: Array, shape: ResidualShape
) -> tuple[Cause, ...]:
    """All causes, the most likely first, from the columns of `wide_model`.

    `sigma` has the standard deviations of the fit's residuals, `ratios` these over the measurement
    noise, NaN where that is not known, each of the shape `(n,)`.
    """
    counts, weights = information.n_samples, _weights(sigma)
    seen = (counts > 0.0) & (sigma > 0.0)
    noise = np.where(np.isfinite(ratios), np.minimum(1.0, 1.0 / np.square(ratios)), 1.0)
    excess = float(np.sum((counts * (1.0 - noise))[seen]))
    joints = model.robot.joint_names
    score, left, scale, names = _scores(model, information, np.where(seen, weights, 0.0))

    def cause(kind: str, of: Sequence[str], says: str, columns: tuple[str, ...]) -> Cause:
        group = [names.index(column) for column in columns]
        values, vectors = np.linalg.eigh(left[np.ix_(group, group)])
        along, new = vectors.T @ score[group], values > NEW_COLUMN_SHARE
        chi2 = float(np.sum(np.square(along[new]) / values[new]))
        # what is periodic in the position goes on above the band, where it counts as noise
        whole = counts[[joints.index(j) for j in of]].sum() if kind == Cogging.law else excess
        share = min(1.0, chi2 / whole) if whole > 0.0 else 0.0
        first = vectors[:1, new] @ (along[new] / values[new]) / scale[group[0]]
        says += OF_VALUE[kind](float(first[0])) if kind in OF_VALUE else ""
        return Cause(kind, of[0] if len(of) == 1 else "", says, columns, chi2, share)

    found = [cause(*group) for group in _groups(model, names, shape.period.tolist())]
    periodic = [x for x in found if x.kind == Cogging.law and x.share >= NAMED_CAUSE_SHARE]
    if len(periodic) > 1:
        of = [x.joint for x in periodic]
        says = _periodic(model.robot, of, [shape.period[joints.index(joint)] for joint in of])
        columns = tuple(name for x in periodic for name in x.names)
        found = [x for x in found if x not in periodic] + [cause(Cogging.law, of, says, columns)]
    return tuple(sorted(found, key=lambda one: -one.rank))


def _weights(sigma: Array) -> Array:
    return np.where(sigma > 0.0, 1.0 / np.square(np.where(sigma > 0.0, sigma, 1.0)), 0.0)


def _scores(
    model: Model, information: Information, weights: Array
) -> tuple[Array, Array, Array, list[str]]:
    """Score and information of the added columns, of unit length each; lengths and names."""
    own, names = set(model.names), information.layout.columns
    per_run = tuple(c for c in names if c in set(model.per_run_names))
    matrix, vector, _, squares = Runs.of(information, per_run).normal(weights)
    scale = lengths_of(squares)
    matrix, vector = matrix / scale[:, None] / scale, vector / scale
    mine = [k for k, c in enumerate(names) if c in own and c not in per_run]
    added = [k for k, c in enumerate(names) if c not in own]
    inverse = np.linalg.pinv(matrix[np.ix_(mine, mine)], rcond=1e-12, hermitian=True)
    across = matrix[np.ix_(added, mine)] @ inverse
    score = vector[added] - across @ vector[mine]
    left = matrix[np.ix_(added, added)] - across @ matrix[np.ix_(mine, added)]
    return score, 0.5 * (left + left.T), scale[added], [names[k] for k in added]


OF_JOINTS = {
    "zero_offset": "zero offset of {}",
    "gain": "gain or scale of the effort of {}",
    "saturation": "gain of {} that",
    "hysteresis": "hysteresis in the effort of {} (it depends on the way to it)",
    "compliance": "elasticity of {}",
}
"""Causes of one column per joint, in words."""
OF_VALUE: dict[str, Callable[[float], str]] = {
    "saturation": lambda x: f" {'falls' if x < 0.0 else 'rises'} with the torque",
    "crosstalk": lambda x: f" ({100.0 * x:.2g} % of it)",
}
"""What follows the words of a cause, by the value of its column."""


def _periodic(robot: Robot, joints: Sequence[str], periods: Sequence[float]) -> str:
    """Efforts with a period in the position, with the term that describes them."""
    often = ", ".join(
        f"{2.0 * np.pi / period:.4g} times per turn"
        if robot.joints[robot.joint_names.index(joint)].kind == "revolute"
        else f"every {period:.4g} m"
        for joint, period in zip(joints, periods, strict=True)
    )
    named = ", ".join(f'"{joint}"' for joint in joints)
    values = ", ".join(f"{period:.5g}" for period in periods)
    listed = f"[{values}]" if len(joints) > 1 else values
    term = f'{{law = "cogging", joints = [{named}], period = {listed}}}'
    says = "an effort of {} that is periodic in its position"
    if len(joints) > 1:
        says = "efforts of {} that are periodic in their positions"
    return f"{says.format(', '.join(joints))}, {often} (term {term})"


def _groups(
    model: Model, names: Sequence[str], periods: Sequence[float]
) -> list[tuple[str, tuple[str, ...], str, tuple[str, ...]]]:
    """Kind, joints, words and columns of every cause whose columns are there."""
    groups: list[tuple[str, tuple[str, ...], str, tuple[str, ...]]] = [
        (kind, (joint,), says.format(joint), (f"{kind}.{joint}",))
        for joint in model.robot.joint_names
        for kind, says in OF_JOINTS.items()
    ]
    joints = model.robot.joint_names
    for k, j in permutations(range(len(joints)), 2):
        says = f"cross-talk of {joints[k]} in the effort of {joints[j]}"
        groups.append(("crosstalk", (joints[j],), says, (f"crosstalk_{k + 1}.{joints[j]}",)))
    for joint, period in zip(joints, periods, strict=True):
        columns = tuple(p.name for p in Cogging(joints=joint).parameters(model.robot))
        says = _periodic(model.robot, (joint,), (period,))
        groups.append((Cogging.law, (joint,), says, columns))
    for body in model.robot.bodies:
        joint, first = body.joint, body.parent < 0
        place = tuple(f"position_{axis}.{joint}" for axis in "xyz")
        groups.append(("position", (joint,), f"position of joint {joint} (link length)", place))
        says = f"tilt of the base (axis of {joint})" if first else f"axis of joint {joint}"
        tilt = tuple(f"axis_{k}.{joint}" for k in (1, 2))
        groups.append(("tilt" if first else "axis", (joint,), says, tilt))
    every = tuple(c for c in names if c.split(".")[0].split("_")[0] in GEOMETRY)
    groups.append(("geometry", (), "geometry of several links (lengths, axes)", every))
    for says, term in FRICTION:
        mine = tuple(p.name for p in term.parameters(model.robot))
        groups.append((term.law, (), says, mine))
    return [g for g in groups if g[3] and set(names).issuperset(g[3])]


WORTH_A_TERM = 0.05  # least relative fall of the error on left-out motion worth another term
WORTH_A_SEARCH = 0.2
"""The same of an error of the geometry or of an effort, which people have to look for on the robot:
its columns stand for other effects as well, and reduce the error of a sound Panda by up to 14 %."""


@dataclass(frozen=True)
class LeftOutGain:
    """Errors on left-out motion without and with a cause."""

    before: float  # geometric mean of a typical joint's and all joints' relative error [%]
    after: float  # the same with it [%]
    confirmed: bool  # whether it falls by more than is worth it, and than chance explains
    left_out: str  # what is left out in turn, `run` or `segment`

    @classmethod
    def of(cls, plain: Array, errors: Array, left_out: str, worth: float) -> "LeftOutGain":
        """Of logarithms of the errors on each part without and with the cause."""
        before, after = float(np.exp(plain.mean())), float(np.exp(errors.mean()))
        confirmed = after < (1.0 - worth) * before and worse(
            plain, errors, DIRECTION_LOSS_PROBABILITY
        )
        return cls(before, after, confirmed, left_out)

    @property
    def words(self) -> str:
        """Both errors."""
        return f"{self.before:.2g} %, with it {self.after:.2g} %"


def left_out_logs(
    model: Model,
    regressor: Regressor,
    sigma: Array,
    runs: Sequence[Run],
    sets: Sequence[Sequence[str]],
) -> tuple[str, list[Array]]:
    """What is left out in turn, and logarithms of the errors on each part by sets of columns.

    Of runs where joints move, by a regressor of the model's columns, or more; `sigma` has the
    standard deviations of the fit's residuals, shape `(n,)`.

    Raises:
        DataError: The runs, or the parts beside one, are too short for a fit.
    """
    divided = folding(runs)
    gathered = information_from(runs, longest=divided.longest)(regressor)
    found, per_run = per_fold(gathered, divided.parts(gathered)), model.per_run_names

    def values_of(information: Information) -> Array:
        # parameters of single runs have their mean over runs, as a new run is expected to have
        solution = solve(Runs.of(information, per_run), _weights(sigma))
        values = solution.values.copy()
        each = [dict(zip(x.columns, x.values, strict=True)) for x in solution.locals]
        for column in {column for one in each for column in one}:
            values[column] = np.mean([one[column] for one in each if column in one])
        return values

    errors = []
    for names in sets:
        some = found.select(names)
        each = [some.of([k]).effort_squares() for k in range(len(some.windows))]
        errors.append(logarithms(left_out_errors(some, some, values_of), np.array(each)))
    return divided.left_out, errors


CELL = {"revolute": 2.0 * np.pi / 4096, "prismatic": 1e-4}  # length of a cell [rad; m]
FEWEST_PERIODS, CELLS_PER_PERIOD = 3, 8  # in the travel, and of the shortest period
DEGREE, FINER = 4, 8  # of the polynomial, and how much finer than the travel frequencies are
NEAR = 81  # frequencies around the greatest of the spectrum that are compared by least squares
NO_PERIOD = 1.0  # where a joint hardly moves


def residual_shape(valued: ValuedModel, runs: Sequence[Run], gains: Array) -> ResidualShape:
    """From the first part of each run."""
    robot = valued.model.robot
    squares, count = np.zeros(robot.n), 0
    cells: list[list[tuple[int, Array, Array]]] = [[] for _ in range(robot.n)]
    for run in runs:
        for block, predicted, rest in residual_blocks(valued, run, gains):
            squares += np.sum(np.square(predicted), axis=1)
            count += predicted.shape[1]
            for j, found in enumerate(cells):
                at = np.floor(block.q[j] / _cell(robot, j)).astype(np.intp)
                low, moving = int(at.min()), block.moving[j]
                sums = np.bincount(at - low, moving * rest[j]).astype(np.float64)
                counts = np.bincount(at - low, moving).astype(np.float64)
                found.append((low, sums, counts))
    periods = [strongest_period(*_joined(c), _cell(robot, j)) for j, c in enumerate(cells)]
    return ResidualShape(np.sqrt(squares / max(count, 1)), np.array(periods))


def _cell(robot: Robot, joint: int) -> float:
    return CELL[robot.joints[joint].kind]


def _joined(cells: Sequence[tuple[int, Array, Array]]) -> tuple[Array, Array]:
    """Sums and counts of all cells from the lowest to the highest."""
    first = min(low for low, _, _ in cells)
    total = np.zeros((2, max(low + len(sums) for low, sums, _ in cells) - first))
    for low, *both in cells:
        total[:, low - first : low - first + len(both[0])] += both
    return total[0], total[1]


def strongest_period(sums: Array, counts: Array, cell: float) -> float:
    """The strongest period of sums of residuals, from those of neighbouring cells `(c,)`."""
    n, weights = len(sums), np.sqrt(counts)
    if n < FEWEST_PERIODS * CELLS_PER_PERIOD:
        return NO_PERIOD
    powers = np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, n), DEGREE)
    trend, size, _ = np.linalg.svd(powers * weights[:, None], full_matrices=False)
    trend = trend[:, size > n * np.finfo(np.float64).eps * size[0]]
    left = sums / np.maximum(weights, 1.0)
    left -= trend @ (trend.T @ left)
    power = np.abs(np.fft.rfft(weights * left, FINER * n))
    first, last = FINER * FEWEST_PERIODS, FINER * n // CELLS_PER_PERIOD
    near = first + int(np.argmax(power[first : last + 1])) + np.linspace(-FINER, FINER, NEAR)
    phases = 2.0 * np.pi * np.outer(near / (FINER * n), np.arange(n) + 0.5)
    waves = weights * np.stack((np.sin(phases), np.cos(phases)), axis=1)
    waves -= waves @ trend @ trend.T
    products = waves @ left
    grams = np.linalg.pinv(waves @ waves.swapaxes(1, 2), hermitian=True)
    explained = np.einsum("ka,kab,kb->k", products, grams, products)
    return float(FINER * n * cell / near[int(np.argmax(explained))])
