"""What to do where a number is poorly identified from a log: where to take it from, in order."""

import numpy as np

from steelyard.diagnosis.case import Case
from steelyard.diagnosis.finding import Edit, Fix
from steelyard.diagnosis.hypotheses.controller_gains import ControllerGains, controller_gains
from steelyard.diagnosis.hypotheses.hypothesis import Hypothesis
from steelyard.robot_file.column_names import Column
from steelyard.robot_file.template.guess_efforts import stated_current

GO_ON = ". If the masses of the model file are wrong, continue: the efforts are then as declared"
NEAR = 3.0
"""How far a factor may be from a thousand, as masses of model files are off."""
AMPERES = {"A": 1.0, "mA": 1e-3}
"""Units of current [A]."""
FACTORS = ("gain", "effort kind", "effort unit")
"""Causes that are a factor on efforts."""


def ways(case: Case, hypothesis: Hypothesis, *, sure: bool) -> Fix:
    """What to do about an explanation whose numbers are not written.

    Args:
        case: What there is.
        hypothesis: The explanation.
        sure: Whether it is beyond doubt that efforts are wrong.
    """
    if hypothesis.cause == "mounting":
        return Fix(
            f"{hypothesis.says}, or an external force acts on the arm (a cable, a balancer), or "
            "lengths and axes differ from the model file: this log alone cannot decide"
        )
    if hypothesis.cause == "payload":
        return Fix(
            f"{hypothesis.says}, or the link inertias differ from the model file: identify it with "
            "steelyard payload, against a model from runs known to be correct, or give that "
            "here (--model)"
        )
    if hypothesis.cause not in FACTORS:
        return Fix(
            f"{hypothesis.says}, or the link inertias differ from the model file: the log alone "
            "cannot decide; examine both, or give a model from runs known to be correct (--model)"
        )
    if unit := _of_names(case, hypothesis):
        return unit
    gains = controller_gains(case) if hypothesis.cause == "gain" else None
    if gains is not None:
        return _of_controller(case, gains)
    return Fix(_of_thousandths(case, hypothesis) + _listed(case, sure=sure))


def _of_names(case: Case, hypothesis: Hypothesis) -> Fix | None:
    """The unit of current that the columns' names state, where it is the factor on all efforts."""
    signals = case.loaded.signals
    if signals is None or set(signals.effort_units) != {"A"}:
        return None
    units = {stated_current(Column(name)) for name in signals.effort}
    if len(units) != 1 or not (unit := units.pop()):
        return None
    factors = np.abs(hypothesis.interpretation.effort_scale / signals.effort_scale)
    wanted = AMPERES[unit] / np.abs(signals.effort_scale)
    if np.any(wanted == 1.0) or np.any(np.abs(np.log(factors / wanted)) > np.log(NEAR)):
        return None
    return Fix(
        f"the names of the effort columns state {unit}, and efforts are off by about that factor",
        (Edit(("signals", "effort", "unit"), unit),),
    )


def _of_thousandths(case: Case, hypothesis: Hypothesis) -> str:
    """The line for torques in mNm, where the factor on all efforts is near a thousandth."""
    signals = case.loaded.signals
    if signals is None or "A" in signals.effort_units:
        return ""
    factors = hypothesis.interpretation.effort_scale / signals.effort_scale
    if np.any((factors < 1e-3 / NEAR) | (factors > 1e-3 * NEAR)):
        return ""
    return "if efforts are in mNm, write gain = 0.001 under [signals.effort]; otherwise "


def _of_controller(case: Case, gains: ControllerGains) -> Fix:
    """The controller's own gains; those that its targets do not show are left to be identified."""
    pairs = zip(case.joints, gains.values, gains.half_widths, gains.known, strict=True)
    shown = ", ".join(f"{name} {g:.4g} ± {w:.2g}" for name, g, w, known in pairs if known)
    says = (
        "gains and masses cannot be identified together from this log; the controller's target "
        f"torque over its target current ({gains.columns[0]} over {gains.columns[1]}, friction "
        f"removed) gives the gains {shown} (95 %)"
    )
    unknown = [f"'{n}'" for n, known in zip(case.joints, gains.known, strict=True) if not known]
    if unknown:
        says += (
            f"; those of {', '.join(unknown)} are poorly identified from it: take them from the "
            'data sheet, or leave them at "identify", relative to the others'
        )
    return Fix(says, (Edit(("signals", "effort", "gain"), gains.entries),))


def _listed(case: Case, *, sure: bool) -> str:
    """The ways to gains, in order."""
    source = case.loaded.sources[0].path.name if case.loaded.sources else "ROBOT"
    robot = source if source.endswith(".toml") else "ROBOT.toml"
    log = case.logs[0].log.path.name if len(case.logs) == 1 else "LOG..."
    entries = ['"identify"'] * len(case.joints)
    entries[min(1, len(entries) - 1)] = "1.0"
    one = f"[{', '.join(entries)}]"
    return (
        "gains and masses cannot be identified together from this log, and no number is written. "
        "In this order: "
        "(1) take gains from the controller's own target torque over its target current, or from "
        "the data sheet (torque constant times gear ratio); "
        '(2) write kind = "motor_current", unit = "A", gain = "identify" under [signals.effort] '
        f"and run `steelyard identify {robot} {log} --loaded LOADED_LOG --payload-mass KG` with a "
        "log that carries a known mass; "
        f"(3) without its mass, write gain = {one}, and run the same without --payload-mass: "
        "results are then up to one scale"
    ) + ("" if sure else GO_ON)
