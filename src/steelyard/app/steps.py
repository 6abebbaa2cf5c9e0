"""All steps of the app in their order."""

from steelyard.app import (
    step_check,
    step_design,
    step_identify,
    step_logs,
    step_robot,
    step_use,
)
from steelyard.app.step import Desk, Step
from steelyard.base.errors import OutputError, SteelyardError

STEPS: tuple[Step, ...] = (
    step_robot.STEP,
    step_logs.STEP,
    step_check.STEP,
    step_design.STEP,
    step_identify.STEP,
    step_use.STEP,
)


def named(name: str) -> Step:
    """The step of a name."""
    for step in STEPS:
        if step.name == name:
            return step
    raise OutputError("there is no such page", where=name, fix="choose a step")


def current(desk: Desk) -> Step:
    """The last step on the way that is not locked; the first if the files cannot be read."""
    try:
        return [step for step in STEPS if not (step.aside or step.locked(desk))][-1]
    except SteelyardError:
        return STEPS[0]
