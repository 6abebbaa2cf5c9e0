"""Whether the load, the scale of efforts, or the offset of a joint changes within a run."""

from collections.abc import Iterator
from typing import ClassVar

from steelyard.base.errors import SteelyardError
from steelyard.check.finding import Finding, Fix, Severity
from steelyard.check.fitted.fitted_case import FittedCase
from steelyard.check.fitted.within_run import (
    ChangeWithinRun,
    ScaleDrift,
    load_change,
    offset_steps,
    scale_drifts,
    share_of_drifts,
)
from steelyard.estimate.estimate import Z95
from steelyard.estimate.friction.mixes import has_memory
from steelyard.estimate.information.information import Information
from steelyard.estimate.information.regressor import base_regressor
from steelyard.estimate.nonlinear.fields import information_from

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
SURE_CHANGE = 5.0
"""Standard deviations that a load or a step must have."""


class ChangeInRun:
    """A load that is picked up, or a torque sensor that is zeroed, while a run is logged."""

    name: ClassVar[str] = "change within a run"

    def __call__(self, case: FittedCase) -> tuple[Finding, ...]:
        """Per run one finding of its load, or else its offsets that jump, or else its scale."""
        found: list[Finding] = []
        for run in _runs(case):
            load = load_change(run, case.identified.model.robot, case.identified.base)
            rows = scale_drifts(run)
            drifts = [drift for drift in rows if _sure_drift(drift)]
            picked = load is not None and _certain(
                load, LEAST_LOAD_SHARE, LEAST_CHANGE_RISE["load"]
            )
            if (
                load is not None
                and picked
                and not (drifts and share_of_drifts(rows) > load.explained)
            ):
                found.append(_of_load(load))
                continue
            steps = _likelier(offset_steps(run), drifts)
            found += [_of_offset(step, case) for step in steps]
            if drifts and not steps:
                found.append(_of_drift(drifts, case))
            warm = [drift for drift in scale_drifts(run, friction=True) if _sure_drift(drift)]
            if warm and not drifts and not steps:
                found.append(_of_friction(warm, case))
        return tuple(sorted(found, key=lambda finding: -finding.severity))


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


def _likelier(steps: list[ChangeWithinRun], drifts: list[ScaleDrift]) -> list[ChangeWithinRun]:
    """Steps of offsets that are certain, and explain more than the drift of their row."""
    rows = {drift.row: drift.explained for drift in drifts}
    certain = [
        step for step in steps if _certain(step, LEAST_OFFSET_SHARE, LEAST_CHANGE_RISE["offset"])
    ]
    return [step for step in certain if step.explained > rows.get(step.row, 0.0)]


def _sure_drift(drift: ScaleDrift) -> bool:
    """Whether a scale drifts, without changing its sign."""
    large = abs(drift.change) > max(LEAST_DRIFT, SURE_CHANGE * drift.std) and drift.change > -1.0
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


def _of_load(change: ChangeWithinRun) -> Finding:
    way = "picks up" if change.value > 0.0 else "puts down"
    return Finding(
        ChangeInRun.name,
        change.run,
        Severity.WRONG,
        f"the arm {way} a payload of {abs(change.value):.3g} ± {Z95 * change.std:.1g} kg "
        f"{_when(change)}",
        _explains(change, LEAST_LOAD_SHARE),
        fix=_cut(change),
    )


def _of_offset(change: ChangeWithinRun, case: FittedCase) -> Finding:
    joint = case.identified.model.robot.coordinates[change.row]
    return Finding(
        ChangeInRun.name,
        change.run,
        Severity.DOUBTFUL,
        f"the offset of '{joint.name}' jumps by {change.value:+.3g} ± {Z95 * change.std:.1g} "
        f"{joint.effort_unit} {_when(change)}, as after a new zero of its torque sensor",
        _explains(change, LEAST_OFFSET_SHARE),
        (joint.name,),
        fix=_cut(change),
    )


def _changes(drifts: list[ScaleDrift], case: FittedCase) -> tuple[tuple[str, ...], str]:
    """Names of the joints, and by how much each changes."""
    names = tuple(case.identified.model.robot.coordinates[drift.row].name for drift in drifts)
    words = ", ".join(
        f"'{name}' by {_size(drift.change)}" for name, drift in zip(names, drifts, strict=True)
    )
    return names, words


def _size(change: float) -> str:
    """A relative change in a few words."""
    if change <= LARGEST_PRINTED_CHANGE:
        return f"about {100.0 * change:+.0f} %"
    return f"more than +{100.0 * LARGEST_PRINTED_CHANGE:.0f} %"


def _of_friction(drifts: list[ScaleDrift], case: FittedCase) -> Finding:
    names, words = _changes(drifts, case)
    return Finding(
        ChangeInRun.name,
        drifts[0].run,
        Severity.OK,
        f"friction drifts during the log, as with gears warming up: {words}",
        "",
        names,
        fix=Fix("Log once the gears are warm"),
        headline=True,
    )


def _of_drift(drifts: list[ScaleDrift], case: FittedCase) -> Finding:
    names, words = _changes(drifts, case)
    least = min(drift.explained for drift in drifts)
    return Finding(
        ChangeInRun.name,
        drifts[0].run,
        Severity.DOUBTFUL,
        f"the effort scale drifts during the log, as with a gain or sensor warming up: {words}",
        f"this explains {100.0 * least:.0f} % of the squared residual or more, "
        f"at least {100.0 * LEAST_DRIFT_SHARE:.0f} % required",
        names,
        fix=Fix("Log once the drives are warm, or cut the log into parts: LOG@START:STOP"),
    )
