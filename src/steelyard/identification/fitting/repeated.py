"""Repeated estimations: of each log alone, or of models that were identified one by one."""

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console

from steelyard.arguments import checked
from steelyard.errors import DataError
from steelyard.estimation.estimate import Estimate
from steelyard.estimation.identified import IdentifiedModel, load_model
from steelyard.estimation.repeated import RepeatedEstimates
from steelyard.identification.fitting.fitting import Fit
from steelyard.identification.job_result import frame
from steelyard.progress import Progress, report_progress
from steelyard.report import ReportContent
from steelyard.report.sections.estimation.repeated import repeated_table
from steelyard.report.sections.tables import text_table

if TYPE_CHECKING:
    from polars import DataFrame


@dataclass(frozen=True, eq=False)
class Repeated:
    """Mean and scatter of repeated estimations; `print` it.

    Attributes:
        estimates: The estimates.
    """

    estimates: RepeatedEstimates

    @property
    def table(self) -> "DataFrame":
        """One row per parameter: mean, standard deviation, and one column per estimation."""
        return frame(flat_rows(self.estimates), "table")

    def to_dict(self) -> dict[str, Any]:
        """As JSON values."""
        return self.estimates.to_dict()

    def csv(self) -> str:
        """The table as CSV."""
        return repeated_csv(self.estimates)

    def __str__(self) -> str:
        text = io.StringIO()
        shown = text_table(repeated_table(self.estimates), "Repeated estimations")
        Console(file=text, width=120).print(shown)
        return text.getvalue()


@checked()
def repeated(
    models: Sequence[str | Path | IdentifiedModel], *, population: bool = False
) -> Repeated:
    """Mean and relative standard deviation of the parameters of models identified one by one.

    Args:
        models: Two or more models of one robot: each a model, its `model.json`, or the folder that
            contains it.
        population: Whether standard deviations are those of the population (1/N) instead of the
            sample (1/(N - 1)).

    Raises:
        SteelyardError: A model cannot be read, there are fewer than two, or a parameter of the same
            name is another combination in one of them.

    Example:
        >>> found = repeated(["arm-model", "arm-model"])
        >>> found.table["std"].max()
        0.0
    """
    known = [load_model(model) for model in models]
    _refuse_other_groups(known)
    estimates = {str(number): model.estimate for number, model in enumerate(known, start=1)}
    return Repeated(RepeatedEstimates.of(estimates, population=population))


def _refuse_other_groups(models: Sequence[IdentifiedModel]) -> None:
    """A base parameter of one name is the same combination in all models.

    Raises:
        DataError: It is not.
    """
    groups: dict[str, str] = {}
    for number, model in enumerate(models, start=1):
        for k, name in enumerate(model.base.base_names):
            group = groups.setdefault(name, model.base.grouping(k))
            if group != model.base.grouping(k):
                raise DataError(
                    f"the base parameter '{name}' of model {number} is the combination "
                    f"{model.base.grouping(k)}, that of another one {group}",
                    where="repeated estimations",
                    fix="identify all models of the same robot with the same terms",
                )


def of_each_log(content: ReportContent, fit: Fit, progress: Progress) -> ReportContent:
    """What the report shows, with estimates from each log alone; notes on logs without one.

    Args:
        content: The report so far.
        fit: The result; laws, their fields and gains stay what they are.
        progress: Told about every log.
    """
    estimates, notes = dict[str, Estimate](), list[str]()
    for number, run in enumerate(fit.runs):
        report_progress(progress, "estimating from each log", number, len(fit.runs))
        own = [k for k, window in enumerate(fit.information.windows) if window.run == run.name]
        information = fit.information.of(own)
        try:
            estimates[run.name] = fit.estimating((run,), information)(information)
        except DataError as error:
            notes.append(f"no estimate from {run.name} alone: {error.wrong}")
    try:
        found = RepeatedEstimates.of(estimates)
    except DataError as error:
        notes.append(f"no scatter over logs: {error.wrong}")
        return replace(content, notes=(*content.notes, *notes))
    return replace(content, repeated=found, notes=(*content.notes, *notes))


def flat_rows(found: RepeatedEstimates) -> list[dict[str, Any]]:
    """One row per parameter, one column per estimation."""
    return [
        {key: value for key, value in row.items() if key != "values"}
        | dict(zip(found.labels, row["values"], strict=True))
        for row in found.rows()
    ]


def repeated_csv(found: RepeatedEstimates) -> str:
    """The rows as CSV."""
    text = io.StringIO()
    rows = flat_rows(found)
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()
