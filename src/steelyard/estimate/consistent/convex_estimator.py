r"""Physically consistent parameters: bodies near their priors [Wensing2018].

The data come whitened and compressed, bodies in the scale of their prior, friction, rotor inertia
and stiffness within their bounds; the program is convex: Clarabel comes near its optimum, Newton's
method gets there. Its curvature at the optimum is the posterior's precision (Laplace), so intervals
count data and prior alike, and each parameter has its share of data. Near the edge of physical
consistency the penalty is steep, which makes no parameter better known: the prior counts there with
the curvature that it has at its own values.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from steelyard.base.arrays import Array, Parameters, frozen, places_of
from steelyard.base.errors import DataError
from steelyard.estimate.consistent.conic_solver_and_scaled_parameters import (
    AIM,
    MOST_ITERATIONS,
    Entropic,
    Form,
    Infeasible,
    Unsolved,
    solved,
    unknowns,
)
from steelyard.estimate.consistent.convex_program_and_newton_refinement import (
    Program,
    conic_constraints,
    polished,
)
from steelyard.estimate.consistent.prior_weight_and_contradictions import (
    LEAST_PRIOR_WEIGHT,
    MOST_NAMED,
    PARTS,
    Tried,
    active_bounds,
    far_constraints,
    refuse_contradictions,
    weighed,
)
from steelyard.estimate.estimate import Estimate, StandardEstimate
from steelyard.estimate.information.base_parameters_and_regressor import BaseMap
from steelyard.estimate.information.information import Information
from steelyard.estimate.least_squares.normal_equations import Fit, Runs, described
from steelyard.estimate.least_squares.weighted_robust_and_whitened import Whitened, whitened
from steelyard.estimate.prior.body_priors import Knowledge

ROUGH = 1e-8  # gap and infeasibility required of the solver where Newton's method does the rest

UNITS = (1e4, 1e6)
"""Units of the squares that are tried where the solver stops in that of the noise, before that of
the whole effort."""

GAP_IN_EFFORT_UNITS = 1e-5  # gap that is enough in such a unit: squares are nearly all the effort's

ENOUGH = 5e-5
"""Gap of the objective that moves no value by more than 0.01 standard deviations: within a gap `g`
the data and the prior together leave a distance of the root of `2 g`."""

LISTED = 6  # prior constraints that the notes list
CONTRADICTED = 2.0  # standard deviations by which data violate a constraint that they contradict
EDGE = 0.02  # least eigenvalue of a body's `X` below which it is at the edge of consistent bodies
CONTRADICTED_KNOWLEDGE = "the data contradict the prior constraints"  # a note begins so
TERM_MISSING = "a term is missing or wrong"  # the end of a note, and of no other
CONSTRAINTS_IN_NOTE = 6  # active constraints that a note names


@dataclass(frozen=True, eq=False)
class Consistent:
    """The convex estimate with a prior; the default."""

    base: BaseMap  # lifts base parameters to standard ones
    knowledge: Knowledge  # priors, bounds and constraints
    form: Form = Entropic()  # penalties of bodies far from their priors, and physical consistency
    # weight of the prior; of its stated uncertainty, or found from the data, if `None`
    gamma: float | None = None
    per_run: tuple[str, ...] = ()  # columns whose parameters every run has for itself
    equal: bool = False  # whether all rows weigh the same, whatever their noise
    iterations: int = MOST_ITERATIONS  # after which the solver gives up

    def __call__(self, information: Information) -> Estimate:
        """Estimate all standard parameters."""
        data = whitened(information, self.per_run, equal=self.equal)
        program = self.program(data)
        return self._described(data, program, self.weighed(data, program))

    def values(
        self, information: Information, gamma: float | None = None, near: Array | None = None
    ) -> tuple[Array, float, Array]:
        """Values of the information's columns `(p,)`, zero without a base parameter.

        Then the weight of the prior, `gamma` or as of a call if `None`, and all standard
        parameters. No run has parameters of its own. `near` are standard parameters of a similar
        problem, to begin at.
        """
        data = whitened(information, equal=self.equal)
        program = self.program(data)
        if gamma is None:
            tried = self.weighed(data, program)
        else:
            begin = None if near is None else program.unknowns.of_standard(near)
            tried = self._tried(program, gamma, begin)
        standard = program.unknowns.standard(tried.u)
        values = self.base.values_of(information.layout.columns, standard)
        return values, tried.gamma, standard

    def program(self, data: Whitened) -> Program:
        """The convex program of whitened data."""
        known = unknowns(data, self.base, self.knowledge)
        return Program(known, conic_constraints(known, self.knowledge), self.form)

    def solve(self, program: Program, gamma: float, near: Array | None = None) -> Array:
        """The unknowns at the optimum with a weight of the prior, near those of a like problem."""
        near = near if program.smooth else None
        if near is not None and (end := polished(program, near, gamma)) is not None:
            return end
        try:
            return self._optimum(program, gamma)
        except (Infeasible, Unsolved) as error:
            refuse_contradictions(self.knowledge)
            if far := far_constraints(program.constraints):
                raise type(error)(
                    error.wrong,
                    where=self._where,
                    fix=f"check the magnitudes in [[knowledge]]: {'; '.join(far)}",
                ) from None
            raise

    def _optimum(self, program: Program, gamma: float) -> Array:
        """Near it by the solver and to the end by Newton's method, or all by the solver."""
        m, whole = len(program.unknowns.weak), float(np.sum(np.square(program.unknowns.vector)))

        def found(unit: float, aim: float, enough: float) -> Array:
            conic = program.conic(gamma, unit=unit)
            return solved(conic, self._where, self.iterations, aim=aim, enough=enough)[:m]

        if program.smooth:
            with suppress(Infeasible, Unsolved):
                end = polished(program, found(1.0, ROUGH, ENOUGH), gamma)
                if end is not None:
                    return end
        try:
            return found(1.0, AIM, ENOUGH)
        except (Infeasible, Unsolved):
            # where consistent bodies contradict the data, the squares are so many times the prior's
            # penalty that the solver loses the latter's digits: other units of the squares help
            for unit in (unit for unit in (*UNITS, whole) if 1.0 < unit <= whole):
                with suppress(Infeasible, Unsolved):
                    return found(unit, ROUGH, GAP_IN_EFFORT_UNITS)
            raise

    @property
    def _where(self) -> str:
        return f"the consistent estimate ({self.form.name} prior)"

    def weighed(self, data: Whitened, program: Program) -> Tried:
        """The solution with the weight of the prior that is given, stated or found."""
        stated = self.gamma
        if stated is None and self.knowledge.uncertainty is not None:
            stated = self.knowledge.uncertainty**-2
        if stated is None and self.form.penalises and any(program.unknowns.priors):
            left_out = partial(self._left_out, data, program)
            return weighed(partial(self._tried, program), left_out, len(program.unknowns.vector))
        return self._tried(program, 0.0 if stated is None else stated)

    def _tried(self, program: Program, gamma: float, near: Array | None = None) -> Tried:
        u = self.solve(program, gamma, near)
        return Tried(gamma, u, program.unknowns.chi_squared(u), program.evidence(u, gamma))

    def _left_out(self, data: Whitened, near: Program, tried: Tried) -> Array:
        """Squares of parts of the data, each predicted without it, but for a constant."""
        whole, weights, found = data.fit.data.whole, 1.0 / data.fit.variances, list[float]()
        windows = range(len(whole.windows))
        for part in np.array_split(windows, min(PARTS, len(windows))):
            rest = whole.of([k for k in windows if k not in part])
            program = self.program(whitened(rest, self.per_run, equal=self.equal))
            begin = program.unknowns.of_standard(near.unknowns.standard(tried.u))
            standard = program.unknowns.standard(self.solve(program, tried.gamma, begin))
            x = self.base.values_of(whole.layout.columns, standard)
            matrix, vector, *_ = Runs.of(whole.of(part.tolist()), self.per_run).normal(weights)
            found.append(float(x @ matrix @ x - 2.0 * vector @ x))
        return np.array(found)

    def _described(self, data: Whitened, program: Program, found: Tried) -> Estimate:
        """The estimate: base parameters as the data see them, and all standard ones."""
        known = program.unknowns
        after, before = _spreads(data, program, found)
        u, held = active_bounds(program, found.u, after @ after.T)
        standard = known.standard(u)
        lift, free = self.base.lift, program.constraints.free
        spread = lift @ (known.scale @ after)
        fit = _fit(data, lift @ standard, spread @ spread.T, self.base)
        name = f"physically consistent ({self.form.name} prior)"
        estimate = described(name, fit, fit.inverse)
        names = estimate.parameters.names
        places = places_of(names, self.base.base_names)
        learned = _share(lift @ known.scale, free, after, before)[places]
        learned[[n in self.per_run for n in names]] = 1.0
        alone = (np.count_nonzero(lift, axis=1) == 1)[places]
        share = _share(known.scale, free, after, before)
        return replace(
            estimate,
            standard=self._standard(estimate, standard, known.scale @ after, share),
            learned=frozen(learned),
            at_bound=tuple(n for n, own in zip(names, alone, strict=True) if n in held and own),
            notes=tuple(self._notes(data, program, found)),
        )

    def _notes(self, data: Whitened, program: Program, found: Tried) -> list[str]:
        """What was known, how its weight came about, and what it costs."""
        notes, gamma = list(self.knowledge.notes), found.gamma
        if labels := list(dict.fromkeys(row.label for row in self.knowledge.rows)):
            more = f"; and {len(labels) - LISTED} more" if len(labels) > LISTED else ""
            notes.append(f"prior constraints: {'; '.join(labels[:LISTED])}{more}")
        if gamma and any(program.unknowns.priors):
            how = "as stated"
            if self.knowledge.uncertainty is None:
                how = "estimated from the data"
                how += f" in {found.solves} iterations" if self.gamma is None else ""
            notes.append(
                f"prior uncertainty of link inertias {100.0 * gamma**-0.5:.3g} % ({how}); prior "
                f"and constraints raise χ² by {found.rise:.3g} (up to "
                f"{len(program.unknowns.vector)} is within noise)"
            )

        return notes + self._cost_notes(data, program, found)

    def _cost_notes(self, data: Whitened, program: Program, found: Tried) -> list[str]:
        """What contradicts the data: knowledge, physical constraints, or the prior."""
        rank, rise, notes = len(program.unknowns.vector), found.rise, list[str]()
        knowledge = replace(self.knowledge, rows=())
        try:
            if self.knowledge.rows:
                bare = replace(program, constraints=conic_constraints(program.unknowns, knowledge))
                free = self._tried(bare, found.gamma)
                if against := _contradicted(program, free.u, _spreads(data, bare, free)[0]):
                    notes.append(
                        f"{CONTRADICTED_KNOWLEDGE}, which raise χ² by "
                        f"{rise - free.rise:.4g}: {'; '.join(against)}"
                    )
                program, rise = bare, free.rise
            if rise > rank and (physical := self._physical(data, program, knowledge)):
                return [*notes, physical]
        except DataError:
            return notes
        if rise > 2.0 * rank and any(program.unknowns.priors):
            notes.append(
                f"a prior with this uncertainty raises χ² by {rise:.4g}, where up to {rank} is "
                "within noise: the data contradict it"
            )
        return notes

    def _physical(self, data: Whitened, program: Program, knowledge: Knowledge) -> str | None:
        """What bounds and consistent bodies cost without a prior; nothing if noise explains it."""
        whole = self._tried(program, LEAST_PRIOR_WEIGHT)
        if whole.rise <= len(program.unknowns.vector):
            return None
        lower = np.where(knowledge.of_bodies, knowledge.lower, -np.inf)
        upper = np.where(knowledge.of_bodies, knowledge.upper, np.inf)
        unbounded = replace(knowledge, lower=lower, upper=upper, curves=())
        bare = replace(program, constraints=conic_constraints(program.unknowns, unbounded))
        alone = self._tried(bare, LEAST_PRIOR_WEIGHT)
        root = _spreads(data, program, whole)[0]
        _, at = active_bounds(program, whole.u, root @ root.T)
        thin = np.linalg.eigvalsh(program.unknowns.pseudo(whole.u))[:, 0] <= EDGE
        edges = [name for name, near in zip(knowledge.bodies, thin, strict=True) if near]
        parts = (
            (whole.rise - alone.rise, "bounds of", grouped(at, knowledge.names)),
            (alone.rise, "valid inertia of", edges),
        )
        most = CONSTRAINTS_IN_NOTE
        named = [
            f"{kind} {', '.join(names[:most])}"
            f"{f' and {len(names) - most} more' if len(names) > most else ''} ({cost:.4g})"
            for cost, kind, names in sorted(parts, key=lambda part: -part[0])
            if names and cost > 0.05 * whole.rise
        ]
        active = f"; active: {'; '.join(named)}" if named else ""
        return (
            f"physical constraints (valid inertias, bounds such as friction >= 0) raise χ² by "
            f"{whole.rise:.4g} even without a prior{active}: {TERM_MISSING}"
        )

    def _standard(
        self, estimate: Estimate, values: Array, spread: Array, share: Array
    ) -> StandardEstimate:
        """All standard parameters; what every run has for itself is as a new run is expected."""
        full, learned, covariance = values.copy(), share.copy(), spread @ spread.T
        for name in self.per_run:
            if name in estimate.parameters.names:
                k, own = self.base.names.index(name), estimate.parameters.names.index(name)
                full[k], learned[k] = estimate.parameters.values[own], 1.0
                covariance[k, k] = estimate.covariance[own, own]
        parameters = Parameters(self.base.names, self.base.units, full)
        return StandardEstimate(parameters, frozen(covariance), frozen(learned))


def _spreads(data: Whitened, program: Program, tried: Tried) -> tuple[Array, Array]:
    r"""Roots $R$ of the unknowns' covariances $R R^T$ with the data and without, each `(m, k)`.

    Within the constraints' equations. Sums of unknowns of which each is hardly known have a small
    variance that rounding would take from $R R^T$, not from their rows of $R$. Where rows do not
    weigh by their noise, that of the data is between the inverses.
    """
    known, free = program.unknowns, program.constraints.free
    prior = program.stated_precision(tried.u, tried.gamma)
    after, before = (
        free @ root_of_inverse(free.T @ precision @ free)
        for precision in (prior + known.matrix.T @ known.matrix, prior)
    )
    if not np.array_equal(data.noise, np.eye(len(data.noise))):
        values, vectors = np.linalg.eigh(known.matrix.T @ data.noise @ known.matrix + prior)
        after = after @ (after.T @ (vectors * np.sqrt(np.maximum(values, 0.0))))
    return after, before


def root_of_inverse(precision: Array) -> Array:
    """Root of the inverse of a precision; of what nothing is known, that of a large variance."""
    values, vectors = np.linalg.eigh(precision)
    floor = 1e-14 * max(float(values.max(initial=0.0)), 1.0)
    return np.asarray(vectors / np.sqrt(np.maximum(values, floor)))


def _share(parameters: Array, free: Array, after: Array, before: Array) -> Array:
    """Share of what is known that the data taught; nothing of what the constraints' equations give.

    Parameters are sums of the unknowns, `(p, m)`; `free` directions of those are left by the
    equations, `(m, k)`; `after` and `before` are the roots of `_spreads`.
    """
    taught, guessed = (np.sum(np.square(parameters @ root), axis=1) for root in (after, before))
    lengths = np.linalg.norm(parameters, axis=1)
    given = np.linalg.norm(parameters @ free, axis=1) <= 1e-9 * lengths
    ratio = taught / np.where(given | (guessed <= 0.0), 1.0, guessed)
    return np.where(given | (guessed <= 0.0), 0.0, np.clip(1.0 - ratio, 0.0, 1.0))


def _fit(data: Whitened, values: Array, covariance: Array, base: BaseMap) -> Fit:
    """The values as a fit in base parameters, with the parameters of single runs."""
    rows = places_of(data.fit.data.whole.layout.columns, base.base_names)
    local = list(data.fit.data.local)
    full = values[rows]
    full[local] = 0.0
    kept = [rows[k] for k in data.fit.kept]
    return replace(
        data.fit,
        values=full,
        inverse=covariance[np.ix_(kept, kept)],
        locals=tuple(part.solved(full) for part in data.eliminated),
    )


def _contradicted(program: Program, free: Array, root: Array) -> tuple[str, ...]:
    """Constraints that the data contradict; `free` is the optimum without them, `(m,)`.

    `root` is that of its covariance.
    """
    constraints, known = program.constraints, program.unknowns
    found: dict[str, tuple[float, float]] = {}
    values, stds = constraints.matrix @ free, np.linalg.norm(constraints.matrix @ root, axis=1)
    standard = dict(zip(known.names, known.standard(free).tolist(), strict=True))
    for row, value, std, low, high in zip(
        constraints.rows, values, stds, constraints.lower, constraints.upper, strict=True
    ):
        missed = max(low - value, value - high)
        if missed <= CONTRADICTED * std or missed <= 0.0:
            continue
        worth = missed / max(std, 1e-300)
        data = sum(factor * standard[name] for name, factor in row.coefficients.items())
        if row.label not in found or worth > found[row.label][0]:
            found[row.label] = (worth, data)
    order = sorted(found, key=lambda label: -found[label][0])
    lines = [f"{label}: {found[label][1]:.4g} without it" for label in order[:MOST_NAMED]]
    rest = len(order) - MOST_NAMED
    return (*lines, *([f"and {rest} more"] if rest > 0 else []))


def grouped(names: Sequence[str], every: Sequence[str]) -> list[str]:
    """Names of parameters; a law of which all are among them is `law.*`."""
    found: dict[str, None] = {}
    for name in names:
        law = name.split(".")[0]
        family = [other for other in every if other.split(".")[0] == law]
        whole = len(family) > 1 and set(family) <= set(names)
        found[f"{law}.*" if whole else name] = None
    return list(found)
