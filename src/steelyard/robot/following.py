"""What mimic joints' own limits leave of the range of the joint that they follow."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from steelyard.robot.robot import Limits


def narrowed(limits: Limits, followers: Iterable[tuple[float, float, Limits]]) -> Limits | None:
    """Limits that keep the followers of a joint within theirs as well.

    A follower at `x = ratio * q + offset` within `[lower, upper]` keeps `q` between
    `(lower - offset) / ratio` and `(upper - offset) / ratio`, and its speed limit counts as
    `velocity / |ratio|`. A follower with an empty range is taken as unlimited.

    Args:
        limits: The joint's own.
        followers: Ratio, offset and limits of each.

    Returns:
        The limits, the effort as it was; `None` if no range is left.
    """
    lower, upper, velocity = limits.lower, limits.upper, limits.velocity
    for ratio, offset, own in followers:
        if ratio == 0.0:
            continue
        velocity = min(velocity, own.velocity / abs(ratio))
        if own.lower < own.upper:
            ends = sorted(((own.lower - offset) / ratio, (own.upper - offset) / ratio))
            lower, upper = max(lower, ends[0]), min(upper, ends[1])
    if not lower < upper:
        return None
    return replace(limits, lower=lower, upper=upper, velocity=velocity)


def merged(given: Limits, model: Limits, narrow: Limits) -> Limits:
    """Limits that a user gave; those left as the model has them are the narrowed ones."""
    lower, upper, velocity = (
        getattr(narrow if getattr(given, side) == getattr(model, side) else given, side)
        for side in ("lower", "upper", "velocity")
    )
    if not lower < upper:
        lower, upper = given.lower, given.upper
    return replace(given, lower=lower, upper=upper, velocity=velocity)


def unlimited_if_empty(limits: Limits) -> Limits:
    """A range of one point says nothing."""
    if limits.lower == limits.upper:
        return replace(limits, lower=-np.inf, upper=np.inf)
    return limits
