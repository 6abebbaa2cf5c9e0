"""Logs as runs for an identified model: read as for its fit, and whether they were in it."""

from collections.abc import Sequence
from dataclasses import replace

from steelyard.base.progress import Progress
from steelyard.estimate.identified_model import IdentifiedModel, Provenance
from steelyard.identify.repeated_motion import repeat_of
from steelyard.robot.file.signals import Signals
from steelyard.runs.processing_choices import Processing
from steelyard.runs.run import Run
from steelyard.runs.runs_of_named_logs import LogArgument, overlap, prepared, recording_of, sha256
from steelyard.runs.spectrum_and_period import Repetitions


def fitted_before(origin: Provenance, log: LogArgument) -> bool:
    """Whether a model was identified from samples of this log, whatever it is called now."""
    inputs = {h for role, h in origin.inputs.items() if role.startswith("identification ")}
    if sha256(log.path) not in inputs:
        return False
    names = [run.rpartition("/")[2] for run in origin.runs]
    cuts = [name.removeprefix(log.path.stem) for name in names if name.startswith(log.path.stem)]
    return not cuts or any(overlap(log, LogArgument(f"{log.path}{cut}", log.path)) for cut in cuts)


def was_fitted(identified: IdentifiedModel, log: LogArgument, run: Run) -> bool:
    """Whether the model was identified from this log, or from rows of its run in another one."""
    if fitted_before(identified.provenance, log):
        return True
    repeat = repeat_of(identified.motions, run)
    return repeat is not None and repeat.same


def processing_of(identified: IdentifiedModel) -> Processing:
    """How logs are read for a model: as those were that it was identified from, without a mean."""
    return replace(
        identified.processing,
        motion_cutoff=identified.cutoffs.motion,
        matched_cutoff=identified.cutoffs.matched,
        repetitions=None,
    )


def runs_for(
    identified: IdentifiedModel,
    logs: Sequence[LogArgument],
    progress: Progress,
    *,
    signals: Signals | None = None,
    at_rest: bool = True,
    repetitions: Repetitions | None = None,
) -> tuple[Run, ...]:
    """Logs as runs for a model, read by its signals unless others are given, and averaged if so."""
    recordings = [recording_of(log, signals or identified.signals) for log in logs]
    processing = replace(processing_of(identified), repetitions=repetitions)
    return prepared(recordings, processing, progress, at_rest=at_rest)
