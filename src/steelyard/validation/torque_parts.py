r"""The predicted effort of every sample by its causes, and what the model does not explain.

With values, a model is $\tau = g(q) + C(q, \dot q)\dot q + M(q)\ddot q + \tau_f + \tau_o$: gravity,
Coriolis and centrifugal efforts, inertia of bodies and rotors, friction, and springs with offsets.
The torque is linear in the parameters, so that each part is the torque of the whole model with the
other parameters at zero.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from steelyard.arrays import Array
from steelyard.measurement.run import Block
from steelyard.model import ValuedModel
from steelyard.parameters import Parameters
from steelyard.regression.gather import Mask
from steelyard.terms.term import Term

PARTS = ("gravity", "coriolis", "inertia", "friction", "other")
"""Causes of effort, in the order of all arrays."""

MOST_KEPT = 5000
"""Samples of a run that are kept at most."""


@dataclass(frozen=True, eq=False)
class TorqueParts:
    """Motion, and efforts behind the score's low-pass, of evenly spaced samples of a run.

    Attributes:
        t: Time, shape `(N,)` [s].
        q: Positions, shape `(N, n)` [rad; m]; likewise `dq` [rad/s; m/s].
        dq: Velocities.
        moving: Whether each joint moves, shape `(N, n)`.
        measured: Measured effort, at the joints, shape `(N, n)` [Nm; N].
        parts: Predicted effort by cause, in the order of `PARTS`, shape `(5, N, n)` [Nm; N].
    """

    t: Array
    q: Array
    dq: Array
    moving: Mask
    measured: Array
    parts: Array

    @property
    def predicted(self) -> Array:
        """The whole predicted effort, shape `(N, n)` [Nm; N]."""
        return np.asarray(self.parts.sum(axis=0))

    @property
    def residual(self) -> Array:
        """Measured minus predicted effort, shape `(N, n)` [Nm; N]."""
        return self.measured - self.predicted

    @property
    def friction(self) -> Array:
        """Measured effort without all that is not friction in the model, `(N, n)` [Nm; N]."""
        return np.asarray(self.residual + self.parts[PARTS.index("friction")])


@dataclass(frozen=True, eq=False)
class TorqueSplit:
    """Parts of a model's efforts, sample by sample.

    Attributes:
        valued: The model with its values.
    """

    valued: ValuedModel

    def block(self, block: Block) -> Array:
        """Unfiltered parts of the efforts of samples with channels, shape `(5, n, B)` [Nm; N]."""
        still = np.zeros_like(block.dq)
        masses = self._masses
        gravity = masses.block(block.q, still, still, block.channels)
        bias = masses.block(block.q, block.dq, still, block.channels)
        rigid = masses.block(block.q, block.dq, block.ddq, block.channels)
        rest = (m.block(block.q, block.dq, block.ddq, block.channels) for m in self._others)
        return np.stack([gravity, bias - gravity, rigid - bias, *rest])

    @cached_property
    def _masses(self) -> ValuedModel:
        return only(self.valued, lambda term: term.cause == "inertia")

    @cached_property
    def _others(self) -> tuple[ValuedModel, ValuedModel]:
        """Friction, and all that is neither friction nor inertia."""
        return (
            only(self.valued, lambda term: term.cause == "friction"),
            only(self.valued, lambda term: term.cause not in ("inertia", "friction")),
        )


def only(valued: ValuedModel, chosen: Callable[[Term], bool]) -> ValuedModel:
    """The same model, and so the same machine code, with the values of some terms; others zero."""
    model = valued.model
    kept = [chosen(term) for term in model.terms for _ in term.parameters(model.robot)]
    values = np.where(kept, valued.values.values, 0.0)
    return ValuedModel(model, Parameters(model.names, model.units, values))
