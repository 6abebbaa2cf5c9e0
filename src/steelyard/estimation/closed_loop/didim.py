r"""DIDIM: direct and inverse dynamic identification models, from torques alone [Gautier2013].

The model is simulated in the same closed loop; the loop makes the simulated motion follow the real
one whatever the values, so $\partial \tau / \partial \phi$ is about the regressor $W$ along the
simulated motion, which holds no noise. Every round simulates anew and moves the values by
$(W^T \Omega W)^{-1} W^T \Omega (\tau - \tau_s)$, until they settle. Measured positions are used to
begin with only.
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
from steelyard.estimation.closed_loop.experiment import Experiment
from steelyard.estimation.closed_loop.filtered_regressor import (
    Rows,
    as_column,
    deviations,
    normal,
    regressors,
    rows_of,
    torques,
)
from steelyard.estimation.closed_loop.simulation import Simulated, require_sound, simulate
from steelyard.estimation.estimate import Estimate
from steelyard.progress import Progress, silent

NAME = "DIDIM"


@dataclass(frozen=True)
class Didim:
    """Simulated against measured torques.

    Attributes:
        rounds: Most simulations.
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
        values = experiment.start_values.values
        for number in range(self.rounds):
            simulated = simulate(experiment, values, self.progress)
            require_sound(experiment, simulated)
            columns = _columns(experiment, simulated)
            residual = rows_of(experiment, missed(experiment, simulated))
            found = deviations(residual, len(values))
            sigma = floored(found, torque)
            matrix = normal(columns, columns, sigma)
            side = normal(columns, as_column(residual), sigma)[:, 0]
            change = np.asarray(np.linalg.solve(matrix, side))
            values = values + change
            if converged(change, matrix, torque, sigma):
                notes = (f"{number + 1} simulations",)
                covariance = np.asarray(np.linalg.inv(matrix))
                return result(NAME, experiment, values, covariance, found, torque.counts, notes)
        raise not_converged_error(NAME, experiment, self.rounds)


def missed(experiment: Experiment, simulated: tuple[Simulated, ...], lane: int = 0) -> list[Array]:
    """Measured minus simulated torques of all runs, each `(n, N)`."""
    return [
        (run.tau - found.tau[..., lane]).T
        for run, found in zip(experiment.runs, simulated, strict=True)
    ]


def _columns(experiment: Experiment, simulated: tuple[Simulated, ...]) -> Rows:
    return rows_of(experiment, regressors(experiment, [found.motion for found in simulated]))
