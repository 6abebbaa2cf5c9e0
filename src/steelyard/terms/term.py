"""What a cause of torque is: linear in named parameters, written over the state of the joints."""

from collections.abc import Callable, Iterable, Mapping
from typing import ClassVar, Protocol

from steelyard.errors import ModelError
from steelyard.kernel.dynamics import JointState, Scalar
from steelyard.parameters import Parameter
from steelyard.robot.robot import Coordinate, Robot

Columns = Mapping[tuple[int, int], Scalar]
"""`(effort row, parameter)` to the torque per unit of that parameter; absent entries are zero."""


class Term(Protocol):
    """A cause of torque.

    A term is a frozen dataclass. What the torque is linear in are its parameters; what it is not
    linear in are its fields.
    """

    law: ClassVar[str]
    """The term's name in files."""

    def parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        """Names, units and bounds, in the order of the columns."""
        ...

    def columns(self, robot: Robot, state: JointState) -> Columns:
        """Torque per unit of each parameter; a state of symbols or of arrays over samples."""
        ...


def acting_on(robot: Robot, joints: tuple[str, ...] | None) -> tuple[int, ...]:
    """Indices of the named joints; all of them for `None`.

    Raises:
        ModelError: The robot has no identified joint of that name.
    """
    if joints is None:
        return tuple(range(robot.n))
    for joint in joints:
        if joint not in robot.joint_names:
            raise ModelError(
                f"a term acts on joint '{joint}', which is not identified",
                where=f"robot '{robot.name}', list of terms",
                mend=f"use names of {', '.join(robot.joint_names)}",
            )
    return tuple(robot.joint_names.index(joint) for joint in joints)


def per_joint(
    robot: Robot,
    joints: tuple[str, ...] | None,
    law: str,
    unit: Callable[[Coordinate], str],
    lower: float = float("-inf"),
) -> tuple[Parameter, ...]:
    """One parameter for every joint the term acts on."""
    acted = (robot.coordinates[j] for j in acting_on(robot, joints))
    return tuple(Parameter(f"{law}.{c.name}", unit(c), lower=lower) for c in acted)


def diagonal(rows: Iterable[int], values: Callable[[int], Scalar]) -> Columns:
    """Parameter k acts on its own joint only."""
    return {(row, k): values(row) for k, row in enumerate(rows)}


def rate_unit(coordinate: Coordinate) -> str:
    """Unit of effort per velocity."""
    return "N s/m" if coordinate.kind == "prismatic" else "N m s/rad"


def effort_unit(coordinate: Coordinate) -> str:
    """Unit of effort."""
    return coordinate.effort_unit


def inertia_unit(coordinate: Coordinate) -> str:
    """Unit of effort per acceleration."""
    return "kg" if coordinate.kind == "prismatic" else "kg m²"
