"""Bases of Fourier series: from rest to rest, raw, and brought to rest by blends or ramps."""

from dataclasses import dataclass, replace

import numpy as np

from steelyard.base.arrays import Array, frozen
from steelyard.excite.trajectories.composed import ChainedMotion, TrendedMotion, WindowedMotion
from steelyard.excite.trajectories.fourier import FourierMotion, rest_basis
from steelyard.excite.trajectories.linear_bases import LinearBasis, check_times, checked_postures
from steelyard.excite.trajectories.polynomials import SMOOTH, PiecewiseMotion, quintic
from steelyard.excite.trajectories.trajectory import ExactTrajectory


@dataclass(frozen=True, eq=False)
class RestFourier(LinearBasis):
    """Series that start and end at rest, by the null space of these conditions.

    The first `2H - 2` coefficients are coordinates in `rest_basis`. Without a `start`, the posture
    at both ends is one more and the last. Where the `end` is another posture than the start, a
    minimum-jerk move over the whole time is added [Swevers1997].

    Attributes:
        joints: Number of joints `n`.
        period: Period and length in time [s].
        harmonics: Number of harmonics `H`, 2 or more.
        start: Posture at the start, shape `(n,)`, if it is not to be chosen.
        end: Posture at the end if it is not the start's; only with a `start`.
    """

    joints: int
    period: float
    harmonics: int
    start: Array | None = None
    end: Array | None = None

    def __post_init__(self) -> None:
        check_times(period=self.period)
        rest_basis(self.harmonics)
        checked_postures(self.joints, self.start, self.end)
        if self.end is not None and self.start is None:
            raise ValueError("an end posture of its own needs a start posture")

    @property
    def count(self) -> int:
        """Functions per joint."""
        return 2 * self.harmonics - 2 + (self.start is None)

    @property
    def highest(self) -> float:
        """Frequency of the highest harmonic [Hz]."""
        return self.harmonics / self.period

    @property
    def prescribed_postures(self) -> tuple[Array, ...]:
        """Start and end, as far as they are given."""
        return checked_postures(self.joints, self.start, self.end)

    def still(self, posture: Array) -> Array:
        """No series, at the posture or the given start; a given end is still gone to."""
        x = np.zeros((self.joints, self.count))
        if self.start is None:
            x[:, -1] = posture
        return x

    def made_of(self, rows: Array) -> FourierMotion | TrendedMotion:
        """The motion of coordinates, start and perhaps end in the columns."""
        free, postures = np.split(rows, [2 * self.harmonics - 2], axis=1)
        series = FourierMotion.from_free(postures[:, 0], free, self.period)
        if self.end is None:
            return series
        way = postures[:, 1] - postures[:, 0]
        trend = PiecewiseMotion(np.array([0.0, self.period]), np.outer(SMOOTH, way)[None])
        return TrendedMotion(series, trend)


@dataclass(frozen=True, eq=False)
class RawFourier(LinearBasis):
    """Series of any coefficients, not at rest at their ends.

    The coefficients are those of the sines, the cosines and the mean posture, in this order.

    Attributes:
        joints: Number of joints `n`.
        period: Period and length in time [s].
        harmonics: Number of harmonics `H`, 1 or more.
    """

    joints: int
    period: float
    harmonics: int

    def __post_init__(self) -> None:
        check_times(period=self.period)
        _check_harmonics(self.joints, self.harmonics)

    @property
    def count(self) -> int:
        """Functions per joint."""
        return 2 * self.harmonics + 1

    @property
    def highest(self) -> float:
        """Frequency of the highest harmonic [Hz]."""
        return self.harmonics / self.period

    @property
    def prescribed_postures(self) -> tuple[Array, ...]:
        """No posture."""
        return ()

    def still(self, posture: Array) -> Array:
        """No sines and no cosines, at the posture."""
        return _mean_only(self.count, self.prescribed_postures, frozen(posture, (self.joints,)))

    def made_of(self, rows: Array) -> FourierMotion:
        """The series of the coefficients in the columns."""
        return _series(rows, self.period, 1)


@dataclass(frozen=True, eq=False)
class BlendedFourier(LinearBasis):
    """From rest by a quintic blend into a series, and from it back to rest where it began.

    The coefficients are those of the sines, the cosines and the mean posture, in this order. The
    blends meet position, velocity and acceleration of the series at its first and last time.

    Attributes:
        joints: Number of joints `n`.
        period: Base period [s].
        harmonics: Number of harmonics `H`, 1 or more.
        periods: How often the period is run through.
        blend: Length of each of the two blends [s].
        start: Posture at both ends, shape `(n,)`; the mean posture if `None`.
    """

    joints: int
    period: float
    harmonics: int
    periods: int
    blend: float
    start: Array | None = None

    def __post_init__(self) -> None:
        check_times(period=self.period, blend=self.blend)
        _check_harmonics(self.joints, self.harmonics)
        checked_postures(self.joints, self.start)
        if self.periods < 1:
            raise ValueError(f"{self.periods} periods are not a valid motion")

    @property
    def count(self) -> int:
        """Functions per joint."""
        return 2 * self.harmonics + 1

    @property
    def highest(self) -> float:
        """The faster one of the highest harmonic and the blends [Hz]."""
        return max(self.harmonics / self.period, 1.0 / self.blend)

    @property
    def prescribed_postures(self) -> tuple[Array, ...]:
        """The start, if it is given."""
        return checked_postures(self.joints, self.start)

    def still(self, posture: Array) -> Array:
        """No sines and no cosines, at the posture or the given start."""
        return _mean_only(self.count, self.prescribed_postures, frozen(posture, (self.joints,)))

    def made_of(self, rows: Array) -> ChainedMotion:
        """The motion of the coefficients, and perhaps the start, in the columns."""
        series = _series(rows[:, : self.count], self.period, self.periods)
        place, zero = rows[:, -1], np.zeros(len(rows))
        state = [series.derivative([0.0], order)[0] for order in range(3)]
        rest, times = (place, zero, zero), np.array([0.0, self.blend])
        parts: list[ExactTrajectory] = [
            PiecewiseMotion(times, quintic(rest, state, self.blend)),
            series,
            PiecewiseMotion(times, quintic(state, rest, self.blend)),
        ]
        return ChainedMotion(parts)


@dataclass(frozen=True, eq=False)
class RampedFourier(LinearBasis):
    """Series whose amplitude rises from zero, and falls back to it.

    The coefficients are those of the sines, the cosines and the mean posture, in this order. Unlike
    a `BlendedFourier`, it takes no time before and after the periods.

    Attributes:
        joints: Number of joints `n`.
        period: Base period [s].
        harmonics: Number of harmonics `H`, 1 or more.
        periods: How often the period is run through, ramps included.
        ramp: Length of each of the two ramps [s].
        start: Posture at both ends, shape `(n,)`; the mean posture if `None`.
    """

    joints: int
    period: float
    harmonics: int
    periods: int
    ramp: float
    start: Array | None = None

    def __post_init__(self) -> None:
        check_times(period=self.period, ramp=self.ramp)
        _check_harmonics(self.joints, self.harmonics)
        checked_postures(self.joints, self.start)
        self.made_of(np.zeros((1, self.count)))

    @property
    def count(self) -> int:
        """Functions per joint."""
        return 2 * self.harmonics + 1

    @property
    def highest(self) -> float:
        """The highest harmonic together with the ramp [Hz]."""
        return self.harmonics / self.period + 0.5 / self.ramp

    @property
    def prescribed_postures(self) -> tuple[Array, ...]:
        """The start, if it is given."""
        return checked_postures(self.joints, self.start)

    def still(self, posture: Array) -> Array:
        """No sines and no cosines, at the posture or the given start."""
        return _mean_only(self.count, self.prescribed_postures, frozen(posture, (self.joints,)))

    def made_of(self, rows: Array) -> WindowedMotion:
        """The motion of the coefficients, and perhaps the start, in the columns."""
        series, place = _series(rows[:, : self.count], self.period, self.periods), rows[:, -1]
        return WindowedMotion(place, replace(series, start=series.start - place), self.ramp)


def _mean_only(count: int, prescribed_postures: tuple[Array, ...], posture: Array) -> Array:
    """Coefficients that are zero but for the last, the posture or a prescribed one."""
    (place,) = prescribed_postures or (posture,)
    x = np.zeros((len(posture), count))
    x[:, -1] = place
    return x


def _series(rows: Array, period: float, periods: int) -> FourierMotion:
    """The series of sines, cosines and mean in the columns."""
    harmonics = rows.shape[1] // 2
    sine, cosine = rows[:, :harmonics], rows[:, harmonics:-1]
    start = rows[:, -1] + cosine.sum(axis=1)
    return FourierMotion(start, sine, cosine, period, periods, rests=False)


def _check_harmonics(joints: int, harmonics: int) -> None:
    checked_postures(joints)
    if harmonics < 1:
        raise ValueError(f"a series needs 1 harmonic or more, not {harmonics}")
