r"""What drifted, and when: changes of friction, offsets and effort scales over windows and logs.

The rigid bodies of a robot stay what they are. Per joint $j$ and window the model's residual is
explained by relative changes of its own parts,

$$ \tau_j - \hat\tau_j = \delta_c\,\hat\tau_{c,j} + \delta_v\,\hat\tau_{v,j} + \delta_o
   + \delta_s\,\hat\tau_{b,j} , $$

dry friction, friction that grows with speed, offset and bodies (their scale is that of the efforts:
a drive gain, or a payload). The sums of products of a window give all four with their deviations;
what the model lacks shows as scatter between windows, which widens them.

A quantity may settle within a log, $a + b\,e^{-t/T}$ as it does when the robot gets warm, or change
at a time within it; its level may change from one log on, or steadily over the logs; or it differs
from the model's. Every shape is tested against none, its free time counted, all joints, quantities
and logs counted: $p$ times the number of tests must stay below `LEVEL`.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import floor, log10
from typing import Any, Literal, get_args

import numpy as np

from steelyard.base.arrays import Z95, Array
from steelyard.estimate.changes_from_model import (
    BODIES,
    DRY,
    OF_JOINT,
    OFFSET,
    VISCOUS,
    LocalParameters,
)
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.estimate.information.information import Information

HealthQuantity = Literal["dry friction", "viscous friction", "offset", "effort scale"]
QUANTITIES: tuple[HealthQuantity, ...] = get_args(HealthQuantity)
PLACES = (DRY, VISCOUS, OFFSET, BODIES)  # of these among a joint's changes from the model

LEAST_WINDOW = 10.0  # least length of a window [s]
MOST_WINDOWS_OF_LOG = 32  # windows of a log at most, of `LEAST_WINDOW` or more
DETERMINED = 1e-8  # least eigenvalue of a window's unit-length normal matrix that is used


@dataclass(frozen=True, eq=False)
class Series:
    """A quantity of one joint over windows."""

    joint: str
    quantity: HealthQuantity
    unit: str  # `""` for a relative change, else `Nm` or `N`
    log: Array  # number of the log of each window, rising, shape `(w,)`
    t: Array  # middle of each window from the log's start, shape `(w,)` [s]
    value: Array  # change from the model, shape `(w,)`
    std: Array  # its standard deviation by the window's residuals, shape `(w,)`
    # the same from a single sample, shape `(w,)`: what residuals that another motion explains may
    # change
    single: Array
    scale: float  # what a change is compared with in `MATTERS`
    known: float  # standard deviation of the model's own value

    def by_log(self) -> Iterator[tuple[int, Array, Array, Array]]:
        """Number of each log, and times, values and standard deviations of its windows."""
        for log in np.unique(self.log):
            mine = self.log == log
            yield int(log), self.t[mine], self.value[mine], self.std[mine]


def series_of(identified: IdentifiedModel, logs: Sequence[Information]) -> tuple[Series, ...]:
    """Changes from the model, per joint, quantity and window; efforts of the logs as logged."""
    gains, units = identified.signals.gains, identified.model.robot.effort_units
    scaled = [log.scaled(gains, units) for log in logs]
    local = LocalParameters(identified, logs[0].layout)
    return tuple(one for row in range(len(units)) for one in _of_joint(local, scaled, row))


def _of_joint(local: LocalParameters, logs: Sequence[Information], row: int) -> Iterator[Series]:
    seen, places = list(local.layout.sees[row]), OF_JOINT * row + np.array(PLACES)
    transform = local.transforms[row][:, [*places, -1]]
    grams = np.concatenate([log.row_grams(row) for log in logs])
    counts = np.concatenate([log.counts[:, row] for log in logs])
    small = np.einsum("ki,wkl,lj->wij", transform, grams, transform)
    total = small.sum(axis=0)
    used = [k for k in range(len(QUANTITIES)) if total[k, k] > 0.0]
    chosen = np.ix_([*used, -1], [*used, -1])
    solved = [_solved(gram[chosen], n) for gram, n in zip(small, counts, strict=True)]
    kept = [k for k, one in enumerate(solved) if one is not None]
    if not kept:
        return
    changes, deviations = np.swapaxes([one for one in solved if one is not None], 0, 1)
    log = np.repeat(np.arange(len(logs), dtype=np.float64), [len(one.windows) for one in logs])
    middle = np.array([0.5 * (w.start + w.stop) for one in logs for w in one.windows])
    coordinate = local.identified.model.robot.coordinates[row]
    friction = float(np.sqrt(sum(total[k, k] for k in (0, 1)) / max(counts.sum(), 1.0)))
    covariance, parts = local.covariance[np.ix_(seen, seen)], transform[:-1, used]
    variances = np.einsum("ik,ij,jk->k", parts, covariance, parts)
    known = np.sqrt(np.maximum(variances, 0.0)) / np.square(parts).sum(axis=0)
    for place, k in enumerate(used):
        offset, std = QUANTITIES[k] == "offset", deviations[:, place].copy()
        yield Series(
            joint=coordinate.name,
            quantity=QUANTITIES[k],
            unit=coordinate.effort_unit if offset else "",
            log=log[kept],
            t=middle[kept],
            value=changes[:, place].copy(),
            std=std,
            single=std * np.sqrt(counts[kept]),
            scale=friction if offset else 1.0,
            known=float(known[place]),
        )


def _solved(gram: Array, count: float) -> tuple[Array, Array] | None:
    """Changes and their standard deviations; `None` of a window that does not show them all."""
    matrix, vector, square = gram[:-1, :-1], gram[:-1, -1], float(gram[-1, -1])
    lengths = np.sqrt(np.diag(matrix))
    if count <= len(lengths) + 1 or not np.all(lengths > 0.0):
        return None
    unit = matrix / lengths[:, None] / lengths
    if np.linalg.eigvalsh(unit)[0] < DETERMINED:
        return None
    inverse = np.linalg.inv(unit) / lengths[:, None] / lengths
    values = inverse @ vector
    rest = max(square - float(values @ vector), 1e-12 * square)
    return values, np.sqrt(np.diag(inverse) * rest / (count - len(lengths)))


Shape = Literal["settles", "steps within", "steps", "drifts", "differs"]

FALSE_DRIFT_LEVEL = 0.01  # probability of any false claim of drift in a robot without

LEAST_CHANGE = {"dry friction": 0.1, "viscous friction": 0.1, "offset": 0.1, "effort scale": 0.02}
"""Least change that is called a drift: of friction and scale relative, of an offset relative to the
joint's friction."""

LEAST_WINDOWS_OF_CHANGE = 6  # windows of a log that a change within it needs
SETTLING = np.geomspace(0.05, 2.0, 12)  # time constants that are compared, over a log's length
SETTLING_TIMES_COMPARED = 4.0  # independent ones among them: a fourfold penalty for choosing one
ENOUGH_LOGS = 4  # logs whose scatter shows how far a model errs with other motions

OTHER_MOTION = 0.5  # share of a log's residual that other motion takes up, of fewer logs

UNKNOWN_SCATTER = 4.0  # scatter of windows over their variances that is assumed of few windows
CLEAR_HALF_WIDTHS = 3.0  # half-widths of a large change that is reported of too few windows, too


@dataclass(frozen=True)
class HealthChange:
    """A change of a quantity."""

    joint: str
    quantity: HealthQuantity
    shape: Shape  # `settles` and `steps within` a log, `steps` and `drifts` over logs, or `differs`
    size: float  # change; relative, or in the unit of the effort
    half_width: float  # of its 95 % interval
    unit: str  # `""` for a relative change, else `Nm` or `N`
    logs: tuple[str, str]  # names of the first and last log that it concerns
    time: float | None  # time constant or time of the step within a log [s]; `None` over logs
    p: float  # probability that chance alone does that in any of the tests
    matters: bool  # whether it is significant, and large enough to be called a drift
    # whether it is large and excludes zero by `CLEAR_HALF_WIDTHS` half-widths, but is not
    # significant: windows are too few
    unproven: bool

    @property
    def when(self) -> str:
        """When, for people to read."""
        first, last = self.logs
        if self.shape == "settles":
            return f"settles within {first}, time constant {minutes(self.time)}"
        if self.shape == "steps within":
            return f"in {first} at {minutes(self.time)}"
        if self.shape == "steps":
            return f"between {first} and {last}"
        return f"from {first} to {last}" if self.shape == "drifts" else f"model to {last}"

    @property
    def text(self) -> str:
        """Size with its interval, for people to read."""
        if self.unit:
            digits = min(12, max(0, 1 - floor(log10(max(self.half_width, 1e-12)))))
            return f"{self.size:+.{digits}f} ± {self.half_width:.{digits}f} {self.unit}"
        return f"{round(100.0 * self.size):+d} ± {100.0 * self.half_width:.0f} %"

    def to_dict(self) -> dict[str, Any]:
        """As JSON values."""
        return {**vars(self), "logs": list(self.logs), "when": self.when}


def minutes(seconds: float | None) -> str:
    """A time for people to read."""
    if seconds is None:
        return ""
    return f"{seconds:.0f} s" if seconds < 120.0 else f"{seconds / 60.0:.0f} min"


def changes_of(series: Sequence[Series], names: Sequence[str]) -> tuple[HealthChange, ...]:
    """What changed, the most certain first; of a quantity and place the best shape alone."""
    tests = max(1, len(series) * (len(names) + 2))
    found = [change for one in series for change in _tested(one, names, tests)]
    return tuple(sorted(found, key=lambda change: (not change.matters, change.p)))


@dataclass(frozen=True, eq=False)
class _Fit:
    """Weighted least squares: coefficients, their covariance, and the sum of squares."""

    values: Array
    covariance: Array
    square: float


def _fit(columns: Array, y: Array, std: Array) -> _Fit:
    design, target = columns / std[:, None], y / std
    covariance = np.asarray(np.linalg.pinv(design.T @ design), dtype=np.float64)
    values = covariance @ (design.T @ target)
    return _Fit(values, covariance, float(np.sum(np.square(target - design @ values))))


def _tested(one: Series, names: Sequence[str], tests: int) -> Iterator[HealthChange]:
    inflation, levels = np.sqrt(_inflation(one)), list[tuple[int, float, float]]()
    for log, t, y, std in one.by_log():
        s, settled = inflation * std, np.ones(len(t), dtype=bool)
        if len(y) >= LEAST_WINDOWS_OF_CHANGE:
            best = _within(one, t, y, s, names[log], tests)
            yield best
            if best.p < FALSE_DRIFT_LEVEL:
                settled = t > t[0] + 0.5 * (t[-1] - t[0])
        level = _fit(np.ones((int(settled.sum()), 1)), y[settled], s[settled])
        levels.append((log, float(level.values[0]), float(np.sqrt(level.covariance[0, 0]))))
    apart = OTHER_MOTION * float(np.median(one.single)) if len(levels) < ENOUGH_LOGS else 0.0
    if len(levels) > 1:
        change, apart = _over_logs(one, levels, apart, names, tests)
        yield change
    number, last, spread = levels[-1]
    variance = spread**2 + one.known**2 + apart**2
    chance = _chance(last**2 / variance, len(one.t)) * tests
    places = ("model", names[number])
    yield _change(one, "differs", last, float(np.sqrt(variance)), places, None, chance, few=True)


def _inflation(one: Series) -> float:
    """By how much windows scatter more than their deviations say, neighbours alike included."""
    residuals = []
    for _, t, y, s in one.by_log():
        if len(y) > 3:
            shapes = [_settling(t, _constant(t, y, s)), _step(len(y), _best_cut(y, s))]
            found = min(
                (y - x @ _fit(x, y, s).values for x in shapes), key=lambda r: r / s @ (r / s)
            )
            residuals.append(found / s)
    free = sum(len(own) - 3 for own in residuals)
    if free < 3:
        return UNKNOWN_SCATTER
    square = sum(float(own @ own) for own in residuals)
    neighbours = sum(float(own[1:] @ own[:-1]) for own in residuals)
    alike = float(np.clip(neighbours / max(square, 1e-300), 0.0, 0.8))
    return max(1.0, square / free) * (1.0 + alike) / (1.0 - alike)


def _constant(t: Array, y: Array, s: Array) -> float:
    constants = SETTLING * float(t[-1] - t[0])
    return float(min(constants, key=lambda tau: _fit(_settling(t, tau), y, s).square))


def _settling(t: Array, tau: float) -> Array:
    """Columns of the settled value and of what is left of the start, shape `(w, 2)`."""
    return np.column_stack([np.ones(len(t)), np.exp(-(t - t[0]) / tau)])


def _chance(statistic: float, count: int) -> float:
    """Probability that a parameter makes a sum of squares fall that much; by rounding, below 0."""
    from scipy.special import fdtrc

    return float(fdtrc(1, max(count - 2, 1), max(statistic, 0.0)))


def _within(one: Series, t: Array, y: Array, s: Array, name: str, tests: int) -> HealthChange:
    constant = _fit(np.ones((len(y), 1)), y, s).square
    tau = _constant(t, y, s)
    settling = _fit(_settling(t, tau), y, s)
    ends = _settling(t, tau)[[0, -1]]
    across = ends[1] - ends[0]
    cut = _best_cut(y, s)
    step = _fit(_step(len(t), cut), y, s)
    p_settling = _chance(constant - settling.square, len(t)) * SETTLING_TIMES_COMPARED
    p_step = _chance(constant - step.square, len(t)) * len(t)
    if settling.square <= step.square or p_settling <= p_step:
        size = float(across @ settling.values)
        spread = float(np.sqrt(across @ settling.covariance @ across))
        return _change(one, "settles", size, spread, (name, name), tau, p_settling * tests)
    size, spread = float(step.values[1]), float(np.sqrt(step.covariance[1, 1]))
    at = 0.5 * float(t[cut - 1] + t[cut])
    return _change(one, "steps within", size, spread, (name, name), at, p_step * tests)


def _best_cut(y: Array, s: Array) -> int:
    """The sample from which on a changed value fits best; two or more are on either side."""
    return min(range(2, len(y) - 1), key=lambda k: _fit(_step(len(y), k), y, s).square)


def _step(count: int, at: int) -> Array:
    """Columns of the value before, and of the change from sample `at` on, shape `(count, 2)`."""
    return np.column_stack([np.ones(count), np.arange(count) >= at])


def _over_logs(
    one: Series,
    levels: Sequence[tuple[int, float, float]],
    apart: float,
    names: Sequence[str],
    tests: int,
) -> tuple[HealthChange, float]:
    """The best change of the level over logs, and by how much logs scatter around it.

    Every log may have a motion of its own, with which the model errs in its own way. Of
    `ENOUGH_LOGS` logs their scatter shows by how much, of fewer `apart` is assumed.
    """
    count, number = len(levels), [log for log, _, _ in levels]
    y, s = (np.array([level[k] for level in levels]) for k in (1, 2))
    s = np.hypot(s, apart)
    constant = _fit(np.ones((count, 1)), y, s).square
    cut = min(range(1, count), key=lambda k: _fit(_step(count, k), y, s).square)
    step, looks = _fit(_step(count, cut), y, s), 2.0 * (count - 1)
    shape: Shape = "steps"
    logs = (names[number[cut - 1]], names[number[cut]])
    best, free = step, max(count - 3, 1)
    if count > 2:
        trend = _fit(np.column_stack([np.ones(count), np.linspace(0.0, 1.0, count)]), y, s)
        if trend.square < step.square:
            best, shape, looks, free = trend, "drifts", 2.0, max(count - 2, 1)
            logs = (names[number[0]], names[number[-1]])
    known = count < ENOUGH_LOGS
    scatter = 1.0 if known else max(1.0, best.square / free)
    p = _chance((constant - best.square) / scatter, len(one.t) if known else free + 2)
    size, spread = float(best.values[1]), float(np.sqrt(scatter * best.covariance[1, 1]))
    found = _change(one, shape, size, spread, logs, None, p * looks * tests, few=known)
    return found, apart if known else float(np.sqrt(scatter - 1.0) * np.median(s))


def _change(
    one: Series,
    shape: Shape,
    size: float,
    spread: float,
    logs: tuple[str, str],
    time: float | None,
    p: float,
    *,
    few: bool = False,
) -> HealthChange:
    """A change as tested; of `few` windows or logs one of `CLEAR_HALF_WIDTHS` is reported too."""
    large, sure = abs(size) >= LEAST_CHANGE[one.quantity] * one.scale, p < FALSE_DRIFT_LEVEL
    clear = few and abs(size) > CLEAR_HALF_WIDTHS * Z95 * spread
    return HealthChange(
        joint=one.joint,
        quantity=one.quantity,
        shape=shape,
        size=size,
        half_width=Z95 * spread,
        unit=one.unit,
        logs=logs,
        time=time,
        p=min(p, 1.0),
        matters=bool(large and sure),
        unproven=bool(clear and large and not sure),
    )
