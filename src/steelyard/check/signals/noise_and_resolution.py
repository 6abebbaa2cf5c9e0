"""How noisy are signals, and how finely resolved?"""

import numpy as np

from steelyard.base.arrays import Array
from steelyard.check.case_logs_and_checks import Case, CheckedLog, log_check
from steelyard.check.finding import Finding, Fix, Picture, Severity, trace
from steelyard.check.signals.computed_efforts_and_set_points import with_others
from steelyard.check.signals.motion_units import driven_joints, unit_reading
from steelyard.check.signals.usable_rows_and_derivatives import (
    SignalOverview,
    noise_of,
    signal_overview,
    with_rows,
)
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
