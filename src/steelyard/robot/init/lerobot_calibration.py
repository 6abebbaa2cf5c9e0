"""Units of positions that LeRobot has normalised, by its calibration of the arm."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import pi
from pathlib import Path
from typing import Any

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import LogError, ModelError
from steelyard.base.files import read_json
from steelyard.robot.init.column_names import Column, by_name, like_finger, listed
from steelyard.robot.robot import Coordinate

STEPS = 4096  # of the encoders, per turn: Feetech STS and Dynamixel X servos
RANGE = ("range_min", "range_max")
NORMALISED = 100.5  # the farthest that normalised positions go, with rounding
WHICH = (
    "LeRobot logs a gripper in 0 to 100, and other joints in degrees or normalised (-100 to 100), "
    "which names do not tell: give init --calibration FILE, the arm's calibration"
)
TAKEN = (
    "positions are taken as normalised, -100 to 100; their range allows degrees too: if they are, "
    'write "deg" for all but the gripper'
)


@dataclass(frozen=True)
class Units:
    """Units of positions as a robot file says them, why, and what the user has to decide."""

    units: list[str | float]
    reason: str
    doubt: str = ""


@dataclass(frozen=True)
class Calibration:
    """Encoder steps between the ends of every motor's range, by the motors' names."""

    path: Path
    spans: Mapping[str, int]

    def units(
        self,
        joints: Sequence[Coordinate],
        columns: Sequence[Column],
        values: Sequence[Array],
    ) -> Units:
        """Units of joints by columns of their positions, and values of positions and targets.

        Raises:
            ModelError: The calibration is of other motors.
            LogError: Names of columns state a unit, or positions of a gripper are not normalised.
        """
        if stated := [column.name for column in columns if column.unit_words]:
            raise LogError(
                f"names of columns state their unit: {listed([Column(x) for x in stated])}",
                where="--calibration",
                fix="leave the option out",
            )
        motors = self._motors(joints, columns)
        for wrong, names in (
            ("the calibration has no motor of", [c.name for c in joints if c.name not in motors]),
            (
                "a calibration is of joints that turn, not of",
                [c.name for c in joints if c.kind != "revolute"],
            ),
        ):
            if names:
                raise ModelError(
                    f"{wrong} {', '.join(names)}",
                    where=f"{self.path}: {', '.join(self.spans)}",
                    fix="give the calibration of this arm; or state position_unit, rad (m) per "
                    "logged unit, in the robot file",
                )
        turn, units, degrees, normalised = 2.0 * pi / STEPS, list[str | float](), False, False
        fingers = [like_finger(c.name) or like_finger(motors[c.name]) for c in joints]
        for joint, x, finger in zip(joints, values, fingers, strict=True):
            span = self.spans[motors[joint.name]]
            units.append(turn * span / 100.0 if finger else turn * span / 200.0)
            far = float(np.abs(x).max(initial=0.0))
            if finger and not NORMALISED - 101.0 <= x.min(initial=0.0) <= far <= NORMALISED:
                raise LogError(
                    f"positions of '{joint.name}' are {x.min():.4g} to {x.max():.4g}, not 0 to 100",
                    where="--calibration",
                    fix="leave the option out: the log is not normalised",
                )
            degrees |= not finger and far > NORMALISED
            normalised |= not finger and far > 180.0 * span / STEPS + 1.0
        ends = f"the ranges in {self.path.name}, of encoders with {STEPS} steps a turn"
        if degrees:
            mixed = [unit if one else "deg" for unit, one in zip(units, fingers, strict=True)]
            return Units(mixed, f"in deg, as they go beyond 100; the gripper's 0 to 100, by {ends}")
        doubt = "" if normalised else TAKEN
        return Units(units, f"in LeRobot's normalised units, by {ends}", doubt)

    def _motors(self, joints: Sequence[Coordinate], columns: Sequence[Column]) -> dict[str, str]:
        """Motors by joint: those that the columns are called by, else the joints."""
        named = {
            joint.name: motor
            for joint, column in zip(joints, columns, strict=True)
            for motor in self.spans
            if re.search(rf"(?<![A-Za-z0-9_]){re.escape(motor)}(?![A-Za-z0-9_])", column.name)
        }
        if len(named) == len(joints) == len(set(named.values())):
            return named
        found = by_name(joints, [Column(name) for name in self.spans])
        return {joint: column.name for joint, column in found.items()}


def read_calibration(path: Path) -> Calibration:
    """A calibration as LeRobot keeps it: JSON with `range_min` and `range_max` of each motor.

    Raises:
        ModelError: The file cannot be read, or is something else.
    """
    return read_json(
        path,
        lambda data: Calibration(path, {str(name): _span(name, one) for name, one in _of(data)}),
        what="the calibration",
        damaged="this is no calibration of LeRobot",
        fix="give the file that lerobot-calibrate wrote, ID.json in its folder calibration",
    )


def _of(data: Any) -> Iterable[tuple[str, Any]]:
    """Motors with what is said of them."""
    if not isinstance(data, dict) or not data:
        raise ValueError("it has no motors")
    return data.items()


def _span(name: str, motor: Any) -> int:
    low, high = (motor.get(k) if isinstance(motor, dict) else None for k in RANGE)
    if not (type(low) is type(high) is int and 0 <= low < high < STEPS):
        raise ValueError(
            f"'{name}' has no {' and '.join(RANGE)} that are steps of one turn, 0 to {STEPS - 1}"
        )
    return high - low
