r"""Drive gains from runs with and without a known payload, or from some known gains.

Effort stays on the left as it was logged, $y_j = \rho_j Y_j \phi$ with $\rho_j = 1/k_j$, so its
noise biases nothing; with noisy currents among the columns, gains of weakly moved joints come out
several times too small. $\phi$ is one for all joints and runs, but for friction and offset, which
are each run's own; the payload's mass, known, or a known gain fixes the scale. Friction takes
energy, so its sign in a row is that of the row's gain.

That is bilinear least squares on Gram matrices,
$\min \sum_j w_j \|y_j - \rho_j Y_j \theta\|^2$ over $\theta$ and some of the $\rho_j$. For given
$\rho$, $\theta$ is linear; $\rho$ goes by damped Gauss-Newton steps of both together, and rows
weigh by their own residuals.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import starmap
from typing import Any, NamedTuple

import numpy as np

from steelyard.base.arrays import Z95, Array, frozen, json_values
from steelyard.base.errors import DataError, ModelError, refuse_unknown
from steelyard.estimate.information.base_parameters_and_regressor import base_parameters
from steelyard.estimate.information.information import Information
from steelyard.estimate.payload.payload_estimate import PayloadEstimate, payload_of
from steelyard.estimate.payload.runs_with_payload import (
    LoadCase,
    carrier,
    covariance_of,
    inverse,
    load_case,
    refuse_foreign,
    scatter,
)
from steelyard.model.model import Model
from steelyard.robot.robot import Frame, Robot

ROUNDS = 50  # most rounds of the weights
STEPS = 100  # most steps in a round
WEAK = 1e-3  # a start below this share of the median gain is put to the median
DOUBTFUL = 0.3  # relative standard deviation from which on a gain's sign is in doubt
ROUNDING = 1e-16  # share of a row's energy below which squared residuals are not known
ALONE = 0.99  # share of a column that others do not make up for, from which on its value is its own

SURE = 20.0
"""Friction over its standard deviation from which on it determines a gain's sign; filtered samples
are alike, and count for less than their number."""

LONGEST = 0.5  # most that a step may change `rho`, relative to it: signs are those of the start
TOLERANCE = 1e-10  # relative change of the cost at which steps end; of the weights, its square root


@dataclass(frozen=True, eq=False)
class Solution:
    """Parameters `theta` in joint units, `rho` = 1 / gain per row, and weights of the rows."""

    theta: Array
    rho: Array
    weights: Array


@dataclass(frozen=True, eq=False)
class Bilinear:
    r"""Bilinear least squares, $\sum_j w_j \|y_j - \rho_j Y_j \theta\|^2$, on Gram matrices."""

    information: Information
    start: Array  # parameters that are not free at their values, the others at zero
    free: tuple[int, ...]
    given: Array  # known gains; not a number where they are to be found
    # columns whose parameters are not negative: friction, whose sign in a row is that of its gain
    dissipative: frozenset[str] = frozenset()

    @classmethod
    def of(
        cls,
        case: LoadCase,
        mass: float | None,
        given: Array,
        loaded: bool,
        dissipative: frozenset[str] = frozenset(),
    ) -> "Bilinear":
        """The problem of runs; without loaded ones there is no payload."""
        start = np.zeros(case.size)
        fixed: tuple[int, ...] = () if loaded else case.payload
        if mass is not None:
            start[case.payload[0]], fixed = mass, case.payload[:1]
        free = tuple(k for k in range(case.size) if k not in fixed)
        return cls(case.information, start, free, given, dissipative)

    @cached_property
    def rows(self) -> tuple[tuple[tuple[int, ...], Array], ...]:
        """Columns of each row, and the Gram matrix of these and its effort."""
        sees = enumerate(self.information.layout.sees)
        return tuple((seen, self.information.row_gram(row)) for row, seen in sees)

    @property
    def n(self) -> int:
        """Number of rows."""
        return len(self.rows)

    @property
    def wanted(self) -> tuple[int, ...]:
        """Rows whose gain is to be found."""
        return tuple(int(k) for k in np.flatnonzero(np.isnan(self.given)))

    @cached_property
    def chosen(self) -> list[int]:
        """Places of the free parameters and the wanted `rho` among all parameters and rows."""
        return [*self.free, *(len(self.start) + row for row in self.wanted)]

    def squares(self, solution: Solution) -> Array:
        """Sum of squared residuals per row, in logged units."""
        result = []
        for rho, (seen, gram) in zip(solution.rho, self.rows, strict=True):
            weights = np.append(-rho * solution.theta[list(seen)], 1.0)
            result.append(weights @ gram @ weights)
        return np.maximum(result, 0.0)

    def cost(self, solution: Solution) -> float:
        """The weighted sum of squares."""
        return float(solution.weights @ self.squares(solution))

    def normal(self, solution: Solution) -> tuple[Array, Array]:
        """Normal equations of a step of the free parameters and the wanted `rho`."""
        size = len(self.start)
        matrix = np.zeros((size + self.n, size + self.n))
        gradient = np.zeros(size + self.n)
        for row, (seen, whole) in enumerate(self.rows):
            slope = np.zeros((len(seen), len(seen) + 1))
            slope[:, :-1] = solution.rho[row] * np.eye(len(seen))
            slope[:, -1] = solution.theta[list(seen)]
            gram, effort = whole[:-1, :-1], whole[:-1, -1]
            rest = effort - solution.rho[row] * gram @ solution.theta[list(seen)]
            index = np.array([*seen, size + row])
            matrix[np.ix_(index, index)] += solution.weights[row] * slope.T @ gram @ slope
            gradient[index] += solution.weights[row] * slope.T @ rest
        return matrix[np.ix_(self.chosen, self.chosen)], gradient[self.chosen]

    def linear(self, rho: Array, weights: Array) -> Array:
        """The best parameters for given `rho`."""
        matrix, gradient = self.normal(Solution(self.start, rho, weights))
        n_free, theta = len(self.free), self.start.copy()
        matrix, gradient = matrix[:n_free, :n_free], gradient[:n_free]
        covariance = inverse(matrix)
        step = covariance @ gradient
        step += covariance @ (gradient - matrix @ step)
        theta[list(self.free)] += step
        return theta

    def deviation(self, solution: Solution) -> Array:
        """Relative standard deviation of each wanted gain; infinite where it is not seen."""
        variances = np.diag(self.covariance(solution))[len(self.free) :]
        found = np.sqrt(variances) / np.abs(solution.rho[list(self.wanted)])
        return np.where(np.isnan(found), np.inf, found)

    def covariance(self, solution: Solution) -> Array:
        """Covariance of the free parameters and the wanted `rho`; NaN where they are not seen.

        Residuals that are alike for longer than the filter, within windows or runs, widen it.
        """
        size, rho, chosen = len(self.start), solution.rho, self.chosen
        matrix, _ = self.normal(solution)
        # what residuals say about changes of all parameters and of every row's `rho`
        names = [f"1/gain.{name}" for name in self.information.layout.rows]
        near = self.information.with_predicted(solution.theta, names, -rho, rho)
        full = np.zeros((size + self.n, size + self.n))
        full[np.ix_(chosen, chosen)] = inverse(matrix)
        factors = scatter(near, np.zeros(len(full)), 1.0 / solution.weights, full)
        more, _, _ = near.normal((factors - 1.0) * solution.weights)
        widening = (full @ more @ full)[np.ix_(chosen, chosen)]
        return covariance_of(matrix, range(len(chosen))) + widening

    @cached_property
    def signs(self) -> Array:
        """Signs of the gains that friction determines, zero where it does not, shape `(n,)`."""
        names, counts = self.information.layout.columns, self.information.n_samples
        found = np.zeros(self.n)
        for row, (seen, gram) in enumerate(self.rows):
            covariance = inverse(gram[:-1, :-1])
            seen_alone = np.diag(covariance @ gram[:-1, :-1]) > ALONE
            mine = [k for k in np.flatnonzero(seen_alone) if names[seen[k]] in self.dissipative]
            values = covariance @ gram[:-1, -1]
            left = float(gram[-1, -1] - values @ gram[:-1, -1])
            variance = max(left, ROUNDING * float(gram[-1, -1])) / max(counts[row], 1.0)
            std = np.sqrt(np.maximum(variance * np.diag(covariance), 1e-300))
            seen_signs = {np.sign(values[k]) for k in mine if abs(values[k]) > SURE * std[k]}
            found[row] = seen_signs.pop() if len(seen_signs) == 1 else 0.0
        return found

    def first(self) -> Array:
        r"""A start, right in sign and size: $\rho$ from gains on the side of the parameters.

        $\min \sum_j w_j \|k_j y_j - Y_j \theta\|^2$ is linear, but noise in $y$ biases it. Rows
        weigh by their columns, whatever the unit of their efforts.
        """
        size = len(self.start)
        matrix = np.zeros((size + self.n, size + self.n))
        for row, (seen, gram) in enumerate(self.rows):
            index = np.array([*seen, size + row])
            signs = np.append(-np.ones(len(seen)), 1.0)
            length = max(float(np.trace(gram[:-1, :-1])), 1e-300)
            matrix[np.ix_(index, index)] += gram * np.outer(signs, signs) / length
        values = np.concatenate([self.start, np.where(np.isnan(self.given), 0.0, self.given)])
        chosen = self.chosen
        values[chosen] = -inverse(matrix[np.ix_(chosen, chosen)]) @ (matrix @ values)[chosen]
        gains, sizes = values[size:], np.abs(values[size:])
        signs = self.signs
        gains = np.where(np.isnan(self.given) & (signs != 0.0), signs * sizes, gains)
        typical = float(np.median(sizes[sizes > 0.0])) if np.any(sizes > 0.0) else 1.0
        weak = np.isnan(self.given) & (sizes < WEAK * typical)
        return np.asarray(1.0 / np.where(weak, np.where(gains < 0.0, -typical, typical), gains))


def solved(problem: Bilinear) -> Solution:
    """Solve with weights from the residuals; a gain in doubt is tried with the other sign too.

    Not so where friction determines it.
    """
    start, signs = problem.first(), problem.signs
    best = _reweighted(problem, start)
    for place, row in enumerate(problem.wanted):
        if signs[row] != 0.0 or problem.deviation(best)[place] <= DOUBTFUL:
            continue
        turned = start.copy()
        turned[row] *= -1.0
        other = _reweighted(problem, turned)
        # twice the negative logarithms of the likelihoods with the rows' own variances
        misfit, known = (
            float(problem.information.n_samples @ np.log(np.maximum(problem.squares(one), 1e-300)))
            for one in (other, best)
        )
        if misfit < known:
            start, best = turned, other
    return best


def _reweighted(problem: Bilinear, rho: Array) -> Solution:
    """Descend from a start until the weights are those of the residuals."""
    energy = np.maximum(problem.information.effort_squares(), 1e-300)
    floor, counts = ROUNDING * energy, np.maximum(problem.information.n_samples, 1.0)
    weights = counts / energy
    solution = Solution(problem.linear(rho, weights), rho, weights)
    for _ in range(ROUNDS):
        solution = _descended(problem, solution)
        covariance, used = inverse(problem.normal(solution)[0]), np.empty(problem.n)
        for row in range(problem.n):  # degrees of freedom that the fit takes from each row
            alone = replace(solution, weights=solution.weights * (np.arange(problem.n) == row))
            used[row] = np.sum(problem.normal(alone)[0] * covariance)
        freedom = np.maximum(counts - used, 1.0)
        updated = freedom / np.maximum(problem.squares(solution), floor)
        change = np.abs(updated / solution.weights - 1.0).max()
        solution = replace(solution, weights=updated)
        if change < np.sqrt(TOLERANCE):
            break
    return solution


def _descended(problem: Bilinear, solution: Solution) -> Solution:
    damping, cost = 1e-3, problem.cost(solution)
    wanted, n_free = list(problem.wanted), len(problem.free)
    for _ in range(STEPS):
        matrix, gradient = problem.normal(solution)
        most = LONGEST * np.abs(solution.rho[wanted])
        after, best = np.inf, solution
        while after > cost and damping < 1e9:
            damped = matrix + damping * np.diag(np.diag(matrix))
            rho, step = solution.rho.copy(), (inverse(damped) @ gradient)[n_free:]
            rho[wanted] += np.clip(step, -most, most)
            best = Solution(problem.linear(rho, solution.weights), rho, solution.weights)
            after = problem.cost(best)
            damping *= 0.2 if after <= cost else 5.0
        if not after <= cost:
            return solution
        fall, solution, cost = cost - after, best, after
        if fall <= TOLERANCE * cost:
            break
    return solution


LARGEST = 0.25
"""Largest relative standard deviation of a gain. The interval is that of its inverse, which is
linear; beyond this, half of the gain, the two differ by more than a quarter."""


class DriveGain(NamedTuple):
    """One joint's gain as it is reported."""

    joint: str
    gain: float
    half_width: float  # half-width of the 95 % interval
    unit: str
    known: bool
    assumed: bool  # whether the data do not show it


@dataclass(frozen=True, eq=False)
class GainEstimate:
    """Drive gains."""

    joints: tuple[str, ...]  # names of the effort rows
    gains: Array  # joint effort per logged unit, `(n,)`
    units: tuple[str, ...]  # their units
    covariance: Array  # `(n, n)`; zero for known gains
    known: tuple[bool, ...]  # whether each was given
    # whether the data do not show it: it is then the geometric mean of the others, and counts for
    # the joint's own friction and rotor only
    assumed: tuple[bool, ...]
    relative: bool  # whether gains, and with them all parameters, are known up to one scale only
    # the payload that fixed the scale, or was found beside, in the scale of the gains; `None`
    # without loaded runs
    payload: PayloadEstimate | None
    sigma: Array  # standard deviation of the filtered residuals per row, in the logged unit

    @property
    def half_width(self) -> Array:
        """Half-widths of the 95 % intervals, shape `(n,)`."""
        return Z95 * np.sqrt(np.diag(self.covariance))

    @property
    def each(self) -> tuple[DriveGain, ...]:
        """The gains one by one."""
        numbers = self.gains.tolist(), self.half_width.tolist()
        each = zip(self.joints, *numbers, self.units, self.known, self.assumed, strict=True)
        return tuple(starmap(DriveGain, each))

    def to_dict(self) -> dict[str, Any]:
        """As JSON values."""
        names = ("joints", "gains", "units", "half_width", "known", "assumed", "relative")
        payload = None if self.payload is None else self.payload.to_dict()
        return {**json_values({name: getattr(self, name) for name in names}), "payload": payload}


def identified_gains(
    model: Model,
    unloaded: Sequence[Information],
    loaded: Sequence[Information] = (),
    *,
    mass: float | None = None,
    frame: str | None = None,
    known: Mapping[str, float] | None = None,
    relative: bool = False,
) -> GainEstimate:
    """Find the drive gains that are not known.

    Given is what runs without and with a payload say, one by one, efforts as logged. The mass of
    the payload [kg] or a known gain fixes the scale; its centre and inertia are found beside the
    gains, in a frame, or that of the last link. Where neither is known, gains `relative` to the
    first joint's, which is called 1, may do. A gain that the data do not show is assumed to be the
    geometric mean of those of its unit; a `DataError` says that there is none, or that nothing
    fixes the scale.
    """
    given = _given(model, known or {})
    unscaled = mass is None and bool(np.isnan(given).all())
    _refuse_unanswerable(unloaded, loaded, mass, unscaled and not relative)
    if unscaled:
        given[0] = 1.0
    refuse_foreign(model, (*unloaded, *loaded))
    carries = carrier(model.robot, frame)
    case = load_case(model, base_parameters(model), carries, unloaded, loaded, first_deviates=False)
    dissipative = frozenset(model.names_where(lambda term: term.dissipation == "each"))
    problem = Bilinear.of(case, mass, given, bool(loaded), dissipative)
    solution = solved(problem)
    pairs = zip(model.robot.effort_units, case.information.signature.effort, strict=True)
    units = tuple("1" if joint == unit else f"{joint}/{unit}" for joint, unit in pairs)
    assumed = np.zeros(len(given), dtype=np.bool_)
    while (shares := problem.deviation(solution)).max(initial=0.0) > LARGEST:
        unseen = problem.wanted[int(np.argmax(shares))]
        assumed[unseen] = True
        problem = replace(problem, given=_assumed(problem, solution, unseen, units))
        solution = solved(problem)
    chosen = list(problem.wanted)  # a known gain has no covariance
    slope, covariance = -1.0 / np.square(solution.rho[chosen]), np.zeros((problem.n, problem.n))
    found = problem.covariance(solution)[len(problem.free) :, len(problem.free) :]
    covariance[np.ix_(chosen, chosen)] = found * slope[:, None] * slope
    return GainEstimate(
        joints=model.robot.joint_names,
        gains=frozen(1.0 / solution.rho),
        units=units,
        covariance=frozen(covariance),
        known=tuple((~np.isnan(given)).tolist()),
        assumed=tuple(assumed.tolist()),
        relative=unscaled,
        payload=_payload(problem, case, solution, model.robot, carries) if loaded else None,
        sigma=frozen(1.0 / np.sqrt(solution.weights)),
    )


def _given(model: Model, known: Mapping[str, float]) -> Array:
    """Known gains in the order of the joints; not a number where unknown."""
    names, given = model.robot.joint_names, np.full(model.robot.n, np.nan)
    for name, gain in known.items():
        where = f"known gains of robot '{model.robot.name}'"
        refuse_unknown(name, names, f"there is no joint '{name}'", where, "joints")
        if not np.isfinite(gain) or gain == 0.0:
            fix = "give joint effort per logged unit, or leave it out to have it identified"
            raise ModelError(f"the gain of joint '{name}' is {gain:g}", where=where, fix=fix)
        given[names.index(name)] = gain
    return given


def _refuse_unanswerable(
    unloaded: Sequence[Information],
    loaded: Sequence[Information],
    mass: float | None,
    unscaled: bool,
) -> None:
    if not unloaded and not loaded:
        wrong, fix = "there is no run", "give runs of the robot"
    elif unscaled:
        wrong = "nothing determines the scale: gains are identifiable only relative to each other"
        fix = (
            "give a loaded run with the payload's mass (--loaded LOG --payload-mass KG), or the "
            "gain of one joint"
        )
    elif mass is not None and not (mass > 0.0 and np.isfinite(mass)):
        wrong, fix = f"the payload's mass is {mass:g} kg", "give it in kg"
    elif mass is not None and not (loaded and unloaded):
        lacking = "without" if loaded else "with"
        wrong = f"a known mass needs runs with and without it; there is none {lacking}"
        fix = (
            f"give a run {lacking} the payload, best of the same motion (--loaded LOG for those "
            "with it)"
        )
    else:
        return
    raise DataError(wrong, where="identification of drive gains", fix=fix)


def _assumed(problem: Bilinear, solution: Solution, row: int, units: Sequence[str]) -> Array:
    """The given gains with that of a row: the others' mean, in sign as friction or most are."""
    shares = dict(zip(problem.wanted, problem.deviation(solution), strict=True))
    alike = [
        k
        for k in range(problem.n)
        if k != row and units[k] == units[row] and shares.get(k, 0.0) <= LARGEST
    ]
    if not alike:
        width, joint = 100.0 * Z95 * shares[row], problem.information.layout.rows[row]
        by = f" (95 % interval of ± {width:.0f} %)" if width < 1e4 else ""
        raise DataError(
            f"the data do not determine the gain of joint '{joint}'{by}, nor any "
            "other gain of its unit",
            where="identification of drive gains",
            fix="move it faster, together with the other joints, or give its gain",
        )
    gains = 1.0 / solution.rho[alike]
    sign = problem.signs[row] or (1.0 if np.sum(np.sign(gains)) >= 0.0 else -1.0)
    given = problem.given.copy()
    given[row] = sign * np.exp(np.log(np.abs(gains)).mean())
    return given


def _payload(
    problem: Bilinear, case: LoadCase, solution: Solution, robot: Robot, frame: Frame
) -> PayloadEstimate:
    """The payload, with no uncertainty of a mass that was given."""
    place = {column: k for k, column in enumerate(problem.free)}
    mine = [k for k, column in enumerate(case.payload) if column in place]
    chosen = [place[case.payload[k]] for k in mine]
    covariance = np.zeros((10, 10))
    covariance[np.ix_(mine, mine)] = problem.covariance(solution)[np.ix_(chosen, chosen)]
    return payload_of(
        frame,
        robot,
        solution.theta[list(case.payload)],
        covariance,
        sigma=frozen(1.0 / np.sqrt(solution.weights)),
        n_samples=frozen(case.information.n_samples),
        notes=("the payload's mass was given",) if len(mine) < 10 else (),
    )
