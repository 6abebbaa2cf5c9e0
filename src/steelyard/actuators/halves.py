"""Whether intervals hold: a law is fitted to two halves of the motions, each by itself.

What a law lacks moves its values in all motions, and no scatter within one fit tells how far. Two
fits to other motions, which begin where the search did, tell it.
"""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from steelyard.actuators.actuator_parameters import ActuatorValues
from steelyard.actuators.choice import Search
from steelyard.actuators.fit import Fitted, fit, motions
from steelyard.actuators.target_runs import Window
from steelyard.base.arrays import Z95

COARSE, FINE = (0.02, 8), (0.005, 4)
"""Steps of rollouts [s] and rounds of the fits, one after the other."""
SHARE = 0.95  # of the values that have to agree
LEAST_HALF = 0.25  # of all motion, else logs are cut


def halves_apart(
    search: Search, start: ActuatorValues, parts: Sequence[str], found: Fitted
) -> float:
    """By which factor intervals of `found` have to be wider for values of two halves to agree.

    Half the difference of their values has the standard deviation of those of `found`, if its
    intervals hold.
    """
    half, values = halves(search.windows), []
    for number in (0, 1):
        windows, at = [w for w, k in zip(search.windows, half, strict=True) if k == number], start
        for h, rounds in (COARSE, FINE):
            at = fit(replace(search, h=h).task(windows, parts), at, rounds).values
        values.append(np.array([one.at(at) for one in found.task.free]))
    off = np.abs(values[0] - values[1]) / (2.0 * found.std)
    return max(1.0, float(np.quantile(off, SHARE)) / Z95)


def halves(windows: Sequence[Window]) -> NDArray[np.int_]:
    """Which half each window is in, `(W,)`: logs of about half the length, or parts of one log."""
    seconds: defaultdict[str, float] = defaultdict(float)
    for window in windows:
        seconds[window.run.name] += float(window.t[-1] - window.t[0])
    length, half = [0.0, 0.0], {}
    for name in sorted(seconds, key=lambda name: -seconds[name]):
        half[name] = int(length[1] < length[0])
        length[half[name]] += seconds[name]
    if min(length) < LEAST_HALF * sum(length):
        return np.asarray(motions(windows) % 2)
    return np.array([half[window.run.name] for window in windows])
