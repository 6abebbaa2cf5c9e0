"""What is removed over 200 draws, and whether intervals hold after the choice.

A simulated arm of six joints, some of whose base parameters are zero or small; the residuals are
white or slowly varying. A parameter whose value is above five of its standard deviations in the
full model of that draw counts as significant.
"""

import sys
from functools import reduce as joined
from operator import add
from pathlib import Path

import numpy as np
from proofs.support.claims import Claim, main_of

sys.path.append(str(Path(__file__).parents[2] / "tests"))
from drawn import motion_of, samples_of
from invented import dh_arm
from steelyard.base.arrays import Z95, Array
from steelyard.estimate.information.base_parameters_and_regressor import base_regressor
from steelyard.estimate.information.information import Information
from steelyard.estimate.least_squares.weighted_robust_and_whitened import WeightedLeastSquares
from steelyard.estimate.reduction.stopping_rules_and_reduction import reduce
from steelyard.model.model import Model

DRAWS, RUNS, COUNT = 200, 4, 240
REGRESSOR = base_regressor(Model(dh_arm()))
NAMES = REGRESSOR.layout.columns


def truth(random: np.random.Generator) -> Array:
    """Values, a third of which are zero and a third small."""
    values = random.normal(size=len(NAMES))
    kind = random.permutation(len(NAMES)) % 3
    return np.where(kind == 0, 0.0, np.where(kind == 1, 0.05 * values, values))


def data(draw: int, *, slow: bool) -> tuple[Array, list[Information]]:
    """True values, and the runs of a draw."""
    random = np.random.default_rng([draw, slow])
    values, runs = truth(random), []
    for run in range(RUNS):
        motion = motion_of(len(REGRESSOR.layout.rows), COUNT, 1000 * draw + run)
        effort = REGRESSOR.dense(*motion) @ values
        noise = random.normal(size=effort.shape)
        if slow:
            for k in range(1, COUNT):
                noise[:, k] = 0.8 * noise[:, k - 1] + 0.6 * noise[:, k]
        runs.append(samples_of(REGRESSOR, motion, effort + noise, f"run{run}").information())
    return values, runs


def main() -> list[Claim]:
    """Significant parameters that go, and intervals of those that stay."""
    claims = []
    for label, slow in (("white residuals", False), ("residuals correlated over 5 samples", True)):
        gone = significant = inside = counted = removed = zero = 0
        for draw in range(DRAWS):
            values, runs = data(draw, slow=slow)
            true = dict(zip(NAMES, values, strict=True))
            whole = joined(add, runs)
            full = WeightedLeastSquares()(whole)
            found = reduce(whole).estimate
            ratios = np.abs(full.parameters.values) / full.std
            strong = {n for n, r in zip(full.parameters.names, ratios, strict=True) if r > 5.0}
            out = {one.name for one in found.removed}
            significant, gone = significant + len(strong), gone + len(strong & out)
            zero += sum(true[name] == 0.0 for name in NAMES)
            removed += sum(true[name] == 0.0 for name in out)
            chosen = reduce(joined(add, runs[: RUNS // 2])).estimate.parameters.names
            rest = WeightedLeastSquares()(joined(add, runs[RUNS // 2 :]).select(chosen))
            errors = [rest.parameters[n] - true[n] for n in rest.parameters.names]
            inside += int(np.sum(np.abs(errors) < Z95 * rest.std))
            counted += len(errors)
        share = 100.0 * gone / significant
        value = (
            f"{share:.2f} % of {significant}; {100.0 * removed / zero:.0f} % of true zeros removed"
        )
        claims.append(
            Claim(f"{label}: removed above 5 standard deviations", value, "< 1 %", share < 1.0)
        )
        inside_percent = 100.0 * inside / counted
        value = f"{inside_percent:.1f} % of {counted}"
        claims.append(
            Claim(
                f"{label}: 95 % intervals, chosen on one half of the runs, estimated on the other",
                value,
                "90 to 98 %",
                90.0 <= inside_percent <= 98.0,
            )
        )
    return claims


if __name__ == "__main__":
    main_of(main)
