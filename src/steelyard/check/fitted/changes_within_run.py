r"""Changes within a run, from the fit of each effort row: a force, a load, an offset, a scale.

Each effort row of a run is fitted by least squares of its own, from sums per window of time. Around
every border two windows are left out, for the change may lie in either, and columns are added that
are zero before it: a constant, or the ten columns of a load. What they take from the squared
residual follows from the sums alone: with the row's columns $A$, the new ones $P$,
$M = I - A A^+$ and efforts $b$, it is $g^T H^{-1} g$ with $H = P^T M P$ and $g = P^T M b$.
For a drift of the scale the new column is $t\,A_b\hat\phi_b$, the torque of bodies and rotors by
the row's own fit $\hat\phi$ times the time from the run's middle over its length: its factor is
the relative change of the scale.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from steelyard.base.arrays import Z95, Array
from steelyard.base.errors import ModelError, SteelyardError
from steelyard.check.cases_and_checks import case_check
from steelyard.check.finding import SURE_DEVIATIONS, Finding, Fix
from steelyard.check.fitted.disagreeing_runs_and_passing_forces import (
    FINE_WINDOW,
    PassingForce,
    passing_force,
)
from steelyard.check.fitted.fitted_case_causes_and_constraints import FittedCase
from steelyard.check.hypotheses.nuisance_fit_and_score import REWEIGHTINGS, ROUNDING
from steelyard.check.hypotheses.signs_and_delay_by_friction import LEAST_ROW_FREEDOM, own_fit
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.estimate.information.base_parameters_and_regressor import BaseMap, base_regressor
from steelyard.estimate.information.filter_and_gram import ParallelFilter
from steelyard.estimate.information.information import Information
from steelyard.estimate.nonlinear.nonlinear_parameters import information_from
from steelyard.estimate.payload.runs_with_payload import carrier, payload_lift
from steelyard.model.laws.register import law_of
from steelyard.robot.robot import Coordinate, Robot
from steelyard.runs.run import Run


@dataclass(frozen=True)
class ChangeWithinRun:
    """One change in a run."""

    time: float  # middle of the time in which it lies [s]
    within: float  # half of that time [s]
    row: int  # number of the joint; -1 for a load
    # step of the offset [effort's unit], mass of the load [kg], or relative change of the scale
    # from the run's start to its end
    value: float
    std: float  # its standard deviation
    explained: float  # share of the squared residual; of a load the geometric mean over rows
    rise: float  # what it takes from the squared residual, over the noise that is left
    left: float = 0.0  # standard deviation of what one row's residual is beside it [effort's unit]

    @property
    def when(self) -> str:
        """The time in which it lies."""
        return f"between {self.time - self.within:.3g} and {self.time + self.within:.3g} s"

    @property
    def cut(self) -> Fix:
        """The parts before and after it."""
        early, late = self.time - self.within, self.time + self.within
        return Fix(
            "Identify the parts before and after separately: "
            f"LOG@:{early:.3g} or LOG@{late:.3g}: (seconds from its start)"
        )

    def certain(self, share: float, rise: float) -> bool:
        """Whether it explains enough, and is significant."""
        sure = abs(self.value) > SURE_DEVIATIONS * self.std
        return sure and self.explained >= share and self.rise >= rise


@dataclass(frozen=True, eq=False)
class _Row:
    """One row of a run around one border: its own least squares, and the sums after the border."""

    after: Array  # Gram matrix of columns and effort after the border, shape `(k + 1, k + 1)`
    own: Array  # whitened columns of its own fit, shape `(k, rank)`
    effort: Array  # products of these with the effort, shape `(rank,)`
    left: float  # squared residual
    freedom: float  # degrees of freedom

    def reduced(self, columns: Array) -> tuple[Array, Array]:
        """$H$ and $g$ of combinations of the row's columns, shape `(k, c)`, after the border."""
        shared = self.own.T @ self.after[:-1, :-1] @ columns
        h = columns.T @ self.after[:-1, :-1] @ columns - shared.T @ shared
        return h, columns.T @ self.after[:-1, -1] - shared.T @ self.effort

    @property
    def enough(self) -> bool:
        return self.freedom >= LEAST_ROW_FREEDOM and self.left > 0.0


_Border = tuple[tuple[float, float], list[_Row]]
"""Middle and half of the time around one border [s], and the rows of the run there."""


def _borders(run: Information) -> Iterator[_Border]:
    """Every border with a window before and after the two that are left out."""
    grams = [run.row_grams(row) for row in range(len(run.layout.rows))]
    for at in range(2, len(run.windows) - 1):
        used = [*range(at - 1), *range(at + 1, len(run.windows))]
        rows = []
        for k, gram in enumerate(grams):
            whole, count = gram[used].sum(axis=0), run.counts[used, k].sum()
            own, effort, left = own_fit(whole)
            after = gram[at + 1 :].sum(axis=0)
            rows.append(_Row(after, own, effort, max(left, 0.0), float(count - own.shape[1])))
        start, stop = run.windows[at - 1].start, run.windows[at].stop
        yield (0.5 * (start + stop), 0.5 * (stop - start)), rows


def offset_steps(run: Information) -> list[ChangeWithinRun]:
    """The most likely step of each joint's offset, for joints that have one."""
    found: dict[int, ChangeWithinRun] = {}
    names = run.layout.columns
    constants = [
        [k for k, c in enumerate(seen) if names[c].startswith("offset.")]
        for seen in run.layout.sees
    ]
    for about, rows in _borders(run):
        for number, (row, places) in enumerate(zip(rows, constants, strict=True)):
            if len(places) != 1 or not row.enough:
                continue
            h, g = row.reduced(np.eye(len(row.own))[:, places])
            bend, slope = float(h[0, 0]), float(g[0])
            if bend <= ROUNDING * row.after[places[0], places[0]]:
                bend, slope = np.inf, 0.0
            numbers = _by_one_column(slope, bend, row.left, row.freedom - 1.0)
            noise = float(np.sqrt((1.0 - numbers[2]) * row.left / row.freedom))
            change = ChangeWithinRun(*about, number, *numbers, noise)
            if number not in found or change.rise > found[number].rise:
                found[number] = change
    return list(found.values())


def _by_one_column(
    slope: float, bend: float, left: float, freedom: float
) -> tuple[float, float, float, float]:
    """Value and standard deviation of one column, the share it explains, and its rise."""
    gain = slope**2 / bend
    noise = max(left - gain, ROUNDING * left) / freedom
    return slope / bend, float(np.sqrt(noise / bend)), gain / left, gain / noise


def load_change(run: Information, robot: Robot, base: BaseMap) -> ChangeWithinRun | None:
    """The most likely time from which on the last link carries more, or less, than before."""
    try:
        lift = dict(zip(base.base_names, payload_lift(robot, base, carrier(robot)), strict=True))
    except ModelError:
        return None
    columns = np.array([lift.get(name, np.zeros(10)) for name in run.layout.columns])
    own = [columns[list(seen)] for seen in run.layout.sees]
    changes = []
    for about, rows in _borders(run):
        used = [(r, c) for r, c in zip(rows, own, strict=True) if r.enough and c.any()]
        if used:
            changes.append(ChangeWithinRun(*about, -1, *_load(used)))
    return max(changes, key=lambda c: c.rise, default=None)


def _load(rows: list[tuple[_Row, Array]]) -> tuple[float, float, float, float]:
    """Mass, std, share and rise of ten numbers of all rows, weighed by the noise they leave."""
    before = left = np.array([row.left for row, _ in rows])
    freedom = np.array([row.freedom for row, _ in rows])
    h, g = (np.array(x) for x in zip(*(row.reduced(columns) for row, columns in rows), strict=True))
    for _ in range(REWEIGHTINGS):
        worth = freedom / left
        inverse = np.linalg.pinv(np.tensordot(worth, h, 1), rcond=1e-10, hermitian=True)
        ten = inverse @ (worth @ g)
        gained = 2.0 * g @ ten - h @ ten @ ten
        left = np.maximum(before - gained, ROUNDING * before)
    explained = 1.0 - float(np.exp(np.mean(np.log(left / before))))
    rise = float(np.sum((before - left) * freedom / left))
    return float(ten[0]), float(np.sqrt(max(inverse[0, 0], 0.0))), explained, rise


FEWEST_DRIFT_WINDOWS = 4  # fewest windows of a run whose scale may drift


def scale_drifts(run: Information, *, friction: bool = False) -> tuple[ChangeWithinRun, ...]:
    """The drift of every row whose bodies, or whose friction, show one."""
    if len(run.windows) < FEWEST_DRIFT_WINDOWS:
        return ()
    start, stop = run.windows[0].start, run.windows[-1].stop
    middle = np.array([0.5 * (window.start + window.stop) for window in run.windows])
    time = (middle - middle.mean()) / (stop - start)
    drifts = ((row, _drift_of_row(run, row, time, friction)) for row in range(len(run.layout.rows)))
    about = 0.5 * (start + stop), 0.5 * (stop - start)
    return tuple(ChangeWithinRun(*about, row, *found) for row, found in drifts if found)


def _is_steady(run: Information, row: int, friction: bool) -> bool:
    """Whether the scale of a row changes the same way in each half of the run, by its own fit.

    Motion that differs between the halves, or a scale that steps, looks like a drift of the whole.
    """
    half = len(run.windows) // 2
    found = []
    for part in (slice(half), slice(half, None)):
        window = run.windows[part]
        middle = np.array([0.5 * (one.start + one.stop) for one in window])
        time = np.zeros(len(run.windows))
        time[part] = (middle - middle.mean()) / (window[-1].stop - window[0].start)
        found.append(_drift_of_row(run, row, time, friction, part))
    values = [one[0] / one[1] for one in found if one]
    return len(values) == len(found) and (min(values) > Z95 or max(values) < -Z95)


def _drift_of_row(
    run: Information, row: int, time: Array, friction: bool, part: slice = slice(None)
) -> tuple[float, float, float, float] | None:
    """Relative change of the scale of one row in some windows, and as of any column.

    `None` if it shows none.
    """
    names = [run.layout.columns[c] for c in run.layout.sees[row]]
    chosen = np.array([law_of(name).drifts() == friction for name in names])
    time, grams = time[part], run.row_grams(row)[part]
    whole, once, twice = (np.tensordot(time**k, grams, 1) for k in (0, 1, 2))
    own, effort, left = own_fit(whole)
    torque = np.where(chosen, own @ effort, 0.0)
    freedom = float(run.counts[part, row].sum()) - own.shape[1] - 1.0
    shared = own.T @ once[:-1, :-1] @ torque
    most = float(torque @ twice[:-1, :-1] @ torque)
    bend = most - float(shared @ shared)
    if freedom <= 0.0 or left <= 0.0 or bend <= ROUNDING * most:
        return None
    slope = float(torque @ once[:-1, -1] - shared @ effort)
    return _by_one_column(slope, bend, left, freedom)


LEAST_LOAD_SHARE, LEAST_OFFSET_SHARE = 0.5, 0.93
"""Least share of the squared residual that a change explains. In sound logs of nine real robots at
most 0.14 (those shorter than 8 s aside) and 0.43; friction that falls by 60 % has up to 0.78."""
MOST_LEFT_BY_STEP = 8.0  # residual that an offset's step leaves, over noise
LEAST_RISE = 100.0  # of changes over noise; at most 92 in those logs
LEAST_DRIFT_SHARE, LEAST_DRIFT = 0.3, 0.05
"""Share of a joint's squared residual that a drift of its scale explains, and change, at least."""
SHORTEST_WARMING = 120.0
"""Shortest log whose drift may be of something that gets warm [s]: drives, gears and sensors do so
in minutes to hours."""
LARGEST_PRINTED_CHANGE = 3.0  # relative change beyond which it is only called larger


@case_check("change within a run")
def change_in_run_check(case: FittedCase) -> Iterable[Finding]:
    """A force that passes, a load picked up, or a torque sensor zeroed while a run is logged.

    Per run one finding of its force or its load, or else its offsets that jump, or else its scale.
    """
    found = [finding for run, logged in _runs(case) for finding in _of_run(case, run, logged)]
    return sorted(found, key=lambda finding: -finding.severity)


def force_of_run(identified: IdentifiedModel, run: Information, logged: Run) -> PassingForce | None:
    """A force that passes within a run; one that lasts to an end of it may be a load.

    A window's filtered samples are those half the filter's length after its times.
    """
    known = identified.estimate.parameters.as_dict()
    force = passing_force(
        run,
        np.array([known.get(name, 0.0) for name in run.layout.columns]),
        lambda: _gathered(identified, logged, FINE_WINDOW),
    )
    if force is None:
        return None
    taps = ParallelFilter.design(logged.matched_cutoff, logged.rate).taps
    late = 0.5 * (len(taps) - 1) / logged.rate
    return replace(force, start=force.start + late, stop=force.stop + late)


def force_words(force: PassingForce, coordinates: Sequence[Coordinate]) -> str:
    """The joints that bear a passing force, with what it adds to their efforts."""
    sizes = zip((coordinates[row] for row in force.rows), force.sizes, strict=True)
    return ", ".join(f"{c.name} {size:.2g} {c.effort_unit}" for c, size in sizes)


def _of_run(case: FittedCase, run: Information, logged: Run) -> Iterator[Finding]:
    model, base = case.identified.model, case.identified.base
    coordinates, log = model.robot.coordinates, run.runs
    force = force_of_run(case.identified, run, logged)
    if force is not None:
        early, late = f"LOG@:{force.start:.3g}", f"LOG@{force.stop:.3g}:"
        yield Finding.doubtful(
            f"{force.when} a force acts that the other motion of the log does not have, as by a "
            f"contact (rms {force_words(force, coordinates)})",
            f"it explains {100.0 * force.explained:.0f} % of the squared residual",
            tuple(coordinates[row].name for row in force.rows),
            fix=Fix(f"Leave it out: give the parts {early} and {late} (seconds from its start)"),
            log=log,
        )
        return
    load = load_change(run, model.robot, base)
    drifts = [drift for drift in scale_drifts(run) if _sure_drift(drift)]
    drifting = {drift.row: drift.explained for drift in drifts}
    steps = [
        step
        for step in offset_steps(run)
        if step.certain(LEAST_OFFSET_SHARE, LEAST_RISE)
        and step.explained > drifting.get(step.row, 0.0)
        and not _more_is_left(case, step)
    ]
    by_load = load.explained if load else 0.0
    if (
        load
        and max(_together(x, len(coordinates)) for x in (drifts, steps)) <= by_load
        and load.certain(LEAST_LOAD_SHARE, LEAST_RISE)
    ):
        way = "picks up" if load.value > 0.0 else "puts down"
        mass = f"{abs(load.value):.3g} ± {Z95 * load.std:.1g} kg"
        says = f"the arm {way} a payload of {mass} {load.when}"
        yield Finding.wrong(says, _explains(load, LEAST_LOAD_SHARE), fix=load.cut, log=log)
        return
    if steps:
        yield _offsets_found(steps, coordinates, log)
    if not steps:
        warm = [drift for drift in scale_drifts(run, friction=True) if _sure_drift(drift)]
        yield from _drift_found(run, drifts or warm, model.robot.joint_names, friction=not drifts)


def _together(changes: Sequence[ChangeWithinRun], rows: int) -> float:
    """Share that changes of single rows explain, geometric mean over all rows, as of a load."""
    left = [np.log(max(1.0 - change.explained, ROUNDING)) for change in changes]
    return 1.0 - float(np.exp(np.sum(left) / rows))


def _more_is_left(case: FittedCase, step: ChangeWithinRun) -> bool:
    """Whether far more than noise is left: a torque of the position looks like a step."""
    if case.ranked is None:
        return False
    return bool(step.left > MOST_LEFT_BY_STEP * case.ranked.beside.noise[step.row])


def _offsets_found(
    steps: Sequence[ChangeWithinRun], coordinates: Sequence[Coordinate], log: str
) -> Finding:
    names = tuple(coordinates[step.row].name for step in steps)
    sizes = [
        f"{step.value:+.3g} ± {Z95 * step.std:.1g} {coordinates[step.row].effort_unit}"
        for step in steps
    ]
    least = min(steps, key=lambda step: step.explained)
    early = max(step.time - step.within for step in steps)
    late = min(step.time + step.within for step in steps)
    common = replace(least, time=0.5 * (early + late), within=0.5 * (late - early))
    if len(steps) == 1:
        says = f"the offset of '{names[0]}' jumps by {sizes[0]} {common.when}, as after a new zero "
        says += "of its torque sensor"
    else:
        each = ", ".join(f"'{name}' by {size}" for name, size in zip(names, sizes, strict=True))
        when = common.when if early < late else "at different times"
        says = f"the offsets jump {when}, as after a new zero of the torque sensors: {each}"
    cut = common.cut if early < late else least.cut
    return Finding.doubtful(says, _explains(least, LEAST_OFFSET_SHARE), names, fix=cut, log=log)


def _drift_found(
    run: Information, drifts: list[ChangeWithinRun], joints: Sequence[str], *, friction: bool
) -> Iterator[Finding]:
    """The finding on scales, or on friction, that drift; a slow cause only where a log tells it."""
    if not drifts:
        return
    names = tuple(joints[drift.row] for drift in drifts)
    large = f"more than +{100.0 * LARGEST_PRINTED_CHANGE:.0f} %"
    sizes = [
        f"about {100.0 * x.value:+.0f} %" if x.value <= LARGEST_PRINTED_CHANGE else large
        for x in drifts
    ]
    words = ", ".join(f"'{n}' by {size}" for n, size in zip(names, sizes, strict=True))
    slow = 2.0 * drifts[0].within >= SHORTEST_WARMING and all(
        _is_steady(run, drift.row, friction) for drift in drifts
    )
    what, cause = ("friction", "gears") if friction else ("the effort scale", "a gain or sensor")
    way = f"drifts during the log, as with {cause} warming up"
    says = f"{what} {way if slow else 'differs between the parts of the log'}: {words}"
    cut = "the log into parts and compare them: LOG@START:STOP"
    if friction:
        fix = Fix("Log once the gears are warm" if slow else f"Cut {cut}")
        yield Finding.ok(says, "", names, fix, headline=True, log=run.runs)
        return
    least = min(drift.explained for drift in drifts)
    figure = (
        f"this explains {100.0 * least:.0f} % of the squared residual or more, at least "
        f"{100.0 * LEAST_DRIFT_SHARE:.0f} % required"
    )
    fix = Fix(f"Log once the drives are warm, or cut {cut}" if slow else f"Cut {cut}")
    yield Finding.doubtful(says, figure, names, fix, log=run.runs)


def _runs(case: FittedCase) -> Iterator[tuple[Information, Run]]:
    """Information of each run by windows, of fitted ones as they were fitted."""
    whole, fitted = case.information, {run.name: run for run in case.fitted}
    if whole is not None:
        for name, group in whole.windows_of_runs.items():
            yield whole.of(group), fitted[name]
    for run in case.unseen:
        try:
            yield _gathered(case.identified, run), run
        except SteelyardError:
            continue


def _gathered(identified: IdentifiedModel, run: Run, longest: float = np.inf) -> Information:
    rests = identified.model.has_memory
    return information_from([run], rests=rests, longest=longest)(base_regressor(identified.model))


def _sure_drift(drift: ChangeWithinRun) -> bool:
    large = abs(drift.value) > LEAST_DRIFT and drift.value > -1.0
    return large and drift.certain(LEAST_DRIFT_SHARE, LEAST_RISE)


def _explains(change: ChangeWithinRun, bound: float) -> str:
    share = f"{100.0 * change.explained:.0f} % of the squared residual"
    return f"this explains {share}, at least {100.0 * bound:.0f} % required"
