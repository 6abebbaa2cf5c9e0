r"""Errors that can be compared between runs and models, in the effort of the joints.

Error and measured effort go through one low-pass of fixed cut-off, whatever the model was fitted
with, and count where the joint moves, by the log alone, whatever a fit left out; in a log in which
no joint moves, everywhere. The error of
a joint is related to its effort limit, and to the effort it used: the root mean square measured in
the log, but at least a quarter of that in the fitted runs, so that the relative error of a joint
with hardly any load in this log is not one of noise and stiction alone. Over joints and runs,
errors and references are pooled as root mean squares of all samples that count.

Where scales of the logged efforts were estimated, an error is computed twice: with the logged
efforts divided by the scales, and as logged, which is what the torque of the model is off from
efforts that are read with the gains of the robot file alone.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest
from math import isclose, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array, finite_json
from steelyard.estimate.identified_model import BAND, IdentifiedModel
from steelyard.robot.robot import Coordinate
from steelyard.runs.run import Run

FASTEST = 0.4  # highest cut-off, per sampling rate; it limits the band of logs slower than 12.5 Hz
LEAST_USED = 0.25  # least reference of an error, over the effort used in the fitted runs
SHORT = 0.02  # time that a joint moves, over the longest of all, up to which it does not count
PROMISED = 90.0  # share in 95 % bands [%] below which an unseen log has less than stated
PLACEHOLDER = 1.0  # gain of a current that only fixes a scale; `init` writes it


@dataclass(frozen=True)
class EffortReference:
    """What errors are related to; tuples have an entry per joint, or are empty."""

    cutoff: float = BAND  # of the low-pass on both sides [Hz]
    limit: tuple[float | None, ...] = ()  # greatest effort [Nm; N], `None` where unknown
    fitted: tuple[float, ...] = ()  # root mean square in the fitted runs, as `JointError`
    scales: tuple[float, ...] = ()  # estimated, in the gains: logged over model


@dataclass(frozen=True, kw_only=True)
class EffortError:
    """An error of efforts of one unit, over joints and runs, beside what it is related to."""

    unit: str  # `Nm` or `N` at the joint; the logged unit where no drive gain is known
    error: float  # root mean square of measured minus predicted effort
    used: float  # root mean square of the measured effort
    least: float = 0.0  # least reference of the error, from the fitted runs
    limit: float | None = None  # greatest effort, root mean square over joints; `None` if unknown
    counted: bool = True  # whether it is of joints that move, or of a log in which none does

    @property
    def reference(self) -> float:
        """The used effort that the error is related to."""
        return max(self.used, self.least)

    @property
    def percent_of_used(self) -> float:
        """The error relative to the used effort [%]."""
        return relative_percent(self.error, self.reference)

    @property
    def percent_of_limit(self) -> float | None:
        """The error relative to the effort limit [%]; `None` where that is unknown."""
        return None if self.limit is None else relative_percent(self.error, self.limit)

    def to_dict(self) -> dict[str, Any]:
        """As JSON values."""
        names = ("unit", "error", "percent_of_used", "percent_of_limit")
        return {name: finite_json(getattr(self, name)) for name in names}


@dataclass(frozen=True, kw_only=True)
class JointError(EffortError):
    """Error of one joint of one run in the fixed band.

    It is of the samples where the joint moves, or of all of a log in which no joint moves.
    Otherwise the joint rests while others move, but for 2 % of the longest time that any of them
    does, and is not pooled.
    """

    joint: str
    samples: int
    seconds: float  # time of these samples [s]
    driven: bool = True  # whether a motor drives it; else its effort is zero, and it is not pooled

    @property
    def percent_of_used(self) -> float:
        """The error relative to the used effort [%]; NaN of a joint without a motor."""
        return super().percent_of_used if self.driven else float("nan")

    @property
    def aside(self) -> str:
        """Why it is not pooled; empty if it is."""
        return "" if self.counted else "at rest" if self.driven else "no motor"

    def to_dict(self) -> dict[str, Any]:
        """As JSON values."""
        names = ("joint", "unit", "counted", "seconds", "error", "used", "limit")
        figures = {name.replace("counted", "moving"): getattr(self, name) for name in names}
        return dict(finite_json(figures) | super().to_dict())


@dataclass(frozen=True)
class BandErrors:
    """Errors of all joints of one run in the fixed band."""

    cutoff: float  # of the low-pass on both sides [Hz]
    at_rest: bool  # whether no joint moves in the run
    joints: tuple[JointError, ...]
    as_logged: tuple[JointError, ...] = ()  # against efforts not divided by estimated scales

    @property
    def pairs(self) -> list[tuple[JointError, JointError | None]]:
        """Each joint's error, and that as logged; `None` without estimated scales."""
        return list(zip_longest(self.joints, self.as_logged))

    def to_dict(self) -> dict[str, Any]:
        """As JSON values."""
        logged = [_joints_dict(one) for one in as_logged([self])]
        return {
            "cutoff": self.cutoff,
            "at_rest": self.at_rest,
            **_joints_dict(self),
            "as_logged": logged[0] if logged else None,
        }


def _joints_dict(errors: BandErrors) -> dict[str, Any]:
    return {
        "joints": [joint.to_dict() for joint in errors.joints],
        "pooled": [one.to_dict() for one in pooled([errors])],
    }


def pooled(runs: Iterable[BandErrors]) -> tuple[EffortError, ...]:
    """Errors of all runs together, one per unit of effort."""
    counted = [joint for run in runs for joint in run.joints if joint.counted]
    units = dict.fromkeys(joint.unit for joint in counted)
    return tuple(_pooled(unit, [j for j in counted if j.unit == unit]) for unit in units)


def as_logged(runs: Iterable[BandErrors]) -> list[BandErrors]:
    """The runs with their errors against efforts as logged; none without estimated scales."""
    return [replace(run, joints=run.as_logged, as_logged=()) for run in runs if run.as_logged]


def of_joints(runs: Sequence[BandErrors]) -> tuple[EffortError | None, ...]:
    """Error of each joint over runs; `None` of one that rests in all of them while others move."""
    own = (
        [replace(run, joints=(run.joints[number],)) for run in runs]
        for number in range(len(runs[0].joints) if runs else 0)
    )
    return tuple(next(iter(pooled(errors)), None) for errors in own)


def _pooled(unit: str, joints: Sequence[JointError]) -> EffortError:
    samples = np.array([joint.samples for joint in joints], dtype=np.float64)

    def root_mean_square(values: Sequence[float]) -> float:
        return float(np.sqrt(np.average(np.square(values), weights=samples)))

    limits = [joint.limit for joint in joints if joint.limit is not None]
    return EffortError(
        unit=unit,
        error=root_mean_square([joint.error for joint in joints]),
        used=root_mean_square([joint.reference for joint in joints]),
        limit=root_mean_square(limits) if len(limits) == len(joints) else None,
    )


def band_of(reference: EffortReference, rate: float) -> float:
    """The cut-off for a log of a rate: the fixed one, or the highest that the rate allows [Hz]."""
    return min(reference.cutoff, FASTEST * rate)


class Squares:
    """Sums of squares per joint: of the error, of the measured effort, of other models' errors.

    Over all samples and where each joint moves, shape `(2 + k, n)`; beside them sums of the
    absolute error, `(2, n)`, and numbers of samples, in motion `(n,)`.
    """

    def __init__(self) -> None:
        self.all = self.moving = self.sizes = np.zeros((2, 1))
        self.samples, self.samples_moving = 0, np.zeros(1)

    def add(self, efforts: Array, moving: NDArray[np.bool_]) -> None:
        """Measured and predicted efforts, and others that are predicted, `(2 + k, n, B)`."""
        measured, size = efforts[0], np.abs(efforts[0] - efforts[1])
        parts = np.square([measured - efforts[1], measured, *(measured - efforts[2:])])
        if not self.samples:
            self.all = self.moving = np.zeros(parts.shape[:2])
        self.all = self.all + parts.sum(axis=2)
        self.moving = self.moving + np.where(moving, parts, 0.0).sum(axis=2)
        self.sizes = self.sizes + [size.sum(axis=1), np.where(moving, size, 0.0).sum(axis=1)]
        self.samples += moving.shape[1]
        self.samples_moving = self.samples_moving + moving.sum(axis=1)


def band_errors(
    run: Run,
    coordinates: Sequence[Coordinate],
    gains: Array,
    reference: EffortReference,
    squares: Squares,
) -> BandErrors:
    """Errors of a run from sums of squares in the fixed band, in logged units.

    With estimated scales, the third row of the sums is of predicted efforts without them.
    """
    moving, unactuated = joints_moving(squares.samples_moving), run.recording.signals.unactuated
    at_rest, known = not moving.any(), gains_known(run.effort_units, gains, reference.scales)

    def of_joint(j: int, row: int, scale: float = 1.0) -> JointError:
        scale = scale if known[j] else 1.0
        unit = scale * abs(float(gains[j])) if known[j] else 1.0
        some, samples = squares.all, squares.samples
        if moving[j]:
            some, samples = squares.moving, int(squares.samples_moving[j])
        error, used = (unit * sqrt(float(x) / samples) for x in some[[row, 1], j])
        return JointError(
            joint=coordinates[j].name,
            unit=coordinates[j].effort_unit if known[j] else run.effort_units[j],
            samples=samples,
            seconds=samples / run.rate,
            counted=(bool(moving[j]) or at_rest) and j not in unactuated,
            driven=j not in unactuated,
            error=error,
            used=used,
            least=LEAST_USED * scale * reference.fitted[j] if reference.fitted else 0.0,
            limit=reference.limit[j] if known[j] and reference.limit else None,
        )

    joints = tuple(of_joint(j, 0) for j in range(len(gains)))
    logged = tuple(of_joint(j, 2, scale) for j, scale in enumerate(reference.scales))
    return BandErrors(band_of(reference, run.rate), at_rest, joints, logged)


def joints_moving(samples: Array) -> NDArray[np.bool_]:
    """Whether each joint counts as moving, by the samples in which it does, shape `(n,)`."""
    return samples > SHORT * float(np.max(samples, initial=0.0))


def gains_known(
    units: Sequence[str], gains: Array, scales: Sequence[float] = ()
) -> tuple[bool, ...]:
    """Whether each logged effort is known in Nm or N at the joint.

    One gain of 1 among those of currents fixes their common scale, which is then unknown; gains
    count without the estimated `scales` that they contain.
    """
    currents = [unit in ("A", "%") for unit in units]
    given = np.abs(gains * np.asarray(scales) if len(scales) else gains)
    relative = any(c and isclose(g, PLACEHOLDER) for c, g in zip(currents, given, strict=True))
    return tuple(not (current and relative) for current in currents)


def effort_reference(identified: IdentifiedModel) -> EffortReference:
    """What errors of an identified model are related to: its robot's limits and fitted runs."""
    signals, robot, known = identified.signals, identified.robot, known_efforts(identified)
    fitted: tuple[float, ...] = ()
    if identified.motions:
        efforts = np.concatenate([samples.effort for samples in identified.motions])
        scale = np.where(known, np.abs(signals.gains), 1.0)
        if len(efforts):
            fitted = tuple((scale * np.sqrt(np.mean(np.square(efforts), axis=0))).tolist())
    limits = tuple(
        one.limits.effort if ok and 0.0 < one.limits.effort < np.inf else None
        for one, ok in zip(robot.coordinates, known, strict=True)
    )
    return EffortReference(identified.cutoffs.headline, limits, fitted, _scales(identified))


def known_efforts(identified: IdentifiedModel) -> tuple[bool, ...]:
    """Whether each effort that a model was identified from is known in Nm or N at the joint."""
    signals = identified.signals
    return gains_known(signals.effort_units, signals.gains, _scales(identified))


def _scales(identified: IdentifiedModel) -> tuple[float, ...]:
    scales = identified.effort_scales
    return () if scales is None else tuple(scales.values.tolist())


def relative_percent(error: float, reference: float) -> float:
    """An error relative to an effort [%]; of one that is zero, any error is infinite."""
    if reference == 0.0:
        return 0.0 if error == 0.0 else float("inf")
    return 100.0 * error / reference
