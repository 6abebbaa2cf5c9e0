r"""Consistent bodies that a log supports by itself; another last link, mirrored bodies.

A nominal model is weak evidence: links may be several times heavier or lighter than it says. So a
reading is also compared with bodies of the log's own, which need only be possible, with
friction and rotor inertia that are not negative:

$$ \min \sum_j \frac{\|s_j e_j - (A^{-1} Y \phi)_j - Y_j \theta_j\|^2}{\|s_j e_j\|^2 (m_j^2 +
   m_0^2)} + \gamma \sum_i D(X_i) $$

with a prior so wide that a factor of three costs next to nothing. A reading that leaves a
large misfit even so contradicts the data; one that leaves a small one does not, whatever the
nominal model says.

Where most of an arm's mass is in its last link, an error of that link in the model file changes the
efforts of all joints by about one factor, and looks like a gain. A heavier link is the same as a
payload; a lighter one is not, and has to be a physically consistent body.

Mirrored bodies turn every torque of the mirrored motion. So the two cannot be distinguished by any
log of such an arm; that efforts are of the other sign is a single convention, and by far the
likelier mistake.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import DataError
from steelyard.check.hypotheses.nuisance_fit_and_score import (
    MISFIT_FLOOR,
    NUISANCES,
    LikelihoodScore,
    score_of,
)
from steelyard.check.hypotheses.readings_and_likelihood import (
    CLOSE_HYPOTHESES,
    FITTED_NUMBER_COST,
    Hypothesis,
    Likelihood,
    Reading,
)
from steelyard.check.signals.good_rows_and_derivatives import remembered
from steelyard.estimate.consistent.conic_solver import solved
from steelyard.estimate.consistent.convex_program import ConicConstraints, Program, polished
from steelyard.estimate.consistent.unknowns_and_penalties import Entropic, Unknowns, ten_map
from steelyard.estimate.information.base_regressor import (
    Regressor,
    base_parameters,
    chosen_regressor,
)
from steelyard.estimate.payload.runs_with_payload import carrier
from steelyard.estimate.prior.body_priors import model_prior
from steelyard.model.compiled_evaluation import check_angles
from steelyard.model.model import Model, ValuedModel

BODY_SAMPLES = 600  # samples that bodies are fitted to
BODY_PRIOR_WEIGHT = 0.1  # weight of the prior: links are known to a factor of three or so
WEIGHT_PASSES = 3  # times that joints weigh by what is left of their efforts
AIMED_GAP, ENOUGH_GAP = 1e-7, 1e-2
"""Gap that is required of the solver, and that is enough to compare misfits."""
WIDEST_FRICTION = 100.0  # standard deviation of friction, in the whole effort


@dataclass(frozen=True, eq=False)
class ConsistentBodies:
    """Bodies of a log's own under one reading."""

    score: LikelihoodScore  # how well they agree
    scale: float  # typical effort of the bodies over that of the nominal ones

    @property
    def percent(self) -> float:
        """Typical misfit [%]."""
        return float(self.score.percent)


@remembered
def consistent_bodies(reading: Reading) -> ConsistentBodies | None:
    """Physically consistent bodies that agree best; `None` where they cannot be found."""
    log = reading.likelihood.thinned(BODY_SAMPLES)
    columns, efforts, moving = rows_of(reading.on(log).changed(payload=None))
    if not (np.isfinite(columns).all() and moving.any() and efforts.any()):
        return None
    problem = _BodyProblem(log, columns, range(len(log.knowledge.robot.bodies)))
    found = problem.agreeing(efforts, efforts, moving)
    return None if found is None else ConsistentBodies(found[1], problem.typical(found[0]))


def other_link(reading: Reading) -> Array | None:
    """Ten numbers by which the last link differs from the model file, all other links as there.

    The link that they make is physically consistent. `None` where none can be found. What the
    reading says of a payload does not count.
    """
    log = reading.likelihood.thinned(BODY_SAMPLES)
    knowledge, bare = log.knowledge, reading.on(log).changed(payload=None)
    columns, efforts, moving = rows_of(bare)
    predicted = bare.predicted(*bare.motion())
    if not (np.isfinite(columns).all() and np.isfinite(predicted).all() and efforts.any()):
        return None
    last = carrier(knowledge.robot).body
    mine = slice(10 * last, 10 * last + 10)
    nominal = knowledge.steady.values.values[mine]
    nuisances = columns[..., 10 * len(knowledge.robot.bodies) :]
    columns = np.concatenate((columns[..., mine], nuisances), axis=-1)
    rest = efforts - predicted * moving + columns[..., :10] @ nominal
    problem = _BodyProblem(log, columns, (last,))
    found = problem.agreeing(rest, efforts, moving)
    return None if found is None else np.asarray((problem.scale @ found[0])[:10] - nominal)


def rows_of(reading: Reading) -> tuple[Array, Array, Array]:
    """Columns of bodies and nuisances `(n, N, k)`, efforts and where joints move `(n, N)`.

    NaN where the states are impossible.
    """
    knowledge, motion, (y, moving) = reading.knowledge, reading.motion(), reading.columns()
    try:
        check_angles(motion[0])
        bodies = knowledge.under_any(reading.gravity, _dense, *motion)
    except (DataError, ValueError):  # the states are impossible
        bodies = np.full((10 * len(knowledge.robot.bodies), *moving.shape), np.nan)
    bodies = np.einsum("ij,kjb->kib", reading.into_logged(), bodies)
    joints, own = np.arange(len(moving)), np.zeros((*moving.shape, len(moving), NUISANCES))
    own[joints, :, joints] = y[:, :NUISANCES].swapaxes(1, 2)
    free = np.moveaxis(bodies, 0, -1) * moving[..., None]
    columns = np.concatenate((free, own.reshape(*moving.shape, -1)), axis=-1)
    return columns, reading.efforts() * moving, moving


def _dense(valued: ValuedModel, q: Array, dq: Array, ddq: Array) -> Array:
    """Columns of the bodies of one model, shape `(10 bodies, n, N)`."""
    return np.moveaxis(_regressor(valued.model).dense(q, dq, ddq), -1, 0).copy()


@remembered
def _regressor(model: Model) -> Regressor:
    return chosen_regressor(model, base_parameters(model), range(10 * len(model.robot.bodies)))


class _BodyProblem:
    """The convex program of one reading, for those bodies whose columns come first.

    Its `scale` are numbers of the bodies and nuisances per unknown, shape `(k, k)`.
    """

    def __init__(self, log: Likelihood, columns: Array, which: Sequence[int]) -> None:
        self._columns, self._log, self._bodies = columns, log, len(which)
        self.scale = np.zeros(2 * columns.shape[-1:])
        for place, body in enumerate(which):
            part = slice(10 * place, 10 * place + 10)
            self.scale[part, part] = ten_map(model_prior(log.knowledge.robot, body).inertia)
        self._places = np.arange(10 * len(which), columns.shape[-1])

    def agreeing(
        self, efforts: Array, measured: Array, moving: Array
    ) -> tuple[Array, LikelihoodScore] | None:
        """The unknowns that agree best, and how well; joints weigh by what is left of them.

        The bodies and the nuisances make the efforts, the misfit is relative to the measured ones,
        where joints move; each `(n, N)`.
        """
        counts = moving.sum(axis=1) * self._log.excerpt.worth
        whole = np.maximum(np.sum(np.square(measured), axis=1), 1e-30)
        misfits = np.full(len(efforts), 0.3)
        # squares of a joint's residual need the triangle of its rows alone
        rows = np.concatenate((self._columns, efforts[..., None]), axis=-1)
        rows = np.asarray(np.linalg.qr(rows, mode="r"))
        near: Array | None = None
        try:
            for _ in range(WEIGHT_PASSES):
                variance = whole / np.maximum(counts, 1.0) * (misfits**2 + MISFIT_FLOOR**2)
                u = self._solved(rows, np.sqrt(self._log.excerpt.worth / variance), near)
                near = self.scale @ u
                left = rows[..., -1] - rows[..., :-1] @ near
                score = score_of(np.sum(np.square(left), axis=1), whole, counts, np.zeros((0,)))
                misfits = score.misfits
        except DataError:
            return None
        return u, score

    def _solved(self, rows: Array, weights: Array, near: Array | None) -> Array:
        """The unknowns; rows `(n, N, k + 1)`, the efforts last, of joint j times `weights[j]`.

        From numbers of bodies and nuisances with other weights, if there are any.
        """
        rows = (rows * weights[:, None, None]).reshape(-1, rows.shape[-1])
        rows, right = rows[:, :-1], rows[:, -1]
        size = np.linalg.norm(right)
        strength = np.linalg.norm(rows[:, self._places], axis=0)
        sizes = size / np.where(strength > 1e-9 * size, strength, size)
        self.scale[self._places, self._places] = sizes
        matrix = rows @ self.scale
        triangle = np.asarray(np.linalg.qr(np.column_stack((matrix, right)), mode="r"))
        k = matrix.shape[1]
        unknowns = Unknowns(
            tuple(str(j) for j in range(k)),
            (True,) * self._bodies,
            tuple(self._places.tolist()),
            self.scale,
            np.where(np.arange(k) < 10 * self._bodies, 0.0, WIDEST_FRICTION**-2),
            triangle[:, :k],
            triangle[:, k],
        )
        lower, upper = (side.reshape(-1) / sizes for side in self._log.bounds)
        constraints = ConicConstraints((), np.eye(k)[self._places], lower, upper)
        program = Program(unknowns, constraints, Entropic())
        if near is not None:
            end = polished(program, unknowns.of_standard(near), BODY_PRIOR_WEIGHT)
            if end is not None:
                return end
        conic = program.conic(BODY_PRIOR_WEIGHT)
        return solved(conic, "bodies of the log's own", aim=AIMED_GAP, enough=ENOUGH_GAP)[:k]

    def typical(self, u: Array) -> float:
        """Geometric mean over joints of the bodies' effort over that of the prior."""
        k = 10 * self._bodies
        prior = np.zeros(len(u))
        prior[:k] = np.tile([1.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0], self._bodies)
        mine, nominal = (
            np.linalg.norm(self._columns[..., :k] @ (self.scale[:k, :k] @ x[:k]), axis=1)
            for x in (u, prior)
        )
        seen = nominal > 1e-9 * nominal.max(initial=1e-300)
        logs = np.log(np.maximum(mine[seen], 1e-300) / nominal[seen])
        return float(np.exp(np.median(logs))) if seen.any() else 1.0


OWN_FILE = "payload"  # the check that an explanation by the last link belongs to
AGREEING_LINK_MISFIT = 12.0  # typical misfit [%] that one link alone may leave
SAME_LINK_MASS = 0.01
"""Change of the mass, over the link's, up to which its centre and inertia are what differs."""


def link_hypotheses(reading: Reading) -> Iterator[Hypothesis]:
    """The last link with mass properties of its own, if these alone explain the efforts.

    It is not one that outweighs the arm which carries it: efforts are then in another unit. Of the
    robot only the model file is known.
    """
    ten, robot = other_link(reading), reading.knowledge.robot
    if ten is None or abs(float(ten[0])) > sum(body.inertia.mass for body in robot.bodies):
        return
    body, changed = robot.bodies[carrier(robot).body], reading.changed(payload=ten)
    more, mass = float(ten[0]), body.inertia.mass
    if changed.percent <= AGREEING_LINK_MISFIT:
        off = f"{abs(more):.2g} kg {'heavier' if more > 0.0 else 'lighter'}"
        says = f"'{body.name}' is about {off} than the {mass:.2g} kg of the model file"
        if abs(more) <= SAME_LINK_MASS * mass:
            says = f"centre of mass or inertia of '{body.name}' differ from the model file"
        cost = 10.0 * FITTED_NUMBER_COST
        yield Hypothesis(OWN_FILE, says, changed, cost, (), changed.score, fixed=False)


def of_link(hypothesis: Hypothesis) -> bool:
    """Whether an explanation is that the last link differs from the model file."""
    return hypothesis.cause == OWN_FILE and not hypothesis.fixed


BOTH_MIRRORS_FIT = ": both fit with free link inertias, and this log cannot distinguish them"
MIRRORED = "all {} have the opposite sign"


def efforts_first(now: Reading, hypotheses: Sequence[Hypothesis]) -> tuple[Hypothesis, ...]:
    """Hypotheses, the likeliest first, turned efforts before turned positions that fit as well."""
    if not hypotheses or not _opposite(now.position_scale, hypotheses[0].reading.position_scale):
        return tuple(hypotheses)
    least = hypotheses[0].log_likelihood - CLOSE_HYPOTHESES
    for hypothesis in hypotheses[1:]:
        if hypothesis.log_likelihood > least and of_efforts(now, hypothesis):
            return (hypothesis, *(r for r in hypotheses if r is not hypothesis))
    return tuple(hypotheses)


def of_efforts(now: Reading, hypothesis: Hypothesis) -> bool:
    """Whether a hypothesis does nothing but turn the signs of all efforts."""
    after = hypothesis.reading
    return (
        hypothesis.cause == "effort sign"
        and len(after.effort) > 1
        and _opposite(now.effort_scale, after.effort_scale)
        and np.array_equal(now.position_scale, after.position_scale)
    )


def mirrors(now: Reading, one: Hypothesis, other: Hypothesis) -> bool:
    """Whether one hypothesis turns all efforts and the other one all positions."""
    return of_efforts(now, one) and _opposite(now.position_scale, other.reading.position_scale)


def with_mirror(hypothesis: Hypothesis) -> Hypothesis:
    """A hypothesis that turns all efforts, or all positions, and names the other one if that fits.

    Against the declared reading.
    """
    before, after = hypothesis.reading.likelihood.declared, hypothesis.reading
    positions = _opposite(before.position_scale, after.position_scale)
    if len(after.effort) < 2 or positions == _opposite(before.effort_scale, after.effort_scale):
        return hypothesis
    if hypothesis.cause != ("position sign" if positions else "effort sign"):
        return hypothesis
    mirror = after.changed(position_scale=-after.position_scale, effort_scale=-after.effort_scale)
    mine, other = consistent_bodies(after), consistent_bodies(mirror)
    if mine is None or other is None:
        return hypothesis
    if float(mine.score.log_likelihood - other.score.log_likelihood) > CLOSE_HYPOTHESES:
        return hypothesis
    other_words = MIRRORED.format("efforts" if positions else "positions")
    return replace(hypothesis, says=f"{hypothesis.says}, or {other_words}{BOTH_MIRRORS_FIT}")


def _opposite(before: Array, after: Array) -> bool:
    return bool(np.all(np.sign(before) == -np.sign(after)))
