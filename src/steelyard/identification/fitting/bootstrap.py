"""`steelyard identify --bootstrap`: the same estimate of windows of time drawn again."""

from dataclasses import replace

from steelyard.errors import DataError
from steelyard.estimation.least_squares.bootstrap import bootstrap
from steelyard.identification.fitting.fitting import Fit
from steelyard.progress import Progress
from steelyard.report import ReportContent


def drawn_again(content: ReportContent, fit: Fit, draws: int, progress: Progress) -> ReportContent:
    """What the report shows, with the draws beside it; a note where the data are too few for it.

    Args:
        content: The report so far.
        fit: The result.
        draws: How often windows are drawn.
        progress: Told about every draw.
    """
    if fit.method.needs != "information":
        of = "samples" if fit.method.needs == "samples" else "whole runs"
        why = f"{fit.method.name} needs {of}, which cannot be resampled"
        return replace(content, notes=(*content.notes, f"no bootstrap: {why}"))
    try:
        found = bootstrap(fit.estimator, fit.information, draws=draws, progress=progress)
    except DataError as error:
        return replace(content, notes=(*content.notes, f"no bootstrap: {error.wrong}"))
    return replace(content, bootstrap=found)
