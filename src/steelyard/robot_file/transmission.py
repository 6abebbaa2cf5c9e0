"""The transmission that a robot file declares."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import ModelError
from steelyard.robot.robot import Transmission
from steelyard.suggest import advice

if TYPE_CHECKING:
    from steelyard.robot_file.sections import TransmissionSection

WORST = 1e8
"""Condition number, rows scaled, from which on a matrix counts as singular."""


def build_transmission(
    section: TransmissionSection, joints: Sequence[str], locate: Callable[..., str]
) -> Transmission:
    """The gears between motors and joints.

    Args:
        section: What the file says.
        joints: Names of the identified joints.
        locate: Places in the file, for messages.

    Raises:
        ModelError: Numbers or names do not fit, or the matrix cannot be inverted.
    """
    motors = section.motors or tuple(f"motor_{k + 1}" for k in range(len(joints)))
    if len(motors) != len(joints):
        raise ModelError(
            f"{len(motors)} motors are named for {len(joints)} joints",
            where=locate("robot", "transmission", "motors"),
            fix=f"name one motor per joint: {', '.join(joints)}",
        )
    for motor in motors:
        if motors.count(motor) > 1:
            raise ModelError(
                f"two motors are called '{motor}'",
                where=locate("robot", "transmission", "motors"),
                fix="give every motor a name of its own",
            )
        if motor in joints:
            raise ModelError(
                f"motor '{motor}' has the name of a joint",
                where=locate("robot", "transmission", "motors"),
                fix="give it another one, so that terms can say which of the two they mean",
            )
    matrix = _matrix(section, motors, joints, locate)
    lengths = np.linalg.norm(matrix, axis=1)
    scaled = matrix / np.where(lengths > 0.0, lengths, 1.0)[:, None]
    if not lengths.all() or np.linalg.cond(scaled) > WORST:
        raise ModelError(
            "the transmission cannot be inverted: " + _why(scaled, motors),
            where=locate("robot", "transmission"),
            fix="every motor must turn some joint, and no combination of joints may leave all "
            "motors at rest: check ratios, coupling and matrix",
        )
    return Transmission(motors, matrix)


def _matrix(
    section: TransmissionSection,
    motors: Sequence[str],
    joints: Sequence[str],
    locate: Callable[..., str],
) -> Array:
    if (section.ratios is None) == (section.matrix is None):
        raise ModelError(
            "a transmission has ratios or a matrix, one of them",
            where=locate("robot", "transmission"),
            fix="give ratios = [...] (and coupling = [...]), or matrix = [[...], ...]",
        )
    n = len(joints)
    if section.matrix is not None:
        if len(section.matrix) != n or any(len(row) != n for row in section.matrix):
            raise ModelError(
                f"the transmission matrix is not {n} x {n}",
                where=locate("robot", "transmission", "matrix"),
                fix="give one row per motor with one ratio per identified joint",
            )
        matrix = np.array(section.matrix, dtype=np.float64)
    else:
        ratios = section.ratios or ()
        if len(ratios) != n:
            raise ModelError(
                f"{len(ratios)} ratios are given for {n} joints",
                where=locate("robot", "transmission", "ratios"),
                fix="give one ratio per identified joint, in the joints' order",
            )
        matrix = np.diag(np.array(ratios, dtype=np.float64))
    for index, coupling in enumerate(section.coupling):
        where = locate("robot", "transmission", "coupling", index)
        for name, names, kind in (
            (coupling.motor, motors, "motors"),
            (coupling.joint, joints, "joints"),
        ):
            if name not in names:
                raise ModelError(
                    f"'{name}' is none of the robot's {kind}",
                    where=where,
                    fix=advice(name, list(names), kind),
                )
        matrix[motors.index(coupling.motor), joints.index(coupling.joint)] += coupling.ratio
    return matrix


def _why(scaled: Array, motors: Sequence[str]) -> str:
    """Which motors' rows are dependent, in words."""
    idle = [m for m, row in zip(motors, scaled, strict=True) if not row.any()]
    if idle:
        return f"'{idle[0]}' turns no joint"
    weights = np.abs(np.linalg.svd(scaled.T)[2][-1])
    together = [m for m, w in zip(motors, weights, strict=True) if w > 1e-6]
    return f"{', '.join(together)} turn with the same combinations of joints"
