"""From a robot and logs to an identified model with its scores: what `steelyard identify` does."""

import os
from collections.abc import Iterable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from html import escape
from pathlib import Path

from steelyard.base.arrays import Parameters
from steelyard.base.checked_arguments import checked
from steelyard.base.errors import LogError
from steelyard.base.progress import Progress, silent
from steelyard.base.workers import refuse_odd
from steelyard.check.all_checks import BASIC_CHECKS, Diagnosis
from steelyard.check.case_from_files_and_precheck import (
    notes_of_precheck,
    prechecked,
)
from steelyard.check.decision.gears_and_friction_of_logs import missing_coupling
from steelyard.check.decision.joint_zeros_and_quarter_turns import turned_joints
from steelyard.check.decision.undecided_questions import UNTIL_OTHER
from steelyard.check.finding import Finding, Severity
from steelyard.check.findings_text_and_page import groups, open_words, print_notes
from steelyard.check.fitted.fitted_case_causes_and_constraints import FittedCase
from steelyard.check.fitted.implausible_estimates_and_gear_side import refuse_absurd
from steelyard.check.fitted.post_fit_checks import doubts_of_fit, examine_fit
from steelyard.check.signals.carried_floating_base import refuse_uncarried
from steelyard.check.signals.movement_rests_and_moving_base import of_base
from steelyard.estimate.estimator_register import method_of
from steelyard.estimate.scores.score import RunScore
from steelyard.identify import repeated_fits
from steelyard.identify import runs_and_notes_of_logs as of_logs
from steelyard.identify import scores_and_model_report as model_report
from steelyard.identify.fit import Fit, below_described_band, calibrated, fit, without_forces
from steelyard.identify.fit_preparation import FitTask, model_to_fit, with_signals
from steelyard.identify.many_logs import (
    many_logs,
    of_all_logs,
    refuse_beside_workers,
    spread_over,
)
from steelyard.identify.page.report_content_and_error_words import ReportContent
from steelyard.identify.remembered_parts import of_first_usable
from steelyard.identify.repeated_motion_and_validation_split import marked_repeats, refuse_same_rows
from steelyard.logs.parquet import natural
from steelyard.report.result import DataFrame
from steelyard.robot.file.model_reading_and_loaded_robot import LoadedRobot
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.file.signals import Signals
from steelyard.runs import runs_of_named_logs as named_logs
from steelyard.runs.run import Run


@dataclass(frozen=True, eq=False, repr=False)
class Identification(repeated_fits.ReportOfLogs):
    """An identified model, and how well it predicts.

    Attributes:
        content: All that the report shows.

    Example:
        >>> found = identify("arm.toml", "fit.csv", validate="other.csv")
        >>> (unseen,) = found.to_dict()["validation"]
        >>> [joint["joint"] for joint in unseen["headline"]["joints"]]
        ['joint1', 'joint2']
    """

    @property
    def parameters(self) -> DataFrame:
        """The base parameters, one a row: value, standard deviation, 95 % interval, status."""
        return model_report.parameter_table(self.model)

    def beside(self, truth: Parameters) -> "Identification":
        """The same with the true standard parameters of a simulated robot in the report."""
        return Identification(replace(self.content, truth=truth))

    def _repr_html_(self) -> str:
        tables = f"{self.scores._repr_html_()}{self.parameters._repr_html_()}"
        line = escape(self.verdict.line)
        return f"<h4>{escape(self.content.title)}</h4><p><strong>{line}</strong></p>{tables}"


@checked(payload_mass=1e-6, bootstrap=20, threads=1)
def identify(
    robot: str | Path | LoadedRobot,
    logs: str | Path | Iterable[str | Path],
    validate: str | Path | Iterable[str | Path] = (),
    *,
    loaded: str | Path | Iterable[str | Path] = (),
    payload_mass: float | None = None,
    payload_frame: str | None = None,
    check: bool = True,
    commanded: bool = False,
    sensitivity: bool = False,
    bootstrap: int | None = None,
    each: bool = False,
    method: str | None = None,
    fixed_base: str | None = None,
    threads: int | None = None,
    cluster: str | None = None,
    progress: Progress = silent,
) -> Identification:
    """Identify a robot's dynamics from logs of its motion.

    Args:
        robot: Robot file (TOML), URDF, xacro or MJCF, or what `load_robot` made of it.
        logs: Logs to fit; `run.csv@5:20` is a window in seconds, `run.csv#100:900` in rows.
        validate: Logs of other motions, for validation.
        loaded: Logs with a payload, to identify unknown drive gains.
        payload_mass: Mass of that payload [kg].
        payload_frame: Frame of the payload; that of the last link if `None`.
        check: Whether the logs are checked before the fit; a wrong finding stops it.
        commanded: Predict the efforts of validation logs from the commanded motion
            (`commanded_position` in the robot file), as feedforward would.
        sensitivity: Repeat the fit with cut-offs x 0.5 to x 2, and compare.
        bootstrap: Number of bootstrap estimates, from resampled time windows.
        each: Also estimate from each log alone: mean and standard deviation of every parameter over
            the logs.
        method: Estimator, such as `WLS`, `Huber` or `IV`, or `least_squares`, instead of the robot
            file's; `steelyard compare` recommends one, `steelyard.estimators()` lists all.
        fixed_base: Link to fix to the world, for a model file; `None` for its root.
        threads: Native threads; as many as the machine has cores if `None`.
        cluster: Many logs (also folders, patterns with `*`, URLs) on workers: address of a Dask
            scheduler, `tcp://HOST:PORT`, or `local:N` for N workers here. Cut-offs, laws, gains and
            checks are those of six of the logs, the parameters those of all.
        progress: Receives events of progress; an exception from it stops the work.

    Returns:
        The model, its scores and its report.

    Raises:
        SteelyardError: A file cannot be used, or the data are not what the robot file says.

    Example:
        >>> found = identify("arm.toml", "fit.csv", validate="other.csv")
        >>> print(found.verdict.level)
        good
        >>> found.model.joints
        ('joint1', 'joint2')
    """
    file = load_robot(robot, base=fixed_base)
    requested = {} if method is None else {"method": method_of(file, method).name}
    file = replace(file, estimation=file.estimation.model_copy(update=requested))
    method_of(file)
    carrying, unknown = (
        named_logs.log_files(named_logs.paths_of(some)) for some in (loaded, validate)
    )
    known = named_logs.paths_of(logs, 1)
    payload = carrying, payload_mass, payload_frame
    cores = threads or os.cpu_count() or 1
    fitting = partial(
        _fitted,
        file,
        payload=payload,
        unknown=unknown,
        check=check,
        commanded=commanded,
        threads=cores,
        progress=progress,
    )
    refuse_odd(cluster)
    if cluster is None:
        state = fitting(named_logs.log_files(known))
        return _reported(state, commanded, sensitivity, bootstrap, each)
    refuse_beside_workers(file, each=each, sensitivity=sensitivity, bootstrap=bootstrap)
    with ExitStack() as stack:
        every = stack.enter_context(many_logs(known, unknown, progress))
        state, sample = of_first_usable(
            spread_over(every),
            lambda texts: fitting(named_logs.log_files(sorted(texts, key=natural))),
            stack,
            blame_first=False,
        )
        given = every, state.found, sample, state.unseen
        found, notes, doubts = of_all_logs(*given, cluster, progress)
        state = replace(state, found=found, assumed=(*state.assumed, *notes), doubts=doubts)
        return _reported(state, commanded)


@dataclass(frozen=True, eq=False)
class _Fitted:
    """A fit to logs, and what the report needs beside it."""

    file: LoadedRobot
    found: Fit
    fitted: Sequence[named_logs.LogArgument]  # those with a payload included
    unknown: Sequence[named_logs.LogArgument]
    clean: tuple[Run, ...]  # of the logs that are fitted
    unseen: tuple[Run, ...]
    diagnosis: Diagnosis | None
    assumed: tuple[str, ...]  # notes that the report begins with
    decided: tuple[str, ...]  # details
    doubts: tuple[Finding, ...] = ()  # about logs that only workers read


def _fitted(
    file: LoadedRobot,
    known: Sequence[named_logs.LogArgument],
    *,
    payload: tuple[Sequence[named_logs.LogArgument], float | None, str | None],
    unknown: Sequence[named_logs.LogArgument],
    check: bool,
    commanded: bool,
    threads: int,
    progress: Progress,
) -> _Fitted:
    """Check logs, make them runs, and fit the model to them."""
    carrying = payload[0]
    named_logs.refuse_overlaps([*known, *carrying], unknown)
    signals, reasons = named_logs.signals_of(file, known[0])
    if commanded:
        _refuse_uncommanded(signals, unknown)
    model, diagnosis, unresolved = model_to_fit(file), None, tuple[str, ...]()
    made = dict[str, Run]()
    if check:
        given = replace(file, signals=signals)
        diagnosis, made = prechecked(file.reference, given, (*known, *unknown), progress)
    clean, unseen = named_logs.runs_of(file, signals, [*known, *carrying], unknown, progress, made)
    file, band = below_described_band(file, signals, model, clean[: len(known)], threads, progress)
    if band:
        read = (*clean, *unseen)
        clean, unseen = named_logs.runs_of(
            file, signals, [*known, *carrying], unknown, progress, before=read
        )
    if diagnosis is not None:
        unresolved = notes_of_precheck(diagnosis, file.reference)
    every = (*clean, *unseen)
    lost = (*of_logs.dropped_rows(every), *of_logs.left_out_stretches(every))
    assumed = (*file.notes, *reasons, *lost, *band)
    decided = of_logs.notes_of(every)
    refuse_same_rows(clean, unseen)
    refuse_uncarried(every, file.robot)
    fitted_runs, carrying_runs = clean[: len(known)], clean[len(known) :]
    task = FitTask(model, file, fitted_runs, carrying_runs, *payload[1:], threads, progress)

    def fitted_to(some: FitTask, left_out: tuple[str, ...] = ()) -> Fit:
        notes = (*assumed, *left_out, *decided, *unresolved)
        origin = of_logs.provenance(file, known, carrying, unknown, some.runs, notes)
        return fit(some, origin)

    found = fitted_to(task)
    if check:
        found, forces = without_forces(found, fitted_to)
        assumed = (*assumed, *forces)
        refuse_absurd(found.identified, file.reference)
    logs = [*known, *carrying]
    of_runs = logs, unknown, clean, unseen
    return _Fitted(file, calibrated(found), *of_runs, diagnosis, assumed, decided)


def _reported(
    state: _Fitted,
    commanded: bool,
    sensitivity: bool = False,
    bootstrap: int | None = None,
    each: bool = False,
) -> Identification:
    """Scores, doubts and the report of a fit."""
    found, unknown, progress = state.found, state.unknown, state.found.task.progress
    known = state.fitted[: len(state.found.task.runs)]
    identified, prepared = found.identified, found.prepared
    every = (*state.clean, *state.unseen)
    unseen = tuple(with_signals(run, identified.signals) for run in state.unseen)
    fitted, fresh, unscaled = _scores(found, unseen, unknown if commanded else ())
    tested = ((), ()) if commanded else (unseen, fresh)
    limitations = (
        *state.doubts,
        *_limitations(found, state.file, state.diagnosis, fitted, *tested),
    )
    doubts = tuple(doubts_of_fit(limitations, [run.name for run in unseen]))
    identified = replace(identified, provenance=replace(identified.provenance, doubts=doubts))
    varied = None
    if sensitivity:
        columns = identified.signals.of_commanded() if commanded else identified.signals
        varied = repeated_fits.fits_with_other_cutoffs(
            found, known, unknown, columns, (fitted, fresh)
        )
    drawn, failed_draws = repeated_fits.bootstrap_of(found, bootstrap)
    repeated, failed_logs = None, tuple[str, ...]()
    if each:
        repeated, failed_logs = repeated_fits.of_each_log(*found.fitted[:3], progress)
    open_loops, files = of_logs.dropped(found.task.model, every), [*state.fitted, *unknown]
    return Identification(
        ReportContent(
            title=f"{identified.robot.name}: identified dynamics",
            robot=identified.robot.name,
            identified=identified,
            scores=fresh,
            fitted=fitted,
            unscaled=unscaled,
            qualities=tuple((run.name, run.quality.rows_of_text) for run in every),
            notes=(
                *state.assumed,
                *prepared.of_contacts,
                *of_logs.first_dropped(open_loops),
                *found.ignored,
                *of_logs.commanded_note(identified, fresh),
                *failed_draws,
                *failed_logs,
            ),
            details=(*state.decided, *found.notes, *open_loops[1:]),
            settings=of_logs.settings(identified),
            friction=prepared.choice,
            findings=prepared.findings,
            gains=prepared.gains,
            zero_offsets=prepared.offsets,
            effort_scales=found.scales,
            diagnosis=state.diagnosis,
            limitations=limitations,
            sensitivity=varied,
            bootstrap=drawn,
            repeated=repeated,
            logs={run.name: log.text for run, log in zip(every, files, strict=True)},
        )
    )


def _refuse_uncommanded(signals: Signals, unseen: Sequence[named_logs.LogArgument]) -> None:
    """Scores from commanded motion need its columns, and logs to be predicted."""
    signals.of_commanded()
    if not unseen:
        wrong = "there is no log to be predicted from its commanded motion"
        fix = "name logs to validate, or leave out 'commanded'"
        raise LogError(wrong, where="options of the identification", fix=fix)


def _scores(
    found: Fit, unseen: Sequence[Run], commanded: Sequence[named_logs.LogArgument]
) -> tuple[tuple[RunScore, ...], tuple[RunScore, ...], tuple[RunScore, ...]]:
    """Scores of fitted runs, of unseen ones, if given from commanded motion, and without scales."""
    identified, unscaled, progress = found.identified, found.unscaled, found.task.progress
    runs = found.fitted.runs
    plain: tuple[RunScore, ...] = ()
    if unscaled is not None and not commanded:
        plain = model_report.scored(
            unscaled, [with_signals(run, unscaled.signals) for run in unseen], progress
        )
    scores = model_report.scored(identified, runs if commanded else (*runs, *unseen), progress)
    if commanded:
        names = [run.name for run in unseen]
        scores += model_report.scored_from_commanded(identified, commanded, names, progress)
    count = len(runs)
    return scores[:count], marked_repeats(identified, unseen, scores[count:]), plain


def _limitations(
    found: Fit,
    file: LoadedRobot,
    diagnosis: Diagnosis | None,
    fitted: tuple[RunScore, ...],
    unseen: tuple[Run, ...],
    fresh: tuple[RunScore, ...],
) -> tuple[Finding, ...]:
    """What limits the verdict: open questions and doubts about the logs, findings after the fit.

    Checks of the fit look at the scores of its runs, and at unseen runs with theirs, predicted from
    the measured motion.
    """
    checked_before = Diagnosis(()) if diagnosis is None else diagnosis
    before, runs = checked_before.findings, found.fitted.runs
    undecided = (one for one in before if one.severity == Severity.DOUBTFUL and one.hypotheses)
    names = {run.name for run in runs}
    open_questions = tuple(one for one in undecided if one.log in names)
    of_runs = runs, unseen, fitted, fresh, found.fitted.information
    of_fit = found.scales, found.consistent, found.prepared.gains
    case = FittedCase(found.identified, *of_runs, open_questions, *of_fit)
    after = (
        *turned_joints(before),
        *examine_fit(case, found.task.progress),
        *of_base(file, before),
        *missing_coupling(before, file.couplings_stated),
    )
    return (*_open_questions(checked_before), *_doubts(checked_before, after), *after)


def _doubts(diagnosis: Diagnosis, found: Sequence[Finding]) -> tuple[Finding, ...]:
    """What the check of the logs doubts, and no check after the fit takes up."""
    taken_up = {one.check for one in found}
    left = Diagnosis(tuple(one for one in diagnosis.findings if one.check not in taken_up))
    checks = [group[0].check for group in groups(left) if group[0].severity]
    says = zip(checks, print_notes(left), strict=True)
    return tuple(Finding(check, "", Severity.DOUBTFUL, note, "") for check, note in says)


EXPLAINED_QUESTIONS = 2  # open questions up to which the headline says why


def _open_questions(diagnosis: Diagnosis) -> tuple[Finding, ...]:
    """What the check of the logs could not decide, in one finding."""
    if diagnosis.inconclusive:
        says, checks = f"check of the logs: {open_words(diagnosis)}", diagnosis.open_checks
        return (Finding("open questions", "", Severity.DOUBTFUL, says, ", ".join(checks)),)
    basic = {check.name for check in BASIC_CHECKS}
    every = [f for f in diagnosis.findings if not f.answered]
    left = [f for f in every if f.check in basic or f.headline]
    found = {f.check: f.says for f in left if not f.says.startswith(UNTIL_OTHER)}
    if not found:
        return ()
    reasons = [f"{check} ({why.removeprefix('undecided: ')})" for check, why in found.items()]
    says = "not decided by the logs, nor shown by this error: "
    whole = says + "; ".join(reasons)
    brief = whole if len(found) <= EXPLAINED_QUESTIONS else says + ", ".join(found)
    return (Finding.ok(whole, headline=True, brief=brief).by("open questions"),)
