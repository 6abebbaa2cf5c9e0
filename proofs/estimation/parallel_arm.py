"""The comparison of Wang et al. (p5) on one parallel arm: least squares, genetic algorithm, CMA-ES.

A true parallelogram five-bar in the horizontal plane, closed by its loop, with friction of its own
in each direction as in their table III, moves on minimum-jerk reaches between the centre and eight
targets on a circle, 50 Hz, eight periods, torque noise of the size of their residuals. Reaches to
targets 1 to 4 are fitted, those to 5 to 8 predicted; errors are root mean squares of each joint.
The paper has 0.116 and 0.201 Nm for least squares with 7 parameters, 0.036 and 0.102 Nm for the
genetic algorithm with 9, 30 individuals over 100 generations. What it does not say: friction of its
own in each direction is linear too.
"""

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TypeVar

import numpy as np
from proofs.support.claims import Claim, main_of

from steelyard.base.arrays import Array
from steelyard.estimate.estimate import Estimate, Estimator
from steelyard.estimate.information.base_parameters_and_regressor import (
    Regressor,
    base_regressor,
    standard_regressor,
)
from steelyard.estimate.information.filter_and_gram import Accumulator, Stretch
from steelyard.estimate.information.information import Information, Signature, Window
from steelyard.estimate.least_squares.known_bounded_and_ridge import (
    BoundedLeastSquares,
    base_bounds,
)
from steelyard.estimate.least_squares.weighted_robust_and_whitened import OrdinaryLeastSquares
from steelyard.estimate.prior.body_priors import default_knowledge
from steelyard.excite.constraints.constraint_and_limits import MotionLimits
from steelyard.excite.planned.joints_along_path import along_path
from steelyard.excite.planned.tool_paths_lines_and_reach import Reaches, on_circle, out_and_back
from steelyard.excite.search.search_methods import minimised_by_genes
from steelyard.model.laws.friction_over_speed import (
    Coulomb,
    DirectionalCoulomb,
    DirectionalViscous,
    Viscous,
)
from steelyard.model.laws.laws_without_friction import RigidBody
from steelyard.model.model import Model
from steelyard.model.terms.term import Term
from steelyard.robot.inertia_and_placement import Inertia
from steelyard.robot.robot import Frame

sys.path[:0] = [str(Path(__file__).parents[2] / name) for name in ("tests", "benchmarks")]
from linear_searches import CmaEs, Genetic  # noqa: E402

from closed_chains import parallelogram  # noqa: E402

L1, L2, CENTRE, RADIUS = 0.3, 0.4, 0.4, 0.2
RATE, REACH_TIME, PERIODS = 50.0, 1.2, 8
NOISE = np.array([0.03, 0.09])
"""White torque noise [Nm]."""

TIP = Frame("tip", 2, np.eye(3), np.array([L1, 0.0, 0.0]))

FRICTION = {
    "directional_viscous_forward": (0.2202, 0.4776),
    "directional_viscous_backward": (0.2644, 0.5482),
    "directional_coulomb_forward": (0.0082, 0.2446),
    "directional_coulomb_backward": (0.2580, 0.0036),
}
"""Their table III."""

PAPER = np.array([[0.0744, 0.1843, 0.2390], [0.0593, 0.1609, 0.2380]])
"""Their inertial parameters, by the genetic algorithm and by least squares."""

MODELS: dict[int, tuple[Term, ...]] = {
    7: (RigidBody(), Coulomb(), Viscous()),
    9: (RigidBody(), DirectionalCoulomb(), Viscous()),
    11: (RigidBody(), DirectionalCoulomb(), DirectionalViscous()),
}
SEEDS = 5

Result = TypeVar("Result")


def arm(terms: tuple[Term, ...]) -> Model:
    """The arm; centres of mass lie on the bars, as in the paper."""
    bars = ((1.1, 0.12, 0.008), (0.9, 0.16, 0.011), (0.7, 0.13, 0.006), (0.4, 0.2, 0.006))
    inertias = tuple(
        Inertia.about_com(mass, (com, 0.0, 0.0), np.diag([1e-4, about, about]))
        for mass, com, about in bars
    )
    return Model(parallelogram(inertias, L1, L2), terms)


def reaches(targets: range) -> tuple[Array, Array, Array]:
    """Reaches there and back: positions, velocities and accelerations, each `(2, N)`."""
    home, up = np.array([0.0, CENTRE, 0.0]), np.array([0.0, 0.0, 1.0])
    places = on_circle(home, RADIUS, 8, up, 0.0)[np.array(targets) % 8]
    path = Reaches(out_and_back(home, places, 1), REACH_TIME, 0.0)
    robot = arm(MODELS[7]).robot
    limits = MotionLimits([-0.5, 1.4], [1.4, 3.3], [3.0, 3.0], [20.0, 20.0])
    t = np.arange(round(path.knots[-1] * RATE)) / RATE
    motion = along_path(robot, limits, TIP, path).trajectory.sample(t)
    q, dq, ddq = (np.tile(x.T, PERIODS) for x in (motion.q, motion.dq, motion.ddq))
    return q, dq, ddq


@dataclass(frozen=True, eq=False)
class Log:
    """Samples of one set of reaches, joint-major `(2, N)`."""

    q: Array
    dq: Array
    ddq: Array
    effort: Array

    @classmethod
    def drawn(cls, targets: range, rng: np.random.Generator) -> "Log":
        """The true arm on its reaches, its torque with noise."""
        model, motion = arm(MODELS[11]), reaches(targets)
        truth = np.array([p.prior or 0.0 for p in model.parameters])
        for name, values in FRICTION.items():
            for joint, value in enumerate(values, start=1):
                truth[model.names.index(f"{name}.link{joint}_joint")] = value
        effort = standard_regressor(model).dense(*motion) @ truth
        return cls(*motion, effort + NOISE[:, None] * rng.standard_normal(effort.shape))

    def information_of(self, regressor: Regressor) -> Information:
        """One pass: what the log says of the paper's columns; all centres lie on their bars."""
        channels = regressor.model.scan()(self.q, self.dq, self.ddq)
        sums = Accumulator(regressor)(
            Stretch(self.q, self.dq, self.ddq, self.effort, None, channels)
        )
        signature = Signature(
            regressor.model.fingerprint, regressor.layout.columns, ("Nm", "Nm"), "none"
        )
        return Information(
            regressor.layout, signature, (Window("reaches", 0.0, 1.0),),
            sums.grams[None], sums.absolute[None], sums.counts[None],
        ).select([n for n in regressor.layout.columns if not n.startswith("my.")])  # fmt: skip

    def errors(self, regressor: Regressor, estimate: Estimate) -> Array:
        """Root mean square error of each joint [Nm]."""
        information = self.information_of(regressor)
        known = estimate.parameters.as_dict()
        squares = information.residual_squares(
            np.array([known[n] for n in information.layout.columns])
        )
        return np.asarray(np.sqrt(squares / information.n_samples))


def on_samples(log: Log, seeds: range) -> tuple[float, Array, float]:
    """The paper's way with 11 parameters, every individual's torque at every sample.

    Returns:
        Root mean square error of their eq. 20 [Nm], that of the algorithm per seed, and how many
        times longer the algorithm takes.
    """
    regressor = base_regressor(arm(MODELS[11]))
    columns = [k for k, n in enumerate(regressor.layout.columns) if not n.startswith("my.")]
    dense = regressor.dense(log.q, log.dq, log.ddq)[:, :, columns].reshape(-1, len(columns))
    effort = log.effort.ravel()

    def criterion(genes: Array) -> Array:
        return np.asarray(np.sqrt(np.mean(np.square(effort - genes @ dense.T), axis=1)))

    def searched(seed: int) -> Array:
        random = np.random.default_rng(seed)
        return np.array(
            [minimised_by_genes(criterion, np.zeros(11), np.ones(11), random=random)[1]]
        )

    def solved() -> Array:
        return np.linalg.solve(dense.T @ dense, dense.T @ effort)

    errors = np.concatenate([searched(seed) for seed in seeds])
    _, theirs = timed(lambda: searched(0), 2)
    values, ours = timed(solved, 300)
    return float(criterion(values[None])[0]), errors, theirs / ours


def timed(work: Callable[[], Result], repeats: int) -> tuple[Result, float]:
    """What it gives, and the least wall time [s]."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        result = work()
        times.append(time.perf_counter() - start)
    return result, min(times)


def compared(log: Log, fresh: Log, size: int) -> tuple[list[Claim], dict[str, Array]]:
    """Lines of the table for one number of parameters, and errors of training and prediction."""
    regressor = base_regressor(arm(MODELS[size]))
    information = log.information_of(regressor)
    known = base_bounds(regressor.base, default_knowledge(regressor.model))
    bounds = {name: known[name] for name in information.layout.columns}
    ways: dict[str, Estimator[Information]] = {
        "least squares": OrdinaryLeastSquares(),
        "constrained least squares": BoundedLeastSquares(bounds),
        "genetic algorithm": Genetic(bounds),
        "CMA-ES": CmaEs(bounds),
    }
    claims, errors = [], {}
    for name, estimator in ways.items():
        estimate, took = timed(partial(estimator, information), 2)
        found = np.array([x.errors(regressor, estimate) for x in (log, fresh)])
        (a, b), (c, d) = found
        line = f"{a:.4f} {b:.4f}, fresh {c:.4f} {d:.4f} Nm"
        claims.append(Claim(f"{name}, {size} parameters", line, f"{1e3 * took:.2g} ms", True))
        errors[name] = found
    return claims, errors


def main() -> list[Claim]:
    """The table, and what it comes to."""
    rng = np.random.default_rng(0)
    log, fresh = Log.drawn(range(1, 5), rng), Log.drawn(range(5, 9), rng)
    table, errors = [], {}
    for size in MODELS:
        lines, errors[size] = compared(log, fresh, size)
        table += lines
    fit = {n: {k: float(np.linalg.norm(x[0])) for k, x in e.items()} for n, e in errors.items()}
    best = [min(v for k, v in fit[n].items() if k != "least squares") for n in (9, 11)]
    excess = max(fit[n]["least squares"] / least for n, least in zip((9, 11), best, strict=True))
    fall = errors[9]["least squares"][1] / errors[7]["least squares"][1]
    least, genetic, ratio = on_samples(log, range(SEEDS))
    impossible = (PAPER[:, 1] ** 2 / (PAPER[:, 0] * PAPER[:, 2])).min()
    return [
        *table,
        Claim(
            "9 and 11: least squares over the best search, training",
            f"{excess:.6f}", "<= 1", excess <= 1.0 + 1e-9,
        ),
        Claim(
            "least squares, 9 over 7 parameters, fresh, joints 1 and 2",
            f"{fall[0]:.2f} {fall[1]:.2f}", "<= 0.75 (paper: 0.31 0.51)", bool(fall.max() <= 0.75),
        ),
        Claim(
            f"11 on samples: genetic algorithm over least squares, {SEEDS} seeds",
            f"{genetic.min() / least:.4f} to {genetic.max() / least:.4f}",
            ">= 1", bool(genetic.min() >= least),
        ),
        Claim("11 on samples: ratio of times", f"{ratio:.0f}", ">= 1000", ratio >= 1000.0),
        Claim(
            "the paper's inertias: square of the coupling over the others' product",
            f"{impossible:.2f} at least", "> 1: no arm can have them", bool(impossible > 1.0),
        ),
    ]  # fmt: skip


if __name__ == "__main__":
    main_of(main)
