"""What a reading of a log's units costs."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import isfinite, log, log10, pi

from steelyard.robot.robot import Coordinate

SHORTEST_STEP, LONGEST_STEP = 1e-4, 0.25
"""Steps of a robot's log lie between these [s], give or take `SLACK`."""
SLACK = 1.1
IMPLAUSIBLE_STEP, CHANGED, OUTSIDE, TOO_FAST, TOO_SLOW, DISAGREE = 4.0, 1.0, 3.0, 2.0, 0.4, 4.0
"""What a reading costs: a step that no log has; a unit that is not the declared one; positions far
beyond their limits; speeds beyond theirs, and per decade below a tenth of theirs; velocities that
are not the derivative."""
OVER_LIMIT = 0.8
"""What a speed beyond the limit of the model file costs that a robot can have: limits there are
often placeholders."""
NAMED = 0.3
"""What a unit costs that is not the one in the column's name."""
FAST, SLOW = 1.5, 0.1
"""Speeds over the joint's limit above and below which they cost."""
FAR_TOO_FAST = 10.0
"""Speed over the usual one from which on it costs all of `TOO_FAST` where a joint has no limit."""
BEYOND, FAR_BEYOND = 1.2, 4.0
"""Distance from the middle of a joint's range, over half the range, that costs nothing, and the
factor above it that costs all of `OUTSIDE`."""
SPEED = {"revolute": 2.0 * pi, "prismatic": 2.0}
"""Usual limits of speed [rad/s; m/s]."""
SAME = 1.15
"""Factor within which two scales are the same."""


@dataclass(frozen=True)
class JointReading:
    """Units of one joint.

    Attributes:
        position_unit: Of the positions.
        position_scale: Radians (metres) that a declared one really is.
        velocity_unit: Of the velocities; empty if none are logged.
        velocity_scale: The same of velocities.
        cost: Of this reading.
    """

    position_unit: str
    position_scale: float
    velocity_unit: str
    velocity_scale: float
    cost: float


def step_cost(step: float) -> float:
    """Cost of a clock's step [s] in a unit of time."""
    if step <= 0.0:
        return 0.0
    off = max(SHORTEST_STEP / step, step / LONGEST_STEP)
    return IMPLAUSIBLE_STEP + log10(off) if off > SLACK else 0.0


@dataclass(frozen=True)
class JointFacts:
    """What one joint's units are judged by.

    Attributes:
        coordinate: The joint.
        low: Lowest position, as declared.
        high: Highest position.
        speed: Nearly the highest speed, in the seconds in which the log was looked at.
        moves: Whether it moves.
        scale: Velocity over derivative in the same seconds; NaN if that is not known.
        positions: Units of the positions, the declared one first, and their scales over its.
        velocities: The same of the velocities; empty if none are logged.
        changed: What another unit of the velocities costs.
        named: Units of position and velocity that the columns' names say; empty if they do not.
    """

    coordinate: Coordinate
    low: float
    high: float
    speed: float
    moves: bool
    scale: float
    positions: dict[str, float]
    velocities: dict[str, float]
    changed: float
    named: tuple[str, str] = ("", "")

    def cheapest(self, second: float) -> JointReading:
        """The cheapest units if a second has so many of those in which the log was looked at."""
        return min(
            (
                self._read(second, position, velocity)
                for position in self.positions
                for velocity in self.velocities or {"": 1.0}
            ),
            key=lambda joint: joint.cost,
        )

    def declared(self, second: float) -> JointReading:
        """The units as declared."""
        return self._read(second, next(iter(self.positions)), next(iter(self.velocities), ""))

    def like(self, second: float, other: JointReading) -> JointReading:
        """The units of another joint, which one that rests has for nothing."""
        return self._read(second, other.position_unit, other.velocity_unit, free=not self.moves)

    def _read(
        self, second: float, position: str, velocity: str, free: bool = False
    ) -> JointReading:
        scale, relative = self.positions[position], self.velocities.get(velocity, 1.0)
        cost = self._outside(scale) + self._speed(self.speed * scale / second)
        if not free:
            cost += CHANGED * (position != next(iter(self.positions)))
            cost += self.changed * (velocity != next(iter(self.velocities), ""))
        for name, unit in zip(self.named, (position, velocity), strict=True):
            cost += NAMED * (name not in ("", unit) and unit != "")
        ratio = abs(self.scale) * second * relative / scale
        if isfinite(ratio) and ratio > 0.0 and abs(log(ratio)) > log(SAME):
            cost += DISAGREE
        return JointReading(position, scale, velocity, relative, cost)

    def _outside(self, scale: float) -> float:
        off = beyond(self.coordinate, scale * self.low, scale * self.high)
        return OUTSIDE * min(1.0, max(0.0, log(max(off, 1.0) / BEYOND) / log(FAR_BEYOND)))

    def _speed(self, speed: float) -> float:
        limit, usual = self.coordinate.limits.velocity, SPEED[self.coordinate.kind]
        if not self.moves or speed <= 0.0:
            return 0.0
        if not isfinite(limit) and speed > FAST * usual:
            share = min(1.0, log(speed / (FAST * usual)) / log(FAR_TOO_FAST / FAST))
            return share * (TOO_FAST + log10(speed / usual))
        limit = limit if isfinite(limit) else usual
        if speed > FAST * max(limit, usual):
            return TOO_FAST + log10(speed / max(limit, usual))
        if speed > FAST * limit:
            return OVER_LIMIT
        return TOO_SLOW * max(0.0, log10(SLOW * limit / speed))


def alike(facts: Sequence[JointFacts], second: float) -> tuple[JointReading, ...]:
    """The cheapest units of joints of one kind, of which logs hardly ever mix several.

    Units that differ between joints are believed only if the same ones for all would cost more
    than a change more, or if they are declared so. Joints that rest say little: they have the
    units of the others.

    Args:
        facts: Of joints of one kind.
        second: How many of those seconds in which the log was looked at a second has.
    """
    own = tuple(f.cheapest(second) for f in facts)
    if _mixed(f.declared(second) for f in facts) or not _mixed(own):
        return own
    same = [tuple(f.like(second, joint) for f in facts) for joint in own]
    best = min(same, key=_cost)
    return best if _cost(best) <= _cost(own) + CHANGED else own


def _mixed(joints: Iterable[JointReading]) -> bool:
    return len({(joint.position_unit, joint.velocity_unit) for joint in joints}) > 1


def _cost(joints: Iterable[JointReading]) -> float:
    return sum(joint.cost for joint in joints)


def beyond(coordinate: Coordinate, low: float, high: float) -> float:
    """Farthest position from the middle of a joint's range, over half the range; 0 without one."""
    lower, upper = coordinate.limits.lower, coordinate.limits.upper
    if not (isfinite(lower) and isfinite(upper) and upper > lower):
        return 0.0
    middle, half = 0.5 * (lower + upper), 0.5 * (upper - lower)
    return max(abs(low - middle), abs(high - middle)) / half
