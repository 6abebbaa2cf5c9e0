r"""Torques of a model along a desired motion.

Friction is that of the *desired* velocity. Laws that jump at zero velocity turn within a speed $w$,
$\tanh(\dot q_d / w)$ in the place of the sign [Volkmann], because a desired velocity is rarely
exactly zero at rest; laws with a smoothing of their own keep that.
"""

from dataclasses import dataclass
from functools import lru_cache

from steelyard.arrays import Array
from steelyard.dynamics.equations import Equations
from steelyard.dynamics.quantity import FRICTION, TORQUE, Quantity
from steelyard.kernel.program.program import Program
from steelyard.kernel.program.smoothing import softened
from steelyard.model import ValuedModel
from steelyard.motion import Motion

SMOOTHING = 1e-3
"""Speed within which friction by the plain sign turns [rad/s; m/s]."""


@dataclass(frozen=True, eq=False)
class SmoothedQuantity(Quantity):
    """A quantity whose jumps at zero velocity are spread.

    Attributes:
        width: Speed within which they turn [rad/s; m/s].
    """

    width: float = SMOOTHING

    def program(self, part: Equations) -> Program:
        """The program of the quantity, softened."""
        return softened(super().program(part), self.arguments.index("dq"), self.width)


@lru_cache(maxsize=64)
def smoothed(quantity: Quantity, width: float) -> Quantity:
    """A quantity with its jumps at zero velocity spread over a speed; zero leaves it as it is."""
    if width == 0.0:
        return quantity
    return SmoothedQuantity(
        f"{quantity.name}, smoothed",
        quantity.arguments,
        quantity.enters,
        quantity.build,
        quantity.shape,
        (*quantity.key, width),
        width=width,
    )


def feedforward_torque(valued: ValuedModel, motion: Motion, smoothing: float = SMOOTHING) -> Array:
    """Joint torques of a model along a desired motion.

    Args:
        valued: Model with values.
        motion: Desired motion, `N` samples of `n` joints; friction with memory begins at rest.
        smoothing: Speed within which laws that jump at zero velocity turn [rad/s; m/s]; zero for
            the plain sign.

    Returns:
        Shape `(N, n)` [Nm; N].
    """
    quantity = smoothed(TORQUE, smoothing)
    return valued.evaluate(quantity, motion.q, motion.dq, motion.ddq, t=motion.t)


def friction_torque(valued: ValuedModel, motion: Motion, smoothing: float = SMOOTHING) -> Array:
    """Torques of the friction laws along a desired motion, as `feedforward_torque`."""
    quantity = smoothed(FRICTION, smoothing)
    return valued.evaluate(quantity, motion.q, motion.dq, motion.ddq, t=motion.t)
