"""A full model made smaller along a path of removals."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from steelyard.base.arrays import Array, frozen
from steelyard.base.errors import DataError, named
from steelyard.estimate.estimate import Estimate, Estimator, Removed
from steelyard.estimate.information.information import Information
from steelyard.estimate.least_squares.weighted_robust_and_whitened import (
    OrdinaryLeastSquares,
    WeightedLeastSquares,
)
from steelyard.estimate.reduction.backward_elimination import (
    CRITERIA,
    Criterion,
    FullModel,
    Path,
    State,
    backward,
)
from steelyard.estimate.reduction.left_out_errors_and_stopping_rules import (
    RISE,
    LeftOutErrors,
    OneStandardError,
    StoppingRule,
    left_out_errors,
    path_errors,
)


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
    tolerance: float = RISE  # relative rise of a joint's error from which it is named
    measure: str = StoppingRule.measure  # which errors of the joints these are
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
        pairs = zip(information.layout.rows, information.signature.effort, strict=True)
        return [
            {
                "joint": joint,
                "unit": unit,
                "full": float(self.fitted[0, k]),
                "full_percent": float(percent[0, k]),
                "reduced": float(self.fitted[1, k]),
                "reduced_percent": float(percent[1, k]),
            }
            for k, (joint, unit) in enumerate(pairs)
        ]

    def after(self, before: Sequence[Removed]) -> "Reduction":
        """The reduction of a model that was reduced before: earlier removals are listed first."""
        later = (replace(one, step=len(before) + one.step) for one in self.estimate.removed)
        return replace(self, estimate=replace(self.estimate, removed=(*before, *later)))


def reduce(
    information: Information,
    criterion: Criterion = CRITERIA[0],
    rule: StoppingRule | None = None,
    *,
    keep: Sequence[str] = (),
    drop: Sequence[str] = (),
    unseen: Information | None = None,
    equal: bool = False,
) -> Reduction:
    """Remove parameters one by one, and take the model that the stopping rule chooses.

    The data are in the base columns of the full model; `OneStandardError` is the rule if there is
    none. Parameters to keep stay, those to drop are removed first, and in any case. On `unseen`
    data the models are scored and nothing is chosen. With `equal` all rows weigh the same, as
    [Wang] has it (eqs. 5 and 12). A `DataError` says that the data show no
    parameter, or that no model is as the rule wants it.
    """
    rule = OneStandardError() if rule is None else rule
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
        rule.tolerance,
        rule.measure,
        frozen(np.array(fitted)),
    )


def reduced(information: Information) -> Estimate:
    """An estimator of the parameters that left-out data need, by the default criterion and rule."""
    return reduce(information).estimate


def least_squares(equal: bool) -> Estimator[Information]:
    """Least squares with rows weighted alike, or by their noise."""
    return OrdinaryLeastSquares() if equal else WeightedLeastSquares()
