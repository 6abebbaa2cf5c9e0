"""Intervals behind noise that is not white: do the stated 95 % still hold the truth?

Torque noise white, low-passed (a first-order lag of 50 or 100 ms, far longer than the samples'
distance), and both together; default filters; 200 draws over the four robots of `recovery`,
each with a motion, a truth and noise of its own. Weighted least squares, and the consistent
estimate with the weight of its prior found from the data. Beside them, for comparison, intervals
that count on white residuals, and the full sandwich.
"""

from collections import defaultdict
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from proofs.estimation.recovery import RATE, log_of, robots
from proofs.support.claims import Claim, main_of

from steelyard.base.arrays import Z95, Array
from steelyard.estimate.consistent.convex_estimator import Consistent
from steelyard.estimate.estimate import Estimate
from steelyard.estimate.information.base_parameters_and_regressor import base_regressor
from steelyard.estimate.information.gather import gather
from steelyard.estimate.least_squares.covariance_from_residuals import scores_of_windows
from steelyard.estimate.least_squares.normal_equations import Fit, shared_map
from steelyard.estimate.least_squares.weighted_robust_and_whitened import WeightedLeastSquares
from steelyard.estimate.prior.body_priors import default_knowledge
from steelyard.model.model import Model
from steelyard.robot.robot import Robot
from steelyard.runs.prepare import prepare
from steelyard.simulate.ground_truth import random_truth

DRAWS = 50
"""Draws per robot."""

LEARNED = 0.8
"""Share from data that a parameter of the consistent estimate must have to be counted."""

CONSISTENT, WEIGHTED = "consistent", "WLS"
WHITE, SANDWICH = "WLS, residuals taken as white", "WLS, full sandwich"


@dataclass(frozen=True)
class Coloured:
    """Torque noise, white and slow.

    Attributes:
        name: What it is called.
        white: Size of the white part.
        slow: Size of the slow part.
        lag: Time constant of the slow part [s].
    """

    name: str
    white: float
    slow: float
    lag: float = 0.1

    def __call__(self, rng: np.random.Generator, shape: tuple[int, ...]) -> Array:
        """Samples, shape `(N, n)`."""
        from scipy.signal import lfilter

        keep = float(np.exp(-1.0 / (self.lag * RATE)))
        driven = rng.standard_normal(shape)
        driven[1:] *= np.sqrt(1.0 - keep**2)
        slow = lfilter([1.0], [1.0, -keep], driven, axis=0)
        return np.asarray(self.white * rng.standard_normal(shape) + self.slow * slow)


NOISES = (
    Coloured("white", 1.0, 0.0),
    Coloured("lag of 50 ms", 0.0, 1.0, 0.05),
    Coloured("lag of 100 ms", 0.0, 1.0),
    Coloured("white and lag of 100 ms", 0.7, 0.7),
)
"""One after another over the draws."""

Coverage = dict[tuple[str, str], list[bool]]
"""Whether intervals hold, by kind of interval and name of the noise."""


def add_coverage(robot: Robot, found: Coverage) -> None:
    """All draws of one robot."""
    regressor = base_regressor(Model(robot))
    consistent = Consistent(regressor.base, default_knowledge(regressor.model))
    weighted = WeightedLeastSquares()
    for seed in range(DRAWS):
        noise = NOISES[seed % len(NOISES)]
        truth = random_truth(robot, seed)
        information = gather(regressor, prepare(log_of(robot, truth, seed, noise)))
        values = regressor.base.base_values(truth.values.values)
        true = dict(zip(regressor.base.base_names, values, strict=True))
        fit, estimate, posterior = (
            make(information) for make in (weighted.fit, weighted, consistent)
        )
        assert posterior.learned is not None
        taught = posterior.learned >= LEARNED
        deviations = [np.sqrt(np.diag(c)) for c in (fit.inverse, sandwich(fit))]
        inside = {
            WEIGHTED: _inside(estimate, estimate.std, true),
            CONSISTENT: _inside(posterior, posterior.std, true)[taught],
            WHITE: _inside(estimate, deviations[0], true),
            SANDWICH: _inside(estimate, deviations[1], true),
        }
        for kind, some in inside.items():
            found[kind, noise.name] += some.tolist()


def sandwich(fit: Fit) -> Array:
    r"""The full sandwich by windows, $\frac{W}{W-1} K (\sum_w g_w g_w^T) K$.

    Its rank is $W - 1$ at most: of use only with several times more windows than parameters.
    """
    kept, inverse = fit.kept, fit.inverse
    found: dict[str, Array] = {}
    for own, _, columns, _, scores in scores_of_windows(fit, len(fit.data.whole.windows)):
        found.setdefault(own.run, np.zeros((len(scores), len(kept))))
        found[own.run] += scores @ shared_map(own, kept)[columns]
    stacked = np.concatenate(list(found.values()))
    middle = stacked.T @ stacked * (len(stacked) / max(len(stacked) - 1, 1))
    covariance = inverse @ middle @ inverse
    return np.asarray(0.5 * (covariance + covariance.T))


def _inside(estimate: Estimate, std: Array, true: dict[str, float]) -> NDArray[np.bool_]:
    wanted = np.array([true[name] for name in estimate.parameters.names])
    return np.abs(estimate.parameters.values - wanted) <= Z95 * std


def _claim(name: str, inside: list[bool]) -> Claim:
    """Held against a bound, but for the kinds that are there for comparison."""
    share = 100.0 * float(np.mean(inside))
    if name.startswith((WHITE, SANDWICH)):
        return Claim(name, f"{share:.1f} %", "reported", True)
    return Claim(name, f"{share:.1f} %", "90 to 99 %", 90.0 <= share <= 99.0)


def main() -> list[Claim]:
    """Coverage by noise, and over all."""
    found: Coverage = defaultdict(list)
    for robot in robots():
        add_coverage(robot, found)
    claims = []
    for kind in (WHITE, SANDWICH, WEIGHTED, CONSISTENT):
        for noise in NOISES:
            claims.append(_claim(f"{kind}, {noise.name}", found[kind, noise.name]))
        everything = [x for (name, _), some in found.items() if name == kind for x in some]
        count = f"all {len(everything)} pairs of {len(robots()) * DRAWS} draws"
        claims.append(_claim(f"{kind}, {count}", everything))
    return claims


if __name__ == "__main__":
    main_of(main)
