r"""What noise of the motion does to the columns of samples, by differences over one deviation.

With $L_k$ the roots of the motion's covariance, $\Sigma = \sum_k L_k L_k^T$, and
$D_k = (A(x + L_k) - A(x - L_k)) / 2$, the torque's variance is $\sum_k (D_k \phi)^2$. Differences
over a whole deviation see friction change its sign, which a derivative does not.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array
from steelyard.regression.regressor import Regressor
from steelyard.regression.samples import Index, Samples

BLOCK = 256
"""Instants evaluated at once, each with every joint moved six ways."""


@dataclass(frozen=True, eq=False)
class Slopes:
    """Variance of the torque through noise of the motion.

    Attributes:
        variances: Per effort row, shape `(N_j,)`.
        bends: Half their change with the parameters, per effort row, shape `(N_j, k_j)`.
    """

    variances: tuple[Array, ...]
    bends: tuple[Array, ...]


def motion_roots(covariance: Array) -> Array:
    """Roots of each joint's covariance of `q, dq, ddq`, `(n, 3, 3)`: one in each last column."""
    scale = np.sqrt(np.maximum(np.diagonal(covariance, axis1=1, axis2=2), 1e-300))
    values, vectors = np.linalg.eigh(covariance / scale[:, :, None] / scale[:, None, :])
    return np.asarray(scale[:, :, None] * vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :])


def slopes(regressor: Regressor, samples: Samples, roots: Sequence[Array], values: Array) -> Slopes:
    """Variances at some parameters, rows in the regressor's own effort unit.

    What was computed along the motion, such as states of friction with memory, stays as it is.

    Args:
        regressor: Model and columns of the samples.
        samples: The samples.
        roots: Per source, see `motion_roots`.
        values: Values of all columns, shape `(p,)`.
    """
    variances = np.zeros((len(samples.rows), len(samples)))
    bends = [np.zeros((len(samples), row.shape[1] - 1)) for row in samples.rows]
    for number, root in enumerate(roots):
        mine = np.flatnonzero(samples.source == number)
        for first in range(0, len(mine), BLOCK):
            block = mine[first : first + BLOCK]
            changes = _changes(regressor, samples, block, root)
            layout = regressor.layout
            for row, (start, seen) in enumerate(zip(layout.starts, layout.sees, strict=True)):
                part = changes[start : start + len(seen)]
                torque = np.einsum("cdb,c->db", part, values[list(seen)])
                variances[row, block] = np.sum(np.square(torque), axis=0)
                bends[row][block] = np.einsum("cdb,db->bc", part, torque)
    return Slopes(
        tuple(v[at] for v, at in zip(variances, samples.at, strict=True)),
        tuple(bend[at] for bend, at in zip(bends, samples.at, strict=True)),
    )


def _changes(regressor: Regressor, samples: Samples, block: Index, root: Array) -> Array:
    """Columns over one deviation of each root, halved, shape `(width, 3 n, B)`."""
    n, count = len(root), len(block)
    moved = np.zeros((3, n, 3 * n, count))
    for joint in range(n):
        for k in range(3):
            moved[:, joint, 3 * joint + k] = root[joint, :, k, None]
    motion = np.stack([samples.q[block].T, samples.dq[block].T, samples.ddq[block].T])[:, :, None]
    both = np.stack([motion + moved, motion - moved], axis=2).reshape(3, n, -1)
    channels = np.tile(samples.channels[block].T, (1, 6 * n))
    result = regressor.code([*both, channels, np.zeros_like(both[0])])
    plus, minus = result.reshape(len(result), 2, 3 * n, count).swapaxes(0, 1)
    return np.asarray(0.5 * (plus - minus))
