"""What a robot carries, from logs and an identified model: what `steelyard payload` does."""

import os
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

from steelyard.application.payload import identify_payload as payload_of
from steelyard.arguments import checked
from steelyard.estimation.identified import IdentifiedModel, load_model
from steelyard.estimation.payload.load import PayloadEstimate
from steelyard.estimation.payload.load_case import carrier
from steelyard.identification.descriptions import dropped
from steelyard.identification.logs import (
    LogArgument,
    fitted_before,
    log_files,
    prepared,
    processing_of,
    recording_of,
    refuse_overlaps,
)
from steelyard.identification.result import paths_of
from steelyard.progress import Progress, silent
from steelyard.regression.gather import gather
from steelyard.regression.regressor import base_regressor
from steelyard.validation.friction.mixes import remembers


@dataclass(frozen=True, eq=False)
class PayloadTask:
    """Logs with a payload, and the model; checked as far as that is possible before reading.

    Attributes:
        identified: The model.
        loaded: Logs with the payload.
        unloaded: Logs without it.
        frame: Frame of the results; that of the last link if `None`.
    """

    identified: IdentifiedModel
    loaded: list[LogArgument]
    unloaded: list[LogArgument]
    frame: str | None

    def done(self, gain_uncertainty: float | None, progress: Progress) -> PayloadEstimate:
        """The estimate, with the model's cut-off frequencies."""
        identified, count = self.identified, len(self.loaded)
        recordings = [
            recording_of(log, identified.signals) for log in (*self.loaded, *self.unloaded)
        ]
        regressor, threads = base_regressor(identified.model), os.cpu_count() or 1
        runs = prepared(recordings, processing_of(identified), progress)
        rests = remembers(identified.model.terms)
        of_runs = [
            gather(regressor, run, rests=rests, threads=threads, progress=progress) for run in runs
        ]
        found = payload_of(
            identified, of_runs[:count], self.frame, unloaded=of_runs[count:], gain=gain_uncertainty
        )
        notes = (*found.notes, *dropped(identified.model, runs), *self._fitted_before())
        return replace(found, notes=notes)

    def _fitted_before(self) -> tuple[str, ...]:
        """A log that the model was identified from weighs nothing against it."""
        return tuple(
            f"the model was identified from {log.path.name}: compared with itself it has no payload"
            for log in self.loaded
            if not self.unloaded and fitted_before(self.identified, log)
        )


def payload_inputs(
    model: str | Path | IdentifiedModel,
    logs: str | Path | Iterable[str | Path],
    frame: str | None,
    unloaded: str | Path | Iterable[str | Path],
) -> PayloadTask:
    """The model and the logs; the arguments and errors are those of `identify_payload`."""
    identified = load_model(model)
    carrier(identified.model.robot, frame)
    with_it, without = log_files(paths_of(logs, least=1)), log_files(paths_of(unloaded))
    refuse_overlaps([*with_it, *without], [])
    return PayloadTask(identified, with_it, without, frame)


@checked()
def identify_payload(
    model: str | Path | IdentifiedModel,
    logs: str | Path | Iterable[str | Path],
    frame: str | None = None,
    *,
    unloaded: str | Path | Iterable[str | Path] = (),
    gain_uncertainty: float | None = None,
    progress: Progress = silent,
) -> PayloadEstimate:
    """Identify a payload: mass, centre of mass and inertia, with 95 % intervals.

    Args:
        model: The model, its `model.json`, or the folder that contains it.
        logs: Logs with the payload.
        frame: Frame of the results; that of the last link if `None`.
        unloaded: Logs without the payload: arm and payload are then identified together.
        gain_uncertainty: Relative standard deviation of each drive gain; if `None`, 0.02 for
            currents, or 0 if effort scales were identified with the model.
        progress: Receives events of progress; an exception from it stops the work.

    Raises:
        SteelyardError: A file cannot be used, or there is no such frame.

    Example:
        >>> carried = identify_payload("arm-model", "other.csv")
        >>> abs(carried.mass) < 0.1
        True
    """
    return payload_inputs(model, logs, frame, unloaded).done(gain_uncertainty, progress)
