"""Mimic joints: which joint drives them, and limits of joints that keep followers within theirs."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from steelyard.robot.mechanism import Joint, Mechanism, Mimic
from steelyard.robot.robot import Limits, Robot


def drive_of(mechanism: Mechanism, joint: Joint) -> Mimic:
    """How a joint follows the independent joint behind it, itself if need be; chains resolved."""
    ratio, offset = 1.0, 0.0
    while joint.mimic is not None:
        offset += ratio * joint.mimic.offset
        ratio *= joint.mimic.ratio
        joint = mechanism.joint(joint.mimic.master)
    return Mimic(joint.name, ratio, offset)


def narrowed(mechanism: Mechanism, drives: Mapping[str, Mimic], name: str) -> tuple[Limits, bool]:
    """Limits that keep the followers of a joint within theirs as well, and whether a range is left.

    A follower at `x = ratio * q + offset` within `[lower, upper]` keeps `q` between `(lower -
    offset) / ratio` and `(upper - offset) / ratio`, and its speed limit counts as `velocity /
    |ratio|`. A follower with an empty range is unlimited; the joint's range stays if none is left.
    """
    limits = unlimited_if_empty(mechanism.joint(name).limits)
    lower, upper, velocity = limits.lower, limits.upper, limits.velocity
    followers = [n for n, drive in drives.items() if drive.master == name and n != name]
    for follower in followers:
        ratio, offset = drives[follower].ratio, drives[follower].offset
        own = mechanism.joint(follower).limits
        if ratio == 0.0:
            continue
        velocity = min(velocity, own.velocity / abs(ratio))
        if own.lower < own.upper:
            ends = sorted(((own.lower - offset) / ratio, (own.upper - offset) / ratio))
            lower, upper = max(lower, ends[0]), min(upper, ends[1])
    if left := not followers or lower < upper:
        return replace(limits, lower=lower, upper=upper, velocity=velocity), left
    return replace(limits, velocity=velocity), left


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


def limit_notes(mechanism: Mechanism, drives: Mapping[str, Mimic], robot: Robot) -> list[str]:
    """What was assumed of the coordinates' limits, a sentence each."""
    notes = []
    for c in robot.joints:
        limits = mechanism.joint(c.name).limits
        if limits.lower == limits.upper and np.isinf(c.limits.lower):
            notes.append(f"joint '{c.name}' has an empty range in the model: taken as unlimited")
        if not narrowed(mechanism, drives, c.name)[1]:
            notes.append(
                f"no position of '{c.name}' satisfies the ranges of its mimic joints: "
                "these are ignored"
            )
    return notes
