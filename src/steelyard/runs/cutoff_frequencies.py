"""Cut-offs of the low-passes of motion and regression that data suggest."""

from dataclasses import dataclass

import numpy as np

from steelyard.base.errors import LogError
from steelyard.runs.processing_choices import Processing

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
    named = [
        (
            "regression",
            "matched_cutoff" if processing.matched_cutoff else "",
            matched,
            MATCHED_HIGHEST,
        ),
        ("motion", "motion_cutoff" if processing.motion_cutoff else "", motion, NYQUIST_SHARE),
    ]
    named += [(*given, NYQUIST_SHARE) for given in processing.cutoffs_of_methods]
    for name, key, cutoff, share in named:
        if not 0.0 < cutoff <= share * rate * (1.0 + 1e-9):
            usual = f"choose one above 0 and up to {share * rate:.4g} Hz, or log faster"
            slow = rate <= SLOWEST_RATE
            raise LogError(
                f"the {name} cut-off of {cutoff:g} Hz does not fit a log of {rate:g} Hz"
                + (": its time looks like milliseconds, not seconds" if slow else ""),
                where=f"{where}, {key} of [processing]" if key else where,
                fix=f"give time in seconds, or its unit as time_unit under [signals] of the robot "
                f"file; {usual}"
                if slow
                else usual,
            )
    return Cutoffs(motion, matched if processing.parallel_filter else 0.5 * rate)


def rounded(value: float) -> float:
    """Two significant digits: a figure to be read and typed again."""
    return float(f"{value:.2g}")
