"""Hypothesis explanations of a log, and what each of them supposes to be wrong."""

from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array
from steelyard.diagnosis.likelihood.interpretation import Interpretation
from steelyard.diagnosis.likelihood.likelihood import Score

FREE = 5.0
"""What a fitted number costs [natural units of likelihood]."""

AS_DECLARED = "as declared"


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """One explanation.

    Attributes:
        cause: Name of the check that it belongs to.
        says: What it supposes, in a few words.
        interpretation: How it reads the log.
        cost: Log-likelihood that its choice among others of its kind, and its fitted numbers, take.
        joints: Indices of the joints concerned.
        score: How well it agrees.
        spread: Standard deviation of the number that was fitted, if one was.
        fixed: Whether the robot file may be changed to say so; not where its numbers are poorly
            identifiable.
        compared: What the misfits are of, and the misfit before [%]; the nominal model or the
            reference, and that of the explanation before, if `None`.
    """

    cause: str
    says: str
    interpretation: Interpretation
    cost: float
    joints: tuple[int, ...]
    score: Score
    spread: float = 0.0
    fixed: bool = True
    compared: tuple[str, float] | None = None

    @property
    def log_likelihood(self) -> float:
        """With what its freedom costs."""
        return float(self.score.log_likelihood) - self.cost

    @property
    def misfits(self) -> Array:
        """Of every joint, shape `(n,)`."""
        return self.score.misfits

    @property
    def percent(self) -> float:
        """Typical misfit [%]."""
        return float(self.score.percent)


def one_of(score: Score, index: int) -> Score:
    """One of several scores."""
    return Score(score.misfits[index], score.counts[index], score.nuisances[index])


def choice(count: int) -> float:
    """What the choice among so many costs."""
    return float(np.log(max(count, 1)))
