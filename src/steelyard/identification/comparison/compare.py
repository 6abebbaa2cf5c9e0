"""Estimators, each judged by runs it was not fitted to: what `steelyard compare` does."""

import json
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console

from steelyard.arguments import checked
from steelyard.identification.comparison.compare_inputs import comparison_inputs, offers_of
from steelyard.identification.job_result import Result, frame
from steelyard.identification.named_logs import paths_of
from steelyard.progress import Progress, silent
from steelyard.report import ReportContent
from steelyard.report.compare_page import render_comparison
from steelyard.report.terminal.compare import comparison_lines
from steelyard.robot_file.loaded import LoadedRobot
from steelyard.validation.compare import compared, scores_of
from steelyard.validation.comparison import Comparison, EstimatorScore

if TYPE_CHECKING:
    from polars import DataFrame


@dataclass(frozen=True, eq=False, repr=False)
class EstimatorComparison(Result):
    """A comparison of estimators.

    Attributes:
        content: What the page shows.
        comparison: Errors of every estimator on left-out runs, and the recommendation.
    """

    content: ReportContent
    comparison: Comparison

    @property
    def untried(self) -> Sequence[str]:
        """Estimators that an interruption left out."""
        return self.comparison.untried

    @property
    def table(self) -> "DataFrame":
        """One row per estimator: its errors on left-out runs, and its time."""
        return frame(self.comparison.to_dict()["estimators"], "table")

    def report(self) -> str:
        """The report as one self-contained HTML page."""
        return render_comparison(self.content)

    def write(self, folder: Path) -> None:
        """Write `compare.html` and `compare.json`."""
        (folder / "compare.html").write_text(self.report(), encoding="utf-8")
        text = json.dumps(self.to_dict(), indent=1, allow_nan=False)
        (folder / "compare.json").write_text(f"{text}\n", encoding="utf-8")

    def to_dict(self) -> dict[str, Any]:
        """The numbers as JSON values, as `steelyard compare --json` prints them."""
        return {**self.comparison.to_dict(), "notes": [*self.content.notes, *self.content.details]}

    def show(self, console: Console, verbose: bool = False) -> None:
        """Print the advice and the table; with `verbose` all of it, and the notes."""
        comparison_lines(self.content, console, verbose)


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
        estimators: Names of estimators; those that neither search nor simulate if empty.
        everything: Without names, all estimators.
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
    cores = threads or os.cpu_count() or 1
    inputs = comparison_inputs(robot, paths_of(logs, least=1), check, cores, progress, fixed_base)
    scores: list[EstimatorScore] = []
    try:
        for score in scores_of(offers, inputs.context, inputs.parts, progress=progress):
            scores.append(score)
    except interruption:
        if not scores:
            raise
    found = compared(scores, offers, inputs.context, inputs.parts)
    found = replace(found, lines=inputs.lines)
    return EstimatorComparison(inputs.content(found), found)
