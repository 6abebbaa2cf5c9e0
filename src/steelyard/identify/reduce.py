"""A smaller model that predicts as well: what `steelyard reduce` does."""

import os
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import reduce as sum_of
from operator import add
from pathlib import Path
from typing import Literal

import numpy as np

from steelyard.base.checked_arguments import checked
from steelyard.base.errors import DataError, ModelError, advice
from steelyard.base.progress import Progress, silent
from steelyard.check.finding import Finding, Fix, Severity
from steelyard.estimate.consistent.convex_estimator import Consistent
from steelyard.estimate.consistent.prior_weight_and_contradictions import (
    contradictions,
    refuse_contradictions,
)
from steelyard.estimate.estimate import Estimate
from steelyard.estimate.identified_model import IdentifiedModel, load_model
from steelyard.estimate.information import base_parameters_and_regressor as regression
from steelyard.estimate.information.information import Information
from steelyard.estimate.information.kept_filtered_samples import in_units_of_joints
from steelyard.estimate.nonlinear.nonlinear_parameters import information_from
from steelyard.estimate.prior.body_priors import Row
from steelyard.estimate.prior.prior_constraint_kinds import knowledge_of
from steelyard.estimate.reduction import stopping_rules_and_reduction as stopping
from steelyard.estimate.reduction.stopping_rules_and_reduction import (
    Reduction,
    criterion_of,
    least_squares,
)
from steelyard.estimate.reduction.stopping_rules_and_reduction import reduce as reduced_by
from steelyard.estimate.scores.residual_traces_and_band_calibration import calibrate
from steelyard.estimate.scores.score import RunScore
from steelyard.identify import runs_and_notes_of_logs as of_logs
from steelyard.identify.page.reduction_and_removals import parameter_comparison
from steelyard.identify.page.report_content_and_error_words import ReportContent
from steelyard.identify.repeated_fits import ReportOfLogs, of_each_log
from steelyard.identify.repeated_motion_and_validation_split import marked_repeats, repeat_of
from steelyard.identify.scores_and_model_report import scored
from steelyard.identify.verdict_and_next_steps import path_word, poorly_predicted
from steelyard.model.model import Model
from steelyard.model.terms.term import Term
from steelyard.report.result import DataFrame, Result, frame
from steelyard.report.words import first_names
from steelyard.robot.file.model_reading_and_loaded_robot import LoadedRobot
from steelyard.robot.file.robot_file import load_robot
from steelyard.runs import runs_of_named_logs as named_logs
from steelyard.runs.run import Run, fastest_of, motion_samples

STILL_SPEED_SHARE = 0.05  # speed over that of the fastest joint of its kind: hardly moves


@dataclass(frozen=True, eq=False, repr=False)
class ReducedModel(ReportOfLogs):
    """A reduced model, the path it lies on, and how well it predicts."""

    reduction: Reduction  # the path, the errors along it and the choice

    @property
    def kept(self) -> tuple[str, ...]:
        """Names of the base parameters that are left."""
        return self.model.estimate.parameters.names

    @property
    def criterion_table(self) -> DataFrame:
        """The criterion's value of every parameter: `name`, `step`, `before` and `last`.

        `before` any removal, and the `last` one: before its removal in that step, or of a parameter
        that is kept (`step` is null) in the reduced model.

        Raises:
            PackageError: Polars is not installed.
        """
        return frame(self.reduction.worth(), "criterion_table")

    @property
    def parameter_comparison(self) -> DataFrame:
        """The parameters of the full model and of the reduced one, with standard deviations.

        Columns are `name`, `unit`, `full`, `full_std`, `full_relative_std_percent` and the same for
        `reduced`; what the data do not identify or what was removed has no value there.

        Raises:
            PackageError: Polars is not installed.
        """
        return frame(parameter_comparison(self.model), "parameter_comparison")

    @property
    def joint_errors(self) -> DataFrame:
        """Errors of both models on the fitted motion by joint, see `Reduction.joint_errors`.

        Raises:
            PackageError: Polars is not installed.
        """
        return frame(self.reduction.joint_errors(), "joint_errors")

    __repr__ = Result.__repr__


@checked(threads=1)
def reduce(
    model: str | Path | IdentifiedModel,
    logs: str | Path | Iterable[str | Path],
    validate: str | Path | Iterable[str | Path] = (),
    *,
    criterion: str = "loss",
    stop: str = "one_standard_error",
    error: Literal["rms", "mean_absolute"] = "rms",
    essential: Literal["moving_friction", "none"] | None = None,
    keep: Iterable[str] = (),
    drop: Iterable[str] = (),
    bodies: str | Path | LoadedRobot | None = None,
    each: bool = False,
    weights: Literal["noise", "equal"] = "noise",
    threads: int | None = None,
    progress: Progress = silent,
) -> ReducedModel:
    """Make an identified model smaller without making it worse on motion that it has not seen.

    One base parameter after the other is removed, the one that is worth least first, and the
    others are refitted; removed parameters are zero. The smaller model describes the speeds and
    postures of the logs; elsewhere a removed parameter may matter.

    Args:
        model: The model, its `model.json`, or the folder that contains it; a reduced one is reduced
            further.
        logs: Logs to fit, such as those that the model was identified from.
        validate: Logs of other motions, for validation.
        criterion: The parameter that is removed next has the least `loss` (rise of chi-square),
            `contribution` (to the torque), `mean_column` (mean absolute value of its regressor
            column) or `deviation` (value over standard deviation).
        stop: Stopping rule: `one_standard_error` (smallest model with a left-out error within one
            standard error of the least, no joint's above the full model's by more than 5 %),
            `tolerance=5` (greatest relative rise of a joint's error, also on left-out motion,
            in percent), `bic`, `condition=30` (normalised condition number), `ratio=30` (greatest
            over least relative standard deviation), `count=25` (parameters), `one_fewer` (removes
            one besides those of `drop`) or `refit` (none besides those).
        error: Error of a joint that `tolerance` compares: `rms`, or `mean_absolute` and on the
            fitted motion alone, as in algorithm 1 [Volkmann].
        essential: Parameters that are essential from the start: `moving_friction` (of joints that
            move) or `none`; if unset, `moving_friction` with `tolerance`, `none` otherwise.
        keep: Base parameters that stay besides, such as 'viscous.*'.
        drop: Base parameters that are removed first, whatever the stopping rule.
        bodies: Robot file; then the values are physically consistent, with its priors,
            and the model can be exported.
        each: Also estimate the reduced model from each log alone: mean and standard deviation of
            every parameter over the logs.
        weights: How joints weigh: by the inverse variance of their `noise`, or all `equal`, as
            weights under estimation in the robot file says it for `identify`.
        threads: Native threads; as many as the machine has cores if `None`.
        progress: Receives events of progress; an exception from it stops the work.

    Raises:
        SteelyardError: A file cannot be used, or no model is as the stopping rule wants it.

    Example:
        >>> smaller = reduce("arm-model", "fit.csv", validate="other.csv", stop="one_fewer")
        >>> full = smaller.reduction.path.full.names
        >>> len(full) - len(smaller.kept)
        1
    """
    identified = load_model(model)
    _refuse_unreducible(identified)
    robot = None if bodies is None else _robot_of(identified, bodies)
    chosen_by, rule = criterion_of(criterion), stopping.rule_of(stop)
    equal = weights == "equal"
    estimator = least_squares(equal)
    if error == "mean_absolute" and not rule.bounded:
        wrong = f"stopping rule '{rule.name}' compares no mean absolute errors"
        fix = "add --stop tolerance=5, or leave --error out"
        raise ModelError(wrong, where="--error mean_absolute", fix=fix)
    known, unknown = (
        named_logs.log_files(named_logs.paths_of(logs, least=1)),
        named_logs.log_files(named_logs.paths_of(validate)),
    )
    named_logs.refuse_overlaps(known, unknown)
    repetitions = identified.processing.repetitions
    runs = of_logs.runs_for(identified, known, progress, at_rest=False, repetitions=repetitions)
    unseen = of_logs.runs_for(identified, unknown, progress, at_rest=False)
    cores = threads or os.cpu_count() or 1
    regressor = regression.base_regressor(identified.model)

    def information_of(some: Sequence[Run]) -> Information:
        rests = identified.model.has_memory
        return information_from(some, rests=rests, threads=cores, progress=progress)(regressor)

    if error == "mean_absolute":
        samples = sum_of(add, in_units_of_joints(regressor, runs, cores, progress))
        rule = stopping.within_tolerance(rule.tolerance, samples)
    before = identified.estimate.removed
    gone = {one.name for one in before}
    columns = [name for name in regressor.layout.columns if name not in gone]
    kept, dropped_first = matching(keep, columns, "--keep"), matching(drop, columns, "--drop")
    _refuse_contradiction(kept, dropped_first, columns)
    if essential == "moving_friction" or (essential is None and rule.bounded):
        friction = moving_friction(identified.model, runs, columns)
        kept += tuple(name for name in friction if name not in dropped_first)
    everything = information_of(runs)
    information = everything.select(columns)
    fresh = information_of(unseen).select(columns) if unseen else None
    limits = {"keep": kept, "drop": dropped_first}
    found = reduced_by(information, chosen_by, rule, **limits, unseen=fresh, equal=equal)
    found = found.after(before)
    estimate = found.estimate

    def estimating(data: Information) -> Estimate:
        if robot is not None:
            return _with_bodies(identified, robot, runs, data, found, equal)
        return estimator(data.select(found.estimate.parameters.names))

    repeated, failed_logs = None, tuple[str, ...]()
    if each:
        one_log = of_each_log(runs, everything, lambda _runs, _data: estimating, progress)
        repeated, failed_logs = one_log
    if robot is not None:
        estimate = estimating(everything)
    smaller = replace(
        _without_empty_terms(replace(identified, estimate=estimate)),
        reference=(estimator(information),),
        motions=motion_samples(runs),
        provenance=replace(
            identified.provenance,
            runs=tuple(run.name for run in runs),
            inputs={
                f"{role} {number}": named_logs.sha256(log.path)
                for role, some in (("identification", known), ("validation", unknown))
                for number, log in enumerate(some, start=1)
            },
        ),
    )
    names = estimate.parameters.names
    left, again = information.select(names), lambda part: estimator(part.select(names))
    calibration = calibrate(smaller, runs, left, again, threads=cores, progress=progress)
    smaller = replace(smaller, calibration=calibration)
    name, both = smaller.model.robot.name, (*runs, *unseen)
    content = ReportContent(
        title=f"{name}: reduced model",
        robot=name,
        identified=smaller,
        scores=marked_repeats(smaller, unseen, scored(smaller, unseen, progress)),
        fitted=scored(smaller, runs, progress),
        qualities=tuple((run.name, run.quality.rows_of_text) for run in both),
        limitations=_undescribed(scored(identified, runs, progress), model, known),
        notes=(*of_logs.dropped_rows(both), *_one_motion(smaller, runs), *failed_logs),
        details=(*of_logs.notes_of(both), *of_logs.dropped(smaller.model, both)),
        settings=of_logs.settings(smaller),
        reduction=found,
        before=scored(identified, unseen, progress),
        repeated=repeated,
    )
    return ReducedModel(content, found)


def _undescribed(
    scores: Sequence[RunScore],
    model: str | Path | IdentifiedModel,
    logs: Sequence[named_logs.LogArgument],
) -> tuple[Finding, ...]:
    """That the model to be reduced does not describe logs that the smaller one is fitted to."""
    if not (poor := poorly_predicted(scores)):
        return ()
    named = "MODEL" if isinstance(model, IdentifiedModel) else path_word(model)
    command = " ".join(["steelyard validate", named, *(path_word(log.text) for log in logs)])
    says = (
        f"the given model predicts {first_names(poor, 3)}: the reduced model is fitted to logs "
        "that the model before it does not describe"
    )
    fix = Fix(f"See why with {command}, and reduce with logs that the model describes")
    doubt = Finding("given model", "", Severity.DOUBTFUL, says, fix=fix, headline=True)
    return (replace(doubt, brief=f"{says}. {fix.says}"),)


def _one_motion(smaller: IdentifiedModel, runs: Sequence[Run]) -> tuple[str, ...]:
    """That all logs repeat the motion of the first, the only one that left-out logs then judge."""
    first, *others = runs
    if not others or any(repeat_of(smaller.motions[:1], run) is None for run in others):
        return ()
    return (
        f"all logs repeat the motion of {first.name}: parameters that it hardly shows were removed "
        "by its errors alone; on other motion the reduced model may be worse than the full one "
        "(--validate LOG with another motion shows it)",
    )


def _refuse_unreducible(identified: IdentifiedModel) -> None:
    """Refuse a model with parameters of single runs, or with some that were not estimated."""
    if own := identified.model.per_run_names:
        wrong = f"every run has a '{own[0]}' of its own, which cannot be removed"
        fix = "identify without per_run = true, and reduce that model"
        raise ModelError(wrong, where=identified.model.robot.name, fix=fix)
    if known := identified.estimate.known:
        raise ModelError(
            f"parameters with a value from [[knowledge]] were not estimated: {', '.join(known)}",
            where=identified.model.robot.name,
            fix="identify without these values and reduce that model; to remove parameters that "
            "are zero, name them with --drop",
        )


def matching(patterns: Iterable[str], names: Sequence[str], option: str) -> tuple[str, ...]:
    """Names that match a pattern, in the order of the names."""
    found: set[str] = set()
    for pattern in (patterns,) if isinstance(patterns, str) else patterns:
        wanted = re.compile(".*".join(map(re.escape, pattern.split("*"))))
        mine = {name for name in names if wanted.fullmatch(name)}
        if not mine:
            wrong = f"no base parameter matches '{pattern}'"
            fix = advice(pattern, names, "base parameters")
            raise ModelError(wrong, where=option, fix=fix)
        found |= mine
    return tuple(name for name in names if name in found)


def _refuse_contradiction(keep: Sequence[str], drop: Sequence[str], names: Sequence[str]) -> None:
    """Refuse parameters that are to stay and to go, and to keep them all."""
    if both := sorted(set(keep) & set(drop)):
        wrong = f"'{both[0]}' is to be kept and to be removed"
        fix = "name it once"
        raise ModelError(wrong, where="--keep and --drop", fix=fix)
    if set(names) <= set(keep):
        wrong = f"all {len(names)} parameters are kept: there is nothing to remove"
        fix = "name fewer parameters"
        raise DataError(wrong, where="--keep", fix=fix)


def moving_friction(model: Model, runs: Sequence[Run], columns: Sequence[str]) -> tuple[str, ...]:
    """Friction parameters of joints that move, essential from the start [Volkmann]."""
    fastest, units = fastest_of(runs), np.array(model.robot.effort_units)
    greatest = np.array([fastest[units == unit].max() for unit in units])
    names = zip(model.robot.joint_names, fastest > STILL_SPEED_SHARE * greatest, strict=True)
    moving = {name for name, moves in names if moves}
    mine = {name for name in model.friction_names if name.rpartition(".")[2] in moving}
    return tuple(name for name in columns if name in mine)


def _robot_of(identified: IdentifiedModel, robot_file: str | Path | LoadedRobot) -> LoadedRobot:
    """The robot of a robot file, refused if the model is of other links."""
    loaded = load_robot(robot_file)
    theirs = [body.name for body in loaded.robot.bodies]
    ours = [body.name for body in identified.model.robot.bodies]
    if theirs != ours:
        wrong = f"the robot file moves the links {', '.join(theirs)}, the model {', '.join(ours)}"
        fix = "give the robot file that the model was identified with"
        raise ModelError(wrong, where=loaded.reference, fix=fix)
    return loaded


def _with_bodies(
    identified: IdentifiedModel,
    loaded: LoadedRobot,
    runs: Sequence[Run],
    information: Information,
    found: Reduction,
    equal: bool,
) -> Estimate:
    """The consistent estimate with the removed base parameters equal to zero."""
    base = regression.base_parameters(identified.model)
    knowledge = knowledge_of(identified.model, loaded, fastest_of(runs))
    zeros = {}
    for one in found.estimate.removed:
        if one.name in base.base_names:
            number = base.base_names.index(one.name)
            weights = base.lift[number]
            coefficients = {base.names[k]: float(weights[k]) for k in np.flatnonzero(weights)}
            zeros[one.name] = Row(f"removed: {base.grouping(number)} = 0", coefficients, 0.0, 0.0)
    possible = dict(zeros)
    while labels := contradictions(replace(knowledge, rows=(*knowledge.rows, *possible.values()))):
        clashing = [name for name, row in possible.items() if row.label in labels]
        if not clashing:
            refuse_contradictions(knowledge)
            break
        del possible[clashing[-1]]
    rows = (*knowledge.rows, *possible.values())
    estimate = Consistent(base, replace(knowledge, rows=rows), equal=equal)(information)
    positive = [name for name in zeros if name not in possible]
    notes = (f"cannot be zero for valid inertias, so estimated: {', '.join(positive)}",)
    return replace(
        estimate.without(possible),
        estimator=f"reduced {estimate.estimator}",
        removed=tuple(one for one in found.estimate.removed if one.name not in positive),
        notes=(*estimate.notes, *(notes if positive else ())),
    )


def _without_empty_terms(identified: IdentifiedModel) -> IdentifiedModel:
    """The model without terms of which nothing is left, where base parameters stay the same."""
    model, estimate = identified.model, identified.estimate
    removed = {one.name for one in estimate.removed} | {one.name for one in estimate.blind}

    def empty(term: Term) -> bool:
        names = {parameter.name for parameter in term.parameters(model.robot)}
        return term.role != "body" and bool(names) and names <= removed

    smaller = Model(model.robot, tuple(term for term in model.terms if not empty(term)))
    if smaller.terms == model.terms or not smaller.terms:
        return identified
    base, gone = regression.base_parameters(smaller), {*model.names} - {*smaller.names}
    if base.base_names != tuple(n for n in identified.base.base_names if n not in gone):
        return identified
    standard = None if estimate.standard is None else estimate.standard.without(gone)
    return replace(
        identified, model=smaller, base=base, estimate=replace(estimate, standard=standard)
    )
