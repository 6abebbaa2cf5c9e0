"""What a joint controller is: gains and models as values, and a running loop with state."""

from dataclasses import dataclass
from typing import ClassVar, Protocol

from steelyard.arrays import Array, frozen
from steelyard.motion import Motion

BANDWIDTH = 20.0
"""Natural frequency of the error of a joint under default gains [Hz]."""


@dataclass(frozen=True, eq=False)
class ControlTask:
    """What a controller is to do, and what it knows of its robot without an identified model.

    Attributes:
        motion: Desired motion at every tick, `N` samples of `n` joints.
        compared: The same as late as measured values are: what the loop would see on the desired
            motion, so that delay alone is no error.
        tick: Time between two ticks [s].
        inertia: Mean inertia of each joint over its postures, shape `(n,)` [kg m²; kg]; gains
            are multiplied with it.
        fastest: Natural frequency up to which joint gains are stable [rad/s]: coupling of the
            joints, lag and delay of the drives are counted.
        limits: Largest torque of each joint, shape `(n,)` [Nm; N].
    """

    motion: Motion
    compared: Motion
    tick: float
    inertia: Array
    fastest: float
    limits: Array

    def __post_init__(self) -> None:
        shape = (self.motion.n_joints,)
        object.__setattr__(self, "inertia", frozen(self.inertia, shape))
        object.__setattr__(self, "limits", frozen(self.limits, shape))


class Loop(Protocol):
    """A controller at work; it may have state."""

    def torque(self, k: int, q: Array, dq: Array) -> Array:
        """Commanded joint torques at tick `k`, shape `(n,)` [Nm; N].

        Args:
            k: Number of the tick; ticks come one after another.
            q: Positions that the loop sees, shape `(n,)` [rad; m].
            dq: Velocities that it sees, likewise.
        """
        ...


class Control(Protocol):
    """A kind of controller with its gains.

    Attributes:
        kind: Its name in options.
        needs_model: Whether it computes with a model of the robot.
    """

    kind: ClassVar[str]
    needs_model: ClassVar[bool]

    def start(self, task: ControlTask) -> Loop:
        """A loop at its first tick."""
        ...
