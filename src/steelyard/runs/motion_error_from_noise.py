r"""How noise of positions becomes errors of motion, and of residuals behind a low-pass.

A method of motion is linear: of white noise with standard deviation $s$ in the positions, its
responses $h_0, h_1, h_2$ to a single sample leave errors of $q, \dot q, \ddot q$ with covariance
$s^2 \sum_k h_{ak} h_{bk}$; noise of logged velocities adds its own. Where residuals go through a
low-pass with taps $m$, and the motion changes slowly against it, $h$ becomes $m * h$.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from steelyard.base.arrays import Array, frozen
from steelyard.runs.first_pass_over_recording import survey
from steelyard.runs.run import Run
from steelyard.runs.smoothing.smoothing_methods_and_zero_phase_filters import Butterworth, Method


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
    base = run.recording.signals.base
    if base is not None:
        of_position = _of_base_motion(of_position, base.tracked, not base.angular_velocity)
    nyquist = 0.5 * run.rate
    speeds = np.zeros(channels.joints) if found.velocity_noise is None else found.velocity_noise
    return MotionError(
        frozen(np.sqrt(nyquist * found.band.noise)),
        frozen(np.sqrt(nyquist * speeds)),
        frozen(_products(of_position, taps)),
        frozen(_products(of_velocity, taps)),
    )


def _of_base_motion(responses: Array, tracked: bool, turned: bool) -> Array:
    """Responses `(3, n, L)` of motion where channels of a base are not its positions.

    What is measured is an acceleration where its place is not `tracked`, and a velocity where it is
    not `turned` by logged angles.
    """
    found, still = responses.copy(), np.zeros_like(responses[0, :3])
    if not tracked:
        found[:, :3] = np.stack([still, still, responses[0, :3]])
    if not turned:
        found[:, 3:6] = np.stack([still, *responses[:2, 3:6]])
    return found


def _products(responses: Array, taps: Array | None) -> Array:
    """Sums of products of responses `(3, n, L)` behind a filter, shape `(n, 3, 3)`."""
    if taps is not None:
        length = responses.shape[2] + len(taps) - 1
        size = 1 << (length - 1).bit_length()
        spectrum = np.fft.rfft(responses, size) * np.fft.rfft(taps, size)
        responses = np.fft.irfft(spectrum, size)[:, :, :length]
    return np.asarray(np.einsum("anl,bnl->nab", responses, responses))
