r"""What a motion on feet shows of a model where the forces of the feet are not known.

With all joints' rows $Y$ of the regressor and $N$ the speeds of all joints per speed of the
independent ones, $N^T J^T = 0$: rows $N^T Y$ know nothing of the forces. Their errors have the
covariance $M = N^T \Sigma N$ with $\Sigma = \operatorname{diag}(1 / w_j)$, so that
$G = \sum_t (N^T Y)^T M^{-1} (N^T Y)$ is the information of the best estimate, the same as that of
rows behind the projection of contacts whose forces are unknown.

With the slope $S$ of a function by $G$, $A = N^T Y$ and $Z = M^{-1} A$ the seeds of $A$ are
$2 Z S$, and those of the rows $N_p$ of passive joints $-2 \Sigma_p N_p Z S Z^T$.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from steelyard.base.arrays import Array
from steelyard.excite.design_problem_and_information import InformationEvaluator, SampledInformation
from steelyard.excite.standing.legs_follow_base import Legs


@dataclass(frozen=True, eq=False)
class InformationOnFeet(InformationEvaluator):
    """The information of samples of a robot that stands; weights are those of all joints.

    States may be those of all joints, `(n_joints, N)`, of which the independent ones count.
    """

    def at(self, q: Array, dq: Array, ddq: Array, *, step: float = 1.0) -> SampledInformation:
        """See `InformationEvaluator`."""
        n, count = self.model.robot.n, len(self.base)
        inputs, entries = self.entries_at(*(np.ascontiguousarray(x[:n]) for x in (q, dq, ddq)))
        seen = SampledInformation(inputs, entries, step, np.zeros((count, count)))
        if not inputs:
            return seen
        rows = self._rows(seen)
        known = np.linalg.solve(self._covariance(seen)[0], rows)
        return replace(seen, gram=step * rows.reshape(-1, count).T @ known.reshape(-1, count))

    def pull(self, seen: SampledInformation, slope: Array) -> tuple[Array, Array, Array]:
        """See `InformationEvaluator`."""
        rows, (covariance, ways) = self._rows(seen), self._covariance(seen)
        known = np.linalg.solve(covariance, rows)
        seeds = 2.0 * seen.step * known @ slope
        whole = known @ slope @ known.transpose(0, 2, 1)
        spread = 1.0 / self.weights[self.model.robot.n :, None]
        by_ways = -2.0 * seen.step * (spread * ways) @ whole
        by_q, by_dq, by_ddq, by_passive = self.slopes_of_entries(seen, self._flat(seeds))
        own, passive = np.hsplit(self._legs.ways_back(self._joints(seen), by_ways), [len(by_q)])
        through = np.einsum("tpk,tp->kt", ways, by_passive.T + passive)
        return by_q + own.T + through, by_dq, by_ddq

    @cached_property
    def _legs(self) -> Legs:
        return Legs(self.model.robot)

    def _joints(self, seen: SampledInformation) -> Array:
        """Positions of all joints, `(N, n_joints)`."""
        return np.vstack([seen.inputs[0], seen.inputs[3]]).T

    def _covariance(self, seen: SampledInformation) -> tuple[Array, Array]:
        """The covariance $M$ at samples `(N, n, n)`, and the ways of passive joints."""
        n, ways = self.model.robot.n, self._legs.ways(self._joints(seen))
        found = ways.transpose(0, 2, 1) @ (ways / self.weights[n:, None])
        found[:, range(n), range(n)] += 1.0 / self.weights[:n]
        return found, ways

    def _rows(self, seen: SampledInformation) -> Array:
        """Rows of the regressor at samples, `(N, n, c)`."""
        found = np.zeros((seen.entries.shape[1], self.model.robot.n, len(self.base)))
        for row, block in enumerate(self._blocks(seen.entries)):
            found[:, row, self.sees[row]] = block.T
        return found

    def _flat(self, rows: Array) -> Array:
        """Entries of rows `(N, n, c)` that the program has, `(entries, N)`."""
        return np.vstack([rows[:, row, columns].T for row, columns in enumerate(self.sees)])
