"""Loads that the virtual robot carries for a while, and outside wrenches on its frames."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from steelyard.base.arrays import Array, frozen, set_fields
from steelyard.base.errors import DataError, LogError, ModelError
from steelyard.estimate.external.wrench_methods_and_observer_step import moved_frame
from steelyard.logs.formats import open_log
from steelyard.robot.inertia_and_placement import Inertia
from steelyard.robot.robot import Robot

_STEEL = 7800.0  # density [kg/m³]


@dataclass(frozen=True)
class Payload:
    """A body that is fixed to a frame of the robot between two times."""

    inertia: Inertia  # its ten numbers, about the frame's origin and along its axes
    frame: str
    attach: float = 0.0  # when it is taken [s], from the start of the log
    release: float = float("inf")  # when it is let go [s]

    def __post_init__(self) -> None:
        flaw = self.inertia.flaw()
        if flaw is not None or not 0.0 <= self.attach < self.release:
            times = f"attached at {self.attach:g} s, released at {self.release:g} s"
            raise ModelError(
                "the payload is "
                + (times if flaw is None else f"not physically consistent: {flaw}"),
                where=f"payload on '{self.frame}'",
                fix="give mass properties of a real body, and times 0 <= attach < release",
            )

    @classmethod
    def ball(
        cls, mass: float, frame: str, attach: float = 0.0, release: float = float("inf")
    ) -> "Payload":
        """A steel ball of a mass [kg] around the frame's origin."""
        radius = (mass / (_STEEL * 4.0 / 3.0 * np.pi)) ** (1.0 / 3.0)
        moments = 0.4 * mass * radius**2 * np.eye(3)
        return cls(Inertia.about_com(mass, np.zeros(3), moments), frame, attach, release)

    def carried(self, t: Array) -> Array:
        """Whether it is carried at times `t`, as booleans."""
        return np.asarray((t >= self.attach) & (t < self.release))

    def added(self, robot: Robot, inertial: Array) -> Array:
        """The bodies' ten numbers, `(n_bodies, 10)`, with the payload on them."""
        frame = moved_frame(robot, self.frame)
        loaded = inertial.copy()
        loaded[frame.body] += self.inertia.moved(frame.rotation, frame.position).ten
        return loaded


WRENCH_COLUMNS = ("fx_N", "fy_N", "fz_N", "tx_Nm", "ty_Nm", "tz_Nm")  # in files and in logs

Axes = Literal["base", "frame"]


@dataclass(frozen=True, eq=False)
class AppliedWrench:
    """Forces and torques that act on a robot at the origin of a frame."""

    frame: str
    t: Array  # times from the start of the log, increasing, shape `(K,)` [s]
    # force and torque from each time until the next one, shape `(K, 6)` [N, Nm]; zero before the
    # first time, the last row stays
    values: Array
    axes: Axes = "base"  # whether they are along the axes of the base or of the frame

    def __post_init__(self) -> None:
        set_fields(self, t=frozen(self.t, (None,)), values=frozen(self.values, (len(self.t), 6)))
        finite = np.isfinite(self.t).all() and np.isfinite(self.values).all()
        if not len(self.t) or not finite or not np.all(np.diff(self.t) > 0.0):
            raise DataError(
                "times do not increase, or a value is no finite number",
                where=f"wrench on '{self.frame}'",
                fix="give rows with increasing times and six finite numbers each",
            )

    def at(self, t: Array) -> Array:
        """Force and torque at times `t`, shape `(N,)`: shape `(N, 6)`."""
        rows = np.searchsorted(self.t, t, side="right")
        return np.concatenate([np.zeros((1, 6)), self.values])[rows]


def read_wrench(path: Path, frame: str, axes: Axes = "base") -> AppliedWrench:
    """The wrench in a table with the columns `time_s`, `fx_N` to `fz_N`, `tx_Nm` to `tz_Nm`."""
    names = ("time_s", *WRENCH_COLUMNS)
    try:
        table = open_log(path)
        missing = [name for name in names if name not in table.columns]
        rows = None if missing else np.concatenate([np.zeros((0, 7)), *table.parts(names)])
    except LogError as error:
        raise DataError(error.wrong, where=error.where, fix=error.fix) from error
    if rows is None:
        raise DataError(
            f"the wrench has no column '{missing[0]}'",
            where=str(path),
            fix=f"give the columns {', '.join(names)}",
        )
    return AppliedWrench(frame, rows[:, 0], rows[:, 1:], axes)
