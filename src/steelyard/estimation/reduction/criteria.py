"""Which parameter is worth least: it is removed next."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array
from steelyard.estimation.reduction.state import State


@dataclass(frozen=True)
class Criterion:
    """A measure of what a parameter is worth to a model.

    Attributes:
        name: Short name, as options know it.
        about: What it is, in a few words.
        worth: Worth of each parameter that is left, shape `(k,)`; the least one is removed.
    """

    name: str
    about: str
    worth: Callable[[State], Array]


def _contribution(state: State) -> Array:
    r"""$|p_j|\,\|w_j\|$ over their sum."""
    torque = np.abs(state.values) * state.full.norms[list(state.active)]
    return np.asarray(torque / max(float(torque.sum()), 1e-300))


CRITERIA: tuple[Criterion, ...] = (
    Criterion("loss", "rise of χ² by the removal, residuals correlated", lambda s: s.losses),
    Criterion("contribution", "relative torque contribution [Wang], eqs. 6 to 9", _contribution),
    Criterion(
        "mean_column",
        "mean absolute column of the regressor [Volkmann], eq. 10",
        lambda s: s.full.means[list(s.active)],
    ),
    Criterion(
        "deviation", "relative standard deviation, the largest first [Pham1991]", lambda s: s.ratios
    ),
)
"""All criteria, the default one first."""
