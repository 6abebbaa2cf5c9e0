"""Which windows a fit may see while a run, or a stretch of one, is left out to be predicted.

A motion that is in the data twice (periods of a Fourier series, a run that was recorded again) is
no test of a fit to its other half: windows that repeat what is left out are left out with it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil

import numpy as np

from steelyard.arrays import Array
from steelyard.measurement.run import Run
from steelyard.regression.information import Information, Window
from steelyard.validation.cross import stretches_of

PER_WAVE = 20.0
"""Instants at which motions are compared, over the regression cut-off."""

ALIKE = 0.1
"""Distance of alike positions and velocities, in their standard deviations, at most."""

SAME_LAG = 2.0
"""Instants by which the lag of two alike motions may vary."""

SHARE = 0.5
"""Share of a window's instants that must be alike for it to repeat a motion."""


LONGEST = 200_000
"""Samples of a left-out run or stretch that are predicted at most: its first ones."""

INSTANTS = 200_000
"""Instants of a run that are compared with what is left out, at most."""


@dataclass(frozen=True)
class LeftOut:
    """A stretch to be predicted, and what may be fitted meanwhile.

    Attributes:
        run: Number of the run.
        span: Start and end of what is predicted [s].
        fitted: Numbers of the windows that are fitted.
    """

    run: int
    span: tuple[float, float]
    fitted: tuple[int, ...]


def runs_left_out(runs: Sequence[Run], information: Information) -> tuple[LeftOut, ...]:
    """Every run in turn; runs of which nothing but repetitions would be left are not left out.

    Args:
        runs: The fitted runs, each with a name of its own.
        information: What they say.
    """
    wanted = [LeftOut(k, run.span, ()) for k, run in enumerate(runs)]
    return _with_windows(wanted, runs, information)


def stretches_left_out(runs: Sequence[Run], information: Information) -> tuple[LeftOut, ...]:
    """Stretches of the longest run in turn, where all runs are of one motion.

    Args:
        runs: The fitted runs, each with a name of its own.
        information: What they say, in windows shorter than the stretches.
    """
    longest = max(range(len(runs)), key=lambda k: runs[k].duration)
    run = runs[longest]
    begin, end = run.span
    spans = [(max(part.start, begin), min(part.stop, end)) for part in stretches_of(run)]
    wanted = [LeftOut(longest, span, ()) for span in spans]
    return _with_windows(wanted, runs, information)


def _first(run: Run, span: tuple[float, float]) -> tuple[float, float]:
    """The span, or that of its first samples where it has more than `LONGEST`."""
    return span[0], min(span[1], span[0] + LONGEST / run.rate)


def _with_windows(
    wanted: Sequence[LeftOut],
    runs: Sequence[Run],
    information: Information,
) -> tuple[LeftOut, ...]:
    """With what may be fitted; without those for which nothing may."""
    courses, size = _courses(runs)
    place = {run.name: k for k, run in enumerate(runs)}
    found = []
    for one in wanted:
        run = runs[one.run]
        span = _first(run, one.span)
        out = _Course.of(replace(run, span=span)).over(size)
        fitted = tuple(
            k
            for k, window in enumerate(information.windows)
            if not (window.run == run.name and _overlap(window, one.span))
            and not courses[place[window.run]].during(window.start, window.stop).repeats(out)
        )
        found += [LeftOut(one.run, span, fitted)] if fitted else []
    return tuple(found)


def _overlap(window: Window, span: tuple[float, float]) -> bool:
    return bool(window.start < span[1] and span[0] < window.stop)


@dataclass(frozen=True, eq=False)
class _Course:
    """The motion of a run at evenly spaced instants.

    Attributes:
        t: Shape `(N,)` [s].
        states: Positions and velocities, shape `(N, 2 n)`.
        apart: Time between instants [s].
    """

    t: Array
    states: Array
    apart: float

    @classmethod
    def of(cls, run: Run, most: float = np.inf) -> "_Course":
        step = max(1, int(run.rate / (PER_WAVE * run.matched_cutoff)))
        step *= max(1, ceil(run.rate * run.duration / step / most))
        parts = [
            (block.t[::step].copy(), np.concatenate([block.q[:, ::step], block.dq[:, ::step]]).T)
            for block in run.blocks()
        ]
        empty = (np.zeros(0), np.zeros((0, 1)))
        t, states = (np.concatenate(part) for part in zip(*(parts or [empty]), strict=True))
        return cls(t, states, step / run.rate)

    def during(self, start: float, stop: float) -> "_Course":
        mine = (self.t >= start) & (self.t <= stop)
        return replace(self, t=self.t[mine], states=self.states[mine])

    def over(self, size: Array) -> "_Course":
        """In units of `size`, shape `(2 n,)`."""
        return replace(self, states=self.states / size)

    def repeats(self, other: "_Course") -> bool:
        """Whether most of this is what the other does, at one lag."""
        from scipy.spatial import KDTree

        if not len(self.t) or not len(other.t):
            return False
        distance, index = KDTree(other.states).query(
            self.states, p=np.inf, distance_upper_bound=ALIKE
        )
        near = np.isfinite(distance)
        if np.mean(near) < SHARE:
            return False
        lags = self.t[near] - other.t[index[near]]
        steady = np.abs(lags - np.median(lags)) <= SAME_LAG * max(self.apart, other.apart)
        return bool(np.sum(steady) >= SHARE * len(near))


def _courses(runs: Sequence[Run]) -> tuple[list[_Course], Array]:
    """The motions in standard deviations of positions and velocities over all runs, and these."""
    courses = [_Course.of(run, INSTANTS) for run in runs]
    size = np.std(np.concatenate([course.states for course in courses]), axis=0)
    size = np.where(size > 0.0, size, 1.0)
    return [course.over(size) for course in courses], size
