"""Hypotheses: readings with a cause and a cost, how they are scored, and the likeliest number."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from steelyard.base.arrays import Array
from steelyard.check.hypotheses.nuisance_fit_and_score import LikelihoodScore
from steelyard.check.hypotheses.readings_and_likelihood import Reading

FITTED_NUMBER_COST = 5.0  # what a fitted number costs [natural units of likelihood]
CLOSE_HYPOTHESES = 3.0  # log-likelihood within which two explanations agree equally well
LIKELY = 8.0  # log odds from which on what a reading says is doubtful
SURE = 20.0
"""Log odds of what a reading says of a cause, over all readings that say otherwise, from which on
it is wrong and a line is written: errors of models weigh as much as 10 on invented robots."""

AS_DECLARED = "as declared"

NOT_SCORED = LikelihoodScore(*np.zeros((3, 0)))  # the score of a hypothesis before it is evaluated


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """One explanation."""

    cause: str  # name of the check that it belongs to
    says: str  # what it supposes, in a few words
    reading: Reading  # how it reads the log
    cost: float  # log-likelihood that its choice among its kind, and its fitted numbers, take
    joints: tuple[int, ...]  # indices of the joints concerned
    score: LikelihoodScore = NOT_SCORED  # how well it agrees; empty before it is evaluated
    spread: float = 0.0  # standard deviation of the number that was fitted, if one was
    # whether the robot file may be changed to say so; not where its numbers are poorly
    # identifiable
    fixed: bool = True
    # what the misfits are of, and the misfit before [%]; the nominal model or the reference,
    # and that of the explanation before, if `None`
    compared: tuple[str, float] | None = None
    evidence: float | None = None  # log evidence, where bodies are not known, instead of the score
    odds: float | None = None  # log odds, by evidence, to the best reading without its cause
    note: str = ""  # where it is known from, if not from this log

    @property
    def log_likelihood(self) -> float:
        """With what its freedom costs."""
        own = self.score.log_likelihood if self.evidence is None else self.evidence
        return float(own) - self.cost

    @property
    def misfits(self) -> Array:
        """Of every joint, shape `(n,)`."""
        return self.score.misfits

    @property
    def percent(self) -> float:
        """Typical misfit [%]."""
        return float(self.score.percent)


def choice_cost(count: int) -> float:
    """What the choice among so many costs."""
    return float(np.log(max(count, 1)))


SAMPLE_BATCH = 12_000  # samples evaluated at once
ZOOMS = 3  # how often the grid is drawn closer
ZOOMED_POINTS = 9  # numbers between the neighbours of the best one


def likeliest(likelihoods: Callable[[Array], Array], grid: Array) -> tuple[float, float]:
    """The number of the largest log-likelihood, and its standard deviation by the curvature there.

    Sought on a grid that is drawn closer around its best point; infinite where there is no top.
    """
    values = likelihoods(grid)
    for number in range(ZOOMS + 1):
        k = int(np.clip(np.argmax(values), 1, len(grid) - 2))
        if number < ZOOMS:
            grid = np.linspace(grid[k - 1], grid[k + 1], ZOOMED_POINTS)
            values = likelihoods(grid)
    step = float(grid[k] - grid[k - 1])
    before, top, after = values[k - 1 : k + 2]
    bend = (before - 2.0 * top + after) / step**2
    if not -np.inf < bend < 0.0:
        return float(grid[k]), np.inf
    shift = np.clip(0.5 * (before - after) / step / bend, -step, step)
    return float(grid[k] + shift), float(1.0 / np.sqrt(-bend))


def scored(hypotheses: Sequence[Hypothesis]) -> list[Hypothesis]:
    """Hypotheses with their scores, many at a time; orders that leave efforts out are left out."""
    whole = [h for h in hypotheses if h.cause != "joint order" or h.reading.keeps_evidence]
    found = []
    size = max(1, SAMPLE_BATCH // len(whole[0].reading.likelihood.excerpt.t)) if whole else 1
    for start in range(0, len(whole), size):
        part = whole[start : start + size]
        readings, likelihood = [h.reading for h in part], part[0].reading.likelihood
        motions = {r.of_motion: r for r in readings}
        places = {motion: k for k, motion in enumerate(motions)}
        sums = likelihood.sums(list(motions.values()))
        score = likelihood.scored(
            sums.of([places[r.of_motion] for r in readings]),
            np.array([r.effort for r in readings]),
            np.array([r.effort_scale for r in readings]),
        )
        found += [replace(h, score=score.one(k)) for k, h in enumerate(part)]
    return found
