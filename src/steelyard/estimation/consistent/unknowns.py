r"""Standard parameters in the scale of their prior.

A body's pseudo-inertia is $J = L X L^T$ with $J_0 = L L^T$ that of its prior: the prior is
$X = 1$, and margins have no unit [Wensing2018]. A body's unknowns are the ten entries of the upper
triangle of $X$, column by column; every other parameter is counted in the standard deviation that
is known of it, else in the size that would make all of the effort, or, where the data do not see
it, in what is wide in its SI unit.
"""

from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array, frozen
from steelyard.estimation.knowledge import Knowledge
from steelyard.estimation.least_squares.whitened import Whitened
from steelyard.regression.base import BaseMap
from steelyard.robot.inertia import Inertia

ORDER = 4
"""Rows of a pseudo-inertia."""

ENTRIES = tuple((i, j) for j in range(ORDER) for i in range(j + 1))
"""Places of the upper triangle, column by column."""

WIDEST = 10.0
"""Standard deviation of a cause of torque that nothing is known of, in that of the whole effort."""

UNSEEN = 1e-9
"""Effort of a parameter, over that of the strongest, below which the data do not see it."""

UNKNOWN = 100.0
"""Standard deviation of a parameter that the data do not see, in its SI unit."""

STAND_IN = Inertia.about_com(1.0, np.zeros(3), 0.01 * np.eye(3))
"""Scale of a body without prior."""

BASIS = np.zeros((10, ORDER, ORDER))
for _k, (_i, _j) in enumerate(ENTRIES):
    BASIS[_k, _i, _j] = BASIS[_k, _j, _i] = 1.0
BASIS.flags.writeable = False

_TENS = np.array([Inertia.from_pseudo(e).ten for e in BASIS]).T
"""Ten numbers of a body per entry of its pseudo-inertia, shape `(10, 10)`."""


@dataclass(frozen=True, eq=False)
class Unknowns:
    r"""Standard parameters as unknowns of a program, $\phi = c + T u$.

    Attributes:
        names: Standard parameters, `p` of them.
        priors: Per body whether it has a prior; its unknowns are `u[10 k : 10 k + 10]`.
        terms: Indices in `names` of the other unknowns, which follow those of the bodies.
        scale: $T$, shape `(p, m)`.
        weak: Precision of each unknown that keeps what no data show near zero, shape `(m,)`.
        matrix: Whitened data over the unknowns, shape `(rank, m)`.
        vector: Shape `(rank,)`.
    """

    names: tuple[str, ...]
    priors: tuple[bool, ...]
    terms: tuple[int, ...]
    scale: Array
    weak: Array
    matrix: Array
    vector: Array

    @property
    def start(self) -> Array:
        """The prior: `X = 1`, no friction."""
        u = np.zeros(len(self.weak))
        u[: 10 * len(self.priors)] = np.tile([float(i == j) for i, j in ENTRIES], len(self.priors))
        return u

    def pseudo(self, u: Array) -> Array:
        """`X` of every body, shape `(bodies, 4, 4)`."""
        return np.tensordot(u[: 10 * len(self.priors)].reshape(-1, 10), BASIS, axes=1)

    def standard(self, u: Array) -> Array:
        """Standard parameters, shape `(p,)`; unseen ones of terms are zero but for constraints."""
        return np.asarray(self.scale @ u)

    def of_standard(self, standard: Array) -> Array:
        """The unknowns of standard parameters, shape `(m,)`; the reverse of `standard`."""
        return np.asarray(np.linalg.solve(self.scale, standard))

    def chi_squared(self, u: Array) -> float:
        """Rise of the weighted squares over those of weighted least squares."""
        residual = self.matrix @ u - self.vector
        return float(residual @ residual)


def unknowns(data: Whitened, base: BaseMap, knowledge: Knowledge) -> Unknowns:
    """The unknowns of a problem.

    Args:
        data: The whitened data.
        base: Lifts base parameters to standard ones.
        knowledge: Gives the priors.
    """
    count = len(knowledge.bodies)
    tens = [knowledge.tens(body) for body in range(count)]
    place = {name: k for k, name in enumerate(base.base_names)}
    lift = base.lift[[place[name] for name in data.names]]
    bodies = {k for ten in tens for k in ten}
    strength = np.linalg.norm(data.matrix @ lift, axis=0)
    terms = tuple(k for k in range(len(base.names)) if k not in bodies)
    scale = np.zeros((len(base.names), 10 * count + len(terms)))
    for body, ten in enumerate(tens):
        prior = knowledge.priors[body] or STAND_IN
        scale[ten, 10 * body : 10 * body + 10] = ten_map(prior)
    least = UNSEEN * float(strength.max(initial=0.0))
    strength = strength[list(terms)]
    sizes = np.divide(
        data.effort, strength, out=np.full(len(terms), UNKNOWN), where=strength > least
    )
    stated = np.array([knowledge.deviations.get(base.names[k], np.nan) for k in terms])
    sizes = np.where(np.isfinite(stated), stated, sizes)
    scale[list(terms), 10 * count + np.arange(len(terms))] = sizes
    matrix = data.matrix @ lift @ scale
    matrix[:, 10 * count + np.flatnonzero(strength <= least)] = 0.0
    weak = np.full(scale.shape[1], WIDEST**-2)
    weak[: 10 * count] = 0.0
    weak[10 * count + np.flatnonzero((strength <= least) | np.isfinite(stated))] = 1.0
    return Unknowns(
        base.names,
        tuple(prior is not None for prior in knowledge.priors),
        terms,
        frozen(scale),
        frozen(weak),
        frozen(matrix),
        data.vector,
    )


def ten_map(prior: Inertia) -> Array:
    """Ten numbers of a body per entry of its `X`, shape `(10, 10)`."""
    factor = np.linalg.cholesky(prior.pseudo)
    rows, columns = np.array(ENTRIES).T
    return np.asarray(_TENS @ (factor @ BASIS @ factor.T)[:, rows, columns].T)
