r"""Errors that can be compared between runs and models, in the effort of the joints.

Error and measured effort go through one low-pass of fixed cut-off, whatever the model was fitted
with, and count where the joint moves; in a log in which no joint moves, everywhere. The error of
a joint is related to its effort limit, and to the effort it used: the root mean square measured in
the log, but at least a quarter of that in the fitted runs, so that the relative error of a joint
with hardly any load in this log is not one of noise and stiction alone. Over joints and runs,
errors and references are pooled as root mean squares of all samples that count.

Where scales of the logged efforts were estimated, an error is computed twice: with the logged
efforts divided by the scales, and as logged, which is what the torque of the model is off from
efforts that are read with the gains of the robot file alone.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from math import isclose, sqrt
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array, finite_json
from steelyard.estimate.identified import BAND

if TYPE_CHECKING:
    from steelyard.estimate.identified import IdentifiedModel
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


@dataclass(frozen=True)
class JointError:
    """Error of one joint in the fixed band.

    Attributes:
        counted: Whether these are the samples where the joint moves, or all of a log in which no
            joint moves. Otherwise the joint rests while others move, but for 2 % of the longest
            time that any of them does, and is not pooled.
    """

    joint: str
    unit: str  # `Nm` or `N` at the joint; the logged unit where no drive gain is known
    samples: int  # number of samples it is computed from
    counted: bool
    error: float  # root mean square of measured minus predicted effort
    used: float  # root mean square of the measured effort
    least: float = 0.0  # least reference of the error, from the fitted runs
    limit: float | None = None  # greatest effort of the joint; `None` where unknown

    @property
    def reference(self) -> float:
        """The used effort that the error is related to."""
        return max(self.used, self.least)

    @property
    def percent_of_used(self) -> float:
        """The error relative to the used effort [%]."""
        return _percent(self.error, self.reference)

    @property
    def percent_of_limit(self) -> float | None:
        """The error relative to the effort limit [%]; `None` where that is unknown."""
        return None if self.limit is None else _percent(self.error, self.limit)

    def to_dict(self) -> dict[str, Any]:
        """As JSON values."""
        figures = {
            "joint": self.joint,
            "unit": self.unit,
            "moving": self.counted,
            "error": self.error,
            "used": self.used,
            "limit": self.limit,
            "percent_of_used": self.percent_of_used,
            "percent_of_limit": self.percent_of_limit,
        }
        return dict(finite_json(figures))


@dataclass(frozen=True)
class BandErrors:
    """Errors of all joints of one run in the fixed band."""

    cutoff: float  # of the low-pass on both sides [Hz]
    at_rest: bool  # whether no joint moves in the run
    joints: tuple[JointError, ...]
    as_logged: tuple[JointError, ...] = ()  # against efforts not divided by estimated scales

    def to_dict(self) -> dict[str, Any]:
        """As JSON values."""
        return {
            "cutoff": self.cutoff,
            "at_rest": self.at_rest,
            "joints": [joint.to_dict() for joint in self.joints],
            "pooled": [one.to_dict() for one in pooled([self])],
            "as_logged": {
                "joints": [joint.to_dict() for joint in self.as_logged],
                "pooled": [one.to_dict() for one in pooled(as_logged([self]))],
            }
            if self.as_logged
            else None,
        }


@dataclass(frozen=True)
class PooledError:
    """Error over all joints with efforts of one unit, and over runs."""

    unit: str
    joints: int  # number of joints that count in some run
    error: float
    reference: float  # root mean square of the used efforts
    limit: float | None  # root mean square of the effort limits; `None` unless all are known

    @property
    def percent_of_used(self) -> float:
        """The error relative to the used efforts [%]."""
        return _percent(self.error, self.reference)

    @property
    def percent_of_limit(self) -> float | None:
        """The error relative to the effort limits [%]; `None` where these are unknown."""
        return None if self.limit is None else _percent(self.error, self.limit)

    def to_dict(self) -> dict[str, Any]:
        """As JSON values."""
        names = ("unit", "error", "percent_of_used", "percent_of_limit")
        return {name: finite_json(getattr(self, name)) for name in names}


def pooled(runs: Iterable[BandErrors]) -> tuple[PooledError, ...]:
    """Errors of all runs together, one per unit of effort."""
    counted = [joint for run in runs for joint in run.joints if joint.counted]
    units = dict.fromkeys(joint.unit for joint in counted)
    return tuple(_pooled(unit, [j for j in counted if j.unit == unit]) for unit in units)


def as_logged(runs: Iterable[BandErrors]) -> list[BandErrors]:
    """The runs with their errors against efforts as logged; none without estimated scales."""
    return [replace(run, joints=run.as_logged, as_logged=()) for run in runs if run.as_logged]


def _pooled(unit: str, joints: Sequence[JointError]) -> PooledError:
    samples = np.array([joint.samples for joint in joints], dtype=np.float64)

    def root_mean_square(values: Sequence[float]) -> float:
        return float(np.sqrt(np.average(np.square(values), weights=samples)))

    limits = [joint.limit for joint in joints if joint.limit is not None]
    return PooledError(
        unit,
        len({joint.joint for joint in joints}),
        root_mean_square([joint.error for joint in joints]),
        root_mean_square([joint.reference for joint in joints]),
        root_mean_square(limits) if len(limits) == len(joints) else None,
    )


def band_of(reference: EffortReference, rate: float) -> float:
    """The cut-off for a log of a rate: the fixed one, or the highest that the rate allows [Hz]."""
    return min(reference.cutoff, FASTEST * rate)


def band_errors(
    run: Run,
    names: Sequence[tuple[str, str]],
    gains: Array,
    reference: EffortReference,
    sums: tuple[Array, int],
    sums_moving: tuple[Array, Array],
    scales: Sequence[float] = (),
) -> BandErrors:
    """Errors of a run from sums of squares in the fixed band.

    Args:
        run: The run.
        names: Name and unit of effort [Nm; N] of each joint.
        gains: Joint effort per logged unit, shape `(n,)`.
        reference: What errors are related to.
        sums: Sums of squares of error and measured effort over all samples, shape `(2, n)`, in
            logged units; number of samples.
        sums_moving: The same where each joint moves; numbers of samples, shape `(n,)`.
        scales: Estimated scales that the gains contain and the errors shall not, one per joint.
    """
    moving = joints_moving(sums_moving[1])
    at_rest = not moving.any()
    all_known = gains_known(run.effort_units, gains, reference.scales)
    joints = []
    for j, (name, unit) in enumerate(names):
        known, moves = all_known[j], bool(moving[j])
        unscaled = scales[j] if scales and known else 1.0
        scale = unscaled * abs(float(gains[j])) if known else 1.0
        some, samples = (sums_moving[0], int(sums_moving[1][j])) if moves else sums
        error, used = (scale * sqrt(float(x) / samples) for x in some[:, j])
        limit = reference.limit[j] if known and reference.limit else None
        least = LEAST_USED * unscaled * reference.fitted[j] if reference.fitted else 0.0
        shown, counts = unit if known else run.effort_units[j], moves or at_rest
        joints.append(JointError(name, shown, samples, counts, error, used, least, limit))
    return BandErrors(band_of(reference, run.rate), at_rest, tuple(joints))


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
    signals, robot = identified.signals, identified.model.robot
    known, scales = known_efforts(identified), identified.effort_scales
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
    scaled = () if scales is None else tuple(scales.values.tolist())
    return EffortReference(identified.cutoffs.headline, limits, fitted, scaled)


def known_efforts(identified: IdentifiedModel) -> tuple[bool, ...]:
    """Whether each effort that a model was identified from is known in Nm or N at the joint."""
    signals, scales = identified.signals, identified.effort_scales
    given = () if scales is None else tuple(scales.values.tolist())
    return gains_known(signals.effort_units, signals.gains, given)


def _percent(error: float, reference: float) -> float:
    if reference == 0.0:
        return 0.0 if error == 0.0 else float("inf")
    return 100.0 * error / reference
