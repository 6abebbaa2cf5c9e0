r"""The Kalman filter of sampled positions, for streams.

The Kalman filter with constant acceleration (p5, eqs 15 and 16): with the state
$x = (q, \dot q, \ddot q)$ and a time step $h$

$$x_k = F x_{k-1} + w,\quad
F = \begin{pmatrix} 1 & h & h^2/2 \\ 0 & 1 & h \\ 0 & 0 & 1 \end{pmatrix},\quad
Q = s \begin{pmatrix} h^5/20 & h^4/8 & h^3/6 \\ h^4/8 & h^3/3 & h^2/2 \\ h^3/6 & h^2/2 & h
\end{pmatrix},\quad y_k = q_k + v,$$

where $s$ is the intensity of white jerk and $v$ white noise of the measured position.
"""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from steelyard.base.arrays import Array
from steelyard.base.errors import DataError
from steelyard.runs.smoothing.kalman_smoother import kalman_smoothed
from steelyard.symbolic.native.kalman_loops import MEASURED, transition

WHERE = "steelyard.KalmanFilter"


class KalmanFilter:
    """Positions, velocities and accelerations of joints from positions as they arrive.

    `step` takes a sample; the attributes are then those of this sample, from it and those before.
    Estimates of a causal filter are late: `delay` says by how much. For logs, the smoother
    (`motion = "kalman"` under `[processing]`) is not. A new motion needs a new filter.

    Attributes:
        steps: Number of samples so far.

    Example:
        >>> filter = KalmanFilter(noise=1e-4, jerk=20.0)
        >>> for k in range(400):
        ...     filter.step(0.005 * k, [0.3 * k * 0.005, 1.0])
        >>> bool(abs(filter.dq - [0.3, 0.0]).max() < 1e-3)
        True
    """

    def __init__(
        self, noise: ArrayLike, jerk: ArrayLike, *, speed: float = 10.0, acceleration: float = 100.0
    ) -> None:
        r"""Begin.

        Args:
            noise: Standard deviation of measured positions, one for all joints or one per joint
                [rad; m].
            jerk: Root of the jerk's intensity, likewise [rad/s^2.5; m/s^2.5]: the larger, the less
                late and the noisier are the estimates.
            speed: Standard deviation of velocities before the first sample [rad/s; m/s].
            acceleration: That of accelerations [rad/s²; m/s²].

        Raises:
            DataError: A number is not above zero and finite.
        """
        given = {"noise": noise, "jerk": jerk, "speed": speed, "acceleration": acceleration}
        values = {name: _positive(name, value) for name, value in given.items()}
        self._noise, self._jerk = values["noise"], values["jerk"]
        self._spread = np.array([float(values[x]) for x in ("speed", "acceleration")])
        self.steps = 0
        self._t = -np.inf
        self._state, self._covariance = np.zeros((0, 3)), np.zeros((0, 3, 3))

    @classmethod
    def fitted(cls, t: ArrayLike, q: ArrayLike, **more: Any) -> "KalmanFilter":
        """A filter with the likeliest noise and jerk of every joint in recorded positions.

        Args:
            t: Time, shape `(N,)` [s], increasing.
            q: Positions, shape `(N, n)` [rad; m], of a typical motion.
            more: As of `KalmanFilter`.

        Raises:
            LogError: There are too few samples, or time does not increase.
            DataError: A joint does not move at all.
        """
        found = kalman_smoothed(np.asarray(t, dtype=float), np.asarray(q, dtype=float))
        still = np.flatnonzero(~((found.noise > 0.0) & (found.jerk > 0.0)))
        if len(still):
            raise DataError(
                f"joint {still[0] + 1} has no noise in these positions, so that none is estimated",
                where=f"{WHERE}.fitted",
                fix="give positions in which every joint moves, or noise and jerk as numbers",
            )
        return cls(found.noise, found.jerk, **more)

    @property
    def q(self) -> Array:
        """Positions, shape `(n,)` [rad; m]."""
        return self._state[:, 0].copy()

    @property
    def dq(self) -> Array:
        """Velocities, shape `(n,)` [rad/s; m/s]."""
        return self._state[:, 1].copy()

    @property
    def ddq(self) -> Array:
        """Accelerations, shape `(n,)` [rad/s²; m/s²]."""
        return self._state[:, 2].copy()

    @property
    def std(self) -> Array:
        """Standard deviations of positions, velocities and accelerations, shape `(3, n)`.

        They hold if the jerk is white and as large as stated.
        """
        variances = np.diagonal(self._covariance, axis1=1, axis2=2)
        return np.asarray(np.sqrt(np.maximum(variances, 0.0)).T)

    def step(self, t: float, q: ArrayLike) -> None:
        """Take a sample.

        Args:
            t: Time [s].
            q: Measured positions, shape `(n,)` [rad; m]; NaN where there is none.

        Raises:
            DataError: Time does not increase, or the sample does not fit those before.
        """
        measured = np.atleast_1d(np.asarray(q, dtype=np.float64))
        self._check(t, measured)
        if self.steps:
            motion, wander = transition(t - self._t)
            self._state = self._state @ motion.T
            noise = np.square(self._jerk)[:, None, None] * wander
            self._covariance = motion @ self._covariance @ motion.T + noise
            column = self._covariance[:, :, 0]
            gain = column / (column[:, :1] + np.square(self._noise)[:, None])
            gain = gain * np.isfinite(measured)[:, None]  # nothing where nothing was measured
            innovation = np.nan_to_num(measured - self._state[:, 0])
            self._state = self._state + gain * innovation[:, None]
            self._covariance = self._covariance - gain[:, :, None] * column[:, None, :]
        else:  # its position, at rest but for the spread
            n = len(measured)
            each = self._noise, self._jerk
            self._noise, self._jerk = (np.broadcast_to(x, n).copy() for x in each)
            self._state = np.column_stack((measured, np.zeros((n, 2))))
            self._covariance = np.zeros((n, 3, 3))
            self._covariance[:, 0, 0] = np.square(self._noise)
            self._covariance[:, [1, 2], [1, 2]] = np.square(self._spread)
        self._t, self.steps = t, self.steps + 1

    def delay(self, frequency: float, rate: float) -> Array:
        """How late positions, velocities and accelerations are after many samples.

        Args:
            frequency: Of a sinusoidal motion [Hz], above zero and below half the rate.
            rate: Of the samples [Hz].

        Returns:
            Phase delay, shape `(3, n)` [s]; `(3, 1)` before the first sample of a filter whose
            noise and jerk are one for all joints.

        Raises:
            DataError: The frequency is not between zero and half the rate.
        """
        if not 0.0 < frequency < 0.5 * rate:
            raise DataError(
                f"a frequency of {frequency:g} Hz of samples at {rate:g} Hz",
                where=f"{WHERE}.delay",
                fix="give a frequency above zero and below half the rate",
            )
        ratios = np.broadcast_to(
            (self._jerk / self._noise) ** 2 / rate**5, max(len(self._state), self._jerk.size, 1)
        )
        return np.array([phase_delays(ratio, frequency / rate) for ratio in ratios]).T / rate

    def _check(self, t: float, measured: Array) -> None:
        n = len(self._state) if self.steps else max(self._noise.size, self._jerk.size)
        fits = measured.shape == (n,) or (not self.steps and n == 1)
        if not fits or measured.ndim != 1:
            raise DataError(
                f"positions of shape {measured.shape}, where there are {n} joints",
                where=f"{WHERE}.step",
                fix="give one position per joint, the same joints in every sample",
            )
        if np.isinf(measured).any() or (not self.steps and np.isnan(measured).any()):
            raise DataError(
                f"positions {measured.tolist()}",
                where=f"{WHERE}.step",
                fix="give finite numbers; NaN where a later sample has no position",
            )
        if not (np.isfinite(t) and t > self._t):
            raise DataError(
                f"a sample at {t} s after one at {self._t} s",
                where=f"{WHERE}.step",
                fix="give samples in the order of time, or begin a new filter",
            )


def phase_delays(ratio: float, frequency: float) -> Array:
    r"""Phase delays of the filter in its steady state, in steps, shape `(3,)`.

    With the gain $K$ and $A = (I - K C) F$ the estimates of a measured $e^{i \omega k}$ are
    $(I - A e^{-i \omega})^{-1} K e^{i \omega k}$.

    Args:
        ratio: Intensity of the jerk over the measurement's variance, time counted in steps.
        frequency: Per sampling rate.
    """
    from scipy.linalg import solve_discrete_are

    motion, wander = transition(1.0)
    scale = np.diag(ratio ** (-np.arange(3.0) / 6.0))
    balanced = scale @ motion @ np.linalg.inv(scale)
    noise = ratio * scale @ wander @ scale
    predicted = solve_discrete_are(balanced.T, MEASURED[:, None], noise, np.eye(1))
    gain = predicted[:, 0] / (predicted[0, 0] + 1.0)
    omega = 2.0 * np.pi * frequency
    loop = (np.eye(3) - np.outer(gain, MEASURED)) @ balanced
    response = np.linalg.solve(np.eye(3) - loop * np.exp(-1j * omega), gain)
    exact = (1j * omega) ** np.arange(3.0)
    return np.asarray(-np.angle(response / exact) / omega)


def _positive(name: str, value: ArrayLike) -> Array:
    numbers = np.asarray(value, dtype=np.float64)
    if numbers.ndim > 1 or not numbers.size or not (np.isfinite(numbers) & (numbers > 0.0)).all():
        raise DataError(
            f"{name} = {value!r}",
            where=WHERE,
            fix=f"give '{name}' as a number above zero, or one per joint",
        )
    return numbers
