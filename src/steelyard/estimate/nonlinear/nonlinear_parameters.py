r"""Fields of terms found from data, and the reference model of load-dependent friction.

Candidates on a logarithmic grid enter one wide pass as a dictionary of columns. The search selects
sub-Grams: weighted least squares per choice, coordinate descent over the fields from several
starts, on the criterion $\sum_j n_j \log \sigma_j^2$ of the rows' residual variances (minus twice
the log likelihood). Further passes take the grid finer around the best choice and keep it wide
elsewhere; a quadratic through the last one gives the values, and the rise of the weighted squares
by 3.84 their 95 % intervals.
"""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from operator import add
from typing import Any

import numpy as np

from steelyard.base.arguments import checked
from steelyard.base.arrays import json_values
from steelyard.base.errors import DataError
from steelyard.base.progress import Progress, silent
from steelyard.estimate.estimate import Estimate, Estimator
from steelyard.estimate.friction.friction_mixes import has_memory
from steelyard.estimate.information.gather import gather
from steelyard.estimate.information.information import Information
from steelyard.estimate.information.regressor import Regressor, base_regressor
from steelyard.estimate.nonlinear.grid_search import (
    WIDEST,
    InformationOf,
    Search,
    Unknown,
    bounds_of,
    points_of,
    unknowns_of,
    value_of,
    with_fields,
)
from steelyard.model.model import Model
from steelyard.model.terms.axes import finds_of
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

    def to_dict(self) -> dict[str, Any]:
        """As JSON values."""
        return dict(json_values(self))

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
) -> InformationOf:
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
    information_of: InformationOf,
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
    unknowns = unknowns_of(model)
    logs = {u: float(np.mean(bounds_of(u))) for u in unknowns}
    groups = _groups(model, unknowns)
    random = np.random.default_rng(seed)
    findings: dict[Unknown, Finding] = {}
    for _ in range(FIELD_ROUNDS if len(groups) > 1 else len(groups)):
        before = dict(logs)
        for group in groups:
            fixed = {
                t: with_fields(model, t, logs) for t in {u.term for u in unknowns} - set(group)
            }
            mine = tuple(u for u in unknowns if u.term in group)
            shape = Search(_with(model, fixed), group, mine)(
                information_of, starts, random, progress
            )
            for k, u in enumerate(mine):
                logs[u] = float(shape.place[k])
                low, high = shape.interval(k)
                findings[u] = Finding(
                    term=model.terms[u.term].law,
                    field=u.field,
                    joint=u.axis,
                    value=value_of(u, logs[u]),
                    interval=(value_of(u, low), value_of(u, high)),
                    bounds=(u.find.lower, u.find.upper),
                )
        if all(abs(logs[u] - before[u]) < FIELD_TOLERANCE for u in unknowns):
            break
    done = _with(model, {u.term: with_fields(model, u.term, logs) for u in unknowns})
    return FoundFields(done, tuple(findings[u] for u in unknowns))


def _with(model: Model, terms: Mapping[int, Term]) -> Model:
    return Model(model.robot, tuple(terms.get(k, term) for k, term in enumerate(model.terms)))


def _groups(model: Model, unknowns: Sequence[Unknown]) -> list[tuple[int, ...]]:
    """Terms that are searched together, so that no pass gets too wide."""
    groups: list[tuple[int, ...]] = []
    room = 0
    for term in dict.fromkeys(u.term for u in unknowns):
        count = len(finds_of(model.terms[term]))
        width = points_of(model, term) ** count * len(model.terms[term].parameters(model.robot))
        if groups and width <= room:
            groups[-1] += (term,)
            room -= width
        else:
            groups.append((term,))
            room = WIDEST - width
    return groups


@checked(threads=1)
def information(
    model: Model,
    runs: Sequence[Run],
    *,
    threads: int | None = None,
    progress: Progress = silent,
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
    cores = threads or os.cpu_count() or 1
    information_of = information_from(
        runs, rests=has_memory(model.terms), threads=cores, progress=progress
    )
    return information_of(base_regressor(model))


MOST_REFERENCE_REFITS = 3  # most refits of the reference
REFERENCE_TOLERANCE = 1e-3  # relative change of the reference's parameters at which it stands still


def bodies_of(estimate: Estimate) -> dict[str, float]:
    """The estimated numbers of the bodies, by name."""
    found = estimate.parameters.as_dict()
    return {name: x for name, x in found.items() if name.split(".")[0] in INERTIAL_NAMES}


def reference_of(
    model: Model, information_of: InformationOf, estimator: Estimator[Information]
) -> dict[str, float]:
    """Bodies fitted without load-dependent friction."""
    terms = tuple(t for t in model.terms if not t.needs_reference)
    return bodies_of(estimator(information_of(base_regressor(replace(model, terms=terms)))))


def with_references(model: Model, reference: Mapping[str, float]) -> Model:
    """The model with a reference in every term that needs one."""
    return replace(model, terms=tuple(term.with_reference(reference) for term in model.terms))


def needs_reference(model: Model) -> bool:
    """Whether a term's load comes from a reference model."""
    return any(term.needs_reference for term in model.terms)


def converged_reference(
    model: Model, information_of: InformationOf, estimator: Estimator[Information]
) -> tuple[Model, bool]:
    """Fit, take the bodies as reference, refit until they stand still; whether they do."""
    reference = reference_of(model, information_of, estimator)
    for _ in range(MOST_REFERENCE_REFITS):
        model = with_references(model, reference)
        found = bodies_of(estimator(information_of(base_regressor(model))))
        names = sorted({*reference, *found})
        a, b = (np.array([some.get(name, 0.0) for name in names]) for some in (reference, found))
        change = float(np.linalg.norm(b - a) / max(float(np.linalg.norm(b)), 1e-300))
        reference = found
        if change < REFERENCE_TOLERANCE:
            return model, True
    return model, False
