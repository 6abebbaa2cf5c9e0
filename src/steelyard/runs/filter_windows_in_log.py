r"""Whether the filters that `[processing]` asks for look at less than a log holds.

The window of a filter is what holds the samples of its response to a single one that are more than
`SMALL_WEIGHT` of the greatest: all samples of a moving average or a local polynomial, some 2.5
periods of the cut-off of a Butterworth low-pass of fourth order.
"""

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import LogError
from steelyard.runs.processing_choices import Processing
from steelyard.runs.recording import Recording
from steelyard.runs.smoothing.smoothing_methods_and_zero_phase_filters import Bank, Designed

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
