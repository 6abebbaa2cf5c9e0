r"""A design problem, the information of motions with its slope by the motion, and earlier models.

The torque of a joint depends on the bodies that it carries and on its own friction. Branches of a
tree that hang on the fixed base share no parameter, and no torque of one depends on the motion of
another: the information is block-diagonal, $\log\det G = \sum_l \log\det G_l$, exactly. Joints
that carry several branches, like those of a torso, make one limb of them.

The information about the base parameters is $G = \sum_t \sum_r w_r\, y_{tr} y_{tr}^T$ with the
regressor's rows $y$. For any function $f(G)$ with slope $S = \partial f / \partial G$ the seed of
row $y_{tr}$ is $2 w_r S y_{tr}$, and one sweep backwards through the traced regressor turns the
seeds of all its entries into derivatives by position, velocity and acceleration.
"""

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import ceil, exp, inf
from pathlib import Path
from typing import Any

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import DataError
from steelyard.estimate.identified_model import IdentifiedModel, load_model
from steelyard.estimate.information.base_parameters_and_regressor import BaseMap, clear_map
from steelyard.estimate.information.filter_and_gram import ParallelFilter
from steelyard.excite.constraints.constraint_and_limits import Constraint, MotionLimits
from steelyard.excite.optimality_criteria import Criterion, d_optimal, worst
from steelyard.excite.search.margins_barrier_and_newton import InequalityConstraints
from steelyard.excite.trajectories.motion_families import Basis
from steelyard.model.equations.inverse_dynamics import JointState
from steelyard.model.equations.passive_joints import passive_ways
from steelyard.model.model import Model
from steelyard.robot.file.model_reading_and_loaded_robot import LoadedRobot
from steelyard.robot.robot import Robot
from steelyard.symbolic.native.compiled_programs import Code, compiled
from steelyard.symbolic.program_and_softening import InputArray as Input
from steelyard.symbolic.program_and_softening import Program, softened

_RATE_OVER_CUTOFF = 20.0  # sampling rate; the independent samples a second do not depend on it
_Q, _DQ, _DDQ, _CHANNELS, _WIDTHS = range(5)


@dataclass(frozen=True, eq=False)
class SampledInformation:
    """Regressor entries at samples; what `InformationEvaluator.pull` needs of them."""

    inputs: list[Array]  # what they were computed from, arrays of `(entries, N)`; the widths `(n,)`
    entries: Array  # `(entries, N)`, row by row of the efforts
    step: float  # what a sample counts for
    gram: Array  # $G$, `(c, c)`


@dataclass(frozen=True, eq=False)
class InformationEvaluator:
    """The information that samples of a motion hold about a model's base parameters.

    Laws that jump at zero speed turn within a width of speed, so that the information has slopes;
    with widths of 1e-9 it is that of the jump itself.
    """

    model: Model  # the model; its terms have no memory
    # of the efforts' squares over a second, such as independent samples a second over the variance
    # of their noise, `(n,)`
    weights: Array
    widths: Array  # speeds within which jumps turn, `(n,)` [rad/s; m/s]
    # base parameters that the model does without: they are zero, not unknown
    absent: tuple[str, ...] = ()

    @cached_property
    def base(self) -> BaseMap:
        """The model's base parameters that motions can show, one per column."""
        return clear_map(self.model).without(self.absent)

    def at(self, q: Array, dq: Array, ddq: Array, *, step: float = 1.0) -> SampledInformation:
        """Information of samples `(n, N)`, each `step` times; none where a loop cannot close."""
        inputs, entries = self.entries_at(q, dq, ddq)
        gram = np.zeros((len(self.base), len(self.base)))
        for block, (rows, square, weight) in zip(self._blocks(entries), self._places, strict=True):
            if len(rows) and inputs:
                gram[square] += (step * weight * block) @ block.T
        return SampledInformation(inputs, entries, step, gram)

    def pull(self, seen: SampledInformation, slope: Array) -> tuple[Array, Array, Array]:
        """Derivatives by `q`, `dq`, `ddq`, `(n, N)`, of a function with slope $S$ `(c, c)`."""
        seeds = np.empty_like(seen.entries)
        blocks = zip(self._blocks(seeds), self._blocks(seen.entries), self._places, strict=True)
        for seed, block, (_, square, weight) in blocks:
            seed[:] = (2.0 * seen.step * weight * slope[square]) @ block
        by_q, by_dq, by_ddq, by_channels = self.slopes_of_entries(seen, seeds)
        n = self.model.robot.n
        if self._passive_map is not None:
            ways = self._passive_map([seen.inputs[_Q], seen.inputs[_CHANNELS]])
            ways = ways.reshape(len(by_channels), n, -1)
            by_q = by_q + np.einsum("pkt,pt->kt", ways, by_channels)
        return by_q, by_dq, by_ddq

    def entries_at(self, q: Array, dq: Array, ddq: Array) -> tuple[list[Array], Array]:
        """What entries of the regressor are computed from, and these; none if a loop is open."""
        scan = self.model.scan(drop=True)
        channels = scan(q, dq, ddq)
        if not scan.closed.all():
            return [], np.zeros((sum(map(len, self.sees)), q.shape[1]))
        inputs = [q, dq, ddq, channels, self.widths]
        return inputs, self._entries(inputs)

    def slopes_of_entries(self, seen: SampledInformation, seeds: Array) -> list[Array]:
        """Derivatives of the sum of seeds times entries by `q`, `dq`, `ddq` and the channels."""
        n = self.model.robot.n
        return np.split(self._slopes([*seen.inputs, seeds]), [n, 2 * n, 3 * n])

    @cached_property
    def _entries(self) -> Code:
        return compiled(["shown", *self._key], self._program)

    @cached_property
    def _slopes(self) -> Code:
        def build() -> tuple[Program, dict[str, Any]]:
            from steelyard.symbolic.symbols_and_tracing import pulled_back

            return pulled_back(self._program()[0], (_Q, _DQ, _DDQ, _CHANNELS)), {}

        return compiled(["shown backwards", *self._key], build)

    @cached_property
    def _passive_map(self) -> Code | None:
        """How passive positions follow the independent ones; `None` for a tree."""
        return passive_ways(self.model.robot) if self.model.robot.passive else None

    @property
    def _key(self) -> list[Any]:
        return [self.model.program_key, list(self.base.independent)]

    @property
    def sees(self) -> list[list[int]]:
        """Per effort the columns that its row of the regressor holds; all others are zero."""
        return [list(columns) for columns in self._entries.about["sees"]]

    @cached_property
    def _places(self) -> list[tuple[list[int], Any, float]]:
        """Per effort row the columns it sees, where these stand in the information, its weight."""
        return [(s, np.ix_(s, s), w) for s, w in zip(self.sees, self.weights, strict=True)]

    def _blocks(self, entries: Array) -> list[Array]:
        """Views of each effort row's entries, `(seen columns, N)`."""
        return np.split(entries, np.cumsum([len(seen) for seen in self.sees])[:-1])

    def _program(self) -> tuple[Program, dict[str, Any]]:
        """The regressor's entries with softened jumps, and the columns that each row `sees`."""
        from steelyard.symbolic.symbols_and_tracing import symbolic

        n, columns = self.model.robot.n, self.base.independent
        place = {column: k for k, column in enumerate(columns)}
        sees: list[list[int]] = []

        def rows(q: Any, dq: Any, ddq: Any, channels: Any, _: Any) -> list[Any]:
            entries = self.model.columns(JointState(q, dq, ddq, channels))
            outputs: list[Any] = []
            for row in range(n):
                seen = sorted(place[c] for r, c in entries if r == row and c in place)
                sees.append(seen)
                outputs += [entries[row, columns[k]] for k in seen]
            return outputs

        inputs = [*self.model.inputs, Input("widths", n, shared=True)]
        return softened(symbolic(rows, inputs), _DQ, _WIDTHS), {"sees": sees}


@dataclass(frozen=True, eq=False)
class Case:
    """One load of the robot: what its motions show, and by what that is judged."""

    shows: InformationEvaluator
    criterion: Criterion


@dataclass(frozen=True, eq=False)
class Objective:
    """A criterion of the information at sample times `(N,)` [s], the worst over all loads.

    A sample stands for the time from it to the next: the information is that of the whole motion.
    """

    basis: Basis
    cases: Sequence[Case]
    t: Array

    @cached_property
    def _shapes(self) -> list[Array]:
        return [self.basis.shapes(self.t, order) for order in range(3)]

    @cached_property
    def _offsets(self) -> list[Array]:
        return [self.basis.offset(self.t, order).T for order in range(3)]

    def __call__(self, x: Array, sharpness: float) -> tuple[float, Array]:
        """The smooth criterion of coefficients `(n, m)`, and its slope, `(n, m)`.

        Infinite where the motion shows too little; the slope is zero then.
        """
        seen = self.seen(x)
        value, slopes = worst(self._judged(seen), sharpness)
        result = np.zeros_like(x)
        if not np.isfinite(value):
            return value, result
        for case, samples, slope in zip(self.cases, seen, slopes, strict=True):
            if np.any(slope):
                for part, shape in zip(case.shows.pull(samples, slope), self._shapes, strict=True):
                    result += part @ shape
        return value, result

    def value(self, x: Array, sharpness: float) -> float:
        """The smooth criterion alone, for searches that take no slopes."""
        return worst(self._judged(self.seen(x)), sharpness)[0]

    def _judged(self, seen: Sequence[SampledInformation]) -> list[tuple[Criterion, Array]]:
        return [(c.criterion, s.gram) for c, s in zip(self.cases, seen, strict=True)]

    def seen(self, x: Array) -> list[SampledInformation]:
        """What the samples show, load by load."""
        q, dq, ddq = (
            np.ascontiguousarray((shape @ x.T).T + offset)
            for shape, offset in zip(self._shapes, self._offsets, strict=True)
        )
        step = self.basis.duration / len(self.t)
        return [case.shows.at(q, dq, ddq, step=step) for case in self.cases]


COMPOSING_SHARPNESS = 4.0  # of the criterion by which motions are compared before they are improved


@dataclass(frozen=True)
class JointGroup:
    """Joints whose efforts share parameters, directly or by way of others, ascending.

    The `columns` are the base parameters that their efforts depend on, ascending.
    """

    joints: tuple[int, ...]
    columns: tuple[int, ...]


def joint_groups_of(shows: InformationEvaluator) -> tuple[JointGroup, ...]:
    """The limbs of a robot, by their first joints; one of all joints where loops close."""
    from scipy.sparse.csgraph import connected_components

    closed, sees = bool(shows.model.robot.passive), [set(columns) for columns in shows.sees]
    shared = np.array([[closed or bool(own & other) for other in sees] for own in sees])
    count, numbers = connected_components(shared, directed=False)
    limbs = [np.flatnonzero(numbers == number).tolist() for number in range(count)]
    columns = [set[int]().union(*(sees[joint] for joint in joints)) for joints in limbs]
    found = zip(limbs, columns, strict=True)
    return tuple(JointGroup(tuple(joints), tuple(sorted(reached))) for joints, reached in found)


SHOWN_PER_WAVE = 20  # samples of the criterion per wave of the highest frequency
KEPT_PER_WAVE = 40  # of the constraints; between two an extreme is at most 0.3 % higher
JUMP_WIDTH = 1e-9  # width of speed [rad/s; m/s] below any of a sample: the jumping laws themselves


def jumping(cases: Sequence[Case]) -> tuple[Case, ...]:
    """The cases with the laws as they are, not softened."""
    return tuple(
        replace(case, shows=replace(case.shows, widths=np.full_like(case.shows.widths, JUMP_WIDTH)))
        for case in cases
    )


@dataclass(frozen=True, eq=False)
class Problem:
    """What is designed; the criterion that people read is of so many `samples`."""

    robot: Robot
    basis: Basis
    limits: MotionLimits
    constraints: Sequence[Constraint]
    cases: Sequence[Case]
    samples: int = 1000
    notes: tuple[str, ...] = ()
    kept_per_wave: int = KEPT_PER_WAVE

    @cached_property
    def objective(self) -> Objective:
        """The smooth criterion on few samples."""
        return Objective(self.basis, self.cases, self._times(SHOWN_PER_WAVE))

    @cached_property
    def limbs(self) -> tuple[JointGroup, ...]:
        """Joints that share no parameter with others."""
        return joint_groups_of(self.cases[0].shows)

    @cached_property
    def inequalities(self) -> InequalityConstraints:
        """Margins on more samples."""
        return InequalityConstraints(
            self.basis, self.limits, self.constraints, self._times(self.kept_per_wave)
        )

    def criterion_value(self, x: Array) -> float:
        """The criterion itself on `samples` samples, with laws that jump at zero speed."""
        return exp(self._jumping.value(x, inf))

    @cached_property
    def _jumping(self) -> Objective:
        return Objective(self.basis, jumping(self.cases), self._spread(self.samples))

    def _times(self, per_wave: int) -> Array:
        waves = self.basis.highest * self.basis.duration
        return self._spread(max(ceil(per_wave * waves), 2 * self.basis.count, 20))

    def _spread(self, count: int) -> Array:
        """Times without the end, which a periodic motion has at its start already."""
        return np.linspace(0.0, self.basis.duration, count, endpoint=False)


def composed_motions(problem: Problem, motions: Iterable[Array]) -> Iterator[Array]:
    """The best of motions in the feasible set so far, after each of them, mixed limb by limb.

    What a limb shows does not depend on the others: where another motion shows its parameters
    better, by D-optimality, the limb takes it over as far as constraints and criterion permit.
    """
    objective, limbs = problem.objective, problem.limbs
    parts = [np.ix_(limb.columns, limb.columns) for limb in limbs]

    def judged(x: Array) -> tuple[Array, float, list[float]]:
        """A motion, its criterion, and that of every limb; of no parameters zero."""
        value = objective.value(x, COMPOSING_SHARPNESS)
        if len(limbs) < 2:
            return x, value, []
        grams = [seen.gram for seen in objective.seen(x)]
        each = [[gram[part] for gram in grams] for part in parts]
        return (
            x,
            value,
            [max(d_optimal(g, 1.0)[0] if len(g) else 0.0 for g in own) for own in each],
        )

    best: tuple[Array, float, list[float]] | None = None
    for motion in motions:
        one = judged(motion)
        first, second = (one, one) if best is None else (best, one)
        if second[1] < first[1]:
            first, second = second, first
        x, value, each = first
        for k, (limb, better) in enumerate(zip(limbs, second[2], strict=False)):
            if not better < each[k]:
                continue
            tried = x.copy()
            tried[list(limb.joints)] = second[0][list(limb.joints)]
            if not problem.inequalities.smallest_margin(tried) > 0.0:
                continue
            now = objective.value(tried, COMPOSING_SHARPNESS)
            if now <= value:
                x, value, each = tried, now, [*each[:k], better, *each[k + 1 :]]
        best = x, value, each
        yield x


@dataclass(frozen=True, eq=False)
class Earlier:
    """What was learnt from an earlier log.

    The `noise` of the filtered residuals, `(n,)` [Nm; N], and their filter's cutoff [Hz]; `values`,
    `(p,)`, of the base parameters that were estimated, and their covariance, `(p, p)`; standard
    parameters by name; the base parameters that the model was reduced by (`removed`) are zero.
    """

    noise: Array
    cutoff: float
    names: tuple[str, ...]
    values: Array
    covariance: Array
    standard: Mapping[str, float]
    removed: tuple[str, ...] = ()

    @property
    def independent_rate(self) -> float:
        """Independent samples a second behind the filter [Hz]."""
        design = ParallelFilter.design(self.cutoff, _RATE_OVER_CUTOFF * self.cutoff)
        return design.rate / (design.decimation * design.inflation)

    @property
    def weights(self) -> Array:
        """Information that a second holds, per squared regressor entry, shape `(n,)`."""
        return np.asarray(self.independent_rate / self.noise**2)

    def information(self, base: BaseMap, absent: Collection[str] = ()) -> Array:
        """Information on a model's base parameters, `(b, b)`; none on those not estimated.

        Parameters that the model does without (`absent`) are known to be zero.
        """
        place = {name: k for k, name in enumerate(base.base_names)}
        known = [k for k, name in enumerate(self.names) if name in place or name in absent]
        own = np.linalg.pinv(self.covariance[np.ix_(known, known)], hermitian=True)
        left = [k for k, name in enumerate(self.names[j] for j in known) if name in place]
        targets = [place[self.names[known[k]]] for k in left]
        full = np.zeros((len(base), len(base)))
        full[np.ix_(targets, targets)] = own[np.ix_(left, left)]
        return full


def earlier_of(identified: IdentifiedModel) -> Earlier:
    """What an identified model knows for the design of a motion."""
    estimate = identified.estimate
    return Earlier(
        estimate.sigma,
        identified.cutoffs.matched,
        estimate.parameters.names,
        estimate.parameters.values,
        estimate.covariance,
        estimate.values.as_dict(),
        (*(one.name for one in estimate.removed), *estimate.known),
    )


def identified_before(
    earlier: str | Path | IdentifiedModel, loaded: LoadedRobot
) -> IdentifiedModel:
    """An earlier model of the robot."""
    known = load_model(earlier)
    where = "earlier model" if isinstance(earlier, IdentifiedModel) else str(earlier)
    theirs, ours = known.model.robot.joint_names, loaded.robot.joint_names
    if theirs != ours:
        raise DataError(
            f"the earlier model moves the joints {', '.join(theirs)}, this robot {', '.join(ours)}",
            where=where,
            fix="give a model that was identified with this robot file, or the model's robot file",
        )
    if not (known.estimate.sigma > 0.0).all():
        raise DataError(
            "the earlier model fits a joint's efforts without any noise",
            where=where,
            fix="leave --earlier out: noise is then assumed",
        )
    return known
