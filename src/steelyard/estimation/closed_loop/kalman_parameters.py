r"""Extended Kalman filter over motion and parameters [Gautier2001].

The state is $(q, \dot q, w, \phi)$ with the noise $w$ of the last torque sample. Measured torques
drive the model, the mean of two samples from one to the next, and measured positions correct it;
neither are filtered. What a step does to the state, to the parameters and to a torque's noise is
found by moving each of them a little, all side by side: derivatives of the whole step, friction and
integration included.

Three things keep the values from being biased or impossible. A torque sample acts before and
after it: without $w$ in the state, its noise and the motion would be taken for independent.
Derivatives by the parameters are taken under the torque that the model makes in closed loop: under
the measured one their noise would be that of the step. And in each pass they are taken at the
parameters that it began with, whose departures then count linearly: a wild one at the start, where
the filter knows little, cannot leave the values that a mechanism can have. Passes are repeated
until that makes no difference; each is a Gauss-Newton step of maximum likelihood.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from steelyard.arrays import Array
from steelyard.estimation.closed_loop.convergence import not_converged_error, result
from steelyard.estimation.closed_loop.experiment import Experiment, Measured
from steelyard.estimation.closed_loop.kalman_pass import Belief, Noise, Steps, filtered
from steelyard.estimation.closed_loop.simulation import require_sound, simulate
from steelyard.estimation.estimate import Estimate
from steelyard.estimation.noise import torque_noise, white_noise
from steelyard.progress import Progress, silent

NAME = "extended Kalman filter"

_LEAST_POSITION_NOISE, _LEAST_TORQUE_NOISE = 1e-8, 1e-5
"""Least noise of positions [rad; m], and of torques over their size."""

_STEADY = 0.1
"""Change between passes over the standard deviations, root mean square, that is none."""

_WONDER = 1.3
"""Mean square of a joint's errors, over what was expected, that is still believed."""


@dataclass(frozen=True)
class KalmanParameters:
    """Parameters as states that do not change.

    The filter begins with `Experiment.start_values`, every parameter uncertain by that value at
    which it alone makes `uncertainty` of the torque, and goes through the runs again and again,
    each time from the last pass's values, until these settle. White noise of positions and torques
    is found from the signals, where it is not given. Where positions surprise the filter more than
    that noise allows, as those of a robot do that the model does not wholly describe, the noise of
    the joint's torque is raised and the pass repeated. Where a joint rests its friction is unknown,
    and its torque says nothing.

    Attributes:
        uncertainty: Share of the torque.
        passes: Most passes.
        position_noise: Standard deviation [rad; m].
        torque_noise: Standard deviation per joint [Nm; N].
        progress: Told how far each pass is.
    """

    uncertainty: float = 0.1
    passes: int = 12
    position_noise: float | None = None
    torque_noise: tuple[float, ...] | None = None
    progress: Progress = silent

    def __call__(self, experiment: Experiment) -> Estimate:
        """Estimate all columns that the filtered motion shows.

        Raises:
            DataError: The filter diverges, or the values do not settle.
        """
        noises = [self._noise(run) for run in experiment.runs]
        values, scale = experiment.start_values.values, self.uncertainty * _sizes(experiment)
        raised = np.ones(len(noises[0].torque))
        for number in range(self.passes):
            belief, wonder = self._passed(experiment, noises, values, scale)
            if (wonder > _WONDER).any():
                factor = np.maximum(wonder, 1.0)
                raised *= factor
                noises = [replace(noise, torque=noise.torque * factor) for noise in noises]
                continue
            change, values = (belief.values - values) / scale, belief.values
            unit = belief.covariance / scale[:, None] / scale
            if change @ np.linalg.solve(unit, change) <= _STEADY**2 * len(change):
                sigma = np.sqrt(np.mean([noise.torque**2 for noise in noises], axis=0))
                counts = np.sum([run.counts.sum(axis=0) for run in experiment.runs], axis=0)
                notes = (f"{number + 1} passes", *_noise_notes(raised))
                return result(NAME, experiment, values, belief.covariance, sigma, counts, notes)
        raise not_converged_error(NAME, experiment, self.passes)

    def _passed(
        self, experiment: Experiment, noises: Sequence[Noise], values: Array, scale: Array
    ) -> tuple[Belief, Array]:
        """One pass over all runs, and how surprising each joint's positions were, `(n,)`."""
        belief, wonders = Belief(values, np.diag(scale**2)), []
        made = simulate(experiment, values, self.progress)
        require_sound(experiment, made)
        for run, noise, quiet in zip(experiment.runs, noises, made, strict=True):
            steps = Steps(experiment, noise, values, scale)
            belief, wonder = filtered(run, noise, steps, quiet.tau[..., 0], belief, self.progress)
            wonders.append(wonder)
        return belief, np.asarray(np.mean(wonders, axis=0))

    def _noise(self, run: Measured) -> Noise:
        n, size = run.q.shape[1], np.sqrt(np.mean(run.tau**2, axis=0))
        position, torque = white_noise(run.q), torque_noise(run.tau, run.q)
        if self.position_noise is not None:
            position = np.full(n, self.position_noise)
        if self.torque_noise is not None:
            torque = np.array(self.torque_noise)
        return Noise(
            np.maximum(position, _LEAST_POSITION_NOISE),
            np.maximum(torque, _LEAST_TORQUE_NOISE * size),
            size,
        )


def _noise_notes(raised: Array) -> tuple[str, ...]:
    """Whether the torque's noise had to be raised."""
    if raised.max() == 1.0:
        return ()
    return (
        "the innovations exceeded their covariance: torque noise was raised up to "
        f"{raised.max():.2g} times that of the sensors",
    )


def _sizes(experiment: Experiment) -> Array:
    """Values at which each parameter alone makes all of the torque, shape `(p,)`."""
    efforts = experiment.information.effort_squares()
    weights = 1.0 / np.maximum(efforts, max(1e-6 * float(efforts.max()), 1e-300))
    own = np.diag(experiment.information.normal(weights)[0])[experiment.kept]
    return np.asarray(1.0 / np.sqrt(np.maximum(own, 1e-300)))
