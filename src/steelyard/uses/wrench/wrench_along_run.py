r"""The external wrench along a run, with intervals and the directions that efforts do not show.

External efforts are what the model's efforts leave over: by the torque,
$\tau_e = M \ddot q + b + \tau_f + \dots - \tau$, or by the momentum, which needs no accelerations;
both behind the same zero-phase low-pass, so that neither lags. Where a joint rests, its friction
lies anywhere in a dead zone: laws without memory then predict none, and efforts are that uncertain
for as long as the low-pass sees the rest.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Z95, Array
from steelyard.base.errors import DataError, ModelError
from steelyard.base.progress import Progress, report_progress, silent
from steelyard.estimate.external import wrench_methods_and_observer_step as methods
from steelyard.estimate.external.momentum_observer_with_wrench_and_contact import (
    PER_PERIOD,
    check_bandwidth,
    momentum_residual,
)
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.estimate.information.gather import blocks_with_channels
from steelyard.estimate.scores.parts_and_bands_along_run import TorqueSplit
from steelyard.estimate.scores.residual_traces_and_band_calibration import (
    FORGOTTEN,
    FRICTION,
    residual_trace,
)
from steelyard.model.torque_and_quantities import Quantity
from steelyard.robot.robot import refuse_floating
from steelyard.runs.run import Block, Run
from steelyard.runs.smoothing.smoothing_methods_and_zero_phase_filters import (
    noise_bandwidth,
    zero_phase,
)
from steelyard.uses.effort_plausibility import refuse_other_efforts
from steelyard.uses.wrench.wrench_kalman_smoother import OBSERVABLE, Smoothed, WrenchMethod

ResidualKind = Literal["momentum", "torque"]

COMPONENTS = (
    "force along x", "force along y", "force along z",
    "moment about x", "moment about y", "moment about z",
)  # fmt: skip

KINDS = ("force along", "moment about")

MINOR_COMPONENT = 0.3  # share of a direction's largest component below which one is not named


def unobservable_directions(learned: Array, expected: methods.Expected) -> tuple[Array, ...]:
    """Directions with less than `OBSERVABLE` from data, each of shape `(6,)` and length 1.

    Components are shares of the expected size; those that are expected to be zero are in none.
    Of several directions, as many components as there are directions stand in one of them each,
    so that they are as simple as can be. `learned` is that of `learned_of`, shape `(6, 6)`.
    """
    from scipy.linalg import qr

    known = expected.variances > 0.0
    values, vectors = np.linalg.eigh(learned[np.ix_(known, known)])
    unobservable = vectors[:, values < OBSERVABLE]
    if not unobservable.size:
        return ()
    pivots = qr(unobservable.T, mode="r", pivoting=True)[1][: unobservable.shape[1]]
    simple = unobservable @ np.linalg.inv(unobservable[np.sort(pivots)])
    found = np.zeros((6, unobservable.shape[1]))
    found[known] = simple / np.linalg.norm(simple, axis=0)
    return tuple(found.T)


def name_of(direction: Array) -> str:
    """A direction `(6,)` for people to read, such as `moment about the axis (−1, 1, 0)`."""
    sizes = np.abs(direction)
    sign = np.sign(direction[np.argmax(sizes)])
    named = np.where(sizes > MINOR_COMPONENT * sizes.max(), sign * direction, 0.0).reshape(2, 3)
    parts = []
    for kind, axis in zip(KINDS, named, strict=True):
        if np.count_nonzero(axis) == 1:
            minus = "−" if axis.sum() < 0.0 else ""
            parts.append(f"{kind} {minus}{'xyz'[int(np.argmax(np.abs(axis)))]}")
        elif axis.any():
            figures = (f"{one:.2g}" for one in axis / np.abs(axis).max() + 0.0)
            parts.append(f"{kind} the axis ({', '.join(figures)})".replace("-", "−"))
    return " with ".join(parts)


SIMULTANEOUS = 2.795
"""Half-width of 95 % intervals of three components at once, over their standard deviation: the root
of the 95 % quantile of a chi-square variable with three degrees of freedom."""

BISECTIONS = 50  # of the search for the largest force of a region
EQUAL_RATES_TOLERANCE = 1e-6  # relative difference up to which rates are one


@dataclass(frozen=True, eq=False)
class WrenchEstimate:
    """External wrench along a run; `t` is `(N,)`, wrenches `(N, 6)` are force [N] and moment [Nm].

    The wrench is what the surroundings exert on the robot, its moment about the frame's origin.
    """

    run: str
    frame: str
    axes: methods.Axes
    residual: ResidualKind
    method: str
    expected: methods.Expected
    bandwidth: float  # of the low-pass of the efforts [Hz]
    joints: tuple[str, ...]
    units: tuple[str, ...]
    t: Array  # time from the log's start [s]
    wrench: Array
    half_width: Array
    # half-width of 95 % intervals of the force along its own direction, shape `(N,)` [N];
    # simultaneous ones, as the direction is estimated too [Scheffe1959]
    force_half_width: Array
    # largest size of a force in the simultaneous region, shape `(N,)` [N]: what is not observable
    # along other directions counts
    force_upper: Array
    torque: Array  # external efforts, shape `(N, n)` [Nm; N]
    torque_half_width: Array  # half-width of 95 % intervals of efforts that nothing external makes
    # share of the expected variance that efforts remove, along the direction in which they remove
    # least, 0 to 1, shape `(N,)`
    least_data_share: Array
    learned: Array  # see `learned_of`, shape `(N, 6, 6)`
    condition: Array  # condition number of the Jacobian, shape `(N,)`

    @property
    def force(self) -> Array:
        """Size of the force, shape `(N,)` [N]."""
        return np.asarray(np.linalg.norm(self.wrench[:, :3], axis=1))

    @property
    def force_lower(self) -> Array:
        """Least size of the force in the simultaneous region, shape `(N,)` [N]."""
        return np.maximum(self.force - self.force_half_width, 0.0)

    @property
    def force_observable(self) -> NDArray[np.bool_]:
        """Whether every direction of the force is observable, shape `(N,)`."""
        return np.asarray(np.linalg.eigvalsh(self.learned[:, :3, :3])[:, 0] >= OBSERVABLE)

    @property
    def pushed(self) -> NDArray[np.bool_]:
        """Whether the force differs from zero, shape `(N,)`."""
        return self.force > self.force_half_width

    @property
    def largest(self) -> int:
        """Sample of the largest force: of those that differ from zero, if any does."""
        return int(np.argmax(np.where(self.pushed | ~self.pushed.any(), self.force, 0.0)))

    @property
    def data_share(self) -> Array:
        """Share of the expected variance that efforts remove, of each component, `(N, 6)`."""
        return np.diagonal(self.learned, axis1=1, axis2=2)

    @property
    def assumed_zero(self) -> NDArray[np.bool_]:
        """Components that are zero by assumption, shape `(6,)`."""
        zero = self.expected.variances == 0.0
        return np.asarray(zero & (self.method != methods.InverseJacobian.name))

    @property
    def unobservable(self) -> tuple[Array, ...]:
        """Directions that are not observable over the run; see `unobservable_directions`."""
        return unobservable_directions(self.learned.mean(axis=0), self.expected)

    def unobservable_share(self, direction: Array) -> float:
        """Share of the samples at which a direction of `unobservable` is not observable."""
        return float(np.mean(direction @ self.learned @ direction < OBSERVABLE))

    @property
    def partly_unobservable(self) -> float:
        """Share of the samples at which some direction is not observable."""
        return float(np.mean(self.least_data_share < OBSERVABLE))


WHITE_NOISE_SHARE = 0.5
"""Share of the fit's residual variance that is noise. Slow residuals are given all of it too, with
what left-out motion and the dead zone add: on a UR10e on other days most of it is slow."""

LONGEST_STRETCH = 120.0  # longest stretch along which the model's errors are the same [s]


def external_efforts(
    identified: IdentifiedModel, run: Run, quantity: Quantity, residual: ResidualKind, cutoff: float
) -> Iterator[tuple[Array, methods.ExternalEfforts]]:
    """Time and external efforts of stretches without gaps, of at most `LONGEST_STRETCH`.

    They are behind a low-pass [Hz], at twice its cut-off or faster.
    """
    uncertainty = identified.effort_uncertainty(noise_bandwidth(cutoff))
    every = max(1, int(run.rate / (2.0 * cutoff)))
    blocks = blocks_with_channels(run.blocks(), identified.model)
    split, compiled = TorqueSplit(identified.valued), identified.model.compiled(quantity)
    values = identified.valued.values.values[compiled.columns]
    for _, of_segment in groupby(blocks, key=lambda block: block.segment):
        full, kept, start = [], [], 0
        for block in of_segment:
            channels = np.empty((0, len(block.t))) if block.channels is None else block.channels
            entries = compiled.code((block.q, block.dq, block.ddq, channels, values))
            observed = methods.Observed.of(entries.T, identified.robot.n)
            speed = np.abs(block.dq)
            noise = uncertainty.noise(speed, block.moving)
            full.append((*_driven(identified, block, observed, split, residual), noise))
            at = slice(-start % every, None, every)
            spread = uncertainty.spread(observed.columns[at], speed[:, at], block.moving[:, at])
            kept.append((block.t[at], observed.jacobian[at].copy(), spread))
            start += len(block.t)
        first, driven, noise = (np.concatenate(some) for some in zip(*full, strict=True))
        raw = first - driven
        if residual == "momentum":
            raw = momentum_residual(first, driven, run.rate)
        t, jacobian, spread = (np.concatenate(some) for some in zip(*kept, strict=True))
        noise = np.maximum(noise, zero_phase(noise, cutoff, run.rate))[::every]
        efforts = methods.ExternalEfforts(
            step=every / run.rate,
            torque=zero_phase(raw, cutoff, run.rate)[::every],
            jacobian=jacobian,
            spread=spread,
            slow=noise,
            noise=np.sqrt(WHITE_NOISE_SHARE) * np.minimum(noise, uncertainty.sigma),
            correlation=uncertainty.correlation,
            per_independent=run.rate / every / (2.0 * noise_bandwidth(cutoff)),
        )
        count = -(-len(t) * every // int(LONGEST_STRETCH * run.rate + 1))
        for inside in np.array_split(np.arange(len(t)), count):
            chosen = slice(int(inside[0]), int(inside[-1]) + 1)
            yield t[chosen], efforts.part(chosen)


def _driven(
    identified: IdentifiedModel,
    block: Block,
    observed: methods.Observed,
    split: TorqueSplit,
    residual: ResidualKind,
) -> tuple[Array, Array]:
    """Predicted and measured efforts, or the momentum and what changes it, `(N, n)` each."""
    predicted = split.block(block)
    at_rest = predicted[FRICTION] * ~(block.moving | identified.model.has_memory)
    effort = (block.effort * identified.signals.gains[:, None] + at_rest).T
    if residual == "torque":
        return predicted.sum(axis=0).T, effort
    return observed.momentum.copy(), effort + observed.drive


def estimated_wrench(
    identified: IdentifiedModel,
    run: Run,
    frame: str | None = None,
    *,
    residual: ResidualKind | None = None,
    method: WrenchMethod | None = None,
    bandwidth: float | None = None,
    axes: methods.Axes = "frame",
    window: tuple[float, float] = (-np.inf, np.inf),
    progress: Progress = silent,
) -> WrenchEstimate:
    """Estimate the external wrench along a run, from its first to its last row in a window [s].

    `Smoothed` for the usual size by default, on the frame of the robot's end. The bandwidth of
    the efforts [Hz] is by default the cut-off of the model's scores, or a tenth of the log's rate
    if that is less.
    """
    place = methods.moved_frame(identified.robot, frame)
    base = identified.signals.base
    if run.has_unknown_forces:
        what = "contacts" if base is not None and base.touches else "what holds the base"
        raise ModelError(
            f"forces of {what} are not measured, and a wrench is what known ones leave over",
            where="[signals.base] of the model's robot file",
            fix="identify the model from logs with measured forces: force = ... under "
            "[[signals.base.contacts]]",
        )
    chosen = _bandwidth(identified, run, bandwidth)
    whole = replace(run, span=(-np.inf, np.inf))
    if residual == "momentum":
        refuse_floating(identified.robot, "the momentum of external torques")
    residual = residual or ("torque" if identified.robot.floating else "momentum")
    sigma = np.asarray(identified.estimate.sigma)
    method = Smoothed() if method is None else method
    pushes = _expected_efforts(identified, whole, method.expected)
    refuse_other_efforts(residual_trace(identified, run, chosen), sigma, identified.joints, pushes)
    quantity = methods.observed_quantity(place, axes, identified.base.independent)
    parts = []
    expected, length = method.expected, sum(s.samples for s in whole.segments) / run.rate
    known, done = expected.variances > 0.0, 0.0
    for t, efforts in external_efforts(identified, whole, quantity, residual, chosen):
        report_progress(progress, "estimating the wrench", done, length)
        found = method(efforts)
        done += len(t) * efforts.step
        part = {
            "t": t,
            "wrench": found.values,
            "half_width": _half_width(found.covariance),
            "force_half_width": _force_half_width(found),
            "force_upper": largest_size(found.values[:, :3], found.covariance[:, :3, :3]),
            "torque": efforts.torque,
            "torque_half_width": _half_width(efforts.covariance),
            "least_data_share": np.linalg.eigvalsh(found.learned[:, known][:, :, known])[:, 0],
            "learned": found.learned,
            "condition": methods.condition_numbers(efforts.jacobian),
        }
        inside = (t >= window[0]) & (t < window[1])  # the run has context around it
        parts.append({name: values[inside] for name, values in part.items()})
    return WrenchEstimate(
        run=run.name,
        frame=place.name,
        axes=axes,
        residual=residual,
        method=method.name,
        expected=expected,
        bandwidth=chosen,
        joints=identified.joints,
        units=identified.robot.effort_units,
        **{name: np.concatenate([part[name] for part in parts]) for name in parts[0]},
    )


def _expected_efforts(identified: IdentifiedModel, run: Run, expected: methods.Expected) -> Array:
    """Standard deviation of what wrenches of the expected size make on the robot's end, `(n,)`.

    In Nm or N, along a run; a wrench on another frame makes less.
    """
    frame = methods.moved_frame(identified.robot, None).name
    q = np.concatenate([block.q[:, :: max(1, int(run.rate))].T for block in run.blocks()])
    jacobian = identified.jacobian(q, frame)
    squares = np.einsum("tij,i,tij->j", jacobian, expected.variances, jacobian)
    return np.asarray(np.sqrt(squares / len(q)))


def _half_width(covariance: Array) -> Array:
    return np.asarray(Z95 * np.sqrt(np.maximum(np.diagonal(covariance, axis1=1, axis2=2), 0.0)))


def _force_half_width(found: methods.Wrenches) -> Array:
    """See `WrenchEstimate.force_half_width`; of a force of zero, the widest."""
    force, covariance = found.values[:, :3], found.covariance[:, :3, :3]
    square = np.sum(np.square(force), axis=1)
    along = np.einsum("ti,tij,tj->t", force, covariance, force)
    widest = np.linalg.eigvalsh(covariance)[:, -1]
    variance = np.divide(along, square, out=widest, where=square > 0.0)
    return np.asarray(SIMULTANEOUS * np.sqrt(np.maximum(variance, 0.0)))


def largest_size(force: Array, covariance: Array) -> Array:
    r"""Upper ends of simultaneous 95 % intervals of sizes of forces, `(N, 3)` to `(N,)` [N].

    The largest $|F|$ of $(F - \hat F)^T C^{-1} (F - \hat F) \le k^2$ with covariances $C$,
    `(N, 3, 3)`, is the root of the least $\mu + \sum_i \mu f_i^2 / (\mu - a_i^2)$ over
    $\mu > a_i^2$, with components $f_i$ of $\hat F$ along principal axes, and half-axes $a_i$.
    """
    values, vectors = np.linalg.eigh(covariance)
    axes = SIMULTANEOUS**2 * np.maximum(values, 0.0)
    along = np.square(np.einsum("ti,tij->tj", force, vectors))

    def over(numerator: Array, mu: Array, power: int) -> Array:
        rest = (mu[:, None] - axes) ** power
        parts = np.divide(numerator, rest, out=np.zeros_like(rest), where=rest > 0.0)
        return np.asarray(parts.sum(axis=1))

    low = axes[:, -1]
    high = np.square(np.sqrt(low) + np.linalg.norm(force, axis=1))
    for _ in range(BISECTIONS):
        mu = 0.5 * (low + high)
        falls = over(along * axes, mu, 2) > 1.0
        low, high = np.where(falls, mu, low), np.where(falls, high, mu)
    return np.asarray(np.sqrt(high * (1.0 + over(along, high, 1))))


def _bandwidth(identified: IdentifiedModel, run: Run, requested: float | None) -> float:
    if requested is None:
        return min(identified.cutoffs.score, run.rate / PER_PERIOD)
    check_bandwidth(requested)
    need = FORGOTTEN / (2.0 * np.pi * requested)
    longest = max(segment.samples for segment in run.segments) / run.rate
    if longest < need:
        raise DataError(
            f"the log has {longest:.3g} s without a gap, too short for a bandwidth of "
            f"{requested:g} Hz (--bandwidth)",
            where=run.name,
            fix=f"choose a bandwidth of at least {FORGOTTEN / (2.0 * np.pi * longest):.2g} Hz, or "
            f"log for {need:.3g} s or more",
        )
    if run.rate < (1.0 - EQUAL_RATES_TOLERANCE) * PER_PERIOD * requested:
        raise DataError(
            f"samples at {run.rate:g} Hz are too few for a bandwidth of {requested:g} Hz",
            where=run.name,
            fix=f"log at {PER_PERIOD * requested:g} Hz or more, or choose a bandwidth of at most "
            f"{run.rate / PER_PERIOD:g} Hz",
        )
    return requested
