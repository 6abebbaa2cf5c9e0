r"""Mass and centre of mass of a whole robot with a floating base, with intervals.

At rest with the proper acceleration $a$ the wrench on the base is $(m a, m c \times a)$, with the
mass $m$ and the centre $c$: rows of the regressor there give $m$ and $m c$ of base parameters,
whose covariance gives the intervals, to first order.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from steelyard.base.arrays import Z95, Array
from steelyard.base.errors import ModelError
from steelyard.robot.robot import BASE_COORDINATES

if TYPE_CHECKING:
    from steelyard.estimate.identified_model import IdentifiedModel

BASE = len(BASE_COORDINATES)
FORCE_Z, MOMENT_X, MOMENT_Y = 2, 3, 4  # rows of the wrench on the base


@dataclass(frozen=True, eq=False)
class MassAndCentre:
    """Mass of a robot, and its centre along the axes of its base from the base frame's origin."""

    mass: float  # [kg]
    mass_half_width: float  # of its 95 % interval [kg]
    centre: Array  # shape of the positions, their last axis x, y, z [m]
    half_width: Array  # of its 95 % intervals, likewise [m]


def mass_and_centre(identified: "IdentifiedModel", q: ArrayLike) -> MassAndCentre:
    """See `IdentifiedModel.mass_and_centre`."""
    robot = identified.robot
    base = identified.signals.base
    if not robot.floating or base is None or not base.wrench_known:
        raise ModelError(
            "the mass of the whole robot is not seen: "
            + ("the wrench on its base is unknown" if robot.floating else "its base is fixed"),
            where=f"robot '{robot.name}'",
            fix="it needs a floating base and known wrenches on it: fit logs in which all contacts "
            "are measured, or nothing touches the robot"
            if robot.floating
            else "links alone have masses: see the table of links, or the prior of the model file",
        )
    positions = np.asarray(q, dtype=np.float64)
    rows = np.atleast_2d(positions)
    if rows.shape[1] == robot.n - BASE:
        rows = np.hstack([np.zeros((len(rows), BASE)), rows])
    still = np.zeros_like(rows)
    along = np.array([still, still])
    along[0, :, FORCE_Z] = along[1, :, 0] = 1.0  # accelerated along z, and along x
    columns = list(identified.base.independent)
    z, x = (identified.regressor(rows, still, a)[:, :BASE][..., columns] for a in along)
    first = np.stack([-z[:, MOMENT_Y], z[:, MOMENT_X], x[:, MOMENT_Y]], axis=1)
    mass = z[:, FORCE_Z]
    values = identified.base.base_values(identified.valued.values.values)
    total = mass @ values
    centre = (first @ values) / total[:, None]
    slopes = (first - centre[..., None] * mass[:, None]) / total[:, None, None]
    covariance = identified.base_covariance

    def half(slope: Array) -> Array:
        variances = np.einsum("...b,bc,...c->...", slope, covariance, slope)
        return np.asarray(Z95 * np.sqrt(np.maximum(variances, 0.0)))

    shape = (*positions.shape[:-1], 3)
    return MassAndCentre(
        float(total[0]), float(half(mass[0])), centre.reshape(shape), half(slopes).reshape(shape)
    )
