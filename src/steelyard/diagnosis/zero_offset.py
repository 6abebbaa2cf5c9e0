"""Estimated zero offsets of joints as evidence: which differ clearly, in words and as an edit."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from steelyard.diagnosis.finding import Edit, Fix
from steelyard.errors import DataError
from steelyard.estimation.fields.fields import information_from
from steelyard.estimation.zero_offset import ZeroOffsets, find_offsets, with_offsets
from steelyard.measurement.run import Run
from steelyard.model import Model
from steelyard.robot.robot import Robot
from steelyard.validation.friction.mixes import remembers

BEYOND = 4.0
"""Standard deviations from what is given at which a zero offset is written as a number."""

UPRIGHT = 0.05
"""Part of gravity across a first axis up to which it is taken to be along it [m/s²]."""


def estimated_offsets(model: Model, runs: Sequence[Run]) -> ZeroOffsets | None:
    """Zero offsets of all joints, from those that the runs are read with; `None` of too few data.

    The robot is an open chain.
    """
    given, rests = runs[0].recording.signals.position_offset, remembers(model.terms)
    start = np.zeros(model.robot.n) if given is None else given
    try:
        return find_offsets(
            model,
            lambda offsets: information_from(with_offsets(runs, offsets), rests=rests),
            start,
            [True] * model.robot.n,
        )
    except DataError:
        return None


def far_offsets(offsets: ZeroOffsets) -> NDArray[np.bool_]:
    """Which offsets differ clearly from those that were given, shape `(n,)`."""
    spread = np.nan_to_num(offsets.std, nan=np.inf)
    return np.asarray(
        (np.abs(offsets.values - offsets.start) > BEYOND * spread) & offsets.converged
    )


def without_effect(robot: Robot) -> tuple[bool, ...]:
    """Joints whose zeros no motion identifies, for parameters express them, or none has an effect.

    A first joint that turns about the direction of gravity or slides, and joints of last bodies.
    """
    parents = {body.parent for body in robot.bodies}
    found = [False] * robot.n
    for k, body in enumerate(robot.bodies):
        along = np.linalg.norm(np.cross(body.rotation @ body.axis, robot.gravity))
        first = body.parent < 0 and (body.kind == "prismatic" or along <= UPRIGHT)
        if body.coordinate < robot.n and (first or k not in parents):
            found[body.coordinate] = True
    return tuple(found)


def numbers(offsets: ZeroOffsets, chosen: NDArray[np.bool_]) -> str:
    """Like `zero offset of elbow 0.4992 ± 0.0008 rad`."""
    parts = [
        f"{offsets.joints[k]} {offsets.values[k]:.4f} ± {offsets.half_width[k]:.4f} "
        f"{offsets.units[k]}"
        for k in np.flatnonzero(chosen)
    ]
    return f"zero offset of {', '.join(parts)}"


def correction(offsets: ZeroOffsets, chosen: NDArray[np.bool_]) -> Fix:
    """The line of the robot file that corrects offsets; others stay as they are given."""
    values = [
        round(float(value), 4) if far else float(start)
        for value, start, far in zip(offsets.values, offsets.start, chosen, strict=True)
    ]
    says = f'Set position_offset = {values} in [signals], or position_offset = "identify"'
    return Fix(says, (Edit(("signals", "position_offset"), values),))
