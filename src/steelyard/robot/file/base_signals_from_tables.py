"""What a robot file declares of a floating base: columns of its motion, its sensor, contacts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from steelyard.base.arrays import Array, frozen
from steelyard.base.errors import ModelError, refuse_unknown
from steelyard.robot.file.signals import BaseSignals, Contact, Signals, Touch
from steelyard.robot.inertia_and_placement import Inertia, rpy_rotation
from steelyard.robot.robot import BASE_COORDINATES, Robot, robot_to_dict

if TYPE_CHECKING:
    from steelyard.robot.file.base_sections import BaseSection

Locate = Callable[..., str]

STANDARD_G = 9.80665  # m/s² in the unit `g`
PARTS = {
    "wxyz": ("w", "x", "y", "z"),
    "xyzw": ("x", "y", "z", "w"),
    "rpy_rad": ("roll", "pitch", "yaw"),
    "rpy_deg": ("roll", "pitch", "yaw"),
    "matrix": tuple(f"{row}{column}" for row in "123" for column in "123"),
}
"""What `{}` stands for in the columns of an orientation, by its kind."""


def build_base_signals(section: BaseSection, robot: Robot, locate: Locate) -> BaseSignals:
    """The signals of the base that a robot file declares."""
    where = locate("signals", "base")
    _check_given(section, where)
    columns = {
        name: _columns(given, parts, locate("signals", "base", name))
        for name, given, parts in (
            ("acceleration", section.acceleration, tuple("xyz")),
            ("position", section.position, tuple("xyz")),
            ("angular_velocity", section.angular_velocity, tuple("xyz")),
            ("orientation", section.orientation, PARTS[section.orientation_kind]),
        )
    }
    each = [_contact(section, k, robot, locate) for k in range(len(section.contacts))]
    contacts = tuple(one for one in each if isinstance(one, Contact))
    axes, place = _mounting(section, robot, locate)
    in_g = section.acceleration_unit == "g"
    tracked = section.position is not None
    return BaseSignals(
        translation=columns["position" if tracked else "acceleration"],
        tracked=tracked,
        scale=STANDARD_G if in_g and not tracked else 1.0,
        bias=tuple(section.acceleration_bias),
        angular_bias=tuple(section.angular_velocity_bias),
        angular_velocity=columns["angular_velocity"],
        angular_scale=np.pi / 180.0 if section.angular_velocity_unit == "deg/s" else 1.0,
        orientation=columns["orientation"],
        orientation_kind=section.orientation_kind,
        axes=tuple(axes.ravel().tolist()),
        place=tuple(place.tolist()),
        gravity=tuple(robot.gravity.tolist()),
        delay=section.delay,
        wrench_known=section.wrench == "none",
        contacts=contacts,
        tree=_without_inertias(robot) if each else {},
        touches=tuple(one for one in each if isinstance(one, Touch)),
    )


def _check_given(section: BaseSection, where: str) -> None:
    """What is given determines the motion of the base once."""
    wrong = fix = ""
    if (section.acceleration is None) == (section.position is None):
        wrong = "the base has an acceleration or a position, one of them"
        fix = 'give acceleration = "acc_{}" of an accelerometer, or position = "p_{}"'
    elif section.position is not None and section.orientation is None:
        wrong = "the base has a position, but no orientation"
        fix = "give orientation = [...] of the same marker body"
    elif section.position is not None and section.angular_velocity is not None:
        wrong = "the base has a position and an angular velocity"
        fix = "leave the angular velocity out: it is that of the orientation"
    elif section.acceleration is None and any(section.acceleration_bias):
        wrong = "acceleration_bias is given, but no acceleration"
        fix = "remove acceleration_bias: it is that of an accelerometer"
    elif section.angular_velocity is None and any(section.angular_velocity_bias):
        wrong = "angular_velocity_bias is given, but no angular velocity"
        fix = "remove angular_velocity_bias: it is that of a gyroscope"
    elif section.angular_velocity is None and section.orientation is None:
        wrong = "the base has neither an angular velocity nor an orientation"
        fix = 'give angular_velocity = "gyro_{}" of a gyroscope, or orientation = [...]'
    elif section.frame is not None and section.mounting is not None:
        wrong = "the sensor of the base has a frame and a mounting"
        fix = "keep one of them"
    elif section.orientation is None and any(c.radius > 0.0 for c in section.contacts):
        wrong = "a contact has a radius, but the base has no orientation, which says what is below"
        fix = "add orientation = [...], or leave radius out and give the position that touches"
    elif section.orientation is None and any(c.axes == "world" for c in section.contacts):
        wrong = "a contact is given along the axes of the world, but the base has no orientation"
        fix = 'add orientation = [...], or give the contact along the axes of its frame: "frame"'
    if wrong:
        raise ModelError(wrong, where=where, fix=fix)


def _columns(given: Any, parts: tuple[str, ...], where: str) -> tuple[str, ...]:
    """A column for each part, of a list or a pattern; none if nothing is given."""
    if given is None:
        return ()
    found = tuple(given.replace("{}", p) for p in parts) if isinstance(given, str) else given
    if len(set(found)) != len(parts):
        raise ModelError(
            f"{len(set(found))} columns are given for {', '.join(parts)}",
            where=where,
            fix=f"list {len(parts)} columns, or give one name with {{}} for {', '.join(parts)}",
        )
    return tuple(found)


def _contact(section: BaseSection, number: int, robot: Robot, locate: Locate) -> Contact | Touch:
    given, key = section.contacts[number], ("signals", "base", "contacts", number)
    names = [frame.name for frame in robot.frames]
    wrong = f"the robot has no link '{given.frame}'"
    refuse_unknown(given.frame, names, wrong, locate(*key, "frame"), "links")
    measured = [name for name in _OF_WRENCH if name in given.model_fields_set]
    flagged = [name for name in _OF_TOUCH if name in given.model_fields_set]
    if (given.force is None) == (given.touching is None) or (measured and flagged):
        both = f", with {measured[0]} and {flagged[0]}" if measured and flagged else ""
        raise ModelError(
            f"the contact at '{given.frame}' has a force or a flag, one of them{both}",
            where=locate(*key),
            fix='give force = "..." (and moment, axes) where it is measured, or touching = "..." '
            f"(and {', '.join(_OF_TOUCH[1:])}) where only contact is known",
        )
    if given.touching is not None:
        if given.sole and given.radius > 0.0:
            raise ModelError(
                f"the contact at '{given.frame}' is a sole and a ball",
                where=locate(*key),
                fix="give sole = true, or radius, not both",
            )
        place = tuple(given.position)
        of_point = (given.sole, place, given.radius, given.margin)
        return Touch(given.frame, given.touching, given.threshold, *of_point)
    columns = [_columns(getattr(given, x), tuple("xyz"), locate(*key, x)) for x in _WRENCH]
    return Contact(given.frame, (*columns[0], *columns[1]), given.axes == "world")


_WRENCH = ("force", "moment")
_OF_WRENCH = (*_WRENCH, "axes")
_OF_TOUCH = ("touching", "threshold", "sole", "position", "radius", "margin")


def _mounting(section: BaseSection, robot: Robot, locate: Locate) -> tuple[Array, Array]:
    """Axes `(3, 3)` and place `(3,)` of the sensor in the base link's frame."""
    if section.mounting is not None:
        m = section.mounting
        return rpy_rotation(*np.deg2rad([m.roll, m.pitch, m.yaw])), np.array(m.position)
    frames = {frame.name: frame for frame in robot.frames if frame.body == 0}
    name = robot.bodies[0].name if section.frame is None else section.frame
    wrong = f"link '{name}' is not fixed to the base"
    refuse_unknown(name, frames, wrong, locate("signals", "base", "frame"), "links of the base")
    return frames[name].rotation, frames[name].position


def _without_inertias(robot: Robot) -> dict[str, Any]:
    """What Jacobians of frames depend on."""
    bodies = tuple(replace(b, inertia=Inertia.zero(), known=False) for b in robot.bodies)
    return robot_to_dict(robot.changed(bodies=bodies, transmission=None))


def with_base(signals: Signals, base: BaseSignals, locate: Locate) -> Signals:
    """Signals of all coordinates of a floating robot, of those of its joints.

    The positions of the base are what its motion is made of: proper acceleration or place, then
    angular velocity or roll, pitch and yaw. It has no motors.
    """
    if signals.commanded_position is not None:
        raise ModelError(
            "commanded positions are given, and the base floats",
            where=locate("signals"),
            fix="remove target, commanded_position and commanded_velocity: nobody commands a base",
        )
    if (base.contacts or base.touches) and any(signals.unknown_gains):
        raise ModelError(
            "gains are to be identified beside contacts",
            where=locate("signals", "effort", "gain"),
            fix="give the gains: contacts push base and joints, whose efforts must have one scale, "
            "in N and Nm",
        )
    names, n = tuple(c.name for c in BASE_COORDINATES), len(BASE_COORDINATES)
    ones, none, known = np.ones(n), np.zeros(n), (False,) * n
    maps: dict[str, Any] = {
        key: frozen(np.block([[np.eye(n), np.zeros((n, signals.n))],
                              [np.zeros((signals.n, n)), given]]))
        for key in ("position_map", "effort_map")
        if (given := getattr(signals, key)) is not None
    }  # fmt: skip
    offset = signals.position_offset
    found = replace(
        signals,
        position=(*names, *signals.position),
        position_scale=frozen([*ones, *signals.position_scale]),
        velocity=None,
        velocity_scale=None,
        velocity_delay=0.0,
        effort=(*(f"effort of {name}" for name in names), *signals.effort),
        effort_scale=frozen([*ones, *signals.effort_scale]),
        effort_units=(*(c.effort_unit for c in BASE_COORDINATES), *signals.effort_units),
        gains=frozen([*ones, *signals.gains]),
        unknown_gains=_beside(known, signals.unknown_gains),
        position_offset=None if offset is None else frozen([*none, *offset]),
        unknown_offsets=_beside(known, signals.unknown_offsets),
        unactuated=(*range(n), *(n + j for j in signals.unactuated)),
        base=base,
        **maps,
    )
    used = found.columns
    if twice := [name for name in used if used.count(name) > 1]:
        raise ModelError(
            f"column '{twice[0]}' is used twice",
            where=locate("signals", "base"),
            fix="give every signal a column of its own",
        )
    return found


def _beside(base: tuple[bool, ...], joints: tuple[bool, ...]) -> tuple[bool, ...]:
    """Marks of all coordinates; none where the joints have none."""
    return (*base, *joints) if joints else ()
