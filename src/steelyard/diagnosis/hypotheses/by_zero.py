r"""The zero of one joint: its positions are $\delta$ away from those of the reference.

The reference predicts the efforts at $q_j + \delta$, with friction as every hypothesis may have it.
Along $\delta$ the log-likelihood is sought on a grid that is drawn closer around its best point;
the curvature at the top gives the standard deviation.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from steelyard.arrays import Array
from steelyard.diagnosis.hypotheses.by_position import Draft, judged
from steelyard.diagnosis.hypotheses.hypothesis import FREE, Hypothesis, choice
from steelyard.diagnosis.likelihood.interpretation import Interpretation
from steelyard.diagnosis.likelihood.likelihood import Likelihood
from steelyard.estimation.estimate import Z95
from steelyard.estimation.zero_offset import LOOSEST

CAUSE = "joint zeros"
"""The check that an explanation by a zero belongs to."""
GRID = np.array(
    [-3.5, -2.8, -2.2, -1.6, -1.2, -0.8, -0.4, -0.2, -0.1, 0.0]
    + [0.1, 0.2, 0.4, 0.8, 1.2, 1.6, 2.2, 2.8, 3.5]
)
"""Offsets that are tried first [rad; m]."""
COARSE = 300
"""Samples for that."""
POINTS, ZOOMS = 9, 3
"""Offsets between the neighbours of the best one, and how often they are drawn closer."""
CLOSE = 3.0
"""Log-likelihood within which zeros of two joints cannot be distinguished."""


@dataclass(frozen=True)
class Zero:
    """The zero offset of a joint: its position is the logged one plus it.

    Attributes:
        joint: Index of the joint.
        name: The joint's name.
        unit: `rad` or `m`.
        value: The likeliest offset; 0 where it is not identifiable.
        std: Its standard deviation; infinite where it is not identifiable.
    """

    joint: int
    name: str
    unit: str
    value: float
    std: float

    @property
    def identifiable(self) -> bool:
        """Whether the log identifies it."""
        return bool(np.isfinite(self.std))

    @property
    def words(self) -> str:
        """Like `elbow -0.0931 ± 0.0102 rad`."""
        return f"{self.name} {self.value:.3f} ± {Z95 * self.std:.3f} {self.unit}"


def zero_hypotheses(likelihood: Likelihood, interpretation: Interpretation) -> Iterator[Hypothesis]:
    """The best zero of each joint whose zero the log identifies; the likeliest names its like."""
    zeros = [zero for zero in zero_offsets(likelihood, interpretation) if zero.identifiable]
    cost = FREE + choice(likelihood.signals.n)
    drafts = [
        Draft(
            CAUSE,
            f"zero offset of {zero.words}",
            moved(interpretation, zero.joint, zero.value),
            cost,
            (zero.joint,),
        )
        for zero in zeros
    ]
    found = [
        replace(hypothesis, spread=zero.std)
        for zero, hypothesis in zip(zeros, judged(likelihood, drafts), strict=True)
    ]
    if found:
        yield from _with_alike(zeros, found)


def _with_alike(zeros: list[Zero], found: list[Hypothesis]) -> Iterator[Hypothesis]:
    """The hypotheses, of which the likeliest names those that it cannot be distinguished from."""
    best = max(found, key=lambda hypothesis: hypothesis.log_likelihood)
    alike = [
        zero.words
        for zero, other in zip(zeros, found, strict=True)
        if other is not best and other.log_likelihood > best.log_likelihood - CLOSE
    ]
    if alike:
        found[found.index(best)] = replace(best, says=f"{best.says} (or of {', '.join(alike)})")
    yield from found


def zero_offsets(likelihood: Likelihood, interpretation: Interpretation) -> tuple[Zero, ...]:
    """Offsets of all joints, each by itself; of an open chain with declared zeros, else none."""
    robot = likelihood.knowledge.robot
    if robot.passive or any(likelihood.signals.unknown_offsets):
        return ()
    coarse = replace(likelihood, excerpt=likelihood.excerpt.thinned(COARSE))
    found = []
    for joint, coordinate in enumerate(robot.coordinates):
        k = int(np.clip(np.argmax(_along(coarse, interpretation, joint, GRID)), 1, len(GRID) - 2))
        value, std = _refined(likelihood, interpretation, joint, GRID[k - 1 : k + 2])
        if std > LOOSEST[coordinate.unit]:
            value, std = 0.0, np.inf
        found.append(Zero(joint, coordinate.name, coordinate.unit, value, std))
    return tuple(found)


def _refined(
    likelihood: Likelihood, interpretation: Interpretation, joint: int, near: Array
) -> tuple[float, float]:
    """Top of the log-likelihood between two offsets, and its standard deviation, or infinity."""
    low, high = float(near[0]), float(near[-1])
    for _ in range(ZOOMS):
        grid = np.linspace(low, high, POINTS)
        k = int(np.clip(np.argmax(_along(likelihood, interpretation, joint, grid)), 1, POINTS - 2))
        low, high = float(grid[k - 1]), float(grid[k + 1])
    middle, step = 0.5 * (low + high), 0.5 * (high - low)
    before, top, after = _along(
        likelihood, interpretation, joint, np.array([low, middle, high], dtype=np.float64)
    )
    bend = (before - 2.0 * top + after) / step**2
    if not bend < 0.0:
        return 0.0, np.inf
    value = middle + float(np.clip(0.5 * (before - after) / step / bend, -step, step))
    return value, float(1.0 / np.sqrt(-bend))


def _along(
    likelihood: Likelihood, interpretation: Interpretation, joint: int, offsets: Array
) -> Array:
    """Log-likelihood at offsets of one joint, of the same shape."""
    drafts = [Draft(CAUSE, "", moved(interpretation, joint, x), 0.0, (joint,)) for x in offsets]
    return np.array([found.log_likelihood for found in judged(likelihood, drafts)])


def moved(interpretation: Interpretation, joint: int, offset: float) -> Interpretation:
    """The interpretation with one joint's zero moved further."""
    before = interpretation.zeros
    zeros = np.zeros(len(interpretation.position)) if before is None else before.copy()
    zeros[joint] += offset
    return interpretation.changed(zeros=zeros)
