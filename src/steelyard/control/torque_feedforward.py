"""Torque feedforward, added to any controller."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from steelyard.arrays import Array
from steelyard.control.feedforward import SMOOTHING, feedforward_torque
from steelyard.control.protocol import Control, ControlTask, Loop
from steelyard.model import ValuedModel


@dataclass(frozen=True, eq=False)
class TorqueFeedforward:
    """A controller, and torques of a model along the desired motion.

    Attributes:
        inner: The controller.
        model: Model with values.
        smoothing: Speed within which friction by the plain sign turns [rad/s; m/s].
    """

    kind: ClassVar[str] = "feedforward"
    needs_model: ClassVar[bool] = True
    inner: Control
    model: ValuedModel
    smoothing: float = SMOOTHING

    def start(self, task: ControlTask) -> "TorqueFeedforwardLoop":
        """A loop at its first tick."""
        torque = feedforward_torque(self.model, task.motion, self.smoothing)
        return TorqueFeedforwardLoop(self.inner.start(task), torque)


class TorqueFeedforwardLoop:
    """A controller at work, with the torques to be added, shape `(N, n)`."""

    def __init__(self, inner: Loop, torque: Array) -> None:
        self._inner, self._torque = inner, torque

    def torque(self, k: int, q: Array, dq: Array) -> Array:
        """Commanded joint torques at tick `k`, shape `(n,)`."""
        return np.asarray(self._inner.torque(k, q, dq) + self._torque[k])
