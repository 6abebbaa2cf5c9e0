"""The external wrench along a run, with intervals and the directions that efforts do not show."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array
from steelyard.base.errors import DataError
from steelyard.base.progress import Progress, report_progress, silent
from steelyard.estimate.estimate import Z95
from steelyard.estimate.external.effort_to_wrench import (
    Expected,
    InverseJacobian,
    Wrenches,
    WrenchMethod,
    condition_numbers,
)
from steelyard.estimate.external.observer import PER_PERIOD, check_bandwidth
from steelyard.estimate.external.observer_program import Axes, moved_frame, observed_quantity
from steelyard.estimate.identified import IdentifiedModel
from steelyard.estimate.scores.residuals import FORGOTTEN, residual_trace
from steelyard.runs.run import Run
from steelyard.uses.other_efforts import refuse_other_efforts
from steelyard.uses.wrench.external_efforts import EffortSource, ResidualKind
from steelyard.uses.wrench.wrench_smoothing import OBSERVABLE, Smoothed

COMPONENTS = (
    "force along x", "force along y", "force along z",
    "moment about x", "moment about y", "moment about z",
)  # fmt: skip

KINDS = ("force along", "moment about")

MINOR_COMPONENT = 0.3
"""Share of a direction's largest component below which another one is not named."""


def unobservable_directions(learned: Array, expected: Expected) -> tuple[Array, ...]:
    """Directions with less than `OBSERVABLE` from data, each of shape `(6,)` and length 1.

    Components are shares of the expected size. Of several directions, as many components as
    there are directions stand in one of them each, so that they are as simple as can be.

    Args:
        learned: See `learned_of`, shape `(6, 6)`.
        expected: What was expected; components that are expected to be zero are in no direction.
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
    """A direction for people to read, such as `moment about the axis (−1, 1, 0)`.

    Args:
        direction: Shares of the expected size, shape `(6,)`.
    """
    sizes = np.abs(direction)
    sign = np.sign(direction[np.argmax(sizes)])
    named = np.where(sizes > MINOR_COMPONENT * sizes.max(), sign * direction, 0.0).reshape(2, 3)
    parts = [_axis_name(kind, axis) for kind, axis in zip(KINDS, named, strict=True) if axis.any()]
    return " with ".join(parts)


def _axis_name(kind: str, axis: Array) -> str:
    """A force or moment along an axis; coordinates are relative to the largest, shape `(3,)`."""
    if np.count_nonzero(axis) == 1:
        sign = "−" if axis.sum() < 0.0 else ""
        return f"{kind} {sign}{'xyz'[int(np.argmax(np.abs(axis)))]}"
    figures = (f"{one:.2g}" for one in axis / np.abs(axis).max() + 0.0)
    return f"{kind} the axis ({', '.join(figures)})".replace("-", "−")


SIMULTANEOUS = 2.795
"""Half-width of 95 % intervals of three components at once, over their standard deviation: the root
of the 95 % quantile of a chi-square variable with three degrees of freedom."""

EQUAL_RATES_TOLERANCE = 1e-6
"""Relative difference up to which rates are one."""


@dataclass(frozen=True, eq=False)
class WrenchEstimate:
    """External wrench along a run; `t` is `(N,)`, wrenches `(N, 6)` are force [N] and moment [Nm].

    The wrench is what the surroundings exert on the robot, its moment about the frame's origin.

    Attributes:
        run: The run's name.
        frame: The frame.
        axes: Whose axes the components are along.
        residual: What external efforts were computed from.
        method: How the wrench was.
        expected: Expected size of wrenches.
        bandwidth: Of the low-pass of the efforts [Hz].
        joints: Names of the joints.
        units: Units of their efforts.
        t: Time from the log's start [s].
        wrench: Force and moment.
        half_width: Half-width of their 95 % intervals.
        force_half_width: Half-width of 95 % intervals of the force along its own direction, shape
            `(N,)` [N]; simultaneous ones, as the direction is estimated too [Scheffe1959].
        torque: External efforts, shape `(N, n)` [Nm; N].
        torque_half_width: Half-width of 95 % intervals of efforts that nothing external makes.
        least_data_share: Share of the expected variance that efforts remove, along the direction
            in which they remove least, 0 to 1, shape `(N,)`.
        learned: See `learned_of`, shape `(N, 6, 6)`.
        condition: Condition number of the Jacobian, shape `(N,)`.
    """

    run: str
    frame: str
    axes: Axes
    residual: ResidualKind
    method: str
    expected: Expected
    bandwidth: float
    joints: tuple[str, ...]
    units: tuple[str, ...]
    t: Array
    wrench: Array
    half_width: Array
    force_half_width: Array
    torque: Array
    torque_half_width: Array
    least_data_share: Array
    learned: Array
    condition: Array

    @property
    def force(self) -> Array:
        """Size of the force, shape `(N,)` [N]."""
        return np.asarray(np.linalg.norm(self.wrench[:, :3], axis=1))

    @property
    def pushed(self) -> NDArray[np.bool_]:
        """Whether the force differs from zero, shape `(N,)`."""
        return self.force > self.force_half_width

    @property
    def largest(self) -> int:
        """Sample of the largest force: of those that differ from zero, if any does."""
        counted = self.pushed if self.pushed.any() else np.ones_like(self.pushed)
        return int(np.argmax(np.where(counted, self.force, 0.0)))

    @property
    def data_share(self) -> Array:
        """Share of the expected variance that efforts remove, of each component, `(N, 6)`."""
        return np.diagonal(self.learned, axis1=1, axis2=2)

    @property
    def assumed_zero(self) -> NDArray[np.bool_]:
        """Components that are zero by assumption, shape `(6,)`."""
        zero = self.expected.variances == 0.0
        return np.asarray(zero & (self.method != InverseJacobian.name))

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


def estimated_wrench(
    identified: IdentifiedModel,
    run: Run,
    frame: str | None = None,
    *,
    residual: ResidualKind = "momentum",
    method: WrenchMethod | None = None,
    bandwidth: float | None = None,
    axes: Axes = "frame",
    progress: Progress = silent,
) -> WrenchEstimate:
    """Estimate the external wrench along a run, from its first to its last row.

    Args:
        identified: The model.
        run: The run.
        frame: Frame that the wrench acts on; that of the robot's end if `None`.
        residual: What external efforts are computed from.
        method: From efforts to the wrench; `Smoothed` for the usual size if `None`.
        bandwidth: Of the low-pass of the efforts [Hz]; if `None`, the cut-off of the model's
            scores, or a tenth of the log's rate if that is less.
        axes: Whose axes components are along.
        progress: Told how far the estimate is.

    Raises:
        ModelError: There is no such frame, or no joint moves it.
        DataError: The log's rate is less than ten times the bandwidth, or the log is too short for
            it.
        LogError: The efforts lack gravity or friction that the model predicts, or the model does
            not explain them; see `refuse_other_efforts`.
        Stopped: `progress` requested a stop.
    """
    place = moved_frame(identified.robot, frame)
    chosen = _bandwidth(identified, run, bandwidth)
    whole = replace(run, span=(-np.inf, np.inf))
    sigma = np.asarray(identified.estimate.sigma)
    method = Smoothed() if method is None else method
    pushes = _expected_efforts(identified, whole, method.expected)
    refuse_other_efforts(residual_trace(identified, run, chosen), sigma, identified.joints, pushes)
    quantity = observed_quantity(place, axes, identified.base.independent)
    source = EffortSource(identified, quantity, residual, chosen)
    parts = []
    expected, length = method.expected, sum(s.samples for s in whole.segments) / run.rate
    known, done = expected.variances > 0.0, 0.0
    for stretch in source.stretches(whole):
        report_progress(progress, "estimating the wrench", done, length)
        efforts, found = stretch.efforts, method(stretch.efforts)
        done += len(stretch.t) * efforts.step
        parts.append(
            (
                stretch.t,
                found.values,
                _half_width(found.covariance),
                _force_half_width(found),
                efforts.torque,
                _half_width(efforts.covariance),
                np.linalg.eigvalsh(found.learned[:, known][:, :, known])[:, 0],
                found.learned,
                condition_numbers(efforts.jacobian),
            )
        )
    t, wrench, half, force_half, torque, torque_half, least, learned, condition = (
        np.concatenate(some) for some in zip(*parts, strict=True)
    )
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
        t=t,
        wrench=wrench,
        half_width=half,
        force_half_width=force_half,
        torque=torque,
        torque_half_width=torque_half,
        least_data_share=least,
        learned=learned,
        condition=condition,
    )


def _expected_efforts(identified: IdentifiedModel, run: Run, expected: Expected) -> Array:
    """Standard deviation of what wrenches of the expected size make on the robot's end, `(n,)`.

    In Nm or N, along a run; a wrench on another frame makes less.
    """
    frame = moved_frame(identified.robot, None).name
    q = np.concatenate([block.q[:, :: max(1, int(run.rate))].T for block in run.blocks()])
    jacobian = identified.jacobian(q, frame)
    squares = np.einsum("tij,i,tij->j", jacobian, expected.variances, jacobian)
    return np.asarray(np.sqrt(squares / len(q)))


def _half_width(covariance: Array) -> Array:
    diagonal = np.diagonal(covariance, axis1=1, axis2=2)
    return np.asarray(Z95 * np.sqrt(np.maximum(diagonal, 0.0)))


def _force_half_width(found: Wrenches) -> Array:
    """See `WrenchEstimate.force_half_width`; of a force of zero, the widest."""
    force, covariance = found.values[:, :3], found.covariance[:, :3, :3]
    square = np.sum(np.square(force), axis=1)
    along = np.einsum("ti,tij,tj->t", force, covariance, force)
    widest = np.linalg.eigvalsh(covariance)[:, -1]
    variance = np.divide(along, square, out=widest, where=square > 0.0)
    return np.asarray(SIMULTANEOUS * np.sqrt(np.maximum(variance, 0.0)))


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
