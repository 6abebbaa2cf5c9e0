"""A log to runs of targets and positions, and what is wrong with its targets."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from steelyard.actuators.target_runs import TargetRun
from steelyard.base.arrays import Array, frozen
from steelyard.base.errors import LogError
from steelyard.logs.clocks_and_combined_logs import Numbered
from steelyard.logs.formats import open_log
from steelyard.logs.log_and_errors import require_columns
from steelyard.robot.file.signals import ROW, TargetSignals
from steelyard.robot.robot import Robot
from steelyard.runs.recording import TURN, continuous, wrapped_middles
from steelyard.runs.runs_of_named_logs import LogArgument

LEAST_ROWS, LEAST_SECONDS = 50, 1.0
"""Of a run."""
ABSURD = 1e3  # no joint is so far [rad; m]
MOST_OUT_OF_TIME = 0.9  # share of rows that have to be later than all before them
GAP = 10.0  # times the usual step of the clock: a longer step ends a run
LONGEST_STEP = 0.25  # of the clock [s]: below 4 Hz nothing of an actuator is seen
MOVES = 0.02  # standard deviation from which on a joint's targets tell anything [rad; m]
FOLLOWS, OTHER = 0.5, 0.9
"""Correlation of a joint with its target, and with another one's, that tell another order."""
LAG = 0.1  # by which positions are compared with earlier and later targets [s]
SUPPLIES = (0.6, 1.4)  # of the nominal voltage, that actuators are fed with
UNKNOWN_SUPPLY = 5.0  # stretch without a voltage that is told [s]
SLOPES = (0.5, 2.0)
"""Of positions over targets: outside, their units differ."""


@dataclass(frozen=True, eq=False)
class TargetLog:
    """What one log holds.

    Attributes:
        name: Of the log, with its window.
        runs: Pieces without a gap.
        notes: What was left out, one sentence each.
    """

    name: str
    runs: tuple[TargetRun, ...]
    notes: tuple[str, ...]

    @property
    def seconds(self) -> float:
        """Length of its runs [s]."""
        return sum(run.seconds for run in self.runs)


def read_targets(argument: LogArgument, signals: TargetSignals, robot: Robot) -> TargetLog:
    """The runs of a log; a `LogError` if there is none, or if its targets are others."""
    path, cut = argument.path, argument.cut
    name = path.stem + cut.text
    log = open_log(path)
    log = Numbered(log) if signals.time == ROW else log
    if signals.supply and signals.supply not in log.columns:
        raise LogError(
            f"the log has no column '{signals.supply}' of the supply voltage",
            where=argument.text,
            fix="log it too; or identify without supply_voltage and nominal_voltage",
        )
    require_columns(path, log.columns, signals.columns)
    parts = list(log.parts(signals.columns, cut.rows))
    table = np.concatenate(parts) if parts else np.zeros((0, len(signals.columns)))
    with np.errstate(invalid="ignore"):
        given = np.isfinite(table) & (np.abs(table * _sizes(signals)) < ABSURD)
    n = signals.n
    for column, some in zip(signals.columns, given.T, strict=True):
        if len(table) and not some.any() and column not in signals.effort:
            raise LogError(
                f"the column '{column}' has no number that can be used",
                where=argument.text,
                fix="name the columns of targets and positions under [signals]",
            )
    whole = given[:, : 2 * n + 1].all(axis=1)
    t = table[whole, 0] * signals.time_scale
    q, target = (table[whole, k : k + n] * signals.scale for k in (1, 1 + n))
    rest = np.where(given, table, np.nan)[whole, 1 + 2 * n :]
    effort = rest[:, :n] * signals.effort_scale if signals.effort else np.full(q.shape, np.nan)
    supply = rest[:, -1] if signals.supply else np.ones(len(t))
    rising = np.ones(len(t), dtype=np.bool_)
    rising[1:] = t[1:] > np.maximum.accumulate(t)[:-1]
    if rising.mean() < MOST_OUT_OF_TIME:
        first = int(np.flatnonzero(np.diff(t) <= 0.0)[0])
        raise LogError(
            f"{int((~rising).sum())} of {len(t)} rows are not later than rows before them",
            where=f"{argument.text}, column '{signals.time}', from usable row {first + 1} on",
            fix="correct the clock: a single time that is far ahead has the same effect; or sort "
            "the rows",
        )
    t, q, target, effort, supply = (x[rising] for x in (t, q, target, effort, supply))
    notes = list[str]()
    if signals.supply:
        supply, told = _supplied(t, supply, argument.text, signals)
        notes.append(f"{name}: {told}")
    if len(t):
        seconds = t - t[0]
        inside = (seconds >= cut.seconds[0]) & (seconds < cut.seconds[1])
        some = (seconds, q, target, effort, supply)
        t, q, target, effort, supply = (x[inside] for x in some)
    if dropped := int((~whole).sum() + (~rising).sum()):
        notes.append(f"{name}: {dropped} rows left out: without a number, or out of time")
    runs, short = _pieces(name, t, *_unwrapped(q, target, robot), supply, effort)
    if short:
        notes.append(f"{name}: {short} rows left out, between gaps of the clock")
    if not runs:
        raise LogError(
            f"the log has no {LEAST_ROWS} rows in a row with targets and positions",
            where=argument.text,
            fix="record some seconds at least, or name a longer window",
        )
    step = float(np.median(np.diff(t)))
    if step > LONGEST_STEP:
        raise LogError(
            f"the log has a row every {step:.3g} s, too few to show how joints follow targets",
            where=argument.text,
            fix="log at 20 Hz or more; or check time_unit under [signals] of the robot file",
        )
    found = TargetLog(name, runs, tuple(notes))
    refuse_other_targets(found, robot.joint_names, signals.target, argument.text)
    return found


def _sizes(signals: TargetSignals) -> Array:
    """Rad, m or nothing of the time per logged unit, by column."""
    rest = len(signals.columns) - 2 * signals.n - 1
    return np.concatenate([[0.0], signals.scale, signals.scale, np.zeros(rest)])


def _supplied(t: Array, voltage: Array, where: str, signals: TargetSignals) -> tuple[Array, str]:
    """The supply over the nominal one at all rows, and what is not known of it.

    A `LogError` if it can be none. Rows without a voltage, or of 0 V, have that about them.
    """
    known = np.isfinite(voltage) & (voltage != 0.0)
    if not known.any():
        raise LogError(
            f"the column '{signals.supply}' has no voltage in rows with targets and positions",
            where=where,
            fix="correct supply_voltage under [signals], or leave it out",
        )
    low, high = (float(x) / signals.nominal for x in np.quantile(voltage[known], (0.0, 1.0)))
    if low < SUPPLIES[0] or high > SUPPLIES[1]:
        raise LogError(
            f"the supply is {low:.3g} to {high:.3g} times the nominal voltage",
            where=f"{where}, column '{signals.supply}'",
            fix="give nominal_voltage in the unit of the column; leave supply_voltage out if the "
            "column holds something else",
        )
    times = np.concatenate([t[:1], t[known], t[-1:]])
    longest = float(np.diff(times).max())
    told = f"the supply is {low:.2f} to {high:.2f} of the nominal {signals.nominal:g}"
    if longest > UNKNOWN_SUPPLY:
        told += f", and not logged for up to {longest:.3g} s: that before and after is used"
    return np.interp(t, t[known], voltage[known]) / signals.nominal, told


def _unwrapped(q: Array, target: Array, robot: Robot) -> tuple[Array, Array]:
    """Positions without jumps of a turn, and targets near them."""
    q = q.copy()
    target = target.copy()
    if not len(q):
        return target, q
    for j, middle in enumerate(wrapped_middles([q])):
        if np.isfinite(middle) and robot.coordinates[j].kind == "revolute":
            q[:, j], _ = continuous(q[:, j], float(middle))
            target[:, j] += TURN * np.round((q[:, j] - target[:, j]) / TURN)
    return target, q


def _pieces(
    name: str, t: Array, target: Array, q: Array, supply: Array, effort: Array
) -> tuple[tuple[TargetRun, ...], int]:
    """Runs between gaps of the clock, and how many rows are in none."""
    if len(t) < LEAST_ROWS:
        return (), len(t)
    steps = np.diff(t)
    ends = np.flatnonzero(steps > GAP * np.median(steps)) + 1
    pieces: list[NDArray[np.intp]] = np.split(np.arange(len(t)), ends)
    kept = [r for r in pieces if len(r) >= LEAST_ROWS and t[r[-1]] - t[r[0]] >= LEAST_SECONDS]
    runs = tuple(TargetRun(name, *(frozen(x[r]) for x in (t, target, q, supply, effort)))
                 for r in kept)  # fmt: skip
    return runs, len(t) - sum(map(len, kept))


def unfollowed(log: TargetLog, joints: Sequence[str]) -> list[str]:
    """Joints whose targets move, and whose positions do something else."""
    moving, like, _ = _followed(log)
    return [joints[j] for j in moving if like[j, j] < FOLLOWS]


def ahead_of_targets(log: TargetLog, joints: Sequence[str]) -> list[str]:
    """Joints whose positions come before their targets, where most of those that move do."""
    late, early = np.zeros((2, len(joints)))
    for run in log.runs:
        k = max(1, round(LAG / float(np.median(np.diff(run.t)))))
        q, u = (x - x.mean(axis=0) for x in (run.q, run.target))
        late += (q[k:] * u[:-k]).sum(axis=0)
        early += (q[:-k] * u[k:]).sum(axis=0)
    moving = _followed(log)[0]
    ahead = [joints[j] for j in moving if early[j] > late[j]]
    return ahead if 2 * len(ahead) > len(moving) else []


def _followed(log: TargetLog) -> tuple[list[int], Array, Array]:
    """Joints whose targets move; correlations of positions with targets `(n, n)`, and slopes."""
    q = np.concatenate([run.q for run in log.runs])
    target = np.concatenate([run.target for run in log.runs])
    moving = [j for j in range(q.shape[1]) if target[:, j].std() > MOVES]
    own, theirs = (x - x.mean(axis=0) for x in (q, target))
    power = np.linalg.norm(theirs, axis=0)
    together = own.T @ theirs
    like = together / np.maximum(np.linalg.norm(own, axis=0)[:, None] * power, 1e-12)
    return moving, like, np.diag(together) / np.maximum(power**2, 1e-12)


def refuse_other_targets(
    log: TargetLog, joints: Sequence[str], columns: Sequence[str], where: str
) -> None:
    """A `LogError` where targets are in another order or unit than the positions."""
    moving, like, slopes = _followed(log)
    if not moving:
        raise LogError(
            "no joint's target moves",
            where=where,
            fix="give a log in which joints move, and whose target columns are commands",
        )
    for j in moving:
        best = int(np.argmax(np.abs(like[j])))
        if like[j, j] < FOLLOWS and best != j and abs(like[j, best]) > OTHER:
            raise LogError(
                f"positions of '{joints[j]}' follow the targets '{columns[best]}' (correlation "
                f"{like[j, best]:.2f}), not '{columns[j]}' ({like[j, j]:.2f})",
                where=where,
                fix="correct the order of target, or of position, under [signals]",
            )
        if like[j, j] > OTHER and not SLOPES[0] < slopes[j] < SLOPES[1]:
            raise LogError(
                f"positions of '{joints[j]}' move {slopes[j]:.3g} times as far as their targets",
                where=where,
                fix="targets have the unit of positions: convert the columns of one of them",
            )
        if like[j, j] < -FOLLOWS:
            raise LogError(
                f"positions of '{joints[j]}' move against their targets",
                where=where,
                fix="targets have the sign of positions: change the sign of one of the columns",
            )
