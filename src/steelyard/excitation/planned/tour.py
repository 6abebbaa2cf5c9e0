"""The requirements on a process motion, and the resulting motion."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from steelyard.arrays import Array, frozen
from steelyard.errors import DataError
from steelyard.excitation.planned.attitudes import AnyAttitude, Attitude
from steelyard.excitation.planned.moves import Pace, ToolLimits
from steelyard.excitation.trajectories.piecewise import PiecewiseMotion


@dataclass(frozen=True)
class Manner:
    """How the tool is led.

    Attributes:
        path: `line`: straight lines of the tool; `joint`: straight in joint space.
        attitude: What is required of the tool's orientation, at all times on lines, else at places.
        tool: Highest speed and acceleration of the tool's origin, beside the joints' limits.
        share: Of all limits but positions that is used.
        straightness: Greatest distance from a line [m], and turn from the attitude [rad].
        dwell: Rest at every place of the task [s].
    """

    path: Literal["line", "joint"] = "line"
    attitude: Attitude = AnyAttitude()
    tool: ToolLimits = ToolLimits()
    share: float = 1.0
    straightness: float = 1e-4
    dwell: float = 0.0

    def __post_init__(self) -> None:
        wrong = {
            "path": self.path not in ("line", "joint"),
            "share": not 0.0 < self.share <= 1.0,
            "straightness": not self.straightness > 0.0,
            "dwell": not 0.0 <= self.dwell < np.inf,
        }
        for name in (name for name, bad in wrong.items() if bad):
            raise DataError(
                f"{name} = {getattr(self, name)!r} cannot be used",
                where="settings of a process motion",
                fix="path is 'line' or 'joint', 0 < share <= 1, straightness > 0 m, dwell >= 0 s",
            )


@dataclass(frozen=True, eq=False)
class Tour:
    """Places of the tool in the order of the visits; after the last one it goes back to the first.

    Attributes:
        places: Shape `(K, 3)` [m], in the base frame.
        names: Of the visits, for messages.
        dwells: Rest after arriving, per visit, `(K,)` [s]; that of the first is at the very end.
        cycles: How often the task is done.
    """

    places: Array
    names: tuple[str, ...]
    dwells: Array
    cycles: int

    def __post_init__(self) -> None:
        object.__setattr__(self, "places", frozen(self.places, (len(self.names), 3)))
        object.__setattr__(self, "dwells", frozen(self.dwells, (len(self.names),)))


@dataclass(frozen=True, eq=False)
class ProcessMotion:
    """A process motion, and notes on it.

    Attributes:
        trajectory: From rest to rest, ending in the posture it started in.
        places: Places visited, the first one again at the end, shape `(K + 1, 3)` [m].
        arrivals: Times of arrival there, shape `(K + 1,)` [s].
        postures: Postures there, shape `(K + 1, n)` [rad; m].
        deviation: Greatest distance of the tool from its straight lines [m], proven for all times.
        turned: Greatest turn of the tool from its attitude on lines [rad], at samples.
        cycles: How often the task is done.
        paces: Per move its time and the limit that it meets.
    """

    trajectory: PiecewiseMotion
    places: Array
    arrivals: Array
    postures: Array
    deviation: float
    turned: float
    cycles: int
    paces: tuple[Pace, ...]

    @property
    def summary(self) -> str:
        """One line that reports it."""
        limits = [pace.limit for pace in self.paces]
        most = max(sorted(set(limits)), key=limits.count)
        straight = f"deviation from straight lines {1e3 * self.deviation:.2g} mm at most; "
        return (
            f"{self.cycles} cycles, {len(self.paces)} moves in {self.trajectory.duration:.2f} s; "
            f"{straight if self.deviation else ''}most moves are limited by the {most}"
        )
