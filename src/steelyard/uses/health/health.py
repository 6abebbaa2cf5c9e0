"""What drifted in a robot, from logs of its operation: what `steelyard health` does."""

import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from steelyard.base.arguments import checked
from steelyard.base.errors import LogError
from steelyard.base.progress import Progress, silent
from steelyard.estimate.friction.mixes import has_memory
from steelyard.estimate.identified import IdentifiedModel, load_model
from steelyard.estimate.information.gather import gather
from steelyard.estimate.information.regressor import base_regressor
from steelyard.estimate.scores.residuals import residual_cutoff, residual_trace
from steelyard.identify.run_notes import notes_of
from steelyard.identify.scores import processing_of
from steelyard.report.result import Result
from steelyard.runs.named_logs import (
    log_files,
    paths_of,
    prepared,
    recording_of,
    refuse_overlaps,
)
from steelyard.uses.health.health_changes import HealthChange, changes_of
from steelyard.uses.health.health_page import HealthContent, health_lines, render_health
from steelyard.uses.health.health_windows import LEAST_WINDOW, MOST_WINDOWS_OF_LOG, series_of
from steelyard.uses.other_efforts import refuse_other_efforts
from steelyard.uses.payload.payload_of_runs import payload_words, unknown_payload

if TYPE_CHECKING:
    from rich.console import Console


@dataclass(frozen=True, eq=False, repr=False)
class Health(Result):
    """Friction, offsets and effort scales of a robot over windows and logs.

    Attributes:
        content: All that the page shows.
    """

    content: HealthContent
    json_name = "health.json"

    @property
    def drifts(self) -> tuple[HealthChange, ...]:
        """What drifted, the most certain first."""
        return self.content.drifts

    @property
    def unproven(self) -> tuple[HealthChange, ...]:
        """What differs by far from the model, or between logs too short to prove a drift."""
        return self.content.unproven

    def report(self) -> str:
        """The report as one self-contained HTML page."""
        return render_health(self.content)

    def to_dict(self) -> dict[str, Any]:
        """What drifted, what was tested, and the values of all windows as JSON values."""
        content = self.content
        return {
            "logs": list(content.logs),
            "drifts": [change.to_dict() for change in content.drifts],
            "unproven": [change.to_dict() for change in content.unproven],
            "tested": [change.to_dict() for change in content.changes],
            "windows": [
                {
                    "joint": one.joint,
                    "quantity": one.quantity,
                    "unit": one.unit or None,
                    "log": [content.logs[int(k)] for k in one.log],
                    "t_s": one.t.tolist(),
                    "change": one.value.tolist(),
                    "std": one.std.tolist(),
                }
                for one in content.series
            ],
            "warnings": list(content.limits),
            "notes": list(content.notes),
        }

    def show(self, console: "Console") -> None:
        """Print what drifted, and one line per joint."""
        health_lines(self.content, console)


@checked()
def health(
    model: str | Path | IdentifiedModel,
    logs: str | Path | Iterable[str | Path],
    *,
    progress: Progress = silent,
) -> Health:
    """Detect drift of friction, offsets and effort scales over windows of logs.

    Args:
        model: The model, its `model.json`, or the folder that contains it.
        logs: Logs of normal operation, in the order of time.
        progress: Receives events of progress; an exception from it stops the work.

    Raises:
        SteelyardError: A file cannot be used, shows no joint's friction, or the effort of a joint
            has the reversed sign.

    Example:
        >>> found = health("arm-model", "other.csv")
        >>> found.drifts
        ()
    """
    identified = load_model(model)
    files = log_files(paths_of(logs, least=1))
    refuse_overlaps(files, [])
    recordings = [recording_of(log, identified.signals) for log in files]
    runs = prepared(recordings, processing_of(identified), progress)
    cutoff = residual_cutoff(identified, runs)
    sigma = np.asarray(identified.estimate.sigma)
    regressor, rests = base_regressor(identified.model), has_memory(identified.model.terms)
    threads, found, carried = os.cpu_count() or 1, [], []
    for run in runs:
        refuse_other_efforts(residual_trace(identified, run, cutoff), sigma, identified.joints)
        whole = gather(regressor, run, rests=rests, threads=threads, progress=progress)
        count = int(run.duration / LEAST_WINDOW)
        found.append(whole.merged(max(1, min(MOST_WINDOWS_OF_LOG, count))))
        payload = unknown_payload(identified, whole)
        carried += [] if payload is None else [payload_words(payload, run.name)]
    series, names = series_of(identified, found), [run.name for run in runs]
    if not series:
        raise LogError(
            "no window shows friction, offset and bodies of a joint separately",
            where=", ".join(names),
            fix="give longer logs, or motion in both directions at several speeds and postures",
        )
    robot = identified.model.robot
    content = HealthContent(
        robot=robot.name,
        joints=robot.joint_names,
        logs=tuple(names),
        series=series,
        changes=changes_of(series, names),
        warnings=tuple(carried),
        notes=notes_of(runs),
    )
    return Health(content)
