"""A guess of the columns of a log without efforts, of joints that follow targets."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from steelyard.base.errors import LogError
from steelyard.robot.init.column_names import Column, by_name, by_number, finite, listed
from steelyard.robot.init.guess_clock_positions_and_velocities import (
    MotionGuess,
    clock_of,
    guess_positions,
)
from steelyard.robot.init.guess_efforts_and_gears import changes
from steelyard.robot.init.lerobot_calibration import WHICH, Calibration
from steelyard.robot.robot import Coordinate

NO_MOTION = {"effort", "velocity", "acceleration", "time"}
"""Quantities that are no target of a position."""


@dataclass(frozen=True)
class TargetGuess:
    """What a log's columns of targets and positions seem to be.

    `section` is `[signals]` as the robot file would say it; `doubt` what the user has to decide.
    """

    section: Mapping[str, Any]
    joints: tuple[str, ...]
    reasons: tuple[str, ...]
    doubt: str = ""


def guess_targets(
    coordinates: Sequence[Coordinate],
    every: Sequence[Coordinate],
    columns: Sequence[str],
    sample: Mapping[str, ArrayLike],
    rate: float | None,
    calibration: Calibration | None = None,
) -> TargetGuess | None:
    """Columns of targets beside those of positions; `None` if the log has efforts, or no targets.

    Numbers count `every` joint of the robot where the log has a column for each, hands included.
    A calibration gives the units.
    """
    positions, targets = targets_without_efforts(columns, sample)
    for joints in (every, coordinates):
        found = [_one_each(joints, some) for some in (positions, targets)]
        if all(found):
            return _guess(joints, found[0], found[1], columns, sample, rate, calibration)
    return None


def targets_without_efforts(
    columns: Sequence[str], sample: Mapping[str, ArrayLike]
) -> tuple[list[Column], list[Column]]:
    """Columns of positions and of targets in a log that has both and no efforts, else none."""
    named = [Column(name) for name in columns]
    values = {name: finite(np.asarray(x)) for name, x in sample.items()}
    efforts = [c for c in named if c.quantity == "effort" and changes(c.name, values)]
    positions = [c for c in named if c.quantity == "position"]
    targets = position_targets(named)
    return (positions, targets) if positions and targets and not efforts else ([], [])


def position_targets(named: Sequence[Column]) -> list[Column]:
    """Columns of targets that positions are to follow."""
    return [c for c in named if c.of_target and _without_target(c).quantity not in NO_MOTION]


def _guess(
    joints: Sequence[Coordinate],
    position: Sequence[Column],
    target: Sequence[Column],
    columns: Sequence[str],
    sample: Mapping[str, ArrayLike],
    rate: float | None,
    calibration: Calibration | None,
) -> TargetGuess | None:
    values = {name: finite(np.asarray(x)) for name, x in sample.items()}
    times = [c for c in map(Column, columns) if c.quantity == "time"]
    try:
        clock, time_reason = clock_of(times, position[0], columns, values, rate)
    except LogError:
        return None
    doubt = ""
    if calibration is not None:
        pairs = zip(position, target, strict=True)
        both = [np.concatenate([values[c.name] for c in pair]) for pair in pairs]
        told = calibration.units(joints, position, both)
        where, doubt = MotionGuess(told.units, told.reason), told.doubt
    else:
        try:
            where = guess_positions(position, joints, values, columns, False, "joint")
        except LogError:
            return None
        units = where.unit if isinstance(where.unit, tuple | list) else [where.unit]
        if "deg" in units and all(c.of_state and not c.unit_words for c in position):
            doubt = WHICH
    section = {
        **clock,
        "position": [c.name for c in position],
        "position_unit": where.unit,
        "target": [c.name for c in target],
    }
    reasons = (
        time_reason,
        f"positions are {listed(position)}; {where.reason}",
        f"targets are {listed(target)}, in the unit and with the signs of the positions",
        "no efforts are logged: actuators are identified from targets and positions",
    )
    why = (*reasons, *where.contradictions)
    return TargetGuess(section, tuple(c.name for c in joints), why, doubt)


def _without_target(column: Column) -> Column:
    """The column by the other words of its name."""
    words = [w for w in column.words if not Column(w).of_target]
    return replace(column, name="_".join(words))


def _one_each(joints: Sequence[Coordinate], columns: Sequence[Column]) -> tuple[Column, ...]:
    """A column for each joint, by name or by number; none if a joint lacks its own."""
    named = by_name(joints, columns)
    if len(named) == len(joints):
        return tuple(named[c.name] for c in joints)
    return next(iter(by_number(len(joints), columns, [c.kind for c in joints])), ())
