"""Columns of the bodies of a robot along the motion of a reading."""

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import DataError
from steelyard.check.hypotheses.nuisance_fit_and_score import NUISANCES
from steelyard.check.hypotheses.readings_and_likelihood import Reading
from steelyard.check.signals.good_rows_and_derivatives import remembered
from steelyard.estimate.information.base_regressor import (
    Regressor,
    base_parameters,
    chosen_regressor,
)
from steelyard.model.compiled_evaluation import check_angles
from steelyard.model.model import Model, ValuedModel


def rows_of(reading: Reading) -> tuple[Array, Array, Array]:
    """Columns of bodies and nuisances `(n, N, k)`, efforts and where joints move `(n, N)`.

    NaN where the states are impossible.
    """
    knowledge, motion, (y, moving) = reading.knowledge, reading.motion(), reading.columns()
    try:
        check_angles(motion[0])
        bodies = knowledge.under_any(reading.gravity, dense_regressor, *motion)
    except (DataError, ValueError):  # the states are impossible
        bodies = np.full((10 * len(knowledge.robot.bodies), *moving.shape), np.nan)
    bodies = np.einsum("ij,kjb->kib", reading.into_logged(), bodies)
    joints, own = np.arange(len(moving)), np.zeros((*moving.shape, len(moving), NUISANCES))
    own[joints, :, joints] = y[:, :NUISANCES].swapaxes(1, 2)
    free = np.moveaxis(bodies, 0, -1) * moving[..., None]
    columns = np.concatenate((free, own.reshape(*moving.shape, -1)), axis=-1)
    return columns, reading.efforts() * moving, moving


def dense_regressor(valued: ValuedModel, q: Array, dq: Array, ddq: Array) -> Array:
    """Columns of the bodies of one model, shape `(10 bodies, n, N)`."""
    return np.moveaxis(_regressor(valued.model).dense(q, dq, ddq), -1, 0).copy()


@remembered
def _regressor(model: Model) -> Regressor:
    return chosen_regressor(model, base_parameters(model), range(10 * len(model.robot.bodies)))
