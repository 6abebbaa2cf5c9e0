"""A full model made smaller along a path of removals, and rules for where that stops."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from math import isfinite
from typing import Any

import numpy as np

from steelyard.base.arrays import Array, frozen, records
from steelyard.base.errors import DataError, ModelError, named
from steelyard.estimate.estimate import Estimate, Estimator, Removed
from steelyard.estimate.information.information import Information, Window
from steelyard.estimate.information.kept_filtered_samples import FilteredSamples
from steelyard.estimate.least_squares.weighted_robust_and_whitened import (
    OrdinaryLeastSquares,
    WeightedLeastSquares,
)
from steelyard.estimate.reduction.backward_elimination_and_left_out_errors import (
    CRITERIA,
    RISE,
    Criterion,
    FullModel,
    LeftOutErrors,
    Path,
    State,
    backward,
    left_out_errors,
    path_errors,
)

WHERE = "stopping rule of the reduction"

Choice = Callable[[Path, LeftOutErrors | None], int]


@dataclass(frozen=True)
class StoppingRule:
    """Where a path ends, and which of its models is taken."""

    name: str  # short name, as options know it
    choose: Choice  # place of the model that is taken; a `DataError` says that none is as wanted
    needs_left_out: bool = False  # whether it looks at errors on left-out data
    tolerance: float = RISE  # rise of a joint's left-out error from which the report names it
    bounded: bool = False  # whether no error of a joint may rise by more than that along the path
    # samples whose mean absolute residuals are the errors; root mean squares of all if `None`
    samples: FilteredSamples | None = None

    @property
    def measure(self) -> str:
        """Which errors of the joints it looks at."""
        return "rms" if self.samples is None else "mean_absolute"

    def accepts(self, full: State, smaller: State) -> bool:
        """Whether a model may be one of the path; else the parameter it lost is essential."""
        if not self.bounded:
            return True
        return bool(np.all(self.errors(smaller) <= (1.0 + self.tolerance) * self.errors(full)))

    def errors(self, state: State) -> Array:
        r"""Error of each effort row on the fitted motion, shape `(rows,)` [Nm; N].

        Mean absolute ones are $\frac{1}{N} \sum |y - A \hat\theta|$ [Volkmann], eq. 11.
        """
        if self.samples is None:
            return state.rms
        columns = self.samples.layout.columns
        values = np.zeros(len(columns))
        values[[columns.index(name) for name in state.names]] = state.values
        rests = self.samples.residuals(values)
        return np.array([np.abs(e).mean() if len(e) else 0.0 for e in rests])

    def during(self, windows: Sequence[Window]) -> "StoppingRule":
        """The rule for a part of the data."""
        samples = None if self.samples is None else self.samples.during(windows)
        return replace(self, samples=samples)


def _one_standard_error(path: Path, left_out: LeftOutErrors | None) -> int:
    """The smallest model whose left-out error is within one standard error of the least.

    No joint's left-out error may rise by more than `RISE`: the error of all joints can hide one,
    and a standard error of two folds can be as large as any rise.
    """
    if left_out is None:
        raise ValueError("errors on left-out data are needed")
    fit = np.array([not left_out.worse(size, RISE) for size in left_out.sizes])
    least = left_out.rise[fit].min()
    near = np.flatnonzero(fit & (left_out.rise <= np.maximum(left_out.spread, least)))
    sizes = {left_out.sizes[k] for k in near} & set(path.sizes)
    if not sizes:
        wrong = "paths of the folds end before a model of the whole data is reached"
        fix = "keep fewer parameters, or take another stopping rule"
        raise DataError(wrong, where=WHERE, fix=fix)
    return path.sizes.index(min(sizes))


def within_tolerance(
    tolerance: float = RISE, samples: FilteredSamples | None = None
) -> StoppingRule:
    r"""Every joint's error stays within a tolerance, above zero, of the full model's [Volkmann].

    $e_{k,j} \le (1 + e_\mathrm{tol})\, e_{0,j}$ for every joint $j$, as the text of the paper says
    (line 10 of its algorithm 1 refuses a removal only if all joints exceed it). The error is the
    root mean square of the residuals; the relative error (eq. 12) has the same ratio. It holds on
    the fitted motion along the path and, where there is any, for each joint's error on left-out
    motion too. With samples it is algorithm 1 as it is printed: their mean absolute errors, of the
    fitted motion alone.
    """

    def choose(path: Path, left_out: LeftOutErrors | None) -> int:
        if samples is not None:
            return len(path.steps)
        sizes = path.sizes if left_out is None else left_out.sizes
        fit = [n for n in sizes if left_out is None or not left_out.worse(n, tolerance)]
        return max((path.sizes.index(n) for n in fit if n in path.sizes), default=0)

    return StoppingRule("tolerance", choose, tolerance=tolerance, bounded=True, samples=samples)


def _least_bic(path: Path, left_out: LeftOutErrors | None) -> int:
    r"""The least $\chi^2 + k \ln N$, residuals and samples counted by their correlation."""
    factors = np.maximum(path.full.factors, 1.0)
    samples = float(np.sum(path.full.information.n_samples / factors))
    costs = [s.chi_square + len(s.active) * np.log(samples) for s in path.states]
    return int(np.argmin(costs))


def _first_within(
    name: str, figure: str, figure_of: Callable[[State], float], limit: float
) -> StoppingRule:
    """The first model of which a figure is at most `limit`."""

    def choose(path: Path, left_out: LeftOutErrors | None) -> int:
        values = np.array([figure_of(state) for state in path.states])
        if not (values <= limit).any():
            wrong = f"no model has a {figure} of {limit:g} or less: the least is {values.min():.3g}"
            fix = "allow a larger one, keep fewer parameters, or log a motion that excites more"
            raise DataError(wrong, where=WHERE, fix=fix)
        return int(np.argmax(values <= limit))

    return StoppingRule(name, choose)


def condition_limit(limit: float = 30.0) -> StoppingRule:
    """The first model with a small enough condition number of unit weighted columns [Wang]."""
    return _first_within("condition", "condition number", lambda state: state.condition, limit)


def deviation_ratio(limit: float = 30.0) -> StoppingRule:
    """The first model whose relative standard deviations lie close enough together [Pham1991]."""

    def ratio(state: State) -> float:
        return float(state.ratios.max() / max(state.ratios.min(), 1e-300))

    return _first_within("ratio", "ratio of relative deviations", ratio, limit)


def count(parameters: float) -> StoppingRule:
    """The model with a number of parameters."""

    def choose(path: Path, left_out: LeftOutErrors | None) -> int:
        if parameters not in path.sizes:
            fix = f"give {path.sizes[0]}, or keep fewer parameters"
            if path.steps:
                fix = f"give a number from {path.sizes[-1]} to {path.sizes[0]}"
            raise DataError(f"no model has {parameters:.12g} parameters", where=WHERE, fix=fix)
        return path.sizes.index(int(parameters))

    return StoppingRule("count", choose)


def _one_fewer(path: Path, left_out: LeftOutErrors | None) -> int:
    """The model without one more parameter: one round of [Wang]."""
    if not path.steps:
        one = len(path.states[0].active) == 1
        fix = "use this model: it has one parameter" if one else "keep fewer parameters"
        raise DataError("no parameter is left that could be removed", where=WHERE, fix=fix)
    return 1


ONE_STANDARD_ERROR = StoppingRule("one_standard_error", _one_standard_error, needs_left_out=True)

RULES: dict[str, StoppingRule | Callable[..., StoppingRule]] = {
    "one_standard_error": ONE_STANDARD_ERROR,
    "tolerance": lambda percent=100.0 * RISE: within_tolerance(0.01 * percent),
    "bic": StoppingRule("bic", _least_bic),
    "condition": condition_limit,
    "ratio": deviation_ratio,
    "count": count,
    "one_fewer": StoppingRule("one_fewer", _one_fewer),
    # the model as it is: the parameters that are left are estimated from other data
    "refit": StoppingRule("refit", lambda path, left_out: 0),
}
"""Stopping rules, or how each is made from the number behind its name."""


def rule_of(text: str) -> StoppingRule:
    """The stopping rule of a text such as `bic` or `tolerance=5`."""
    name, equals, number = text.partition("=")
    make = named(name, RULES, "stopping rule", "stopping rules", "--stop")
    if isinstance(make, StoppingRule):
        if equals:
            wrong = f"stopping rule '{name}' takes no number"
            raise ModelError(wrong, where="--stop", fix=f"--stop {name}")
        return make
    whole = make is count
    if not equals and not whole:
        return make()
    try:
        value = float(number)
    except ValueError:
        value = float("nan")
    if not isfinite(value) or not value > 0.0 or (whole and value % 1.0):
        raise ModelError(
            f"'{number}' is no number that stopping rule '{name}' can use",
            where=f"--stop {text}",
            fix="give a whole number, such as count=25"
            if whole
            else f"give a number above zero, such as {name}=5",
        )
    return make(value)


def criterion_of(name: str) -> Criterion:
    """The criterion of a name."""
    known = {criterion.name: criterion for criterion in CRITERIA}
    return named(name, known, "criterion", "criteria", "--criterion")


@dataclass(frozen=True, eq=False)
class Reduction:
    """A reduced model, and the path it lies on."""

    path: Path
    criterion: Criterion  # what chose the parameters to remove
    chosen: int  # place of the one that was taken
    # errors on left-out data; `None` where there are too few windows for them
    left_out: LeftOutErrors | None
    estimate: Estimate  # its values and their covariance, given the choice
    # errors of all models on other data, `(states, rows)` [%]; `None` without
    unseen: Array | None = None
    rule: StoppingRule = ONE_STANDARD_ERROR  # what it was chosen by
    # errors of the full model, of the reduced one and of none (the effort itself) on the fitted
    # motion, shape `(3, rows)` [Nm; N]
    fitted: Array = field(default_factory=lambda: np.zeros((3, 0)))

    @property
    def state(self) -> State:
        """The model that was taken."""
        return self.path.states[self.chosen]

    def worth(self) -> list[dict[str, Any]]:
        """The criterion's value of every parameter; what was removed first, then from least on.

        Each row has the `name`, the `step` that removed it (`None` if it is left), its value in the
        model `before` any removal of this reduction, and the `last` one: before its own removal, or
        in the model that was taken. `None` where there is no value.
        """
        whole = State(self.path.full, tuple(range(len(self.path.full.names))))
        at_first, at_last = (
            dict(zip(state.names, self.criterion.worth(state).tolist(), strict=True))
            for state in (whole, self.state)
        )
        removed = [
            (one.name, one.step, one.worth if one.criterion == self.criterion.name else None)
            for one in self.estimate.removed
        ]
        left = [(name, None, at_last[name]) for name in sorted(at_last, key=at_last.__getitem__)]
        return [
            {"name": name, "step": step, "before": at_first.get(name), "last": last}
            for name, step, last in (*removed, *left)
        ]

    def joint_errors(self) -> list[dict[str, Any]]:
        """Errors of each joint on the fitted motion, as the stopping rule measures them.

        Each row has the `joint`, `unit`, error of the `full` and of the `reduced` model in that
        unit, and both relative to the effort in percent, `full_percent` and `reduced_percent`
        ([Volkmann], eqs. 11 and 12, if the measure is `mean_absolute`).
        """
        information = self.path.full.information
        percent = 100.0 * self.fitted[:2] / np.maximum(self.fitted[2], 1e-300)
        return records(
            joint=information.layout.rows,
            unit=information.signature.effort,
            full=self.fitted[0],
            full_percent=percent[0],
            reduced=self.fitted[1],
            reduced_percent=percent[1],
        )

    def after(self, before: Sequence[Removed]) -> "Reduction":
        """The reduction of a model that was reduced before: earlier removals are listed first."""
        later = (replace(one, step=len(before) + one.step) for one in self.estimate.removed)
        return replace(self, estimate=replace(self.estimate, removed=(*before, *later)))


def reduce(
    information: Information,
    criterion: Criterion = CRITERIA[0],
    rule: StoppingRule = ONE_STANDARD_ERROR,
    *,
    keep: Sequence[str] = (),
    drop: Sequence[str] = (),
    unseen: Information | None = None,
    equal: bool = False,
) -> Reduction:
    """Remove parameters one by one, and take the model that the stopping rule chooses.

    The data are in the base columns of the full model. Parameters to keep stay, those to drop are
    removed first, and in any case. On `unseen` data the models are scored and nothing is chosen.
    With `equal` all rows weigh the same, as [Wang] has it (eqs. 5 and 12). A `DataError` says that
    the data show no parameter, or that no model is as the rule wants it.
    """
    follow = partial(backward, criterion=criterion, keep=keep, drop=drop)

    def part(full: FullModel) -> Path:
        return follow(full, accepts=rule.during(full.information.windows).accepts)

    full = FullModel.of(information, equal=equal)
    left_out: LeftOutErrors | None = None
    try:
        left_out = left_out_errors(information, part, equal=equal)
    except DataError:
        if rule.needs_left_out:
            raise
    path = follow(full, accepts=rule.accepts)
    place = rule.choose(path, left_out)
    errors = None if unseen is None else frozen(path_errors(path, unseen)[0])
    whole, state = State(full, tuple(range(len(full.names)))), path.states[place]
    # what the model lacks or is dropped unseen is known to be zero
    hidden = (Removed(one.name, 0, 0.0, criterion.name) for one in full.blind if one.name in drop)
    steps = (*path.requested, *hidden, *path.steps[:place])
    estimate = least_squares(equal)(full.information.select(state.names))
    estimate = replace(
        estimate,
        estimator=f"reduced {estimate.estimator} ({len(full.names)} to {len(state.active)})",
        blind=tuple(one for one in full.blind if one.name not in drop),
        removed=tuple(replace(one, step=number) for number, one in enumerate(steps, start=1)),
    )
    fitted = [rule.errors(one) for one in (whole, state, State(full, ()))]
    return Reduction(
        path,
        criterion,
        place,
        left_out,
        estimate,
        errors,
        rule,
        frozen(np.array(fitted)),
    )


def reduced(information: Information) -> Estimate:
    """An estimator of the parameters that left-out data need, by the default criterion and rule."""
    return reduce(information).estimate


def least_squares(equal: bool) -> Estimator[Information]:
    """Least squares with rows weighted alike, or by their noise."""
    return OrdinaryLeastSquares() if equal else WeightedLeastSquares()
