"""What a cause of torque is: linear in named parameters, written over the state of the joints."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from typing_extensions import Self

from steelyard.arrays import Array
from steelyard.kernel.equations.dynamics import JointState, Scalar
from steelyard.parameters import Parameter
from steelyard.robot.robot import Robot
from steelyard.terms.axes import Axis
from steelyard.terms.model_files import Place

Columns = Mapping[tuple[int, int], Scalar]
"""`(joint, parameter)` to the torque per unit of that parameter; absent entries are zero."""

Dissipation = Literal["none", "each", "together"]
"""What a law knows of energy: nothing; that each of its coefficients takes some; or that it takes
some together with all others along the same coordinate, whatever the signs of its coefficients."""

Cause = Literal["inertia", "spring", "friction", "offset"]
"""What a law is about. Inertia and springs last; friction and offsets change from day to day."""

Role = Literal["body", "rotor", "brake", "effort"]
"""How a simulation has a law: as mass of the bodies, as inertia of a rotor, as friction that sticks
and slips, or as an effort that is computed from the state."""

SHARE = (0.1, 0.25)
"""Least and largest share of a joint's typical torque that an invented law takes."""


class Term(ABC):
    """A cause of torque, and all that is known of it: no other file lists laws.

    A term is a frozen dataclass. What the torque is linear in are its parameters; what it is not
    linear in are its fields. Parameters are named `law.coordinate`, or with more behind the law's
    name. What has no default here, the register requires of every law.
    """

    law: ClassVar[str]
    """The term's name in files."""
    dissipation: ClassVar[Dissipation]
    """How the consistent estimate bounds it."""
    cause: ClassVar[Cause]
    """What kind of thing it is."""
    shown_by: ClassVar[str]
    """The motion that shows its parameters, to be followed by names of joints."""
    in_model_files: ClassVar[Place]
    """What of it model files have a place for: one of the functions of `model_files`."""
    bounds: ClassVar[Mapping[str, tuple[float, float]]] = {}
    """Fields that can be found from data, all speeds or lengths, to their least and greatest."""
    symbol: ClassVar[str] = ""
    """Customary letters of the parameters named `law.coordinate`; empty where none are."""
    unnamed: ClassVar[tuple[str, ...]] = ("joints", "per_run")
    """Fields that are left out where a mix of laws is named for people."""
    shares: ClassVar[Mapping[str, tuple[float, float]]] = {}
    """Shares of `typical_values` of invented parameters, by their name up to the dot, if others
    than `SHARE`, of either sign where the parameter may have either."""
    needs_reference: ClassVar[bool] = False
    """Whether its columns need a reference model, see `with_reference`."""
    per_run: bool = False
    """Whether every run has parameters of its own."""

    @abstractmethod
    def parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        """Names, units and bounds, in the order of the columns."""

    @abstractmethod
    def columns(self, robot: Robot, state: JointState) -> Columns:
        """Torque per unit of each parameter; a state of symbols or of arrays over samples.

        The state and the rows are those of all joints, `robot.joints`.
        """

    @classmethod
    def drifts(cls) -> bool:
        """Whether its parameters change from day to day."""
        return cls.cause in ("friction", "offset")

    @property
    def role(self) -> Role:
        """How a simulation has it."""
        return "effort"

    @property
    def on_motors(self) -> bool:
        """Whether it acts before the gears, so that a sensor behind them does not feel it."""
        return False

    def with_reference(self, values: Mapping[str, float]) -> Self:
        """The same term with another reference model, the numbers of its bodies by name."""
        return self

    def typical_values(
        self, robot: Robot, at_torque: Array, inertia: Callable[[Axis], float]
    ) -> Array:
        """What invented parameters are measured by, shape `(parameters,)`.

        Args:
            robot: The robot.
            at_torque: Value at which each parameter alone loads a joint with its typical torque,
                shape `(parameters,)`.
            inertia: Typical inertia that a coordinate moves [kg m²; kg].
        """
        return at_torque


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


class StatefulTerm(Term):
    """A term whose columns need more than one sample's state: a scan along the motion.

    Its channels enter `columns` as `state.channels`. Friction with memory is a `Presliding`.
    """

    state_only_fields: ClassVar[tuple[str, ...]]
    """Fields that act on the channels alone; the columns over the channels do not know them."""

    @abstractmethod
    def n_channels(self, robot: Robot) -> int:
        """Number of channels."""

    @abstractmethod
    def warm_up(self, robot: Robot) -> Array:
        """Travel of each joint after which the unknown start is forgotten, `(n_joints,)`."""

    @abstractmethod
    def remember(self, robot: Robot, samples: Samples, memory: Any) -> tuple[Array, Any]:
        """Channels `(n_channels, N)` of consecutive samples, and the memory at their end.

        Args:
            robot: The robot.
            samples: The samples.
            memory: What the call before returned; `None` at the start of a motion.
        """


def channels_of(term: Term, robot: Robot) -> int:
    """Number of channels of any term."""
    return term.n_channels(robot) if isinstance(term, StatefulTerm) else 0
