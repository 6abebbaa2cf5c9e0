"""What to do where a number is poorly identifiable from a log: where to take it from, in order."""

from steelyard.diagnosis.case import Case
from steelyard.diagnosis.rival import Rival

FACTORS = ("gain", "effort kind", "effort unit")
"""Causes that are a factor on efforts."""


def ways(case: Case, rival: Rival) -> str:
    """What to do about an explanation whose numbers are not written."""
    if rival.cause not in FACTORS:
        return (
            f"{rival.says}, or the bodies are others than the model file says: the log alone "
            "cannot decide; look at both, or give a model from clean runs (--model)"
        )
    source = case.loaded.sources[0].path.name if case.loaded.sources else "ROBOT"
    robot = source if source.endswith(".toml") else "ROBOT.toml"
    log = " ".join(e.log.path.name for e in case.logs)
    return (
        "gains and masses cannot be identified together from this log, and no number is written. "
        "In this order: "
        "(1) take gains from the controller's own target torque over its target current, or from "
        "the data sheet (torque constant times gear ratio); "
        '(2) write kind = "motor_current", unit = "A", gain = "identify" under [signals.effort] '
        f"and run `steelyard identify {robot} {log} --loaded LOADED_LOG --payload-mass KG` with a "
        "log that carries a known mass; "
        "(3) the same without --loaded: results up to one scale. If masses are what is wrong in "
        "the model file, go on: the efforts are then right as declared"
    )
