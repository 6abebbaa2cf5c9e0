r"""Predicted efforts by their causes: gravity, Coriolis, inertia, friction, springs with offsets.

With values, a model is $\tau = g(q) + C(q, \dot q)\dot q + M(q)\ddot q + \tau_f + \tau_o$: gravity,
Coriolis and centrifugal efforts, inertia of bodies and rotors, friction, and springs with offsets.
The torque is linear in the parameters, so that each part is the torque of the whole model with the
other parameters at zero.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from steelyard.base.arrays import Array, Parameters
from steelyard.estimate.information.gather import Mask
from steelyard.model.model import ValuedModel
from steelyard.model.terms.term import Term
from steelyard.runs.run import Block

PARTS = ("gravity", "coriolis", "inertia", "friction", "other")  # order of all arrays


@dataclass(frozen=True, eq=False)
class TorqueParts:
    """Motion, and efforts behind the score's low-pass, of evenly spaced samples of a run."""

    t: Array  # time, shape `(N,)` [s]
    q: Array  # positions, shape `(N, n)` [rad; m]; likewise `dq` [rad/s; m/s]
    dq: Array
    moving: Mask  # whether each joint moves, shape `(N, n)`
    measured: Array  # measured effort, at the joints, shape `(N, n)` [Nm; N]
    parts: Array  # predicted effort by cause, in the order of `PARTS`, shape `(5, N, n)` [Nm; N]

    @classmethod
    def joined(cls, runs: Sequence["TorqueParts"]) -> "TorqueParts":
        """The samples of several runs one after another."""
        signals = zip(*(vars(run).values() for run in runs), strict=True)
        return cls(*(np.concatenate(some, axis=max(-2, -some[0].ndim)) for some in signals))

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


class TorqueSplit:
    """Parts of a model's efforts, sample by sample."""

    def __init__(self, valued: ValuedModel) -> None:
        self._masses = only(valued, lambda term: term.cause == "inertia")
        self._friction = only(valued, lambda term: term.cause == "friction")
        self._others = only(valued, lambda term: term.cause not in ("inertia", "friction"))

    def block(self, block: Block) -> Array:
        """Unfiltered parts of the efforts of samples with channels, shape `(5, n, B)` [Nm; N]."""
        q, dq, ddq, still = block.q, block.dq, block.ddq, np.zeros_like(block.dq)
        gravity, bias, rigid = (
            self._masses.block(q, *motion, block.channels)
            for motion in ((still, still), (dq, still), (dq, ddq))
        )
        rest = (m.block(q, dq, ddq, block.channels) for m in (self._friction, self._others))
        return np.stack([gravity, bias - gravity, rigid - bias, *rest])


def only(valued: ValuedModel, chosen: Callable[[Term], bool]) -> ValuedModel:
    """The same model, and so the same machine code, with the values of some terms; others zero."""
    model = valued.model
    kept = [chosen(term) for term in model.terms for _ in term.parameters(model.robot)]
    values = np.where(kept, valued.values.values, 0.0)
    return ValuedModel(model, Parameters(model.names, model.units, values))
