"""From a robot and logs to an identified model with its scores: what `steelyard identify` does."""

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console

from steelyard.base.arguments import checked
from steelyard.base.arrays import Parameters
from steelyard.base.errors import LogError
from steelyard.base.progress import Progress, silent
from steelyard.check.decision.joint_zeros import turned_joints
from steelyard.check.decision.transmission import missing_coupling
from steelyard.check.examine import Diagnosis
from steelyard.check.finding import Finding, Severity
from steelyard.check.findings_text import open_words
from steelyard.check.fitted.fitted_case import FittedCase
from steelyard.check.fitted.implausible import refuse_absurd
from steelyard.check.fitted.post_fit import examine_fit
from steelyard.check.signals.movement import of_base
from steelyard.check.subject import notes_of_precheck, prechecked
from steelyard.estimate.estimators import method_of
from steelyard.estimate.identified import IdentifiedModel
from steelyard.identify.fit import Fit, calibrated, fit, with_signals
from steelyard.identify.page.content import ReportContent
from steelyard.identify.page.model_verdict import Verdict, verdict
from steelyard.identify.page.section_register import SECTIONS, parameters_csv, print_report, render
from steelyard.identify.prepared_fit import Payload
from steelyard.identify.refits import Repeated, of_each_log, varied, with_bootstrap
from steelyard.identify.run_notes import (
    commanded_note,
    dropped,
    dropped_rows,
    first_dropped,
    notes_of,
    provenance,
    settings,
)
from steelyard.identify.scores import (
    Scores,
    parameter_table,
    result_line,
    scored,
    scored_from_commanded,
)
from steelyard.identify.validation_data import marked_repeats, refuse_same_rows
from steelyard.model.robot_file_model import model_with_open_friction
from steelyard.report.result import Result
from steelyard.robot.file.loaded_robot import LoadedRobot
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.file.signals import Signals
from steelyard.runs.named_logs import (
    LogArgument,
    log_files,
    paths_of,
    refuse_overlaps,
    runs_of,
    signals_of,
)
from steelyard.runs.run import Run

if TYPE_CHECKING:
    from polars import DataFrame


@dataclass(frozen=True, eq=False, repr=False)
class Identification(Result):
    """An identified model, and how well it predicts.

    Attributes:
        model: The identified model.
        content: All that the report shows.

    Example:
        >>> found = identify("arm.toml", "fit.csv", validate="other.csv")
        >>> (unseen,) = found.to_dict()["validation"]
        >>> [joint["joint"] for joint in unseen["headline"]["joints"]]
        ['joint1', 'joint2']
    """

    model: IdentifiedModel
    content: ReportContent

    @property
    def verdict(self) -> Verdict:
        """The headline, its level, and findings that limit it."""
        return verdict(self.content)

    @property
    def parameters(self) -> "DataFrame":
        """The base parameters, one a row: value, standard deviation, 95 % interval, status."""
        return parameter_table(self.model)

    @property
    def repeated(self) -> Repeated | None:
        """Mean and scatter of the estimates from each log alone, if they were asked for."""
        found = self.content.repeated
        return None if found is None else Repeated(found)

    @property
    def scores(self) -> Scores:
        """Errors of predicted efforts per joint and log; all columns in its `table`."""
        return Scores(self.content.fitted, self.content.scores)

    def report(self) -> str:
        """The report as one self-contained HTML page."""
        return render(self.content)

    def beside(self, truth: Parameters) -> "Identification":
        """The same with the true standard parameters of a simulated robot in the report."""
        return replace(self, content=replace(self.content, truth=truth))

    def write(self, folder: Path) -> None:
        """Write `model.json`, `parameters.csv`, `report.html`; with `each` also `repeated.csv`."""
        (folder / "model.json").write_text(self.model.text(), encoding="utf-8")
        (folder / "parameters.csv").write_text(parameters_csv(self.model), encoding="utf-8")
        (folder / "report.html").write_text(self.report(), encoding="utf-8")
        if self.repeated is not None:
            (folder / "repeated.csv").write_text(self.repeated.csv(), encoding="utf-8")

    def show(self, console: Console, verbose: bool = False) -> None:
        """Print the verdict and the errors of every joint; with `verbose` all details."""
        print_report(self.content, console, verbose)

    def to_dict(self) -> dict[str, Any]:
        """The numbers as JSON values, as `steelyard identify --json` prints them."""
        return {
            field: value
            for section in SECTIONS
            for field, value in section.to_dict(self.content).items()
        }

    def __repr__(self) -> str:
        """Robot, level and error in one line."""
        return result_line("Identification", self.content)

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
    cores = threads or os.cpu_count() or 1
    file = load_robot(robot, base=fixed_base)
    requested = {} if method is None else {"method": method_of(file, method).name}
    file = replace(file, estimation=file.estimation.model_copy(update=requested))
    method_of(file)
    known, carrying, unknown = (
        log_files(paths_of(some, least)) for some, least in ((logs, 1), (loaded, 0), (validate, 0))
    )
    refuse_overlaps([*known, *carrying], unknown)
    signals, reasons = signals_of(file, known[0])
    if commanded:
        _refuse_uncommanded(signals, unknown)
    model = model_with_open_friction(file)
    found_out = None
    if check:
        given = replace(file, signals=signals)
        found_out = prechecked(file.reference, given, (*known, *unknown), progress)
    clean, unseen = runs_of(file, signals, [*known, *carrying], unknown, progress)
    unresolved = () if found_out is None else notes_of_precheck(found_out, file.reference)
    lost = dropped_rows((*clean, *unseen))
    notes = (*file.notes, *reasons, *lost, *notes_of((*clean, *unseen)), *unresolved)
    refuse_same_rows(clean, unseen)
    fitted, loaded_runs = clean[: len(known)], clean[len(known) :]
    origin = provenance(file, known, carrying, unknown, fitted, notes)
    payload = Payload(payload_mass, payload_frame)
    found = fit(model, file, fitted, loaded_runs, payload, origin, cores, progress)
    if check:
        refuse_absurd(found.identified, file.reference)
    found = calibrated(found, cores, progress)
    plain = found.unscaled
    unscaled = (
        ()
        if plain is None or commanded
        else scored(plain, [with_signals(run, plain.signals) for run in unseen], progress)
    )
    unseen = tuple(found.alike(run) for run in unseen)
    open_loops = dropped(model, (*clean, *unseen))
    details = (*notes_of((*clean, *unseen)), *found.notes, *open_loops[1:])
    notes = (*file.notes, *reasons, *lost, *first_dropped(open_loops), *found.ignored)
    notes += unresolved
    content = _content(found, unseen, (*clean, *unseen), unknown if commanded else (), progress)
    notes += commanded_note(found.identified, content.scores)
    files = [*known, *carrying, *unknown]
    content = replace(
        content,
        notes=notes,
        details=details,
        unscaled=unscaled,
        logs={run.name: log.text for run, log in zip((*clean, *unseen), files, strict=True)},
    )
    content = replace(content, diagnosis=found_out)
    limits = _limitations(found, () if commanded else unseen, content, progress)
    before = () if found_out is None else found_out.findings
    limits += (*of_base(file, before), *missing_coupling(before, file.couplings_stated))
    content = replace(
        content, limitations=(*_inconclusive(found_out), *turned_joints(before), *limits)
    )
    if sensitivity:
        content = varied(content, found, (known, unknown), cores, progress, commanded=commanded)
    if bootstrap is not None:
        content = with_bootstrap(content, found, bootstrap, progress)
    if each:
        content = of_each_log(content, found, progress)
    return Identification(found.identified, content)


def _refuse_uncommanded(signals: Signals, unseen: Sequence[LogArgument]) -> None:
    """Scores from commanded motion need its columns, and logs to be predicted.

    Raises:
        SteelyardError: One is missing.
    """
    signals.of_commanded()
    if not unseen:
        raise LogError(
            "there is no log to be predicted from its commanded motion",
            where="options of the identification",
            fix="name logs to validate, or leave out 'commanded'",
        )


def _content(
    fit: Fit,
    unseen: Sequence[Run],
    logs: Sequence[Run],
    commanded: Sequence[LogArgument],
    progress: Progress,
) -> ReportContent:
    """Score the model on all runs; what the report shows.

    Unseen runs are predicted from the commanded motion of their logs, if those are given.
    """
    identified, fitted = fit.identified, fit.runs
    name = identified.model.robot.name
    scores = scored(identified, fitted if commanded else (*fitted, *unseen), progress)
    if commanded:
        names = [run.name for run in unseen]
        scores += scored_from_commanded(identified, commanded, names, progress)
    fresh = marked_repeats(identified, unseen, scores[len(fitted) :])
    return ReportContent(
        title=f"{name}: identified dynamics",
        robot=name,
        identified=identified,
        scores=fresh,
        fitted=scores[: len(fitted)],
        qualities=tuple((run.name, run.quality.rows_of_text) for run in logs),
        settings=settings(identified),
        friction=fit.choice,
        findings=fit.findings,
        gains=fit.gains,
        offsets=fit.offsets,
        scales=fit.scales,
    )


def _limitations(
    fit: Fit, unseen: Sequence[Run], content: ReportContent, progress: Progress
) -> tuple[Finding, ...]:
    """What checks of the fitted model find."""
    case = FittedCase(
        fit.identified,
        tuple(fit.runs),
        tuple(unseen),
        content.fitted,
        content.scores if unseen else (),
        fit.information,
        _unresolved(content.diagnosis, fit.runs),
        fit.scales,
    )
    return examine_fit(case, progress)


def _inconclusive(diagnosis: Diagnosis | None) -> tuple[Finding, ...]:
    """That the check before could not decide whether the robot file describes the logs."""
    if diagnosis is None or not diagnosis.inconclusive:
        return ()
    says = f"check of the logs: {open_words(diagnosis)}"
    return (
        Finding("open questions", "", Severity.DOUBTFUL, says, ", ".join(diagnosis.open_checks)),
    )


def _unresolved(diagnosis: Diagnosis | None, fitted: Sequence[Run]) -> tuple[Finding, ...]:
    """Other interpretations of the fitted runs that the check before found as good, or better."""
    names = {run.name for run in fitted}
    found = () if diagnosis is None else diagnosis.findings
    return tuple(
        finding
        for finding in found
        if finding.severity == Severity.DOUBTFUL and finding.hypotheses and finding.log in names
    )
