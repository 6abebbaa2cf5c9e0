"""The choices of the processing chain, its methods by the names they have in files; cut-offs.

The window of a filter is what holds the samples of its response to a single one that are more than
`SMALL_WEIGHT` of the greatest: all samples of a moving average or a local polynomial, some 2.5
periods of the cut-off of a Butterworth low-pass of fourth order.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from steelyard.base.arrays import Array, json_values
from steelyard.base.errors import LogError, ModelError
from steelyard.robot.file.sections import ProcessingSection
from steelyard.robot.file.tables_by_kind import Kinds
from steelyard.robot.file.toml_schema import Positive, as_declared
from steelyard.runs.recording import Recording
from steelyard.runs.rows.resampling import INTERPOLATIONS
from steelyard.runs.smoothing.kalman_smoother import (
    CausalKalman,
    CausalKalmanSmoother,
    Kalman,
    KalmanSmoother,
)
from steelyard.runs.smoothing.likeliest_cutoffs_and_fourier import Auto, Fourier
from steelyard.runs.smoothing.smoothing_methods_and_zero_phase_filters import (
    Bank,
    Butterworth,
    Designed,
    Method,
    Smoother,
)
from steelyard.runs.smoothing.spline_and_finite_windows import (
    FIR,
    MovingAverage,
    SavitzkyGolay,
    SmoothingSpline,
)
from steelyard.runs.spectrum_and_period import Repetitions

METHODS: dict[str, type[Any]] = {
    method.name: method
    for method in (
        Auto,
        Butterworth,
        FIR,
        SavitzkyGolay,
        MovingAverage,
        Fourier,
        Kalman,
        CausalKalman,
        SmoothingSpline,
    )
}
"""Ways from positions to motion, for `motion = ...`."""

SMOOTHERS: dict[str, type[Any]] = {
    method.name: method
    for method in (
        Butterworth,
        FIR,
        SavitzkyGolay,
        MovingAverage,
        KalmanSmoother,
        CausalKalmanSmoother,
    )
}
"""Ways to smooth efforts, for `effort = ...`."""

Description = str | Mapping[str, Any]
method_of: Callable[[Description, str], Method]
method_of = Kinds(METHODS, "method", "method for motion", "method").built
"""A method from its name, or from a table with its name under `method` and its settings."""
smoother_of: Callable[[Description, str], Smoother]
smoother_of = Kinds(SMOOTHERS, "method", "method for effort", "method").built
"""A smoother of efforts, likewise."""


def description_of(method: Method | Smoother) -> dict[str, Any]:
    """The table that `method_of` or `smoother_of` turns back into the method."""
    settings = {name: x for name, x in json_values(method).items() if x is not None}
    return {"method": method.name, **settings}


def method_in_words(method: Method | Smoother) -> str:
    """Name and settings that are not the default: `savitzky_golay, degree 4`."""
    settings = [
        f"{x.name} {_shown_value(value)}"
        for x in fields(method)  # type: ignore[arg-type]
        if (value := getattr(method, x.name)) != x.default
    ]
    return ", ".join((method.name, *settings)).replace("_", " ")


def _shown_value(value: object) -> str:
    if isinstance(value, tuple):
        return " ".join(map(_shown_value, value))
    return f"{value:g}" if isinstance(value, float) else str(value)


OUTLIERS = 15.0
"""Default distance from the rows around, in usual ones, from which on a row is an outlier: on clean
logs of five robots it marks 3 values in 100 000, currents of drives that start or stop."""
NOT_WHITE = ", as the noise is not white"  # why `auto` chose the low-pass of the motion cut-off

BY_CUTOFF: Method = Auto()  # stands for a method that is not given


@dataclass(frozen=True, eq=False)
class Processing:
    """How a recording is made a run; what is `None` comes from the data."""

    motion_cutoff: float | None = None  # low-pass of positions and velocities [Hz]
    # low-pass that the pass applies to regressor and effort alike [Hz]
    matched_cutoff: float | None = None
    # speed up to which a joint rests, one for all or one per joint [rad/s; m/s]; 0: none rests
    rest_speed: float | tuple[float, ...] | None = None
    rate: float | None = None  # of the uniform clock [Hz]
    resampling: str = "cubic"  # name of the interpolation, see `INTERPOLATIONS`
    # from positions to motion; if not given, `Auto`, or `Butterworth` where the cut-off of the
    # motion is given
    motion: Method = BY_CUTOFF
    effort: Smoother | None = None  # smooths efforts; `None`: they stay as logged
    effort_cutoff: float | None = None  # cut-off of that [Hz]; the motion's if `None`
    # distance from which on a row is an outlier, see `outliers`; `None`: none is
    outliers: float | None = OUTLIERS
    # whether rows that repeat the one before in motion are interpolated
    bridge_repeats: bool = True
    leave_out_saturated: bool = True  # whether efforts that stay at a limit count for nothing
    # that the motion is repeated, and only its mean is wanted
    repetitions: Repetitions | None = None
    parallel_filter: bool = True  # whether regressor and effort are low-passed at all

    def __post_init__(self) -> None:
        if self.motion is BY_CUTOFF:
            usual = Auto() if self.motion_cutoff is None else Butterworth()
            object.__setattr__(self, "motion", usual)
        if self.resampling not in INTERPOLATIONS:
            raise ModelError(
                f"'{self.resampling}' is not a resampling method",
                where="processing",
                fix=f"use one of {', '.join(INTERPOLATIONS)}",
            )

    @property
    def cutoffs_of_methods(self) -> tuple[tuple[str, str, float], ...]:
        """Cut-offs given with `motion` and `effort`: name, key of `[processing]`, value [Hz]."""
        found = []
        if self.effort is not None and self.effort_cutoff is not None:
            found.append(("effort", "cutoff in effort", self.effort_cutoff))
        if isinstance(self.motion, Auto | CausalKalman):
            found += [("position", "cutoffs in motion", x) for x in self.motion.cutoffs or ()]
            velocity = self.motion.velocity_cutoffs or ()
            found += [("velocity", "velocity_cutoffs in motion", x) for x in velocity]
        return tuple(found)

    @property
    def motion_words(self) -> str:
        """The way from positions to motion in words; what `auto` has chosen, where it is that."""
        if not isinstance(self.motion, Auto):
            return method_in_words(self.motion)
        return f"{self.motion.choice} (chosen by auto{'' if self.motion != Auto() else NOT_WHITE})"

    @property
    def effort_words(self) -> str:
        """What is done with efforts, in words."""
        if self.effort is None:
            return "efforts not smoothed"
        at = "" if self.effort_cutoff is None else f" {self.effort_cutoff:g} Hz"
        return f"efforts by {method_in_words(self.effort)}{at}"

    def to_dict(self) -> dict[str, Any]:
        """As JSON values; exact."""
        effort = None if self.effort is None else description_of(self.effort)
        values: dict[str, Any] = json_values(self)
        return values | {"motion": description_of(self.motion), "effort": effort}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> "Processing":
        """The processing that `to_dict` wrote."""
        values = dict(data)
        where = "processing of the model"
        values["motion"] = method_of(values["motion"], where)
        if values["effort"] is not None:
            values["effort"] = smoother_of(values["effort"], where)
        if isinstance(values["rest_speed"], list):
            values["rest_speed"] = tuple(values["rest_speed"])
        if values.get("repetitions") is not None:
            values["repetitions"] = Repetitions(**values["repetitions"])
        return cls(**values)


def requested_processing(section: ProcessingSection, where: Callable[..., str]) -> Processing:
    """The processing that a robot file requests.

    Raises:
        ModelError: There is no such method, or it has no such setting or value.
    """
    table, repetitions = section.repetitions, None
    if table is not None:
        repetitions = Repetitions(**({} if isinstance(table, str) else table.model_dump()))
    wanted = Processing(
        motion_cutoff=section.motion_cutoff,
        matched_cutoff=None if section.matched_cutoff == "off" else section.matched_cutoff,
        rest_speed=0.0 if section.rest_speed == "off" else section.rest_speed,
        rate=section.rate,
        resampling=section.resampling,
        outliers=None if section.outliers == "keep" else section.outliers,
        bridge_repeats=section.repeats == "bridge",
        leave_out_saturated=section.saturation == "leave_out",
        repetitions=repetitions,
        parallel_filter=section.matched_cutoff != "off",
    )
    if section.motion is not None:
        wanted = replace(wanted, motion=method_of(section.motion, where("processing", "motion")))
    if section.effort is not None:
        effort, place = section.effort, where("processing", "effort")
        settings = {"method": effort} if isinstance(effort, str) else dict(effort)
        given, fix = settings.pop("cutoff", None), "give a frequency above 0 Hz"
        try:
            cutoff = as_declared(Positive | None, given)
        except ValueError:
            raise ModelError(f"the effort's cutoff is {given!r}", where=place, fix=fix) from None
        wanted = replace(wanted, effort=smoother_of(settings, place), effort_cutoff=cutoff)
    return wanted


MATCHED_FACTOR = 10.0
"""Matched cut-off over the motion's band: effort has harmonics of the motion (products of
velocities, friction at reversals) that a factor near 1 would remove."""
MATCHED_LOWEST = 2.0  # lowest regression cut-off [Hz]: slower filters need logs of minutes
MATCHED_HIGHEST = 0.2  # highest regression cut-off, per sampling rate
MOTION_FACTOR = 3.0
"""Motion cut-off over regression cut-off: the derivatives' filter must be flat where the parallel
one passes, and sharp corners of friction follow from velocities it has not rounded. What it
passes of noise, the parallel filter takes out again; on real robots a cut at the noise floor
itself predicts worse by 1 to 3 % of the error."""
MOTION_HIGHEST = 0.25  # highest default motion cut-off, per sampling rate
NYQUIST_SHARE = 0.45
"""Highest cut-off of motion or efforts that can be requested, per sampling rate."""
SLOWEST_RATE = 2.0
"""Rate up to which time is likelier in milliseconds than in seconds [Hz]: no robot is logged so
slowly."""
SHORTEST_SEGMENT = 4.0
"""Least length of a segment in periods of the regression cut-off: what the filter spans."""


@dataclass(frozen=True)
class Cutoffs:
    """Cut-off frequencies [Hz] of the motion's and of the parallel filter."""

    motion: float
    matched: float


def cutoffs(
    processing: Processing, band: float, rate: float, where: str, floor: float = 0.0
) -> Cutoffs:
    """The requested cut-offs, or those that fit the motion's band and its noise floor [Hz].

    Without a parallel filter that cut-off is half the rate, all that a log can hold.
    The motion's cut-off is never below `floor`, where the spectrum of the positions meets its
    noise: nothing that can be distinguished from noise is removed.
    """
    matched = processing.matched_cutoff if processing.parallel_filter else None
    if matched is None:
        highest = min(MATCHED_HIGHEST * rate, processing.motion_cutoff or np.inf)
        matched = min(rounded(max(MATCHED_FACTOR * band, MATCHED_LOWEST)), highest)
    motion = processing.motion_cutoff
    if motion is None:
        wide = max(MOTION_FACTOR * matched, floor)
        motion = rounded(max(matched, min(wide, MOTION_HIGHEST * rate)))
    keys = ("matched_cutoff", "motion_cutoff")
    stated = [key if getattr(processing, key) else "" for key in keys]
    named = [("regression", stated[0], matched, MATCHED_HIGHEST)]
    named += [("motion", stated[1], motion, NYQUIST_SHARE)]
    named += [(*given, NYQUIST_SHARE) for given in processing.cutoffs_of_methods]
    for name, key, cutoff, share in named:
        if not 0.0 < cutoff <= share * rate * (1.0 + 1e-9):
            wrong = f"the {name} cut-off of {cutoff:g} Hz does not fit a log of {rate:g} Hz"
            fix = f"choose one above 0 and up to {share * rate:.4g} Hz, or log faster"
            if rate <= SLOWEST_RATE:
                wrong += ": its time looks like milliseconds, not seconds"
                unit = "its unit as time_unit under [signals] of the robot file"
                fix = f"give time in seconds, or {unit}; {fix}"
            place = f"{where}, {key} of [processing]" if key else where
            raise LogError(wrong, where=place, fix=fix)
    return Cutoffs(motion, matched if processing.parallel_filter else 0.5 * rate)


def rounded(value: float) -> float:
    """Two significant digits: a figure to be read and typed again."""
    return float(f"{value:.2g}")


SMALL_WEIGHT = 0.05  # of a sample in a filter's response, over the greatest in it


def require_windows_in_log(
    processing: Processing, rate: float, samples: int, recording: Recording
) -> None:
    """Raise if a period of a cut-off, or the window of a filter, is longer than the log.

    Args:
        processing: The methods as requested, with the cut-off of the motion.
        rate: Of the uniform clock [Hz].
        samples: Length of the longest stretch of the log without a gap.
        recording: The log.
    """
    motion = float(processing.motion_cutoff or 0.0)
    has = f"{samples / rate:.3g} s without a gap"
    given = (("motion", "motion_cutoff", motion), *processing.cutoffs_of_methods)
    for name, key, cutoff in given:
        if cutoff * samples < rate:
            raise LogError(
                f"the {name} cut-off of {cutoff:g} Hz has a period of {1.0 / cutoff:.3g} s, but "
                f"the log has {has}",
                where=f"{recording.where}, {key} of [processing]",
                fix=f"choose one above {rate / samples:.2g} Hz, or log for longer",
            )
    joints = recording.channels.joints
    lengths = {"motion": window(processing.motion.designed(motion, rate), joints, None)}
    if processing.effort is not None:
        smoother = processing.effort.smooth(processing.effort_cutoff or motion, rate)
        lengths["effort"] = window(smoother, joints)
    for key, length in lengths.items():
        if length > samples:
            raise LogError(
                f"the filter of {key} looks at {length} samples ({length / rate:.3g} s), but the "
                f"log has {samples} ({has})",
                where=f"{recording.where}, {key} of [processing]",
                fix="choose a shorter window or span, fewer passes or a higher cut-off, or log "
                "for longer",
            )


def window(designed: Bank | Designed, joints: int, *velocity: None) -> int:
    """Samples that a filter of channels looks at; 0 of one that takes whole segments."""
    if designed.halo is None:
        return 0
    impulse = np.zeros((joints, 4 * designed.halo + 1))
    impulse[:, 2 * designed.halo] = 1.0
    response: Array = np.abs(designed(impulse, *velocity))
    large = response > SMALL_WEIGHT * response.max(axis=-1, keepdims=True)
    at = np.flatnonzero(large.reshape(-1, large.shape[-1]).any(axis=0))
    return int(at[-1] - at[0] + 1)
