"""All efforts of the other sign, or all positions: of arms with a mirror plane, bodies fit both.

Mirrored bodies turn every torque of the mirrored motion. So the two cannot be told apart by any
log of such an arm; that efforts are of the other sign is a single convention, and by far the
likelier mistake.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from steelyard.arrays import Array
from steelyard.diagnosis.hypotheses.possible import possible
from steelyard.diagnosis.hypotheses.reading import Reading
from steelyard.diagnosis.hypotheses.rival import Rival
from steelyard.diagnosis.hypotheses.trial import Trial

CLOSE = 3.0
"""Log-likelihood within which the two fit equally well."""
BOTH = ": both fit with free masses, and this log cannot distinguish them"
JOINTS, EFFORTS = "all positions have the opposite sign", "all efforts have the opposite sign"


def efforts_first(now: Reading, rivals: Sequence[Rival]) -> tuple[Rival, ...]:
    """Rivals, the likeliest first, with turned efforts before turned positions that fit as well.

    Args:
        now: The reading that they start from.
        rivals: The likeliest first.
    """
    if not rivals or not _turned(now.position_scale, rivals[0].reading.position_scale):
        return tuple(rivals)
    least = rivals[0].log_likelihood - CLOSE
    for rival in rivals[1:]:
        if rival.log_likelihood > least and of_efforts(now, rival):
            return (rival, *(r for r in rivals if r is not rival))
    return tuple(rivals)


def of_efforts(now: Reading, rival: Rival) -> bool:
    """Whether a rival does nothing but turn the signs of all efforts."""
    after = rival.reading
    return (
        rival.cause == "effort sign"
        and len(after.effort) > 1
        and _turned(now.effort_scale, after.effort_scale)
        and np.array_equal(now.position_scale, after.position_scale)
    )


def mirrors(now: Reading, one: Rival, other: Rival) -> bool:
    """Whether one rival turns all efforts and the other one all positions."""
    return of_efforts(now, one) and _turned(now.position_scale, other.reading.position_scale)


def with_mirror(trial: Trial, before: Reading, rival: Rival) -> Rival:
    """A rival that turns all efforts, or all positions, and names the other one if that fits.

    Args:
        trial: The log.
        before: The reading that it starts from.
        rival: The explanation.
    """
    after = rival.reading
    positions = _turned(before.position_scale, after.position_scale)
    if len(after.effort) < 2 or positions == _turned(before.effort_scale, after.effort_scale):
        return rival
    if rival.cause != ("position sign" if positions else "effort sign"):
        return rival
    mirror = after.changed(position_scale=-after.position_scale, effort_scale=-after.effort_scale)
    mine, other = possible(trial, after), possible(trial, mirror)
    if mine is None or other is None:
        return rival
    if float(mine.score.log_likelihood - other.score.log_likelihood) > CLOSE:
        return rival
    return replace(rival, says=f"{rival.says}, or {EFFORTS if positions else JOINTS}{BOTH}")


def _turned(before: Array, after: Array) -> bool:
    return bool(np.all(np.sign(before) == -np.sign(after)))
