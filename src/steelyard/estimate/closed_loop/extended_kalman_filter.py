r"""Extended Kalman filter over motion and parameters, with the noise of its signals [Gautier2001].

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

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import DataError
from steelyard.base.progress import Progress, report_progress
from steelyard.estimate.closed_loop.feedback_and_forward_dynamics import Integration
from steelyard.estimate.closed_loop.simulated_experiment import (
    Experiment,
    Measured,
    simulate_soundly,
)
from steelyard.estimate.closed_loop.simulating_estimators import FilteredRows, Simulating, Step

_ORDER = 4
_NORM = np.sqrt(70.0)  # fourth difference of white noise of size 1: root of 1 + 16 + 36 + 16 + 1
_GAUSSIAN = 1.482602218505602  # standard deviation over the median size of normal numbers


def white_noise(values: Array, differenced: int = 0) -> Array:
    """Standard deviation of the white noise on smooth uniform samples `(N, C)`, shape `(C,)`.

    Fourth differences hold next to nothing of what is smooth; their median size does not mind a few
    jumps. The values may be `differenced` so many times already.
    """
    differences = np.diff(values, n=_ORDER - differenced, axis=0)
    return np.asarray(_GAUSSIAN * np.median(np.abs(differences), axis=0) / _NORM)


def torque_noise(tau: Array, q: Array) -> Array:
    """Standard deviation of what torque sensors add, shape `(n,)`.

    A controller answers the noise of measured positions with real torques. What follows that noise,
    at the same sample or a neighbour, is therefore no noise of the torque. Torques and unfiltered
    positions are uniform samples of the same times, shape `(N, n)`.
    """
    noisy, answered = (np.diff(x, n=_ORDER, axis=0) for x in (tau, q))
    rest = noisy[1:-1].copy()
    for joint in range(tau.shape[1]):
        own = answered[:, joint]
        near = np.column_stack((own[:-2], own[1:-1], own[2:]))
        rest[:, joint] -= near @ np.linalg.lstsq(near, rest[:, joint], rcond=None)[0]
    return white_noise(rest, _ORDER)


_TURN, _SPEED, _SHARE = 1e-6, 1e-5, 1e-4  # changes of positions, speeds, and the rest over its size
_FAR = 0.5  # error of a predicted position at which the filter has diverged [rad; m]
_UNSURE = 0.1  # first uncertainty of velocities, over their size

_TICKS_PER_EVENT = 500


@dataclass(frozen=True, eq=False)
class Noise:
    """White noise of one run, as standard deviations per joint, shape `(n,)`."""

    position: Array  # [rad; m]
    torque: Array  # [Nm; N]
    size: Array  # root mean square of the torque

    @classmethod
    def of(cls, run: Measured) -> "Noise":
        """As the signals of a run show it."""
        size, torque = np.sqrt(np.mean(run.tau**2, axis=0)), torque_noise(run.tau, run.q)
        position = np.maximum(white_noise(run.q), _LEAST_POSITION_NOISE)
        return cls(position, np.maximum(torque, _LEAST_TORQUE_NOISE * size), size)

    def torque_variance(self, counts: Array) -> Array:
        """Variance of the torque at a sample that counts, or does not, shape `(n,)`."""
        return np.where(counts > 0.0, self.torque**2, self.size**2)


Belief = tuple[Array, Array]  # parameters `(p,)`, and their covariance `(p, p)`


class Steps:
    """Steps between samples and their derivatives at parameters `about`, all lanes at once."""

    def __init__(self, experiment: Experiment, noise: Noise, about: Array, scale: Array) -> None:
        """Begin, with the sizes of the parameters' changes, shape `(p,)`."""
        n, p = len(noise.torque), len(scale)
        self._changes = np.concatenate(
            (np.full(n, _TURN), np.full(n, _SPEED), _SHARE * noise.size, _SHARE * scale)
        )
        self._n, self._first = n, 3 * n + 1
        lanes = np.zeros((3 * n + p, self._first + p + 1))
        lanes[: 3 * n, 1 : self._first] = np.diag(self._changes[: 3 * n])
        lanes[3 * n :, self._first + 1 :] = np.diag(self._changes[3 * n :])
        self._q, self._dq, self._effort, values = np.split(lanes, (n, 2 * n, 3 * n))
        self._quiet = np.arange(lanes.shape[1]) >= self._first
        widths = experiment.start_values.widths
        self._moving = Integration(experiment.dynamics, values + about[:, None], widths)
        self.about = about

    def __call__(
        self, motion: Array, noisy: Array, quiet: Array, duration: float
    ) -> tuple[Array, Array, float]:
        """One step of a duration [s] from positions and velocities `(2 n,)` to those after it.

        With their derivatives by those before, by the torques and by the parameters,
        `(2 n, 3 n + p)`, and the least pivot of the mass matrix. The measured torque `(n,)` is
        noisy; the derivatives by the parameters are taken under a quiet one, which the model makes.
        """
        n, first, moving = self._n, self._first, self._moving
        np.add(self._q, motion[:n, None], out=moving.q)
        np.add(self._dq, motion[n:, None], out=moving.dq)
        applied = np.where(self._quiet, quiet[:, None], noisy[:, None])
        np.add(self._effort, applied, out=moving.effort)
        moving.advance(duration)
        ends = np.concatenate((moving.q, moving.dq))
        by_state, by_value = ends[:, 1:first] - ends[:, :1], ends[:, first + 1 :] - ends[:, [first]]
        slopes = np.concatenate((by_state, by_value), axis=1) / self._changes
        return ends[:, 0], slopes, float(moving.least[0])


class State:
    """Motion, noise of the last torque sample, and departure of the parameters, with covariance."""

    def __init__(self, run: Measured, noise: Noise, departure: Array, covariance: Array) -> None:
        n = len(noise.torque)
        self._n, self._noise = n, noise
        self.mean = np.concatenate((run.motion.q[0], run.motion.dq[0], np.zeros(n), departure))
        speeds = _UNSURE * np.sqrt(np.mean(run.motion.dq**2, axis=0))
        torque, nothing = noise.torque_variance(run.counts[0]), np.zeros(len(departure))
        self.spread = np.diag(np.concatenate((noise.position**2, speeds**2, torque, nothing)))
        self.spread[3 * n :, 3 * n :] = covariance

    def predict(self, ends: Array, slopes: Array, counts: Array) -> None:
        """Go one step on, under the mean of two torque samples; the noise of the second is new.

        Ends and slopes are those of a step; `counts` says whether that sample counts, `(n,)`.
        """
        n, spread = self._n, self.spread
        moving, noisy, fixed = slice(0, 2 * n), slice(2 * n, 3 * n), slice(3 * n, None)
        transition, variance = slopes.copy(), self._noise.torque_variance(counts)
        transition[:, noisy] *= -0.5
        half = transition[:, noisy]
        self.mean[moving] = ends + transition[:, 2 * n :] @ self.mean[2 * n :]
        self.mean[noisy] = 0.0
        moved, fresh = transition @ spread, half * variance
        spread[moving, moving] = moved @ transition.T + fresh @ half.T
        spread[moving, noisy], spread[noisy, moving] = fresh, fresh.T
        spread[noisy, noisy] = np.diag(variance)
        spread[noisy, fixed], spread[fixed, noisy] = 0.0, 0.0
        spread[moving, fixed], spread[fixed, moving] = moved[:, fixed], moved[:, fixed].T

    def correct(self, missed: Array) -> Array:
        """Take in measured less predicted positions `(n,)`; returns squares over the expected."""
        n, spread = self._n, self.spread
        expected = spread[:n, :n] + np.diag(self._noise.position**2)
        gain = np.linalg.solve(expected, spread[:n]).T
        self.mean += gain @ missed
        spread -= gain @ spread[:n]
        self.spread = 0.5 * (spread + spread.T)
        return np.asarray(missed**2 / np.diag(expected))


def filtered(
    run: Measured, noise: Noise, steps: Steps, quiet: Array, belief: Belief, progress: Progress
) -> tuple[Belief, Array]:
    """One pass over one run, with torques without noise, shape `(N, n)`.

    Returns what is known after it, and the mean square of the positions' errors over what was
    expected, shape `(n,)`; a `DataError` says that the filter diverges.
    """
    n, surprise = len(noise.torque), np.zeros(len(noise.torque))
    state = State(run, noise, belief[0] - steps.about, belief[1])
    for k in range(1, len(run.q)):
        if k % _TICKS_PER_EVENT == 0:
            report_progress(progress, f"filtering {run.name}", k / run.rate, len(run.q) / run.rate)
        noisy, calm = (0.5 * (x[k - 1] + x[k]) for x in (run.tau, quiet))
        ends, slopes, least = steps(state.mean[: 2 * n], noisy, calm, 1.0 / run.rate)
        state.predict(ends, slopes, run.counts[k])
        missed = run.q[k] - state.mean[:n]
        impossible = least <= 0.0
        if impossible or not np.abs(missed).max() < _FAR:
            off = f"it is more than {_FAR:g} rad (m) off"
            why = "its mass matrix is no longer positive definite" if impossible else off
            wrong = f"the Kalman filter diverged at {run.motion.t[k]:.2f} s: {why}"
            fix = "filter the motion more, or take another estimator"
            raise DataError(wrong, where=run.name, fix=fix)
        surprise += state.correct(missed)
    belief = steps.about + state.mean[3 * n :], state.spread[3 * n :, 3 * n :]
    return belief, surprise / (len(run.q) - 1)


_LEAST_POSITION_NOISE, _LEAST_TORQUE_NOISE = 1e-8, 1e-5  # [rad; m], over the size
_STEADY = 0.1  # change between passes over the standard deviations, root mean square, that is none
_CREDIBLE_ERROR_RATIO = 1.3  # mean square of a joint's errors, over the expected, that is believed


@dataclass(frozen=True)
class KalmanParameters(Simulating):
    """Parameters as states that do not change.

    The filter begins with `Experiment.start_values`, every parameter uncertain by that value at
    which it alone makes `uncertainty` of the torque, and goes through the runs again and again,
    each time from the last pass's values, until these settle. White noise of positions and torques
    is found from the signals. Where positions surprise the filter more than
    that noise allows, as those of a robot do that the model does not wholly describe, the noise of
    the joint's torque is raised and the pass repeated. Where a joint rests its friction is unknown,
    and its torque says nothing.
    """

    name: ClassVar[str] = "extended Kalman filter"
    quiet: ClassVar[float] = _STEADY
    exact: ClassVar[float] = 0.0
    rounds: int = 12
    uncertainty: float = 0.1  # share of the torque

    def steps(self, experiment: Experiment, torque: FilteredRows) -> Iterator[Step]:
        """Each passes over all runs."""
        noises = [Noise.of(run) for run in experiment.runs]
        information = experiment.information
        efforts = information.effort_squares()
        weights = 1.0 / np.maximum(efforts, max(1e-6 * float(efforts.max()), 1e-300))
        own = np.diag(information.normal(weights)[0])[experiment.kept]
        # at its size, each parameter alone makes all of the torque
        sizes = 1.0 / np.sqrt(np.maximum(own, 1e-300))
        values, scale = experiment.start_values.values, self.uncertainty * sizes
        raised = np.ones(len(noises[0].torque))
        for number in range(self.rounds):
            belief, surprises = (values, np.diag(scale**2)), []
            made = simulate_soundly(experiment, values, self.progress)
            for run, noise, quiet in zip(experiment.runs, noises, made, strict=True):
                steps, torques = Steps(experiment, noise, values, scale), quiet.tau[..., 0]
                belief, surprise = filtered(run, noise, steps, torques, belief, self.progress)
                surprises.append(surprise)
            (found, covariance), surprise = belief, np.mean(surprises, axis=0)
            if (surprise > _CREDIBLE_ERROR_RATIO).any():
                factor = np.maximum(surprise, 1.0)
                raised *= factor
                noises = [replace(noise, torque=noise.torque * factor) for noise in noises]
                continue
            change, values = found - values, found
            precision = np.linalg.inv(covariance / scale[:, None] / scale) / scale[:, None] / scale
            sigma = np.sqrt(np.mean([noise.torque**2 for noise in noises], axis=0))
            counts = np.sum([run.counts.sum(axis=0) for run in experiment.runs], axis=0)
            notes = [f"{number + 1} passes"]
            if raised.max() != 1.0:
                notes.append(
                    "the innovations exceeded their covariance: torque noise was raised up to "
                    f"{raised.max():.2g} times that of the sensors"
                )
            yield Step(values, change, precision, sigma, sigma, covariance, counts, tuple(notes))
