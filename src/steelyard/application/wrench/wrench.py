"""The external wrench along a run, with intervals and what efforts do not show of it."""

from dataclasses import dataclass, replace

import numpy as np

from steelyard.application.other_efforts import refuse_without
from steelyard.application.wrench.directions import unobservable_directions
from steelyard.application.wrench.efforts import EffortSource, ResidualKind
from steelyard.arrays import Array
from steelyard.errors import DataError
from steelyard.estimation.estimate import Z95
from steelyard.estimation.external.momentum import PER_PERIOD, check_bandwidth
from steelyard.estimation.external.observed import Axes, moved_frame, observed_quantity
from steelyard.estimation.external.smoothing import OBSERVABLE, Smoothed
from steelyard.estimation.external.wrench import Expected, WrenchMethod, condition_numbers
from steelyard.estimation.identified import IdentifiedModel
from steelyard.measurement.run import Run
from steelyard.progress import Progress, silent, tell
from steelyard.validation.residual_traces import residual_trace

EXACT = 1e-6
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
        torque: External efforts, shape `(N, n)` [Nm; N].
        torque_half_width: Half-width of 95 % intervals of efforts that nothing external makes.
        least_data_share: Share of the expected variance that efforts remove, along the direction
            in which they remove least, 0 to 1, shape `(N,)`.
        data_share: The same of each component, shape `(N, 6)`.
        learned: Mean over time of `learned_of`, shape `(6, 6)`.
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
    torque: Array
    torque_half_width: Array
    least_data_share: Array
    data_share: Array
    learned: Array
    condition: Array

    @property
    def unobservable(self) -> tuple[Array, ...]:
        """Directions that are not observable over the run; see `unobservable_directions`."""
        return unobservable_directions(self.learned, self.expected)

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
        DataError: The log's rate is less than ten times the bandwidth.
        LogError: The efforts lack gravity or friction that the model predicts.
        Stopped: `progress` requested a stop.
    """
    place = moved_frame(identified.robot, frame)
    chosen = _bandwidth(identified, run, bandwidth)
    whole = replace(run, span=(-np.inf, np.inf))
    refuse_without(residual_trace(identified, run, chosen), np.asarray(identified.estimate.sigma))
    method = Smoothed() if method is None else method
    quantity = observed_quantity(place, axes, identified.base.independent)
    source = EffortSource(identified, quantity, residual, chosen)
    parts, learned = [], np.zeros((6, 6))
    expected, length = method.expected, sum(s.samples for s in whole.segments) / run.rate
    known, done = expected.variances > 0.0, 0.0
    for stretch in source.stretches(whole):
        tell(progress, "estimating the wrench", done, length)
        efforts, found = stretch.efforts, method(stretch.efforts)
        learned += found.learned.sum(axis=0)
        done += len(stretch.t) * efforts.step
        parts.append(
            (
                stretch.t,
                found.values,
                _half_width(found.covariance),
                efforts.torque,
                _half_width(efforts.covariance),
                np.linalg.eigvalsh(found.learned[:, known][:, :, known])[:, 0],
                np.diagonal(found.learned, axis1=1, axis2=2),
                condition_numbers(efforts.jacobian),
            )
        )
    t, wrench, half, torque, torque_half, least, data_share, condition = (
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
        torque=torque,
        torque_half_width=torque_half,
        least_data_share=least,
        data_share=data_share,
        learned=learned / len(t),
        condition=condition,
    )


def _half_width(covariance: Array) -> Array:
    diagonal = np.diagonal(covariance, axis1=1, axis2=2)
    return np.asarray(Z95 * np.sqrt(np.maximum(diagonal, 0.0)))


def _bandwidth(identified: IdentifiedModel, run: Run, requested: float | None) -> float:
    if requested is None:
        return min(identified.cutoffs.score, run.rate / PER_PERIOD)
    check_bandwidth(requested)
    if run.rate < (1.0 - EXACT) * PER_PERIOD * requested:
        raise DataError(
            f"samples at {run.rate:g} Hz are too few for a bandwidth of {requested:g} Hz",
            where=run.name,
            fix=f"log at {PER_PERIOD * requested:g} Hz or more, or choose a bandwidth of at most "
            f"{run.rate / PER_PERIOD:g} Hz",
        )
    return requested
