r"""The weight of the prior: the likeliest one that the data allow.

The weight of the prior: stated, $\gamma = 1/s^2$ with the prior's relative uncertainty $s$.
Otherwise the $\gamma$ under which the data are likeliest, all parameters integrated out (Laplace)
[MacKay1992], and never so large that the weighted squares rise over those of least squares by more
than the rank of the data: as much as noise alone moves them.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from steelyard.base.arrays import Array

LEAST_PRIOR_WEIGHT, MOST_PRIOR_WEIGHT = 1e-3, 1e4  # uncertainties of 3000 % and 1 %
FIRST_PRIOR_WEIGHT = 10.0  # weight that is tried first: 32 %
PRIOR_WEIGHT_STEP = 6.0  # factor between weights until the likeliest is between two
REFINED = 2  # times that a parabola through three weights gives a better one
SOLVES = 15  # most solutions of a search


@dataclass(frozen=True, eq=False)
class Tried:
    """The solution with one weight."""

    gamma: float  # the weight
    u: Array
    rise: float  # rise of the weighted squares over those of least squares
    evidence: float  # logarithm of the data's likelihood, but for a constant


@dataclass(frozen=True, eq=False)
class Weighed:
    """A weight and the solution with it."""

    tried: Tried
    solves: int = 1  # solutions that the search took
    physics: float = 0.0  # rise without a prior worth the name, if above the rank of the data


def weighed(attempt: Callable[[float, Array | None], Tried], rank: int) -> Weighed:
    """Search the likeliest weight whose rise is allowed, up to `rank`.

    `attempt` solves with a weight, from unknowns of a solution nearby if there are any.
    """
    search = _Search(attempt)
    best = search.likeliest()
    if search.at(best).rise <= rank:
        return Weighed(search.at(best), len(search.found))
    least = search.at(LEAST_PRIOR_WEIGHT).rise
    physics = least if least > rank else 0.0
    gamma = search.largest(best, rank + physics)
    return Weighed(search.at(gamma), len(search.found), physics)


@dataclass(frozen=True, eq=False)
class _Search:
    """Weights that were tried; each is solved once."""

    attempt: Callable[[float, Array | None], Tried]
    found: dict[float, Tried] = field(default_factory=dict)

    def at(self, gamma: float) -> Tried:
        """The solution with a weight."""
        if gamma not in self.found:
            apart = {abs(np.log(gamma / known)): tried.u for known, tried in self.found.items()}
            self.found[gamma] = self.attempt(gamma, apart[min(apart)] if apart else None)
        return self.found[gamma]

    def likeliest(self) -> float:
        """The weight of most evidence, at an end of the range or between its neighbours."""
        best = FIRST_PRIOR_WEIGHT
        for factor in (PRIOR_WEIGHT_STEP, 1.0 / PRIOR_WEIGHT_STEP):
            while LEAST_PRIOR_WEIGHT < best < MOST_PRIOR_WEIGHT:
                further = float(np.clip(best * factor, LEAST_PRIOR_WEIGHT, MOST_PRIOR_WEIGHT))
                if self.at(further).evidence <= self.at(best).evidence:
                    break
                best = further
        for _ in range(REFINED):
            below = max((g for g in self.found if g < best), default=None)
            above = min((g for g in self.found if g > best), default=None)
            if below is None or above is None:
                break
            # top of the parabola through three weights, in their logarithm, kept between them
            x = np.log([below, best, above])
            y = [self.at(g).evidence for g in (below, best, above)]
            curve = np.polyfit(x - x[1], y, 2)
            top = -curve[1] / (2.0 * curve[0]) if curve[0] < 0.0 else 0.0
            away = np.clip(top, 0.8 * (x[0] - x[1]), 0.8 * (x[2] - x[1]))
            gamma = float(np.exp(x[1] + away))
            best = max(best, gamma, key=lambda g: self.at(g).evidence)
        return best

    def largest(self, high: float, allowed: float) -> float:
        """The largest weight below `high` whose rise is allowed, to a few percent."""
        low = max(
            (g for g, t in self.found.items() if t.rise <= allowed), default=LEAST_PRIOR_WEIGHT
        )
        high = min((g for g, t in self.found.items() if t.rise > allowed), default=high)
        while len(self.found) < SOLVES and high > 1.1 * low:
            middle = float(np.sqrt(low * high))
            low, high = (middle, high) if self.at(middle).rise <= allowed else (low, middle)
        return low
