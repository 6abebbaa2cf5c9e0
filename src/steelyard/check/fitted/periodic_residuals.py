r"""Periods in the position that residuals show, and how large the efforts of a model are.

Of samples where a joint moves, the residual is summed up in cells of the position. What is left of
these sums beside a polynomial has the spectrum $|\sum_c r_c e^{-2\pi i f x_c}|$ over frequencies
$f$ per position; near its greatest value, least squares of a polynomial and a sine find the period.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from steelyard.base.arrays import Array
from steelyard.estimate.scores.residuals import residual_blocks
from steelyard.model.model import ValuedModel
from steelyard.robot.robot import Robot
from steelyard.runs.run import Run

CELL = {"revolute": 2.0 * np.pi / 4096, "prismatic": 1e-4}  # length of a cell [rad; m]
FEWEST_PERIODS, CELLS_PER_PERIOD = 3, 8  # in the travel, and of the shortest period
DEGREE, FINER = 4, 8  # of the polynomial, and how much finer than the travel frequencies are
NEAR = 81  # frequencies around the greatest of the spectrum that are compared by least squares
NO_PERIOD = 1.0  # where a joint hardly moves


@dataclass(frozen=True, eq=False)
class ResidualShape:
    """Of every joint."""

    size: Array  # root mean square of the predicted effort, shape `(n,)` [Nm; N]
    period: Array  # the period that is strongest in the residual, shape `(n,)` [rad; m]


def residual_shape(valued: ValuedModel, runs: Sequence[Run], gains: Array) -> ResidualShape:
    """From the first part of each run."""
    robot = valued.model.robot
    squares, count = np.zeros(robot.n), 0
    cells: list[list[tuple[int, Array, Array]]] = [[] for _ in range(robot.n)]
    for run in runs:
        for block, predicted, rest in residual_blocks(valued, run, gains):
            squares += np.sum(np.square(predicted), axis=1)
            count += predicted.shape[1]
            for j, found in enumerate(cells):
                at = np.floor(block.q[j] / _cell(robot, j)).astype(np.intp)
                low, size = int(at.min()), int(np.ptp(at)) + 1
                moving = block.moving[j]
                sums, counts = np.zeros(size), np.zeros(size)
                np.add.at(sums, at - low, moving * rest[j])
                np.add.at(counts, at - low, moving)
                found.append((low, sums, counts))
    periods = [strongest_period(*_joined(c), _cell(robot, j)) for j, c in enumerate(cells)]
    return ResidualShape(np.sqrt(squares / max(count, 1)), np.array(periods))


def _cell(robot: Robot, joint: int) -> float:
    return CELL[robot.joints[joint].kind]


def _joined(cells: Sequence[tuple[int, Array, Array]]) -> tuple[Array, Array]:
    """Sums and counts of all cells from the lowest to the highest."""
    first = min(low for low, _, _ in cells)
    total = np.zeros((2, max(low + len(sums) for low, sums, _ in cells) - first))
    for low, *both in cells:
        total[:, low - first : low - first + len(both[0])] += both
    return total[0], total[1]


def strongest_period(sums: Array, counts: Array, cell: float) -> float:
    """The strongest period of sums of residuals, from those of neighbouring cells `(c,)`."""
    n, weights = len(sums), np.sqrt(counts)
    if n < FEWEST_PERIODS * CELLS_PER_PERIOD:
        return NO_PERIOD
    powers = np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, n), DEGREE)
    trend = np.asarray(powers * weights[:, None], dtype=np.float64)
    right = sums / np.maximum(weights, 1.0)

    def left(columns: Array) -> Array:
        return right - columns @ np.linalg.lstsq(columns, right, rcond=None)[0]

    power = np.abs(np.fft.rfft(weights * left(trend), FINER * n))
    first, last = FINER * FEWEST_PERIODS, FINER * n // CELLS_PER_PERIOD
    near = first + int(np.argmax(power[first : last + 1])) + np.linspace(-FINER, FINER, NEAR)
    phases = 2.0 * np.pi * np.outer(near / (FINER * n), np.arange(n) + 0.5)
    squares = [
        float(np.sum(np.square(left(np.column_stack((trend, weights * s, weights * c))))))
        for s, c in zip(np.sin(phases), np.cos(phases), strict=True)
    ]
    return float(FINER * n * cell / near[int(np.argmin(squares))])
