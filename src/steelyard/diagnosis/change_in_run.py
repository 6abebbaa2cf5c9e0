"""Whether the load, or the offset of a joint, changes in the middle of a run."""

from collections.abc import Iterator
from typing import ClassVar

from steelyard.diagnosis.finding import Finding, Judgement, Mend
from steelyard.diagnosis.fitted_case import FittedCase
from steelyard.diagnosis.mid_log import Change, load_change, offset_steps
from steelyard.errors import SteelyardError
from steelyard.estimation.estimate import Z95
from steelyard.estimation.fields import said_by
from steelyard.regression.information import Information
from steelyard.regression.regressor import base_regressor
from steelyard.validation.mixes import remembers

LOAD, OFFSET = 0.5, 0.85
"""Least share of the squared residual that a change explains. In sound logs of nine real robots at
most 0.14 (those shorter than 8 s aside) and 0.43; friction that falls by 60 % has up to 0.78."""
RISES = {"load": 200.0, "offset": 100.0}
"""Least rise of the squared residual over noise; at most 92 in those logs, both."""
SURE = 5.0
"""Standard deviations that a load or a step must have."""


class ChangeInRun:
    """A load that is picked up, or a torque sensor that is zeroed, while a run is logged."""

    name: ClassVar[str] = "change within a run"

    def __call__(self, case: FittedCase) -> tuple[Finding, ...]:
        """One finding per run whose load changes, or else per joint whose offset jumps."""
        found: list[Finding] = []
        for run in _runs(case):
            load = load_change(run, case.identified.model.robot, case.identified.base)
            if load is not None and _certain(load, LOAD, RISES["load"]):
                found.append(_of_load(load))
                continue
            steps = [s for s in offset_steps(run) if _certain(s, OFFSET, RISES["offset"])]
            found += [_of_offset(step, case) for step in steps]
        return tuple(sorted(found, key=lambda finding: -finding.judgement))


def _runs(case: FittedCase) -> Iterator[Information]:
    """Information of each run by windows, of fitted ones as they were fitted."""
    whole, model = case.information, case.identified.model
    if whole is not None:
        for name in dict.fromkeys(window.run for window in whole.windows):
            yield whole.of([k for k, window in enumerate(whole.windows) if window.run == name])
    for run in case.unseen:
        try:
            yield said_by([run], rests=remembers(model.terms))(base_regressor(model))
        except SteelyardError:
            continue


def _certain(change: Change, share: float, rise: float) -> bool:
    sure = abs(change.value) > SURE * change.std
    return sure and change.explained >= share and change.rise >= rise


def _when(change: Change) -> str:
    return f"between {change.time - change.within:.3g} and {change.time + change.within:.3g} s"


def _cut(change: Change) -> Mend:
    early, late = change.time - change.within, change.time + change.within
    return Mend(
        f"take what lies before and after by itself: LOG@:{early:.3g} or LOG@{late:.3g}: "
        "(seconds from its start)"
    )


def _explains(change: Change, bound: float) -> str:
    share = f"{100.0 * change.explained:.0f} % of the squared residual"
    return f"this explains {share}, bound {100.0 * bound:.0f} %"


def _of_load(change: Change) -> Finding:
    way = "picks up" if change.value > 0.0 else "puts down"
    return Finding(
        ChangeInRun.name,
        change.run,
        Judgement.WRONG,
        f"the arm {way} a load of {abs(change.value):.3g} ± {Z95 * change.std:.1g} kg "
        f"{_when(change)}",
        _explains(change, LOAD),
        mend=_cut(change),
    )


def _of_offset(change: Change, case: FittedCase) -> Finding:
    joint = case.identified.model.robot.coordinates[change.row]
    return Finding(
        ChangeInRun.name,
        change.run,
        Judgement.DOUBTFUL,
        f"the offset of '{joint.name}' jumps by {change.value:+.3g} ± {Z95 * change.std:.1g} "
        f"{joint.effort_unit} {_when(change)}, as if its torque sensor were zeroed anew",
        _explains(change, OFFSET),
        (joint.name,),
        mend=_cut(change),
    )
