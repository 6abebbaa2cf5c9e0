r"""The frame that carries a payload; runs with and without one as one linear problem.

A run with a payload and one without see the same arm, but the payload in one only and friction of
their own day: old parameters of a run = its transform @ shared parameters.

The payload's numbers, moved to the frame of the body that carries it, add to that body's: with
`lift` the map from standard to base parameters, $\phi_\mathrm{base} + B\,\phi_L$, $B$ = `lift`'s
ten columns of the body times the move.

What such runs say about some parameters, all others free, is a marginal information.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from operator import add

import numpy as np

from steelyard.base.arrays import Z95, Array, places_of
from steelyard.base.errors import DataError, ModelError, named
from steelyard.estimate.information.base_parameters_and_regressor import BaseMap
from steelyard.estimate.information.information import Information
from steelyard.model.model import Model
from steelyard.robot.inertia_and_placement import INERTIAL_NAMES, INERTIAL_UNITS, Inertia
from steelyard.robot.robot import Frame, Robot

SEEN = 1e-10  # share of a parameter's information, all others free, that counts as some
TOUCHED = 1e-4  # component along an unseen direction from which on a parameter is not seen
RANK = 1e-13  # relative eigenvalue of a scaled normal matrix whose direction is left at zero


def inverse(matrix: Array) -> Array:
    """Inverse of a symmetric, non-negative matrix; directions without information stay at zero."""
    size = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    scale = np.where(size > 0.0, size, np.inf)
    values, vectors = np.linalg.eigh(matrix / scale[:, None] / scale)
    kept = values > RANK * values.max(initial=1e-300) * len(values)
    part = vectors[:, kept] / scale[:, None]
    return np.asarray((part / values[kept]) @ part.T)


def marginal(matrix: Array, chosen: Sequence[int]) -> Array:
    """Information left of some when all others are free, $A_{cc} - A_{co} A_{oo}^{-1} A_{oc}$."""
    mine = list(chosen)
    others = [k for k in range(len(matrix)) if k not in set(mine)]
    cross = matrix[np.ix_(mine, others)]
    left = matrix[np.ix_(mine, mine)] - cross @ inverse(matrix[np.ix_(others, others)]) @ cross.T
    return np.asarray((left + left.T) / 2.0)


def _scaled(matrix: Array, chosen: Sequence[int]) -> tuple[Array, Array, Array]:
    """Scale of each chosen parameter, eigenvalues and vectors of what is left about them in it."""
    size = np.sqrt(np.maximum(np.diag(matrix)[list(chosen)], 0.0))
    scale = np.where(size > 0.0, size, np.inf)
    values, vectors = np.linalg.eigh(marginal(matrix, chosen) / scale[:, None] / scale)
    return scale, values, vectors


def seen_information(matrix: Array, chosen: Sequence[int]) -> Array:
    """The same without directions that the data do not see, which rounding leaves in it."""
    scale, values, vectors = _scaled(matrix, chosen)
    seen = values >= SEEN
    kept = vectors[:, seen] * np.where(np.isfinite(scale), scale, 0.0)[:, None]
    return np.asarray((kept * values[seen]) @ kept.T)


def covariance_of(matrix: Array, chosen: Sequence[int]) -> Array:
    """Covariance `(c, c)` of chosen of `p` parameters with an information matrix; NaN if unseen."""
    scale, values, vectors = _scaled(matrix, chosen)
    null = values < SEEN
    kept = vectors[:, ~null] / scale[:, None]
    covariance = np.asarray((kept / values[~null]) @ kept.T)
    blind = np.linalg.norm(vectors[:, null], axis=1) > TOUCHED
    covariance[blind, :] = covariance[:, blind] = np.nan
    return covariance


def carrier(robot: Robot, name: str | None = None) -> Frame:
    """The frame of that name; that of the last link, or of a floating base, if none is named."""
    links = {
        body.name: Frame(body.name, k, np.eye(3), np.zeros(3))
        for k, body in enumerate(robot.bodies)
    }
    frames = links | {frame.name: frame for frame in robot.frames}
    if name is None:
        return links[robot.bodies[0 if robot.floating else -1].name]
    frame = named(name, frames, "frame", "frames", f"robot '{robot.name}'")
    wrong, which = "", ""
    if frame.body < 0:
        wrong, which = "is fixed to the base: a payload there loads no joint", "frame that moves"
    elif robot.bodies[frame.body].massless:
        wrong, which = "lies between two joints of one body, and has no mass", "link with mass"
    if wrong:
        fix = f"name a {which}, such as '{robot.bodies[-1].name}'"
        raise ModelError(f"frame '{name}' {wrong}", where=f"robot '{robot.name}'", fix=fix)
    return frame


def payload_lift(robot: Robot, base: BaseMap, frame: Frame) -> Array:
    """What a payload's ten numbers in a frame add to the base parameters, shape `(b, 10)`."""
    body = robot.bodies[frame.body].name
    if f"{INERTIAL_NAMES[0]}.{body}" not in base.names:
        wrong = "a payload adds to the robot's bodies, but the model's terms have none"
        fix = 'list the term "rigid_body", and identify the model anew'
        raise ModelError(wrong, where=f"robot '{robot.name}', list of terms", fix=fix)
    move = np.array(
        [Inertia.from_ten(e).moved(frame.rotation, frame.position).ten for e in np.eye(10)]
    ).T
    columns = places_of((f"{name}.{body}" for name in INERTIAL_NAMES), base.names)
    return np.asarray(base.lift[:, columns] @ move)


def joined(
    parts: Sequence[tuple[Information, Array]], names: Sequence[str], units: Sequence[str]
) -> Information:
    """All parts as information about the shared parameters, one window each.

    A part is what a run says, and its transform from shared parameters to those of its columns,
    shape `(columns, shared)`. Sums of |column| are not known in the result.
    """
    seen = sum(np.abs(transform) for _, transform in parts)
    sees, found = parts[0][0].layout.seen_through(np.asarray(seen)), []
    for information, transform in parts:
        if not information.windows:
            fix = "leave the run out, or log a motion in which the joints move"
            raise DataError("the run has no usable samples", where="information of a run", fix=fix)
        whole = information.grouped([range(len(information.windows))])
        found.append(replace(whole, beside=None).map(transform, names, units, sees=sees))
    return reduce(add, found)


FREEDOM = 2.0  # expected squares of scores below which they are too few


def scatter(information: Information, values: Array, variances: Array, covariance: Array) -> Array:
    """How many times more than by white residuals a fit scatters, per row, shape `(rows,)`.

    By the scores of windows, or of whole runs where that is more, see `covariance_from_residuals`;
    one where chance explains them. Few windows know a factor badly: it is wider as Student's
    quantile is.
    """
    from scipy.special import stdtrit

    factors = np.ones(len(variances))
    for windows in (information, information.merged(1)):
        found, chance = _scatter(windows, values, variances, covariance)
        wider = np.square(stdtrit(2.0 / np.square(np.maximum(chance, 1e-3)), 0.975) / Z95)
        factors = np.where(found > factors * (1.0 + chance), found * wider, factors)
    return factors


def _scatter(
    windows: Information, values: Array, variances: Array, covariance: Array
) -> tuple[Array, Array]:
    """The same of some windows, and its relative standard deviation by chance."""
    factors, chance = np.ones((2, len(variances)))
    for row, seen in enumerate(windows.layout.sees):
        columns = list(seen)
        grams = windows.row_grams(row) / variances[row]
        scores = grams[:, :-1] @ np.append(-values[columns], 1.0)
        inner = covariance[np.ix_(columns, columns)]
        taken = inner @ grams[:, :-1, :-1]
        # scores of two windows are correlated by -G_w C G_v, as the fit takes part of both
        squares = taken @ taken
        expected = np.trace(taken.sum(axis=0) - squares.sum(axis=0))
        variance = 2.0 * float(
            np.sum(squares.sum(axis=0) * squares.sum(axis=0).T)
            + np.sum((taken - 2.0 * squares) * taken.swapaxes(1, 2))
        )
        if expected >= FREEDOM and len(windows.windows) > 1:
            factors[row] = np.sum((scores @ inner) * scores) / expected
            chance[row] = np.sqrt(max(variance, 0.0)) / expected
    return factors, chance


WINDOWS = 8  # windows kept per run; for the correlation of residuals


def drifting(model: Model, columns: Sequence[str]) -> tuple[int, ...]:
    """Numbers of the columns that differ from day to day: friction, offset, what is per run."""
    steady = model.names_where(lambda term: not (term.drifts() or term.per_run))
    return tuple(k for k, name in enumerate(columns) if name not in steady)


@dataclass(frozen=True, eq=False)
class LoadCase:
    """Runs with and without a payload as one linear problem.

    The parameters are those of the arm, then what each run's friction and offset deviate from them,
    then the ten of each payload.
    """

    information: Information
    n_arm: int  # how many parameters the arm has
    drift: tuple[int, ...]  # columns of the arm that deviate per run
    n_loads: int = 1  # number of payloads; one at least, which may be carried by no run

    @property
    def size(self) -> int:
        """Number of all parameters."""
        return len(self.information.layout.columns)

    @property
    def payload(self) -> tuple[int, ...]:
        """Numbers of the last payload's ten parameters."""
        return self.payloads[-1]

    @property
    def payloads(self) -> tuple[tuple[int, ...], ...]:
        """Numbers of each payload's ten parameters."""
        starts = range(self.size - 10 * self.n_loads, self.size, 10)
        return tuple(tuple(range(start, start + 10)) for start in starts)

    @property
    def deviations(self) -> tuple[tuple[int, ...], ...]:
        """Numbers of the parameters that deviate, per run that does."""
        width = max(len(self.drift), 1)
        inner = range(self.n_arm, self.payloads[0][0])
        return tuple(tuple(inner[k : k + width]) for k in range(0, len(inner), width))


def load_case(
    model: Model,
    base: BaseMap,
    frame: Frame,
    unloaded: Sequence[Information],
    loaded: Sequence[Information],
    *,
    first_deviates: bool,
    zero: Collection[str] = (),
) -> LoadCase:
    """Put runs without and with one payload together; see `combined`.

    Friction and offset of the first run are those of the arm, unless it deviates too.
    """
    runs = (*unloaded, *loaded)
    deviating = range(0 if first_deviates else 1, len(runs))
    return combined(
        model,
        base,
        frame,
        runs,
        [None] * len(unloaded) + [0] * len(loaded),
        [deviating.index(k) if k in deviating else None for k in range(len(runs))],
        zero=zero,
    )


def combined(
    model: Model,
    base: BaseMap,
    frame: Frame,
    runs: Sequence[Information],
    loads: Sequence[int | None],
    days: Sequence[int | None],
    *,
    zero: Collection[str] = (),
) -> LoadCase:
    """Put runs, or parts of one, together.

    `loads` are the numbers of the payloads that they carry, `days` those of their deviations of
    friction and offset; `None` without, or for those of the arm. Base parameters of the arm that
    are known to be `zero` are left out; a payload adds to them too.
    """
    runs = tuple(run.merged(WINDOWS) for run in runs)
    layout = runs[0].layout
    arm = [k for k, name in enumerate(layout.columns) if name not in zero]
    names, units = ([some[k] for k in arm] for some in (layout.columns, layout.units))
    n_arm, drift = len(arm), drifting(model, names)
    n_days, n_loads = (len({k for k in some if k is not None}) for some in (days, loads))
    n_loads = max(n_loads, 1)
    lift = payload_lift(model.robot, base, frame)[places_of(layout.columns, base.base_names)]
    start = n_arm + len(drift) * n_days
    size = start + 10 * n_loads
    parts = []
    for run, load, day in zip(runs, loads, days, strict=True):
        transform = np.zeros((len(layout.columns), size))
        transform[arm, range(n_arm)] = 1.0
        if day is not None:
            own = range(n_arm + len(drift) * day, n_arm + len(drift) * (day + 1))
            transform[[arm[k] for k in drift], own] = 1.0
        if load is not None:
            transform[:, start + 10 * load : start + 10 * load + 10] = lift
        pieces = [run.of([k]) for k in range(len(run.windows))] or [run]
        parts += [(piece, transform) for piece in pieces]
    deviations = [(f"{names[k]} of run {r + 1}", units[k]) for r in range(n_days) for k in drift]
    tens = [
        (f"{name}.payload{k or ''}", unit)
        for k in range(n_loads)
        for name, unit in zip(INERTIAL_NAMES, INERTIAL_UNITS, strict=True)
    ]
    columns = [*zip(names, units, strict=True), *deviations, *tens]
    information = joined(parts, [n for n, _ in columns], [u for _, u in columns])
    return LoadCase(information, n_arm, drift, n_loads)


def refuse_foreign(model: Model, runs: Sequence[Information]) -> None:
    """Runs must have been gathered with the model."""
    for run in runs:
        if run.signature.model != model.fingerprint:
            raise DataError(
                "the runs were gathered with another model",
                where=f"run '{run.windows[0].run if run.windows else '?'}'",
                fix="gather them with the regressor of this model",
            )
