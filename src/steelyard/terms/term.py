"""What a cause of torque is: linear in named parameters, written over the state of the joints."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol, runtime_checkable

from steelyard.arrays import Array
from steelyard.kernel.equations.dynamics import JointState, Scalar
from steelyard.parameters import Parameter
from steelyard.robot.robot import Robot

Columns = Mapping[tuple[int, int], Scalar]
"""`(joint, parameter)` to the torque per unit of that parameter; absent entries are zero."""


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
        """Torque per unit of each parameter; a state of symbols or of arrays over samples.

        The state and the rows are those of all joints, `robot.joints`.
        """
        ...


@dataclass(frozen=True, eq=False)
class Samples:
    """Consecutive samples of a motion, as a term with channels sees them.

    Attributes:
        q: All joints' positions, shape `(n_joints, N)`; likewise `dq` and `ddq`.
        rigid_torque: Torques of the rigid bodies, shape `(n_joints, N)`, for ten numbers per body,
            shape `(10 n_bodies,)`.
    """

    q: Array
    dq: Array
    ddq: Array
    rigid_torque: Callable[[Array], Array]


@runtime_checkable
class Remembering(Protocol):
    """A term whose columns need more than one sample's state: a scan along the motion.

    Its channels enter `columns` as `state.channels`.
    """

    aside: ClassVar[tuple[str, ...]]
    """Fields that act on the channels alone; the columns over the channels do not know them."""

    def n_channels(self, robot: Robot) -> int:
        """Number of channels."""
        ...

    def warm_up(self, robot: Robot) -> Array:
        """Travel of each joint after which the unknown start is forgotten, `(n_joints,)`."""
        ...

    def remember(self, robot: Robot, samples: Samples, memory: Any) -> tuple[Array, Any]:
        """Channels `(n_channels, N)` of consecutive samples, and the memory at their end.

        Args:
            robot: The robot.
            samples: The samples.
            memory: What the call before returned; `None` at the start of a motion.
        """
        ...


def channels_of(term: Term, robot: Robot) -> int:
    """Number of channels of any term."""
    return term.n_channels(robot) if isinstance(term, Remembering) else 0
