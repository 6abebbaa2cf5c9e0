r"""Paths of a tool over time: circles, and straight reaches from place to place.

A circle is gone round at a constant speed that rises and falls along the minimum-jerk step
$s = 10 \tau^3 - 15 \tau^4 + 6 \tau^5$ [Flash1985]; a reach goes straight from place to place along
the same step.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.polynomial import Polynomial

from steelyard.base.arrays import Array, frozen
from steelyard.excite.trajectories.exact_trajectories import SMOOTH

_PER_LAP = 16  # stretches of a lap, and of its ramps, that are followed at once at most
_PER_REACH = 4  # stretches of a reach that are followed at once at most
_SAME = 1e-9  # places nearer to each other than this are one [m]

_STEP = Polynomial(SMOOTH)
_RISE = _STEP.integ()  # way at a speed that rises from 0 to 1 within the unit of time


@dataclass(frozen=True, eq=False)
class Circle:
    """A circle about `centre` [m], started and stopped smoothly; whole turns include both ramps.

    A lap at full speed takes `period`, the speed rises and falls in `ramp` [s] each, which takes
    `ramp / (2 period)` of a turn. It turns right-handed about `normal`. The start's `angle` [rad]
    is from the projection of the base's x axis on its plane, or of the y axis where x is normal to
    it.
    """

    centre: Array
    radius: float
    period: float
    laps: int
    ramp: float
    normal: Array
    angle: float = 0.0

    def __post_init__(self) -> None:
        for name in ("centre", "normal"):
            object.__setattr__(self, name, frozen(getattr(self, name), (3,)))
        if self.ramp > self.laps * self.period:
            raise ValueError(
                f"a ramp of {self.ramp:g} s is longer than the circle's laps, "
                f"{self.laps * self.period:g} s in all"
            )
        plane_axes(self.normal)

    @property
    def duration(self) -> float:
        """Length in time [s]."""
        return self.laps * self.period + self.ramp

    @cached_property
    def knots(self) -> Array:
        """Times from 0 to the duration, shape `(k,)` [s]; the path is smooth between them."""
        stretches = [(0.0, self.ramp), (self.ramp, self.duration - self.ramp)]
        stretches.append((self.duration - self.ramp, self.duration))
        parts = [
            np.linspace(start, end, int(np.ceil(_PER_LAP * max((end - start) / self.period, 0.5))))
            for start, end in stretches
            if end - start > 1e-9 * self.duration
        ]
        return np.unique(np.concatenate(parts))

    def at(self, t: float) -> tuple[Array, Array, Array]:
        """Place [m], velocity [m/s] and acceleration [m/s²], each `(3,)`, in the base frame."""
        way, rate, slope = self._pace(t)
        speed = 2.0 * np.pi / self.period
        angle, rate, slope = self.angle + speed * way, speed * rate, speed * slope
        ahead, aside = plane_axes(self.normal)
        out = self.radius * (np.cos(angle) * ahead + np.sin(angle) * aside)
        across = self.radius * (np.cos(angle) * aside - np.sin(angle) * ahead)
        return self.centre + out, rate * across, slope * across - rate**2 * out

    def _pace(self, t: float) -> tuple[float, float, float]:
        """Time gone at full speed, and its first and second derivative."""
        left = self.duration - t
        if left < min(t, self.ramp):
            way, rate, slope = self._pace(left)
            return self.laps * self.period - way, rate, -slope
        x = min(t / self.ramp, 1.0)
        rest = max(t - self.ramp, 0.0)
        slope = float(_STEP.deriv()(x)) / self.ramp
        return self.ramp * float(_RISE(x)) + rest, float(_STEP(x)), slope


@dataclass(frozen=True, eq=False)
class Reaches:
    """Straight minimum-jerk reaches through places `(k, 3)` [m], with a pause at each.

    Every reach takes `move`, and every pause `dwell` [s]. The first place is where it starts.
    """

    places: Array
    move: float
    dwell: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "places", frozen(self.places, (None, 3)))
        ways = np.linalg.norm(np.diff(self.places, axis=0), axis=1)
        if ways.min() < _SAME:
            raise ValueError("each place of the reaches differs from the one before it")

    @cached_property
    def knots(self) -> Array:
        """See `Circle`."""
        once = np.linspace(0.0, self.move, _PER_REACH + 1)[:-1]
        once = np.concatenate([once, [self.move] if self.dwell > 0.0 else []])
        starts = self._each * np.arange(len(self.places) - 1)
        whole = (starts[:, None] + once).ravel()
        return np.append(whole, self._each * (len(self.places) - 1))

    def at(self, t: float) -> tuple[Array, Array, Array]:
        """See `Circle`."""
        k = min(int(t / self._each * (1.0 + 1e-12)), len(self.places) - 2)
        x = min(max(t - k * self._each, 0.0) / self.move, 1.0)
        start, way = self.places[k], self.places[k + 1] - self.places[k]
        steps = (_STEP(x), _STEP.deriv()(x) / self.move, _STEP.deriv(2)(x) / self.move**2)
        place, velocity, acceleration = (step * way for step in steps)
        return start + place, velocity, acceleration

    @property
    def _each(self) -> float:
        """Time from reach to reach [s]."""
        return self.move + self.dwell


ToolPath = Circle | Reaches  # where a tool is to be over time; it starts and ends at rest


def plane_axes(normal: Array) -> tuple[Array, Array]:
    """Unit vectors in a plane, `(3,)` each: the base's x axis seen along the normal, and across.

    The y axis takes the place of x where the normal is along x. Both are right-handed with the
    normal.
    """
    size = float(np.linalg.norm(normal))
    if not _SAME < size < np.inf:
        raise ValueError(f"the normal {normal} has no direction")
    up = normal / size
    x, y, _ = np.eye(3)
    ahead = x - (x @ up) * up
    ahead = ahead if np.linalg.norm(ahead) > 1e-3 else y - (y @ up) * up
    ahead = ahead / np.linalg.norm(ahead)
    return ahead, np.cross(up, ahead)


def on_circle(centre: Array, radius: float, count: int, normal: Array, angle: float) -> Array:
    """Places at equal distances on a circle, shape `(count, 3)` [m]; `angle` is of the first."""
    ahead, aside = plane_axes(normal)
    angles = angle + 2.0 * np.pi * np.arange(count) / count
    spread = np.outer(np.cos(angles), ahead) + np.outer(np.sin(angles), aside)
    return np.asarray(centre + radius * spread)


def out_and_back(home: Array, targets: Array, times: int) -> Array:
    """Places of reaches from home to each target and back, `(1 + 2 times k, 3)`, from `(k, 3)`."""
    once = np.stack([targets, np.broadcast_to(home, targets.shape)], axis=1).reshape(-1, 3)
    return np.concatenate([np.reshape(home, (1, 3)), np.tile(once, (times, 1))])
