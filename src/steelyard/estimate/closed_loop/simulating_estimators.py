r"""Estimators that simulate the robot: instrumental variables, DIDIM, closed-loop output error.

Each simulates the model in the closed loop of the measured motion, moves the values by what the
torques say, and simulates anew until they settle.

Least squares is biased where the regressor $W$ holds noise. Instruments $Z$, the regressor along
the motion that the model makes in the same closed loop, hold none of it, and
$\phi = (Z^T \Omega W)^{-1} Z^T \Omega \tau$ is unbiased [Janot2014].

DIDIM, direct and inverse dynamic identification models, uses torques alone [Gautier2013]: the loop
makes the simulated motion follow the real one whatever the values, so
$\partial \tau / \partial \phi$ is about the regressor $W$ along the simulated motion, which holds
no noise. Every round moves the values by $(W^T \Omega W)^{-1} W^T \Omega (\tau - \tau_s)$. Measured
positions are used to begin with only.

Closed-loop output error finds the values whose simulation shows the measured torques [Landau2001]:
it minimises $\sum_r \|\tau_r - \tau_{s,r}(\phi)\|^2 / \sigma_r^2$ behind the parallel filter by
Levenberg and Marquardt's method [Marquardt1963], with one simulation for every parameter that is
moved a little, all side by side.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from steelyard.base.arrays import Array, Parameters, frozen
from steelyard.base.errors import DataError
from steelyard.base.progress import Progress, silent
from steelyard.estimate.closed_loop.simulated_experiment import (
    Experiment,
    Simulated,
    simulate,
    simulate_soundly,
)
from steelyard.estimate.estimate import Estimate
from steelyard.estimate.information.filter_and_gram import MOVING, ParallelFilter

_STEP = 1e-4  # change of the torque, over the torque, by which a parameter is moved

_LEAST_DAMPING, _MOST_DAMPING = 1e-9, 1e6

QUIET = 0.03  # change of the values over their standard deviations, root mean square, that is none
EXACT = 1e-7  # change of the torque, over the torque, that is none


@dataclass(frozen=True, eq=False)
class Step:
    """One round of an estimator that simulates."""

    values: Array  # where it leads, `(p,)`
    change: Array  # change of the values that the data ask for, `(p,)`
    precision: Array  # inverse covariance of the values, `(p, p)`
    sigma: Array  # deviations of the torques that the round counted with, `(n,)`
    deviations: Array  # those of the residuals, which exact data make zero, `(n,)`
    covariance: Array | None = None  # where it is not the inverse of the precision
    counts: Array | None = None  # samples of each torque where they are not the filtered ones
    notes: tuple[str, ...] = ()  # how many rounds there were, if empty


@dataclass(frozen=True)
class Simulating(ABC):
    """Rounds of simulations until one asks for a change of the values that says nothing."""

    name: ClassVar[str]
    counted: ClassVar[str] = "simulations"
    quiet: ClassVar[float] = QUIET
    exact: ClassVar[float] = EXACT
    rounds: int = 15
    progress: Progress = silent

    @abstractmethod
    def steps(self, experiment: Experiment, torque: "FilteredRows") -> Iterator[Step]:
        """At most so many rounds."""

    def __call__(self, experiment: Experiment) -> Estimate:
        """Estimate all columns that the filtered motion shows."""
        torque = FilteredRows.of(experiment, [run.tau.T for run in experiment.runs])
        for number, step in enumerate(self.steps(experiment, torque)):
            notes = step.notes or (f"{number + 1} {self.counted}",)
            size = float(step.change @ step.precision @ step.change)
            quiet, exact = self.quiet**2 * len(step.change), self.exact**2
            if size <= quiet or size <= exact * _cost(torque, step.sigma):
                break
        else:
            wrong = f"{self.name} did not converge within {self.rounds} rounds"
            fix = "filter the motion more, or log one that excites the joints more"
            raise DataError(wrong, where=experiment.where, fix=fix)
        start, covariance = experiment.start, step.covariance
        if covariance is None:
            covariance = np.asarray(np.linalg.inv(step.precision))
        if not (np.isfinite(step.values).all() and np.isfinite(covariance).all()):
            wrong = f"{self.name} ended with values that are not finite"
            fix = "log a motion that excites the joints more"
            raise DataError(wrong, where=experiment.where, fix=fix)
        return replace(
            start,
            estimator=self.name,
            parameters=Parameters(start.parameters.names, start.parameters.units, step.values),
            covariance=frozen((covariance + covariance.T) / 2.0),
            sigma=frozen(step.deviations),
            n_samples=frozen(torque.counts if step.counts is None else step.counts),
            notes=(*experiment.notes, *experiment.start_values.notes, *notes),
        )


@dataclass(frozen=True)
class InstrumentalVariables(Simulating):
    """Instruments from the simulated closed loop."""

    name: ClassVar[str] = "instrumental variables"
    rounds: int = 12

    def steps(self, experiment: Experiment, torque: "FilteredRows") -> Iterator[Step]:
        """Each simulates once."""
        motions = [(r.motion.q, r.motion.dq, r.motion.ddq) for r in experiment.runs]
        seen, values = _regressor(experiment, motions), experiment.start_values.values
        for _ in range(self.rounds):
            simulated = simulate_soundly(experiment, values, self.progress)
            instruments = _regressor(experiment, [found.motion for found in simulated])
            sigma = _floored(_left(torque, seen, values).deviations(len(values)), torque)
            cross = normal(instruments, seen, sigma)
            found = np.linalg.solve(cross, normal(instruments, torque, sigma))
            inverse = np.linalg.inv(cross)
            covariance = inverse @ normal(instruments, instruments, sigma) @ inverse.T
            change, values = np.asarray(found - values), np.asarray(found)
            deviations = _left(torque, seen, values).deviations(len(values))
            yield Step(values, change, np.linalg.inv(covariance), sigma, deviations, covariance)


@dataclass(frozen=True)
class Didim(Simulating):
    """Simulated against measured torques."""

    name: ClassVar[str] = "DIDIM"

    def steps(self, experiment: Experiment, torque: "FilteredRows") -> Iterator[Step]:
        """Each simulates once."""
        values = experiment.start_values.values
        for _ in range(self.rounds):
            simulated = simulate_soundly(experiment, values, self.progress)
            columns = _regressor(experiment, [found.motion for found in simulated])
            step, _ = _gauss_newton(values, columns, _residual(experiment, simulated), torque)
            values = values + step.change
            yield replace(step, values=values)


@dataclass(frozen=True)
class ClosedLoopOutputError(Simulating):
    """Simulated against measured torques, with true sensitivities."""

    name: ClassVar[str] = "closed-loop output error"
    counted: ClassVar[str] = "rounds"

    def steps(self, experiment: Experiment, torque: "FilteredRows") -> Iterator[Step]:
        """Each takes one simulation per parameter."""
        values, damping = experiment.start_values.values, 1e-3
        for _ in range(self.rounds):
            residual, columns = self._linearised(experiment, values)
            step, side = _gauss_newton(values, columns, residual, torque)
            yield step
            cost = _cost(residual, step.sigma)
            while damping < _MOST_DAMPING:
                scaled = step.precision + damping * np.diag(np.diag(step.precision))
                moved = values + np.linalg.solve(scaled, side)
                simulated = simulate(experiment, moved, self.progress)
                sound = all(found.sound[0] for found in simulated)
                if sound and _cost(_residual(experiment, simulated), step.sigma) < cost:
                    break
                damping *= 10.0
            else:
                return
            values, damping = moved, max(damping / 10.0, _LEAST_DAMPING)

    def _linearised(
        self, experiment: Experiment, values: Array
    ) -> "tuple[FilteredRows, FilteredRows]":
        """Residuals, and the simulated torques' derivatives by the parameters."""
        matrix, _, square = experiment.information.normal(np.ones(len(experiment.start.sigma)))
        own = np.diag(matrix)[experiment.kept]
        steps = np.asarray(_STEP * np.sqrt(square / np.maximum(own, 1e-300)))
        lanes = np.concatenate((np.zeros((len(values), 1)), np.diag(steps)), axis=1)
        simulated = simulate_soundly(experiment, values[:, None] + lanes, self.progress)
        slopes = [
            np.moveaxis((found.tau[..., 1:] - found.tau[..., :1]) / steps, 1, 0)
            for found in simulated
        ]
        return _residual(experiment, simulated), FilteredRows.of(experiment, slopes)


@dataclass(frozen=True, eq=False)
class FilteredRows:
    """Filtered samples of every effort row of all runs; those that do not count are zero."""

    values: Array  # `(n, K, ...)`: columns, or one torque
    counts: Array  # how many independent samples each row has, `(n,)`
    share: Array  # per filtered sample how many independent ones it stands for, `(K,)`

    @classmethod
    def of(cls, experiment: Experiment, values: Sequence[Array]) -> "FilteredRows":
        """All runs, one behind the other, from values `(n, N, ...)` per run."""
        found, counts, shares = [], [], []
        for run, of_run in zip(experiment.runs, values, strict=True):
            matched = run.matched
            kept = (filtered(run.counts_after_transient, matched) > MOVING).astype(np.float64)
            rows = np.stack([filtered(row, matched) for row in of_run])
            found.append(rows * kept.T.reshape(rows.shape[:2] + (1,) * (rows.ndim - 2)))
            counts.append(kept.sum(axis=0) / matched.inflation)
            shares.append(np.full(len(kept), 1.0 / matched.inflation))
        return cls(np.concatenate(found, axis=1), np.sum(counts, axis=0), np.concatenate(shares))

    def deviations(self, used: int) -> Array:
        """Deviation of each row's residuals, shape `(n,)`; the rows share `used` parameters."""
        squares = np.einsum("rk,k,rk->r", self.values, self.share, self.values)
        left = np.maximum(self.counts - used / len(self.counts), 1.0)
        return np.asarray(np.sqrt(squares / left))


def filtered(values: Array, matched: ParallelFilter) -> Array:
    """Samples `(N, ...)` through the parallel filter, shape `(K, ...)`."""
    from scipy.signal import upfirdn

    missing = -(len(matched.taps) - 1) % matched.decimation
    padded = np.concatenate((np.zeros((missing, *values.shape[1:])), values))
    first = (len(matched.taps) - 1 + missing) // matched.decimation
    count = max(0, (len(values) - len(matched.taps)) // matched.decimation + 1)
    return np.asarray(upfirdn(matched.taps, padded, 1, matched.decimation, 0)[first:][:count])


def normal(left: FilteredRows, right: FilteredRows, sigma: Array) -> Array:
    r"""$\sum_r Z_r^T W_r / \sigma_r^2$, every independent sample counted once."""
    total = 0.0
    for row, spread in enumerate(sigma):
        weighted = left.values[row] * left.share[:, None] / spread**2
        total = total + weighted.T @ right.values[row]
    return np.asarray(total)


def _regressor(
    experiment: Experiment, motions: Sequence[tuple[Array, Array, Array]]
) -> FilteredRows:
    """Columns that the data see, along motions of `(N, n)` samples."""
    dense, kept = experiment.regressor.dense, experiment.kept
    columns = [
        dense(*(np.ascontiguousarray(x.T) for x in motion))[:, :, kept] for motion in motions
    ]
    return FilteredRows.of(experiment, columns)


def _left(torque: FilteredRows, seen: FilteredRows, values: Array) -> FilteredRows:
    return replace(torque, values=torque.values - seen.values @ values)


def _residual(experiment: Experiment, simulated: Sequence[Simulated]) -> FilteredRows:
    """Measured minus simulated torques, those of the first lane."""
    pairs = zip(experiment.runs, simulated, strict=True)
    return FilteredRows.of(experiment, [(run.tau - found.tau[..., 0]).T for run, found in pairs])


def _gauss_newton(
    values: Array, columns: FilteredRows, residual: FilteredRows, torque: FilteredRows
) -> tuple[Step, Array]:
    """The step of least squares from `values`, which it keeps, and its right side, `(p,)`."""
    deviations = residual.deviations(len(values))
    sigma = _floored(deviations, torque)
    matrix, side = normal(columns, columns, sigma), normal(columns, residual, sigma)
    return Step(values, np.asarray(np.linalg.solve(matrix, side)), matrix, sigma, deviations), side


def _floored(sigma: Array, torque: FilteredRows) -> Array:
    """Standard deviations that exact data do not make zero, shape `(n,)`."""
    size = np.sqrt(np.mean(np.square(torque.values), axis=1))
    return np.maximum(sigma, 1e-10 * max(float(size.max()), 1e-300))


def _cost(residual: FilteredRows, sigma: Array) -> float:
    return float(np.einsum("rk,k,r->", np.square(residual.values), residual.share, 1.0 / sigma**2))
