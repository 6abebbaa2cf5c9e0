"""The way of the data that commands share: logs named on the command line to runs and scores."""

from collections.abc import Sequence
from dataclasses import replace

from steelyard.estimation.identified import IdentifiedModel
from steelyard.identification.named_logs import (
    LogArgument,
    _overlap,
    prepared,
    recording_of,
    sha256,
)
from steelyard.measurement import Processing, Run
from steelyard.progress import Progress, report_progress
from steelyard.validation.bands import Bands
from steelyard.validation.headline import effort_reference
from steelyard.validation.score import RunScore, score
from steelyard.validation.torque_parts import TorqueSplit


def fitted_before(identified: IdentifiedModel, log: LogArgument) -> bool:
    """Whether the model was identified from samples of this log, whatever it is called now."""
    origin = identified.provenance
    inputs = {h for role, h in origin.inputs.items() if role.startswith("identification ")}
    if sha256(log.path) not in inputs:
        return False
    names = [run.rpartition("/")[2] for run in origin.runs]
    cuts = [name.removeprefix(log.path.stem) for name in names if name.startswith(log.path.stem)]
    return not cuts or any(_overlap(log, LogArgument(f"{log.path}{cut}", log.path)) for cut in cuts)


def processing_of(identified: IdentifiedModel) -> Processing:
    """How logs are read for a model: as those were that it was identified from, without a mean."""
    return replace(
        identified.processing,
        motion_cutoff=identified.cutoffs.motion,
        matched_cutoff=identified.cutoffs.matched,
        repetitions=None,
    )


def scored(
    identified: IdentifiedModel, runs: Sequence[Run], progress: Progress
) -> tuple[RunScore, ...]:
    """Scores of a model on runs, with the nominal model beside it."""
    gains, cutoff, bands = identified.signals.gains, identified.cutoffs.score, Bands.of(identified)
    prior, reference = identified.model.prior, effort_reference(identified)
    split, scores = TorqueSplit(identified.valued), []
    for number, run in enumerate(runs):
        report_progress(progress, "validating", number, len(runs))
        scores.append(score(identified.valued, run, gains, cutoff, prior, bands, split, reference))
    return tuple(scores)


def scored_from_commanded(
    identified: IdentifiedModel,
    logs: Sequence[LogArgument],
    names: Sequence[str],
    progress: Progress,
) -> tuple[RunScore, ...]:
    """Scores of a model whose efforts are predicted from the commanded motion of logs.

    Args:
        identified: The model.
        logs: The logs.
        names: Names of their runs.
        progress: Told about every log.

    Raises:
        ModelError: The columns of the commanded motion are not known.
        LogError: A log has no such columns.
    """
    signals = identified.signals.of_commanded()
    recordings = [recording_of(log, signals) for log in logs]
    runs = prepared(recordings, processing_of(identified), progress, at_rest=True)
    named = [replace(run, name=name) for run, name in zip(runs, names, strict=True)]
    return tuple(
        replace(score, predicted_from="commanded") for score in scored(identified, named, progress)
    )
