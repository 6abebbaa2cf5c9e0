r"""Are positions and efforts measured, or computed: set-points, or what a model says?

A divided difference $\sum_i w_i x_i$ over $k + 1$ rows, with the order $k$ of `DIFFERENCE_ORDER`,
vanishes for polynomials below that order; of white noise it has the standard deviation
$\sigma \|w\|$. What is left of a smooth signal falls with the $k$-th power of the rows' distance,
so noise far below what varies is measured.
"""

import re
from collections.abc import Sequence
from dataclasses import replace
from functools import reduce
from operator import add

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array
from steelyard.base.errors import SteelyardError
from steelyard.check.case_logs_and_checks import Case, CheckedLog, log_check
from steelyard.check.clean_runs_and_customary_model import clean_runs, customary_model
from steelyard.check.finding import Finding, Fix, Severity, percent_of
from steelyard.check.signals.motion_units import driven_joints, unit_reading
from steelyard.check.signals.usable_rows_and_derivatives import signal_overview, with_rows
from steelyard.estimate.information.base_parameters_and_regressor import base_regressor
from steelyard.estimate.information.gather import gather
from steelyard.estimate.least_squares.weighted_robust_and_whitened import WeightedLeastSquares
from steelyard.robot.init.column_names import Column, Quantity, by_number

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
SPEED_TIME, SLOW_JOINT_SHARE = 0.02, 0.05
"""Time over which a speed is taken [s], and the share of the fastest below which a joint rests."""


@log_check("computed efforts", "Are efforts measured, or computed from the motion?", logs=with_rows)
def computed_efforts_check(case: Case, log: CheckedLog) -> Finding | None:
    """Efforts without measurement noise that a rigid-body model explains entirely."""
    if not signal_overview(log).moves:
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
    overview = signal_overview(log)
    t, q, effort = (x[:COMPUTED_EFFORT_ROWS] for x in (overview.t, overview.q, overview.effort))
    step = overview.step * unit_reading(case, log).second
    reach = max(1, round(0.5 * SPEED_TIME / max(step, 1e-9)))
    padded = np.pad(q, ((reach, reach), (0, 0)), mode="edge")
    far = np.abs(padded[2 * reach :] - padded[: -2 * reach])
    moving = far > SLOW_JOINT_SHARE * np.quantile(far, 0.98, axis=0)
    moving &= driven_joints(case, log)
    with np.errstate(invalid="ignore", divide="ignore"):
        of_effort, of_q = (noise_levels(t, x, moving) / x.std(axis=0) for x in (effort, q))
    return of_effort, of_q


def _unexplained(case: Case, log: CheckedLog) -> float | None:
    """Residual of least squares over the effort, all joints together; `None` if there is none."""
    try:
        runs = clean_runs(replace(case, logs=(log,)))
        regressor = base_regressor(customary_model(case))
        information = reduce(add, [gather(regressor, run) for run in runs])
        fit = WeightedLeastSquares().fit(information)
    except (SteelyardError, TypeError):
        return None
    left = information.residual_squares(fit.solution.values)
    return float(np.sqrt(left.sum() / information.effort_squares().sum()))


SMOOTH_POSITION_NOISE = 1e-7
"""Noise or rounding of positions, over their variation, below which no encoder measured them. Least
of the joints' largest on seven real robots, two resampled logs aside: 1e-5."""


@log_check("set points", "Are signals measured, or set-points of the controller?", logs=with_rows)
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
    if not signal_overview(log).moves:
        return Finding.ok("no declared column is called a set-point; nothing moves")
    effort, position = noise_shares(case, log)
    worst = float(np.nanmax(position, initial=0.0))
    figure = (
        f"noise of positions up to {worst:.1g} of their variation, at least "
        f"{SMOOTH_POSITION_NOISE:g} required"
    )
    noisy = bool(np.nanmax(effort, initial=0.0) > NOISE_FREE)
    if noisy and np.isfinite(position).any() and worst < SMOOTH_POSITION_NOISE:
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
