r"""The wrench over time: a Kalman smoother that estimates the model's errors along with it.

Efforts of a stretch of a log are $\tau_k = J_k^T F_k + A_k z + e_k$. What the model errs in is the
same along the stretch: its parameters are off by $z$, of variance 1 each in the model's own
uncertainty. Wrench and slow residuals change over time as stationary processes of first order with
the correlation times $T$ and `ALIKE`. So what pushes is distinguished from what the model errs in
by how it changes with the motion, and a direction that efforts do not show in a singular posture is
known from just before and after.

The smoother is linear: it is run on the efforts and on the columns of $A$ at once, least squares of
the innovations then give $z$ [Friedland1969]. As most of the time nothing pushes, the size of the
wrench is estimated too, over windows of $T$, by expectation maximisation.
"""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import DataError
from steelyard.estimate.external import wrench_methods_and_observer_step as methods

DURATION = 1.0  # expected duration of a push [s]
RESIDUAL_CORRELATION_TIME = 0.4  # of slow residuals [s], as on a UR10e on other days
LEAST_WRENCH_VARIANCE, MOST_WRENCH_VARIANCE = 1e-4, 1.0  # over the expected variance
ROUNDS = 4  # rounds of the estimate of the wrench's size
OBSERVABLE = 0.5  # least share from data of the expected variance along an observable direction
NEGLIGIBLE = 0.01  # effect of parameters on efforts, over their noise, that is left out


@dataclass(frozen=True)
class Smoothed:
    """Wrenches over time, with errors of the model estimated from the same log."""

    name: ClassVar[str] = "smoothed"
    expected: methods.Expected = methods.Expected()  # the size of wrenches, to begin with
    duration: float = DURATION  # how long a push lasts, usually [s]

    def __post_init__(self) -> None:
        if not 0.0 < self.duration < np.inf:
            wrong = f"{self.duration:g} s is no duration of a push"
            fix = "give a time above zero, such as 1 s"
            raise DataError(wrong, where="expected wrench (--duration)", fix=fix)

    def __call__(self, efforts: methods.ExternalEfforts) -> methods.Wrenches:
        """Wrenches of all samples."""
        # combinations of parameters that make no difference to the efforts are left out
        rms = np.hypot(efforts.slow, efforts.noise)[:, :, None]
        flat = (efforts.spread / rms).reshape(-1, efforts.spread.shape[2])
        effects, vectors = np.linalg.eigh(flat.T @ flat / len(flat))
        spread = efforts.spread @ vectors[:, effects > NEGLIGIBLE**2]
        efforts = replace(efforts, spread=spread)
        std, size = np.sqrt(self.expected.variances), np.ones(len(efforts.torque))
        first = values, covariance = self._posterior(efforts, size)
        for _ in range(ROUNDS):
            square = np.square(values) + np.diagonal(covariance, axis1=1, axis2=2)
            size = self._averaged(size * square[:, std > 0.0].mean(axis=1), efforts.step)
            values, covariance = self._posterior(efforts, size)
        before = std[:, None] * first[1] * std
        after = size[:, None, None] * covariance
        whole = std[:, None] * (after + _unobservable(first[1], after)) * std
        values = values * np.sqrt(size)[:, None] * std
        return methods.Wrenches(values, whole, methods.learned_of(before, self.expected))

    def _posterior(self, efforts: methods.ExternalEfforts, size: Array) -> tuple[Array, Array]:
        """Wrenches over their expected size, `(N, 6)`, and their covariances, `(N, 6, 6)`."""
        n = efforts.torque.shape[1]
        lasts = np.repeat([self.duration, RESIDUAL_CORRELATION_TIME], [6, n])
        std = np.sqrt(size)[:, None] * np.sqrt(self.expected.variances)
        of_wrench = (efforts.jacobian * std[:, :, None]).swapaxes(1, 2)
        loads = np.concatenate([of_wrench, efforts.slow[:, :, None] * np.eye(n)], axis=2)
        noise = efforts.noise[:, :, None] * efforts.correlation * efforts.noise[:, None, :]
        before = np.eye(6 + n)
        before[6:, 6:] = efforts.correlation
        data = np.concatenate([efforts.torque[:, :, None], efforts.spread], axis=2)
        keeps, noise = np.exp(-efforts.step / lasts), noise * efforts.per_independent
        states, covariances, gram = _smoothed(keeps, before, data, loads, noise)
        off = np.linalg.inv(np.eye(len(gram) - 1) + gram[1:, 1:])
        wrench = states[:, :6]
        values = wrench[:, :, 0] - wrench[:, :, 1:] @ (off @ gram[1:, 0])
        spread = wrench[:, :, 1:] @ np.linalg.cholesky(off)
        return values, covariances[:, :6, :6] + spread @ spread.swapaxes(1, 2)

    def _averaged(self, size: Array, step: float) -> Array:
        """Mean over a window as long as a push, or twice the stretch, within limits."""
        from scipy.ndimage import uniform_filter1d

        window = 2 * max(1, round(min(0.5 * self.duration / step, len(size)))) + 1
        mean = uniform_filter1d(size, window, mode="nearest")
        return np.asarray(np.clip(mean, LEAST_WRENCH_VARIANCE, MOST_WRENCH_VARIANCE))


WrenchMethod = methods.Weighted | methods.InverseJacobian | Smoothed  # from efforts to wrenches


def _smoothed(
    keeps: Array, before: Array, data: Array, loads: Array, noise: Array
) -> tuple[Array, Array, Array]:
    """Kalman smoother of a stationary process, on several columns of `data` with the same gains.

    Of each state a step `keeps` a part, `(m,)`; `before` is their covariance without data, `(m,
    m)`. `loads` lead from states to data, `(N, n, m)`, which is `(N, n, c)`; its `noise` has
    covariances `(N, n, n)`. Comes back: states `(N, m, c)`, their covariances `(N, m, m)`, and the
    sum of squares and products of the whitened innovations, `(c, c)`.
    """
    count, n, columns = data.shape
    m = len(keeps)
    added = before * (1.0 - np.outer(keeps, keeps))
    states, covariances = np.empty((count, m, columns)), np.empty((count, m, m))
    predicted, innovations = np.empty((count, m, m)), np.empty((count, n, columns))
    state, covariance = np.zeros((m, columns)), before
    for k in range(count):
        load = loads[k]
        shared = load @ covariance
        root = np.linalg.cholesky(shared @ load.T + noise[k])
        white = np.linalg.solve(root, np.concatenate([data[k] - load @ state, shared], axis=1))
        innovations[k], gain = white[:, :columns], white[:, columns:]
        predicted[k], states[k] = covariance, state + gain.T @ innovations[k]
        covariances[k] = covariance - gain.T @ gain
        state = keeps[:, None] * states[k]
        covariance = keeps[:, None] * covariances[k] * keeps + added
    carried = keeps[:, None] * covariances[:-1]
    back = np.linalg.solve(predicted[1:], carried).swapaxes(1, 2)
    states[:-1] -= back @ (keeps[:, None] * states[:-1])
    covariances[:-1] -= back @ carried
    for k in range(count - 2, -1, -1):
        states[k] += back[k] @ states[k + 1]
        covariances[k] += back[k] @ covariances[k + 1] @ back[k].T
    flat = innovations.reshape(-1, columns)
    return states, covariances, flat.T @ flat


def _unobservable(before: Array, after: Array) -> Array:
    """What covariances are widened by along unobservable directions, shape `(N, 6, 6)`.

    That nothing pushes is concluded from observable directions: along others the interval
    stays as wide as before the size was estimated.
    """
    values, vectors = np.linalg.eigh(before)
    along = np.einsum("tij,tik,tkj->tj", vectors, after, vectors)
    lacking = np.where(values > 1.0 - OBSERVABLE, np.maximum(values - along, 0.0), 0.0)
    return np.asarray((vectors * lacking[:, None, :]) @ vectors.swapaxes(1, 2))
