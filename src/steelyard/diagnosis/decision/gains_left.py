"""What logs say of drive gains: by the controller's own targets, or as `identify` would."""

import numpy as np

from steelyard.diagnosis.case import Case
from steelyard.diagnosis.finding import Edit, Finding, Fix, Severity
from steelyard.diagnosis.hypotheses.alternatives import AMPERES
from steelyard.diagnosis.hypotheses.controller_gains import controller_gains
from steelyard.diagnosis.identifiability import clean_runs, customary_model
from steelyard.errors import DataError, SteelyardError
from steelyard.estimation.payload.gains import identified_gains
from steelyard.regression.gather import gather
from steelyard.regression.regressor import base_regressor
from steelyard.robot_file.sections import Gain

SOURCES = (
    "enter the gains of {} before identifying (data sheet: torque constant times gear ratio), or "
    "give `steelyard identify` a log that carries a known mass (--loaded LOG --payload-mass KG)"
)

NEAR, FAR = 1.15, 1.4
"""Factor from a controller's own gain from which on a declared one is doubtful, and wrong."""


def gains_left(case: Case, name: str) -> tuple[Finding, ...]:
    """One doubtful finding for all logs where they do not show the gains that are left to them.

    Args:
        case: Robot and logs.
        name: Name of the check.
    """
    signals = case.loaded.signals
    if signals is None or not any(signals.unknown_gains):
        return ()
    pairs = list(zip(case.joints, signals.gains, signals.unknown_gains, strict=True))
    unknown = tuple(joint for joint, _, left in pairs if left)
    listed = ", ".join(f"'{joint}'" for joint in unknown)
    try:
        model, runs = customary_model(case), clean_runs(case)
        if not runs:
            return ()
        regressor = base_regressor(model)
        known = {joint: float(gain) for joint, gain, left in pairs if not left}
        identified_gains(model, [gather(regressor, run) for run in runs], known=known)
    except DataError as error:
        says = f"the gains are not identifiable from these logs alone: {error.wrong}"
        figure = f"{len(unknown)} of {len(pairs)} gains to be identified"
        fix = Fix(SOURCES.format("one joint or more" if not known else listed))
        return (Finding(name, "", Severity.DOUBTFUL, says, figure, unknown, fix),)
    except SteelyardError:
        return ()
    return ()


def gains_of_controller(case: Case, name: str) -> tuple[Finding, ...]:
    """Declared gains beside target torque over target current, of all logs; none without targets.

    Args:
        case: Robot and logs.
        name: Name of the check.
    """
    signals, found = case.loaded.signals, controller_gains(case)
    if signals is None or found is None:
        return ()
    declared, values = np.abs(signals.gains), found.values
    unknown = np.array(signals.unknown_gains or (False,) * signals.n)
    both = found.known & ~unknown
    if not both.any():
        return ()
    ratios = np.where(both, values, declared) / declared
    factor = np.exp(np.abs(np.log(ratios)))
    joints = np.flatnonzero(factor > NEAR)
    source = f"{found.columns[0]} over {found.columns[1]}, friction fitted beside it"
    if unit := _other_unit(float(np.median(ratios[both])), float(signals.effort_scale[0])):
        says = f"by the controller's targets ({source}) efforts are in {unit}"
        figure = f"gains are {np.median(ratios[both]):.4g} times the declared ones"
        fix = Fix("declare the unit of the columns", (Edit(("signals", "effort", "unit"), unit),))
        return (Finding(name, "", Severity.WRONG, says, figure, fix=fix),)
    figure = (
        f"gains differ from the controller's by {100.0 * (factor.max() - 1.0):.2g} % or less, "
        f"at most {100.0 * (NEAR - 1.0):.0f} % allowed"
    )
    if not len(joints):
        what = "the gains" if np.all(signals.gains[both] > 0.0) else "the sizes of the gains"
        says = f"the controller's targets confirm {what} ({source})"
        if left := ", ".join(case.joints[j] for j in np.flatnonzero(~found.known)):
            says = f"undecided for {left}; {says} of the other joints"
        return (Finding(name, "", Severity.OK, says, figure, answered=not left),)
    listed = ", ".join(
        f"{case.joints[j]} {values[j]:.4g} ± {found.half_widths[j]:.2g}, declared {declared[j]:.4g}"
        for j in joints
    )
    says = f"the controller's targets give other gains: {listed}"
    entries: list[Gain] = [
        "identify" if left else float(gain)
        for gain, left in zip(signals.gains, unknown, strict=True)
    ]
    for j in joints:
        entries[j] = float(f"{np.copysign(values[j], signals.gains[j]):.4g}")
    severity = Severity.WRONG if factor.max() > FAR else Severity.DOUBTFUL
    fix = Fix(
        f"take these gains, from {source}, or correct those of the data sheet",
        (Edit(("signals", "effort", "gain"), entries),),
    )
    named = tuple(case.joints[j] for j in joints)
    return (Finding(name, "", severity, says, figure, named, fix),)


def _other_unit(ratio: float, scale: float) -> str:
    """The unit of current by which the controller's gains are those declared; empty if none.

    Args:
        ratio: The controller's gains over those declared.
        scale: The declared unit [A].
    """
    for unit, size in AMPERES.items():
        if size != scale and abs(np.log(ratio * scale / size)) < np.log(FAR):
            return unit
    return ""
