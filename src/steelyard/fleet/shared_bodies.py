r"""The model that all robots of a fleet share, what is a robot's or a day's own eliminated.

With columns $Z$ of a row's changes, scatter $\Omega$ of days and $V$ of robots, the sums of
products $G$ of a day lose what the day's own changes explain, and their sum what the robot's do,

$$ G_d' = G_d - G_d Z (Z^T G_d Z + \sigma^2\Omega^{-1})^{-1} Z^T G_d ,\qquad
   G_r'' = \textstyle\sum_d G_d' - \ldots V^{-1} \ldots , $$

which are sums of products again: every estimator takes them, a robot as one run.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from steelyard.base.arrays import Array
from steelyard.estimate.changes_from_model import OF_JOINT, LocalParameters
from steelyard.estimate.information.information import Information, Window, packed


class SharedSums:
    """Sums of products of one robot, day after day."""

    def __init__(self, local: LocalParameters, day: Array, robot: Array) -> None:
        self._local, self._day, self._robot = local, day, robot
        self._rows: list[Array] = []
        self._last: Information | None = None
        self._counts, self._span = np.zeros(len(local.joints)), (np.inf, -np.inf)

    def add(self, information: Information, warm: Array) -> None:
        """Take in a day, whose changes by temperature are known, `(m,)`; efforts as logged."""
        signals = self._local.identified.signals
        scaled = information.scaled(signals.gains, self._local.units)
        grams = [
            self._without(self._moved(scaled.row_gram(row), row, warm), row, self._day)
            for row in range(len(self._local.joints))
        ]
        before = self._rows or [np.zeros_like(gram) for gram in grams]
        self._rows = [a + b for a, b in zip(before, grams, strict=True)]
        self._last, self._counts = scaled, self._counts + scaled.n_samples
        starts, stops = [w.start for w in scaled.windows], [w.stop for w in scaled.windows]
        self._span = min(self._span[0], *starts), max(self._span[1], *stops)

    def information(self, name: str) -> Information:
        """The robot's sums as one window."""
        assert self._last is not None
        grams = [
            packed(self._without(gram, row, self._robot)[None])
            for row, gram in enumerate(self._rows)
        ]
        return replace(
            self._last,
            windows=(Window(name, *self._span),),
            grams=np.concatenate(grams, axis=1),
            absolute=np.full((1, sum(self._last.layout.widths)), np.nan),
            counts=self._counts[None],
            beside=None,
        )

    def _own(self, row: int) -> Array:
        """Columns of the row's changes, `(k + 1, 4)`."""
        found: Array = self._local.transforms[row][:, OF_JOINT * row : OF_JOINT * (row + 1)]
        return found

    def _moved(self, gram: Array, row: int, warm: Array) -> Array:
        move = np.eye(len(gram))
        move[:, -1] -= self._own(row) @ warm[OF_JOINT * row : OF_JOINT * (row + 1)]
        return np.asarray(move.T @ gram @ move)

    def _without(self, gram: Array, row: int, variances: Array) -> Array:
        own = variances[OF_JOINT * row : OF_JOINT * (row + 1)]
        varied = own > 0.0
        columns = self._own(row)[:, varied]
        cross = gram @ columns
        prior = np.diag(self._local.sigma[row] ** 2 / own[varied])
        return np.asarray(gram - cross @ np.linalg.solve(columns.T @ cross + prior, cross.T))


def summed(robots: Sequence[Information]) -> Information:
    """All robots, a window each."""
    found = robots[0]
    for one in robots[1:]:
        found = found + one
    return found
