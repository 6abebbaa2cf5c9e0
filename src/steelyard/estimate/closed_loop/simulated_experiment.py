r"""Measured signals and the loop that moved the robot, simulated with a model from start values.

It follows the log's own smoothed motion by joint feedback of 20 Hz, critically damped, with the
inertias that the log shows, and adds the log's own smoothed torque to it: a model with the right
values then needs next to no feedback. What is simulated is therefore the logged motion seen
through a loop of some 20 Hz; it holds no noise that such a loop does not pass.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import cast

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array, frozen, places_of
from steelyard.base.errors import DataError
from steelyard.base.motion import Motion
from steelyard.base.progress import Progress, report_progress, silent
from steelyard.estimate.closed_loop.feedback_and_forward_dynamics import (
    Forward,
    Integration,
    JointPD,
    impossible_mass,
    tuned_pd,
)
from steelyard.estimate.estimate import Estimate
from steelyard.estimate.information.base_parameters_and_regressor import Regressor
from steelyard.estimate.information.filter_and_gram import ParallelFilter
from steelyard.estimate.information.information import Information
from steelyard.estimate.least_squares.weighted_robust_and_whitened import WeightedLeastSquares
from steelyard.estimate.nonlinear.nonlinear_parameters import information_from
from steelyard.model.laws.laws_without_friction import RigidBody
from steelyard.model.terms.term import ActsOnAxes
from steelyard.runs.run import Run
from steelyard.runs.smoothing.smoothing_methods_and_zero_phase_filters import zero_phase
from steelyard.runs.smoothing.spline_and_finite_windows import SavitzkyGolay

CONTROL_RATE = 1000.0  # least rate of simulated controllers [1/s]
SETTLING = 0.25  # time in which a simulation forgets how it was started; not looked at [s]
_RAW = SavitzkyGolay(window=3, degree=2)  # positions as they are, and their central differences

_SHORTEST, _POSTURES = 2.0, 64


@dataclass(frozen=True, eq=False)
class RunController:
    """How a robot was controlled along one run."""

    controller: JointPD
    # times from the log's start, `(K,)` [s], to the positions and velocities that were commanded,
    # each `(K, n)`
    wanted: Callable[[Array], tuple[Array, Array]]
    # times to torques that were added to the feedback, `(K, n)`; none if `None`
    ahead: Callable[[Array], Array] | None = None


@dataclass(frozen=True, eq=False)
class Measured:
    """A stretch of a run without gaps."""

    name: str  # the run
    rate: float
    motion: Motion  # filtered motion, `N` samples
    q: Array  # positions as measured, not filtered, `(N, n)` [rad; m]
    tau: Array  # joint torques as measured, `(N, n)` [Nm; N]
    counts: Array  # which samples of each torque count, ones and zeros, `(N, n)`
    cutoff: float  # low-pass of regressor and torque alike [Hz]

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
    """Values with which simulations start, of the columns that the data see, `(p,)`."""

    values: Array
    widths: Array  # of speed, within which friction turns, `(n,)` [rad/s; m/s]
    notes: tuple[str, ...] = ()  # how they were come by


@dataclass(frozen=True, eq=False)
class Experiment:
    """Measured stretches of runs, how they were controlled, and what their motion says itself."""

    regressor: Regressor
    runs: tuple[Measured, ...]
    loops: tuple[RunController, ...]
    information: Information  # efforts are joint torques
    notes: tuple[str, ...] = ()  # what was assumed

    @classmethod
    def of_runs(
        cls, regressor: Regressor, runs: Sequence[Run], information: Information | None = None
    ) -> "Experiment":
        """An experiment of logged runs; their efforts become joint torques by the gains.

        How they were controlled is not logged: a controller of our own stands in. The information,
        efforts as joint torques, is gathered if it is not given. A `DataError` says why the runs
        cannot be simulated.
        """
        Forward(regressor.model, regressor.base.independent)
        parts = tuple(part for run in runs for part in _stretches(run))
        if not parts:
            wrong = f"no segment without gaps is as long as {_SHORTEST:g} s"
            fix = "log for longer"
            raise DataError(wrong, where=", ".join(run.name for run in runs), fix=fix)
        if information is None:
            information = information_from(runs)(regressor)
        found = cls(regressor, parts, (), information)
        q, start = found.postures, found.start_values
        masses, _ = found.dynamics.mass_and_bias(q, np.zeros_like(q), start.values, start.widths)
        own = tuple(_assumed_loop(run, masses) for run in parts)
        return replace(found, loops=own, notes=(ASSUMED_CONTROLLER_NOTE,))

    @cached_property
    def start(self) -> Estimate:
        """Weighted least squares on the filtered motion: where searches begin."""
        return WeightedLeastSquares()(self.information)

    @cached_property
    def kept(self) -> list[int]:
        """Columns of the regressor that the data see."""
        return places_of(self.start.parameters.names, self.regressor.layout.columns)

    @cached_property
    def dynamics(self) -> Forward:
        """Forward dynamics in the parameters that the data see."""
        model = self.regressor.model
        return Forward(model, tuple(places_of(self.start.parameters.names, model.names)))

    @cached_property
    def start_values(self) -> StartValues:
        """Values that can be simulated: the start's, or the nominal bodies with its friction."""
        try:
            return _tried(self, self.start.parameters.values, ())
        except DataError:
            nominal = _nominal(self)
            if nominal is None:
                raise
        return _tried(self, nominal, (START_VALUES_NOTE,))

    @cached_property
    def postures(self) -> Array:
        """Some postures along the motion, shape `(n, K)`."""
        q = [run.motion.q[:: max(1, len(run.q) // _POSTURES)] for run in self.runs]
        return np.ascontiguousarray(np.concatenate(q).T)

    @property
    def where(self) -> str:
        """Names of the runs, for messages."""
        return ", ".join(dict.fromkeys(run.name for run in self.runs))


def _stretches(run: Run) -> list[Measured]:
    signals = run.recording.signals
    if any(signals.unknown_gains):
        wrong = "simulating the robot needs joint torques, but the drive gains are unknown"
        fix = "give the gains in [signals.effort], or leave out estimators that simulate"
        raise DataError(wrong, where=run.name, fix=fix)
    whole = run.whole()
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
                frozen(whole.effort[inside] * signals.gains),
                frozen(counts[inside]),
                run.matched_cutoff,
            )
        )
    return found


BANDWIDTH = 20.0  # natural frequency of the joints' errors [Hz]
_TORQUE_CUTOFF = 2.0  # low-pass of the torque that is added, over the regression cut-off

_HIGHEST = 0.4

ASSUMED_CONTROLLER_NOTE = (
    f"the log contains no controller data: a joint controller of {BANDWIDTH:g} Hz is assumed, "
    "which follows the log's smoothed motion and adds its smoothed torque"
)


def _assumed_loop(run: Measured, masses: Array) -> RunController:
    """Feedback to the smoothed motion of a run, and its smoothed torque."""
    from scipy.interpolate import CubicHermiteSpline

    motion = run.motion
    q = CubicHermiteSpline(motion.t, motion.q, motion.dq)
    dq = CubicHermiteSpline(motion.t, motion.dq, motion.ddq)
    cutoff = min(_TORQUE_CUTOFF * run.cutoff, _HIGHEST * run.rate)
    smooth = zero_phase(run.tau, cutoff, run.rate)

    def wanted(t: Array) -> tuple[Array, Array]:
        inside = np.clip(t, motion.t[0], motion.t[-1])
        return np.asarray(q(inside)), np.asarray(dq(inside))

    def ahead(t: Array) -> Array:
        return np.column_stack([np.interp(t, motion.t, column) for column in smooth.T])

    return RunController(tuned_pd(masses, BANDWIDTH, run.rate * run.ticks), wanted, ahead)


_TICKS_PER_EVENT = 500
_DIVERGED_DISTANCE = 3.0  # distance from the measured motion that is a run-away [rad; m]


@dataclass(frozen=True, eq=False)
class Simulated:
    """One run, simulated in `L` lanes, at the samples of the measured one."""

    # positions, velocities and accelerations of the first lane, each `(N, n)`; the last are central
    # differences over two ticks
    motion: tuple[Array, Array, Array]
    tau: Array  # joint torques, `(N, n, L)`: the mean of those held before and after each sample
    possible: NDArray[np.bool_]  # lanes whose mass matrix was always positive definite, `(L,)`
    sound: NDArray[np.bool_]  # those of them that did not run away, `(L,)`


def simulate(
    experiment: Experiment, values: Array, progress: Progress = silent, widths: Array | None = None
) -> tuple[Simulated, ...]:
    """The runs as the model makes them, with parameters `(p, L)`, or `(p,)` for one lane.

    Jumps turn within widths of speed `(n,)`, those of the start if `None`.
    """
    turning = experiment.start_values.widths if widths is None else widths
    return tuple(
        _simulate_run(run, loop, experiment.dynamics, values, turning, progress)
        for run, loop in zip(experiment.runs, experiment.loops, strict=False)
    )


def simulate_soundly(
    experiment: Experiment, values: Array, progress: Progress = silent, widths: Array | None = None
) -> tuple[Simulated, ...]:
    """The same; a `DataError` unless the first lane of every run is sound."""
    simulated = simulate(experiment, values, progress, widths)
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
    return simulated


def _simulate_run(
    run: Measured,
    loop: RunController,
    dynamics: Forward,
    values: Array,
    widths: Array,
    progress: Progress,
) -> Simulated:
    """One run as the model makes it, from its first measured sample, tick by tick."""
    lanes = np.reshape(values, (len(values), -1))
    ticks, samples, n = run.ticks, len(run.q), dynamics.n
    motion, tau = np.empty((3, samples, n)), np.empty((samples, n, lanes.shape[1]))
    least, farthest = np.full(lanes.shape[1], np.inf), np.zeros(lanes.shape[1])
    step = 1.0 / (run.rate * ticks)
    t = run.motion.t[0] + np.arange((samples - 1) * ticks + 1) * step
    wanted_q, wanted_dq = loop.wanted(t)
    ahead = np.zeros_like(wanted_q) if loop.ahead is None else loop.ahead(t)
    with np.errstate(all="ignore"):
        moving = Integration(dynamics, lanes, widths)
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
                tau[sample] = commanded if previous is None else 0.5 * (previous + commanded)
                motion[:2, sample] = moving.q[:, 0], now
                distance = np.abs(moving.q - run.motion.q[sample][:, None]).max(axis=0)
                np.maximum(farthest, distance, out=farthest)
            moving.effort[:] = previous = commanded
            moving.advance(step)
            np.fmin(least, moving.least, out=least, where=farthest < _DIVERGED_DISTANCE)
            if inside == 0:
                motion[2, sample] = (moving.dq[:, 0] - before) / (step if k == 0 else 2 * step)
            before = now
    possible = ~(least <= 0.0)
    sound = possible & (farthest < _DIVERGED_DISTANCE) & np.isfinite(tau).all(axis=(0, 1))
    return Simulated((motion[0], motion[1], motion[2]), tau, possible, sound)


START_VALUES_NOTE = (
    "the estimate from the filtered motion cannot be simulated: the search started from the "
    "inertial parameters of the model file"
)


def _tried(experiment: Experiment, values: Array, notes: tuple[str, ...]) -> StartValues:
    """The values, if the runs can be simulated with them."""
    widths = experiment.dynamics.widths(experiment.postures, values)
    simulate_soundly(experiment, values, widths=widths)
    return StartValues(values, widths, notes)


def _nominal(experiment: Experiment) -> Array | None:
    """Bodies of the model file, the other terms as they were found but within their bounds.

    Rotors are customarily matched to what they move, and noise makes inertia seem small: a rotor
    has at least the inertia of the bodies that its joint moves.
    """
    model = experiment.regressor.model
    if not all(body.known for body in model.robot.bodies):
        return None
    bodies = {p.name: p.prior or 0.0 for p in RigidBody().parameters(model.robot)}
    found = experiment.start.parameters.as_dict()
    standard = {p.name: max(found.get(p.name, 0.0), p.lower) for p in model.parameters} | bodies
    rotors = [cast(ActsOnAxes, term) for term in model.terms if term.role == "rotor"]
    alone = standard | {p.name: 0.0 for term in rotors for p in term.parameters(model.robot)}
    q, still = experiment.postures, np.zeros_like(experiment.postures)
    ones = np.ones(model.robot.n)
    mass = experiment.dynamics.mass_and_bias(q, still, _based(experiment, alone), ones)[0]
    moved = np.diagonal(mass, axis1=1, axis2=2).mean(axis=0)
    for term in rotors:
        named = term.parameters(model.robot)
        for axis, parameter in zip(term.axes(model.robot), named, strict=True):
            row = np.array(axis.row)
            size = float(np.min(moved[row != 0.0] / row[row != 0.0] ** 2))
            standard[parameter.name] = max(standard[parameter.name], size)
    return _based(experiment, standard)


def _based(experiment: Experiment, standard: Mapping[str, float]) -> Array:
    """Base parameters that the data see, of standard ones."""
    base, names = experiment.regressor.base, experiment.start.parameters.names
    return frozen(base.values_of(names, [standard[name] for name in base.names]))
