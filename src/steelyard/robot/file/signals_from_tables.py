"""What a robot file declares of signals: columns, clock, units, signs, gains and gear sides."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from steelyard.base.arrays import Array, frozen
from steelyard.base.errors import ModelError, refuse_unknown
from steelyard.robot.file import signals
from steelyard.robot.robot import Coordinate, Transmission

if TYPE_CHECKING:
    from steelyard.robot.file.sections import SignalsSection

Locate = Callable[..., str]  # key path in the robot file to the words of a message's `where`


def build_signals(
    section: SignalsSection,
    coordinates: Sequence[Coordinate],
    locate: Locate,
    gears: Transmission | None = None,
) -> signals.Signals:
    """The signals a robot file declares, for the joints it identifies and gears, if it has any."""
    if not section.has_efforts:
        raise ModelError(
            "there are neither columns of efforts nor of position targets",
            where=locate("signals"),
            fix="add [signals.effort] columns = ..., kind = ..., unit = ...; or target = ..., if "
            "joints follow targets and their efforts are not logged",
        )
    for key in ("supply_voltage", "nominal_voltage"):
        if getattr(section, key) is not None:
            raise ModelError(
                f"{key} is given, and no actuators are identified",
                where=locate("signals", key),
                fix=f"remove {key}; or add target = ... and [actuator], for actuators that follow "
                "position targets",
            )
    declared = _Declared(section, coordinates, locate)
    declared.check_sides(gears)
    columns = declared.motion_columns()
    time, time_scale = declared.clock()
    unactuated = declared.unactuated()
    effort = declared.effort_columns(unactuated)
    measured = tuple(x for j, x in enumerate(effort) if j not in unactuated)
    for keys in (_MEASURED, _COMMANDED):
        moved = [((key,), columns.get(key, ())) for key in keys]
        declared.check_distinct([(("time",), (time,)), *moved, (("effort", "columns"), measured)])
    position_scale = declared.scales("position") * declared.signs("position")
    velocity_scale = declared.scales("velocity") * declared.signs("velocity")
    units, effort_scale = declared.effort_units()
    gains, unknown_gains = declared.gains(effort, units)
    effort_map = position_map = None
    if gears is not None and section.coordinates == "motor":
        position_map = frozen(np.linalg.inv(gears.matrix))
    if gears is not None and section.effort.side == "motor":
        if gears.coupled:
            if any(unknown_gains):
                raise ModelError(
                    "gains behind coupled gears cannot be identified",
                    where=locate("signals", "effort", "gain"),
                    fix="give each motor's gain (its torque constant), or log joint torques",
                )
            effort_map = frozen(gears.matrix.T * gains)  # R^T diag(k)
            units = tuple(c.effort_unit for c in coordinates)
            gains = np.ones(len(coordinates))
        else:
            gains = gains * np.diag(gears.matrix)
    offsets, unknown_offsets = declared.offsets()
    return signals.Signals(
        time=time,
        time_scale=time_scale,
        position=columns["position"],
        position_scale=frozen(position_scale),
        velocity=columns.get("velocity"),
        velocity_scale=frozen(velocity_scale) if "velocity" in columns else None,
        effort=effort,
        effort_scale=effort_scale,
        effort_kind=section.effort.kind,
        effort_units=units,
        gains=frozen(gains),
        effort_side=section.effort.side,
        unknown_gains=unknown_gains,
        position_map=position_map,
        position_offset=offsets,
        effort_map=effort_map,
        velocity_delay=section.velocity_delay,
        effort_delay=section.effort.delay,
        unknown_offsets=unknown_offsets,
        unactuated=unactuated,
        commanded_position=columns.get("commanded_position"),
        commanded_velocity=columns.get("commanded_velocity"),
        commanded_velocity_scale=frozen(velocity_scale)
        if "commanded_velocity" in columns
        else None,
    )


def build_target_signals(
    section: SignalsSection,
    coordinates: Sequence[Coordinate],
    locate: Locate,
    gears: Transmission | None = None,
) -> signals.TargetSignals:
    """The signals that a robot file declares for joints whose actuators are identified."""
    for key in ("velocity", "commanded_position", "commanded_velocity"):
        if getattr(section, key) is not None:
            raise ModelError(
                f"{key} is given beside target"
                + (", with [actuator]" if section.has_efforts else ", but no efforts"),
                where=locate("signals", key),
                fix=f"remove {key}: actuators are identified from positions and targets; or "
                + ("remove [actuator]" if section.has_efforts else "add [signals.effort]")
                + ", to identify from efforts",
            )
    if (section.supply_voltage is None) != (section.nominal_voltage is None):
        given = "supply_voltage" if section.nominal_voltage is None else "nominal_voltage"
        raise ModelError(
            f"{given} is given alone",
            where=locate("signals", given),
            fix='give both: supply_voltage = "COLUMN", and nominal_voltage = the voltage that '
            "identified values are for, in the unit of that column",
        )
    if section.coordinates == "motor":
        raise ModelError(
            "targets are those of motors",
            where=locate("signals", "coordinates"),
            fix='actuators are identified at the joints: coordinates = "joint"',
        )
    declared = _Declared(section, coordinates, locate)
    if section.has_efforts:
        declared.check_sides(gears)
    time, time_scale = declared.clock()
    position, target = (declared.columns(getattr(section, k), k) for k in ("position", "target"))
    named = [("time", (time,)), ("position", position), ("target", target)]
    named += [("supply_voltage", (section.supply_voltage,))] if section.supply_voltage else []
    keys = [((key,), columns) for key, columns in named]
    efforts = declared.effort_columns(()) if section.has_efforts else ()
    declared.check_distinct([*keys, (("effort", "columns"), efforts)])
    scale = frozen(declared.scales("position"))
    zeros = declared.each(section.position_offset, "offsets", "position_offset")
    known = tuple(None if zero == "identify" else zero for zero in zeros)
    signs = declared.each(section.position_sign, "signs", "position_sign")
    found = signals.TargetSignals(time, time_scale, position, target, scale, signs, known)
    if section.supply_voltage is not None and section.nominal_voltage is not None:
        found = replace(found, supply=section.supply_voltage, nominal=section.nominal_voltage)
    return _with_efforts(found, declared, gears) if section.has_efforts else found


def _with_efforts(
    found: signals.TargetSignals, declared: _Declared, gears: Transmission | None
) -> signals.TargetSignals:
    """With the columns of efforts that are logged beside targets."""
    given, where = declared.section.effort, declared.locate("signals", "effort")
    refused = {
        "are gravity compensated": given.kind == "gravity_compensated_torque",
        "have a delay": given.delay != 0.0,
        "are missing at joints": bool(given.unactuated),
        "are those of coupled motors": gears is not None and gears.coupled,
    }
    for words in (words for words, yes in refused.items() if yes):
        raise ModelError(
            f"efforts beside targets {words}, and actuators are described",
            where=where,
            fix="remove [signals.effort]: actuators are identified without them; or remove "
            "[actuator], to identify from efforts",
        )
    columns = declared.effort_columns(())
    units, scale = declared.effort_units()
    gains, unknown = np.ones(found.n), (True,) * found.n
    if given.gain is not None or not set(units) & set(signals.WITHOUT_TORQUE):
        gains, unknown = declared.gains(columns, units)
    known = [float(g) for g, no in zip(gains, unknown, strict=True) if not no]
    if any(unknown) and 1.0 in known and set(units) & set(signals.WITHOUT_TORQUE):
        raise ModelError(
            'a gain of 1 beside "identify" stands for a scale that is not known',
            where=declared.locate("signals", "effort", "gain"),
            fix='write gain = "identify" for all joints; or the torque per unit that is known',
        )
    if gears is not None and given.side == "motor":
        gains = gains * np.diag(gears.matrix)
    return replace(
        found,
        effort=columns,
        effort_units=units,
        effort_scale=tuple(scale.tolist()),
        effort_gain=tuple(None if no else float(g) for g, no in zip(gains, unknown, strict=True)),
        effort_at_joint=given.kind not in signals.MOTOR_KINDS,
    )


_MEASURED, _COMMANDED = ("position", "velocity"), ("commanded_position", "commanded_velocity")


@dataclass(frozen=True)
class _Declared:
    """The table `[signals]` of a robot file, for some of its joints."""

    section: SignalsSection
    joints: Sequence[Coordinate]
    locate: Locate

    def each(self, given: Any, what: str, *key: str) -> tuple[Any, ...]:
        """A value per joint, from one for all or a list."""
        values = given if isinstance(given, tuple) else (given,) * len(self.joints)
        if len(values) != len(self.joints):
            names = ", ".join(c.name for c in self.joints)
            raise ModelError(
                f"{len(values)} {what} are given for {len(self.joints)} identified joints "
                f"({names})",
                where=self.locate("signals", *key),
                fix="give one per joint, in the joints' order; [robot] joints = [...] says which "
                "joints are identified",
            )
        return values

    def columns(self, given: str | tuple[str, ...], *key: str) -> tuple[str, ...]:
        """A column for each joint, of a list or a pattern."""
        if isinstance(given, str):
            if "{}" not in given and "{joint}" not in given and len(self.joints) > 1:
                raise ModelError(
                    f"'{given}' is one column, but {len(self.joints)} joints are identified",
                    where=self.locate("signals", *key),
                    fix='list one column per joint, or give a pattern: "q{}" for q1, q2, ..., '
                    'or "{joint}_position"',
                )
            given = signals.expanded(given, self.joints)
        return self.each(given, f"columns ({', '.join(given)})", *key)

    def motion_columns(self) -> dict[str, tuple[str, ...]]:
        """Columns of measured and commanded motion; targets are the commanded positions."""
        section, locate = self.section, self.locate
        columns = {
            key: self.columns(given, key)
            for key in (*_MEASURED, *_COMMANDED, "target")
            if (given := getattr(section, key)) is not None
        }
        if columns.keys() >= {"target", "commanded_position"}:
            raise ModelError(
                "target and commanded_position are both given",
                where=locate("signals", "target"),
                fix="keep one of them: both are the positions that the joints are to follow",
            )
        if "target" in columns:
            columns["commanded_position"] = columns.pop("target")
        if "commanded_velocity" in columns and "commanded_position" not in columns:
            raise ModelError(
                "commanded_velocity is given, but no commanded_position",
                where=locate("signals", "commanded_velocity"),
                fix="add commanded_position = ..., or remove commanded_velocity",
            )
        without = not columns.keys() & {"velocity", "commanded_velocity"}
        for key in ("velocity_unit", "velocity_sign", "velocity_delay"):
            if without and getattr(section, key):
                raise ModelError(
                    f"{key} is given, but no velocity columns",
                    where=locate("signals", key),
                    fix=f"add velocity = ..., or remove {key}",
                )
        return columns

    def clock(self) -> tuple[str, float]:
        """Column of time, or of the rows' numbers if only a rate is given; seconds per unit."""
        section = self.section
        if section.rate is None and section.time is not None:
            return section.time, signals.TIME_UNITS[section.time_unit]
        if section.rate is not None and section.time is None:
            return signals.ROW, 1.0 / section.rate
        both, none = "both a column of time and a rate", "neither a column of time nor a rate"
        raise ModelError(
            f"there is {both if section.rate else none}",
            where=self.locate("signals"),
            fix='set time = "..." for the log\'s clock, or rate = ... [Hz] if it has none',
        )

    def check_distinct(self, lists: Iterable[tuple[tuple[str, ...], Sequence[str]]]) -> None:
        """Refuse a column that two signals share; `lists` are keys with their columns."""
        known: dict[str, str] = {}
        for key, columns in lists:
            name = ".".join(("signals", *key))
            for column in columns:
                if column in known:
                    places = " and ".join(dict.fromkeys((known[column], name)))
                    raise ModelError(
                        f"column '{column}' is used twice, in {places}",
                        where=self.locate("signals", *key),
                        fix="give every signal a column of its own",
                    )
                known[column] = name

    def scales(self, quantity: str) -> Array:
        """SI per logged unit, without signs.

        A unit is a name or a number. One name for all means those joints that it can measure. A
        motor that turns may drive a prismatic joint.
        """
        given, key = getattr(self.section, f"{quantity}_unit"), f"{quantity}_unit"
        units = signals.POSITION_UNITS if quantity == "position" else signals.VELOCITY_UNITS
        if self.section.coordinates == "motor":
            units = dict.fromkeys(units, {u: x for some in units.values() for u, x in some.items()})
        wanted: Sequence[str | float | None] = self.each(given, "units", key)
        if isinstance(given, str) and any(given in units[c.kind] for c in self.joints):
            wanted = [given if given in units[c.kind] else None for c in self.joints]
        for coordinate, unit in zip(self.joints, wanted, strict=True):
            if isinstance(unit, str) and unit not in (fitting := units[coordinate.kind]):
                raise ModelError(
                    f"unit '{unit}' does not fit joint '{coordinate.name}', which is "
                    f"{coordinate.kind}",
                    where=self.locate("signals", key),
                    fix=f"use one of {', '.join(fitting)}",
                )
        pairs = zip(self.joints, wanted, strict=True)
        sizes = (units[c.kind][unit] if isinstance(unit, str) else unit for c, unit in pairs)
        return np.array([1.0 if size is None else size for size in sizes])

    def signs(self, quantity: str) -> Any:
        """1, or -1 where a column counts the other way."""
        key = f"{quantity}_sign"
        given = getattr(self.section, key)
        return 1.0 if given is None else np.array(self.each(given, "signs", key))

    def unactuated(self) -> tuple[int, ...]:
        """Numbers of the joints without a motor."""
        names = [c.name for c in self.joints]
        effort, where = self.section.effort, self.locate("signals", "effort", "unactuated")
        for name in effort.unactuated:
            wrong = f"'{name}' is none of the identified joints"
            refuse_unknown(name, names, wrong, where, "joints")
        all_given = len(effort.unactuated) == len(names)
        if effort.unactuated and (all_given or effort.side == "motor"):
            raise ModelError(
                "no joint has a motor"
                if all_given
                else "efforts are those of motors, and a joint has none",
                where=where,
                fix='name the joints without a motor; efforts are those of joints (side = "joint")',
            )
        return tuple(j for j, name in enumerate(names) if name in effort.unactuated)

    def effort_columns(self, unactuated: tuple[int, ...]) -> tuple[str, ...]:
        """A column per joint; where it has no motor, of any name."""
        given, key = self.section.effort.columns, ("effort", "columns")
        some = [c for j, c in enumerate(self.joints) if j not in unactuated]
        if not unactuated or isinstance(given, str) or len(given) != len(some):
            return self.columns(given, *key)
        found = list(replace(self, joints=some).columns(given, *key))
        for j in unactuated:
            found.insert(j, f"effort of {self.joints[j].name}")
        return tuple(found)

    def offsets(self) -> tuple[Array | None, tuple[bool, ...]]:
        """Offsets, 0 where they are to be identified, and where they are; `None` if none given."""
        given, key = self.section.position_offset, "position_offset"
        if given is None:
            return None, ()
        offsets = self.each(given, "offsets", key)
        for offset, coordinate in zip(offsets, self.joints, strict=True):
            if offset != "identify" and signals.looks_like_degrees(offset, coordinate):
                raise ModelError(
                    f"position_offset is in rad: {offset:g} of '{coordinate.name}' looks like "
                    "degrees",
                    where=self.locate("signals", key),
                    fix=f"write {np.deg2rad(offset):.6g}",
                )
        unknown = tuple(offset == "identify" for offset in offsets)
        return frozen([0.0 if x == "identify" else float(x) for x in offsets]), unknown

    def check_sides(self, gears: Transmission | None) -> None:
        """Signals of the motors' side need a transmission."""
        effort = self.section.effort
        sides = ((self.section.coordinates, ("coordinates",)), (effort.side, ("effort", "side")))
        for side, key in sides:
            if side == "motor" and gears is None:
                raise ModelError(
                    "signals are those of the motors, but the robot has no transmission",
                    where=self.locate("signals", *key),
                    fix="give [robot.transmission] ratios = [...], or a matrix (in a file of "
                    "`steelyard init`: fill in ratios, and remove the # before it and before "
                    "[robot.transmission])",
                )
        if effort.side == "motor" and effort.kind not in signals.MOTOR_KINDS:
            raise ModelError(
                f"an effort of kind '{effort.kind}' is not one of the motors",
                where=self.locate("signals", "effort", "side"),
                fix='use kind = "motor_torque" or "motor_current" with side = "motor"',
            )

    def effort_units(self) -> tuple[tuple[str, ...], Array]:
        """Base unit of each effort column, and base units per logged unit."""
        effort, key = self.section.effort, ("effort", "unit")
        units, where = self.each(effort.unit, "units", *key), self.locate("signals", *key)
        for unit, coordinate in zip(units, self.joints, strict=True):
            if effort.kind not in signals.MOTOR_KINDS and unit != coordinate.effort_unit:
                raise ModelError(
                    f"unit '{unit}' does not fit the joint torque of '{coordinate.name}', "
                    f"which is {coordinate.kind}",
                    where=where,
                    fix=f"use '{coordinate.effort_unit}' there, or kind = \"motor_current\" with "
                    "gains if the columns hold currents",
                )
            if effort.kind == "motor_torque" and unit in ("A", "mA"):
                raise ModelError(
                    f"unit '{unit}' is a current's, but the effort's kind is motor_torque",
                    where=where,
                    fix='use kind = "motor_current", or unit = "Nm"',
                )
        if effort.kind == "motor_current" and not {"A", "mA", "%"} & set(units):
            raise ModelError(
                "the effort's kind is motor_current, but no unit is a current's: "
                + ", ".join(units),
                where=where,
                fix='use unit = "A" or "mA" with gain in Nm per A, or kind = "motor_torque"',
            )
        bases = [signals.EFFORT_UNITS[unit] for unit in units]
        return tuple(base for base, _ in bases), frozen([size for _, size in bases])

    def gains(self, columns: Sequence[str], units: Sequence[str]) -> tuple[Array, tuple[bool, ...]]:
        """Joint effort per base unit, 1 where it is to be identified; and where it is."""
        given, key, joints = self.section.effort.gain, ("effort", "gain"), self.joints
        where = self.locate("signals", *key)
        if given is None:
            for unit, column, coordinate in zip(units, columns, joints, strict=True):
                if unit in signals.WITHOUT_TORQUE:
                    raise ModelError(
                        f"column '{column}' holds {signals.WITHOUT_TORQUE[unit]}, but joint "
                        f"'{coordinate.name}' has no drive gain",
                        where=where,
                        fix=f"give gain = [...] in {coordinate.effort_unit}/{unit} per joint, or "
                        'gain = "identify" with a known payload, in a robot file: steelyard init '
                        "MODEL LOG writes one with the ways to obtain gains",
                    )
            return np.ones(len(joints)), (False,) * len(joints)
        values = self.each(given, "gains", *key)
        unknown = tuple(gain == "identify" for gain in values)
        gains = np.array([1.0 if gain == "identify" else float(gain) for gain in values])
        if not np.all(gains):
            name = joints[int(np.argmin(np.abs(gains)))].name
            raise ModelError(
                f"the gain of joint '{name}' is zero",
                where=where,
                fix="give the torque at the joint per logged unit; its sign may be negative",
            )
        return gains, unknown
