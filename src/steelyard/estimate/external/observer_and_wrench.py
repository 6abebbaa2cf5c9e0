r"""External efforts by the generalised momentum [DeLuca2005], and the wrench that makes them.

A wrench $F$ on a frame makes efforts $\tau = J^T F$. With the covariance $S$ of what the model
predicts wrongly, and wrenches of the expected size $P$,

$$\hat F = (J S^{-1} J^T + P^{-1})^{-1} J S^{-1} \tau = P J (J^T P J + S)^{-1} \tau$$

with the covariance $P - P J (J^T P J + S)^{-1} J^T P$. The second form needs no inverse of $J$: it
is finite in singular postures, for any number of joints. What no effort shows stays at zero, with
an interval as wide as the expected size. $J^{-T} \tau$ knows neither $S$ nor $P$.

Between two samples the momentum changes by $\Delta p = \int (\tau + u + \tau_e)\,dt$, see
`observed`, so that $s = \Delta p / \Delta t - \overline{\tau + u}$ is the mean external effort, and
the observer of first order with bandwidth $b$ follows it as $r \leftarrow a r + (1 - a) s$ with
$a = e^{-2 \pi b \Delta t}$.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import exp, inf, pi
from typing import ClassVar, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from steelyard.base.arrays import Z95, Array, frozen
from steelyard.base.errors import DataError
from steelyard.base.motion import numbers
from steelyard.estimate.covariance_and_band_widths import EffortUncertainty
from steelyard.estimate.external.compiled_observer_step import STATES, StepProgram
from steelyard.estimate.external.contact_thresholds import ChangeStepper, ContactThresholds
from steelyard.model.compiled_quantity import check_angles
from steelyard.symbolic.native.compiled_programs import SampleCall
from steelyard.symbolic.native.llvm_vector_code import MAX_ANGLE

FORCE = 30.0  # expected size of a force [N]: a firm push
LEVER = 0.1  # expected distance of a force from the frame's origin [m]
FORCES, LEVERS = (0.1, 1e5), (0.0, 100.0)  # range of expected forces [N] and levers [m]
TINY = 1e-12  # singular values of a Jacobian below this share of the largest are zero


@dataclass(frozen=True)
class Expected:
    """The size that wrenches are expected to have."""

    force: float = FORCE  # standard deviation of each component of the force [N]
    # that of each component of the moment, over `force` [m]; 0 for forces at the origin
    lever: float = LEVER

    def __post_init__(self) -> None:
        for name, value, (least, most), unit, usual in (
            ("force", self.force, FORCES, "N", "the size of a usual force, such as 30 N"),
            ("lever", self.lever, LEVERS, "m", "how far from the frame's origin, such as 0.1 m"),
        ):
            if not least <= value <= most:
                raise DataError(
                    f"a {name} of {value:g} {unit} is no expected size: {least:g} to {most:g} "
                    f"{unit} can be expected",
                    where=f"expected wrench (--{name})",
                    fix=f"give {usual}",
                )

    @property
    def variances(self) -> Array:
        """Diagonal of $P$, shape `(6,)`."""
        return frozen(np.repeat(np.square([self.force, self.force * self.lever]), 3))


@dataclass(frozen=True, eq=False)
class ExternalEfforts:
    """External efforts along a stretch of a log, behind a low-pass, and how far they may be off.

    They are $J^T F + A z + e$ with parameters $z$ of the model, independent and of variance 1, and
    residuals $e$, one part of which is slow, another one noise.
    """

    step: float  # time between samples [s]
    torque: Array  # external efforts, `(N, n)` [Nm; N]
    jacobian: Array  # of the frame, `(N, 6, n)`
    spread: Array  # $A$, `(N, n, k)`
    slow: Array  # standard deviation of the slow residuals, `(N, n)` [Nm; N]
    noise: Array  # that of the others, likewise
    correlation: Array  # of both between joints, `(n, n)`
    per_independent: float  # samples per independent one of the noise

    def part(self, at: slice) -> "ExternalEfforts":
        """Some consecutive samples."""
        names = ("torque", "jacobian", "spread", "slow", "noise")
        return replace(self, **{name: getattr(self, name)[at] for name in names})

    @property
    def covariance(self) -> Array:
        """$S$, shape `(N, n, n)`."""
        std = np.hypot(self.slow, self.noise)
        residual = std[:, :, None] * self.correlation * std[:, None, :]
        return np.asarray(self.spread @ self.spread.swapaxes(1, 2) + residual)


@dataclass(frozen=True, eq=False)
class Wrenches:
    """Estimated wrenches."""

    values: Array  # force [N] and moment [Nm], `(N, 6)`
    covariance: Array  # `(N, 6, 6)`
    # share of what is expected of a wrench that efforts decide, see `learned_of`, `(N, 6, 6)`
    learned: Array


class WrenchMethod(Protocol):
    """From external efforts to wrenches."""

    name: ClassVar[str]

    @property
    def expected(self) -> Expected:
        """The size of wrenches, beside which a direction is seen or not."""

    def __call__(self, efforts: ExternalEfforts) -> Wrenches:
        """Wrenches of all samples."""


@dataclass(frozen=True)
class Weighted:
    """Each sample by itself, weighted by the model's uncertainty and the expected size."""

    name: ClassVar[str] = "weighted"
    expected: Expected = Expected()  # the size

    def __call__(self, efforts: ExternalEfforts) -> Wrenches:
        """See `WrenchMethod`."""
        prior, jacobian = self.expected.variances, efforts.jacobian
        spread = jacobian * prior[:, None]
        together = jacobian.swapaxes(1, 2) @ spread + efforts.covariance
        gain = np.linalg.solve(together, spread.swapaxes(1, 2)).swapaxes(1, 2)
        covariance = np.diag(prior) - gain @ spread.swapaxes(1, 2)
        values = (gain @ efforts.torque[:, :, None])[:, :, 0]
        return Wrenches(values, covariance, learned_of(covariance, self.expected))


@dataclass(frozen=True)
class InverseJacobian:
    r"""$J^{-T} \tau$, by the pseudo-inverse where $J$ has none; large near singular postures."""

    name: ClassVar[str] = "inverse"
    expected: Expected = Expected()  # the size of wrenches, beside which a direction is seen or not

    def __call__(self, efforts: ExternalEfforts) -> Wrenches:
        """See `WrenchMethod`."""
        inverse = np.linalg.pinv(efforts.jacobian.swapaxes(1, 2), rcond=TINY)
        values = (inverse @ efforts.torque[:, :, None])[:, :, 0]
        covariance = inverse @ efforts.covariance @ inverse.swapaxes(1, 2)
        return Wrenches(values, covariance, Weighted(self.expected)(efforts).learned)


def learned_of(covariance: Array, expected: Expected) -> Array:
    r"""Share of what is expected of a wrench that efforts decide, $1 - P^{-1/2} C P^{-1/2}$.

    $C$ is a covariance, and $P$ what it was before, shape `(N, 6, 6)`. Eigenvalues of 0 belong to
    directions that no effort shows, of 1 to those that efforts show exactly. Without a lever there
    is nothing to know of moments.
    """
    std = np.sqrt(expected.variances)
    scale = np.divide(1.0, std, out=np.zeros(6), where=std > 0.0)
    return np.asarray(np.eye(6) - scale[:, None] * covariance * scale)


def condition_numbers(jacobian: Array) -> Array:
    """Condition number of each Jacobian, `(N, 6, n)` to `(N,)`; infinite where it is singular."""
    values = np.linalg.svd(jacobian, compute_uv=False)
    if jacobian.shape[2] < jacobian.shape[1]:
        return np.full(len(jacobian), np.inf)
    with np.errstate(divide="ignore"):
        return np.asarray(values[:, 0] / values[:, -1])


PER_PERIOD = 10.0  # samples that a period of the observer's bandwidth needs
NOISE = 0.5 * np.pi  # noise bandwidth of a low-pass of first order over its bandwidth


def check_bandwidth(bandwidth: float) -> None:
    """Check a bandwidth."""
    if not 0.0 < bandwidth < np.inf:
        raise DataError(
            f"{bandwidth:g} Hz is no bandwidth",
            where="observer of external efforts",
            fix="give a frequency above zero, such as 8 Hz",
        )


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
        program: StepProgram,
        values: Array,
        columns: Callable[[Array, Array, Array], Array],
        uncertainty: EffortUncertainty,
        rest_speed: Array,
        bandwidth: float,
        expected: Expected,
        thresholds: ContactThresholds | None = None,
    ) -> None:
        """Begin; `columns` are regressor entries `(n, c)` at a sample, `values` of all parameters.

        Thresholds of contact must be for this bandwidth [Hz]; without, no contact is reported.
        """
        code, n = program.code, len(rest_speed)
        self.bandwidth, self.expected = bandwidth, expected
        self.steps = self.gaps = 0
        """Samples so far, and gaps in time among them."""
        self._n, self._columns, self._code = n, columns, code
        self._noise = _Noise(uncertainty, rest_speed)
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
        self._scan = program.equations.scan() if program.equations.n_channels else None
        self._channels = np.zeros(program.equations.n_channels)
        self._covariance = np.zeros((n, n))
        self._values, self._variances = np.ascontiguousarray(values), expected.variances
        inputs = (
            self._state, self._sample, self._scalars, self._channels, self._values,
            self._covariance, self._variances,
        )  # fmt: skip
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
            raise DataError(
                f"values of shapes {shapes} for {self._n} joints",
                where="q, dq, tau",
                fix="give one number per joint in each",
            ) from None
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
            raise DataError(
                "the observer has no thresholds of contact",
                where="contact of an observer",
                fix="give thresholds to observe(), such as those of steelyard.contact(...)",
            )
        return (np.abs(self._state[3 * self._n :]) > self._limits) | self._changed

    def _begin(self) -> None:
        """Forget what was before."""
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
