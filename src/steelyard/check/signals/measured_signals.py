r"""Are signals measured, not computed or commanded, fine enough, not cut off, and with their signs?

A divided difference $\sum_i w_i x_i$ over $k + 1$ rows, with the order $k$ of `DIFFERENCE_ORDER`,
vanishes for polynomials below that order; of white noise it has the standard deviation
$\sigma \|w\|$. What is left of a smooth signal falls with the $k$-th power of the rows' distance,
so noise far below what varies is measured.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array, stretches
from steelyard.base.errors import SteelyardError
from steelyard.check.cases_and_checks import Case, CheckedLog, log_check
from steelyard.check.finding import (
    MOST_NAMED,
    PICTURE_TIME,
    Finding,
    Fix,
    Picture,
    Severity,
    of_joints,
    percent_of,
    trace,
)
from steelyard.check.signals.motion_units import driven_joints, unit_reading
from steelyard.check.signals.usable_rows import SLOW_SHARE, SignalOverview, noise_of
from steelyard.estimate.least_squares.weighted_robust_and_whitened import WeightedLeastSquares
from steelyard.robot.init.column_names import Column, Quantity, by_number
from steelyard.runs.first_pass_over_recording import MOVED
from steelyard.runs.run import Run

DIFFERENCE_ORDER = 6


def noise_levels(t: Array, x: Array, moving: NDArray[np.bool_]) -> Array:
    """Standard deviation of the white noise of each of the signals `(N, n)` while its joint moves.

    The rows' distance in time is taken once from the stamps and once as even, for stamps may
    jitter although rows are even; the lower noise of both counts. The median makes jumps and gaps
    harmless. NaN where fewer than `10 * ORDER` rows are in motion, or more than a tenth of these
    repeat the row before: the signal is quantised too coarsely.
    """
    levels = np.full(x.shape[1], np.nan)
    if len(t) <= DIFFERENCE_ORDER:
        return levels
    found = [np.abs(_difference(s, x)) for s in (t, np.arange(float(len(t))))]
    inside = moving[DIFFERENCE_ORDER // 2 : len(t) - DIFFERENCE_ORDER // 2]
    same = np.diff(x, axis=0, prepend=np.nan) == 0.0
    for j in range(x.shape[1]):
        mine = inside[:, j]
        if mine.sum() >= 10 * DIFFERENCE_ORDER and same[moving[:, j], j].mean() <= 0.1:
            levels[j] = 1.4826 * min(float(np.median(d[mine, j])) for d in found)
    return levels


def _difference(t: Array, x: Array) -> Array:
    """Divided differences with weights of unit length, shape `(N - ORDER, n)`."""
    count = len(t) - DIFFERENCE_ORDER
    at = np.lib.stride_tricks.sliding_window_view(t, DIFFERENCE_ORDER + 1)
    at = at / np.maximum((at[:, -1:] - at[:, :1]) / DIFFERENCE_ORDER, 1e-300)
    apart = at[:, :, None] - at[:, None, :] + np.eye(DIFFERENCE_ORDER + 1)
    weights = 1.0 / np.prod(apart, axis=2)
    weights /= np.linalg.norm(weights, axis=1, keepdims=True)
    return np.asarray(sum(weights[:, [i]] * x[i : i + count] for i in range(DIFFERENCE_ORDER + 1)))


def _other_columns(log: CheckedLog, declared: Sequence[str], quantity: Quantity) -> tuple[str, ...]:
    """Patterns of columns of a quantity, one per declared column, such as `current{}_A`."""
    columns = [Column(name) for name in log.log.columns if name not in declared]
    groups = by_number(len(declared), [c for c in columns if c.quantity == quantity])
    return tuple(re.sub(r"\d+(?=\D*$)", "{}", group[0].name) for group in groups)


def with_others(fix: Fix, log: CheckedLog) -> Fix:
    """The advice, with the effort columns that may be taken instead."""
    return Fix(fix.says + _beside(log, log.recording.signals.effort, "effort"), fix.edits)


def _beside(log: CheckedLog, declared: Sequence[str], quantity: Quantity) -> str:
    others = ", ".join(f"'{one}'" for one in _other_columns(log, declared, quantity))
    return f"; this log has {others} too" if others else ""


NOISE_FREE = 5e-4
"""Noise over all that varies, below which an effort has none. Least of the joints' largest on nine
real robots, those behind a filter aside: 9e-3; of efforts computed from a real motion: 4e-6."""
MEASURED_POSITION_NOISE = 1e-6
"""Noise or rounding of positions, over their variation, from which on they were measured."""
EXPLAINED_BY_MODEL = 0.005
"""Residual of a fit over the effort, below which the model explains all of it. Fits of the nine
real robots leave 0.007 to 0.36."""
LOG_MEASURED_TORQUES = Fix(
    "log the measured torque or the motor current, not the controller's feedforward or model torque"
)
NOISE_FREE_EFFORTS = {
    (True, True): ", and the rigid-body model explains all of them: they were computed from the "
    "motion, not measured, so a fit returns the parameters they were computed with, not the "
    "robot's",
    (True, False): ", and the rigid-body model explains all of them: as positions have no noise "
    "either, the log is a simulation or a computed command; a fit finds the parameters of that "
    "computation",
    (False, True): ", positions have: efforts were computed, or low-passed before they were logged",
    (False, False): " and positions have none: both were low-passed before they were logged, or "
    "computed",
}
"""What they are, by whether a model explains them and positions are measured."""
COMPUTED_EFFORT_ROWS = 20_000
SPEED_TIME = 0.02  # time over which a speed is taken [s]


@log_check("computed efforts", "Are efforts measured, or computed from the motion?", of_rows=True)
def computed_efforts_check(case: Case, log: CheckedLog) -> Finding | None:
    """Efforts without measurement noise that a rigid-body model explains entirely."""
    if not log.overview.moves:
        return None
    effort, position = noise_shares(case, log)
    if not np.isfinite(effort).any():
        says = "the noise of efforts is below their resolution, or nothing moves for long enough"
        return Finding.ok(says, answered=False)
    worst = float(np.nanmax(effort))
    figure = (
        f"noise in motion {percent_of(worst)} of the effort's variation in the noisiest joint, at "
        f"least {percent_of(NOISE_FREE)} required"
    )
    if worst > NOISE_FREE:
        return Finding.ok("efforts have measurement noise", figure)
    measured = bool(np.nanmax(position, initial=0.0) > MEASURED_POSITION_NOISE)
    residual = _unexplained(case, log)
    if residual is not None:
        figure += (
            f"; residual of a fit {percent_of(residual)} of the effort, at least "
            f"{percent_of(EXPLAINED_BY_MODEL)} required"
        )
    explained = residual is not None and residual <= EXPLAINED_BY_MODEL
    says = "efforts have no measurement noise" + NOISE_FREE_EFFORTS[explained, measured]
    if not (explained or measured):
        return Finding.ok(says, figure, answered=False)
    severity = Severity.WRONG if explained and measured else Severity.DOUBTFUL
    return Finding.of(severity, says, figure, fix=with_others(LOG_MEASURED_TORQUES, log))


def noise_shares(case: Case, log: CheckedLog) -> tuple[Array, Array]:
    """Noise of efforts and positions over their variation, NaN where unknown, each `(n,)`."""
    overview = log.overview
    t, q, effort = (x[:COMPUTED_EFFORT_ROWS] for x in (overview.t, overview.q, overview.effort))
    step = overview.step * unit_reading(case, log).second
    reach = max(1, round(0.5 * SPEED_TIME / max(step, 1e-9)))
    padded = np.pad(q, ((reach, reach), (0, 0)), mode="edge")
    far = np.abs(padded[2 * reach :] - padded[: -2 * reach])
    moving = far > SLOW_SHARE * np.quantile(far, 0.98, axis=0)
    moving &= driven_joints(case, log)
    with np.errstate(invalid="ignore", divide="ignore"):
        of_effort, of_q = (noise_levels(t, x, moving) / x.std(axis=0) for x in (effort, q))
    return of_effort, of_q


def _unexplained(case: Case, log: CheckedLog) -> float | None:
    """Residual of least squares over the effort, all joints together; `None` if there is none."""
    try:
        information = case.only(log).information
        fit = WeightedLeastSquares().fit(information)
    except (SteelyardError, TypeError):
        return None
    left = information.residual_squares(fit.values)
    return float(np.sqrt(left.sum() / information.effort_squares().sum()))


@log_check("set points", "Are signals measured, or set-points of the controller?", of_rows=True)
def set_points_check(case: Case, log: CheckedLog) -> Finding:
    """Columns whose names speak of set-points, and positions without noise beside noisy efforts."""
    signals, named, instead = log.recording.signals, [], ""
    declared: dict[Quantity, tuple[str, ...]] = {
        "position": signals.position,
        "velocity": signals.velocity or (),
        "effort": signals.effort,
    }
    for quantity, columns in declared.items():
        if targets := [name for name in columns if Column(name).of_target]:
            more = f" and {len(targets) - 1} more" * (len(targets) > 1)
            named.append(f"{quantity} column '{targets[0]}'{more}")
            instead += _beside(log, columns, quantity)
    if named:
        says = "; ".join(named) + ": commanded by their names, not measured"
        fix = Fix("declare the columns that hold measurements under [signals]" + instead)
        return Finding.doubtful(says, fix=fix)
    if not log.overview.moves:
        return Finding.ok("no declared column is called a set-point; nothing moves")
    effort, position = noise_shares(case, log)
    worst = float(np.nanmax(position, initial=0.0))
    figure = (
        f"noise of positions up to {worst:.1g} of their variation, at least "
        f"{MEASURED_POSITION_NOISE:g} required"
    )
    noisy = bool(np.nanmax(effort, initial=0.0) > NOISE_FREE)
    if noisy and np.isfinite(position).any() and worst < MEASURED_POSITION_NOISE:
        says = (
            "undecided: efforts have measurement noise, and positions are noise-free: commanded "
            "positions, low-passed ones, or those of a simulation"
        )
        return Finding.ok(says, figure, answered=False)
    says = "no declared column is called a set-point, and positions have measurement noise"
    return Finding.ok(says, figure)


def measured_instead(log: CheckedLog) -> tuple[str, ...]:
    """Patterns of effort columns that may be measured, where the declared ones are set-points."""
    declared = log.recording.signals.effort
    targets = any(Column(name).of_target for name in declared)
    return _other_columns(log, declared, "effort") if targets else ()


FEWEST_LEVELS = 50  # different values of an effort below which it is doubtful
FEWEST_LEVEL_ROWS = 500  # rows below which levels are not counted
NOISY_SHARE = 0.7  # noise from row to row over all that varies, from which on an effort is doubtful
LEAVE_COARSE_JOINTS = Fix(
    "leave these joints out (joints = [...], [robot.locked]), or log them with finer resolution"
)
REPAIR_SENSOR = Fix("repair the sensor or its line before the next log")
DECLARE_MEASURED_COLUMNS = Fix(
    "declare the columns that hold measured efforts under [signals.effort]"
)


@log_check("noise", "Are resolution and noise sufficient?", of_rows=True)
def noise_check(case: Case, log: CheckedLog) -> Finding:
    """Resolution and noise of every signal; efforts of few levels are doubtful, of one wrong."""
    overview = log.overview
    move = driven_joints(case, log).copy()
    move[list(log.recording.signals.unactuated)] = False
    levels = np.array([len(np.unique(column)) for column in overview.effort.T])
    noise = noise_of(overview.effort)
    spread = overview.effort.std(axis=0)
    share = np.divide(noise, spread, out=np.zeros_like(noise), where=spread > 0.0)
    constant = move & (levels == 1)
    coarse = move & (levels < FEWEST_LEVELS) & (len(overview.t) >= FEWEST_LEVEL_ROWS) & ~constant
    loud = move & (share > NOISY_SHARE) & ~coarse
    dead = _dead_stretches(case, log)
    silent = np.isin(np.arange(len(move)), [j for j, _ in dead])
    bad = np.flatnonzero(constant | coarse | loud | silent)
    seen = np.flatnonzero(move) if move.any() else np.arange(len(move))
    least, loudest = seen[np.argmin(levels[seen])], seen[np.argmax(share[seen])]
    columns = log.recording.signals.effort
    steps = overview.resolution[overview.channels.effort]
    flat = ", ".join(f"{case.joints[j]} (column '{columns[j]}')" for j in np.flatnonzero(constant))
    noisy = ", ".join(case.joints[j] for j in np.flatnonzero(loud))
    clauses = [f"the effort of {flat} never changes: it is not measured"] if flat else []
    clauses += [
        f"the effort of {case.joints[j]} has only {levels[j]} levels, {steps[j]:.2g} apart"
        for j in np.flatnonzero(coarse)
    ]
    clauses += [f"the effort of {noisy} is mostly noise"] if noisy else []
    clauses += [words for _, words in dead[:MOST_NAMED]]
    clauses.append(_noise_facts(case, overview, noise, log.recording.signals.effort_units))
    fix = DECLARE_MEASURED_COLUMNS if constant.any() else LEAVE_COARSE_JOINTS
    if constant.any() and not overview.effort[:, constant].any():
        listed = ", ".join(f'"{case.joints[j]}"' for j in np.flatnonzero(constant))
        fix = Fix(f"{fix.says}; if no motor drives them, unactuated = [{listed}] there")
    return Finding.of(
        Severity.WRONG if constant.any() else Severity(int(len(bad) > 0)),
        "; ".join(clauses),
        f"{case.joints[least]}: {levels[least]} distinct effort values (at least {FEWEST_LEVELS} "
        f"required); {case.joints[loudest]}: noise is {100.0 * share[loudest]:.2g} % of the "
        f"effort's variation (at most {100.0 * NOISY_SHARE:g} % allowed)"
        + ("" if move.any() else "; efforts of joints at rest are not judged"),
        joints=tuple(case.joints[j] for j in bad),
        fix=with_others(REPAIR_SENSOR if silent[bad].all() else fix, log) if len(bad) else None,
        picture=_noise_picture(case, log, overview, int(bad[0] if len(bad) else least)),
    )


def _dead_stretches(case: Case, log: CheckedLog) -> list[tuple[int, str]]:
    """Joints whose effort keeps one value while they move, and when, in words."""
    if not isinstance(log.run, Run):
        return []
    return [
        (
            j,
            f"the effort of {case.joints[j]} keeps one value from {s.start:.4g} to {s.stop:.4g} s "
            "while it moves, and is left out there",
        )
        for s in log.run.recording.left_out
        for j in s.joints
    ]


def _noise_facts(case: Case, overview: SignalOverview, noise: Array, units: tuple[str, ...]) -> str:
    c = overview.channels
    q, positions = noise_of(overview.q), case.loaded.robot.coordinates
    worst = c.base + int(np.argmax(q[c.base :]))
    loudest = c.base + int(np.argmax(noise[c.base :]))
    steps = overview.resolution[c.encoders], overview.resolution[c.effort][c.base :]
    return (
        f"positions: steps {_range(steps[0])}, noise up to {q[worst]:.1g} "
        f"{positions[worst].unit}; efforts: steps {_range(steps[1])}, "
        f"noise up to {noise[loudest]:.2g} {units[loudest]} ({case.joints[loudest]})"
    )


def _range(values: Array) -> str:
    low, high = float(values.min()), float(values.max())
    return f"{low:.1g}" if high <= 1.01 * low else f"{low:.1g} to {high:.1g}"


def _noise_picture(case: Case, log: CheckedLog, overview: SignalOverview, joint: int) -> Picture:
    half = 0.5 * PICTURE_TIME / unit_reading(case, log).second
    at = np.abs(overview.t - 0.5 * (overview.t[0] + overview.t[-1])) <= half
    unit = log.recording.signals.effort_units[joint]
    t, effort = overview.t[at] - overview.t[0], overview.effort[at, joint]
    return Picture("time [s]", f"effort [{unit}]", (trace(case.joints[joint], t, effort),))


LONG_STAY = 5.0  # rows that a stay at the highest or lowest value is long at least
STEPS_BESIDE_EXTREME, REACH_BESIDE_EXTREME = 5, 5.5
"""Steps of the sensor next to an extreme, for the usual length of a stay at one level; and with
room for rounding."""
STAY_RATIO = 8.0
r"""Stay at the extreme over the mean stay beside it, at least. A smooth peak that fills its highest
level stays $2\sqrt2$ there and $\sqrt{k+1} - \sqrt k$ on each side of the levels below it: a ratio
of 6.9 for $k = 1 ... 5$, and a row more by rounding."""
SWITCHED_GAP = 0.15
"""Distance to the next level over the range, from which on an effort is switched, not cut off."""
FEWEST_UNSIGNED_JOINTS = 2
"""Joints whose effort touches zero and keeps its sign, from which on chance does not explain it."""
TOUCHING_ZERO = 0.05
"""Share of an effort's greatest size that the least must come below. One that carries a weight
throughout stays away from zero."""


@dataclass(frozen=True)
class _Stay:
    """How long an effort stays at an extreme: its value, the rows, and those that are cut off."""

    value: float
    rows: int
    bound: float

    @property
    def share(self) -> float:
        """1 or more of what is cut off."""
        return self.rows / self.bound


@log_check("saturation", "Are efforts saturated?", of_rows=True)
def saturation_check(case: Case, log: CheckedLog) -> Finding:
    """Efforts that stay at exactly their highest or lowest value."""
    overview = log.overview
    ends = [(_highest(x), _highest(-x)) for x in overview.effort.T]
    stays = [
        high if high.share >= low.share else replace(low, value=-low.value) for high, low in ends
    ]
    cut = [j for j, stay in enumerate(stays) if stay.share >= 1.0]
    worst = max(range(len(stays)), key=lambda j: stays[j].share)
    unit = log.recording.signals.effort_units
    clauses = [
        f"the effort of {case.joints[j]} stays at {stays[j].value:.4g} {unit[j]} "
        f"for {stays[j].rows} rows"
        for j in cut
    ]
    bound = stays[worst].bound
    effort = trace(case.joints[worst], overview.t - overview.t[0], overview.effort[:, worst])
    picture = Picture("time [s]", f"effort [{unit[worst]}]", (effort,))
    return Finding.doubtful_if(
        bool(cut),
        "; ".join(clauses) or "no effort stays at its extreme",
        f"{stays[worst].rows} rows at an extreme ({case.joints[worst]})"
        + (f", fewer than {bound:.0f} required" if np.isfinite(bound) else ""),
        Fix("move slower or with less load, or raise the range of the effort measurement"),
        joints=[case.joints[j] for j in cut],
        picture=picture if cut else None,
    )


def _highest(effort: Array) -> _Stay:
    """The longest stay at the highest value."""
    levels = np.unique(effort)[::-1]
    top, rows = float(levels[0]), int(_stays(effort, levels[0]).max())
    if len(levels) <= STEPS_BESIDE_EXTREME or top - levels[1] > SWITCHED_GAP * (top - levels[-1]):
        return _Stay(top, rows, np.inf)
    near = levels[1 : 1 + STEPS_BESIDE_EXTREME]
    step = float(np.abs(np.diff(levels[: 1 + STEPS_BESIDE_EXTREME])).min())
    close = [_stays(effort, x) for x in near if top - x < REACH_BESIDE_EXTREME * step]
    mean = sum(float(np.square(own).sum() / own.sum()) for own in close) / STEPS_BESIDE_EXTREME
    return _Stay(top, rows, float(np.ceil(max(LONG_STAY, STAY_RATIO * mean))))


def _stays(effort: Array, level: float) -> NDArray[np.intp]:
    return np.array([stop - start for start, stop in stretches(effort == level)])


@log_check("signed efforts", "Do efforts change their sign?", of_rows=True)
def signed_efforts_check(case: Case, log: CheckedLog) -> Finding:
    """Efforts of all joints keep one sign, and those of some touch zero."""
    overview = log.overview
    effort, size = overview.effort, np.abs(overview.effort)
    low, high = effort.min(axis=0), effort.max(axis=0)
    moves = (np.ptp(overview.q, axis=0) > MOVED) & (high > low)
    one_sign = moves & ((low >= 0.0) | (high <= 0.0))
    touching = one_sign & (size.min(axis=0) <= TOUCHING_ZERO * size.max(axis=0))
    unsigned = bool(touching.sum() >= FEWEST_UNSIGNED_JOINTS and (one_sign == moves).all())
    joints = tuple(j for j, is_one in zip(case.joints, one_sign, strict=True) if is_one)
    figure = f"{len(joints)} of {int(moves.sum())} joints that move have efforts of one sign"
    if not unsigned:
        return Finding.ok("efforts change their sign, or carry a weight", figure)
    return Finding.doubtful(
        "efforts of all joints that move keep one sign and touch zero, as absolute values do",
        figure,
        joints,
        Fix("log torques or currents with their sign"),
        of_joints("logged effort", [("least", low, "points"), ("greatest", high, "points")]),
    )
