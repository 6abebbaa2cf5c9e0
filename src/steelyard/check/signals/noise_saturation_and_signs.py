"""How noisy and finely resolved are signals; are efforts cut off, or without their signs?"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array, stretches
from steelyard.check.case_logs_and_checks import Case, CheckedLog, log_check
from steelyard.check.finding import Finding, Fix, Picture, Severity, of_joints, trace
from steelyard.check.signals.computed_efforts_and_set_points import with_others
from steelyard.check.signals.motion_units import driven_joints, unit_reading
from steelyard.check.signals.usable_rows_and_derivatives import (
    SignalOverview,
    noise_of,
    signal_overview,
    with_rows,
)
from steelyard.runs.first_pass_over_recording import MOVED
from steelyard.runs.run import Run

FEWEST_LEVELS = 50  # different values of an effort below which it is doubtful
FEWEST_LEVEL_ROWS = 500  # rows below which levels are not counted
NOISY_SHARE = 0.7  # noise from row to row over all that varies, from which on an effort is doubtful
LEAVE_COARSE_JOINTS = Fix(
    "leave these joints out (joints = [...], [robot.locked]), or log them with finer resolution"
)
REPAIR_SENSOR = Fix("repair the sensor or its line before the next log")
MOST_NAMED_STRETCHES = 5  # stretches without a measured effort that are named
DECLARE_MEASURED_COLUMNS = Fix(
    "declare the columns that hold measured efforts under [signals.effort]"
)
NOISE_PICTURE_TIME = 20.0  # length of the picture [s]


@log_check("noise", "Are resolution and noise sufficient?", logs=with_rows)
def noise_check(case: Case, log: CheckedLog) -> Finding:
    """Resolution and noise of every signal; efforts of few levels are doubtful, of one wrong."""
    overview = signal_overview(log)
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
    clauses += [words for _, words in dead[:MOST_NAMED_STRETCHES]]
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
    worst, loudest = int(np.argmax(q)), int(np.argmax(noise))
    return (
        f"positions: steps {_range(overview.resolution[c.q])}, noise up to {q[worst]:.1g} "
        f"{positions[worst].unit}; efforts: steps {_range(overview.resolution[c.effort])}, "
        f"noise up to {noise[loudest]:.2g} {units[loudest]} ({case.joints[loudest]})"
    )


def _range(values: Array) -> str:
    low, high = float(values.min()), float(values.max())
    return f"{low:.1g}" if high <= 1.01 * low else f"{low:.1g} to {high:.1g}"


def _noise_picture(case: Case, log: CheckedLog, overview: SignalOverview, joint: int) -> Picture:
    """The joint's effort in the middle of the log."""
    half = 0.5 * NOISE_PICTURE_TIME / unit_reading(case, log).second
    at = np.abs(overview.t - 0.5 * (overview.t[0] + overview.t[-1])) <= half
    unit = log.recording.signals.effort_units[joint]
    t, effort = overview.t[at] - overview.t[0], overview.effort[at, joint]
    return Picture("time [s]", f"effort [{unit}]", (trace(case.joints[joint], t, effort),))


LONG_STAY = 5
"""Stays of usual length that a stay at the highest or lowest value must be long at least."""
OFTEN_AT_LIMIT = 0.005  # share of all rows there from which on an effort is cut off, too
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


@log_check("saturation", "Are efforts saturated?", logs=with_rows)
def saturation_check(case: Case, log: CheckedLog) -> Finding:
    """Efforts that stay at exactly their highest or lowest value."""
    overview = signal_overview(log)
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
    """The longest stay at the highest value, or all of them, whichever is more striking."""
    levels = np.unique(effort)[::-1]
    top, stays = levels[0], _stays(effort, levels[0])
    once = _Stay(float(top), int(stays.max()), np.inf)
    if len(levels) <= STEPS_BESIDE_EXTREME or top - levels[1] > SWITCHED_GAP * (top - levels[-1]):
        return once
    near = levels[1 : 1 + STEPS_BESIDE_EXTREME]
    beside = [_stays(effort, level) for level in near]
    step = float(np.abs(np.diff(levels[: 1 + STEPS_BESIDE_EXTREME])).min())
    pairs = zip(beside, near, strict=True)
    close = [own for own, level in pairs if top - level < REACH_BESIDE_EXTREME * step]
    usual = LONG_STAY * float(np.median(np.concatenate(beside)))
    mean = sum(float(np.square(own).sum() / own.sum()) for own in close) / STEPS_BESIDE_EXTREME
    rows = sum(int(own.sum()) for own in close) / STEPS_BESIDE_EXTREME
    often = max(usual, OFTEN_AT_LIMIT * len(effort), STAY_RATIO * rows)
    once = replace(once, bound=float(np.ceil(max(usual, STAY_RATIO * mean))))
    many = replace(once, rows=int(stays.sum()), bound=float(np.ceil(often)))
    return many if many.share >= 1.0 else once


def _stays(effort: Array, level: float) -> NDArray[np.intp]:
    """Lengths of the stays at a level, in rows."""
    return np.array([stop - start for start, stop in stretches(effort == level)])


@log_check("signed efforts", "Do efforts change their sign?", logs=with_rows)
def signed_efforts_check(case: Case, log: CheckedLog) -> Finding:
    """Efforts of all joints keep one sign, and those of some touch zero."""
    overview = signal_overview(log)
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
