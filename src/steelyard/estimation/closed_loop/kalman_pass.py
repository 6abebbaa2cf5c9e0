"""One pass of the Kalman filter over motion and parameters, along one run."""

from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import DataError
from steelyard.estimation.closed_loop.experiment import Experiment, Measured
from steelyard.estimation.closed_loop.forward import Integration
from steelyard.progress import Progress, report_progress

_TURN, _SPEED, _SHARE = 1e-6, 1e-5, 1e-4
"""Changes by which derivatives are found: of positions, velocities, and of the rest over their
size."""

_FAR = 0.5
"""Error of a predicted position at which the filter has diverged [rad; m]."""

_UNSURE = 0.1
"""First uncertainty of velocities, over their size."""

_TICKS_PER_EVENT = 500


@dataclass(frozen=True, eq=False)
class Noise:
    """White noise of one run.

    Attributes:
        position: Standard deviation per joint, shape `(n,)` [rad; m].
        torque: Likewise [Nm; N].
        size: Root mean square of the torque, likewise.
    """

    position: Array
    torque: Array
    size: Array

    def torque_variance(self, counts: Array) -> Array:
        """Variance of the torque at a sample that counts, or does not, shape `(n,)`."""
        return np.where(counts > 0.0, self.torque**2, self.size**2)


@dataclass(frozen=True, eq=False)
class Belief:
    """Parameters, shape `(p,)`, and their covariance, `(p, p)`."""

    values: Array
    covariance: Array


@dataclass(frozen=True, eq=False)
class Slopes:
    """One step and its derivatives.

    Attributes:
        ends: Positions and velocities after it, shape `(2 n,)`.
        motion: Derivatives by those before, shape `(2 n, 2 n)`.
        effort: By the torques, shape `(2 n, n)`.
        values: By the parameters, shape `(2 n, p)`.
        least: Least pivot of the mass matrix.
    """

    ends: Array
    motion: Array
    effort: Array
    values: Array
    least: float


class Steps:
    """Steps from one sample to the next and their derivatives, all lanes at once.

    Attributes:
        about: Parameters that the derivatives are taken at, shape `(p,)`.
    """

    def __init__(self, experiment: Experiment, noise: Noise, about: Array, scale: Array) -> None:
        """Begin.

        Args:
            experiment: What moves.
            noise: Gives the size of the torques.
            about: See the class.
            scale: Sizes of the parameters' changes, shape `(p,)`.
        """
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

    def __call__(self, motion: Array, noisy: Array, quiet: Array, duration: float) -> Slopes:
        """One step.

        Args:
            motion: Positions and velocities, shape `(2 n,)`.
            noisy: Measured torque, shape `(n,)`.
            quiet: Torque without noise, at which the parameters' derivatives are taken.
            duration: [s].
        """
        n, first, moving = self._n, self._first, self._moving
        np.add(self._q, motion[:n, None], out=moving.q)
        np.add(self._dq, motion[n:, None], out=moving.dq)
        applied = np.where(self._quiet, quiet[:, None], noisy[:, None])
        np.add(self._effort, applied, out=moving.effort)
        moving.advance(duration)
        ends = np.concatenate((moving.q, moving.dq))
        slopes = (ends[:, 1:first] - ends[:, :1]) / self._changes[: 3 * n]
        by_value = (ends[:, first + 1 :] - ends[:, first : first + 1]) / self._changes[3 * n :]
        least = float(moving.least[0])
        return Slopes(ends[:, 0], slopes[:, : 2 * n], slopes[:, 2 * n :], by_value, least)


class State:
    """Motion, noise of the last torque sample, and departure of the parameters, with covariance."""

    def __init__(self, run: Measured, noise: Noise, departure: Array, covariance: Array) -> None:
        n = len(noise.torque)
        self._n, self._noise = n, noise
        self._moving, self._noisy = slice(0, 2 * n), slice(2 * n, 3 * n)
        self._fixed = slice(3 * n, None)
        self.mean = np.concatenate((run.motion.q[0], run.motion.dq[0], np.zeros(n), departure))
        speeds = _UNSURE * np.sqrt(np.mean(run.motion.dq**2, axis=0))
        own = (
            noise.position**2,
            speeds**2,
            noise.torque_variance(run.counts[0]),
            np.zeros(len(departure)),
        )
        self.spread = np.diag(np.concatenate(own))
        self.spread[self._fixed, self._fixed] = covariance

    @property
    def motion(self) -> Array:
        """Positions and velocities, shape `(2 n,)`."""
        return self.mean[self._moving]

    def predict(self, slopes: Slopes, counts: Array) -> None:
        """Go one step on; the noise of the torque sample at its end is new.

        Args:
            slopes: The step under the mean of two torque samples.
            counts: Whether the sample at its end counts, shape `(n,)`.
        """
        moving, noisy, fixed, spread = self._moving, self._noisy, self._fixed, self.spread
        variance, half = self._noise.torque_variance(counts), -0.5 * slopes.effort
        departed = slopes.values @ self.mean[fixed]
        self.mean[moving] = slopes.ends + half @ self.mean[noisy] + departed
        self.mean[noisy] = 0.0
        transition = np.concatenate((slopes.motion, half, slopes.values), axis=1)
        moved, fresh = transition @ spread, half * variance
        spread[moving, moving] = moved @ transition.T + fresh @ half.T
        spread[moving, noisy], spread[noisy, moving] = fresh, fresh.T
        spread[noisy, noisy] = np.diag(variance)
        spread[noisy, fixed], spread[fixed, noisy] = 0.0, 0.0
        spread[moving, fixed], spread[fixed, moving] = moved[:, fixed], moved[:, fixed].T

    def correct(self, missed: Array) -> Array:
        """Take measured positions in.

        Args:
            missed: Their distance from the predicted ones, shape `(n,)`.

        Returns:
            Its squares over what was expected, shape `(n,)`.
        """
        n, spread = self._n, self.spread
        expected = spread[:n, :n] + np.diag(self._noise.position**2)
        gain = np.linalg.solve(expected, spread[:n]).T
        self.mean += gain @ missed
        spread -= gain @ spread[:n]
        self.spread = 0.5 * (spread + spread.T)
        return np.asarray(missed**2 / np.diag(expected))

    def belief(self, about: Array) -> Belief:
        """The parameters."""
        return Belief(about + self.mean[self._fixed], self.spread[self._fixed, self._fixed])


def filtered(
    run: Measured, noise: Noise, steps: Steps, quiet: Array, belief: Belief, progress: Progress
) -> tuple[Belief, Array]:
    """One pass over one run.

    Args:
        run: What was measured.
        noise: Its noise.
        steps: The model's.
        quiet: Torques without noise, shape `(N, n)`.
        belief: What is known before.
        progress: Told how far it is.

    Returns:
        What is known after it, and the mean square of the positions' errors over what was expected,
        shape `(n,)`.

    Raises:
        DataError: The filter diverges.
    """
    n, wonder = len(noise.torque), np.zeros(len(noise.torque))
    state = State(run, noise, belief.values - steps.about, belief.covariance)
    for k in range(1, len(run.q)):
        if k % _TICKS_PER_EVENT == 0:
            report_progress(progress, f"filtering {run.name}", k / run.rate, len(run.q) / run.rate)
        noisy, calm = (0.5 * (x[k - 1] + x[k]) for x in (run.tau, quiet))
        slopes = steps(state.motion, noisy, calm, 1.0 / run.rate)
        state.predict(slopes, run.counts[k])
        missed = run.q[k] - state.mean[:n]
        if slopes.least <= 0.0 or not np.abs(missed).max() < _FAR:
            raise _diverged(run, k, slopes.least)
        wonder += state.correct(missed)
    return state.belief(steps.about), wonder / (len(run.q) - 1)


def _diverged(run: Measured, k: int, least: float) -> DataError:
    """What to say where the filter has lost the robot."""
    why = (
        "its mass matrix is no longer positive definite"
        if least <= 0.0
        else f"it is more than {_FAR:g} rad (m) off"
    )
    return DataError(
        f"the Kalman filter diverged at {run.motion.t[k]:.2f} s: {why}",
        where=run.name,
        fix="low-pass the motion of its start values more, or give the noise of positions and "
        "torques",
    )
