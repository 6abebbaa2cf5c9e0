"""Units of positions that LeRobot has normalised, by its calibration of the arm."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import pi
from pathlib import Path
from typing import Any

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import LogError, ModelError
from steelyard.base.files import read_json
from steelyard.robot.init.column_names import Column, by_name, like_finger
from steelyard.robot.robot import Coordinate

STEPS = 4096  # of the encoders, per turn: Feetech STS and Dynamixel X servos
SLACK = 0.5  # beyond -100 to 100, or 0 to 100
WHICH = (
    "LeRobot logs degrees or normalised values (-100 to 100, the gripper 0 to 100), and names do "
    "not tell which: if normalised, give init --calibration FILE, the arm's calibration"
)


@dataclass(frozen=True)
class Calibration:
    """Encoder steps between the ends of every motor's range, by the motors' names."""

    path: Path
    spans: Mapping[str, int]

    def units(
        self,
        joints: Sequence[Coordinate],
        columns: Sequence[Column],
        values: Mapping[str, Array],
    ) -> tuple[list[str | float], str]:
        """Unit of every joint's positions, as a robot file says it, and why.

        Raises:
            ModelError: The calibration is of other motors.
            LogError: Positions of a gripper are not normalised.
        """
        motors = by_name(joints, [Column(name) for name in self.spans])
        other = [c.name for c in joints if c.name not in motors or c.kind != "revolute"]
        if other:
            raise ModelError(
                f"the calibration has no motor of {', '.join(other)}, or it is no revolute joint",
                where=f"{self.path}: {', '.join(self.spans)}",
                fix="give the calibration of this arm; or state position_unit, rad (m) per logged "
                "unit, in the robot file",
            )
        turn, found = 2.0 * pi / STEPS, list[str | float]()
        fingers = [like_finger(c.name) or like_finger(motors[c.name].name) for c in joints]
        reach = [values.get(column.name, np.zeros(0)) for column in columns]
        far = [float(np.abs(x).max(initial=0.0)) for x in reach]
        degrees = any(x > 100.0 + SLACK for x, one in zip(far, fingers, strict=True) if not one)
        for joint, x, finger in zip(joints, reach, fingers, strict=True):
            span = self.spans[motors[joint.name].name]
            if finger and not -SLACK <= x.min(initial=0.0) <= x.max(initial=0.0) <= 100.0 + SLACK:
                raise LogError(
                    f"positions of '{joint.name}' are {x.min():.4g} to {x.max():.4g}, not 0 to 100",
                    where="--calibration",
                    fix="leave the option out: the log is not normalised",
                )
            found.append(turn * span / 100.0 if finger else turn * span / 200.0)
        ends = f"the ranges in {self.path.name}, of encoders with {STEPS} steps a turn"
        if not degrees:
            return found, f"in LeRobot's normalised units, by {ends}"
        mixed = [unit if one else "deg" for unit, one in zip(found, fingers, strict=True)]
        return mixed, f"in deg, as they go beyond 100; the gripper's 0 to 100, by {ends}"


def read_calibration(path: Path) -> Calibration:
    """A calibration as LeRobot keeps it: JSON with `range_min` and `range_max` of each motor.

    Raises:
        ModelError: The file cannot be read, or is something else.
    """
    return read_json(
        path,
        lambda data: Calibration(path, {str(name): _span(name, one) for name, one in data.items()}),
        what="the calibration",
        damaged="this is no calibration of LeRobot",
        fix="give the file that lerobot-calibrate wrote, ID.json in its folder calibration",
    )


def _span(name: str, motor: Any) -> int:
    low, high = motor["range_min"], motor["range_max"]
    if not (type(low) is type(high) is int and 0 <= low < high < STEPS):
        raise ValueError(
            f"range_min and range_max of '{name}' are not two steps of one turn, 0 to {STEPS - 1}"
        )
    return high - low
