r"""External efforts by the generalised momentum [DeLuca2005], along a log or sample by sample.

Between two samples the momentum changes by $\Delta p = \int (\tau + u + \tau_e)\,dt$, with the
drive $u$ of `momentum_and_drive`, so that $s = \Delta p / \Delta t - \overline{\tau + u}$ is the
mean external effort, and the observer of first order with bandwidth $b$ follows it as
$r \leftarrow a r + (1 - a) s$ with $a = e^{-2 \pi b \Delta t}$.
"""

from functools import partial
from math import exp, inf, pi
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.base.arrays import Z95, Array, frozen
from steelyard.base.errors import DataError
from steelyard.base.motion import numbers
from steelyard.estimate.covariance_and_band_widths import EffortUncertainty, rest_speed_of
from steelyard.estimate.external.contact_thresholds import ChangeStepper, ContactThresholds
from steelyard.estimate.external.wrench_methods_and_observer_step import (
    STATES,
    Axes,
    Expected,
    columns_quantity,
    moved_frame,
    step_code,
)
from steelyard.model.compiled_quantity import check_angles
from steelyard.symbolic.native.compiled_programs import SampleCall
from steelyard.symbolic.native.llvm_vector_code import MAX_ANGLE

if TYPE_CHECKING:
    from steelyard.estimate.identified_model import IdentifiedModel

PER_PERIOD = 10.0  # samples that a period of the observer's bandwidth needs
NOISE = 0.5 * np.pi  # noise bandwidth of a low-pass of first order over its bandwidth


def check_bandwidth(bandwidth: float) -> None:
    """Check a bandwidth."""
    if not 0.0 < bandwidth < np.inf:
        wrong = f"{bandwidth:g} Hz is no bandwidth"
        fix = "give a frequency above zero, such as 8 Hz"
        raise DataError(wrong, where="observer of external efforts", fix=fix)


def momentum_residual(momentum: Array, effort: Array, rate: float) -> Array:
    r"""External efforts along one segment, not low-passed, shape `(N, n)` [Nm; N].

    That of a sample is the mean of $s$ before and after it; zero where there is one sample alone.
    `effort` is what drives the momentum, $\tau + u$; `rate` that of the samples [Hz].
    """
    if len(momentum) < 2:
        return np.zeros_like(momentum)
    between = rate * np.diff(momentum, axis=0) - 0.5 * (effort[1:] + effort[:-1])
    return np.asarray(
        0.5 * (between[[0, *range(len(between))]] + between[[*range(len(between)), -1]])
    )


SMALL = MAX_ANGLE**2  # sum of squares of positions that machine code can take
PER_PERIOD_COVARIANCE = 4.0  # most computations of the efforts' covariance a period
GAP = 2.0  # longest step, over the longest that the bandwidth allows, that is no gap
FEW = 20  # steps from which on too many gaps are an error


class Observer:
    """External efforts, wrench and contact of a robot on samples as they arrive.

    `step` takes a sample; the attributes are then those of this sample, and new arrays whenever
    they are read. A new motion needs a new observer, and so does every thread. After a gap in
    time it begins anew.

    Example:
        >>> model = load_model("arm-model")
        >>> observer = model.observe("lower")
        >>> for k in range(100):
        ...     q, still = [0.3, 0.5], [0.0, 0.0]
        ...     observer.step(0.004 * k, q, still, model.torque(q, still, still))
        >>> bool(abs(observer.torque).max() < 1e-9)
        True
    """

    def __init__(
        self,
        identified: "IdentifiedModel",
        frame: str | None,
        axes: Axes,
        bandwidth: float,
        expected: Expected,
        thresholds: ContactThresholds | None,
    ) -> None:
        """Begin; see `IdentifiedModel.observe`. Thresholds must be for this bandwidth [Hz]."""
        robot, equations = identified.robot, identified.model
        n, given = robot.n, identified.processing.rest_speed
        self.bandwidth, self.expected = bandwidth, expected
        self.steps = self.gaps = 0
        """Samples so far, and gaps in time among them."""
        self._n, columns = n, columns_quantity(identified.base.independent)
        self._columns = partial(identified.start().evaluate, columns)
        rest_speed = rest_speed_of(n, identified.calibration, given)
        self._noise = _Noise(identified.effort_uncertainty(NOISE * bandwidth), rest_speed)
        self._thresholds = None if thresholds is None else thresholds.start()
        self._changes = None if thresholds is None else ChangeStepper(thresholds.changes)
        self._limits, self._changed = np.full(n, np.nan), np.zeros(n, dtype=bool)
        self._rate = 2.0 * pi * bandwidth
        self._longest = GAP / (PER_PERIOD * bandwidth)
        self._hold = 1.0 / (PER_PERIOD_COVARIANCE * bandwidth)
        self._t = self._due = -inf
        self._state, self._sample = np.zeros(STATES * n), np.zeros(3 * n)
        self._scalars = np.zeros(3)
        self._q, self._dq, self._tau = (self._sample[k * n : k * n + n] for k in range(3))
        self._scan = equations.scan() if equations.n_channels else None
        self._channels = np.zeros(equations.n_channels)
        self._covariance = np.zeros((n, n))
        self._values = np.ascontiguousarray(identified.valued.values.values)
        self._variances = expected.variances
        inputs = (
            self._state, self._sample, self._scalars, self._channels, self._values,
            self._covariance, self._variances,
        )  # fmt: skip
        code = step_code(equations, moved_frame(robot, frame), axes)
        self._evaluation = SampleCall(code, inputs, self._sample, SMALL)
        self._next = self._evaluation.result[: STATES * n]

    def step(self, t: float, q: ArrayLike, dq: ArrayLike, tau: ArrayLike) -> None:
        """Take the next sample.

        Args:
            t: Time [s].
            q: Positions, shape `(n,)` [rad; m].
            dq: Velocities, likewise.
            tau: Joint efforts, likewise [Nm; N].

        Raises:
            DataError: An argument has another shape or is no finite number, time does not increase,
                or samples come less than ten times per period of the bandwidth.
        """
        since = t - self._t
        if not since > 0.0:
            raise _refused(
                f"time does not increase: {t:g} s after {self._t:g} s", "leave repeated samples out"
            )
        try:
            self._q[:], self._dq[:], self._tau[:] = q, dq, tau
        except (TypeError, ValueError):
            shapes = ", ".join(str(np.shape(x)) for x in (q, dq, tau))
            wrong = f"values of shapes {shapes} for {self._n} joints"
            fix = "give one number per joint in each"
            raise DataError(wrong, where="q, dq, tau", fix=fix) from None
        gap = since > self._longest
        left, inverse = (1.0, 0.0) if gap else (exp(-self._rate * since), 1.0 / since)
        if gap:
            self._begin()
        self._scalars[:] = left, inverse, self._rate
        if self._scan is not None:
            motion = (self._q, self._dq, self._accelerations())
            self._channels[:] = self._scan(*(x[:, None] for x in motion))[:, 0]
        if t >= self._due:  # the covariance of the efforts changes no faster than the observer
            entries = self._columns(self._q, self._dq, self._accelerations())
            self._covariance[:] = self._noise(entries, self._dq)
            self._due = t + self._hold
        if not self._evaluation.call():
            check_angles(self._q)
            numbers("dq", self._dq, [(self._n,)])
            numbers("tau", self._tau, [(self._n,)])
            raise _refused("a velocity or an effort is too large for numbers", "check their units")
        self._state[:] = self._next
        self._t = t
        if self._thresholds is not None and self._changes is not None:
            self._limits = self._thresholds.step(t, self._dq)
            resting, external = self._thresholds.resting, self._state[3 * self._n :]
            self._changed = self._changes.step(t, resting, external)
        self.steps += 1
        self.gaps += gap
        if gap and self.steps > FEW and 2 * self.gaps > self.steps:
            raise DataError(
                f"most samples are more than {self._longest:.3g} s apart",
                where=f"observer with a bandwidth of {self.bandwidth:g} Hz",
                fix=f"give at least {PER_PERIOD * self.bandwidth:g} samples a second, or choose a "
                "lower bandwidth",
            )

    @property
    def torque(self) -> Array:
        """External effort of each joint, shape `(n,)` [Nm; N]; zero at the first sample."""
        return self._state[3 * self._n :].copy()

    @property
    def torque_half_width(self) -> Array:
        """Half-width of the 95 % intervals of `torque`, shape `(n,)` [Nm; N]."""
        return np.asarray(Z95 * np.sqrt(np.diag(self._covariance)))

    @property
    def wrench(self) -> Array:
        """Force [N] and moment [Nm] on the frame, shape `(6,)`."""
        return self._evaluation.result[-12:-6].copy()

    @property
    def half_width(self) -> Array:
        """Half-width of the 95 % intervals of `wrench`, shape `(6,)` [N; Nm]."""
        return np.asarray(Z95 * np.sqrt(np.maximum(self._evaluation.result[-6:], 0.0)))

    @property
    def contact(self) -> NDArray[np.bool_]:
        """Whether each joint's external effort, or its change at rest, exceeds its threshold.

        Returns:
            Shape `(n,)`.

        Raises:
            DataError: The observer has no thresholds.
        """
        if self._thresholds is None:
            wrong = "the observer has no thresholds of contact"
            fix = "give thresholds to observe(), such as those of steelyard.contact(...)"
            raise DataError(wrong, where="contact of an observer", fix=fix)
        return (np.abs(self._state[3 * self._n :]) > self._limits) | self._changed

    def _begin(self) -> None:
        n = self._n
        self._state[2 * n : 3 * n], self._state[3 * n :] = self._dq, 0.0
        self._due = -inf
        if self._changes is not None:
            self._changes.begin()
        if self._scan is not None:
            self._scan = self._scan.again()

    def _accelerations(self) -> Array:
        """Those behind the observer's low-pass, shape `(n,)`."""
        slow = self._state[2 * self._n : 3 * self._n]
        return np.asarray(self._rate * self._scalars[0] * (self._dq - slow))


def _refused(wrong: str, fix: str) -> DataError:
    return DataError(wrong, where="samples of an observer", fix=fix)


class _Noise:
    """Covariance of what the model predicts wrongly, at single samples.

    What depends on the range of speed of each joint alone is computed once per combination.
    """

    def __init__(self, uncertainty: EffortUncertainty, rest_speed: Array) -> None:
        self._uncertainty, self._rest = uncertainty, rest_speed[:, None]
        known = uncertainty.calibration
        edges = np.empty((len(rest_speed), 0)) if known is None else known.edges
        self._edges = frozen(np.maximum(np.hstack([self._rest, edges]), self._rest))
        self._factor = np.ascontiguousarray(uncertainty.factor)
        self._of_speed: dict[bytes, tuple[Array, Array]] = {}

    def __call__(self, columns: Array, dq: Array) -> Array:
        """Covariance, shape `(n, n)`, of regressor entries `(n, c)` at velocities `(n,)`."""
        place = np.abs(dq)[:, None] > self._edges
        key = place.tobytes()
        if key not in self._of_speed:
            speed = np.abs(dq)[:, None]
            moving = speed > self._rest
            nothing = np.zeros((1, len(speed), self._factor.shape[0]))
            noise = self._uncertainty.covariance(nothing, speed, moving)[0]
            scale = np.maximum(self._uncertainty.factor_of(speed, moving), 1.0)
            self._of_speed[key] = noise, scale
        noise, scale = self._of_speed[key]
        spread = (columns @ self._factor) * scale
        return np.asarray(spread @ spread.T + noise)
