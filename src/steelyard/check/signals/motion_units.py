r"""Units of time, positions and velocities that make a log plausible, and what each costs.

A velocity that is 57 times the derivative of a position may be in degrees per second, or the
position may be in units of 57 rad, or the clock in units of 57 s. So they are weighed together:
each reading costs what is implausible about it (a step of the clock, positions beyond the joints'
limits, speeds beyond or far below theirs, velocities that are not the derivative) and what it
changes of what the robot file says. The cheapest one is believed.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from math import isclose, isfinite, log, log10, pi

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array
from steelyard.check.cases_and_checks import Case, CheckedLog, remembered
from steelyard.check.signals.usable_rows import PositionSlopes
from steelyard.check.signals.velocity_scale_and_lag import (
    FEWEST_RATE_JOINTS,
    RATE_TOLERANCE,
    UNEVEN_RATE,
    VelocityAgreement,
    rate_by_velocities,
    velocity_agreement,
)
from steelyard.robot.file.signals import POSITION_UNITS, ROW, VELOCITY_UNITS
from steelyard.robot.init.column_names import Column
from steelyard.robot.init.guess_efforts_and_gears import beyond_range
from steelyard.robot.robot import Coordinate, JointKind
from steelyard.runs.first_pass_over_recording import FASTEST_SHARE

SHORTEST_STEP, LONGEST_STEP = 1e-4, 0.25
"""Steps of a robot's log lie between these [s], give or take `OUTSIDE_RANGE`."""
OUTSIDE_RANGE = 1.1
"""Distance from the middle of a range over half of it, from which on something is outside it."""
IMPLAUSIBLE_STEP, CHANGED_UNIT_COST, OUTSIDE_COST = 4.0, 1.0, 3.0
TOO_FAST, TOO_SLOW, DISAGREEING_COST = 2.0, 0.4, 4.0
"""What a reading costs: a step that no log has; a unit that is not the declared one; positions far
beyond their limits; speeds beyond theirs, and per decade below a tenth of theirs; velocities that
are not the derivative."""
NAMED_UNIT_COST = 0.3  # what a unit costs that is not the one in the column's name
FAST_SPEED, SLOW_SPEED = 1.5, 0.1  # speeds over the joint's limit above and below which they cost
FAR_TOO_FAST = 10.0
"""Speed over the usual one from which on it costs all of `TOO_FAST` where a joint has no limit."""
BEYOND_RANGE, FAR_BEYOND = 1.2, 4.0
"""Distance from the middle of a joint's range, over half the range, that costs nothing, and the
factor above it that costs all of `OUTSIDE_COST`."""
USUAL_SPEED = {"revolute": 2.0 * pi, "prismatic": 2.0}  # usual limits of speed [rad/s; m/s]
SAME_SCALE = 1.15  # factor within which two scales are the same


@dataclass(frozen=True)
class JointReading:
    """Units of one joint."""

    position_unit: str  # of the positions; of a stated number, that number
    position_scale: float  # radians (metres) that a declared one really is
    velocity_unit: str  # of the velocities; empty if none are logged
    velocity_scale: float  # the same of velocities
    cost: float  # of this reading


def step_cost(step: float) -> float:
    """Cost of a clock's step [s] in a unit of time."""
    if step <= 0.0:
        return 0.0
    off = max(SHORTEST_STEP / step, step / LONGEST_STEP)
    return IMPLAUSIBLE_STEP + log10(off) if off > OUTSIDE_RANGE else 0.0


@dataclass(frozen=True, eq=False)
class JointFacts:
    """What one joint's units are judged by."""

    coordinate: Coordinate  # the joint
    low: float  # lowest position, as declared
    high: float  # highest position
    speed: float  # nearly the highest speed, in the seconds in which the log was looked at
    moves: bool  # whether it moves
    scale: float  # velocity over derivative in the same seconds; NaN if that is not known
    # units of the positions, the declared one first, and their scales over its
    positions: dict[str, float]
    velocities: dict[str, float]  # the same of the velocities; empty if none are logged
    changed: float  # what another unit of the velocities costs
    # units of position and velocity that the columns' names say; empty if they do not
    named: tuple[str, str] = ("", "")

    def cheapest(self, second: float) -> JointReading:
        """The cheapest units if a second has so many of those in which the log was looked at."""
        units = product(self.positions, self.velocities or ("",))
        return min((self._read(second, *pair) for pair in units), key=lambda joint: joint.cost)

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
        off = beyond_range(self.coordinate, scale * self.low, scale * self.high)
        share = log(max(off, 1.0) / BEYOND_RANGE) / log(FAR_BEYOND)
        cost = OUTSIDE_COST * min(1.0, max(0.0, share)) + self._speed(self.speed * scale / second)
        if not free:
            cost += CHANGED_UNIT_COST * (position != next(iter(self.positions)))
            cost += self.changed * (velocity != next(iter(self.velocities), ""))
        for name, unit in zip(self.named, (position, velocity), strict=True):
            cost += NAMED_UNIT_COST * (name not in ("", unit) and unit != "")
        ratio = abs(self.scale) * second * relative / scale
        if isfinite(ratio) and ratio > 0.0 and abs(log(ratio)) > log(SAME_SCALE):
            cost += DISAGREEING_COST
        return JointReading(position, scale, velocity, relative, cost)

    def _speed(self, speed: float) -> float:
        limit, usual = self.coordinate.limits.velocity, USUAL_SPEED[self.coordinate.kind]
        if not self.moves or speed <= 0.0:
            return 0.0
        if not isfinite(limit) and speed > FAST_SPEED * usual:
            share = min(1.0, log(speed / (FAST_SPEED * usual)) / log(FAR_TOO_FAST / FAST_SPEED))
            return share * (TOO_FAST + log10(speed / usual))
        limit = limit if isfinite(limit) else usual
        if speed > FAST_SPEED * max(limit, usual):  # limits of model files may be placeholders
            return TOO_FAST + log10(speed / max(limit, usual))
        return TOO_SLOW * max(0.0, log10(SLOW_SPEED * limit / speed))


def _mixed(joints: Iterable[JointReading]) -> bool:
    return len({(joint.position_unit, joint.velocity_unit) for joint in joints}) > 1


def _cost(joints: Iterable[JointReading]) -> float:
    return sum(joint.cost for joint in joints)


DRAGGED_SPEED_SHARE = 0.02
"""Share of the fastest joint's rms speed below which a joint is only dragged along."""
SURE_UNIT_GAIN = 1.0
"""What another unit of a position must gain over the declared one to be right beyond doubt."""


@dataclass(frozen=True)
class UnitReading:
    """The units that fit best."""

    time_unit: str  # of the stamps; `ROW` where velocities contradict the declared rate
    second: float  # seconds that a declared second really has
    joints: tuple[JointReading, ...]  # units of each joint
    as_declared: tuple[JointReading, ...]  # the same with the units as declared, for their costs
    cheaper: bool  # whether it costs less than all units as declared
    # velocities against derivatives, positions and velocities as declared, in seconds of this
    agreement: VelocityAgreement | None

    @property
    def sure(self) -> bool:
        """Whether other units of positions than the declared ones are right beyond doubt."""
        pairs = zip(self.as_declared, self.joints, strict=True)
        gains = [a.cost - b.cost for a, b in pairs if a.position_unit != b.position_unit]
        return min((gain for gain in gains if gain > 0.0), default=0.0) >= SURE_UNIT_GAIN

    @property
    def relative(self) -> Array:
        """Velocity over derivative once all units are right, shape `(n,)`; NaN if unknown."""
        scale = np.nan if self.agreement is None else self.agreement.scale
        return scale * np.array([j.velocity_scale / j.position_scale for j in self.joints])


def logged_velocities(case: Case, checked: CheckedLog) -> tuple[tuple[str, ...], Array] | None:
    """Columns and values of logged velocities, shape `(N, n)`, in the good rows.

    Declared ones are in SI units as declared, others as logged. `None` if there are none.
    """
    overview, signals = checked.overview, checked.recording.signals
    if overview.dq is not None and signals.velocity is not None:
        return signals.velocity, overview.dq
    columns = case.guesses.get("velocity", ())
    usable = len(columns) == signals.n and set(checked.log.columns).issuperset(columns)
    if not usable or signals.position_map is not None:
        return None
    parts = list(checked.log.parts(columns, checked.window))
    if not parts:
        return None
    values = np.concatenate(parts)[overview.kept]
    return columns, np.where(np.isfinite(values), values, 0.0)


def unit_value(
    units: Sequence[str], case: Case, known: Mapping[str, Mapping[str, float]]
) -> str | float | list[str] | list[str | float]:
    """Units of the joints as the robot file says them: one for all that can have it, or a list."""
    names = {name for of_kind in known.values() for name in of_kind}
    if not names.issuperset(units):
        said = [unit if unit in names else float(unit) for unit in units]
        return said[0] if len(set(units)) == 1 else said
    kinds = [c.kind for c in case.loaded.robot.coordinates][-len(units) :]
    usual = {kind: next(iter(of_kind)) for kind, of_kind in known.items()}
    for one in dict.fromkeys(units):
        kind = kinds[units.index(one)]
        meant = [one if k == kind else usual[k] for k in kinds]
        if one != usual[kind] and meant == list(units):
            return one
    return units[0] if len(set(units)) == 1 else list(units)


@remembered
def unit_reading(case: Case, checked: CheckedLog) -> UnitReading:
    """The cheapest reading of a log."""
    overview, signals = checked.overview, checked.recording.signals
    logged = logged_velocities(case, checked)
    rate = rate_by_velocities(signals, overview, logged)
    units = signals.time_units if rate is None else {ROW: 1.0 / rate}
    seconds = {unit: scale / signals.time_scale for unit, scale in units.items()}
    looked = min(seconds.values(), key=lambda s: (step_cost(overview.step * s), s != 1.0))
    agreed = None if logged is None else velocity_agreement(overview, logged[1], looked)
    facts = _facts(case, checked, looked, agreed)
    joints_facts = facts[signals.n_base :]
    groups = [[f for f in joints_facts if f.coordinate.kind == kind] for kind in USUAL_SPEED]
    found = []
    for unit, second in seconds.items():
        # what is logged of a floating base has units of its own
        of_base = facts[: signals.n_base]
        read = {f: f.declared(second / looked) for f in of_base}
        for group in groups:
            own = tuple(f.cheapest(second / looked) for f in group)
            # logs hardly ever mix units of joints of one kind: they are believed only if the same
            # ones for all cost more than a change more, or if they are declared so
            if _mixed(own) and not _mixed(f.declared(second / looked) for f in group):
                same = [tuple(f.like(second / looked, joint) for f in group) for joint in own]
                best = min(same, key=_cost)
                own = best if _cost(best) <= _cost(own) + CHANGED_UNIT_COST else own
            read |= zip(group, own, strict=True)
        changed = CHANGED_UNIT_COST if abs(second - 1.0) > 1e-9 else 0.0
        cost = _cost(read.values()) + changed + step_cost(overview.step * second)
        cost += _unheld_cost(read, second / looked, declared=changed == 0.0)
        found.append((cost, unit, second, tuple(read[f] for f in facts)))
    cost, unit, second, joints = min(found, key=lambda f: f[0])
    as_declared = tuple(f.declared(second / looked) for f in facts)
    cheaper = cost < _cost(f.declared(1.0 / looked) for f in facts) + step_cost(overview.step)
    agreed = None if agreed is None else agreed.in_seconds(second / looked)
    return UnitReading(unit, second, joints, as_declared, cheaper, agreed)


def _unheld_cost(
    joints: Mapping[JointFacts, JointReading], second: float, *, declared: bool
) -> float:
    """What other units cost if they leave a factor that all velocities have over derivatives.

    It is known much better than to `SAME_SCALE` if all joints have the same one.
    """
    declared = declared and all(
        (f.declared(second).position_unit, f.declared(second).velocity_unit)
        == (joint.position_unit, joint.velocity_unit)
        for f, joint in joints.items()
    )
    left = [
        abs(f.scale) * second * joint.velocity_scale / joint.position_scale
        for f, joint in joints.items()
        if isfinite(f.scale) and f.scale != 0.0
    ]
    if declared or len(left) < FEWEST_RATE_JOINTS or max(left) - min(left) > UNEVEN_RATE * left[0]:
        return 0.0
    off = abs(sum(left) / len(left) - 1.0) > RATE_TOLERANCE
    return DISAGREEING_COST * len(left) * off


def _facts(
    case: Case, checked: CheckedLog, looked: float, agreed: VelocityAgreement | None
) -> tuple[JointFacts, ...]:
    overview, signals = checked.overview, checked.recording.signals
    slope = overview.slopes(looked)
    v, n = slope.v, len(slope.v)
    fast = np.quantile(np.abs(v), FASTEST_SHARE, axis=1) if v.shape[1] else np.zeros(n)
    low, high = np.zeros((2, n))
    if len(overview.q):
        low, high = np.quantile(overview.q, [0.005, 0.995], axis=0)
    moving, base = slope.moving.copy(), slice(0, signals.n_base)
    low[base] = high[base] = fast[base] = 0.0
    moving[base] = False
    scale = np.full(n, np.nan)
    if agreed is not None:
        scale = np.where(agreed.reliable_joints, agreed.scale, np.nan)
    logged = logged_velocities(case, checked)
    rated = ("",) * n if logged is None else logged[0]
    own = np.ones(n)
    if signals.velocity is not None and signals.velocity_scale is not None:
        own = signals.velocity_scale
    facts = []
    for joint, c in enumerate(case.loaded.robot.coordinates):
        of_position = _position_units(float(signals.position_scale[joint]), c.kind)
        of_velocity = VELOCITY_UNITS[c.kind]
        rates = _relative(float(own[joint]), of_velocity)
        named, rate_named = Column(signals.position[joint]), Column(rated[joint])
        facts.append(
            JointFacts(
                c,
                float(low[joint]),
                float(high[joint]),
                float(fast[joint]),
                bool(moving[joint]),
                float(scale[joint]),
                _relative(float(signals.position_scale[joint]), of_position),
                {} if agreed is None else rates,
                CHANGED_UNIT_COST if signals.velocity is not None else 0.5 * CHANGED_UNIT_COST,
                (named.unit_named(of_position), rate_named.unit_named(of_velocity)),
            )
        )
    return tuple(facts)


def _position_units(scale: float, kind: JointKind) -> Mapping[str, float]:
    """Units that positions may be in; a number that is stated is the only one."""
    named = POSITION_UNITS[kind]
    known = any(isclose(abs(scale), size) for size in named.values())
    return named if known else {repr(abs(scale)): abs(scale)}


def _relative(scale: float, units: Mapping[str, float]) -> dict[str, float]:
    """Scales of units over that of the declared one, nearest to a scale, which comes first."""
    declared = min(units, key=lambda unit: abs(log(units[unit] / abs(scale))))
    return {declared: 1.0} | {unit: size / units[declared] for unit, size in units.items()}


@remembered
def motion_in_units(case: Case, checked: CheckedLog) -> PositionSlopes:
    """Derivatives of the positions in true seconds, and which joints move."""
    return checked.overview.slopes(unit_reading(case, checked).second)


@remembered
def driven_joints(case: Case, checked: CheckedLog) -> NDArray[np.bool_]:
    """Joints that are not only dragged along: their speed counts beside the fastest one's."""
    slope, joints = motion_in_units(case, checked), unit_reading(case, checked).joints
    if slope.v.shape[1] == 0:
        return slope.moving
    scale = np.array([joint.position_scale for joint in joints])
    moving = slope.moving & (np.arange(len(scale)) >= checked.channels.base)
    speed = np.sqrt(np.square(slope.v).mean(axis=1)) * scale * moving
    return np.asarray(moving & (speed >= DRAGGED_SPEED_SHARE * speed.max()))
