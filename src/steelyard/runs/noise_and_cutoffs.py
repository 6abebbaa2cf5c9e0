r"""Noise of positions in motion and residuals; cut-offs and rest speed that data suggest.

A method of motion is linear: of white noise with standard deviation $s$ in the positions, its
responses $h_0, h_1, h_2$ to a single sample leave errors of $q, \dot q, \ddot q$ with covariance
$s^2 \sum_k h_{ak} h_{bk}$; noise of logged velocities adds its own. Where residuals go through a
low-pass with taps $m$, and the motion changes slowly against it, $h$ becomes $m * h$.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from steelyard.base.arrays import Array, frozen
from steelyard.base.errors import LogError
from steelyard.runs.processing_choices import Processing
from steelyard.runs.run import Run
from steelyard.runs.smoothing.zero_phase_filters import Butterworth, Method
from steelyard.runs.survey_and_kept_samples import survey


def motion_responses(
    method: Method, cutoff: float, rate: float, joints: int
) -> tuple[Array, Array]:
    """Responses of a local method to one position, and to one logged velocity.

    They are position, velocity and acceleration, shape `(3, n, 2 halo + 1)`; for other methods
    those of the Butterworth low-pass.
    """
    designed = method.designed(cutoff, rate)
    if designed.halo is None:
        designed = Butterworth().designed(cutoff, rate)
    halo = designed.halo or 0
    impulse = np.zeros((joints, 4 * halo + 1))
    impulse[:, 2 * halo] = 1.0
    return designed(impulse, None), designed(np.zeros_like(impulse), impulse)


def noise_gain(response: Array, rate: float) -> Array:
    """Standard deviations of filters' results for white noise of density 1 per Hz, `(n,)`."""
    return np.asarray(np.sqrt(0.5 * rate * np.square(response).sum(axis=-1)))


@dataclass(frozen=True, eq=False)
class MotionError:
    """Noise of one run's positions and velocities, and its way into motion."""

    # standard deviation of a measured position on the uniform clock, `(n,)` [rad; m]
    position: Array
    velocity: Array  # the same of a logged velocity; zero where none is logged [rad/s; m/s]
    of_position: Array  # covariance of `q, dq, ddq` per variance of a position, shape `(n, 3, 3)`
    of_velocity: Array  # the same per variance of a logged velocity

    def covariance(self, position: ArrayLike | None = None) -> Array:
        """Covariance of each joint's `q, dq, ddq`, `(n, 3, 3)`, with another std of `position`."""
        s = self.position if position is None else np.broadcast_to(position, self.position.shape)
        variances = np.square(s)[:, None, None], np.square(self.velocity)[:, None, None]
        return np.asarray(variances[0] * self.of_position + variances[1] * self.of_velocity)


def motion_error(run: Run, taps: Array | None = None) -> MotionError:
    """The noise of a run's positions, from the upper half of their spectrum.

    The median over the spectrum is a little low for runs of less than a minute. Methods that are
    not local count as the Butterworth low-pass of their cut-off.
    """
    found = survey(run.recording.in_memory(), run.chain.processing)
    channels = run.recording.channels
    of_position, of_velocity = motion_responses(
        run.chain.processing.motion, run.motion_cutoff, run.rate, channels.joints
    )
    if channels.velocities:
        of_position[1:] = 0.0
    nyquist = 0.5 * run.rate
    speeds = np.zeros(channels.joints) if found.velocity_noise is None else found.velocity_noise
    return MotionError(
        frozen(np.sqrt(nyquist * found.band.noise)),
        frozen(np.sqrt(nyquist * speeds)),
        frozen(_products(of_position, taps)),
        frozen(_products(of_velocity, taps)),
    )


def _products(responses: Array, taps: Array | None) -> Array:
    """Sums of products of responses `(3, n, L)` behind a filter, shape `(n, 3, 3)`."""
    if taps is not None:
        length = responses.shape[2] + len(taps) - 1
        size = 1 << (length - 1).bit_length()
        spectrum = np.fft.rfft(responses, size) * np.fft.rfft(taps, size)
        responses = np.fft.irfft(spectrum, size)[:, :, :length]
    return np.asarray(np.einsum("anl,bnl->nab", responses, responses))


BINS_PER_DECADE = 32
LOWEST_SPEED_DECADE, HIGHEST_SPEED_DECADE = -8, 4
"""Decades of speed, relative to the reference, that the histogram covers."""


class SpeedHistogram:
    """Speeds of all joints, in constant memory: logarithmic bins, 7.5 % wide.

    A speed per joint, `reference`, is the edge of a bin, beside the `highest` one; `(n,)`.
    """

    def __init__(self, reference: Array) -> None:
        bins = (HIGHEST_SPEED_DECADE - LOWEST_SPEED_DECADE) * BINS_PER_DECADE + 1
        self.reference = reference
        self.highest = np.zeros(len(reference))
        self._count = np.zeros((len(reference), bins), dtype=np.int64)
        self._first = np.full((len(reference), bins), np.inf)
        self._last = np.full((len(reference), bins), -np.inf)

    def add(self, t: Array, dq: Array) -> None:
        """Take in samples: time `(N,)` [s], increasing over calls, and velocity `(n, N)`."""
        if len(t) == 0:
            return
        for joint, velocity in enumerate(dq):
            self.highest[joint] = max(self.highest[joint], float(np.abs(velocity).max()))
            speed = np.maximum(np.abs(velocity) / self.reference[joint], 10.0**LOWEST_SPEED_DECADE)
            place = np.floor(_bin(speed)).astype(np.intp)
            np.clip(place, 0, self._count.shape[1] - 1, out=place)
            self._count[joint] += np.bincount(place, minlength=self._count.shape[1])
            bins, first = np.unique(place, return_index=True)
            last = len(place) - 1 - np.unique(place[::-1], return_index=True)[1]
            self._first[joint, bins] = np.minimum(self._first[joint, bins], t[first])
            self._last[joint, bins] = t[last]

    def quantile(self, share: float) -> Array:
        """Speed per joint below which a share of the samples is, shape `(n,)`."""
        below = np.cumsum(self._count, axis=1)
        place = [np.searchsorted(row, share * row[-1]) for row in below]
        return self.reference * self._edge(np.array(place) + 1)

    def edge_above(self, speed: Array) -> Array:
        """The lowest edges of bins that are not below `speed`, shape `(n,)`."""
        return self.reference * self._edge(np.ceil(_bin(speed / self.reference) - 1e-6))

    def moving(self, rest_speed: Array) -> tuple[float, float] | None:
        """First and last time at which any joint is faster than its rest speed (edges of bins)."""
        place = np.round(_bin(rest_speed / self.reference))
        start = np.clip(place, 0, self._count.shape[1] - 1).astype(int)
        first = min(row[s:].min() for row, s in zip(self._first, start, strict=True))
        last = max(row[s:].max() for row, s in zip(self._last, start, strict=True))
        return None if first == np.inf else (float(first), float(last))

    def _edge(self, place: Array) -> Array:
        return np.asarray(10.0 ** (place / BINS_PER_DECADE + LOWEST_SPEED_DECADE))


def _bin(speed: Array) -> Array:
    """The bin, counted in fractions, of a speed over the reference."""
    return np.asarray((np.log10(speed) - LOWEST_SPEED_DECADE) * BINS_PER_DECADE)


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
NYQUIST_SHARE = 0.45  # highest cut-off that can be requested, per sampling rate
SLOWEST_RATE = 2.0
"""Rate up to which time is likelier in milliseconds than in seconds [Hz]: no robot is logged so
slowly."""
SHORTEST_SEGMENT = 4.0
"""Least length of a segment in periods of the regression cut-off: what the filter spans."""
REST_SHARE = 0.005  # rest speed over the speed that a joint exceeds 1 % of the time
REST_SHARE_OF_FASTEST = 0.001
"""Rest speed over the same speed of the fastest joint: slower ones are dragged, not driven."""
REST_NOISE = 4.0  # rest speed over the standard deviation of the velocity's noise
REST_STEPS = 2.0  # rest speed over the speed that one step of the sensor's resolution seems to be
REST_LOWEST = 1e-4  # lowest default rest speed [rad/s; m/s]
MOVING_OVER_REST = 2.0
"""Speed over rest speed at which a run's motion starts and ends: noise does not reach it."""


@dataclass(frozen=True)
class Cutoffs:
    """Cut-off frequencies [Hz] of the motion's and of the parallel filter."""

    motion: float
    matched: float


def cutoffs(
    processing: Processing, band: float, rate: float, where: str, floor: float = 0.0
) -> Cutoffs:
    """The requested cut-offs, or those that fit the motion's band and its noise floor [Hz].

    The motion's cut-off is never below `floor`, where the spectrum of the positions meets its
    noise: nothing that can be distinguished from noise is removed.
    """
    matched = processing.matched_cutoff
    if matched is None:
        highest = min(MATCHED_HIGHEST * rate, processing.motion_cutoff or np.inf)
        matched = rounded(min(max(MATCHED_FACTOR * band, MATCHED_LOWEST), highest))
    motion = processing.motion_cutoff
    if motion is None:
        wide = max(MOTION_FACTOR * matched, floor)
        motion = rounded(max(matched, min(wide, MOTION_HIGHEST * rate)))
    for name, cutoff, share in (
        ("regression", matched, MATCHED_HIGHEST),
        ("motion", motion, NYQUIST_SHARE),
    ):
        if not 0.0 < cutoff <= share * rate * (1.0 + 1e-9):
            usual = f"choose one above 0 and up to {share * rate:.4g} Hz, or log faster"
            slow = rate <= SLOWEST_RATE
            raise LogError(
                f"the {name} cut-off of {cutoff:g} Hz does not fit a log of {rate:g} Hz"
                + (": its time looks like milliseconds, not seconds" if slow else ""),
                where=where,
                fix=f"give time in seconds, or its unit as time_unit under [signals] of the robot "
                f"file; {usual}"
                if slow
                else usual,
            )
    return Cutoffs(motion, matched)


def rounded(value: float) -> float:
    """Two significant digits: a figure to be read and typed again."""
    return float(f"{value:.2g}")


def default_rest_speed(fast: Array, noise: Array, step_speed: Array) -> Array:
    """Speed up to which a joint rests, shape `(n,)`.

    Args:
        fast: Speed that each joint exceeds 1 % of the time.
        noise: Standard deviation of each velocity's noise.
        step_speed: Speed that one step of each sensor's resolution seems to be.
    """
    slow = np.maximum(REST_SHARE * fast, max(REST_SHARE_OF_FASTEST * fast.max(), REST_LOWEST))
    return np.maximum(slow, np.maximum(REST_NOISE * noise, REST_STEPS * step_speed))


def given_rest_speed(processing: Processing, joints: int) -> Array | None:
    """The requested rest speeds, shape `(n,)`, or `None`."""
    if processing.rest_speed is None:
        return None
    speeds = np.atleast_1d(np.asarray(processing.rest_speed, dtype=np.float64))
    if len(speeds) not in (1, joints) or not (np.isfinite(speeds) & (speeds > 0.0)).all():
        raise LogError(
            f"rest speed {processing.rest_speed} does not fit {joints} joints",
            where="processing",
            fix=f"give one speed above 0 for all joints, or {joints} of them",
        )
    return frozen(np.broadcast_to(speeds, (joints,)))
