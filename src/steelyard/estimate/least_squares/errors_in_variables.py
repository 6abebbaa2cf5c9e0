r"""Noise in the measured motion: maximum likelihood and total least squares.

With $L_k$ the roots of the motion's covariance, $\Sigma = \sum_k L_k L_k^T$, and
$D_k = (A(x + L_k) - A(x - L_k)) / 2$, the torque's variance is $\sum_k (D_k \phi)^2$. Differences
over a whole deviation see friction change its sign, which a derivative does not.

A residual then has the variance $v_i = \sigma_j^2 + g_i^T \Sigma g_i$, with $g$ the torque's change
with $q, \dot q, \ddot q$, $\Sigma$ their covariance behind the filters, and $g$ depends on the
parameters and on where the robot is [Leboutet2021]. The true motion maximised out, parameters
minimise $\sum_i e_i^2 / v_i(\phi)$, which, unlike least squares, is not drawn towards zero by noise
in the columns; $\sigma_j^2$ is that of greatest likelihood, log-variance term included.

Finds the smallest change of $[A \mid b]$, rows weighted by their noise, that makes $A x = b$
solvable; columns and effort are scaled to unit length first, so each is thought wrong by the same
share of itself. With $\sigma^2$ the smallest eigenvalue of the Gram matrix of $[A \mid b]$,
$x = (A^T A - \sigma^2 I)^{-1} A^T b$ [VanHuffel1991]. Sums of products are all it takes.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from steelyard.base.arrays import Array, frozen
from steelyard.base.errors import DataError
from steelyard.estimate.covariance_and_band_widths import covariance_root
from steelyard.estimate.estimate import Estimate
from steelyard.estimate.information.base_parameters_and_regressor import Regressor
from steelyard.estimate.information.information import Information
from steelyard.estimate.information.kept_filtered_samples import FilteredSamples, Index
from steelyard.estimate.least_squares.covariance_from_residuals import honest_covariance
from steelyard.estimate.least_squares.normal_equations import (
    described,
    inverse_of_gram,
    refuse_few,
    unit_length,
)
from steelyard.estimate.least_squares.weighted_robust_and_whitened import (
    FREEDOM,
    WeightedLeastSquares,
    residuals_of,
)

BLOCK = 256  # instants evaluated at once, each with every joint moved six ways


def slopes(
    regressor: Regressor, samples: FilteredSamples, roots: Sequence[Array], values: Array
) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
    """Variance of the torque through noise of the motion per effort row, `(N_j,)`, in its unit.

    And half the change of that with the parameters, `(N_j, k_j)`. What was computed along the
    motion, such as states of friction with memory, stays as it is. Roots are those of each joint's
    covariance of `q, dq, ddq`, of every source, `(n, 3, 3)`: one in each last column; values are
    those of all columns, `(p,)`.
    """
    layout, variances = regressor.layout, np.zeros((len(samples.rows), len(samples)))
    bends = [np.zeros((len(samples), row.shape[1] - 1)) for row in samples.rows]
    for number, root in enumerate(roots):
        mine = np.flatnonzero(samples.source == number)
        for first in range(0, len(mine), BLOCK):
            block = mine[first : first + BLOCK]
            changes = _changes(regressor, samples, block, root)
            for row, (start, seen) in enumerate(zip(layout.starts, layout.sees, strict=True)):
                part = changes[start : start + len(seen)]
                torque = np.einsum("cdb,c->db", part, values[list(seen)])
                variances[row, block] = np.sum(np.square(torque), axis=0)
                bends[row][block] = np.einsum("cdb,db->bc", part, torque)
    return (
        tuple(v[at] for v, at in zip(variances, samples.at, strict=True)),
        tuple(bend[at] for bend, at in zip(bends, samples.at, strict=True)),
    )


def _changes(regressor: Regressor, samples: FilteredSamples, block: Index, root: Array) -> Array:
    """Columns over one deviation of each root, halved, shape `(width, 3 n, B)`."""
    n, count = len(root), len(block)
    moved = np.zeros((3, n, 3 * n, count))
    for joint in range(n):
        for k in range(3):
            moved[:, joint, 3 * joint + k] = root[joint, :, k, None]
    motion = np.stack([samples.q[block].T, samples.dq[block].T, samples.ddq[block].T])[:, :, None]
    both = np.stack([motion + moved, motion - moved], axis=2).reshape(3, n, -1)
    channels = np.tile(samples.channels[block].T, (1, 6 * n))
    result = regressor.code([*both, channels, np.zeros_like(both[0])])
    plus, minus = result.reshape(len(result), 2, 3 * n, count).swapaxes(0, 1)
    return np.asarray(0.5 * (plus - minus))


FLOOR = 1e-24  # least variance of the effort's own noise over the mean square of the effort
HALVINGS = 5  # how often a step that does not help is halved


@dataclass(frozen=True, eq=False)
class MotionNoise:
    """Gauss-Newton steps on standardised residuals, variances and their bend included.

    Efforts of different joints count as independent. The covariance is that of the scores,
    $H^{-1} M H^{-1}$, to first order in the noise. Parameters that runs have for themselves stay as
    weighted least squares has them.
    """

    regressor: Regressor  # model and columns of the samples
    rounds: int = 30  # most steps
    # change of the parameters, in standard deviations, at which they have converged
    tolerance: float = 1e-4
    per_run: tuple[str, ...] = ()  # columns whose parameters every run has for itself

    def __call__(self, samples: FilteredSamples) -> Estimate:
        """Estimate all columns that the data see; not of rows that were combined."""
        if samples.layout.mixed:
            raise DataError(
                "noise of the motion is followed in rows of their own only, and forces of contacts "
                "were taken out of all of them",
                where="[signals.base] contacts with touching",
                fix="choose another estimator, such as consistent or WLS, or give measured forces",
            )
        start = WeightedLeastSquares(per_run=self.per_run)(samples.information())
        refuse_few(samples.information(), len(start.parameters), FREEDOM)
        roots = [covariance_root(source.error.covariance()) for source in samples.sources]
        problem = _Problem.of(self.regressor, samples, start, roots)
        state = problem.likeliest(problem.at(problem.first, np.square(start.sigma)))
        for count in range(1, self.rounds + 1):
            before = state.values
            state, spread = problem.stepped(state)
            if np.max(np.abs(state.values - before) / spread) < self.tolerance:
                return problem.estimate(start, state, f"converged after {count} steps")
            state = problem.likeliest(state)
        return problem.estimate(start, state, f"not converged after {self.rounds} steps")


@dataclass(frozen=True, eq=False)
class _State:
    """Where the search is; all but the first two per effort row."""

    values: Array  # parameters that are searched, `(k,)`
    own: Array  # variance of each row's own noise, `(rows,)`
    residuals: tuple[Array, ...]  # `(N_j,)`
    motion: tuple[Array, ...]  # variance of each residual through noise of the motion, `(N_j,)`
    bends: tuple[Array, ...]  # half the change of that with the parameters, `(N_j, k_j)`
    total: tuple[Array, ...]  # variance of each residual, `(N_j,)`
    loss: float  # what is minimised


@dataclass(frozen=True, eq=False)
class _Problem:
    """Samples with what is searched and what is fixed."""

    regressor: Regressor
    # the samples, without what parameters of single runs explain of their efforts
    samples: FilteredSamples
    roots: list[Array]  # per source the roots of the motion's covariance
    names: tuple[str, ...]  # what is searched
    place: tuple[int, ...]  # its columns
    fixed: Array  # values of the other columns, `(p,)`
    first: Array  # where the search begins

    @classmethod
    def of(
        cls, regressor: Regressor, samples: FilteredSamples, start: Estimate, roots: list[Array]
    ) -> "_Problem":
        columns, known = samples.layout.columns, start.parameters.as_dict()
        own = {name for one in start.per_run for name in one.parameters.names}
        names = tuple(name for name in start.parameters.names if name not in own)
        fixed = np.array([known[c] if c in own else 0.0 for c in columns])
        shared = np.array([known.get(c, 0.0) if c not in own else 0.0 for c in columns])
        rows = []
        for rest, weight, row, seen in zip(
            residuals_of(samples, start),
            samples.weights,
            samples.rows,
            samples.layout.sees,
            strict=True,
        ):
            effort = rest / np.sqrt(weight) + row[:, :-1] @ shared[list(seen)]
            rows.append(np.column_stack([row[:, :-1], effort]))
        first = np.array([known[name] for name in names])
        place = tuple(columns.index(name) for name in names)
        return cls(regressor, replace(samples, rows=tuple(rows)), roots, names, place, fixed, first)

    def at(self, values: Array, own: Array) -> _State:
        """The state at some parameters and variances of the efforts' own noise."""
        shared = np.zeros(len(self.fixed))
        shared[list(self.place)] = values
        motion, bends = slopes(self.regressor, self.samples, self.roots, shared + self.fixed)
        residuals = self.samples.residuals(shared)
        return self._state(_State(values, own, residuals, motion, bends, (), 0.0))

    def _state(self, state: _State) -> _State:
        total = tuple(
            own / weight + motion
            for own, weight, motion in zip(
                state.own, self.samples.weights, state.motion, strict=True
            )
        )
        parts = zip(self.samples.shares, state.residuals, total, strict=True)
        loss = sum(float(np.sum(share * np.square(e) / v)) for share, e, v in parts)
        return replace(state, total=total, loss=loss)

    def likeliest(self, state: _State) -> _State:
        """The same parameters with the variances that are likeliest then."""
        own = [self._own(row, state) for row in range(len(state.own))]
        return self._state(replace(state, own=np.array(own)))

    def _own(self, row: int, state: _State) -> float:
        """Variance of one row's own noise: least sum of `log v + e² / v`."""
        from scipy.optimize import minimize_scalar

        squares, share = np.square(state.residuals[row]), self.samples.shares[row]
        weight, motion = self.samples.weights[row], state.motion[row]
        size = np.square(self.samples.rows[row][:, -1])
        least = FLOOR * float(size.mean()) if len(size) and size.any() else 1.0
        most = 2.0 * float((squares * weight).mean()) if len(size) else 0.0
        if most <= least:
            return least

        def loss(logarithm: float) -> float:
            v = np.exp(logarithm) / weight + motion
            return float(np.sum(share * (np.log(v) + squares / v)))

        found = minimize_scalar(loss, bounds=(np.log(least), np.log(most)), method="bounded")
        return float(np.exp(found.x))

    def stepped(self, state: _State) -> tuple[_State, Array]:
        """The state a step on, variances as they were, and the parameters' deviations."""
        matrix, vector, _ = self._sums(state)
        inverse = inverse_of_gram(matrix)
        step = inverse @ vector
        for halving in range(HALVINGS):
            new = self.at(state.values + 0.5**halving * step, state.own)
            if new.loss <= state.loss:
                return new, np.sqrt(np.diag(inverse))
        return state, np.sqrt(np.diag(inverse))

    def _sums(self, state: _State) -> tuple[Array, Array, Array]:
        """Normal matrix and vector of a step, and the sum of squared scores."""
        p = len(self.fixed)
        matrix, vector, scores = np.zeros((p, p)), np.zeros(p), np.zeros((p, p))
        for row, seen in enumerate(self.samples.layout.sees):
            e, v, share = state.residuals[row], state.total[row], self.samples.shares[row]
            columns = self.samples.rows[row][:, :-1] + state.bends[row] * (e / v)[:, None]
            columns = columns / np.sqrt(v)[:, None]
            r, index = e / np.sqrt(v), np.array(seen, dtype=int)
            matrix[np.ix_(index, index)] += (columns.T * share) @ columns
            vector[index] += columns.T @ (share * r)
            scores[np.ix_(index, index)] += (columns.T * (share * np.square(r))) @ columns
        k = list(self.place)
        return matrix[np.ix_(k, k)], vector[k], scores[np.ix_(k, k)]

    def estimate(self, start: Estimate, state: _State, how: str) -> Estimate:
        """What was found, in the form that the search began with."""
        matrix, _, scores = self._sums(state)
        inverse = inverse_of_gram(matrix)
        worth = float(start.n_samples.sum())
        noise = scores * worth / max(worth - len(self.names), 1.0)
        place = [start.parameters.names.index(name) for name in self.names]
        values, covariance = start.parameters.values.copy(), start.covariance.copy()
        values[place] = state.values
        covariance[np.ix_(place, place)] = inverse @ noise @ inverse
        each = zip(state.residuals, self.samples.weights, state.motion, state.total, strict=True)
        rows = [
            (np.sqrt(np.mean(np.square(e) * w)), m.sum() / v.sum()) if len(e) else (0.0, 0.0)
            for e, w, m, v in each
        ]
        shares = " ".join(f"{100.0 * share:.2g}" for _, share in rows)
        return replace(
            start,
            estimator="maximum likelihood with motion noise",
            parameters=replace(start.parameters, values=values),
            covariance=frozen(0.5 * (covariance + covariance.T)),
            sigma=frozen([sigma for sigma, _ in rows]),
            notes=(how, f"share of the variance from motion noise, per joint: {shares} %"),
        )


GENERIC = 1e-12  # least gap between the smallest eigenvalues without and with the effort


@dataclass(frozen=True)
class TotalLeastSquares:
    r"""Rows are weighted as weighted least squares has them.

    The covariance is $H^{-1} (\sum_j \varphi_j G_j) H^{-1}$ with $H = A^T A - \sigma^2 I$, $G_j$
    what row $j$ adds to $A^T A$ and $\varphi_j$ as in `scatter`, times the residual variance: a
    little wider than to first order, and right if all columns are as noisy as they are taken to be.
    """

    # columns whose parameters every run has for itself; they are taken as exact
    per_run: tuple[str, ...] = ()

    def __call__(self, information: Information) -> Estimate:
        """Estimate all columns that the data see."""
        fit = WeightedLeastSquares(per_run=self.per_run).fit(information)
        kept, weights = fit.kept, 1.0 / fit.variances
        matrix, vector, _, _ = fit.data.normal(weights)
        unit, lengths = unit_length(matrix[np.ix_(kept, kept)])
        square = 0.0
        for run, own in zip(fit.data.runs, fit.locals, strict=True):
            _, of_run, size = run.normal(weights)
            square += size - float(of_run[list(own.columns)] @ own.offset)
        effort = np.sqrt(max(square, 0.0))
        right, size = vector[kept] / lengths / max(effort, 1e-300), len(kept)
        whole = np.ones((size + 1, size + 1))
        whole[:size, :size], whole[size, :size], whole[:size, size] = unit, right, right
        smallest = max(float(np.linalg.eigvalsh(whole)[0]), 0.0)
        if np.linalg.eigvalsh(unit)[0] - smallest < GENERIC:
            raise DataError(
                "total least squares has no solution: the smallest change of the data that makes "
                "them consistent makes a column vanish",
                where=information.runs,
                fix="use weighted least squares, or a more exciting motion",
            )
        left = unit - smallest * np.eye(size)
        inverse = np.asarray(np.linalg.inv(left), dtype=np.float64)
        x = inverse @ right
        x += inverse @ (right - left @ x)
        values = np.zeros(len(vector))
        values[kept] = effort * x / lengths
        found = fit.at(values)
        covariance = honest_covariance(fit, inverse / lengths[:, None] / lengths)
        ratios = found.variances / fit.variances
        covariance *= np.average(ratios, weights=information.n_samples)
        return described("total least squares", found, covariance)
