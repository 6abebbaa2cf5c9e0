"""Random motions of all kinds."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from steelyard.excite.trajectories.exact_trajectories import (
    ChainedMotion,
    ExactTrajectory,
    PiecewiseMotion,
    SampledMotion,
    through_postures,
)
from steelyard.excite.trajectories.fourier import FourierMotion, repeated


def rest_fourier(rng: np.random.Generator, periods: int = 2) -> FourierMotion:
    harmonics = int(rng.integers(2, 9))
    free = rng.standard_normal((3, 2 * harmonics - 2))
    return FourierMotion.from_free(rng.standard_normal(3), free, rng.uniform(1.0, 12.0), periods)


def raw_fourier(rng: np.random.Generator, periods: int = 1) -> FourierMotion:
    sine, cosine = rng.standard_normal((2, 3, int(rng.integers(1, 9))))
    start, period = rng.standard_normal(3), rng.uniform(1.0, 12.0)
    return FourierMotion(start, sine, cosine, period, periods, rests=False)


def piecewise(rng: np.random.Generator) -> PiecewiseMotion:
    pieces, degree = rng.integers(1, 7, size=2)
    coefficients = rng.standard_normal((pieces, degree + 1, 3))
    for before, after in zip(coefficients, coefficients[1:], strict=False):
        after[0] = before.sum(axis=0)
    return PiecewiseMotion(np.cumsum([0.0, *rng.uniform(0.2, 3.0, pieces)]), coefficients)


def table(rng: np.random.Generator) -> SampledMotion:
    t = np.cumsum(rng.uniform(0.05, 1.0, 12))
    return SampledMotion(t, rng.standard_normal((12, 3)))


def chained(rng: np.random.Generator) -> ChainedMotion:
    first = raw_fourier(rng)
    way = np.vstack([first.start, rng.standard_normal((2, 3)), first.start])
    return ChainedMotion((first, through_postures(way, [0.7, 1.3, 0.4], 0.2), first), times=3)


def trended(rng: np.random.Generator) -> FourierMotion:
    series = rest_fourier(rng, periods=1)
    line = through_postures(rng.standard_normal((3, 3)), 0.5 * series.duration)
    return replace(series, trend=PiecewiseMotion(line.breaks, line.coefficients))


def windowed(rng: np.random.Generator) -> FourierMotion:
    series = raw_fourier(rng, periods=2)
    ramp = series.duration * rng.choice([0.03, 0.2, 0.5])
    return series.ramped(rng.standard_normal(3), ramp)


def several(rng: np.random.Generator) -> ExactTrajectory:
    return repeated(through_postures([[0.0, 1, 2], [1.0, -1, 3], [0.0, 1, 2]], 0.9), 4)


MAKERS: tuple[Callable[[np.random.Generator], ExactTrajectory], ...] = (
    rest_fourier,
    raw_fourier,
    piecewise,
    table,
    chained,
    trended,
    windowed,
    several,
)
