"""Which windows a fit may see while a run, or a stretch of one, is left out to be predicted.

A motion that is in the data twice (periods of a Fourier series, a run that was recorded again) is
no test of a fit to its other half: windows that repeat what is left out are left out with it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

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


@dataclass(frozen=True)
class LeftOut:
    """A stretch to be predicted, and what may be fitted meanwhile.

    Attributes:
        run: Number of the run.
        span: Start and end of the stretch [s].
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
    begin, end = runs[longest].span
    wanted = [
        LeftOut(longest, (max(part.start, begin), min(part.stop, end)), ())
        for part in stretches_of(runs[longest])
    ]
    return _with_windows(wanted, runs, information)


def _with_windows(
    wanted: Sequence[LeftOut],
    runs: Sequence[Run],
    information: Information,
) -> tuple[LeftOut, ...]:
    """With what may be fitted; without those for which nothing may."""
    courses = _courses(runs)
    place = {run.name: k for k, run in enumerate(runs)}
    found = []
    for one in wanted:
        out = courses[one.run].during(*one.span)
        fitted = tuple(
            k
            for k, window in enumerate(information.windows)
            if not (window.run == runs[one.run].name and _overlap(window, one.span))
            and not courses[place[window.run]].during(window.start, window.stop).repeats(out)
        )
        found += [LeftOut(one.run, one.span, fitted)] if fitted else []
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
    def of(cls, run: Run) -> "_Course":
        step = max(1, int(run.rate / (PER_WAVE * run.matched_cutoff)))
        parts = [
            (block.t[::step], np.concatenate([block.q, block.dq])[:, ::step].T)
            for block in run.blocks()
        ]
        t, states = (np.concatenate(part) for part in zip(*parts, strict=True))
        return cls(t, states, step / run.rate)

    def during(self, start: float, stop: float) -> "_Course":
        mine = (self.t >= start) & (self.t <= stop)
        return replace(self, t=self.t[mine], states=self.states[mine])

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


def _courses(runs: Sequence[Run]) -> list[_Course]:
    """The motions, every position and velocity in its standard deviation over all runs."""
    courses = [_Course.of(run) for run in runs]
    size = np.std(np.concatenate([course.states for course in courses]), axis=0)
    size = np.where(size > 0.0, size, 1.0)
    return [replace(course, states=course.states / size) for course in courses]
