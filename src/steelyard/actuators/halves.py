"""Whether intervals hold: a law is fitted to two halves of the motions, each by itself.

What a law lacks moves its values in all motions, and no scatter within one fit tells how far. Two
fits to other motions tell it; they begin with the values with which signs were found.
"""

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from steelyard.actuators.actuator_parameters import ActuatorValues
from steelyard.actuators.choice import Search
from steelyard.actuators.fit import Fitted, fit, motions
from steelyard.actuators.target_runs import Window
from steelyard.base.arrays import Z95, frozen

COARSE, FINE = (0.02, 8), (0.005, 4)
"""Steps of rollouts [s] and rounds of the fits, one after the other."""
SHARE = 0.95  # of the values that have to agree
LESS = 10.0
"""Times the least standard deviation of all motion, above which a half does not show a value."""
ASSUMED = 0.5  # of the prior's standard deviation, from which on a value is mostly the prior's
MOST_SPREADS = 3.0  # standard deviations of the prior: whatever an actuator can be
LEAST_HALF = 0.25  # of all motion, else logs are cut


def halves_apart(
    search: Search,
    start: ActuatorValues,
    parts: Sequence[str],
    found: Fitted,
    progress: Callable[[int], None] = lambda half: None,
) -> float | None:
    """By which factor intervals of `found` have to be wider for the values of two halves to agree.

    With shares $f_1, f_2$ of the windows, the difference of two values has $1 / f_1 + 1 / f_2$
    times the variance of those of `found`, if its intervals hold. Values of which one half has far
    less information, such as those of a joint that moves in the other one, and values that are
    mostly what is assumed, are not compared; `None` if no value is.
    """
    half, both = halves(search.windows), list[Fitted]()
    for number in (0, 1):
        progress(number)
        windows, at = [w for w, k in zip(search.windows, half, strict=True) if k == number], start
        for h, rounds in (COARSE, FINE):
            fitted = fit(replace(search, h=h).task(windows, parts), at, rounds)
            at = fitted.values
        both.append(fitted)
    told = np.array([one.least_std < LESS * found.least_std for one in both]).all(axis=0)
    told &= found.least_std < ASSUMED * found.task.spread
    if not told.any():
        return None
    one, two = (np.array([x.at(fitted.values) for x in fitted.task.free]) for fitted in both)
    shares = [len(fitted.task.windows) / len(search.windows) for fitted in both]
    off = (np.abs(one - two) / (found.std * np.sqrt(sum(1.0 / share for share in shares))))[told]
    return max(1.0, float(np.quantile(off, SHARE, method="higher")) / Z95)


def widened(found: Fitted, factor: float) -> Fitted:
    """The same with this factor on the standard deviations that motions tell.

    None is more than `MOST_SPREADS` of the prior's: motions that do not show a value do not tell
    how far off it is either.
    """
    covariance = found.covariance + (factor**2 - 1.0) * found.scatter
    std = np.sqrt(np.diag(covariance))
    less = np.minimum(1.0, MOST_SPREADS * found.task.spread / std)
    return replace(found, covariance=frozen(covariance * np.outer(less, less)))


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
