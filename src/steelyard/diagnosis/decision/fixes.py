"""From the interpretation that explains a log to the keys of the robot file that say it."""

from collections.abc import Sequence

import numpy as np

from steelyard.arrays import Array
from steelyard.diagnosis.finding import Edit
from steelyard.diagnosis.hypotheses.by_effort import PERCENT
from steelyard.diagnosis.hypotheses.by_mounting import refined_gravity
from steelyard.diagnosis.hypotheses.by_zero import CAUSE
from steelyard.diagnosis.likelihood.accuracy import spread_of
from steelyard.diagnosis.likelihood.interpretation import Interpretation
from steelyard.diagnosis.likelihood.likelihood import Likelihood
from steelyard.errors import ModelError
from steelyard.robot_file.efforts import MOTOR_KINDS
from steelyard.robot_file.file import load_robot_file
from steelyard.robot_file.loaded import LoadedRobot
from steelyard.robot_file.sections import Gain

DIGITS = 4
"""Significant digits of fitted numbers."""
WHOLE = 0.01
"""Relative distance up to which a gear ratio is taken for a whole number."""
EFFORT = ("signals", "effort")


def edits_of(
    cause: str, likelihood: Likelihood, interpretation: Interpretation, loaded: LoadedRobot
) -> tuple[Edit, ...]:
    """The edits that one cause needs; all causes' edits together make the interpretation."""
    before, s = likelihood.declared, likelihood.signals
    if cause == "joint order":
        return _orders(before, interpretation, s.position, s.effort)
    if cause == "position sign":
        if np.array_equal(np.sign(interpretation.position_scale), np.sign(before.position_scale)):
            return ()
        signs = [int(x) for x in np.sign(interpretation.position_scale)]
        return (Edit(("signals", "position_sign"), signs),)
    if cause == "effort delay":
        return (Edit((*EFFORT, "delay"), round(interpretation.delay, 4)),)
    if cause == "mounting":
        refined = refined_gravity(likelihood, interpretation)
        gravity = [round(float(x), 4) + 0.0 for x in refined]
        return (Edit(("robot", "gravity"), gravity), Edit(("robot", "mounting"), None))
    if cause == CAUSE:
        return zero_edits(likelihood, interpretation)
    if cause in ("effort sign", "effort unit", "effort kind", "gain"):
        return _effort(cause, likelihood, interpretation, loaded)
    return ()


def zero_edits(likelihood: Likelihood, interpretation: Interpretation) -> tuple[Edit, ...]:
    """Zero offsets of all joints."""
    given = likelihood.signals.position_offset
    zeros = np.zeros(likelihood.signals.n) if given is None else given
    if interpretation.zeros is not None:
        zeros = zeros + interpretation.zeros
    return (Edit(("signals", "position_offset"), [round(float(x), 4) + 0.0 for x in zeros]),)


def _orders(
    before: Interpretation, after: Interpretation, position: Sequence[str], effort: Sequence[str]
) -> tuple[Edit, ...]:
    found = []
    if after.position != before.position:
        found.append(Edit(("signals", "position"), [position[k] for k in after.position]))
    if after.effort != before.effort:
        found.append(Edit((*EFFORT, "columns"), [effort[k] for k in after.effort]))
    return tuple(found)


def _effort(
    cause: str, likelihood: Likelihood, after: Interpretation, loaded: LoadedRobot
) -> tuple[Edit, ...]:
    """Kind, unit and gain of the efforts."""
    before, s = likelihood.declared, likelihood.signals
    if np.any(after.ratios != 1.0):
        return _ratios(likelihood, after, loaded)
    factors = after.effort_scale / before.effort_scale
    kinds = () if after.kind in (before.kind, PERCENT) else (Edit((*EFFORT, "kind"), after.kind),)
    if after.kind == "gravity_compensated_torque" != before.kind:
        if before.kind in MOTOR_KINDS or "A" in s.effort_units:
            return (Edit(("robot", "gravity"), [0.0, 0.0, 0.0]),)
        return kinds
    gains = file_gains(likelihood, loaded) * factors
    gain = (
        Edit((*EFFORT, "gain"), _entries(likelihood, gains), _accuracy(cause, likelihood, after)),
    )
    if after.kind == PERCENT:
        kind = Edit((*EFFORT, "kind"), "motor_torque")
        return (kind, Edit((*EFFORT, "unit"), "%"), *gain)
    if after.kind == "motor_current" != before.kind:
        return (*kinds, Edit((*EFFORT, "unit"), "A"), *gain)
    if after.kind == "joint_torque" and before.kind == "motor_current":
        units = list(loaded.robot.effort_units)
        one = units[0] if len(set(units)) == 1 else units
        return (*kinds, Edit((*EFFORT, "unit"), one), Edit((*EFFORT, "gain"), None))
    if set(s.effort_units) == {"A"} and np.allclose(np.abs(factors), np.abs(factors[0])):
        scale = float(np.abs(after.effort_scale[0]))
        unit = {1.0: "A", 1e-3: "mA"}.get(round(scale, 9))
        if unit is not None and abs(factors[0]) != 1.0:
            edits = (Edit((*EFFORT, "unit"), unit),)
            signed = Edit((*EFFORT, "gain"), _entries(likelihood, gains / np.abs(factors)))
            return edits if np.all(factors > 0.0) else (*edits, signed)
    return gain


def _entries(likelihood: Likelihood, gains: Array) -> list[Gain]:
    """The gains as the robot file states them; those that are to be identified stay so."""
    unknown = likelihood.signals.unknown_gains or (False,) * len(gains)
    return ["identify" if left else x for x, left in zip(rounded(gains), unknown, strict=True)]


def _ratios(likelihood: Likelihood, after: Interpretation, loaded: LoadedRobot) -> tuple[Edit, ...]:
    """Gear ratios: whole numbers where one is near."""
    gears = loaded.robot.transmission
    if gears is None:
        return ()
    found = []
    for ratio, factor in zip(np.diag(gears.matrix), after.ratios, strict=True):
        value = float(f"{ratio * factor:.{DIGITS}g}") if factor != 1.0 else float(ratio)
        whole = float(round(value))
        found.append(whole if abs(value - whole) <= WHOLE * abs(value) else value)
    return (Edit(("robot", "transmission", "ratios"), found, spread_of(likelihood, after)),)


def _accuracy(cause: str, likelihood: Likelihood, after: Interpretation) -> float:
    """Of a gain that was fitted; signs and units are exact."""
    return spread_of(likelihood, after) if cause == "gain" else 0.0


def file_gains(likelihood: Likelihood, loaded: LoadedRobot) -> Array:
    """Gains as the robot file gives them: behind what its gears do, shape `(n,)`."""
    s, gears = likelihood.signals, loaded.robot.transmission
    if gears is None:
        return likelihood.gains
    if s.effort_map is not None:
        return np.asarray(np.diag(np.linalg.solve(gears.matrix.T, s.effort_map)))
    try:
        section = load_robot_file(loaded.sources[0].path).signals
    except ModelError:
        return likelihood.gains
    if section is not None and section.effort.side == "motor":
        return np.asarray(likelihood.gains / np.diag(gears.matrix))
    return likelihood.gains


def rounded(values: Array) -> list[float]:
    """To the digits that a fit is worth."""
    return [float(f"{x:.{DIGITS}g}") for x in values]
