"""Friction that grows with the load on the joint."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import isfinite
from typing import Any, ClassVar

import numpy as np
from typing_extensions import Self

from steelyard.base.arrays import Array
from steelyard.base.errors import advice
from steelyard.model.equations.closed_chains import completed, projected
from steelyard.model.equations.inverse_dynamics import JointState, Scalar, Scalars
from steelyard.model.laws.presliding import OneState
from steelyard.model.laws.rigid_body import RigidBody
from steelyard.model.terms.axes import Axes, unfit
from steelyard.model.terms.friction_memory import RigidTorque
from steelyard.model.terms.term import Dissipation
from steelyard.model.terms.terms_in_model_files import Place, left_out
from steelyard.robot.inertia_and_placement import INERTIAL_NAMES
from steelyard.robot.robot import Robot

PLAUSIBLE = 0.5
r"""Largest $\mu$ of robots' gears: an efficiency of 67 %, about that of strain wave gears in the
cold or at small torque; planetary and cycloidal gears have 80 to 95 %."""


@dataclass(frozen=True)
class LoadDependent(OneState):
    r"""Load-dependent friction, $f = \mu\,|\tau_\mathrm{rigid}|\,s$, without a unit.

    $\tau_\mathrm{rigid}$ is what the rigid bodies of a reference model load the coordinate with,
    $s$ the direction of motion as a Dahl state [Dahl1968]. The reference is frozen, so the torque
    stays linear in $\mu$; an outer loop may refit it.

    Attributes:
        length: Presliding length of the direction, one for all or one per coordinate [rad; m].
        reference: Ten numbers per body by name, `{"m.forearm": 3.2, ...}`, absent ones zero; the
            robot's nominal bodies if nothing is named.
    """

    law: ClassVar[str] = "load_dependent"
    dissipation: ClassVar[Dissipation] = "none"
    shown_by: ClassVar[str] = "motion in both directions under several loads of"
    in_model_files: ClassVar[Place] = left_out("friction that grows with load")
    unnamed: ClassVar[tuple[str, ...]] = ("per_run", "reference")
    units: ClassVar[Mapping[str, str]] = {"": "1"}
    needs_reference: ClassVar[bool] = True
    state_only_fields: ClassVar[tuple[str, ...]] = ("length", "reference")
    reference: tuple[tuple[str, float], ...] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "reference", _numbers(self.reference))

    def with_reference(self, values: Mapping[str, float]) -> Self:
        """The same law with another reference model; parameters of other laws do not matter."""
        bodies = {n: float(v) for n, v in values.items() if n.split(".")[0] in INERTIAL_NAMES}
        if not bodies:
            raise unfit(
                "the reference of load-dependent friction names no number of a body",
                'list "rigid_body" among the terms, or give standard parameters by name: '
                '{"m.forearm": 3.2, ...}',
            )
        return replace(self, reference=tuple(bodies.items()))

    def channels(
        self, robot: Robot, state: JointState, states: Scalars, torque: RigidTorque
    ) -> list[Scalar]:
        """Load times direction."""
        borne = _borne(robot, state, list(torque(self.reference_of(robot))))
        found = []
        for share, sense in zip(_shares(robot, self.axes(robot)), states, strict=True):
            load, *others = (float(c) * x for c, x in zip(share, borne, strict=True) if c)
            found.append(np.abs(sum(others, load)) * sense)
        return found

    def reference_of(self, robot: Robot) -> Array:
        """Ten numbers per body of the reference, shape `(10 n_bodies,)`."""
        if not self.reference:
            if not robot.nominal.any():
                raise unfit(
                    "load-dependent friction needs a reference model, but no body has a mass",
                    "give the robot's links masses, or the term a `reference` from an "
                    "earlier result",
                    robot,
                )
            return robot.nominal.ravel()
        names = [p.name for p in RigidBody().parameters(robot)]
        values = dict(self.reference)
        if strange := [name for name in values if name not in names]:
            raise unfit(
                f"the reference of load-dependent friction names '{strange[0]}'",
                advice(strange[0], names, "numbers of bodies"),
                robot,
            )
        return RigidBody.numbers_of(robot, values)


def _numbers(reference: Any) -> tuple[tuple[str, float], ...]:
    """Named finite numbers, from a table or named pairs."""
    try:
        values = tuple((str(name), float(x)) for name, x in dict(reference).items())
    except (TypeError, ValueError):
        values = None
    if values is None or not all(isfinite(x) for _, x in values):
        raise unfit(
            f"load-dependent friction has reference = {reference!r}",
            'give finite numbers of bodies by name: reference = {"m.forearm" = 3.2}',
        )
    return values


def _borne(robot: Robot, state: JointState, torque: list[Scalar]) -> list[Scalar]:
    """What the joints bear of the rigid bodies' torque; passive joints bear nothing."""
    if not robot.passive:
        return torque
    n = robot.n
    _, torque_map = completed(
        robot, JointState(state.q[:n], state.dq[:n], state.ddq[:n], state.q[n:])
    )
    rows = projected(robot, {(row, 0): x for row, x in enumerate(torque)}, torque_map)
    return [*(rows[row, 0] for row in range(n)), *(0.0 * x for x in torque[n:])]


def _shares(robot: Robot, axes: Axes) -> Array:
    r"""Loads along the axes per torque of the joints, shape `(axes, n_joints)`.

    A motor bears its row of $R^{-T}\tau$; another coordinate $c$ bears $c \cdot \tau / \|c\|^2$.
    """
    gears, rows = robot.transmission, []
    for axis in axes:
        row = np.array(axis.row)
        share = row / (row @ row)
        if gears is not None and axis.name in gears.motors:
            motor = gears.motors.index(axis.name)
            if np.array_equal(row[: robot.n], gears.matrix[motor]):
                share = np.zeros(robot.n_joints)
                share[: robot.n] = np.linalg.inv(gears.matrix)[:, motor]
        rows.append(share)
    return np.array(rows)
