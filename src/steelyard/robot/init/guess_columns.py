"""A guess of which columns of a log are what, by their names and their values."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from steelyard.base.arrays import Array, by_key
from steelyard.base.errors import LogError
from steelyard.robot.file.sections import Side, SignalsSection
from steelyard.robot.file.signals import Signals, expanded
from steelyard.robot.file.signals_from_tables import build_signals
from steelyard.robot.init import column_names
from steelyard.robot.init import guess_clock_positions_and_velocities as motion
from steelyard.robot.init import guess_efforts_and_gears as efforts
from steelyard.robot.init.column_names import Column, Quantity, by_name, by_number, give_up, listed
from steelyard.robot.init.guess_targets import position_targets
from steelyard.robot.robot import Coordinate, Robot

Sample = Mapping[str, ArrayLike]
_BY_NAME = "by the joints' names"


@dataclass(frozen=True)
class Guess:
    """What a log's columns seem to be."""

    section: SignalsSection  # as the robot file would say it; a current's gain is left open
    joints: tuple[str, ...]  # that the log has positions and efforts of, in the columns' order
    velocity: tuple[str, ...]  # velocity columns that were seen, and left out
    reasons: tuple[str, ...]  # why, one sentence each, for the user
    contradictions: tuple[str, ...] = ()  # values that contradict the model file, one sentence each
    gears: efforts.Gears | None = None  # where the log has positions of both motors and joints
    velocity_unit: Any = None  # of all velocity columns, or one per joint; `None` for rad/s and m/s

    @property
    def motor_side(self) -> bool:
        """Whether a transmission is needed."""
        return "motor" in (self.section.coordinates, self.section.effort.side)


def guess_signals(
    robot: Robot, columns: Sequence[str], sample: Sample | None = None
) -> tuple[Signals, tuple[str, ...]]:
    """Signals of a log for a robot without a robot file, and the reasons.

    The columns must cover all joints, and gains of currents would be needed, which a log cannot
    give. Some values of columns tell units that names do not state.
    """
    guess = guess_columns(robot.coordinates, columns, sample)
    refuse_motors(guess, columns)
    if missing := [name for name in robot.joint_names if name not in guess.joints]:
        raise LogError(
            f"the log has columns for {len(guess.joints)} joints of {robot.n}; "
            f"none for {', '.join(missing)}",
            where=f"columns {', '.join(columns)}",
            fix="write a robot file with `steelyard init` and set there which joints are "
            "identified, and where the others are locked",
        )
    place = "the log's columns as guessed (`steelyard init` writes the guess to a robot file)"
    return build_signals(guess.section, robot.coordinates, lambda *key: place), guess.reasons


def guess_columns(
    coordinates: Sequence[Coordinate],
    columns: Sequence[str],
    sample: Sample | None = None,
    rate: float | None = None,
    geared: bool = False,
    every: Sequence[Coordinate] = (),
    side: Side | None = None,
) -> Guess:
    """The columns of time, positions and efforts, and their units; `LogError` if unassigned.

    Columns are matched by the joints' names if they carry them, else by their numbers. Columns of
    targets and commands are passed over; velocities are used if the sample shows that they are
    worth it. A `rate` [Hz] is for logs without a column of time. What is stated counts more than
    names: the `side` of the efforts, which is that of positions too if it is `joint`; gear ratios
    (`geared`), with which positions far beyond the limits are of motors, or else efforts are.
    Numbers may count `every` joint of the robot, also those that are not to be identified; of
    columns of text a sample has the first value, which may name a joint.
    """
    arrays = {name: np.asarray(values) for name, values in (sample or {}).items()}
    texts = {name: str(x[0]) for name, x in arrays.items() if x.dtype.kind == "U" and len(x)}
    values = {name: column_names.finite(x) for name, x in arrays.items()}
    named = column_names.labelled(columns, texts, [c.name for c in every or coordinates])
    kinds = by_key((c.quantity, c) for c in named if c.quantity is not None)
    joints, counted, position, effort, how = _matched(coordinates, every, kinds, columns, values)
    clock, time_reason = motion.clock_of(kinds.get("time", []), position[0], columns, values, rate)
    if counts := [c.name for c in effort if c.has(*efforts.COUNTS)]:
        give_up(f"efforts are in counts, which have no unit: {', '.join(counts)}", columns)
    effort_words, units = efforts.effort_units(effort, joints, values)
    of_motors = all(c.of_motor for c in effort) if side is None else side == "motor"
    where = motion.guess_positions(position, joints, values, columns, geared or of_motors, side)
    stated = side is not None or (geared and not (of_motors or where.motors))
    of_motors = side == "motor" if side is not None else of_motors or stated
    if stated:
        effort_words = "of motors, as stated: joint torque through the gears"
        effort_words = effort_words if of_motors else "torque at the joints, as stated"
    velocity = _one_each(joints, counted, kinds.get("velocity", []))
    rates = motion.judged(velocity, position, joints, where.unit, clock, sample or {})
    used = rates.used
    counting = by_number(len(counted), kinds["effort"], [c.kind for c in counted])
    groups = [effort, *(group for group in counting if set(effort) <= set(group))]
    currents = {"A", "mA"} & set(units)  # a gain takes them to the joints' side, unless stated
    kind = "motor_current" if currents else "motor_torque" if of_motors else "joint_torque"
    behind = "motor" if of_motors and (stated or not currents) else "joint"
    free = efforts.unactuated(position, effort, values) if behind == "joint" else ()
    section = SignalsSection.model_validate(
        {
            **clock,
            "coordinates": "motor" if where.motors else "joint",
            "position": _short(position, joints),
            "position_unit": where.unit,
            **({"velocity": _short(used, joints)} if used else {}),
            **({"velocity_unit": rates.unit} if used and rates.unit else {}),
            "effort": {
                "columns": _short(effort, joints),
                "kind": kind,
                "side": behind,
                "unit": units[0] if len(set(units)) == 1 else units,
                "unactuated": [joints[j].name for j in free],
            },
        }
    )
    if how == _BY_NAME and all(c.label for c in position):
        how = "by the joints' names in the log's rows"
    elif how != _BY_NAME:
        called = [c.label for c in column_names.labelled([c.name for c in position], texts)]
        if all(called) and len(set(called)) == len(called):
            how += f", though the log calls them {', '.join(called)}: check it"
    reasons = [
        time_reason,
        f"positions are {listed(position)}, assigned {how}; {where.reason}",
        f"efforts are {listed(effort)}, assigned {how}; {effort_words}"
        + efforts.others([c for group in groups for c in group], kinds.get("effort", [])),
    ]
    if free:
        names_of_free = ", ".join(joints[j].name for j in free)
        reasons.append(
            f"no motor drives {names_of_free}, as the effort is always zero while the joint moves; "
            "if it is only not measured, lock the joint or log its effort"
        )
    if velocity:
        reasons.append(rates.reason)
    goals = position_targets(named)
    if goals and len(goals) == len(counted):
        reasons.append(
            f"targets are logged too ({listed(goals)}): to identify the actuators that follow "
            "them, add target = ... under [signals], and a section [actuator]"
        )
    left = () if used else tuple(c.name for c in velocity)
    contradictions = where.contradictions + rates.contradictions
    if kind == "joint_torque":
        contradictions += efforts.beyond_effort(effort, joints, values)
    gears = None if where.motors else _gears(joints, position, kinds.get("position", ()), sample)
    names = tuple(c.name for c in joints)
    return Guess(section, names, left, tuple(reasons), contradictions, gears, rates.unit)


def _gears(
    joints: Sequence[Coordinate],
    position: Sequence[Column],
    every: Sequence[Column],
    sample: Sample | None,
) -> efforts.Gears | None:
    """Gears from a log that has positions of joints and of motors."""
    motors = [column for column in every if column.of_motor]
    found = _one_each(joints, (), motors) or _one_each(joints, joints, motors)
    columns = [*found, *position]
    if not found or sample is None or any(column.name not in sample for column in columns):
        return None
    sides = [np.asarray(sample[column.name], dtype=np.float64) for column in columns]
    return efforts.regressed(sides[: len(joints)], sides[len(joints) :])


def velocities_beside(position: Sequence[str], columns: Sequence[str]) -> tuple[str, ...]:
    """Velocity columns that are called as the position columns are; none if one lacks its own."""
    found = by_key((c.stem, c.name) for c in map(Column, columns) if c.quantity == "velocity")
    beside = [found.get(Column(name).stem, []) for name in position]
    return tuple(names[0] for names in beside) if all(len(n) == 1 for n in beside) else ()


def refuse_motors(guess: Guess, columns: Sequence[str]) -> None:
    """Signals of motors need gear ratios, which a model file alone does not give."""
    section = guess.section
    if not guess.motor_side:
        return
    moved = section.coordinates == "motor"
    given = section.position if moved else section.effort.columns
    named = given if isinstance(given, str) else ", ".join(given)
    what = "positions" if moved else "efforts"
    give_up(f"{what} are of motors, not of joints: {named}", columns, column_names.OF_MOTORS)


def recognised(
    quantity: Quantity, coordinates: Sequence[Coordinate], columns: Sequence[str]
) -> tuple[Column | None, ...]:
    """Columns of a quantity in a log that cannot be assigned as a whole.

    A column or `None` for each joint, where more than half of the joints have one; else nothing.
    """
    named = [c for c in map(Column, columns) if c.quantity == quantity]
    by_joint, count = by_name(coordinates, named), len(coordinates)
    groups = by_number(count, named, [c.kind for c in coordinates])
    if groups and len(by_joint) < count:
        return groups[0]
    if 2 * len(by_joint) > count:
        return tuple(by_joint.get(c.name) for c in coordinates)
    return column_names.partly_by_number(count, named)


def _matched(
    coordinates: Sequence[Coordinate],
    every: Sequence[Coordinate],
    kinds: Mapping[Quantity, Sequence[Column]],
    columns: Sequence[str],
    values: Mapping[str, Array],
) -> tuple[list[Coordinate], Sequence[Coordinate], list[Column], list[Column], str]:
    """Joints, those that numbers count, position and effort columns, and how they were assigned."""
    position, effort = kinds.get("position", ()), kinds.get("effort", ())
    named_q, named_tau = by_name(coordinates, position), by_name(coordinates, effort)
    if joints := [c for c in coordinates if c.name in named_q and c.name in named_tau]:
        found_q, found_tau = ([named[c.name] for c in joints] for named in (named_q, named_tau))
        return joints, (), found_q, found_tau, _BY_NAME
    joints = [c for c in coordinates if not column_names.like_finger(c.name)]
    for counted in (joints, every or coordinates):
        numbered_q, numbered_tau = (_numbered(joints, counted, x) for x in (position, effort))
        if numbered_q and numbered_tau:
            found = (g for g in numbered_tau if any(efforts.changes(c.name, values) for c in g))
            alive = next(found, numbered_tau[0])
            return joints, counted, list(numbered_q[0]), list(alive), "by their numbers"
    quantity: Quantity = "position"
    if _numbered(joints, joints, position) or all(c.name in named_q for c in joints):
        quantity = "effort"
    give_up(_why_not(quantity, kinds.get(quantity, ()), joints, columns), columns)


def _why_not(
    quantity: Quantity, like: Sequence[Column], joints: Sequence[Coordinate], columns: Sequence[str]
) -> str:
    """Why no columns are assigned: none like them, some joints without, or not one for each."""
    every, what = [*map(Column, columns)], f"{quantity}s"
    found = recognised(quantity, joints, columns)
    missing = [j.name for j, column in zip(joints, found, strict=False) if column is None]
    if missing:
        beside = [column for column in found if column is not None]
        left = [c for c in every if c not in beside and c.quantity in (None, quantity)]
        perhaps = f" (perhaps {listed(left)})" if left else ""
        return (
            f"{what} are {listed(beside)}, but no column is recognised as that of "
            f"{', '.join(missing)}{perhaps}"
        )
    topics = {name.partition("/position/")[0] for name in columns if "/position/" in name}
    if not like and quantity == "effort" and any(c.of_target for c in every):
        return (
            "no efforts are logged, but targets: `steelyard init MODEL LOG` writes a robot file "
            "from which the actuators are identified"
        )
    if not like and quantity == "effort" and topics:
        return f"messages of {', '.join(sorted(topics))} have positions, but no values of efforts"
    if not like:
        key = "[signals] position" if quantity == "position" else "[signals.effort] columns"
        groups = by_number(len(joints), [c for c in every if c.quantity is None])
        lines = [f"{key} = {json.dumps(_short(group, joints))}" for group in groups]
        return f"none look like the {what} of {len(joints)} joints" + (
            f"; if these are, write {' or '.join(lines)}"
            if lines
            else f"; if another file has the {what} of the same rows, join both: "
            "steelyard log convert LOG JOINED.csv --beside OTHER"
        )
    return (
        f"{len(like)} columns look like {what} ({listed(like)}), but the robot model has "
        f"{len(joints)} joints ({', '.join(joint.name for joint in joints)}): log or model file of "
        "another robot, or joints that are not logged"
    )


def _one_each(
    joints: Sequence[Coordinate], counted: Sequence[Coordinate], columns: Sequence[Column]
) -> tuple[Column, ...]:
    """A column for each joint by the number among those counted, or by name if none are; or ()."""
    if counted:
        return next(iter(_numbered(joints, counted, columns)), ())
    named = by_name(joints, columns)
    found = tuple(named[c.name] for c in joints if c.name in named)
    return found if len(found) == len(joints) else ()


def _numbered(
    joints: Sequence[Coordinate], counted: Sequence[Coordinate], columns: Sequence[Column]
) -> list[tuple[Column, ...]]:
    """Columns of joints, by groups in which numbers count some joints, these among them."""
    places = [k for k, coordinate in enumerate(counted) if coordinate in joints]
    groups = by_number(len(counted), columns, [c.kind for c in counted])
    return [tuple(group[k] for k in places) for group in groups]


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
