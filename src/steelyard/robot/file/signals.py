"""Which columns of a log hold what, resolved to SI units and joint order."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from math import pi
from typing import TYPE_CHECKING, Any

import numpy as np

from steelyard.base.arrays import Array, frozen
from steelyard.base.errors import ModelError, refuse_unknown
from steelyard.robot.file.effort_units_and_gears import (
    Locate,
    check_count,
    check_sides,
    coupled_map,
    effort_units_of,
    gains_of,
    one_each,
)
from steelyard.robot.robot import Coordinate, Transmission

if TYPE_CHECKING:
    from steelyard.robot.file.sections import EffortKind, Side, SignalsSection

TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
POSITION_UNITS = {
    "revolute": {"rad": 1.0, "deg": pi / 180.0},
    "prismatic": {"m": 1.0, "mm": 1e-3},
}
VELOCITY_UNITS = {
    "revolute": {"rad/s": 1.0, "deg/s": pi / 180.0, "rpm": pi / 30.0},
    "prismatic": {"m/s": 1.0, "mm/s": 1e-3},
}

NOT_OF_SAMPLES = {
    "effort_kind",
    "effort_units",
    "gains",
    "unknown_gains",
    "unknown_offsets",
    "commanded_position",
    "commanded_velocity",
    "commanded_velocity_scale",
}
"""Fields of `Signals` that say nothing of how samples are read, but what they mean."""

ROW = "row number"
"""Column that a log without a clock is read with: the numbers of its rows, from zero."""


@dataclass(frozen=True, eq=False)
class Signals:
    """Columns of a log and how to read them; entries are in the order of the coordinates.

    Scales and offsets have the shape `(n,)`, in rad or m, rad/s or m/s, and base units `A`, `Nm`,
    `N` or `%` per logged unit, negative where a column counts the other way. `time` is `ROW` where
    a rate is declared instead, `time_scale` in seconds per unit.

    Velocities are `None` if positions are to be differentiated. `gains` are the joint torque [Nm; N
    on a prismatic joint] per base unit, 1 where it is to be identified; `position_offset` is where
    the log says zero [rad; m], 0 where that is to be identified. The maps `(n, n)` lead from logged
    positions and velocities, and from logged efforts, to the joints'; units and gains count behind
    that; `None` if they are the joints' already. Delays are against positions [s].

    Joints that are `unactuated`, by number, have no effort, and their columns are not read. Columns
    of the commanded motion are `None` if they are not known; the signals `of_commanded` only read
    them, positions with the scales of `position`.
    """

    time: str
    time_scale: float
    position: tuple[str, ...]
    position_scale: Array
    velocity: tuple[str, ...] | None
    velocity_scale: Array | None
    effort: tuple[str, ...]
    effort_scale: Array
    effort_kind: EffortKind
    effort_units: tuple[str, ...]
    gains: Array
    effort_side: Side = "joint"
    unknown_gains: tuple[bool, ...] = ()
    position_map: Array | None = None
    position_offset: Array | None = None
    effort_map: Array | None = None
    velocity_delay: float = 0.0
    effort_delay: float = 0.0
    unknown_offsets: tuple[bool, ...] = ()
    unactuated: tuple[int, ...] = ()
    commanded_position: tuple[str, ...] | None = None
    commanded_velocity: tuple[str, ...] | None = None
    commanded_velocity_scale: Array | None = None

    def of_commanded(self) -> Signals:
        """The same efforts beside the commanded motion instead of the measured one."""
        if self.commanded_position is None:
            raise ModelError(
                "the columns of the commanded motion are not known",
                where="[signals] of the robot file",
                fix='add commanded_position = "...", and commanded_velocity = "..." if it is '
                "logged; a model keeps those of the robot file that it was identified with",
            )
        return replace(
            self,
            position=self.commanded_position,
            velocity=self.commanded_velocity,
            velocity_scale=self.commanded_velocity_scale,
            velocity_delay=0.0,
        )

    @property
    def columns(self) -> tuple[str, ...]:
        """All columns that are read: no efforts of joints without a motor."""
        measured = [name for j, name in enumerate(self.effort) if j not in self.unactuated]
        return (self.time, *self.position, *(self.velocity or ()), *measured)

    def reads_alike(self, other: Signals) -> bool:
        """Whether both make the same samples of a log: gains and commanded columns do not count."""
        names = {field.name for field in fields(self)} - NOT_OF_SAMPLES
        return all(np.array_equal(getattr(self, name), getattr(other, name)) for name in names)

    @property
    def time_units(self) -> Mapping[str, float]:
        """Seconds per unit that time may be logged in; rows come at the rate that is declared."""
        return {"row": self.time_scale} if self.time == ROW else TIME_UNITS

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.position)

    def logged_efforts(self, torque: Array) -> Array:
        r"""Effort columns of joint torques, $y = S^{-1} E^{-1} \operatorname{diag}(k)^{-1} \tau$.

        Torques have the shape `(..., n)` [Nm; N]; columns the units, signs and side of `effort`.
        """
        base = torque / self.gains
        if self.effort_map is not None:
            base = base @ np.linalg.inv(self.effort_map).T
        return np.asarray(base / self.effort_scale)


def build_signals(
    section: SignalsSection,
    coordinates: Sequence[Coordinate],
    locate: Locate,
    gears: Transmission | None = None,
) -> Signals:
    """The signals a robot file declares, for the joints it identifies and gears, if it has any."""
    if not section.has_efforts:
        raise ModelError(
            "there are neither columns of efforts nor of position targets",
            where=locate("signals"),
            fix="add [signals.effort] columns = ..., kind = ..., unit = ...; or target = ..., if "
            "joints follow targets and their efforts are not logged",
        )
    check_sides(section, gears, locate)
    columns = {
        key: columns_of(given, coordinates, locate("signals", key))
        for key in (*_MEASURED, *_COMMANDED, "target")
        if (given := getattr(section, key)) is not None
    }
    _refuse_two_targets(columns, locate)
    columns |= {"commanded_position": columns.pop("target")} if "target" in columns else {}
    _refuse_half_motion(columns, section, locate)
    time, time_scale = clock_of_section(section, locate)
    unactuated = _unactuated(section, coordinates, locate)
    effort = _effort_columns(section, coordinates, unactuated, locate)
    measured = tuple(x for j, x in enumerate(effort) if j not in unactuated)
    clock, efforts = (("signals", "time"), (time,)), (("signals", "effort", "columns"), measured)
    for keys in (_MEASURED, _COMMANDED):
        moved = [(("signals", key), columns.get(key, ())) for key in keys]
        check_distinct([clock, *moved, efforts], locate)
    position_scale = position_scales(section, coordinates, locate)
    velocity_scale = _scales(section, "velocity", VELOCITY_UNITS, coordinates, locate)
    units, effort_scale = effort_units_of(section.effort, coordinates, locate)
    gains, unknown = gains_of(section.effort, effort, units, coordinates, locate)
    effort_map = position_map = None
    if gears is not None and section.coordinates == "motor":
        position_map = frozen(np.linalg.inv(gears.matrix))
    if gears is not None and section.effort.side == "motor":
        if gears.coupled:
            effort_map = coupled_map(gears, gains, unknown, locate)
            units = tuple(c.effort_unit for c in coordinates)
            gains = frozen(np.ones(len(coordinates)))
        else:
            gains = frozen(gains * np.diag(gears.matrix))
    position_offset, unknown_offsets = _position_offset(section, coordinates, locate)
    return Signals(
        time=time,
        time_scale=time_scale,
        position=columns["position"],
        position_scale=position_scale,
        velocity=columns.get("velocity"),
        velocity_scale=velocity_scale if "velocity" in columns else None,
        effort=effort,
        effort_scale=effort_scale,
        effort_kind=section.effort.kind,
        effort_units=units,
        gains=gains,
        effort_side=section.effort.side,
        unknown_gains=unknown,
        position_map=position_map,
        position_offset=position_offset,
        effort_map=effort_map,
        velocity_delay=section.velocity_delay,
        effort_delay=section.effort.delay,
        unknown_offsets=unknown_offsets,
        unactuated=unactuated,
        commanded_position=columns.get("commanded_position"),
        commanded_velocity=columns.get("commanded_velocity"),
        commanded_velocity_scale=velocity_scale if "commanded_velocity" in columns else None,
    )


def _unactuated(
    section: SignalsSection, coordinates: Sequence[Coordinate], locate: Locate
) -> tuple[int, ...]:
    """Numbers of the joints without a motor."""
    names = [c.name for c in coordinates]
    given, where = section.effort.unactuated, locate("signals", "effort", "unactuated")
    for name in given:
        wrong = f"'{name}' is none of the identified joints"
        refuse_unknown(name, names, wrong, where, "joints")
    if given and (len(given) == len(names) or section.effort.side == "motor"):
        raise ModelError(
            "no joint has a motor"
            if len(given) == len(names)
            else "efforts are those of motors, and a joint has none",
            where=where,
            fix='name the joints without a motor; efforts are those of joints (side = "joint")',
        )
    return tuple(j for j, name in enumerate(names) if name in given)


def _effort_columns(
    section: SignalsSection,
    coordinates: Sequence[Coordinate],
    unactuated: tuple[int, ...],
    locate: Locate,
) -> tuple[str, ...]:
    """A column per joint; where it has no motor, of any name."""
    given, where = section.effort.columns, locate("signals", "effort", "columns")
    some = [c for j, c in enumerate(coordinates) if j not in unactuated]
    few = unactuated and not isinstance(given, str) and len(given) == len(some)
    found = list(columns_of(given, some if few else coordinates, where))
    for j in unactuated if few else ():
        found.insert(j, f"effort of {coordinates[j].name}")
    return tuple(found)


_MEASURED, _COMMANDED = ("position", "velocity"), ("commanded_position", "commanded_velocity")


def _refuse_two_targets(columns: Mapping[str, Sequence[str]], locate: Locate) -> None:
    """Targets are the commanded positions."""
    if columns.keys() >= {"target", "commanded_position"}:
        raise ModelError(
            "target and commanded_position are both given",
            where=locate("signals", "target"),
            fix="keep one of them: both are the positions that the joints are to follow",
        )


def _refuse_half_motion(
    columns: Mapping[str, Sequence[str]], section: SignalsSection, locate: Locate
) -> None:
    """Commanded velocities go with positions, and what is said of velocities with columns."""
    if "commanded_velocity" in columns and "commanded_position" not in columns:
        raise ModelError(
            "commanded_velocity is given, but no commanded_position",
            where=locate("signals", "commanded_velocity"),
            fix="add commanded_position = ..., or remove commanded_velocity",
        )
    if columns.keys() & {"velocity", "commanded_velocity"}:
        return
    for key in ("velocity_unit", "velocity_sign", "velocity_delay"):
        if getattr(section, key):
            raise ModelError(
                f"{key} is given, but no velocity columns",
                where=locate("signals", key),
                fix=f"add velocity = ..., or remove {key}",
            )


def clock_of_section(section: SignalsSection, locate: Locate) -> tuple[str, float]:
    """Column of time, or of the rows' numbers if only a rate is given, and seconds per its unit."""
    if section.rate is None and section.time is not None:
        return section.time, TIME_UNITS[section.time_unit]
    if section.rate is not None and section.time is None:
        return ROW, 1.0 / section.rate
    both, none = "both a column of time and a rate", "neither a column of time nor a rate"
    raise ModelError(
        f"there is {both if section.rate else none}",
        where=locate("signals"),
        fix='set time = "..." for the log\'s clock, or rate = ... [Hz] if it has none',
    )


LEAST_DEGREES = 15.0  # offset from which on a multiple of five is taken for degrees


def looks_like_degrees(offset: float, coordinate: Coordinate) -> bool:
    """Whether a position offset in rad was most likely given in degrees."""
    return coordinate.kind == "revolute" and abs(offset) >= LEAST_DEGREES and offset % 5.0 == 0.0


def _position_offset(
    section: SignalsSection, coordinates: Sequence[Coordinate], locate: Locate
) -> tuple[Array | None, tuple[bool, ...]]:
    """Offsets, 0 where they are to be identified, and where they are; `None` if none is given."""
    given = section.position_offset
    if given is None:
        return None, ()
    offsets = one_each(given, "offsets", coordinates, locate("signals", "position_offset"))
    unknown = tuple(offset == "identify" for offset in offsets)
    for offset, coordinate in zip(offsets, coordinates, strict=True):
        if offset != "identify" and looks_like_degrees(offset, coordinate):
            raise ModelError(
                f"position_offset is in rad: {offset:g} of '{coordinate.name}' looks like degrees",
                where=locate("signals", "position_offset"),
                fix=f"write {np.deg2rad(offset):.6g}",
            )
    return frozen([0.0 if x == "identify" else float(x) for x in offsets]), unknown


def expanded(pattern: str, coordinates: Sequence[Coordinate]) -> tuple[str, ...]:
    """Columns of a pattern: `{}` stands for 1, 2, ..., `{joint}` for the joint's name."""
    return tuple(
        pattern.replace("{}", str(number)).replace("{joint}", coordinate.name)
        for number, coordinate in enumerate(coordinates, start=1)
    )


def position_scales(
    section: SignalsSection, coordinates: Sequence[Coordinate], locate: Locate
) -> Array:
    """Rad or m per logged unit of positions, with their signs `(n,)`."""
    return _scales(section, "position", POSITION_UNITS, coordinates, locate)


def columns_of(
    given: str | tuple[str, ...], coordinates: Sequence[Coordinate], where: str
) -> tuple[str, ...]:
    """A column for each joint, of a list or a pattern."""
    if isinstance(given, str):
        if "{}" not in given and "{joint}" not in given and len(coordinates) > 1:
            raise ModelError(
                f"'{given}' is one column, but {len(coordinates)} joints are identified",
                where=where,
                fix='list one column per joint, or give a pattern: "q{}" for q1, q2, ..., '
                'or "{joint}_position"',
            )
        given = expanded(given, coordinates)
    check_count(len(given), f"columns ({', '.join(given)})", coordinates, where)
    return given


def check_distinct(lists: Sequence[tuple[tuple[str, ...], Sequence[str]]], locate: Locate) -> None:
    """Refuse a column that two signals share; `lists` are keys with their columns."""
    known: dict[str, str] = {}
    for key, columns in lists:
        name = ".".join(key)
        for column in columns:
            if column in known:
                places = " and ".join(dict.fromkeys((known[column], name)))
                raise ModelError(
                    f"column '{column}' is used twice, in {places}",
                    where=locate(*key),
                    fix="give every signal a column of its own",
                )
            known[column] = name


def _scales(
    section: SignalsSection,
    quantity: str,
    units: Mapping[str, Mapping[str, float]],
    coordinates: Sequence[Coordinate],
    locate: Locate,
) -> Array:
    """SI per logged unit, negative where a column counts the other way.

    One unit for all means those joints that it can measure. A motor that turns may drive a
    prismatic joint.
    """
    given, signs = (getattr(section, f"{quantity}_{what}") for what in ("unit", "sign"))
    where = locate("signals", f"{quantity}_unit")
    if section.coordinates == "motor":
        units = dict.fromkeys(units, {u: x for some in units.values() for u, x in some.items()})
    if isinstance(given, tuple):
        check_count(len(given), "units", coordinates, where)
        wanted: list[str | None] = list(given)
    else:
        wanted = [given if given in units[c.kind] else None for c in coordinates]
        if given is not None and not any(wanted):
            wanted = [given] * len(coordinates)
    scales = np.ones(len(coordinates))
    for k, (coordinate, unit) in enumerate(zip(coordinates, wanted, strict=True)):
        fitting = units[coordinate.kind]
        if unit is not None and unit not in fitting:
            raise ModelError(
                f"unit '{unit}' does not fit joint '{coordinate.name}', which is {coordinate.kind}",
                where=where,
                fix=f"use one of {', '.join(fitting)}",
            )
        scales[k] = 1.0 if unit is None else fitting[unit]
    if signs is not None:
        check_count(len(signs), "signs", coordinates, locate("signals", f"{quantity}_sign"))
        scales *= signs
    return frozen(scales)


LATER_FIELDS = (
    *("commanded_position", "commanded_velocity", "commanded_velocity_scale"),
    *("unknown_offsets", "unactuated"),
)
"""Fields that files of earlier versions do not have."""


def signals_from_dict(data: Mapping[str, Any]) -> Signals:
    """The signals of `json_values`; `KeyError`, `ValueError` or `TypeError` if damaged."""
    n, values = len(data["position"]), dict(data)
    for field in fields(Signals):
        name, kind = field.name, str(field.type)
        given = values.get(name) if name in LATER_FIELDS else values[name]
        if given is None:
            continue
        if kind.startswith("tuple"):
            values[name] = tuple(given)
        elif kind.startswith("Array"):
            values[name] = frozen(given, (n, n) if name.endswith("map") else (n,))
            useless = ~np.isfinite(values[name]) | (values[name] == 0.0)
            if (name.endswith("scale") or name == "gains") and useless.any():
                raise ValueError(f"'{name}' of the signals holds a value that cannot be used")
    if len(values["effort"]) != n or len(values["effort_units"]) != n:
        raise ValueError("the signals' lists differ in length")
    return Signals(**values)
