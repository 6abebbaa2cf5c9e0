"""Bases from the `[excitation.motion]` table; a new kind is a section there and a line here."""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from steelyard.base.arrays import Array, frozen
from steelyard.base.errors import DataError, advice
from steelyard.excite.trajectories.fourier_bases import (
    BlendedFourier,
    RampedFourier,
    RawFourier,
    RestFourier,
)
from steelyard.excite.trajectories.linear_bases import Basis, ReachingBasis, SplineBasis
from steelyard.robot.robot import Robot

_WHERE = "[excitation.motion]"


def posture_of(given: Any, robot: Robot, what: str) -> Array | None:
    """A posture from a list or a table by joint; joints that a table leaves out are at zero.

    Raises:
        DataError: It has too many or too few numbers, or names a joint that is not there.
    """
    if given is None:
        return None
    if isinstance(given, Mapping):
        for name in given:
            if name not in robot.joint_names:
                raise DataError(
                    f"'{what}' names a joint '{name}' that the robot does not have",
                    where=_WHERE,
                    fix=advice(name, robot.joint_names, "joints"),
                )
        return frozen([given.get(name, 0.0) for name in robot.joint_names])
    if len(given) != robot.n:
        raise DataError(
            f"'{what}' has {len(given)} numbers for {robot.n} joints",
            where=_WHERE,
            fix="give one number per joint: " + ", ".join(robot.joint_names),
        )
    return frozen(given)


def _fourier(s: Any, robot: Robot) -> Basis:
    start, end = (posture_of(getattr(s, key), robot, key) for key in ("start", "end"))
    return RestFourier(robot.n, s.period, s.harmonics, _with(start, end), end)


def _raw(s: Any, robot: Robot) -> Basis:
    return RawFourier(robot.n, s.period, s.harmonics)


def _blended(s: Any, robot: Robot) -> Basis:
    start = posture_of(s.start, robot, "start")
    return BlendedFourier(robot.n, s.period, s.harmonics, s.periods, s.blend, start)


def _ramped(s: Any, robot: Robot) -> Basis:
    start = posture_of(s.start, robot, "start")
    return RampedFourier(robot.n, s.period, s.harmonics, s.periods, s.ramp, start)


def _spline(s: Any, robot: Robot) -> Basis:
    start, end = (posture_of(getattr(s, key), robot, key) for key in ("start", "end"))
    return SplineBasis(robot.n, s.duration, s.points, s.degree, _with(start, end), end)


def _reaching(s: Any, robot: Robot) -> Basis:
    start = posture_of(s.start, robot, "start")
    return ReachingBasis(robot.n, s.targets, s.move, s.dwell, start)


def _with(start: Array | None, end: Array | None) -> Array | None:
    """The start, which an end needs.

    Raises:
        DataError: There is an end without it.
    """
    if end is not None and start is None:
        raise DataError(
            "an end posture is given, but no start posture",
            where=_WHERE,
            fix="give start = [...] too; without either, the motion ends where it starts",
        )
    return start


FAMILIES: Mapping[str, Callable[[Any, Robot], Basis]] = MappingProxyType(
    {
        "fourier": _fourier,
        "raw_fourier": _raw,
        "blended_fourier": _blended,
        "ramped_fourier": _ramped,
        "spline": _spline,
        "reaching": _reaching,
    }
)
"""Families that are searched; all other kinds of motion are planned, see `plans`."""


def basis_of(section: Any, robot: Robot) -> Basis:
    """The family of motions that a table describes.

    Raises:
        DataError: Its numbers do not fit each other or the robot.
    """
    try:
        return FAMILIES[section.kind](section, robot)
    except ValueError as error:
        raise DataError(str(error), where=_WHERE, fix="change that number") from error


def per_joint(given: Any, robot: Robot, what: str, default: Array) -> Array:
    """Numbers by joint, from one for all, a list, or a table that changes some of the defaults.

    Raises:
        DataError: A list has another length, or a table names a joint that is not there.
    """
    where = f"[excitation.limits] {what}"
    if given is None:
        return default
    if isinstance(given, float | int):
        return np.full(robot.n, float(given))
    if isinstance(given, Mapping):
        values = np.array(default)
        for name, value in given.items():
            if name not in robot.joint_names:
                raise DataError(
                    f"the robot has no joint '{name}'",
                    where=where,
                    fix=advice(name, robot.joint_names, "joints"),
                )
            values[robot.joint_names.index(name)] = value
        return values
    if len(given) != robot.n:
        raise DataError(
            f"{len(given)} numbers for {robot.n} joints",
            where=where,
            fix="give one number, one per joint, or a table by joint name",
        )
    return np.array(given, dtype=np.float64)
