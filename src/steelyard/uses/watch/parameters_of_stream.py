r"""A recursive estimate of what changed in the robot, from the stream itself: `watch --identify`.

Stretches of some seconds become sums of products, as logs do. Those in which something is carried,
and those that no change of these parameters explains, as with a contact, are left out: a friction
that grew may look like a contact, but is explained. Old stretches are forgotten,

$$ \Lambda \leftarrow e^{-\Delta t / T}\,\Lambda + \Lambda_\mathrm{new}, $$

and what is left gives relative changes of each joint's bodies, dry and viscous friction, and its
offset (see `changes_from_model`). Errors $\delta$ of the model's values, with covariance $C$, make
right-hand sides $K \delta$, with $K$ summed as $\Lambda$ is; intervals contain
$\Lambda^{-1} K C K^T \Lambda^{-1}$. A change is published where the motion has shown it; others
stay those of the model, and are named.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from steelyard.base.arrays import Z95, Array
from steelyard.base.errors import SteelyardError
from steelyard.estimate.changes_from_model import OF_JOINT, LocalParameters, NormalEquations
from steelyard.estimate.information.information import Information

STRETCH = 20.0  # of the stream that becomes one piece of information [s]
EVERY = 60.0  # time of used stretches between two publications [s]
SHOWN = 0.1
"""Standard deviation of a relative change, of an offset over the joint's friction, up to which the
motion has shown it."""
UNEXPLAINED = 4.0
"""Squared residual that a stretch's own changes leave, in variances of the model's logs, from which
on something else acts."""
QUANTITIES = ("bodies", "dry friction", "viscous friction", "offset")

Gather = Callable[[Array], Information]
"""What consecutive rows as logged say, with one window or more."""


@dataclass(frozen=True)
class ChangedParameter:
    """A change from the model that the motion has shown: relative, or in the unit given."""

    joint: str
    quantity: str
    value: float
    half_width: float
    unit: str  # `""` for a relative change


@dataclass(frozen=True)
class StreamParameters:
    """What the stream has shown up to a time [s]; `stays` names what it has not."""

    time: float
    seconds: float  # of stretches that count, old ones less
    shown: tuple[ChangedParameter, ...]
    stays: tuple[str, ...]


class ParameterStream:
    """Estimates changes from the model, sample by sample.

    Attributes:
        left_out: Number of stretches with a payload or a contact, or without motion.
        used: Number of those that count.
    """

    def __init__(self, local: LocalParameters, gather: Gather, forget: float) -> None:
        """Begin; what was is forgotten with the time constant `forget` [s]."""
        self.left_out = self.used = 0
        self._local, self._gather, self._forget = local, gather, forget
        self._rows: deque[Array] = deque()
        self._began, self._spoilt = np.nan, False
        self._known: NormalEquations | None = None
        self._of_model = np.zeros((local.size, len(local.layout.columns)))
        self._seconds = self._since = 0.0

    def spoil(self) -> None:
        """The present stretch does not count: something is carried, or was."""
        self._spoilt = True

    def step(self, t: float, row: Array) -> StreamParameters | None:
        """Take the next sample, a row as logged [s]; what is published with it."""
        if np.isnan(self._began):
            self._began = t
        self._rows.append(row)
        if t - self._began < STRETCH:
            return None
        rows, spoilt = np.array(self._rows), self._spoilt
        self._rows.clear()
        passed, self._began, self._spoilt = t - self._began, t, False
        if spoilt or not self._take(rows, passed):
            self.left_out += 1
            return None
        self.used += 1
        self._since += passed
        if self._since < EVERY:
            return None
        self._since = 0.0
        return self._published(t)

    def _take(self, rows: Array, passed: float) -> bool:
        try:
            information = self._gather(rows)
            new = self._local.equations(information)
        except SteelyardError:  # no motion, or too short for filters
            return False
        if self._local.unexplained(new) > UNEXPLAINED:
            return False
        kept = float(np.exp(-passed / self._forget))
        old = self._known
        self._known = new if old is None else old.times(kept) + new
        self._of_model = kept * self._of_model + self._local.of_model(information)
        self._seconds = kept * self._seconds + passed
        return True

    def _published(self, t: float) -> StreamParameters:
        known, local = self._known, self._local
        assert known is not None
        friction = local.friction([known])
        own = slice(0, OF_JOINT * len(local.joints))  # stretches with a payload are left out
        expected = local.expected(friction)[own]
        inverse = np.linalg.inv(known.matrix[own, own] + np.diag(expected**-2.0))
        values = inverse @ known.vector[own]
        left = max(float(known.residual.sum() - values @ known.vector[own]), 0.0)
        widened = max(1.0, left / max(float(known.counts.sum()), 1.0))
        by_model = inverse @ self._of_model[own]
        variance = np.einsum("ij,jk,ik->i", by_model, local.covariance, by_model)
        std = np.sqrt(widened * np.diag(inverse) + variance)
        shown, stays = list[ChangedParameter](), list[str]()
        for row, joint in enumerate(local.joints):
            for part, quantity in enumerate(QUANTITIES):
                k = OF_JOINT * row + part
                if not local.has(row, part):
                    continue
                if std[k] > SHOWN * expected[k]:
                    stays.append(f"{quantity} of {joint}")
                    continue
                unit = local.units[row] if quantity == "offset" else ""
                half = Z95 * float(std[k])
                shown.append(ChangedParameter(joint, quantity, float(values[k]), half, unit))
        return StreamParameters(t, self._seconds, tuple(shown), tuple(stays))
