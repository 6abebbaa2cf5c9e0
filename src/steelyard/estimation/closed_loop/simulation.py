"""Closed-loop simulation of a model along measured runs, many sets of parameters side by side."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.errors import DataError
from steelyard.estimation.closed_loop.experiment import Experiment, Loop, Measured
from steelyard.estimation.closed_loop.forward import Forward, Integration, impossible_mass
from steelyard.progress import Progress, report_progress, silent

_TICKS_PER_EVENT = 500
_BEYOND = 3.0
"""Distance from what was measured at which a simulation has run away [rad; m]."""


@dataclass(frozen=True, eq=False)
class Simulated:
    """One run, simulated in `L` lanes, at the samples of the measured one.

    Attributes:
        q: Positions of the first lane, shape `(N, n)`; likewise `dq` and `ddq`, which is a central
            difference over two ticks.
        tau: Joint torques, shape `(N, n, L)`: the mean of those held before and after each sample.
        possible: Lanes whose mass matrix was always positive definite, shape `(L,)`.
        sound: Those of them that did not run away, shape `(L,)`.
    """

    q: Array
    dq: Array
    ddq: Array
    tau: Array
    possible: NDArray[np.bool_]
    sound: NDArray[np.bool_]

    @property
    def motion(self) -> tuple[Array, Array, Array]:
        """Position, velocity and acceleration of the first lane."""
        return self.q, self.dq, self.ddq


def simulate(
    experiment: Experiment, values: Array, progress: Progress = silent
) -> tuple[Simulated, ...]:
    """The runs as the model makes them, under the same control.

    Args:
        experiment: Runs and their control.
        values: Parameters, shape `(p, L)`, or `(p,)` for one lane.
        progress: Told how far it is.

    Raises:
        Stopped: `progress` requested a stop.
    """
    widths = experiment.start_values.widths
    return tuple(
        along(run, loop, experiment.dynamics, values, widths, progress)
        for run, loop in zip(experiment.runs, experiment.loops, strict=True)
    )


def require_sound(experiment: Experiment, simulated: Sequence[Simulated]) -> None:
    """Raise unless the first lane of every run is sound."""
    for run, found in zip(experiment.runs, simulated, strict=False):
        if not found.possible[0]:
            raise impossible_mass(experiment.regressor.model)
        if not found.sound[0]:
            raise DataError(
                "the simulation diverged with the current estimate",
                where=run.name,
                fix="filter the motion more, log a more exciting one, or check that controller "
                "and reference motion are those of the log",
            )


def along(
    run: Measured,
    loop: Loop,
    dynamics: Forward,
    values: Array,
    widths: Array,
    progress: Progress = silent,
) -> Simulated:
    """One run as the model makes it.

    Args:
        run: What was measured; the simulation starts from its first sample.
        loop: How it was controlled.
        dynamics: What moves.
        values: Parameters, shape `(p, L)`, or `(p,)` for one lane.
        widths: Speeds within which friction turns, shape `(n,)`.
        progress: Told how far it is.
    """
    lanes = np.reshape(values, (len(values), -1))
    with np.errstate(all="ignore"):
        return _Tape(run, dynamics.n, lanes.shape[1]).filled(
            run, loop, Integration(dynamics, lanes, widths), progress
        )


class _Tape:
    """What is kept of a simulation."""

    def __init__(self, run: Measured, n: int, lanes: int) -> None:
        self.motion = np.empty((3, len(run.q), n))
        self.tau = np.empty((len(run.q), n, lanes))
        self.least = np.full(lanes, np.inf)
        self.farthest = np.zeros(lanes)

    def filled(
        self, run: Measured, loop: Loop, moving: Integration, progress: Progress
    ) -> Simulated:
        """Ticks of the controller, one after another."""
        ticks, samples = run.ticks, len(run.q)
        step = 1.0 / (run.rate * ticks)
        t = run.motion.t[0] + np.arange((samples - 1) * ticks + 1) * step
        wanted_q, wanted_dq = loop.wanted(t)
        ahead = np.zeros_like(wanted_q) if loop.ahead is None else loop.ahead(t)
        moving.q[:], moving.dq[:] = run.motion.q[0][:, None], run.motion.dq[0][:, None]
        previous, before = None, moving.dq[:, 0].copy()
        for k in range(len(t)):
            if k % _TICKS_PER_EVENT == 0:
                report_progress(progress, f"simulating {run.name}", k * step, len(t) * step)
            rate = wanted_dq[k] - moving.dq.T
            commanded = loop.controller.torque(wanted_q[k] - moving.q.T, rate).T + ahead[k][:, None]
            sample, inside = divmod(k, ticks)
            now = moving.dq[:, 0].copy()
            if inside == 0:
                self.tau[sample] = commanded if previous is None else 0.5 * (previous + commanded)
                self.motion[:2, sample] = moving.q[:, 0], now
                distance = np.abs(moving.q - run.motion.q[sample][:, None]).max(axis=0)
                np.maximum(self.farthest, distance, out=self.farthest)
            moving.effort[:] = previous = commanded
            moving.advance(step)
            near = self.farthest < _BEYOND
            np.fmin(self.least, moving.least, out=self.least, where=near)
            if inside == 0:
                self.motion[2, sample] = (moving.dq[:, 0] - before) / (step if k == 0 else 2 * step)
            before = now
        possible = ~(self.least <= 0.0)
        sound = possible & (self.farthest < _BEYOND) & np.isfinite(self.tau).all(axis=(0, 1))
        q, dq, ddq = self.motion
        return Simulated(q, dq, ddq, self.tau, possible, sound)
