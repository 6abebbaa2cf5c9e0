"""Whether the contacts that a log has can carry a robot with a floating base as it moves."""

from collections.abc import Sequence

import numpy as np

from steelyard.base.errors import LogError
from steelyard.robot.robot import Robot
from steelyard.runs.run import Run

CARRIED = 0.33  # part, or multiple, of what mass and acceleration ask for that contacts may carry


def refuse_uncarried(runs: Sequence[Run], robot: Robot) -> None:
    """A `LogError` where contacts carry far less or more than the robot's mass is accelerated by.

    The mass of the model file counts; nothing is compared without one, or with unknown forces.
    """
    mass = sum(body.inertia.mass for body in robot.bodies)
    for run in runs:
        base = run.recording.signals.base
        if base is None or not base.wrench_known or base.touches or mass <= 0.0:
            continue
        count, forces, accelerations = 0, 0.0, 0.0
        for block in run.blocks():
            count += len(block.t)
            forces += float(np.sum(block.effort[:3] ** 2))
            accelerations += float(np.sum(block.ddq[:3] ** 2))
        force, proper = np.sqrt(forces / count), np.sqrt(accelerations / count)
        gravity = float(np.linalg.norm(base.gravity))
        if max(force / mass, proper) < CARRIED * gravity:
            continue  # in free fall
        share, given = force / (mass * max(proper, 1e-9)), bool(base.contacts)
        figures = f"{force:.3g} N, and its proper acceleration is {proper:.3g} m/s²"
        if share < CARRIED:
            raise LogError(
                f"the robot of {mass:.3g} kg is carried by {'only ' if given else ''}{figures}: "
                "something that is not measured touches it, or accelerations have another unit",
                where=run.name,
                fix="name all contacts as [[signals.base.contacts]], or the wrench as unknown "
                '(wrench = "unknown" in [signals.base]); check acceleration_unit, and the mass in '
                "the model file",
            )
        if share > 1.0 / CARRIED:
            raise LogError(
                f"contacts carry the robot of {mass:.3g} kg with {figures}: the acceleration has "
                "no gravity in it, or another unit, as forces may have",
                where=run.name,
                fix="log what an accelerometer measures, with gravity; give acceleration_unit = "
                '"g" if it is 1 at rest; check units of forces, and the mass in the model file',
            )
