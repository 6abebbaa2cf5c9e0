r"""The weight of the prior: of a stated uncertainty, or estimated from the data.

Stated, $\gamma = 1/s^2$ with the prior's relative uncertainty $s$. Otherwise the $\gamma$ under
which the data are likeliest, all parameters integrated out (Laplace) [MacKay1992], and never so
large that the weighted squares rise over those of least squares by more than the rank of the data:
as much as noise alone moves them.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from steelyard.arrays import Array

LEAST, MOST = 1e-3, 1e4
"""Range of weights; prior uncertainties of 3000 % and 1 %."""

FIRST = 10.0
"""Weight that is tried first: 32 %."""

STEP = 6.0
"""Factor between weights until the likeliest is between two."""

REFINED = 2
"""Times that a parabola through three weights gives a better one."""

SOLVES = 15
"""Most solutions of a search."""


@dataclass(frozen=True, eq=False)
class Tried:
    """The solution with one weight.

    Attributes:
        gamma: The weight.
        u: The unknowns.
        rise: Rise of the weighted squares over those of least squares.
        evidence: Logarithm of the data's likelihood, but for a constant.
    """

    gamma: float
    u: Array
    rise: float
    evidence: float


@dataclass(frozen=True, eq=False)
class Weighed:
    """A weight and the solution with it.

    Attributes:
        tried: The solution.
        solves: Solutions that the search took.
        physics: The rise without a prior worth the name where that is more than the rank of the
            data; else zero.
    """

    tried: Tried
    solves: int = 1
    physics: float = 0.0


Attempt = Callable[[float, Array | None], Tried]
"""The solution with a weight, from unknowns of a solution nearby if there are any."""


def weighed(attempt: Attempt, rank: int) -> Weighed:
    """Search the likeliest weight whose rise the data allow.

    Args:
        attempt: The solution with a weight.
        rank: Rise that is allowed.
    """
    search = _Search(attempt)
    best = search.likeliest()
    if search.at(best).rise <= rank:
        return Weighed(search.at(best), len(search.found))
    least = search.at(LEAST).rise
    allowed = rank if least <= rank else least + rank
    gamma = search.largest(best, allowed)
    return Weighed(search.at(gamma), len(search.found), least if least > rank else 0.0)


class _Search:
    """Weights that were tried; each is solved once."""

    def __init__(self, attempt: Attempt) -> None:
        self._attempt = attempt
        self.found: dict[float, Tried] = {}

    def at(self, gamma: float) -> Tried:
        """The solution with a weight."""
        if gamma not in self.found:
            apart = {abs(np.log(gamma / known)): tried.u for known, tried in self.found.items()}
            self.found[gamma] = self._attempt(gamma, apart[min(apart)] if apart else None)
        return self.found[gamma]

    def likeliest(self) -> float:
        """The weight of most evidence, at an end of the range or between its neighbours."""
        best = FIRST
        for factor in (STEP, 1.0 / STEP):
            while LEAST < best < MOST:
                further = float(np.clip(best * factor, LEAST, MOST))
                if self.at(further).evidence <= self.at(best).evidence:
                    break
                best = further
        for _ in range(REFINED):
            below = max((g for g in self.found if g < best), default=None)
            above = min((g for g in self.found if g > best), default=None)
            if below is None or above is None:
                break
            gamma = self._peak(below, best, above)
            best = max(best, gamma, key=lambda g: self.at(g).evidence)
        return best

    def _peak(self, *gammas: float) -> float:
        """Top of the parabola through three weights, in their logarithm, kept between them."""
        x, y = np.log(gammas), [self.at(g).evidence for g in gammas]
        curve = np.polyfit(x - x[1], y, 2)
        top = -curve[1] / (2.0 * curve[0]) if curve[0] < 0.0 else 0.0
        return float(np.exp(x[1] + np.clip(top, 0.8 * (x[0] - x[1]), 0.8 * (x[2] - x[1]))))

    def largest(self, high: float, allowed: float) -> float:
        """The largest weight below `high` whose rise is allowed, to a few percent."""
        low = max((g for g, t in self.found.items() if t.rise <= allowed), default=LEAST)
        high = min((g for g, t in self.found.items() if t.rise > allowed), default=high)
        while len(self.found) < SOLVES and high > 1.1 * low:
            middle = float(np.sqrt(low * high))
            low, high = (middle, high) if self.at(middle).rise <= allowed else (low, middle)
        return low
