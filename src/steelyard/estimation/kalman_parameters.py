r"""Extended Kalman filter over motion and parameters [Gautier2001].

The state is $(q, \dot q, w, \phi)$ with the noise $w$ of the last torque sample; measured torques
drive the model, the mean of two samples from one to the next, measured positions correct it,
neither of them filtered. A sample's noise acts before and after it: without $w$ in the state,
motion and noise would be correlated and the values biased. What a step does to the state, to the parameters and to a torque's noise
is found by moving each of them a little, all side by side: derivatives of the whole step, friction
and integration included. In each pass the derivatives are taken at the parameters that it began
with, and the parameters' departures from them count linearly: a wild departure at the start, where
the filter knows little, then cannot leave the values that a mechanism can have. Passes are repeated
until that makes no difference, which makes each one a Gauss-Newton step of maximum likelihood.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import DataError
from steelyard.estimation.estimate import Estimate
from steelyard.estimation.experiment import Experiment, Measured
from steelyard.estimation.forward import Integration
from steelyard.estimation.noise import torque_noise, white_noise
from steelyard.estimation.settling import result, unsettled
from steelyard.estimation.simulation import require_sound, simulate
from steelyard.progress import Progress, silent, tell

NAME = "extended Kalman filter"

_TURN, _SPEED, _SHARE = 1e-6, 1e-5, 1e-4
"""Changes by which derivatives are found: of positions, velocities, and of the rest over their
size."""

_LEAST_POSITION_NOISE, _LEAST_TORQUE_NOISE = 1e-8, 1e-5
"""Least noise of positions [rad; m], and of torques over their size."""

_FAR = 0.5
"""Error of a predicted position at which the filter has diverged [rad; m]."""

_STEADY = 0.1
"""Change between passes over the standard deviations, root mean square, that is none."""

_WONDER = 1.3
"""Mean square of a joint's errors, over what was expected, that is still believed."""

_TICKS_PER_EVENT = 500


@dataclass(frozen=True)
class KalmanParameters:
    """Parameters as states that do not change.

    The filter begins with weighted least squares on the filtered motion (see `Experiment.begun`),
    every parameter uncertain by that value at which it alone makes `uncertainty` of the torque,
    and goes through the runs again and again, each time from the last pass's values, until these
    settle. White noise of positions and torques is found from the signals, where it is not given.
    Where positions surprise the filter more than that noise allows, as those of a robot do that the
    model does not wholly describe, the noise of the joint's torque is raised and the pass repeated.
    Where a joint rests its friction is unknown, and its torque says nothing.

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
        values, scale = experiment.begun.values, self.uncertainty * _sizes(experiment)
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
                notes = (f"{number + 1} passes", *_said(raised))
                return result(NAME, experiment, values, belief.covariance, sigma, counts, notes)
        raise unsettled(NAME, experiment, self.passes)

    def _passed(
        self, experiment: Experiment, noises: Sequence["_Noise"], values: Array, scale: Array
    ) -> tuple["_Belief", Array]:
        """One pass over all runs, and how surprising each joint's positions were, `(n,)`."""
        belief, wonders = _Belief(values, np.diag(scale**2)), []
        made = simulate(experiment, values, self.progress)
        require_sound(experiment, made)
        for run, noise, quiet in zip(experiment.runs, noises, made, strict=True):
            steps = _Steps(experiment, noise, values, scale)
            belief, wonder = _filtered(
                run, noise, steps, quiet.tau[..., 0], belief, self.progress
            )
            wonders.append(wonder)
        return belief, np.asarray(np.mean(wonders, axis=0))

    def _noise(self, run: Measured) -> "_Noise":
        n, size = run.q.shape[1], np.sqrt(np.mean(run.tau**2, axis=0))
        given = self.position_noise
        position = white_noise(run.q) if given is None else np.full(n, given)
        torque = self.torque_noise
        torque = torque_noise(run.tau, run.q) if torque is None else np.array(torque)
        return _Noise(
            np.maximum(position, _LEAST_POSITION_NOISE),
            np.maximum(torque, _LEAST_TORQUE_NOISE * size),
            size,
        )


def _said(raised: Array) -> tuple[str, ...]:
    """Whether the torque's noise had to be raised."""
    if raised.max() == 1.0:
        return ()
    return (
        f"the positions surprised the filter: it took torques for up to {raised.max():.2g} times "
        "noisier than their sensors",
    )


@dataclass(frozen=True, eq=False)
class _Noise:
    """Standard deviations per joint, and the size of its torque, each `(n,)`."""

    position: Array
    torque: Array
    size: Array

    def held(self, counts: Array) -> Array:
        """Variance of the torque at a sample that counts, or does not, shape `(n,)`."""
        return np.asarray(np.where(counts > 0.0, self.torque**2, self.size**2))


@dataclass(frozen=True, eq=False)
class _Belief:
    """Parameters and their covariance."""

    values: Array
    covariance: Array


def _sizes(experiment: Experiment) -> Array:
    """Values at which each parameter alone makes all of the torque, shape `(p,)`."""
    efforts = experiment.information.effort_squares()
    weights = 1.0 / np.maximum(efforts, 1e-300 + 1e-6 * efforts.max())
    own = np.diag(experiment.information.normal(weights)[0])[experiment.kept]
    return np.asarray(1.0 / np.sqrt(np.maximum(own, 1e-300)))


def _filtered(
    run: Measured,
    noise: _Noise,
    steps: "_Steps",
    quiet: Array,
    belief: _Belief,
    progress: Progress,
) -> tuple[_Belief, Array]:
    """One pass over one run, and the mean square of its errors over what it expected.

    `quiet` are torques without noise.
    """
    n, about = len(noise.torque), steps.about
    moving, noisy, fixed = slice(0, 2 * n), slice(2 * n, 3 * n), slice(3 * n, None)
    state = np.concatenate(
        (run.motion.q[0], run.motion.dq[0], np.zeros(n), belief.values - about)
    )
    speeds = np.sqrt(np.mean(run.motion.dq**2, axis=0))
    spread = np.zeros((len(state), len(state)))
    spread[moving, moving] = np.diag(np.concatenate((noise.position**2, (0.1 * speeds) ** 2)))
    spread[noisy, noisy] = np.diag(noise.held(run.counts[0]))
    spread[fixed, fixed] = belief.covariance
    measured, wonder = np.diag(noise.position**2), np.zeros(n)
    for k in range(1, len(run.q)):
        if k % _TICKS_PER_EVENT == 0:
            tell(progress, f"filtering {run.name}", k / run.rate, len(run.q) / run.rate)
        noisy_mean, mean = (0.5 * (x[k - 1] + x[k]) for x in (run.tau, quiet))
        ahead, by_motion, by_effort, by_value = steps(state[moving], noisy_mean, mean, run.rate)
        before, after = -0.5 * by_effort, -0.5 * by_effort * noise.held(run.counts[k])
        state[moving] = ahead + before @ state[noisy] + by_value @ state[fixed]
        state[noisy] = 0.0
        transition = np.concatenate((by_motion, before, by_value), axis=1)
        moved = transition @ spread
        spread[moving, moving] = moved @ transition.T - 0.5 * after @ by_effort.T
        spread[moving, noisy], spread[noisy, moving] = after, after.T
        spread[noisy, noisy] = np.diag(noise.held(run.counts[k]))
        spread[noisy, fixed], spread[fixed, noisy] = 0.0, 0.0
        spread[moving, fixed], spread[fixed, moving] = moved[:, fixed], moved[:, fixed].T
        missed = run.q[k] - state[:n]
        if steps.least <= 0.0 or not np.abs(missed).max() < _FAR:
            raise _diverged(run, k, steps.least)
        expected = spread[:n, :n] + measured
        wonder += missed**2 / np.diag(expected)
        gain = np.linalg.solve(expected, spread[:n]).T
        state += gain @ missed
        spread -= gain @ spread[:n]
        spread = 0.5 * (spread + spread.T)
    return _Belief(about + state[fixed], spread[fixed, fixed]), wonder / (len(run.q) - 1)


class _Steps:
    """One sample's step and its derivatives, all lanes at once.

    Attributes:
        about: Parameters that the derivatives are taken at, shape `(p,)`.
        least: Least pivot of the last step's mass matrix.
    """

    def __init__(self, experiment: Experiment, noise: _Noise, about: Array, scale: Array) -> None:
        n, p = len(noise.torque), len(scale)
        self._n, self._p = n, p
        self._changes = np.concatenate(
            (np.full(n, _TURN), np.full(n, _SPEED), _SHARE * noise.size, _SHARE * scale)
        )
        noisy, quiet = 3 * n + 1, p + 1
        lanes = np.zeros((3 * n + p, noisy + quiet))
        lanes[: 3 * n, 1:noisy] = np.diag(self._changes[: 3 * n])
        lanes[3 * n :, noisy + 1 :] = np.diag(self._changes[3 * n :])
        self._q, self._dq, self._effort, values = np.split(lanes, (n, 2 * n, 3 * n))
        self._quiet = np.arange(noisy + quiet) >= noisy
        widths = experiment.begun.widths
        self._moving = Integration(experiment.dynamics, values + about[:, None], widths)
        self.about, self.least = about, np.inf

    def __call__(
        self, motion: Array, noisy: Array, quiet: Array, rate: float
    ) -> tuple[Array, Array, Array, Array]:
        """The next positions and velocities, `(2 n,)`, from those before.

        Args:
            motion: Positions and velocities, shape `(2 n,)`.
            noisy: Measured torque, shape `(n,)`.
            quiet: Torque without noise, at which the parameters' derivatives are taken.
            rate: Steps per second.

        Returns:
            With their derivatives by the last ones, by the torques and by the parameters, shapes
            `(2 n, 2 n)`, `(2 n, n)` and `(2 n, p)`.
        """
        n, moving = self._n, self._moving
        np.add(self._q, motion[:n, None], out=moving.q)
        np.add(self._dq, motion[n:, None], out=moving.dq)
        np.add(self._effort, np.where(self._quiet, quiet[:, None], noisy[:, None]), out=moving.effort)
        moving.advance(1.0 / rate)
        self.least = float(moving.least[0])
        ends, first = np.concatenate((moving.q, moving.dq)), 3 * n + 1
        by_noisy = (ends[:, 1:first] - ends[:, :1]) / self._changes[: 3 * n]
        by_value = (ends[:, first + 1 :] - ends[:, first : first + 1]) / self._changes[3 * n :]
        return ends[:, 0], by_noisy[:, : 2 * n], by_noisy[:, 2 * n :], by_value


def _diverged(run: Measured, k: int, least: float) -> DataError:
    """What to say where the filter has lost the robot."""
    why = (
        "its mass matrix is no longer positive definite"
        if least <= 0.0
        else f"it is more than {_FAR:g} rad (m) off"
    )
    return DataError(
        f"the {NAME} diverged at {run.motion.t[k]:.2f} s: {why}",
        where=run.name,
        mend="filter the motion that it begins with more, or give the noises of position and "
        "torque",
    )
