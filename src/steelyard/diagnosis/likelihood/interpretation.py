"""One way to read the columns of a log, and the robot-file keys in which two ways differ."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from steelyard.arrays import Array
from steelyard.robot_file.signals import Signals


@dataclass(frozen=True, eq=False)
class Interpretation:
    r"""How columns of positions and efforts become joint motion and effort.

    Joint j's position is `position_scale[j] * z[position[j]]`, its effort
    `effort_scale[j] * e[effort[j]]`, behind which maps, offsets and gains of the signals count.

    Attributes:
        position: Column of each joint's position among those declared.
        position_scale: rad or m per logged unit, sign included, shape `(n,)`.
        effort: Column of each joint's effort among those declared.
        effort_scale: What a logged unit is in the declared base unit, shape `(n,)`.
        gravity: In the base frame, shape `(3,)` [m/s²]; zero where efforts come without.
        delay: By how much efforts are logged late [s].
        time: Seconds per declared second.
        kind: Of the efforts.
        ratios: Gear ratio of every motor to its own joint over the declared one, shape `(n,)`.
        payload: Ten numbers of what the last body carries, in its frame; `None` if nothing.
        zeros: What is added to the joint positions beside declared offsets, shape `(n,)` [rad; m];
            `None` if nothing.
    """

    position: tuple[int, ...]
    position_scale: Array
    effort: tuple[int, ...]
    effort_scale: Array
    gravity: Array
    delay: float
    kind: str
    ratios: Array
    time: float = 1.0
    payload: Array | None = None
    zeros: Array | None = None

    @property
    def of_motion(self) -> tuple[Any, ...]:
        """All that the joints' motion depends on."""
        arrays = (self.position_scale, self.ratios, self.zeros)
        return (self.position, self.time, *(None if x is None else x.tobytes() for x in arrays))

    def changed(self, **fields: Any) -> "Interpretation":
        """The same with some of its attributes replaced."""
        return replace(self, **fields)

    def with_factors(self, factors: Array) -> "Interpretation":
        """Efforts times a factor per joint."""
        return replace(self, effort_scale=self.effort_scale * factors)


def declared_reading(signals: Signals, gravity: Array) -> Interpretation:
    """The interpretation that a robot file declares."""
    joints = tuple(range(signals.n))
    return Interpretation(
        position=joints,
        position_scale=np.asarray(signals.position_scale),
        effort=joints,
        effort_scale=np.asarray(signals.effort_scale),
        gravity=np.asarray(gravity),
        delay=signals.effort_delay,
        kind=signals.effort_kind,
        ratios=np.ones(signals.n),
    )
