"""Identified models side by side: errors on the same logs, and parameters in a common set."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import ModelError
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.estimate.scores.effort_errors import (
    BandErrors,
    EffortError,
    band_of,
    effort_reference,
    known_efforts,
    of_joints,
    pooled,
)
from steelyard.estimate.scores.score import score
from steelyard.runs.run import Run

SAME = 1e-6
"""Part of a base parameter that another model's base parameters do not determine, over its size,
up to which they determine it."""

CommonStatus = Literal[
    "identified", "at a bound", "removed", "not identifiable", "no such parameter"
]


@dataclass(frozen=True, eq=False)
class ModelErrors:
    """Errors of one model on one log; efforts are in the unit of the errors."""

    run: str
    fitted: bool  # whether the model was identified from this log
    errors: BandErrors
    mae: Array  # mean absolute error of each joint over the same samples, shape `(n,)`
    t: Array  # time, shape `(N,)` [s]
    measured: Array  # low-passed measured effort, shape `(N, n)`
    predicted: Array  # that of the model, likewise


@dataclass(frozen=True, eq=False)
class ComparedModel:
    """One of the models."""

    name: str
    identified: IdentifiedModel
    runs: tuple[ModelErrors, ...]  # its errors, one entry per log


@dataclass(frozen=True)
class ParameterValue:
    """What one model says of a base parameter."""

    status: CommonStatus  # whether it has a value, and why not
    value: float | None = None  # zero if removed, `None` if not known
    std: float | None = None  # standard deviation; `None` where there is none


@dataclass(frozen=True)
class CommonParameter:
    """A base parameter, and what every model says of it."""

    name: str  # the standard parameter that leads its group
    group: str
    unit: str
    values: tuple[ParameterValue, ...]


@dataclass(frozen=True, eq=False)
class ModelComparison:
    """Models side by side."""

    models: tuple[ComparedModel, ...]  # as they were given; the first one says how logs are read

    @property
    def runs(self) -> tuple[str, ...]:
        """Names of the logs."""
        return tuple(run.run for run in self.models[0].runs)

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints."""
        return tuple(joint.joint for joint in self.models[0].runs[0].errors.joints)

    @cached_property
    def pooled_runs(self) -> tuple[int, ...]:
        """Numbers of the logs that no model was identified from; all, if each was used for one."""
        every = range(len(self.runs))
        unseen = [k for k in every if not any(model.runs[k].fitted for model in self.models)]
        return tuple(unseen or every)

    def all_joints(self, model: ComparedModel) -> tuple[EffortError, ...]:
        """Errors of a model over all joints and pooled logs, one per unit of effort."""
        return pooled(model.runs[k].errors for k in self.pooled_runs)

    def each_joint(self, model: ComparedModel) -> tuple[EffortError | None, ...]:
        """The error of each joint over all pooled logs; `None` if it moves in none."""
        return of_joints([model.runs[k].errors for k in self.pooled_runs])

    @cached_property
    def parameters(self) -> tuple[CommonParameter, ...]:
        """Every base parameter of any model."""
        return common_parameters([model.identified for model in self.models])


def model_errors(
    identified: IdentifiedModel, run: Run, first: IdentifiedModel, fitted: bool
) -> ModelErrors:
    """Errors of a model on a run, in the band and the unit of the first model's.

    Logged efforts are converted by the gains of the first model, so that all models predict the
    same measured effort; of a model with other effort columns by its own.
    """
    reference = replace(effort_reference(first), scales=())
    gains, cutoff = identified.signals.gains, band_of(reference, run.rate)
    found = score(identified.valued, run, gains, cutoff, reference=reference)
    mine = first if same_efforts(identified, first) else identified
    # effort in the unit of the errors per logged unit, of either sign
    scales = np.where(known_efforts(mine), mine.signals.gains, 1.0)
    own = np.where(known_efforts(identified), np.abs(gains), 1.0)
    joints = tuple(
        replace(joint, unit=unit, error=float(x) * joint.error, used=float(x) * joint.used)
        for joint, x, unit in zip(
            found.errors.joints, np.abs(scales) / own, units_of(first), strict=True
        )
    )
    errors, traces = replace(found.errors, joints=joints), found.traces
    logged = [
        joint.mae if joint.mae_moving is None or errors.at_rest else joint.mae_moving
        for joint in found.joints
    ]
    efforts = traces.measured * scales, traces.predicted * scales
    return ModelErrors(found.run, fitted, errors, np.abs(scales) * logged, traces.t, *efforts)


def units_of(identified: IdentifiedModel) -> tuple[str, ...]:
    """Units of the errors: those of the joints, or the logged ones where no gain is known."""
    logged = identified.signals.effort_units
    return tuple(
        joint if known else unit
        for joint, unit, known in zip(
            identified.robot.effort_units, logged, known_efforts(identified), strict=True
        )
    )


def same_efforts(one: IdentifiedModel, other: IdentifiedModel) -> bool:
    """Whether two models read the same effort columns in the same way, their gains apart."""
    a, b = one.signals, other.signals
    maps = [np.zeros(0) if x.effort_map is None else x.effort_map for x in (a, b)]
    return (
        (a.effort, a.effort_units) == (b.effort, b.effort_units)
        and np.array_equal(a.effort_scale, b.effort_scale)
        and np.array_equal(maps[0], maps[1])
    )


def refuse_different(
    first: IdentifiedModel, other: IdentifiedModel, names: tuple[str, str]
) -> None:
    """Two models are of one robot, with efforts in the same units."""
    where = f"models {names[0]} and {names[1]}"
    if first.joints != other.joints:
        wrong = f"one has the joints {', '.join(first.joints)}, the other {', '.join(other.joints)}"
        fix = "compare models of the same robot, with the joints in the same order"
        raise ModelError(wrong, where=where, fix=fix)
    if not same_efforts(other, first) and units_of(first) != units_of(other):
        raise ModelError(
            f"the efforts of one are in {', '.join(dict.fromkeys(units_of(first)))}, those of the "
            f"other in {', '.join(dict.fromkeys(units_of(other)))}",
            where=where,
            fix="give the drive gains of both robot files in [signals.effort] gain, and identify "
            "again",
        )


def common_parameters(models: Sequence[IdentifiedModel]) -> tuple[CommonParameter, ...]:
    r"""Base parameters of all models, and what every model says of each.

    A base parameter of one model, $\phi = r^T \theta$ of the standard parameters $\theta$, is
    known from another model's base parameters $L \theta$ where $r^T = c^T L$; its value is then
    $c^T \phi'$, its variance $c^T \Sigma' c$. Standard parameters that a model does not have are
    zero in it. The set is that of the model with the most base parameters, with those of the
    others whose names are not in it.
    """
    found: dict[str, CommonParameter] = {}
    for owner in sorted(models, key=lambda model: -len(model.base)):
        base = owner.base
        for k, (name, unit) in enumerate(zip(base.base_names, base.base_units, strict=True)):
            if name not in found:
                row = {base.names[i]: base.lift[k, i] for i in np.flatnonzero(base.lift[k])}
                values = tuple(parameter_value(model, name, unit, row) for model in models)
                found[name] = CommonParameter(name, base.grouping(k), unit, values)
    return tuple(found.values())


def parameter_value(
    identified: IdentifiedModel, name: str, unit: str, row: dict[str, float]
) -> ParameterValue:
    """What a model says of a base parameter."""
    base, estimate = identified.base, identified.estimate
    if any(removed.name == name for removed in estimate.removed):
        return ParameterValue("removed", 0.0)
    place = {standard: k for k, standard in enumerate(base.names)}
    wanted = np.zeros(len(base.names))
    for standard, coefficient in row.items():
        if standard in place:
            wanted[place[standard]] = coefficient
    chosen = wanted[list(base.independent)]
    if not wanted.any() or (name in place and base.units[place[name]] != unit):
        return ParameterValue("no such parameter")
    if np.abs(wanted - chosen @ base.lift).max() > SAME * np.abs(wanted).max():
        return ParameterValue("not identifiable")
    members = {base.base_names[k] for k in np.flatnonzero(chosen)}
    if estimate.standard is None and members & {blind.name for blind in estimate.blind}:
        return ParameterValue("not identifiable")
    value = float(chosen @ base.base_values(identified.valued.values.values))
    if members & set(estimate.at_bound):
        return ParameterValue("at a bound", value)
    variance = float(chosen @ identified.base_covariance @ chosen)
    return ParameterValue("identified", value, float(np.sqrt(max(variance, 0.0))))
