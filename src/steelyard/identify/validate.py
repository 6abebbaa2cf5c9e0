"""How well a model predicts other logs: what `steelyard validate` and `residuals` do."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from steelyard.base.arrays import Array, frozen
from steelyard.base.checked_arguments import checked
from steelyard.base.errors import DataError
from steelyard.base.progress import Progress, silent
from steelyard.check.findings_text_and_page import finding_dict
from steelyard.check.fitted.fitted_case_causes_and_constraints import FittedCase
from steelyard.check.fitted.post_fit_checks import examine_fit, kept_doubts
from steelyard.estimate.identified_model import IdentifiedModel, load_model
from steelyard.estimate.information.gather import Mask
from steelyard.estimate.scores.effort_errors import (
    band_of,
    effort_reference,
    joints_moving,
    known_efforts,
)
from steelyard.estimate.scores.model_comparison import units_of
from steelyard.estimate.scores.score import RunScore, low_passed, no_closed_sample
from steelyard.identify import runs_and_notes_of_logs as of_logs
from steelyard.identify.page.report_content_and_error_words import ReportContent
from steelyard.identify.repeated_motion_and_validation_split import marked_repeats
from steelyard.identify.scores_and_model_report import ModelReport, scored, scored_from_commanded
from steelyard.identify.verdict_and_next_steps import verdict
from steelyard.report.result import DataFrame, Result, frame
from steelyard.runs.run import Run
from steelyard.runs.runs_of_named_logs import log_file, log_files, paths_of


@dataclass(frozen=True, eq=False, repr=False)
class Validation(ModelReport):
    """Errors of a model on logs."""

    write = Result.write

    def to_dict(self) -> dict[str, Any]:
        """The verdict, and under `logs` the scores of each log, in the order of the logs."""
        order = [name for name, _ in self.content.qualities]
        found = [self._result(score, fitted=False) for score in self.content.scores]
        found += [self._result(score, fitted=True) for score in self.content.fitted]
        found.sort(key=lambda one: order.index(one["run"]))
        return {"verdict": self.verdict.to_dict(), "logs": found}

    def _result(self, score: RunScore, *, fitted: bool) -> dict[str, Any]:
        others = {name for name, _ in self.content.qualities} - {"", score.run}
        own = replace(
            self.content,
            scores=() if fitted else (score,),
            fitted=(score,) if fitted else (),
            limitations=tuple(x for x in self.content.limitations if x.log not in others),
        )
        return {
            **score.to_dict(),
            "fitted": fitted,
            "verdict": verdict(own).to_dict(),
            "limitations": [finding_dict(finding) for finding in own.limitations],
        }


@checked()
def validate(
    model: str | Path | IdentifiedModel,
    logs: str | Path | Iterable[str | Path],
    *,
    commanded: bool = False,
    progress: Progress = silent,
) -> Validation:
    """Score an identified model on logs that it was not fitted to.

    Args:
        model: The model, its `model.json`, or the folder that contains it.
        logs: The logs; `run.csv@5:20` is a window in seconds.
        commanded: Predict the efforts from the commanded motion (`commanded_position` in the robot
            file), as feedforward would.
        progress: Receives events of progress; an exception from it stops the work.

    Raises:
        SteelyardError: A file cannot be used.

    Example:
        >>> scored = validate("arm-model", "other.csv")
        >>> scored.scores["percent_of_used"].max() < 10.0
        True
    """
    identified = load_model(model)
    files = log_files(paths_of(logs, least=1))
    runs = of_logs.runs_for(identified, files, progress)
    scores = (
        scored_from_commanded(identified, files, [run.name for run in runs], progress)
        if commanded
        else scored(identified, runs, progress)
    )
    scores = marked_repeats(identified, runs, scores)
    fitted, fresh = list[RunScore](), list[tuple[Run, RunScore]]()
    for log, run, score in zip(files, runs, scores, strict=True):
        if of_logs.was_fitted(identified, log, run):
            fitted.append(score)
        else:
            fresh.append((run, score))
    # checks compare with the measured motion, not with a commanded one
    unseen = [(run, score) for run, score in fresh if score.predicted_from == "measured"]
    runs_of, scores_of = tuple(run for run, _ in unseen), tuple(score for _, score in unseen)
    found = examine_fit(FittedCase(identified, unseen=runs_of, unseen_scores=scores_of))
    known = {(one.check, one.says) for one in found}
    kept = (one for one in kept_doubts(identified) if (one.check, one.says) not in known)
    open_loops = of_logs.dropped(identified.model, runs)
    content = ReportContent(
        title=f"{identified.model.robot.name}: validation",
        robot=identified.model.robot.name,
        identified=identified,
        scores=tuple(score for _, score in fresh),
        fitted=tuple(fitted),
        qualities=tuple((run.name, run.quality.rows_of_text) for run in runs),
        notes=(
            *of_logs.dropped_rows(runs),
            *of_logs.first_dropped(open_loops),
            *of_logs.commanded_note(identified, scores),
            *(f"{score.run} was fitted: its score does not validate the model" for score in fitted),
        ),
        details=(*of_logs.notes_of(runs), *open_loops[1:]),
        settings=of_logs.settings(identified),
        limitations=(*kept, *found),
        logs={run.name: log.text for run, log in zip(runs, files, strict=True)},
        only_errors=True,
    )
    return Validation(content)


@dataclass(frozen=True, eq=False, repr=False)
class Residuals:
    """Efforts along a log, measured and predicted, both behind one zero-phase low-pass.

    Every sample is there from the first to the last motion. With estimated scales of the efforts,
    the measured ones are divided by them.
    """

    run: str  # name of the log
    joints: tuple[str, ...]  # names of the joints, in the order of the columns
    # unit of each joint's efforts: Nm or N; the logged unit without a known drive gain
    units: tuple[str, ...]
    cutoff: float  # of the low-pass [Hz]
    t: Array  # time, shape `(N,)` [s]
    measured: Array  # measured effort, shape `(N, n)`
    predicted: Array  # effort predicted by the model, shape `(N, n)`
    moving: Mask  # whether each joint moves by the log alone, shape `(N, n)`

    @property
    def residual(self) -> Array:
        """Measured minus predicted effort, shape `(N, n)`."""
        return self.measured - self.predicted

    @property
    def counted(self) -> Mask:
        """Samples that the errors are computed from, shape `(N, n)`.

        Where a joint moves; all of a joint that rests.
        """
        return self.moving | ~joints_moving(self.moving.sum(axis=0))

    @property
    def error(self) -> Array:
        """Root mean square of the residual over the `counted` samples, shape `(n,)`."""
        squares = np.where(self.counted, self.residual**2, 0.0)
        return np.asarray(np.sqrt(squares.sum(axis=0) / self.counted.sum(axis=0)))

    @property
    def table(self) -> DataFrame:
        """A Polars data frame with one row per sample and joint.

        Raises:
            PackageError: Polars is not installed.
        """
        count, n = self.measured.shape
        columns = {
            "t": np.repeat(self.t, n),
            "joint": list(self.joints) * count,
            "measured": self.measured.ravel(),
            "predicted": self.predicted.ravel(),
            "residual": self.residual.ravel(),
            "unit": list(self.units) * count,
            "moving": self.moving.ravel(),
        }
        return frame(columns, "residuals")

    def __repr__(self) -> str:
        errors = zip(self.joints, self.error, self.units, strict=True)
        listed = ", ".join(f"{joint} {error:.3g} {unit}" for joint, error, unit in errors)
        return f"Residuals({self.run}, below {self.cutoff:g} Hz: {listed})"


@checked()
def residuals(
    model: str | Path | IdentifiedModel,
    log: str | Path,
    *,
    cutoff: float | None = None,
    progress: Progress = silent,
) -> Residuals:
    """Measured and predicted efforts of a log, in the band and the unit of the printed errors.

    `error` is then what `identify` and `validate` print for each joint.

    Args:
        model: The model, its `model.json`, or the folder that contains it.
        log: The log; `run.csv@5:20` is a window in seconds.
        cutoff: Of the low-pass of measured and predicted efforts [Hz]; that of the printed errors
            (5 Hz, unless the robot file says otherwise) if `None`.
        progress: Receives events of progress; an exception from it stops the work.

    Raises:
        SteelyardError: A file cannot be used, or the cut-off is too high for the log's rate.

    Example:
        >>> found = residuals("arm-model", "other.csv")
        >>> found.residual.shape == found.measured.shape == (len(found.t), 2)
        True
        >>> printed = validate("arm-model", "other.csv").scores["error"]
        >>> bool(abs(found.error - printed.to_numpy()).max() < 1e-9)
        True
    """
    if cutoff is not None and not cutoff > 0.0:
        wrong = f"a low-pass of {cutoff:g} Hz passes nothing"
        fix = "give a positive frequency, or None for that of the printed errors"
        raise DataError(wrong, where="cutoff of residuals", fix=fix)
    identified = load_model(model)
    (file,) = map(log_file, paths_of(log))
    (run,) = of_logs.runs_for(identified, [file], progress)
    gains = identified.signals.gains
    band = band_of(effort_reference(identified), run.rate) if cutoff is None else cutoff
    found = [(x.t, x.counted, x.efforts) for x in low_passed([identified.valued], run, gains, band)]
    if not found:
        raise no_closed_sample(identified.valued, run)
    t, moving, efforts = (np.concatenate(some, axis=-1) for some in zip(*found, strict=True))
    measured, predicted = efforts * np.where(known_efforts(identified), gains, 1.0)[:, None]
    about = run.name, identified.joints, units_of(identified), band
    return Residuals(*about, frozen(t), frozen(measured.T), frozen(predicted.T), moving.T)
