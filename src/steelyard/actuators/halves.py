"""Whether intervals hold: a law is fitted to two halves of the motions, each by itself.

What a law lacks moves its values in all motions, and no scatter within one fit tells how far. Two
fits to other motions, which begin where the search did, tell it.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from steelyard.actuators.actuator_parameters import ActuatorValues
from steelyard.actuators.choice import Search
from steelyard.actuators.fit import Fitted, fit, motions
from steelyard.base.arrays import Z95, frozen

ROUNDS = 10
SHARE = 0.95  # of the values that have to agree


def halves_apart(
    search: Search, start: ActuatorValues, parts: Sequence[str], found: Fitted
) -> float:
    """By which factor intervals of `found` have to be wider for values of two halves to agree.

    The halves are every other motion, and those between. Half the difference of their values has
    the standard deviation of those of `found`, if its intervals hold.
    """
    half, values = motions(search.windows) % 2, []
    for number in (0, 1):
        windows = [w for w, k in zip(search.windows, half, strict=True) if k == number]
        fitted = fit(search.task(windows, parts), start, ROUNDS)
        values.append(np.array([one.at(fitted.values) for one in fitted.task.free]))
    off = np.abs(values[0] - values[1]) / (2.0 * found.std)
    return max(1.0, float(np.quantile(off, SHARE)) / Z95)


def widened(found: Fitted, factor: float) -> Fitted:
    """The same with intervals wider by a factor, but none wider than the prior's."""
    less = np.minimum(1.0, found.task.spread / (factor * found.std)) * factor
    return replace(found, covariance=frozen(found.covariance * np.outer(less, less)))
