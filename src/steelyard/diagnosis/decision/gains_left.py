"""Whether `gain = "identify"` can be answered from the logs, as `identify` would."""

from steelyard.diagnosis.case import Case
from steelyard.diagnosis.finding import Finding, Fix, Severity
from steelyard.diagnosis.identifiability import clean_runs, customary_model
from steelyard.errors import DataError, SteelyardError
from steelyard.estimation.payload.gains import identified_gains
from steelyard.regression.gather import gather
from steelyard.regression.regressor import base_regressor

SOURCES = (
    "enter the gains of {} before identifying (data sheet: torque constant times gear ratio), or "
    "give `steelyard identify` a log that carries a known mass (--loaded LOG --payload-mass KG)"
)


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
