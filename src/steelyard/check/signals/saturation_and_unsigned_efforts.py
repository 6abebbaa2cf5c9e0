"""Are efforts cut off at a limit, or logged without their signs?"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array
from steelyard.check.case_logs_and_checks import Case, CheckedLog, log_check
from steelyard.check.finding import Finding, Fix, Picture, of_joints, trace
from steelyard.check.signals.usable_rows_and_derivatives import signal_overview, with_rows
from steelyard.runs.rows.faulty_row_detectors import stretches
from steelyard.runs.rows.frozen_encoders_and_dead_efforts import MOVED

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
