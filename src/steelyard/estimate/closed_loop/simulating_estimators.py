r"""Estimators that simulate the robot: instrumental variables, DIDIM, closed-loop output error.

DIDIM: direct and inverse dynamic identification models, from torques alone [Gautier2013].
Closed-loop output error: the values whose simulation shows the measured torques [Landau2001].


Least squares is biased where the regressor $W$ holds noise. Instruments $Z$, the regressor along
the motion that the model makes in the same closed loop, hold none of it, and
$\phi = (Z^T \Omega W)^{-1} Z^T \Omega \tau$ is unbiased [Janot2014]. They are simulated anew with
each round's values until these settle.

The model is simulated in the same closed loop; the loop makes the simulated motion follow the real
one whatever the values, so $\partial \tau / \partial \phi$ is about the regressor $W$ along the
simulated motion, which holds no noise. Every round simulates anew and moves the values by
$(W^T \Omega W)^{-1} W^T \Omega (\tau - \tau_s)$, until they settle. Measured positions are used to
begin with only.

Minimises $\sum_r \|\tau_r - \tau_{s,r}(\phi)\|^2 / \sigma_r^2$ behind the parallel filter by
Levenberg and Marquardt's method [Marquardt1963]. The model is simulated in the same closed loop,
once for every parameter that is moved a little, all side by side.
"""

from dataclasses import dataclass

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.progress import Progress, silent
from steelyard.estimate.closed_loop.experiment import Experiment, Simulated, require_sound, simulate
from steelyard.estimate.closed_loop.filtered_regressor import (
    FilteredRows,
    as_column,
    converged,
    deviations,
    floored,
    normal,
    not_converged_error,
    regressors,
    result,
    rows_of,
    torques,
)
from steelyard.estimate.estimate import Estimate

INSTRUMENTAL_NAME = "instrumental variables"


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
                return result(
                    INSTRUMENTAL_NAME, experiment, values, covariance, sigma, torque.counts, notes
                )
        raise not_converged_error(INSTRUMENTAL_NAME, experiment, self.rounds)


def _instruments(experiment: Experiment, values: Array, progress: Progress) -> FilteredRows:
    simulated = simulate(experiment, values, progress)
    require_sound(experiment, simulated)
    return rows_of(experiment, regressors(experiment, [found.motion for found in simulated]))


def _sigma(torque: FilteredRows, seen: FilteredRows, values: Array) -> Array:
    return deviations(
        FilteredRows(torque.values - seen.values @ values, torque.counts, torque.share), len(values)
    )


DIDIM_NAME = "DIDIM"


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
            residual = rows_of(experiment, torque_errors(experiment, simulated))
            found = deviations(residual, len(values))
            sigma = floored(found, torque)
            matrix = normal(columns, columns, sigma)
            side = normal(columns, as_column(residual), sigma)[:, 0]
            change = np.asarray(np.linalg.solve(matrix, side))
            values = values + change
            if converged(change, matrix, torque, sigma):
                notes = (f"{number + 1} simulations",)
                covariance = np.asarray(np.linalg.inv(matrix))
                return result(
                    DIDIM_NAME, experiment, values, covariance, found, torque.counts, notes
                )
        raise not_converged_error(DIDIM_NAME, experiment, self.rounds)


def torque_errors(
    experiment: Experiment, simulated: tuple[Simulated, ...], lane: int = 0
) -> list[Array]:
    """Measured minus simulated torques of all runs, each `(n, N)`."""
    return [
        (run.tau - found.tau[..., lane]).T
        for run, found in zip(experiment.runs, simulated, strict=True)
    ]


def _columns(experiment: Experiment, simulated: tuple[Simulated, ...]) -> FilteredRows:
    return rows_of(experiment, regressors(experiment, [found.motion for found in simulated]))


OUTPUT_ERROR_NAME = "closed-loop output error"

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
                return result(
                    OUTPUT_ERROR_NAME, experiment, values, covariance, found, torque.counts, notes
                )
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
        raise not_converged_error(OUTPUT_ERROR_NAME, experiment, self.rounds)


def _linearised(
    experiment: Experiment, values: Array, progress: Progress
) -> tuple[FilteredRows, FilteredRows]:
    """Residuals, and the simulated torques' derivatives by the parameters."""
    steps = _steps(experiment)
    lanes = np.concatenate((np.zeros((len(values), 1)), np.diag(steps)), axis=1)
    simulated = simulate(experiment, values[:, None] + lanes, progress)
    require_sound(experiment, simulated)
    slopes = [
        np.moveaxis((found.tau[..., 1:] - found.tau[..., :1]) / steps, 1, 0) for found in simulated
    ]
    return rows_of(experiment, torque_errors(experiment, simulated)), rows_of(experiment, slopes)


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
    return _cost(rows_of(experiment, torque_errors(experiment, simulated)), sigma)


def _cost(residual: FilteredRows, sigma: Array) -> float:
    return float(np.einsum("rk,k,r->", np.square(residual.values), residual.share, 1.0 / sigma**2))
