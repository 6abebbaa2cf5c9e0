"""Estimators, or identified models, side by side on logs: `steelyard compare`, `compare-models`."""

import json
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NoReturn

from rich.console import Console

from steelyard.base.arrays import json_values, records
from steelyard.base.checked_arguments import checked
from steelyard.base.errors import DataError, ModelError
from steelyard.base.progress import Progress, report_progress, silent
from steelyard.check.case_from_files_and_precheck import (
    notes_of_precheck,
    prechecked,
)
from steelyard.estimate import estimator_register as register
from steelyard.estimate.estimator_register import Sources
from steelyard.estimate.identified_model import IdentifiedModel, load_model
from steelyard.estimate.information.base_parameters_and_regressor import base_regressor
from steelyard.estimate.information.information import Information
from steelyard.estimate.least_squares.weighted_robust_and_whitened import WeightedLeastSquares
from steelyard.estimate.scores.cross_validation import longest_window
from steelyard.estimate.scores.estimator_comparison import Comparison, Parts
from steelyard.estimate.scores.estimator_comparison import compare as compare_estimators
from steelyard.estimate.scores.model_comparison import (
    ComparedModel,
    ModelComparison,
    model_errors,
    refuse_different,
    same_efforts,
)
from steelyard.identify import runs_and_notes_of_logs as of_logs
from steelyard.identify.comparison import estimators_page
from steelyard.identify.comparison.models_page import COMPARE_MODELS_SECTIONS, ModelsContent
from steelyard.identify.fit_preparation import FitTask, PreparedFit, model_to_fit, prepare_fit
from steelyard.report.page import render_sections
from steelyard.report.result import DataFrame, Result, frame
from steelyard.robot.file.model_reading_and_loaded_robot import LoadedRobot
from steelyard.robot.file.robot_file import load_robot
from steelyard.runs import runs_of_named_logs as named_logs
from steelyard.runs.run import Run, fastest_of


def _refuse_one_run(information: Information) -> NoReturn:
    wrong = "it simulates whole runs, and there is only one"
    fix = "give several logs, or several cuts of this one: LOG@0:10 LOG@10:20"
    raise DataError(wrong, where=information.runs, fix=fix)


def offers_of(names: Sequence[str], everything: bool) -> tuple[register.Offer, ...]:
    """The named estimators, several in one name with commas; else those that do not search."""
    if names and everything:
        wrong = "estimators are named, and all are requested"
        fix = "leave out one of the two"
        raise ModelError(wrong, where="estimators, everything (--estimators, --all)", fix=fix)
    if not names:
        return tuple(offer for offer in register.ESTIMATORS if everything or not offer.slow)
    each = [name.strip() for some in names for name in some.split(",") if name.strip()]
    return tuple(
        dict.fromkeys(register.offer_of(name, "estimators (--estimators)") for name in each)
    )


def comparison_inputs(
    file: LoadedRobot, logs: Sequence[str], check: bool, threads: int, progress: Progress
) -> tuple[register.Context, Parts, PreparedFit, tuple[str, ...], tuple[str, ...]]:
    """What estimators are given, the model with its runs, notes, and details."""
    files = named_logs.log_files(logs)
    named_logs.refuse_overlaps(files, ())
    signals, reasons = named_logs.signals_of(file, files[0])
    if signals.unknown_gains and all(signals.unknown_gains):
        raise ModelError(
            "estimators cannot be compared while every drive gain is to be identified",
            where="[signals.effort] gain",
            fix="identify the gains first (steelyard identify ROBOT LOG --loaded LOG "
            "--payload-mass KG), and write them into the robot file",
        )
    model, diagnosis, made = model_to_fit(file), None, dict[str, Run]()
    if check:
        given = replace(file, signals=signals)
        diagnosis, made = prechecked(file.reference, given, files, progress)
    runs = named_logs.runs_of(file, signals, files, (), progress, made)[0]
    unresolved = () if diagnosis is None else notes_of_precheck(diagnosis, file.reference)
    task = FitTask(model, file, runs, threads=threads, progress=progress)
    ground = prepare_fit(task, WeightedLeastSquares())
    notes = (*file.notes, *reasons, *of_logs.dropped_rows(runs), *unresolved)
    details = (*of_logs.notes_of(runs), *ground.notes, *of_logs.dropped(model, runs))
    # one more pass, in windows that parts can be made of
    regressor, runs = base_regressor(ground.model), ground.runs
    information = task.information_of(ground.model, runs, longest_window(runs))(regressor)
    context = register.context_of(file, regressor, fastest_of(runs), progress)
    sources = Sources(regressor, runs, information, threads, progress)
    experiment = sources.experiment if len(runs) > 1 else _refuse_one_run
    parts = Parts.of(runs, information, {"samples": sources.samples, "experiment": experiment})
    return context, parts, ground, notes, (*details, *context.knowledge.notes)


@dataclass(frozen=True, eq=False, repr=False)
class EstimatorComparison(Result):
    """A comparison of estimators."""

    content: estimators_page.ComparisonContent  # what the page shows
    page_name, json_name = "compare.html", "compare.json"

    @property
    def comparison(self) -> Comparison:
        """Errors of every estimator on left-out runs, and the recommendation."""
        return self.content.comparison

    @property
    def untried(self) -> Sequence[str]:
        """Estimators that an interruption left out."""
        return self.comparison.untried

    @property
    def table(self) -> DataFrame:
        """One row per estimator: its errors on left-out runs, and its time."""
        return frame(self.comparison.to_dict()["estimators"], "table")

    def report(self) -> str:
        """The report as one self-contained HTML page."""
        return render_sections(estimators_page.COMPARE_SECTIONS, self.content, "compared")

    def to_dict(self) -> dict[str, Any]:
        """The numbers as JSON values, as `steelyard compare --json` prints them."""
        return {**self.comparison.to_dict(), "notes": [*self.content.notes, *self.content.details]}

    def show(self, console: Console, verbose: bool = False) -> None:
        """Print the advice and the table; with `verbose` all of it, and the notes."""
        estimators_page.comparison_lines(self.content, console, verbose)


@checked(threads=1)
def compare(
    robot: str | Path | LoadedRobot,
    logs: str | Path | Iterable[str | Path],
    estimators: Sequence[str] = (),
    *,
    everything: bool = False,
    check: bool = True,
    fixed_base: str | None = None,
    threads: int | None = None,
    progress: Progress = silent,
    interruption: type[BaseException] = KeyboardInterrupt,
) -> EstimatorComparison:
    """Compare estimators by cross-validation: fit all logs but one and predict it.

    Args:
        robot: Robot file (TOML), URDF, xacro or MJCF, or what `load_robot` made of it.
        logs: The logs; a single one is divided into stretches.
        estimators: Estimators to compare, such as `WLS`, `consistent`, `Huber` or `IV`; without
            any, all that use no random search and no simulation.
        everything: Also estimators that use random search or simulation; takes minutes.
        check: Whether the logs are checked before.
        fixed_base: Link to fix to the world, for a model file; `None` for its root.
        threads: Native threads; as many as the machine has cores if `None`.
        progress: Receives events of progress; an exception from it stops the work.
        interruption: Exception that ends the comparison; finished estimators are returned.

    Raises:
        SteelyardError: A file cannot be used, or there is no estimator of a name.

    Example:
        >>> found = compare("arm.toml", "fit.csv", ["OLS", "WLS"])
        >>> list(found.table["estimator"])
        ['OLS', 'WLS']
    """
    offers = offers_of(estimators, everything)
    paths = named_logs.paths_of(logs, least=1)
    file = load_robot(robot, base=fixed_base)
    context, parts, ground, notes, details = comparison_inputs(
        file, paths, check, threads or os.cpu_count() or 1, progress
    )
    found = compare_estimators(offers, context, parts, progress=progress, interruption=interruption)
    name = ground.model.robot.name
    return EstimatorComparison(
        estimators_page.ComparisonContent(
            title=f"{name}: estimators compared",
            robot=name,
            qualities=tuple((run.name, run.quality.rows_of_text) for run in ground.runs),
            notes=notes,
            details=details,
            friction=ground.choice,
            findings=ground.findings,
            gains=ground.gains,
            comparison=replace(found, current=register.method_of(file).name),
        )
    )


GivenModel = str | Path | IdentifiedModel  # also a `model.json`, or its folder


def named_models(
    models: Sequence[GivenModel] | Mapping[str, GivenModel],
) -> dict[str, IdentifiedModel]:
    """Models by distinct names: those given, of their files or folders, or `model 1`."""
    if isinstance(models, Mapping):
        return {str(name): load_model(model) for name, model in models.items()}
    names = [_name(model, number) for number, model in enumerate(models, start=1)]
    if len(set(names)) < len(names):
        names = [f"{name} ({k})" for k, name in enumerate(names, 1)]
    return {name: load_model(each) for name, each in zip(names, models, strict=True)}


def _name(model: GivenModel, number: int) -> str:
    if isinstance(model, IdentifiedModel):
        return f"model {number}"
    path = Path(model).absolute()
    if path.name == "model.json":
        return path.parent.name
    return path.stem if path.suffix == ".json" else path.name


@dataclass(frozen=True, eq=False, repr=False)
class ComparedModels(Result):
    """Models side by side."""

    content: ModelsContent  # what the page shows
    page_name, json_name = "models.html", "models.json"

    @property
    def comparison(self) -> ModelComparison:
        """Errors, efforts over time and parameters."""
        return self.content.models

    @property
    def errors(self) -> DataFrame:
        """Errors of predicted efforts, one row per model, log and joint."""
        return frame(self.to_dict()["errors"], "errors")

    @property
    def parameters(self) -> DataFrame:
        """One row per base parameter and model."""
        return frame(self.to_dict()["parameters"], "parameters")

    @property
    def bodies(self) -> DataFrame:
        """Masses and centres, one row per link and model; none of models without link inertias."""
        return frame(self.to_dict()["bodies"], "bodies")

    @property
    def efforts(self) -> DataFrame:
        """Low-passed efforts over time, one row per model, log, joint and sample."""
        return frame(
            [
                {"run": run.run, "model": model.name, "joint": joint, **sample}
                for model in self.comparison.models
                for run in model.runs
                for j, joint in enumerate(self.comparison.joints)
                for sample in records(
                    t=run.t, measured=run.measured[:, j], predicted=run.predicted[:, j]
                )
            ],
            "efforts",
        )

    def report(self) -> str:
        """The report as one self-contained HTML page."""
        return render_sections(COMPARE_MODELS_SECTIONS, self.content, "compared")

    def to_dict(self) -> dict[str, Any]:
        """The numbers as JSON values, as `steelyard compare-models --json` prints them."""
        found: dict[str, Any] = {"robot": self.content.robot}
        for section in COMPARE_MODELS_SECTIONS:
            found |= section.to_dict(self.content)
        return {**found, "notes": [*self.content.notes, *self.content.details]}

    def show(self, console: Console, verbose: bool = False) -> None:
        """Print the errors and the models; with `verbose` every log, parameters and notes."""
        for section in COMPARE_MODELS_SECTIONS:
            parts = [*section.printed(self.content)]
            parts += section.detailed(self.content) if verbose else ()
            for part in parts:
                console.print(part)
            if parts:
                console.print()
        for note in (*self.content.notes, *(self.content.details if verbose else ())):
            console.print(f"note: {note}", markup=False)


@checked()
def compare_models(
    models: Sequence[str | Path | IdentifiedModel] | Mapping[str, str | Path | IdentifiedModel],
    logs: str | Path | Iterable[str | Path],
    *,
    progress: Progress = silent,
) -> ComparedModels:
    """Compare identified models of one robot on logs that they were not identified from.

    Every log is processed as for the first model, so that all models predict the same effort;
    columns, delays and zero offsets are read as each model was identified.

    Args:
        models: At least two models, their `model.json`, or the folders that contain them; a
            mapping gives them names.
        logs: The logs; `run.csv@5:20` is a window in seconds.
        progress: Receives events of progress; an exception from it stops the work.

    Raises:
        SteelyardError: A file cannot be used, or the models are of different robots.

    Example:
        >>> full = identify("arm.toml", "fit.csv")
        >>> small = reduce(full.model, "fit.csv")
        >>> found = compare_models({"full": full.model, "reduced": small.model}, "other.csv")
        >>> sorted(set(found.errors["model"]))
        ['full', 'reduced']
    """
    named = named_models(models)
    if len(named) < 2:
        wrong = f"{len(named)} model is given" if named else "no model is given"
        fix = "give at least two; `steelyard validate` scores a single one"
        raise ModelError(wrong, where="models to compare", fix=fix)
    (first_name, first), *others = named.items()
    for name, other in others:
        refuse_different(first, other, (f"'{first_name}'", f"'{name}'"))
    files = named_logs.log_files(named_logs.paths_of(logs, least=1))
    runs = _runs(named, files, progress)
    found = []
    for number, (name, identified) in enumerate(named.items()):
        report_progress(progress, "comparing models", number, len(named))
        scored = tuple(
            model_errors(identified, run, first, of_logs.was_fitted(identified, log, run))
            for log, run in zip(files, runs[name], strict=True)
        )
        found.append(ComparedModel(name, identified, scored))
    comparison = ModelComparison(tuple(found))
    content = ModelsContent(
        title=f"{first.robot.name}: models compared",
        robot=first.robot.name,
        qualities=tuple((run.name, run.quality.rows_of_text) for run in runs[first_name]),
        models=comparison,
        notes=_notes(named, comparison, runs[first_name]),
        details=of_logs.notes_of(runs[first_name]),
        settings=(("models", ", ".join(named)), ("logs", ", ".join(file.text for file in files))),
    )
    return ComparedModels(content)


def _runs(
    named: Mapping[str, IdentifiedModel],
    files: Sequence[named_logs.LogArgument],
    progress: Progress,
) -> dict[str, tuple[Run, ...]]:
    """The logs as each model reads them, in the processing of the first; read once if alike."""
    first = next(iter(named.values()))
    known: dict[str, tuple[Run, ...]] = {}
    found = {}
    for name, identified in named.items():
        values = json_values(identified.signals)
        key = json.dumps({k: v for k, v in values.items() if k not in ("gains", "unknown_gains")})
        if key not in known:
            known[key] = of_logs.runs_for(first, files, progress, signals=identified.signals)
        found[name] = known[key]
    return found


def _notes(
    named: Mapping[str, IdentifiedModel], comparison: ModelComparison, runs: Sequence[Run]
) -> tuple[str, ...]:
    (first_name, first), *others = named.items()
    notes = []
    for k, run in enumerate(comparison.runs):
        used = [model.name for model in comparison.models if model.runs[k].fitted]
        if used:
            notes.append(f"{run} was used to identify {', '.join(used)}: no validation")
    own = first.processing.to_dict()
    if processed := [name for name, other in others if other.processing.to_dict() != own]:
        notes.append(
            f"logs are processed as for {first_name}; {', '.join(processed)}: identified with "
            "other [processing]"
        )
    kind = first.signals.effort_kind
    alike = (same_efforts(x, first) and x.signals.effort_kind == kind for _, x in others)
    if efforts := [name for (name, _), same in zip(others, alike, strict=True) if not same]:
        notes.append(f"{', '.join(efforts)}: other effort columns than {first_name}")
    return (*notes, *of_logs.dropped_rows(runs))
