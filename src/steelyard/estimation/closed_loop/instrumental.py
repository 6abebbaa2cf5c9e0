r"""Instrumental variables: what noise in the regressor cannot bias.

Least squares is biased where the regressor $W$ holds noise. Instruments $Z$, the regressor along
the motion that the model makes in the same closed loop, hold none of it, and
$\phi = (Z^T \Omega W)^{-1} Z^T \Omega \tau$ is unbiased [Janot2014]. They are simulated anew with
each round's values until these settle.
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
from steelyard.estimation.closed_loop.simulation import require_sound, simulate
from steelyard.estimation.estimate import Estimate
from steelyard.progress import Progress, silent

NAME = "instrumental variables"


@dataclass(frozen=True)
class InstrumentalVariables:
    """Instruments from the simulated closed loop.

    Attributes:
        rounds: Most simulations.
        progress: Told how far each is.
    """

    rounds: int = 12
    progress: Progress = silent

    def __call__(self, experiment: Experiment) -> Estimate:
        """Estimate all columns that the filtered motion shows.

        Raises:
            DataError: The model cannot be simulated, or the values do not settle.
        """
        motions = [(r.motion.q, r.motion.dq, r.motion.ddq) for r in experiment.runs]
        seen = rows_of(experiment, regressors(experiment, motions))
        torque = rows_of(experiment, torques(experiment))
        values = experiment.start_values.values
        for number in range(self.rounds):
            instruments = _instruments(experiment, values, self.progress)
            sigma = floored(_sigma(torque, seen, values), torque)
            cross = normal(instruments, seen, sigma)
            side = normal(instruments, as_column(torque), sigma)[:, 0]
            found = np.linalg.solve(cross, side)
            inverse = np.linalg.inv(cross)
            covariance = inverse @ normal(instruments, instruments, sigma) @ inverse.T
            change, values = np.asarray(found - values), np.asarray(found)
            if converged(change, np.linalg.inv(covariance), torque, sigma):
                sigma = _sigma(torque, seen, values)
                notes = (f"{number + 1} simulations",)
                return result(NAME, experiment, values, covariance, sigma, torque.counts, notes)
        raise not_converged_error(NAME, experiment, self.rounds)


def _instruments(experiment: Experiment, values: Array, progress: Progress) -> Rows:
    simulated = simulate(experiment, values, progress)
    require_sound(experiment, simulated)
    return rows_of(experiment, regressors(experiment, [found.motion for found in simulated]))


def _sigma(torque: Rows, seen: Rows, values: Array) -> Array:
    return deviations(
        Rows(torque.values - seen.values @ values, torque.counts, torque.share), len(values)
    )
