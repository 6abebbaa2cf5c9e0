r"""Fields of terms and joint zero offsets found from data; references of load-dependent friction.

Candidates on a logarithmic grid enter one wide pass as a dictionary of columns. The search selects
sub-Grams: weighted least squares per choice, coordinate descent over the fields from several
starts, on the criterion $\sum_j n_j \log \sigma_j^2$ of the rows' residual variances (minus twice
the log likelihood). Further passes take the grid finer around the best choice and keep it wide
elsewhere; a quadratic through the last one gives the values, and the rise of the weighted squares
by 3.84 their 95 % intervals.

With $q + \delta$ in place of the logged $q$, the torque is $Y(q + \delta)\,\phi$: linear in the
parameters, not in the offsets. A step fits both to the columns
$[\,Y \;\; \partial (Y \phi) / \partial q\,]$ at the offsets and parameters that were reached, by
weighted least squares [Gautier1997]; friction may differ from run to run as the model says.

What the data identify, the columns themselves show. The first joint's offset turns the robot about
its axis: with that axis along gravity nothing changes. The last joint's turns the last body about
its axis, which its parameters express as well. Such offsets have no column of their own, or a
standard deviation beyond `LOOSEST`; they are left as they are, and named.
"""

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from operator import add
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Z95, Array, finite_json, frozen
from steelyard.base.checked_arguments import checked
from steelyard.base.errors import DataError
from steelyard.base.progress import Progress, silent
from steelyard.estimate.estimate import Estimate, Estimator
from steelyard.estimate.information.base_parameters_and_regressor import Regressor, base_regressor
from steelyard.estimate.information.gather import gather
from steelyard.estimate.information.information import Information
from steelyard.estimate.least_squares.weighted_robust_and_whitened import WeightedLeastSquares
from steelyard.estimate.nonlinear import grid_search
from steelyard.model.model import Model
from steelyard.model.terms.axes_and_fields import finds_of
from steelyard.model.terms.geometry_and_effort_errors import GeometryErrors
from steelyard.model.terms.term import Term
from steelyard.robot.inertia_and_placement import INERTIAL_NAMES
from steelyard.runs.run import Run

FIELD_ROUNDS = 12  # most searches per term where terms are searched one after another
FIELD_TOLERANCE = 3e-3  # relative change of all fields at which such searches have converged


@dataclass(frozen=True)
class Finding:
    """A field's value, as found."""

    term: str  # name of the term
    field: str  # name of the field
    joint: str | None  # name of the coordinate it belongs to; `None` if all share it
    value: float  # in the field's unit
    interval: tuple[float, float]  # of 95 %; ends at the bounds if the data do not end it before
    bounds: tuple[float, float]  # between which it was searched

    @property
    def open_ends(self) -> tuple[bool, bool]:
        """Whether the data leave the lower and the upper end open."""
        return self.interval[0] <= self.bounds[0], self.interval[1] >= self.bounds[1]

    @property
    def identifiable(self) -> bool:
        """Whether the value is identifiable: both ends of the interval lie within the bounds."""
        return not any(self.open_ends)

    @property
    def warning(self) -> str | None:
        """A note where the data do not identify the field."""
        if self.identifiable:
            return None
        low, high = self.interval
        of = f"the {self.field} of term '{self.term}'"
        of += f" at '{self.joint}'" if self.joint else ""
        fix = f"fix it: {self.field} = {self.value:.3g}"
        log = "log slower motion with reversals"
        if all(self.open_ends):
            return (
                f"{of} is not identifiable: any value from {low:.3g} to {high:.3g} fits as well; "
                f"{log}, or {fix}"
            )
        if self.value in self.bounds:
            return f"{of} is estimated at its bound {self.value:.3g}; widen the search, or {fix}"
        side = f"below {high:.3g}" if self.open_ends[0] else f"above {low:.3g}"
        return f"the data bound {of} on one side only: {side}; {log}, or {fix}"


@dataclass(frozen=True, eq=False)
class FoundFields:
    """A model whose fields are all numbers, and every field that was searched."""

    model: Model
    findings: tuple[Finding, ...]

    @property
    def notes(self) -> tuple[str, ...]:
        """One sentence for every field that the data do not identify."""
        return tuple(f.warning for f in self.findings if f.warning is not None)


def information_from(
    runs: Sequence[Run],
    *,
    rests: bool = False,
    longest: float = np.inf,
    threads: int = 1,
    progress: Progress = silent,
) -> grid_search.InformationOf:
    """What runs say, efforts in the joints' units; every call is a pass; options as of `gather`."""

    def information_of(regressor: Regressor) -> Information:
        units = regressor.model.robot.effort_units
        parts = [
            gather(
                regressor, run, rests=rests, longest=longest, threads=threads, progress=progress
            ).scaled(run.recording.signals.gains, units)
            for run in runs
        ]
        return reduce(add, parts)

    return information_of


def find_fields(
    model: Model,
    information_of: grid_search.InformationOf,
    *,
    starts: int = 8,
    seed: int = 0,
    progress: Progress = silent,
) -> FoundFields:
    """Find all fields that stand as `Find` in a model; without any it comes back as it is.

    If all candidates together are too many columns, terms are searched one after another; the
    intervals of one then hold for the values of the others. The search starts from `starts` random
    choices of candidates. A `ModelError` says that a field cannot be found from data.
    """
    unknowns = grid_search.unknowns_of(model)
    logs = {u: float(np.mean(grid_search.bounds_of(u))) for u in unknowns}
    groups = _groups(model, unknowns)
    random = np.random.default_rng(seed)
    findings: dict[grid_search.Unknown, Finding] = {}
    for _ in range(FIELD_ROUNDS if len(groups) > 1 else len(groups)):
        before = dict(logs)
        for group in groups:
            fixed = {
                t: grid_search.with_fields(model, t, logs)
                for t in {u.term for u in unknowns} - set(group)
            }
            mine = tuple(u for u in unknowns if u.term in group)
            shape = grid_search.Search(_with(model, fixed), group, mine)(
                information_of, starts, random, progress
            )
            for k, u in enumerate(mine):
                logs[u] = float(shape.place[k])
                low, high = shape.interval(k)
                findings[u] = Finding(
                    term=model.terms[u.term].law,
                    field=u.field,
                    joint=u.axis,
                    value=grid_search.value_of(u, logs[u]),
                    interval=(grid_search.value_of(u, low), grid_search.value_of(u, high)),
                    bounds=(u.find.lower, u.find.upper),
                )
        if all(abs(logs[u] - before[u]) < FIELD_TOLERANCE for u in unknowns):
            break
    done = _with(model, {u.term: grid_search.with_fields(model, u.term, logs) for u in unknowns})
    return FoundFields(done, tuple(findings[u] for u in unknowns))


def _with(model: Model, terms: Mapping[int, Term]) -> Model:
    return Model(model.robot, tuple(terms.get(k, term) for k, term in enumerate(model.terms)))


def _groups(model: Model, unknowns: Sequence[grid_search.Unknown]) -> list[tuple[int, ...]]:
    """Terms that are searched together, so that no pass gets too wide."""
    groups: list[tuple[int, ...]] = []
    room = 0
    for term in dict.fromkeys(u.term for u in unknowns):
        count = len(finds_of(model.terms[term]))
        width = grid_search.points_of(model, term) ** count * len(
            model.terms[term].parameters(model.robot)
        )
        if groups and width <= room:
            groups[-1] += (term,)
            room -= width
        else:
            groups.append((term,))
            room = grid_search.WIDEST - width
    return groups


@checked(threads=1)
def information(
    model: Model, runs: Sequence[Run], *, threads: int | None = None, progress: Progress = silent
) -> Information:
    """What runs say about the base parameters of a model, in one pass over their samples.

    Args:
        model: The model.
        runs: The runs.
        threads: Native threads; as many as the machine has cores if `None`.
        progress: Receives events of progress; an exception from it stops the work.

    Example:
        >>> info = information(model_of("arm.toml"), load_runs("arm.toml", "fit.csv"))
        >>> info.normal()[0].shape == (len(info.layout.columns),) * 2
        True
    """
    if not runs:
        raise DataError(
            "there is no run", where="list of runs", fix="give those that load_runs returns"
        )
    information_of = information_from(
        runs, rests=model.has_memory, threads=threads or os.cpu_count() or 1, progress=progress
    )
    return information_of(base_regressor(model))


MOST_REFERENCE_REFITS = 3  # most refits of the reference
REFERENCE_TOLERANCE = 1e-3  # relative change of the reference's parameters at which it stands still


def bodies_of(estimate: Estimate) -> dict[str, float]:
    """The estimated numbers of the bodies, by name."""
    found = estimate.parameters.as_dict()
    return {name: x for name, x in found.items() if name.split(".")[0] in INERTIAL_NAMES}


def reference_of(
    model: Model, information_of: grid_search.InformationOf, estimator: Estimator[Information]
) -> dict[str, float]:
    """Bodies fitted without load-dependent friction."""
    terms = tuple(t for t in model.terms if not t.needs_reference)
    return bodies_of(estimator(information_of(base_regressor(replace(model, terms=terms)))))


def converged_reference(
    model: Model, information_of: grid_search.InformationOf, estimator: Estimator[Information]
) -> tuple[Model, bool]:
    """Fit, take the bodies as reference, refit until they stand still; whether they do."""
    reference = reference_of(model, information_of, estimator)
    for _ in range(MOST_REFERENCE_REFITS):
        model = replace(model, terms=tuple(t.with_reference(reference) for t in model.terms))
        found = bodies_of(estimator(information_of(base_regressor(model))))
        names = sorted({*reference, *found})
        a, b = (np.array([some.get(name, 0.0) for name in names]) for some in (reference, found))
        change = float(np.linalg.norm(b - a) / max(float(np.linalg.norm(b)), 1e-300))
        reference = found
        if change < REFERENCE_TOLERANCE:
            return model, True
    return model, False


ROUNDS = 20  # most Gauss-Newton steps
LONGEST = 0.25  # longest step of an offset [rad; m]: derivatives hold for small angles only
LOOSEST = {"rad": 0.1, "m": 0.05}  # standard deviation of what is not identifiable
CONVERGED = 0.02  # step in standard deviations at which the search has converged
LAW = "zero_offset"


@dataclass(frozen=True, eq=False)
class ZeroOffsets:
    """Estimated offsets: joint position = logged position + offset."""

    joints: tuple[str, ...]
    units: tuple[str, ...]  # `rad` or `m` per joint
    values: Array  # shape `(n,)`; of joints that are not identifiable as they were given
    start: Array  # what was given, shape `(n,)`
    std: Array  # their standard deviations, shape `(n,)`; NaN of what was not estimated
    wanted: tuple[bool, ...]  # whether each was to be estimated
    converged: bool

    @property
    def half_width(self) -> Array:
        """Half-width of the 95 % intervals, shape `(n,)`."""
        return Z95 * self.std

    def words(self, chosen: NDArray[np.bool_]) -> str:
        """Chosen offsets with their intervals, like `elbow 0.4992 ± 0.0008 rad`."""
        rows = zip(self.joints, self.values, self.half_width, self.units, chosen, strict=True)
        return ", ".join(
            f"{j} {x:.4f} ± {half:.4f} {unit}" for j, x, half, unit, is_one in rows if is_one
        )

    @property
    def note(self) -> str:
        """Values with their intervals, and what is not identifiable, for people to read."""
        known = np.isfinite(self.std)
        left = ", ".join(
            j
            for j, sure, wanted in zip(self.joints, known, self.wanted, strict=True)
            if wanted > sure
        )
        text = f"zero offsets identified: {self.words(known) or 'none'}"
        if left:
            text += f"; not identifiable from these data, left as given: {left}"
        return text if self.converged else f"{text}; the search did not converge"

    def to_dict(self) -> dict[str, Any]:
        """As JSON values; `half_width` is `None` where an offset was not estimated."""
        names = ("joints", "units", "values", "half_width", "converged")
        return dict(finite_json({name: getattr(self, name) for name in names}))


def with_offsets(runs: Sequence[Run], offsets: Array) -> tuple[Run, ...]:
    """The runs with joint positions that many radians or metres from what was logged."""
    return tuple(run.displaced(offsets) for run in runs)


def find_offsets(
    model: Model,
    information_at: Callable[[Array], grid_search.InformationOf],
    start: Array,
    wanted: Sequence[bool],
) -> ZeroOffsets:
    """Estimate zero offsets of an open chain.

    Those that are not wanted stay at their start, `(n,)`; `information_at` is what the runs say
    about a regressor with offsets `(n,)`.

    Raises:
        DataError: The robot has closed chains.
    """
    if model.robot.passive:
        wrong = "zero offsets of closed chains cannot be estimated"
        fix = "give position_offset = [...] in [signals]"
        raise DataError(wrong, where=f"robot '{model.robot.name}'", fix=fix)
    fit = WeightedLeastSquares(per_run=model.per_run_names)
    values, spread, converged = start.copy(), np.full(len(start), np.nan), False
    bodies = bodies_of(fit(information_at(values.copy())(base_regressor(model))))
    for _ in range(ROUNDS):
        wide = replace(model, terms=(*model.terms, GeometryErrors(reference=tuple(bodies.items()))))
        information = information_at(values.copy())(base_regressor(wide))
        estimate, step, spread = offset_step(information, fit, model, wanted)
        bodies = bodies_of(estimate)
        moved = np.nan_to_num(step)
        values += moved * min(1.0, LONGEST / max(float(np.abs(moved).max()), 1e-300))
        if np.all(np.abs(moved) <= CONVERGED * np.nan_to_num(spread, nan=np.inf)):
            converged = True
            break
    joints, units = model.robot.joint_names, tuple(c.unit for c in model.robot.coordinates)
    arrays = frozen(values), frozen(start), frozen(spread)
    return ZeroOffsets(joints, units, *arrays, tuple(wanted), converged)


def offset_step(
    information: Information, fit: WeightedLeastSquares, model: Model, wanted: Sequence[bool]
) -> tuple[Estimate, Array, Array]:
    """One step: the joint estimate, offsets to add and their standard deviations.

    The information is of the model's columns and those of all offsets. Columns of offsets that the
    data do not identify are taken out one by one, the loosest first.
    """
    joints = model.robot.joint_names
    own = {f"{LAW}.{joint}": k for k, joint in enumerate(joints)}
    left = [name for name, k in own.items() if wanted[k]]
    while True:
        columns = [c for c in information.layout.columns if c not in own or c in left]
        estimate = fit(information.select(columns))
        stds = dict(zip(estimate.parameters.names, estimate.std.tolist(), strict=True))
        loose = {
            name: stds.get(name, np.inf) / LOOSEST[model.robot.coordinates[own[name]].unit]
            for name in left
        }
        worst = max(loose, key=lambda name: loose[name], default=None)
        if worst is None or loose[worst] <= 1.0:
            break
        left.remove(worst)
    known = estimate.parameters.as_dict()
    step, spread = np.full((2, len(joints)), np.nan)
    for name in left:
        step[own[name]], spread[own[name]] = known[name], stds[name]
    return estimate, step, spread
