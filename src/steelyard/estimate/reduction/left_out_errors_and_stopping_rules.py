"""Rules for when a reduction stops, and the errors of its models on left-out data.

Per fold the whole path is made again from the other folds: a parameter that was removed because
the left-out fold does not need it would make that fold's error too small [Hastie2009].
"""

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import isfinite
from typing import ClassVar

import numpy as np

from steelyard.base.arrays import Array, frozen
from steelyard.base.errors import DataError, ModelError, named
from steelyard.estimate.information.information import Information, Window
from steelyard.estimate.information.kept_filtered_samples import FilteredSamples
from steelyard.estimate.reduction.backward_elimination import FullModel, Path, State
from steelyard.estimate.scores.cross_validation import (
    FEWEST,
    logarithms,
    standard_error,
    too_short,
    windows_of_folds,
)

PathOf = Callable[[FullModel], Path]  # the path of a full model


@dataclass(frozen=True, eq=False)
class LeftOutErrors:
    """Errors on left-out folds by the number of parameters."""

    sizes: tuple[int, ...]
    errors: Array  # relative error of each fold and effort row, `(folds, sizes, rows)` [%]
    # one value per fold and size: the mean of the logarithms of a typical row's error and of that
    # of all rows together, `(folds, sizes)`
    logarithms: Array
    # how many folds had removed a parameter before the smallest model, by name and size
    removed: tuple[Counter[str], ...]
    folds: tuple[str, ...]  # what was left out in turn

    @property
    def mean(self) -> Array:
        """Mean over folds and rows per size, shape `(sizes,)` [%]."""
        return np.asarray(self.errors.mean(axis=(0, 2)))

    @property
    def best(self) -> int:
        """Place of the size with the least error."""
        return int(np.argmin(self.logarithms.mean(axis=0)))

    @property
    def spread(self) -> Array:
        """Standard error over folds of the difference to the best size, shape `(sizes,)`.

        Of logarithms; folds differ far more from each other than sizes do within a fold, so the
        differences are what tells sizes apart.
        """
        apart = self.logarithms - self.logarithms[:, [self.best]]
        return np.array([standard_error(column) for column in apart.T])

    @property
    def rise(self) -> Array:
        """Mean difference of the logarithms to those of the best size, shape `(sizes,)`."""
        means = self.logarithms.mean(axis=0)
        return np.asarray(means - means[self.best])

    @property
    def joint_rise(self) -> Array:
        """Relative rise of each row's error to the largest model's, shape `(sizes, rows)`.

        Geometric means over folds, so that a joint with hardly any effort in a fold does not hide
        what becomes worse in the others.
        """
        means = np.log(np.maximum(self.errors, 1e-9)).mean(axis=0)
        return np.asarray(np.expm1(means - means[0]))

    def worse(self, size: int, tolerance: float) -> tuple[tuple[int, float], ...]:
        """Rows whose error rises by more than the tolerance, and by how much, at a size."""
        rises = self.joint_rise[self.sizes.index(size)] if size in self.sizes else ()
        return tuple((k, float(rise)) for k, rise in enumerate(rises) if rise > tolerance)


RISE = 0.05  # relative rise of a joint's left-out error that a removal may cost by default


def folds_of(information: Information) -> tuple[tuple[str, tuple[int, ...]], ...]:
    """Windows of every run or, where there is one run, of stretches of it, with their names."""
    windows, parts = information.windows, windows_of_folds(information)
    if len(parts) < FEWEST:
        fix = "log longer or several runs, or reduce to a number of parameters"
        raise too_short(information.runs or "no run", fix)
    if len(information.windows_of_runs) > 1:
        return tuple((windows[part[0]].run, part) for part in parts)
    names = (f"{windows[p[0]].start:.3g} to {windows[p[-1]].stop:.3g} s" for p in parts)
    return tuple(zip(names, parts, strict=True))


def left_out_errors(
    information: Information, path_of: PathOf, *, equal: bool = False
) -> LeftOutErrors:
    """Errors of the models of a path, each fold predicted by a path of the others."""
    folds = folds_of(information)
    results = []
    for _name, mine in folds:
        others = [k for k in range(len(information.windows)) if k not in set(mine)]
        path = path_of(FullModel.of(information.of(others), equal=equal))
        results.append((path, path_errors(path, information.of(mine))))
    shared = set.intersection(*(set(path.sizes) for path, _ in results))
    sizes = tuple(sorted(shared, reverse=True))
    errors, logs, removed = [], [], [Counter[str]() for _ in sizes]
    for path, (found, squares) in results:
        at = [path.sizes.index(size) for size in sizes]
        errors.append(found[at])
        logs.append(logarithms(found[at], np.tile(squares, (len(at), 1))))
        for place, count in zip(at, removed, strict=True):
            count.update(step.name for step in path.steps[:place])
    return LeftOutErrors(
        sizes,
        frozen(np.stack(errors)),
        frozen(np.stack(logs)),
        tuple(removed),
        tuple(name for name, _ in folds),
    )


def path_errors(path: Path, tested: Information) -> tuple[Array, Array]:
    """Relative errors of a path's models on other data `(states, rows)` [%]; efforts' squares."""
    squares = tested.effort_squares()
    size = np.where(squares > 0.0, squares, np.inf)
    place = [tested.layout.columns.index(name) for name in path.full.names]
    errors = np.empty((len(path.states), len(squares)))
    for k, state in enumerate(path.states):
        values = np.zeros(len(tested.layout.columns))
        values[place] = state.all_values
        errors[k] = 100.0 * np.sqrt(tested.residual_squares(values) / size)
    return errors, squares


WHERE = "stopping rule of the reduction"


class StoppingRule(ABC):
    """Where a path ends, and which of its models is taken."""

    name: ClassVar[str]  # short name, as options know it
    needs_left_out: ClassVar[bool] = False  # whether it looks at errors on left-out data
    tolerance: float = RISE  # rise of a joint's left-out error from which the report names it

    measure: ClassVar[str] = "rms"

    def accepts(self, full: State, smaller: State) -> bool:
        """Whether a model may be one of the path; else the parameter it lost is essential."""
        return True

    def errors(self, state: State) -> Array:
        """Error of each effort row on the fitted motion, shape `(rows,)` [Nm; N]."""
        return state.rms

    def during(self, windows: Sequence[Window]) -> "StoppingRule":
        """The rule for a part of the data."""
        return self

    @abstractmethod
    def choose(self, path: Path, left_out: LeftOutErrors | None) -> int:
        """Place of the model that is taken; a `DataError` says that none is as wanted."""


@dataclass(frozen=True)
class OneStandardError(StoppingRule):
    """The smallest model whose left-out error is within one standard error of the least.

    No joint's left-out error may rise by more than the tolerance: the error of all joints can hide
    one, and a standard error of two folds can be as large as any rise.
    """

    name: ClassVar[str] = "one_standard_error"
    needs_left_out: ClassVar[bool] = True

    def choose(self, path: Path, left_out: LeftOutErrors | None) -> int:
        """See `StoppingRule`."""
        if left_out is None:
            raise ValueError("errors on left-out data are needed")
        fit = np.array([not left_out.worse(size, self.tolerance) for size in left_out.sizes])
        least = left_out.rise[fit].min()
        near = np.flatnonzero(fit & (left_out.rise <= np.maximum(left_out.spread, least)))
        sizes = {left_out.sizes[k] for k in near} & set(path.sizes)
        if not sizes:
            wrong = "paths of the folds end before a model of the whole data is reached"
            fix = "keep fewer parameters, or take another stopping rule"
            raise DataError(wrong, where=WHERE, fix=fix)
        return path.sizes.index(min(sizes))


@dataclass(frozen=True)
class Tolerance(StoppingRule):
    r"""Every joint's error stays within a tolerance of the full model's [Volkmann].

    $e_{k,j} \le (1 + e_\mathrm{tol})\, e_{0,j}$ for every joint $j$, as the text of the paper says
    (line 10 of its algorithm 1 refuses a removal only if all joints exceed it). The error is the
    root mean square of the residuals; the relative error (eq. 12) has the same ratio. It holds on
    the fitted motion along the path and, where there is any, for each joint's error on left-out
    motion too.
    """

    name: ClassVar[str] = "tolerance"

    tolerance: float = RISE  # $e_\mathrm{tol}$, above zero

    def __post_init__(self) -> None:
        if not self.tolerance > 0.0:
            raise ModelError(
                f"the tolerance is {100.0 * self.tolerance:g} %",
                where=WHERE,
                fix="give a percentage above zero, such as tolerance=5",
            )

    def accepts(self, full: State, smaller: State) -> bool:
        """Whether no joint's error grows by more than the tolerance."""
        allowed = (1.0 + self.tolerance) * self.errors(full)
        return bool(np.all(self.errors(smaller) <= allowed))

    def choose(self, path: Path, left_out: LeftOutErrors | None) -> int:
        """The last one that left-out motion, if there is any, does not refuse for some joint."""
        sizes = path.sizes if left_out is None else left_out.sizes
        fit = [n for n in sizes if left_out is None or not left_out.worse(n, self.tolerance)]
        return max((path.sizes.index(n) for n in fit if n in path.sizes), default=0)


@dataclass(frozen=True, kw_only=True)
class MeanAbsoluteTolerance(Tolerance):
    """Algorithm 1 of [Volkmann] as it is printed: mean absolute errors of the fitted motion."""

    measure: ClassVar[str] = "mean_absolute"

    samples: FilteredSamples  # those whose residuals count

    def errors(self, state: State) -> Array:
        """See `StoppingRule`."""
        return mean_absolute_errors(self.samples, state)

    def during(self, windows: Sequence[Window]) -> "MeanAbsoluteTolerance":
        """See `StoppingRule`."""
        return replace(self, samples=self.samples.during(windows))

    def choose(self, path: Path, left_out: LeftOutErrors | None) -> int:
        """The last one."""
        return len(path.steps)


def mean_absolute_errors(samples: FilteredSamples, state: State) -> Array:
    r"""$\frac{1}{N} \sum |y - A \hat\theta|$ per effort row, `(rows,)` [Volkmann], eq. 11."""
    columns = samples.layout.columns
    values = np.zeros(len(columns))
    values[[columns.index(name) for name in state.names]] = state.values
    return np.array([np.abs(e).mean() if len(e) else 0.0 for e in samples.residuals(values)])


@dataclass(frozen=True)
class Bic(StoppingRule):
    r"""The least $\chi^2 + k \ln N$, residuals and samples counted by their correlation."""

    name: ClassVar[str] = "bic"

    def choose(self, path: Path, left_out: LeftOutErrors | None) -> int:
        """See `StoppingRule`."""
        factors = np.maximum(path.full.factors, 1.0)
        samples = float(np.sum(path.full.information.n_samples / factors))
        costs = [s.chi_square + len(s.active) * np.log(samples) for s in path.states]
        return int(np.argmin(costs))


@dataclass(frozen=True)
class _FirstWithin(StoppingRule):
    """The first model of which a figure is at most `limit`."""

    figure: ClassVar[str]
    limit: float = 30.0

    @abstractmethod
    def figure_of(self, state: State) -> float:
        """The figure of a model."""

    def choose(self, path: Path, left_out: LeftOutErrors | None) -> int:
        """See `StoppingRule`."""
        values = np.array([self.figure_of(state) for state in path.states])
        if not (values <= self.limit).any():
            raise DataError(
                f"no model has a {self.figure} of {self.limit:g} or less: the least is "
                f"{values.min():.3g}",
                where=WHERE,
                fix="allow a larger one, keep fewer parameters, or log a motion that excites more",
            )
        return int(np.argmax(values <= self.limit))


@dataclass(frozen=True)
class ConditionLimit(_FirstWithin):
    """The first model with a small enough condition number of unit weighted columns [Wang]."""

    name: ClassVar[str] = "condition"
    figure: ClassVar[str] = "condition number"

    def figure_of(self, state: State) -> float:
        """The condition number."""
        return state.condition


@dataclass(frozen=True)
class DeviationRatio(_FirstWithin):
    """The first model whose relative standard deviations lie close enough together [Pham1991]."""

    name: ClassVar[str] = "ratio"
    figure: ClassVar[str] = "ratio of relative deviations"

    def figure_of(self, state: State) -> float:
        """The greatest relative standard deviation over the least."""
        return float(state.ratios.max() / max(state.ratios.min(), 1e-300))


@dataclass(frozen=True)
class Count(StoppingRule):
    """The model with a number of parameters."""

    name: ClassVar[str] = "count"

    parameters: int

    def choose(self, path: Path, left_out: LeftOutErrors | None) -> int:
        """See `StoppingRule`."""
        if self.parameters not in path.sizes:
            fix = f"give {path.sizes[0]}, or keep fewer parameters"
            if path.steps:
                fix = f"give a number from {path.sizes[-1]} to {path.sizes[0]}"
            raise DataError(f"no model has {self.parameters} parameters", where=WHERE, fix=fix)
        return path.sizes.index(self.parameters)


@dataclass(frozen=True)
class OneFewer(StoppingRule):
    """The model without one more parameter: one round of [Wang]."""

    name: ClassVar[str] = "one_fewer"

    def choose(self, path: Path, left_out: LeftOutErrors | None) -> int:
        """See `StoppingRule`."""
        if not path.steps:
            one = len(path.states[0].active) == 1
            fix = "use this model: it has one parameter" if one else "keep fewer parameters"
            raise DataError("no parameter is left that could be removed", where=WHERE, fix=fix)
        return 1


@dataclass(frozen=True)
class Refit(StoppingRule):
    """The model as it is: the parameters that are left are estimated from other data."""

    name: ClassVar[str] = "refit"

    def choose(self, path: Path, left_out: LeftOutErrors | None) -> int:
        """See `StoppingRule`."""
        return 0


RULES: dict[type[StoppingRule], Callable[[float], StoppingRule] | None] = {
    OneStandardError: None,
    Tolerance: lambda percent: Tolerance(0.01 * percent),
    Bic: None,
    ConditionLimit: ConditionLimit,
    DeviationRatio: DeviationRatio,
    Count: lambda parameters: Count(int(parameters)),
    OneFewer: None,
    Refit: None,
}
"""Stopping rules, and how each is made from the number behind its name, if it takes one."""


def rule_of(text: str) -> StoppingRule:
    """The stopping rule of a text such as `bic` or `tolerance=5`."""
    name, equals, number = text.partition("=")
    known = {rule.name: rule for rule in RULES}
    kind = named(name, known, "stopping rule", "stopping rules", "--stop")
    make = RULES[kind]
    if make is None and equals:
        raise ModelError(
            f"stopping rule '{name}' takes no number", where="--stop", fix=f"--stop {name}"
        )
    if not equals and kind is not Count:
        return kind()
    try:
        value = float(number)
    except ValueError:
        value = float("nan")
    if make is None or not isfinite(value) or not value > 0.0 or (kind is Count and value % 1.0):
        whole = "give a whole number, such as count=25"
        raise ModelError(
            f"'{number}' is no number that stopping rule '{name}' can use",
            where=f"--stop {text}",
            fix=whole if kind is Count else f"give a number above zero, such as {name}=5",
        )
    return make(value)
