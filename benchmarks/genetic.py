"""A parallelogram robot with Stribeck friction, identified by a genetic algorithm and by ours.

The setting of Wang et al., "Genetic Algorithm Based Dynamics Modeling and Control of a Parallel
Rehabilitation Robot": three inertial parameters, per joint Coulomb and viscous friction, here with
the Stribeck effect; minimum-jerk reaches, 50 Hz, torque noise. The genetic algorithm searches all
linear parameters and Stribeck speeds at once, 30 chromosomes over 100 generations; ours searches
the speeds alone and solves the rest.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from steelyard.base.arrays import Parameter
from steelyard.estimate.estimate import Estimate
from steelyard.estimate.information.base_parameters_and_regressor import Regressor, base_regressor
from steelyard.estimate.information.filter_and_gram import Accumulator, Stretch
from steelyard.estimate.information.information import Information, Signature, Window
from steelyard.estimate.least_squares.weighted_robust_and_whitened import WeightedLeastSquares
from steelyard.estimate.nonlinear.nonlinear_parameters import FoundFields, find_fields
from steelyard.excite.search.search_methods import minimised_by_genes
from steelyard.model.equations.inverse_dynamics import JointState
from steelyard.model.laws.friction_over_speed import Coulomb, Stribeck, Viscous
from steelyard.model.model import Model
from steelyard.model.terms.axes_and_fields import Find
from steelyard.model.terms.term import Cause, Columns, Dissipation, Term
from steelyard.robot.robot import Coordinate, Robot

RATE, REACHES, REACH_TIME, NOISE = 50.0, 16, 1.2, 0.02
RANGES = np.deg2rad([[-20.0, 80.0], [80.0, 190.0]])
SLOWEST, FASTEST = 1e-3, 1.0
CHROMOSOMES, GENERATIONS = 30, 100

UPPER = np.array([0.5, 0.5, 0.5, *np.full(6, 1.0)])
"""Range of the linear parameters, from zero: inertial ones, then Coulomb, viscous, excess."""


@dataclass(frozen=True)
class Parallelogram(Term):
    """Inertia of a parallelogram five-bar whose two motors share an axis (their eq. 13)."""

    law: ClassVar[str] = "parallelogram"
    dissipation: ClassVar[Dissipation] = "none"
    cause: ClassVar[Cause] = "inertia"

    def parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        """Inertia of each motor's side, and their coupling."""
        return tuple(Parameter(f"phi{k}", "kg m²") for k in (1, 2, 3))

    def columns(self, robot: Robot, state: JointState) -> Columns:
        """Columns of the two motors' torques."""
        (q1, q2), (dq1, dq2), (ddq1, ddq2) = state.q, state.dq, state.ddq
        c, s = np.cos(q2 - q1), np.sin(q2 - q1)
        return {
            (0, 0): ddq1,
            (0, 1): ddq2 * c - dq2 * dq2 * s,
            (1, 1): ddq1 * c + dq1 * dq1 * s,
            (1, 2): ddq2,
        }


@dataclass(frozen=True, eq=False)
class Log:
    """Samples, joint-major `(2, N)`, with the truth of the Stribeck speeds `(2,)`."""

    q: np.ndarray
    dq: np.ndarray
    ddq: np.ndarray
    effort: np.ndarray
    speeds: np.ndarray

    def information_of(self, regressor: Regressor) -> Information:
        """What the log says about a regressor."""
        channels = regressor.model.scan()(self.q, self.dq, self.ddq)
        stretch = Stretch(self.q, self.dq, self.ddq, self.effort, None, channels)
        sums = Accumulator(regressor)(stretch)
        signature = Signature(
            regressor.model.fingerprint, regressor.layout.columns, ("Nm", "Nm"), "none"
        )
        return Information(
            regressor.layout, signature, (Window("log", 0.0, 1.0),),
            sums.grams[None], sums.absolute[None], sums.counts[None],
        )  # fmt: skip


def model_with(speed: object) -> Model:
    """The robot with its friction."""
    arms = (Coordinate("hip", "revolute"), Coordinate("knee", "revolute"))
    terms = (Parallelogram(), Coulomb(), Viscous(), Stribeck(speed=speed))  # type: ignore[arg-type]
    return Model(Robot("parallelogram", (), arms), terms)


def linear_columns(log: Log, speeds: np.ndarray) -> np.ndarray:
    """Columns of the nine linear parameters, by hand: `(P, 2, N, 9)` for speeds `(P, 2)`."""
    q, dq, ddq = log.q, log.dq, log.ddq
    c, s = np.cos(q[1] - q[0]), np.sin(q[1] - q[0])
    columns = np.zeros((len(speeds), 2, q.shape[1], 9))
    columns[:, 0, :, 0] = ddq[0]
    columns[:, 0, :, 1] = ddq[1] * c - dq[1] ** 2 * s
    columns[:, 1, :, 1] = ddq[0] * c + dq[0] ** 2 * s
    columns[:, 1, :, 2] = ddq[1]
    for j in range(2):
        sense = np.sign(dq[j])
        columns[:, j, :, 3 + j] = sense
        columns[:, j, :, 5 + j] = dq[j]
        columns[:, j, :, 7 + j] = sense * np.exp(-np.abs(dq[j]) / speeds[:, j, None])
    return columns


def drawn(seed: int) -> Log:
    """Minimum-jerk reaches between random targets, and the torque of a random robot."""
    rng = np.random.default_rng(seed)
    count = int(REACH_TIME * RATE)
    x = np.arange(count) / count
    shape = 10 * x**3 - 15 * x**4 + 6 * x**5
    speed = (30 * x**2 - 60 * x**3 + 30 * x**4) / REACH_TIME
    push = (60 * x - 180 * x**2 + 120 * x**3) / REACH_TIME**2
    targets = rng.uniform(RANGES[:, 0], RANGES[:, 1], (REACHES + 1, 2))
    parts = [
        (a[:, None] + (b - a)[:, None] * shape, (b - a)[:, None] * speed, (b - a)[:, None] * push)
        for a, b in zip(targets[:-1], targets[1:], strict=True)
    ]
    q, dq, ddq = (np.concatenate(x, axis=1) for x in zip(*parts, strict=True))
    speeds = np.exp(rng.uniform(np.log(0.03), np.log(0.3), 2))
    friction = rng.uniform([0.1, 0.1, 0.2, 0.2, 0.1, 0.1], [0.25, 0.25, 0.5, 0.5, 0.3, 0.3])
    truth = np.array([0.20, 0.10, 0.24, *friction])
    still = Log(q, dq, ddq, np.zeros_like(q), speeds)
    effort = linear_columns(still, speeds[None])[0] @ truth
    return Log(q, dq, ddq, effort + NOISE * rng.standard_normal(q.shape), speeds)


def root_mean_square(log: Log, linear: np.ndarray, speeds: np.ndarray) -> np.ndarray:
    """Errors of chromosomes [Nm], `(P,)`: parameters `(P, 9)` and speeds `(P, 2)`; their eq. 24."""
    j, s = np.arange(2), np.sign(log.dq)
    c, w = np.cos(log.q[1] - log.q[0]), np.sin(log.q[1] - log.q[0])
    twin = np.array([log.ddq[1] * c - log.dq[1] ** 2 * w, log.ddq[0] * c + log.dq[0] ** 2 * w])
    fading = np.exp(-np.abs(log.dq) / speeds[:, :, None])
    torque = (
        linear[:, [0, 2], None] * log.ddq
        + linear[:, 1, None, None] * twin
        + (linear[:, 3 + j, None] + linear[:, 7 + j, None] * fading) * s
        + linear[:, 5 + j, None] * log.dq
    )
    return np.asarray(np.sqrt(np.mean((log.effort - torque) ** 2, axis=(1, 2))))


def genetic(log: Log, seed: int) -> tuple[np.ndarray, float]:
    """The best chromosome, 9 linear parameters and 2 speeds, and its error [Nm]."""

    def errors(genes: np.ndarray) -> np.ndarray:
        return root_mean_square(log, genes[:, :9], np.exp(genes[:, 9:]))

    low = np.concatenate([np.zeros(9), np.full(2, np.log(SLOWEST))])
    high = np.concatenate([UPPER, np.full(2, np.log(FASTEST))])
    sizes, random = (
        {"population": CHROMOSOMES, "generations": GENERATIONS},
        np.random.default_rng(seed),
    )
    best, cost = minimised_by_genes(errors, low, high, **sizes, random=random)
    return np.concatenate([best[:9], np.exp(best[9:])]), cost


def ours(log: Log, seed: int) -> tuple[FoundFields, Estimate]:
    """Fields from one start, and all other parameters."""
    wanted = model_with(Find(SLOWEST, FASTEST, shared=False))
    found = find_fields(wanted, log.information_of, starts=1, seed=seed)
    return found, WeightedLeastSquares()(log.information_of(base_regressor(found.model)))


def error_of(log: Log, found: FoundFields, estimate: Estimate) -> float:
    """Error of our estimate [Nm], by the same formula as the genetic algorithm's."""
    known = estimate.parameters.as_dict()
    linear = np.array([known.get(name, 0.0) for name in found.model.names])
    speeds = np.array([[f.value for f in found.findings]])
    return float(root_mean_square(log, linear[None], speeds)[0])


def comparison(best: Callable[..., float], seeds: range) -> list[tuple[str, str, str, bool]]:
    """Rows for the benchmark's table: times and errors of both, on the same logs."""
    logs = [drawn(seed) for seed in seeds]
    ours(logs[0], 0)
    mine = np.mean([best(lambda k=k, x=x: ours(x, k), 3) for k, x in enumerate(logs)])
    theirs = np.mean([best(lambda k=k, x=x: genetic(x, k), 1) for k, x in enumerate(logs)])
    errors = np.array([[error_of(x, *ours(x, k)), genetic(x, k)[1]] for k, x in enumerate(logs)])
    worst, least = errors[:, 1].max() / NOISE, errors[:, 1].min() / NOISE
    return [
        ("Stribeck speeds, 2 joints, steelyard", f"{1e3 * mine:.0f} ms", "", True),
        ("the same, genetic algorithm of 30 x 100", f"{1e3 * theirs:.0f} ms", "", True),
        ("genetic algorithm: ratio of times", f"{theirs / mine:.1f}", "", True),
        ("error over the noise, steelyard", f"{errors[:, 0].max() / NOISE:.3f} at most", "", True),
        ("error over the noise, genetic", f"{least:.2f} to {worst:.2f}", "", True),
    ]
