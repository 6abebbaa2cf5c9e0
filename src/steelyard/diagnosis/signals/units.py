r"""Units that make a log plausible: of time, positions and velocities, all at once.

A velocity that is 57 times the derivative of a position may be in degrees per second, or the
position may be in units of 57 rad, or the clock in units of 57 s. So they are weighed together:
each reading costs what is implausible about it (a step of the clock, positions beyond the joints'
limits, speeds beyond or far below theirs, velocities that are not the derivative) and what it
changes of what the robot file says. The cheapest one is believed.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import log

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.diagnosis.case import Case, Evidence
from steelyard.diagnosis.signal_overview import SignalOverview, look, once
from steelyard.diagnosis.signals.agreement import Agreement, agreement
from steelyard.diagnosis.signals.rate import rate_by_velocities
from steelyard.diagnosis.signals.slopes import Slopes, slopes
from steelyard.diagnosis.signals.unit_costs import (
    CHANGED,
    JointFacts,
    JointReading,
    alike,
    step_cost,
)
from steelyard.robot_file.column_names import Column
from steelyard.robot_file.signals import POSITION_UNITS, ROW, VELOCITY_UNITS

FASTEST_SHARE = 0.995
"""Quantile of a joint's speed that is compared with its limit."""
DRAGGED = 0.02
"""Share of the fastest joint's rms speed below which a joint is only dragged along."""


SURE = 1.0
"""What another unit of a position must gain over the declared one to be right beyond doubt."""


@dataclass(frozen=True)
class Reading:
    """The units that fit best.

    Attributes:
        time_unit: Of the stamps; `ROW` where velocities contradict the declared rate.
        second: Seconds that a declared second really has.
        joints: Units of each joint.
        as_declared: The same with the units as declared, for their costs.
        cost: Of all.
        declared_cost: Of all units as declared.
        agreement: Velocities against derivatives, in seconds of this reading but positions and
            velocities as declared; `None` if there are none.
    """

    time_unit: str
    second: float
    joints: tuple[JointReading, ...]
    as_declared: tuple[JointReading, ...]
    cost: float
    declared_cost: float
    agreement: Agreement | None

    @property
    def sure(self) -> bool:
        """Whether other units of positions than the declared ones are right beyond doubt."""
        pairs = zip(self.as_declared, self.joints, strict=True)
        gains = [a.cost - b.cost for a, b in pairs if a.position_unit != b.position_unit]
        return min((gain for gain in gains if gain > 0.0), default=0.0) >= SURE

    def relative(self, joint: int) -> float:
        """Velocity over derivative of the position once all units are right; NaN if unknown."""
        if self.agreement is None:
            return float("nan")
        units = self.joints[joint]
        scale = float(self.agreement.scale[joint])
        return scale * units.velocity_scale / units.position_scale


def velocities(case: Case, evidence: Evidence) -> tuple[tuple[str, ...], Array] | None:
    """Columns and values of logged velocities, shape `(N, n)`, in the good rows.

    Declared ones are in SI units as declared, others as logged. `None` if there are none.
    """
    overview, signals = look(case, evidence), evidence.recording.signals
    if overview.dq is not None and signals.velocity is not None:
        return signals.velocity, overview.dq
    columns = case.guesses.get("velocity", ())
    known = set(evidence.log.columns)
    if (
        len(columns) != signals.n
        or not known.issuperset(columns)
        or signals.position_map is not None
    ):
        return None
    parts = list(evidence.log.parts(columns, evidence.window))
    if not parts:
        return None
    values = np.concatenate(parts)[overview.kept]
    return columns, np.where(np.isfinite(values), values, 0.0)


def unit_of(scale: float, units: Mapping[str, float]) -> str:
    """The unit with that scale; the nearest one."""
    return min(units, key=lambda unit: abs(log(units[unit] / abs(scale))))


def declared_units(evidence: Evidence, case: Case) -> tuple[str, ...]:
    """Unit of each position as the robot file declares it."""
    scales = evidence.recording.signals.position_scale
    return tuple(
        unit_of(float(s), POSITION_UNITS[c.kind])
        for s, c in zip(scales, case.loaded.robot.coordinates, strict=True)
    )


def unit_value(
    units: Sequence[str], case: Case, known: Mapping[str, Mapping[str, float]]
) -> str | list[str]:
    """Units of the joints as the robot file says them: one for all that can have it, or a list."""
    kinds = [c.kind for c in case.loaded.robot.coordinates]
    usual = {kind: next(iter(of_kind)) for kind, of_kind in known.items()}
    for one in dict.fromkeys(units):
        kind = kinds[units.index(one)]
        meant = [one if k == kind else usual[k] for k in kinds]
        if one != usual[kind] and meant == list(units):
            return one
    return units[0] if len(set(units)) == 1 else list(units)


@once
def reading(case: Case, evidence: Evidence) -> Reading:
    """The cheapest reading of a log."""
    overview, signals = look(case, evidence), evidence.recording.signals
    logged = velocities(case, evidence)
    rate = rate_by_velocities(signals, overview, logged)
    units = signals.time_units if rate is None else {ROW: 1.0 / rate}
    time_scale = signals.time_scale
    looked = min(
        (s / time_scale for s in units.values()),
        key=lambda second: (step_cost(overview.step * second), second != 1.0),
    )
    agreed = None if logged is None else agreement(overview, logged[1], looked)
    facts = _facts(case, evidence, overview, looked, agreed)
    found = []
    for unit, scale in units.items():
        second = scale / time_scale
        joints = _units(facts, second / looked)
        changed = CHANGED if abs(second - 1.0) > 1e-9 else 0.0
        cost = sum(j.cost for j in joints) + changed + step_cost(overview.step * second)
        found.append((cost, unit, second, joints))
    cost, unit, second, joints = min(found, key=lambda f: f[0])
    declared = tuple(f.declared(1.0 / looked) for f in facts)
    return Reading(
        unit,
        second,
        joints,
        tuple(f.declared(second / looked) for f in facts),
        cost,
        sum(j.cost for j in declared) + step_cost(overview.step),
        None if agreed is None else agreed.in_seconds(second / looked),
    )


def _units(facts: Sequence[JointFacts], second: float) -> tuple[JointReading, ...]:
    """The cheapest units of all joints."""
    kinds = [fact.coordinate.kind for fact in facts]
    of_kind = {k: iter(alike([f for f in facts if f.coordinate.kind == k], second)) for k in kinds}
    return tuple(next(of_kind[kind]) for kind in kinds)


def _facts(
    case: Case,
    evidence: Evidence,
    overview: SignalOverview,
    looked: float,
    agreed: Agreement | None,
) -> tuple[JointFacts, ...]:
    signals = evidence.recording.signals
    slope = slopes(overview, looked)
    v, move = slope.v, slope.moving
    fast = np.quantile(np.abs(v), FASTEST_SHARE, axis=1) if v.shape[1] else np.zeros(len(v))
    n = len(v)
    low, high = (
        np.quantile(overview.q, [0.005, 0.995], axis=0) if len(overview.q) else np.zeros((2, n))
    )
    reliable = np.zeros(n, dtype=np.bool_) if agreed is None else agreed.reliable_joints
    positions = declared_units(evidence, case)
    logged = velocities(case, evidence)
    rated = ("",) * n if logged is None else logged[0]
    facts = []
    for joint, c in enumerate(case.loaded.robot.coordinates):
        own = 1.0
        if signals.velocity is not None and signals.velocity_scale is not None:
            own = abs(float(signals.velocity_scale[joint]))
        rates = _relative(unit_of(own, VELOCITY_UNITS[c.kind]), VELOCITY_UNITS[c.kind])
        facts.append(
            JointFacts(
                c,
                float(low[joint]),
                float(high[joint]),
                float(fast[joint]),
                bool(move[joint]),
                float(agreed.scale[joint])
                if agreed is not None and reliable[joint]
                else float("nan"),
                _relative(positions[joint], POSITION_UNITS[c.kind]),
                {} if agreed is None else rates,
                CHANGED if signals.velocity is not None else 0.5 * CHANGED,
                (
                    _named(signals.position[joint], POSITION_UNITS[c.kind]),
                    _named(rated[joint], VELOCITY_UNITS[c.kind]),
                ),
            )
        )
    return tuple(facts)


def _named(column: str, units: Mapping[str, float]) -> str:
    """The unit in a column's name, such as that of `q1_rad`; empty if there is none."""
    words = Column(column).words
    for unit in sorted(units, key=lambda unit: (unit in ("m", "m/s"), unit)):
        if unit.split("/")[0] in words:
            return unit
    return ""


def _relative(declared: str, units: Mapping[str, float]) -> dict[str, float]:
    """Scales of units over that of the declared one, which comes first."""
    ordered = [declared, *(unit for unit in units if unit != declared)]
    return {unit: units[unit] / units[declared] for unit in ordered}


@once
def motion(case: Case, evidence: Evidence) -> Slopes:
    """Derivatives of the positions in true seconds, and which joints move."""
    return slopes(look(case, evidence), reading(case, evidence).second)


@once
def driven(case: Case, evidence: Evidence) -> NDArray[np.bool_]:
    """Joints that are not only dragged along: their speed counts beside the fastest one's."""
    slope, joints = motion(case, evidence), reading(case, evidence).joints
    if slope.v.shape[1] == 0:
        return slope.moving
    scale = np.array([joint.position_scale for joint in joints])
    speed = np.sqrt(np.square(slope.v).mean(axis=1)) * scale * slope.moving
    enough: NDArray[np.bool_] = slope.moving & (speed >= DRAGGED * speed.max())
    return enough
