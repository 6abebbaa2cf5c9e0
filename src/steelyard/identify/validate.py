"""How well a model predicts other logs: what `steelyard validate` does."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from steelyard.base.checked_arguments import checked
from steelyard.base.progress import Progress, silent
from steelyard.check.findings_text_and_page import finding_dict
from steelyard.check.fitted.fitted_case_causes_and_constraints import FittedCase
from steelyard.check.fitted.post_fit_checks import examine_fit, kept_doubts
from steelyard.estimate.identified_model import IdentifiedModel, load_model
from steelyard.estimate.scores.score import RunScore
from steelyard.identify.page.report_content import ReportContent
from steelyard.identify.provenance_and_notes import (
    commanded_note,
    dropped,
    dropped_rows,
    first_dropped,
    notes_of,
    settings,
)
from steelyard.identify.repeated_motion import marked_repeats
from steelyard.identify.runs_for_model import runs_for, was_fitted
from steelyard.identify.scores_and_model_report import ModelReport, scored, scored_from_commanded
from steelyard.identify.verdict_and_next_steps import verdict
from steelyard.report.result import Result
from steelyard.runs.run import Run
from steelyard.runs.runs_of_named_logs import log_files, paths_of


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
        order = [name for name, _ in self.content.qualities]
        own = replace(
            self.content,
            scores=() if fitted else (score,),
            fitted=(score,) if fitted else (),
            limitations=tuple(
                one
                for one in self.content.limitations
                if one.log in ("", score.run) or one.log not in order
            ),
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
    runs = runs_for(identified, files, progress)
    scores = (
        scored_from_commanded(identified, files, [run.name for run in runs], progress)
        if commanded
        else scored(identified, runs, progress)
    )
    scores = marked_repeats(identified, runs, scores)
    fitted, fresh = list[RunScore](), list[tuple[Run, RunScore]]()
    for log, run, score in zip(files, runs, scores, strict=True):
        if was_fitted(identified, log, run):
            fitted.append(score)
        else:
            fresh.append((run, score))
    unseen = [(run, score) for run, score in fresh if score.predicted_from == "measured"]
    case = FittedCase(  # checks compare with the measured motion, not with a commanded one
        identified,
        unseen=tuple(run for run, _ in unseen),
        unseen_scores=tuple(score for _, score in unseen),
    )
    found = examine_fit(case)
    known = {(one.check, one.says) for one in found}
    kept = (one for one in kept_doubts(identified) if (one.check, one.says) not in known)
    open_loops = dropped(identified.model, runs)
    content = ReportContent(
        title=f"{identified.model.robot.name}: validation",
        robot=identified.model.robot.name,
        identified=identified,
        scores=tuple(score for _, score in fresh),
        fitted=tuple(fitted),
        qualities=tuple((run.name, run.quality.rows_of_text) for run in runs),
        notes=(
            *dropped_rows(runs),
            *first_dropped(open_loops),
            *commanded_note(identified, scores),
            *(f"{score.run} was fitted: its score does not validate the model" for score in fitted),
        ),
        details=(*notes_of(runs), *open_loops[1:]),
        settings=settings(identified),
        limitations=(*kept, *found),
        logs={run.name: log.text for run, log in zip(runs, files, strict=True)},
        only_errors=True,
    )
    return Validation(content)
