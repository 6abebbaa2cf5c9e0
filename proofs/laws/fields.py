"""Stribeck speeds of a parallelogram robot: found from one start, against all there are.

Twenty robots with logs of their own. The truth of the search is a dense grid over both speeds with
a polish by Nelder and Mead, written here over plain arrays. A genetic algorithm of 30 x 100 runs on
the same logs, see `benchmarks/genetic.py`; times are reported, `make bench` shows them too.
"""

import sys
import time
from pathlib import Path

import numpy as np
from proofs.support.claims import Claim, main_of
from scipy.optimize import minimize

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
from genetic import FASTEST, NOISE, SLOWEST, Log, drawn, error_of, genetic, linear_columns, ours

SEEDS, GRID, ROUNDS = 20, 60, 30
SAME = 1e-4
"""Relative difference of geometric mean residuals; half a unit of the criterion's 3.84."""


def grams_of(log: Log, speeds: np.ndarray) -> np.ndarray:
    """Gram matrices of columns and effort per row, `(P, 2, 10, 10)`, for speeds `(P, 2)`."""
    columns = linear_columns(log, speeds)
    effort = np.broadcast_to(log.effort[None, :, :, None], (*columns.shape[:3], 1))
    both = np.concatenate([columns, effort], axis=3)
    return np.asarray(both.transpose(0, 1, 3, 2) @ both)


def residual(grams: np.ndarray, count: int) -> np.ndarray:
    """Geometric mean of both rows' residuals [Nm], `(...)`, least over the linear parameters.

    Args:
        grams: Shape `(..., 2, 10, 10)`.
        count: Samples.
    """
    weights = np.ones(grams.shape[:-2])
    for _ in range(ROUNDS):
        total = np.sum(weights[..., None, None] * grams, axis=-3)
        values = np.linalg.pinv(total[..., :-1, :-1], hermitian=True) @ total[..., :-1, -1:]
        ones = np.concatenate([-values, np.ones_like(values[..., :1, :])], axis=-2)[..., None, :, :]
        squares = (np.swapaxes(ones, -1, -2) @ grams @ ones)[..., 0, 0] / count
        weights = 1.0 / squares
    return np.asarray(np.exp(0.25 * np.sum(np.log(squares), axis=-1)))


def global_least(log: Log) -> float:
    """The least residual over all pairs of speeds [Nm]."""
    grid = np.geomspace(SLOWEST, FASTEST, GRID)
    count = log.q.shape[1]
    alike = np.concatenate([grams_of(log, np.array([[v, v]])) for v in grid])
    pairs = np.stack(
        [np.repeat(alike[:, None, 0], GRID, axis=1), np.repeat(alike[None, :, 1], GRID, axis=0)],
        axis=2,
    )
    costs = residual(pairs, count)
    first, second = np.unravel_index(np.argmin(costs), costs.shape)

    def cost(logs: np.ndarray) -> float:
        speeds = np.clip(np.exp(logs), SLOWEST, FASTEST)
        return float(residual(grams_of(log, speeds[None])[0], count))

    start = np.log([grid[first], grid[second]])
    polished = minimize(cost, start, method="Nelder-Mead", options={"xatol": 1e-5, "fatol": 1e-12})
    return min(float(polished.fun), float(costs.min()))


def main() -> list[Claim]:
    """One start each; the genetic algorithm with a seed each."""
    reached, excess, inside = 0, [], 0
    errors, times = [], []
    for seed in range(SEEDS):
        log = drawn(seed)
        begun = time.perf_counter()
        found, estimate = ours(log, seed)
        between = time.perf_counter()
        _, theirs = genetic(log, seed)
        times.append((between - begun, time.perf_counter() - between))
        errors.append((error_of(log, found, estimate), theirs))
        speeds = np.array([f.value for f in found.findings])
        least = global_least(log)
        excess.append(float(residual(grams_of(log, speeds[None])[0], log.q.shape[1])) / least - 1.0)
        reached += excess[-1] <= SAME
        inside += sum(
            f.interval[0] <= true <= f.interval[1]
            for f, true in zip(found.findings, log.speeds, strict=True)
        )
    mine, genetics = np.array(errors).T / NOISE
    ratio = np.median([b / a for a, b in times])
    return [
        Claim(
            f"global optimum from one start, {SEEDS} seeds",
            f"{reached} reached, worst {max(excess):.1e} above",
            f">= 19 within {SAME:g}",
            reached >= 19,
        ),
        Claim(
            "true speeds in their 95 % intervals", f"{inside} of {2 * SEEDS}", ">= 34", inside >= 34
        ),
        Claim(
            "error over the noise: ours, genetic 30 x 100",
            f"at most {mine.max():.3f}, {genetics.min():.2f} to {genetics.max():.2f}",
            "genetic >= ours, always",
            bool(np.all(genetics >= mine)),
        ),
        Claim("genetic algorithm's time over ours", f"{ratio:.1f}", "reported", True),
    ]


if __name__ == "__main__":
    main_of(main)
