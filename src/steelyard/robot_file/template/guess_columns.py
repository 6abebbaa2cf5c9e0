"""A guess of which columns of a log are what, by their names and their values."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NoReturn

import numpy as np
from numpy.typing import ArrayLike

from steelyard.arrays import Array
from steelyard.errors import LogError
from steelyard.robot.robot import Coordinate, Robot
from steelyard.robot_file.column_names import Column, Quantity, by_name, by_number, like_finger
from steelyard.robot_file.sections import SignalsSection
from steelyard.robot_file.signals import Signals, build_signals, expanded
from steelyard.robot_file.template.guess_efforts import COUNTS, changes, effort_units, others, reach
from steelyard.robot_file.template.guess_velocities import judged, rates

Sample = Mapping[str, ArrayLike]
_BY_NAME = "by the joints' names"


@dataclass(frozen=True)
class Guess:
    """What a log's columns seem to be.

    Attributes:
        section: As the robot file would say it; a current's gain is left open.
        joints: Joints that the log has positions and efforts of, in the order of the columns.
        velocity: Velocity columns that were seen, and left out.
        reasons: Why, one sentence each, for the user.
    """

    section: SignalsSection
    joints: tuple[str, ...]
    velocity: tuple[str, ...]
    reasons: tuple[str, ...]


def guess_signals(
    robot: Robot, columns: Sequence[str], sample: Sample | None = None
) -> tuple[Signals, tuple[str, ...]]:
    """Signals of a log for a robot without a robot file, and the reasons.

    Args:
        robot: The robot; the log must cover all its joints.
        columns: Names of the log's columns.
        sample: Some values of columns, for units that names do not tell.

    Raises:
        LogError: The columns cannot be told, or do not cover the joints.
        ModelError: The columns hold motor current: gains are needed, which a log cannot tell.
    """
    guess = guess_columns(robot.coordinates, columns, sample)
    if missing := [name for name in robot.joint_names if name not in guess.joints]:
        raise LogError(
            f"the log has columns for {len(guess.joints)} joints of {robot.n}; "
            f"none for {', '.join(missing)}",
            where=f"columns {', '.join(columns)}",
            fix="write a robot file with `steelyard init` and set there which joints are "
            "identified, and where the others are locked",
        )

    def where(*key: str | int) -> str:
        return "the log's columns as guessed (`steelyard init` writes the guess to a robot file)"

    return build_signals(guess.section, robot.coordinates, where), guess.reasons


def guess_columns(
    coordinates: Sequence[Coordinate],
    columns: Sequence[str],
    sample: Sample | None = None,
    rate: float | None = None,
) -> Guess:
    """The columns of time, positions and efforts, and their units.

    Columns are matched by the joints' names if they carry them, else by their numbers. Columns of
    targets and commands are passed over; velocities are used if the sample shows that they are
    worth it.

    Raises:
        LogError: They cannot be told.
    """
    values = {name: _finite(values) for name, values in (sample or {}).items()}
    kinds: dict[Quantity, list[Column]] = {}
    for column in map(Column, columns):
        if column.quantity is not None:
            kinds.setdefault(column.quantity, []).append(column)
    joints, position, effort, how = _matched(coordinates, kinds, columns, values)
    clock, time_reason = _clock(_beside(position, kinds.get("time", [])), columns, values, rate)
    if motors := [c.name for c in position if c.has("motor", "motors")]:
        wrong = f"positions are of motors, not of joints: {', '.join(motors)}"
        _give_up(wrong, columns, OF_MOTORS)
    if counted := [c.name for c in effort if c.has(*COUNTS)]:
        _give_up(f"efforts are in counts, which have no unit: {', '.join(counted)}", columns)
    effort_words, units = effort_units(effort, joints, values)
    position_unit, position_reason = _position_unit(position, joints, values)
    velocity = _velocity(joints, kinds.get("velocity", []), how)
    used, velocity_reason = judged(velocity, position, position_unit, clock, sample or {})
    section = SignalsSection.model_validate(
        {
            **clock,
            "position": _short(position, joints),
            "position_unit": position_unit,
            **({"velocity": _short(used, joints)} if used else {}),
            **({"velocity_unit": rates(position_unit)} if used and position_unit else {}),
            "effort": {
                "columns": _short(effort, joints),
                "kind": "motor_current" if {"A", "mA"} & set(units) else "joint_torque",
                "unit": units[0] if len(set(units)) == 1 else units,
            },
        }
    )
    reasons = [
        time_reason,
        f"positions are {_listed(position)}, assigned {how}; {position_reason}",
        f"efforts are {_listed(effort)}, assigned {how}; {effort_words}"
        + others(effort, kinds.get("effort", [])),
    ]
    if velocity:
        reasons.append(velocity_reason)
    left = () if used else tuple(c.name for c in velocity)
    return Guess(section, tuple(c.name for c in joints), left, tuple(reasons))


def guess_time(columns: Sequence[str], sample: Sample) -> tuple[str, str] | None:
    """The column of time and its unit; `None` if no column looks like time."""
    values = {name: _finite(values) for name, values in sample.items()}
    candidates = [c for c in map(Column, columns) if c.quantity == "time"]
    try:
        time = _time(candidates, columns, values)
    except LogError:
        return None
    return time.name, _time_unit(time, values)[0]


def velocities_beside(position: Sequence[str], columns: Sequence[str]) -> tuple[str, ...]:
    """Velocity columns that are called as the position columns are; none if one lacks its own.

    Args:
        position: The position columns, in the joints' order.
        columns: All columns of the log.
    """
    found: dict[tuple[str, ...], list[str]] = {}
    for column in map(Column, columns):
        if column.quantity == "velocity":
            found.setdefault(column.stem, []).append(column.name)
    beside = [found.get(Column(name).stem, []) for name in position]
    return tuple(names[0] for names in beside) if all(len(n) == 1 for n in beside) else ()


IN_FILE = (
    'set it in a robot file: [signals] time = "...", position = ["...", ...] and '
    "[signals.effort] columns = [...], kind = ..., unit = ... (`steelyard init` writes one)"
)


OF_MOTORS = (
    "the gears between motors and joints are needed: in a robot file (`steelyard init` writes one) "
    'set [signals] coordinates = "motor" and [robot.transmission] ratios = [turns of each motor '
    "per turn of its joint], with coupling = [...] where a motor turns with a second joint; and "
    "[signals.effort] columns = [...], kind = ..., side, unit = ..."
)


def _give_up(wrong: str, columns: Sequence[str], fix: str = IN_FILE) -> NoReturn:
    raise LogError(
        f"the log's columns cannot be assigned: {wrong}",
        where=f"columns {', '.join(columns)}",
        fix=fix,
    )


def _finite(values: ArrayLike) -> Array:
    array = np.asarray(values, dtype=np.float64)
    finite: Array = array[np.isfinite(array)]
    return finite


def _listed(columns: Sequence[Column]) -> str:
    return ", ".join(c.name for c in columns)


def _time(
    candidates: Sequence[Column], columns: Sequence[str], values: Mapping[str, Array]
) -> Column:
    def rises(column: Column) -> bool:
        steps = np.diff(values.get(column.name, np.zeros(0)))
        return bool(len(steps) == 0 or np.mean(steps >= 0.0) > 0.9)

    rising = [c for c in candidates if rises(c)]
    if not rising:
        _give_up(
            "no column looks like time",
            columns,
            "give the log's rate: `steelyard init URDF LOG --rate HZ` writes a robot file with "
            f'[signals] rate = HZ instead of time = "..."; or {IN_FILE}',
        )
    return min(rising, key=lambda c: (_topic(c) != _topic(rising[0]), len(c.words)))


def _clock(
    candidates: Sequence[Column],
    columns: Sequence[str],
    values: Mapping[str, Array],
    rate: float | None,
) -> tuple[dict[str, Any], str]:
    """What the robot file says of time, and why."""
    if rate is not None:
        said = f"time is the number of the row at the {rate:g} Hz that were given"
        beside = f", not {_listed(candidates)}" if candidates else ""
        return {"rate": rate}, said + beside
    time = _time(candidates, columns, values)
    unit, reason = _time_unit(time, values)
    said = f"time is '{time.name}' in {unit}, {reason}"
    return {"time": time.name, "time_unit": unit}, said


def _beside(position: Sequence[Column], candidates: Sequence[Column]) -> Sequence[Column]:
    """Times of the topic that positions are of, if the log is of messages."""
    topic = position[0].name.rpartition("/position/")[0]
    return [c for c in candidates if topic and _topic(c) == topic] or candidates


def _topic(time: Column) -> str:
    return time.name.rpartition("/")[0]


def _matched(
    coordinates: Sequence[Coordinate],
    kinds: Mapping[Quantity, Sequence[Column]],
    columns: Sequence[str],
    values: Mapping[str, Array],
) -> tuple[list[Coordinate], list[Column], list[Column], str]:
    """Joints, their position and effort columns, and how they were told."""
    position, effort = kinds.get("position", ()), kinds.get("effort", ())
    named_q, named_tau = by_name(coordinates, position), by_name(coordinates, effort)
    if joints := [c for c in coordinates if c.name in named_q and c.name in named_tau]:
        found_q, found_tau = ([named[c.name] for c in joints] for named in (named_q, named_tau))
        return joints, found_q, found_tau, _BY_NAME
    joints = [c for c in coordinates if not like_finger(c.name)]
    kinds_of = [c.kind for c in joints]
    numbered_q, numbered_tau = (by_number(len(joints), x, kinds_of) for x in (position, effort))
    for what, like, groups in (
        ("positions", position, numbered_q),
        ("efforts", effort, numbered_tau),
    ):
        if not groups:
            beside = f": {len(like)} columns look like {what}" if like else ""
            _give_up(f"none look like the {what} of {len(joints)} joints{beside}", columns)
    alive = [g for g in numbered_tau if any(changes(c.name, values) for c in g)] or numbered_tau
    return joints, list(numbered_q[0]), list(alive[0]), "by their numbers"


def _velocity(
    joints: Sequence[Coordinate], columns: Sequence[Column], how: str
) -> tuple[Column, ...]:
    if how == _BY_NAME:
        named = by_name(joints, columns)
        found = tuple(named[c.name] for c in joints if c.name in named)
        return found if len(found) == len(joints) else ()
    groups = by_number(len(joints), columns, [c.kind for c in joints])
    return groups[0] if groups else ()


def _time_unit(time: Column, values: Mapping[str, Array]) -> tuple[str, str]:
    for unit, words in (
        ("ms", ("ms", "msec", "millis")),
        ("us", ("us", "usec", "micros")),
        ("ns", ("ns", "nsec", "nanos")),
        ("s", ("s", "sec", "seconds")),
    ):
        if time.has(*words):
            return unit, "by its name"
    steps = np.diff(values.get(time.name, np.zeros(0)))
    step = float(np.median(steps[steps > 0.0])) if np.any(steps > 0.0) else 0.0
    if step == 0.0:
        return "s", "by default"
    unit = "s" if step < 0.5 else "ms" if step < 500.0 else "us" if step < 5e5 else "ns"
    return unit, f"as its steps are {step:.4g}"


def _position_unit(
    columns: Sequence[Column], joints: Sequence[Coordinate], values: Mapping[str, Array]
) -> tuple[Any, str]:
    units, why = [], "in rad or m, by default"
    for column, joint in zip(columns, joints, strict=True):
        most = reach(column.name, values)
        si, other = ("rad", "deg") if joint.kind == "revolute" else ("m", "mm")
        if column.has(si, other, "degree", "degrees"):
            units.append(si if column.has(si) else other)
            why = "units by their names"
        else:
            limit = max(abs(joint.limits.lower), abs(joint.limits.upper))
            far = 4.0 * np.pi if joint.kind == "revolute" else 10.0 * min(limit, 1.0)
            units.append(other if most > far else si)
            if most > 0.0:
                why = f"in {units[-1]} by their range (up to {most:.3g})"
    if set(units) <= {"rad", "m"}:
        return None, why
    return (units[0] if len(set(units)) == 1 else units), why


def _short(columns: Sequence[Column], joints: Sequence[Coordinate]) -> Any:
    """One pattern for all columns if there is one, else the list."""
    names = tuple(c.name for c in columns)
    if len(names) < 2:
        return names
    first = names[0]
    for at in (k for k, letter in enumerate(first) if letter == "1"):
        pattern = f"{first[:at]}{{}}{first[at + 1 :]}"
        if expanded(pattern, joints) == names:
            return pattern
    return names
