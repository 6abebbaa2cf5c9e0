r"""Changes within a run, from the fit of each effort row: an offset, a load, a drifting scale.

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
from dataclasses import dataclass

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import SteelyardError
from steelyard.check.finding import Finding, Fix
from steelyard.check.fitted.fitted_case import FittedCase, post_fit_check
from steelyard.check.hypotheses.friction_evidence import whitened_columns
from steelyard.estimate.estimate import Z95
from steelyard.estimate.friction.mixes import has_memory
from steelyard.estimate.information.base_parameters import BaseMap
from steelyard.estimate.information.information import Information
from steelyard.estimate.information.regressor import base_regressor
from steelyard.estimate.nonlinear.fields import information_from
from steelyard.model.laws.register import law_of
from steelyard.robot.rigid_body import INERTIAL_NAMES
from steelyard.robot.robot import Coordinate, Robot

LEAST_LEFT_SHARE = 1e-9  # least share of the squared residual that a change is taken to leave
LEAST_ROW_FREEDOM = 20.0  # degrees of freedom that a row needs
NOISE_ROUNDS = 4  # iterations of the rows' noise


@dataclass(frozen=True)
class ChangeWithinRun:
    """One change in a run."""

    run: str  # the run's name
    time: float  # middle of the time in which it lies [s]
    within: float  # half of that time [s]
    row: int  # number of the joint; -1 for a load
    # step of the offset [effort's unit], mass of the load [kg], or relative change of the scale
    # from the run's start to its end
    value: float
    std: float  # its standard deviation
    # share of the squared residual that it explains: of the row; of a load the geometric mean over
    # rows
    explained: float
    rise: float  # what it takes from the squared residual, over the noise that is left


@dataclass(frozen=True, eq=False)
class _Row:
    """One row of a run around one border: its own least squares, and the sums after the border."""

    after: Array  # gram matrix of columns and effort after the border, shape `(k + 1, k + 1)`
    own: Array  # whitened columns of its own fit, shape `(k, rank)`
    effort: Array  # products of these with the effort, shape `(rank,)`
    left: float  # squared residual
    freedom: float  # degrees of freedom

    def reduced(self, columns: Array) -> tuple[Array, Array]:
        """$H$ and $g$ of combinations of the row's columns, shape `(k, c)`, after the border."""
        shared = self.own.T @ self.after[:-1, :-1] @ columns
        h = columns.T @ self.after[:-1, :-1] @ columns - shared.T @ shared
        return h, columns.T @ self.after[:-1, -1] - shared.T @ self.effort


@dataclass(frozen=True, eq=False)
class _Border:
    """Rows of a run around one border, and when that is."""

    run: str
    time: float
    within: float
    rows: tuple[_Row, ...]


def _borders(run: Information) -> Iterator[_Border]:
    """Every border with a window before and after the two that are left out."""
    grams = [run.row_grams(row) for row in range(len(run.layout.rows))]
    for at in range(2, len(run.windows) - 1):
        used = [*range(at - 1), *range(at + 1, len(run.windows))]
        rows = tuple(
            _row(gram[used].sum(axis=0), gram[at + 1 :].sum(axis=0), run.counts[used, k].sum())
            for k, gram in enumerate(grams)
        )
        start, stop = run.windows[at - 1].start, run.windows[at].stop
        yield _Border(run.windows[at].run, 0.5 * (start + stop), 0.5 * (stop - start), rows)


def _row(whole: Array, after: Array, count: float) -> _Row:
    own = whitened_columns(whole[:-1, :-1])
    effort = own.T @ whole[:-1, -1]
    left = float(whole[-1, -1] - effort @ effort)
    return _Row(after, own, effort, max(left, 0.0), float(count - own.shape[1]))


def offset_steps(run: Information) -> list[ChangeWithinRun]:
    """The most likely step of each joint's offset, for joints that have one."""
    found: dict[int, ChangeWithinRun] = {}
    places = [_offset_of(run, row) for row in range(len(run.layout.rows))]
    for border in _borders(run):
        for number, (row, place) in enumerate(zip(border.rows, places, strict=True)):
            if place is None or row.freedom < LEAST_ROW_FREEDOM or row.left <= 0.0:
                continue
            change = _step(border, row, number, place)
            if number not in found or change.rise > found[number].rise:
                found[number] = change
    return list(found.values())


def _offset_of(run: Information, row: int) -> int | None:
    """Place of the constant among a row's columns; `None` if it has none of its own."""
    seen = run.layout.sees[row]
    mine = [k for k, c in enumerate(seen) if run.layout.columns[c].startswith("offset.")]
    return mine[0] if len(mine) == 1 else None


def _step(border: _Border, row: _Row, number: int, place: int) -> ChangeWithinRun:
    h, g = row.reduced(np.eye(len(row.own))[:, [place]])
    bend, slope = float(h[0, 0]), float(g[0])
    if bend <= LEAST_LEFT_SHARE * row.after[place, place]:
        bend, slope = np.inf, 0.0
    found = _by_one_column(slope, bend, row.left, row.freedom - 1.0)
    return ChangeWithinRun(border.run, border.time, border.within, number, *found)


def _by_one_column(
    slope: float, bend: float, left: float, freedom: float
) -> tuple[float, float, float, float]:
    """Value and standard deviation of one column, the share it explains, and its rise."""
    gain = slope**2 / bend
    noise = max(left - gain, LEAST_LEFT_SHARE * left) / freedom
    return slope / bend, float(np.sqrt(noise / bend)), gain / left, gain / noise


def load_change(run: Information, robot: Robot, base: BaseMap) -> ChangeWithinRun | None:
    """The most likely time from which on the last link carries more, or less, than before."""
    columns = _load_columns(run, robot, base)
    own = [columns[list(seen)] for seen in run.layout.sees]
    changes = []
    for border in _borders(run):
        pairs = zip(border.rows, own, strict=True)
        used = [
            (r, c) for r, c in pairs if r.freedom >= LEAST_ROW_FREEDOM and r.left > 0.0 and c.any()
        ]
        if used:
            changes.append(_load(border, used))
    return max(changes, key=lambda c: c.rise, default=None)


def _load(border: _Border, rows: list[tuple[_Row, Array]]) -> ChangeWithinRun:
    """Ten numbers shared by all rows, each row weighed by the noise that a load leaves to it."""
    before = left = np.array([row.left for row, _ in rows])
    freedom = np.array([row.freedom for row, _ in rows])
    parts = [row.reduced(columns) for row, columns in rows]
    for _ in range(NOISE_ROUNDS):
        noise = left / freedom
        h = sum((h / s for (h, _), s in zip(parts, noise, strict=True)), np.zeros((10, 10)))
        g = sum((g / s for (_, g), s in zip(parts, noise, strict=True)), np.zeros(10))
        inverse = np.linalg.pinv(h, rcond=1e-10, hermitian=True)
        ten = inverse @ g
        gained = np.array([2.0 * g @ ten - ten @ h @ ten for h, g in parts])
        left = np.maximum(before - gained, LEAST_LEFT_SHARE * before)
    return ChangeWithinRun(
        border.run,
        border.time,
        border.within,
        -1,
        float(ten[0]),
        float(np.sqrt(max(inverse[0, 0], 0.0))),
        1.0 - float(np.exp(np.mean(np.log(left / before)))),
        float(np.sum((before - left) * freedom / left)),
    )


def _load_columns(run: Information, robot: Robot, base: BaseMap) -> Array:
    """Ten numbers of the last link to the information's columns, shape `(columns, 10)`.

    Zero where the model has no rigid bodies.
    """
    names = [f"{kind}.{robot.bodies[-1].name}" for kind in INERTIAL_NAMES]
    found = np.zeros((len(run.layout.columns), len(names)))
    if not set(names) <= set(base.names):
        return found
    numbers = [base.names.index(name) for name in names]
    lift, place = base.lift, {name: k for k, name in enumerate(run.layout.columns)}
    for row, name in zip(lift, base.base_names, strict=True):
        if name in place:
            found[place[name]] = row[numbers]
    return found


FEWEST_DRIFT_WINDOWS = 4  # fewest windows of a run whose scale may drift


def scale_drifts(run: Information, *, friction: bool = False) -> tuple[ChangeWithinRun, ...]:
    """The drift of every row whose bodies, or whose friction, show one."""
    if len(run.windows) < FEWEST_DRIFT_WINDOWS:
        return ()
    start, stop = run.windows[0].start, run.windows[-1].stop
    middle = np.array([0.5 * (window.start + window.stop) for window in run.windows])
    time = (middle - middle.mean()) / (stop - start)
    drifts = ((row, _drift_of_row(run, row, time, friction)) for row in range(len(run.layout.rows)))
    about = run.windows[0].run, 0.5 * (start + stop), 0.5 * (stop - start)
    return tuple(ChangeWithinRun(*about, row, *found) for row, found in drifts if found)


def share_of_drifts(rows: Sequence[ChangeWithinRun]) -> float:
    """Share of the squared residual that they explain, geometric mean over rows, as of a load."""
    left = [np.log(max(1.0 - row.explained, LEAST_LEFT_SHARE)) for row in rows]
    return 1.0 - float(np.exp(np.mean(left))) if left else 0.0


def _drift_of_row(
    run: Information, row: int, time: Array, friction: bool
) -> tuple[float, float, float, float] | None:
    """Relative change of the scale of one row, and as of any column; `None` if it shows none."""
    names = [run.layout.columns[c] for c in run.layout.sees[row]]
    chosen = np.array([law_of(name).drifts() == friction for name in names])
    grams = run.row_grams(row)
    whole, once, twice = (np.tensordot(time**k, grams, 1) for k in (0, 1, 2))
    own = whitened_columns(whole[:-1, :-1])
    effort = own.T @ whole[:-1, -1]
    torque = np.where(chosen, own @ effort, 0.0)
    left = float(whole[-1, -1] - effort @ effort)
    freedom = float(run.counts[:, row].sum()) - own.shape[1] - 1.0
    shared = own.T @ once[:-1, :-1] @ torque
    most = float(torque @ twice[:-1, :-1] @ torque)
    bend = most - float(shared @ shared)
    if freedom <= 0.0 or left <= 0.0 or bend <= LEAST_LEFT_SHARE * most:
        return None
    slope = float(torque @ once[:-1, -1] - shared @ effort)
    return _by_one_column(slope, bend, left, freedom)


LEAST_LOAD_SHARE, LEAST_OFFSET_SHARE = 0.5, 0.93
"""Least share of the squared residual that a change explains. In sound logs of nine real robots at
most 0.14 (those shorter than 8 s aside) and 0.43; friction that falls by 60 % has up to 0.78."""
LEAST_CHANGE_RISE = {"load": 200.0, "offset": 100.0}
"""Least rise of the squared residual over noise; at most 92 in those logs, both."""
LEAST_DRIFT_SHARE, DRIFT_RISES, LEAST_DRIFT = 0.3, 100.0, 0.05
"""Least share of a joint's squared residual that a drift of its scale explains, least rise, and
least change; in sound logs of ten real robots the rise is at most 44."""
LARGEST_PRINTED_CHANGE = 3.0
"""Relative change beyond which the number says no more than that it is large."""
SURE_CHANGE = 5.0  # standard deviations that a load or a step must have


@post_fit_check("change within a run")
def change_in_run_check(case: FittedCase) -> Iterable[Finding]:
    """A load that is picked up, or a torque sensor that is zeroed, while a run is logged.

    Per run one finding of its load, or else its offsets that jump, or else its scale.
    """
    found: list[Finding] = []
    coordinates = case.identified.model.robot.coordinates
    for run in _runs(case):
        load = load_change(run, case.identified.model.robot, case.identified.base)
        rows = scale_drifts(run)
        drifts = [drift for drift in rows if _sure_drift(drift)]
        picked = load is not None and _certain(load, LEAST_LOAD_SHARE, LEAST_CHANGE_RISE["load"])
        if load is not None and picked and not (drifts and share_of_drifts(rows) > load.explained):
            way = "picks up" if load.value > 0.0 else "puts down"
            mass = f"{abs(load.value):.3g} ± {Z95 * load.std:.1g} kg"
            says = f"the arm {way} a payload of {mass} {_when(load)}"
            figure = _explains(load, LEAST_LOAD_SHARE)
            found.append(Finding.wrong(says, figure, fix=_cut(load), log=load.run))
            continue
        steps = _likelier(offset_steps(run), drifts)
        found += [_of_offset(step, coordinates[step.row]) for step in steps]
        warm = [drift for drift in scale_drifts(run, friction=True) if _sure_drift(drift)]
        if drifts and not steps:
            least = min(drift.explained for drift in drifts)
            figure = (
                f"this explains {100.0 * least:.0f} % of the squared residual or more, at least "
                f"{100.0 * LEAST_DRIFT_SHARE:.0f} % required"
            )
            says = "the effort scale drifts during the log, as with a gain or sensor warming up"
            fix = Fix("Log once the drives are warm, or cut the log into parts: LOG@START:STOP")
            names, words = _changes(drifts, coordinates)
            log = drifts[0].run
            found.append(Finding.doubtful(f"{says}: {words}", figure, names, fix, log=log))
        elif warm and not steps:
            names, words = _changes(warm, coordinates)
            says = f"friction drifts during the log, as with gears warming up: {words}"
            fix, log = Fix("Log once the gears are warm"), warm[0].run
            found.append(Finding.ok(says, "", names, fix, headline=True, log=log))
    return sorted(found, key=lambda finding: -finding.severity)


def _runs(case: FittedCase) -> Iterator[Information]:
    """Information of each run by windows, of fitted ones as they were fitted."""
    whole, model = case.information, case.identified.model
    if whole is not None:
        for name in dict.fromkeys(window.run for window in whole.windows):
            yield whole.of([k for k, window in enumerate(whole.windows) if window.run == name])
    for run in case.unseen:
        try:
            yield information_from([run], rests=has_memory(model.terms))(base_regressor(model))
        except SteelyardError:
            continue


def _certain(change: ChangeWithinRun, share: float, rise: float) -> bool:
    sure = abs(change.value) > SURE_CHANGE * change.std
    return sure and change.explained >= share and change.rise >= rise


def _likelier(
    steps: Sequence[ChangeWithinRun], drifts: Sequence[ChangeWithinRun]
) -> list[ChangeWithinRun]:
    """Steps of offsets that are certain, and explain more than the drift of their row."""
    rows = {drift.row: drift.explained for drift in drifts}
    return [
        step
        for step in steps
        if _certain(step, LEAST_OFFSET_SHARE, LEAST_CHANGE_RISE["offset"])
        and step.explained > rows.get(step.row, 0.0)
    ]


def _sure_drift(drift: ChangeWithinRun) -> bool:
    """Whether a scale drifts, without changing its sign."""
    large = abs(drift.value) > max(LEAST_DRIFT, SURE_CHANGE * drift.std) and drift.value > -1.0
    return large and drift.explained >= LEAST_DRIFT_SHARE and drift.rise >= DRIFT_RISES


def _when(change: ChangeWithinRun) -> str:
    return f"between {change.time - change.within:.3g} and {change.time + change.within:.3g} s"


def _cut(change: ChangeWithinRun) -> Fix:
    early, late = change.time - change.within, change.time + change.within
    return Fix(
        f"Identify the parts before and after separately: LOG@:{early:.3g} or LOG@{late:.3g}: "
        "(seconds from its start)"
    )


def _explains(change: ChangeWithinRun, bound: float) -> str:
    share = f"{100.0 * change.explained:.0f} % of the squared residual"
    return f"this explains {share}, at least {100.0 * bound:.0f} % required"


def _of_offset(change: ChangeWithinRun, joint: Coordinate) -> Finding:
    return Finding.doubtful(
        f"the offset of '{joint.name}' jumps by {change.value:+.3g} ± {Z95 * change.std:.1g} "
        f"{joint.effort_unit} {_when(change)}, as after a new zero of its torque sensor",
        _explains(change, LEAST_OFFSET_SHARE),
        (joint.name,),
        fix=_cut(change),
        log=change.run,
    )


def _changes(
    drifts: Sequence[ChangeWithinRun], coordinates: Sequence[Coordinate]
) -> tuple[tuple[str, ...], str]:
    """Names of the joints, and by how much each changes."""
    names = tuple(coordinates[drift.row].name for drift in drifts)
    large = f"more than +{100.0 * LARGEST_PRINTED_CHANGE:.0f} %"
    sizes = (
        f"about {100.0 * x.value:+.0f} %" if x.value <= LARGEST_PRINTED_CHANGE else large
        for x in drifts
    )
    return names, ", ".join(f"'{n}' by {size}" for n, size in zip(names, sizes, strict=True))
