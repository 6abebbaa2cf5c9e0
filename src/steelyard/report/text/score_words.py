"""Errors of predictions in words: every percentage with its kind and its band."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import isfinite
from statistics import fmean
from typing import TYPE_CHECKING

from steelyard.report.text.words import count, percent, significant

if TYPE_CHECKING:
    from steelyard.estimation.identified import IdentifiedModel
    from steelyard.validation.score import JointScore, RunScore

MOVING, WHOLE = "where they move", "whole log"

PROMISED = 90.0
"""Share of a log that was not fitted [%] below which 95 % bands hold less than they promise."""

NAMED = 3
"""Most joints that are named one by one."""


@dataclass(frozen=True)
class RelativeError:
    """One relative error of one or more runs.

    Attributes:
        value: Mean over the runs [%].
        norm: `pooled` or `mean`: norms over all joints together, or the mean of their errors.
        joints: Over how many joints, like `6 joints`.
        samples: Over which samples: `where they move` or `whole log`.
    """

    value: float
    norm: str
    joints: str
    samples: str

    @property
    def kind(self) -> str:
        """Like `pooled over 7 joints, where they move`."""
        return f"{self.norm} over {self.joints}, {self.samples}"

    @property
    def words(self) -> str:
        """Like `1.5 % pooled, where they move`."""
        return f"{percent(self.value)} {self.norm}, {self.samples}"


def relative_errors(scores: Sequence[RunScore]) -> list[RelativeError]:
    """Relative errors of runs, the one to be judged by first.

    Pooled before mean, since a joint that carries hardly any load has a large relative error and
    rules a mean; where joints move before whole logs. A pooled error needs one unit of effort, one
    of motion a joint that moves: what some run does not have is left out. None without runs.
    """
    if not scores:
        return []
    moving, every = _moving(scores), count(len(scores[0].joints), "joint")
    kinds: tuple[tuple[Callable[[RunScore], float | None], str, str, str], ...] = (
        (lambda s: s.pooled_percent_moving, "pooled", moving, MOVING),
        (lambda s: s.pooled_percent, "pooled", every, WHOLE),
        (lambda s: s.mean_percent_moving, "mean", moving, MOVING),
        (lambda s: s.mean_percent, "mean", every, WHOLE),
    )
    found = []
    for of, *kind in kinds:
        known = [value for value in map(of, scores) if value is not None]
        if known and len(known) == len(scores):
            found.append(RelativeError(fmean(known), *kind))
    return found


def band(scores: Sequence[RunScore]) -> str:
    """Like `below 8 Hz`: the low-pass of both sides of the comparison."""
    return f"below {' and '.join(f'{c:g}' for c in sorted({run.cutoff for run in scores}))} Hz"


def band_origin(identified: IdentifiedModel | None) -> str:
    """Where the band comes from, if another identification may come to another one; or nothing."""
    if identified is None or identified.processing.matched_cutoff is not None:
        return ""
    if identified.cutoffs.score != identified.cutoffs.matched:
        return ""
    return (
        "The band was chosen from the fitted runs; [validation] cutoff in the robot file keeps it "
        "the same for every model"
    )


def poorly_predicted(scores: Sequence[RunScore], limit: float) -> str:
    """Joints with a mean relative error above `limit` [%], with their RMSE; or nothing."""
    listed = []
    for number, joint in enumerate(scores[0].joints):
        own = [run.joints[number] for run in scores]
        error = fmean(relative(one) for one in own)
        if isfinite(error) and error > limit:
            rmse = significant(fmean(one.rmse for one in own), 2)
            listed.append((error, f"{joint.joint} {percent(error)} (RMSE {rmse} {joint.unit})"))
    listed.sort(reverse=True)
    more = f" and {len(listed) - NAMED} more" if len(listed) > NAMED else ""
    return ", ".join(words for _, words in listed[:NAMED]) + more


def coverage_words(inside: float, unseen: bool) -> str:
    """How much of a log lies in its 95 % bands [%], and whether that is less than they promise."""
    less = ": less than stated" if unseen and inside < PROMISED else ""
    return f"{percent(inside)} of this log inside{less}"


def relative(joint: JointScore) -> float:
    """The error a joint is judged by: where it moves, or else over all samples [%]."""
    moving = joint.relative_percent_moving
    return joint.relative_percent if moving is None else moving


def _moving(scores: Sequence[RunScore]) -> str:
    joints = scores[0].joints
    moving = sum(
        any(run.joints[k].relative_percent_moving is not None for run in scores)
        for k in range(len(joints))
    )
    if moving < len(joints):
        return f"the {moving} of {len(joints)} joints that move"
    return count(len(joints), "joint")
