"""What estimators look at that simulate: measured signals, and the loop that moved the robot."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from steelyard.arrays import Array, frozen
from steelyard.errors import DataError
from steelyard.estimation.closed_loop.controller import Controller
from steelyard.estimation.closed_loop.forward import Forward
from steelyard.estimation.estimate import Estimate
from steelyard.estimation.least_squares.least_squares import WeightedLeastSquares
from steelyard.measurement.methods.savitzky_golay import SavitzkyGolay
from steelyard.measurement.run import Run
from steelyard.motion import Motion
from steelyard.regression.gather import gather
from steelyard.regression.information import Information
from steelyard.regression.parallel_filter import ParallelFilter
from steelyard.regression.regressor import Regressor

CONTROL_RATE = 1000.0
"""Least rate of simulated controllers [1/s]."""

SETTLING = 0.25
"""Time in which a simulation forgets how it was started, and which is not looked at [s]."""

_RAW = SavitzkyGolay(window=3, degree=2)
"""Positions as they are, and their central differences."""

_SHORTEST, _POSTURES = 2.0, 64


@dataclass(frozen=True, eq=False)
class Loop:
    """How a robot was controlled along one run.

    Attributes:
        controller: Its feedback.
        wanted: Times from the log's start, shape `(K,)` [s], to the positions and velocities that
            were commanded, each `(K, n)`.
        ahead: Times to torques that were added to the feedback, `(K, n)`; none if `None`.
    """

    controller: Controller
    wanted: Callable[[Array], tuple[Array, Array]]
    ahead: Callable[[Array], Array] | None = None


@dataclass(frozen=True, eq=False)
class Measured:
    """A stretch of a run without gaps.

    Attributes:
        name: The run.
        rate: Samples per second [Hz].
        motion: Filtered motion, `N` samples.
        q: Positions as measured, not filtered, shape `(N, n)` [rad; m].
        tau: Joint torques as measured, shape `(N, n)` [Nm; N].
        counts: Which samples of each torque count, ones and zeros, shape `(N, n)`.
        cutoff: Low-pass of regressor and torque alike [Hz].
    """

    name: str
    rate: float
    motion: Motion
    q: Array
    tau: Array
    counts: Array
    cutoff: float

    @property
    def ticks(self) -> int:
        """Ticks of the simulated controller per sample."""
        return max(1, int(np.ceil(CONTROL_RATE / self.rate - 1e-9)))

    @cached_property
    def matched(self) -> ParallelFilter:
        """The filter of regressor and torque alike."""
        return ParallelFilter.design(self.cutoff, self.rate)

    @cached_property
    def counts_after_transient(self) -> Array:
        """`counts` without the transient at the start of a simulation."""
        counts = np.array(self.counts, dtype=np.float64)
        counts[: int(np.ceil(SETTLING * self.rate))] = 0.0
        return frozen(counts)


@dataclass(frozen=True, eq=False)
class StartValues:
    """Values with which simulations start.

    Attributes:
        values: Values of the columns that the data see, shape `(p,)`.
        widths: Speeds within which friction turns, shape `(n,)` [rad/s; m/s].
        notes: How they were come by, where that is worth saying.
    """

    values: Array
    widths: Array
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Experiment:
    """Measured stretches of runs, how they were controlled, and what their motion says by itself.

    Attributes:
        regressor: Model and columns.
        runs: The stretches.
        loops: How each was controlled.
        information: What all of them say about the columns, efforts as joint torques.
        notes: What was assumed, for people to read.
    """

    regressor: Regressor
    runs: tuple[Measured, ...]
    loops: tuple[Loop, ...]
    information: Information
    notes: tuple[str, ...] = ()

    @classmethod
    def of_runs(
        cls,
        regressor: Regressor,
        runs: Sequence[Run],
        loops: Sequence[Loop] | None = None,
        information: Information | None = None,
    ) -> "Experiment":
        """An experiment of logged runs.

        Args:
            regressor: Model and columns.
            runs: The runs; their efforts become joint torques by the robot file's gains.
            loops: How each was controlled; where that is not known, `None`, a controller of our
                own stands in, see `stand_in`.
            information: What the runs say about the columns with efforts as joint torques, if it
                was gathered already.

        Raises:
            DataError: A gain is unknown, the model cannot be simulated, or no stretch is long
                enough.
        """
        Forward(regressor.model, regressor.base.independent)
        stretches = [_stretches(run) for run in runs]
        parts = tuple(part for of_run in stretches for part in of_run)
        if not parts:
            raise DataError(
                f"no segment without gaps is as long as {_SHORTEST:g} s",
                where=", ".join(run.name for run in runs),
                fix="log for longer",
            )
        if information is None:
            units = regressor.model.robot.effort_units
            per_run = [gather(regressor, run).scaled(_gains(run), units) for run in runs]
            information = per_run[0]
            for more in per_run[1:]:
                information = information + more
        if loops is None:
            from steelyard.estimation.closed_loop.assumed_controller import stand_in

            return stand_in(cls(regressor, parts, (), information))
        each = [loop for loop, of_run in zip(loops, stretches, strict=True) for _ in of_run]
        return cls(regressor, parts, tuple(each), information)

    @cached_property
    def start(self) -> Estimate:
        """Weighted least squares on the filtered motion: where searches begin."""
        return WeightedLeastSquares()(self.information)

    @cached_property
    def kept(self) -> list[int]:
        """Columns of the regressor that the data see."""
        place = {name: k for k, name in enumerate(self.regressor.layout.columns)}
        return [place[name] for name in self.start.parameters.names]

    @cached_property
    def dynamics(self) -> Forward:
        """Forward dynamics in the parameters that the data see."""
        names = self.regressor.model.names
        return Forward(
            self.regressor.model, tuple(names.index(n) for n in self.start.parameters.names)
        )

    @cached_property
    def start_values(self) -> "StartValues":
        """Values that can be simulated: the start's, or where it has none, the model file's.

        Raises:
            DataError: Neither has a positive definite mass matrix along the motion.
        """
        from steelyard.estimation.closed_loop.start_values import start_estimate

        return start_estimate(self)

    @property
    def widths(self) -> Array:
        """Speeds within which friction turns in simulations, shape `(n,)`."""
        return self.start_values.widths

    @cached_property
    def postures(self) -> Array:
        """Some postures along the motion, shape `(n, K)`."""
        q = [run.motion.q[:: max(1, len(run.q) // _POSTURES)] for run in self.runs]
        return np.ascontiguousarray(np.concatenate(q).T)

    @property
    def where(self) -> str:
        """Names of the runs, for messages."""
        return ", ".join(dict.fromkeys(run.name for run in self.runs))


def _gains(run: Run) -> Array:
    """Joint torque per unit of effort, shape `(n,)`."""
    signals = run.recording.signals
    if any(signals.unknown_gains):
        raise DataError(
            "simulating the robot needs joint torques, but the drive gains are unknown",
            where=run.name,
            fix="give the gains in [signals.effort], or leave out estimators that simulate",
        )
    return signals.gains


def _stretches(run: Run) -> list[Measured]:
    gains, whole = _gains(run), run.whole()
    chain = replace(run.chain, processing=replace(run.chain.processing, motion=_RAW))
    raw = replace(run, chain=chain).whole()
    counts = whole.moving * (1.0 if whole.weights is None else whole.weights > 0.0)
    found = []
    for segment in np.unique(whole.segment):
        part = np.flatnonzero(whole.segment == segment)
        if len(part) < _SHORTEST * run.rate:
            continue
        inside = slice(int(part[0]), int(part[-1]) + 1)
        found.append(
            Measured(
                run.name,
                run.rate,
                Motion(*(getattr(whole.motion, x)[inside] for x in ("t", "q", "dq", "ddq"))),
                frozen(raw.motion.q[inside]),
                frozen(whole.effort[inside] * gains),
                frozen(counts[inside]),
                run.matched_cutoff,
            )
        )
    return found
