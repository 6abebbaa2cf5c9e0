r"""Closed-loop output error: the values whose simulation shows the measured torques [Landau2001].

Minimises $\sum_r \|\tau_r - \tau_{s,r}(\phi)\|^2 / \sigma_r^2$ behind the parallel filter by
Levenberg and Marquardt's method [Marquardt1963]. The model is simulated in the same closed loop,
once for every parameter that is moved a little, all side by side.
"""

from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array
from steelyard.estimation.closed_loop.convergence import (
    converged,
    floored,
    not_converged_error,
    result,
)
from steelyard.estimation.closed_loop.didim import missed
from steelyard.estimation.closed_loop.experiment import Experiment
from steelyard.estimation.closed_loop.filtered_regressor import (
    Rows,
    as_column,
    deviations,
    normal,
    rows_of,
    torques,
)
from steelyard.estimation.closed_loop.simulation import require_sound, simulate
from steelyard.estimation.estimate import Estimate
from steelyard.progress import Progress, silent

NAME = "closed-loop output error"

_STEP = 1e-4
"""Change of the torque, over the torque, by which a parameter is moved."""

_LEAST_DAMPING, _MOST_DAMPING = 1e-9, 1e6


@dataclass(frozen=True)
class ClosedLoopOutputError:
    """Simulated against measured torques, with true sensitivities.

    Attributes:
        rounds: Most rounds, each with one simulation per parameter.
        progress: Told how far each is.
    """

    rounds: int = 15
    progress: Progress = silent

    def __call__(self, experiment: Experiment) -> Estimate:
        """Estimate all columns that the filtered motion shows.

        Raises:
            DataError: The model cannot be simulated, or the values do not settle.
        """
        torque = rows_of(experiment, torques(experiment))
        values, damping = experiment.start_values.values, 1e-3
        for number in range(self.rounds):
            residual, columns = _linearised(experiment, values, self.progress)
            found = deviations(residual, len(values))
            sigma = floored(found, torque)
            matrix = normal(columns, columns, sigma)
            side = normal(columns, as_column(residual), sigma)[:, 0]
            whole = np.asarray(np.linalg.solve(matrix, side))
            if converged(whole, matrix, torque, sigma):
                covariance, notes = np.asarray(np.linalg.inv(matrix)), (f"{number + 1} rounds",)
                return result(NAME, experiment, values, covariance, found, torque.counts, notes)
            cost = _cost(residual, sigma)
            while damping < _MOST_DAMPING:
                scaled = matrix + damping * np.diag(np.diag(matrix))
                moved = values + np.linalg.solve(scaled, side)
                if _cost_at(experiment, moved, sigma, self.progress) < cost:
                    break
                damping *= 10.0
            else:
                break
            values, damping = moved, max(damping / 10.0, _LEAST_DAMPING)
        raise not_converged_error(NAME, experiment, self.rounds)


def _linearised(experiment: Experiment, values: Array, progress: Progress) -> tuple[Rows, Rows]:
    """Residuals, and the simulated torques' derivatives by the parameters."""
    steps = _steps(experiment)
    lanes = np.concatenate((np.zeros((len(values), 1)), np.diag(steps)), axis=1)
    simulated = simulate(experiment, values[:, None] + lanes, progress)
    require_sound(experiment, simulated)
    slopes = [
        np.moveaxis((found.tau[..., 1:] - found.tau[..., :1]) / steps, 1, 0) for found in simulated
    ]
    return rows_of(experiment, missed(experiment, simulated)), rows_of(experiment, slopes)


def _steps(experiment: Experiment) -> Array:
    """How far each parameter is moved, shape `(p,)`."""
    matrix, _, square = experiment.information.normal(np.ones(len(experiment.start.sigma)))
    own = np.diag(matrix)[experiment.kept]
    return np.asarray(_STEP * np.sqrt(square / np.maximum(own, 1e-300)))


def _cost_at(experiment: Experiment, values: Array, sigma: Array, progress: Progress) -> float:
    """The sum of squares; infinite where the model cannot be simulated."""
    simulated = simulate(experiment, values, progress)
    if not all(found.sound[0] for found in simulated):
        return np.inf
    return _cost(rows_of(experiment, missed(experiment, simulated)), sigma)


def _cost(residual: Rows, sigma: Array) -> float:
    return float(np.einsum("rk,k,r->", np.square(residual.values), residual.share, 1.0 / sigma**2))
