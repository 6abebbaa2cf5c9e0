"""Logs as runs for an identified model, where it comes from, and notes on what was left out."""

from collections.abc import Sequence
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

from steelyard.base.progress import Progress
from steelyard.estimate.identified_model import IdentifiedModel, Provenance
from steelyard.estimate.scores.score import RunScore
from steelyard.identify.repeated_motion_and_validation_split import repeat_of
from steelyard.logs.log_and_errors import parse_log_argument
from steelyard.model.model import Model
from steelyard.robot.file.model_reading_and_loaded_robot import LoadedRobot
from steelyard.robot.file.signals import Signals
from steelyard.runs.processing_choices import Processing
from steelyard.runs.run import Run, open_stretches
from steelyard.runs.runs_of_named_logs import LogArgument, overlap, prepared, recording_of, sha256
from steelyard.runs.spectrum_and_period import Repetitions


def fitted_before(origin: Provenance, log: LogArgument) -> bool:
    """Whether a model was identified from samples of this log, whatever it is called now."""
    own, role = sha256(log.path), "identification "
    files = [
        k.removeprefix(role) for k, h in origin.inputs.items() if h == own and k.startswith(role)
    ]
    if not files:
        return False
    names = [run.rpartition("/")[2] for run in origin.runs]
    stems = {Path(file).stem for file in files}
    cuts = [name.removeprefix(x) for x in stems for name in names if name.startswith(x)]
    return not cuts or any(
        overlap(log.cut, parse_log_argument(f"{log.path}{cut}")[1]) for cut in cuts
    )


def was_fitted(identified: IdentifiedModel, log: LogArgument, run: Run) -> bool:
    """Whether the model was identified from this log, or from rows of its run in another one."""
    if fitted_before(identified.provenance, log):
        return True
    repeat = repeat_of(identified.motions, run)
    return repeat is not None and repeat.same


def processing_of(identified: IdentifiedModel) -> Processing:
    """How logs are read for a model: as those were that it was identified from, without a mean."""
    cutoffs = identified.cutoffs
    own = replace(identified.processing, motion_cutoff=cutoffs.motion, repetitions=None)
    return replace(own, matched_cutoff=cutoffs.matched)


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


LISTED_TIMES = 5  # times that are listed, at most


def provenance(
    loaded: LoadedRobot,
    fitted: Sequence[LogArgument],
    carrying: Sequence[LogArgument],
    validated: Sequence[LogArgument],
    runs: Sequence[Run],
    notes: Sequence[str],
) -> Provenance:
    """Hashes of all inputs, and what was decided on the way."""
    inputs = {f"robot {s.path.name}": s.sha256 for s in loaded.sources}
    for role, logs in (("identification", fitted), ("loaded", carrying), ("validation", validated)):
        for path in dict.fromkeys(log.path for log in logs):
            name = f"{role} {path.name}"
            more = sum(key == name or key.startswith(f"{name} (") for key in inputs)
            inputs[f"{name} ({more + 1})" if more else name] = sha256(path)
    return Provenance(version("steelyard"), inputs, tuple(r.name for r in runs), tuple(notes))


def settings(identified: IdentifiedModel) -> tuple[tuple[str, str], ...]:
    """Settings as label and value."""
    signals, cutoffs = identified.signals, identified.cutoffs
    found = signals.unknown_gains or (False,) * signals.n
    each = (f"{g:.4g}" if own else f"{g:g}" for g, own in zip(signals.gains, found, strict=True))
    gains = f"gains {', '.join(each)}"
    if identified.effort_scales is not None:
        gains += ", divided by the estimated scales"
    if signals.effort_map is not None:
        gains = "of the motors, with coupled gears"
    return (
        ("estimator", identified.estimate.estimator),
        ("motion cut-off (positions, velocities, accelerations)", f"{cutoffs.motion:g} Hz"),
        ("regression cut-off (regressor and effort)", f"{cutoffs.matched:g} Hz"),
        ("cut-off of the verdict (measured and predicted effort)", f"{cutoffs.headline:g} Hz"),
        ("cut-off of plots and other errors", f"{cutoffs.score:g} Hz"),
        ("velocities", "logged" if signals.velocity else "differentiated positions"),
        ("motion", f"by {identified.processing.motion_words}"),
        ("efforts", identified.processing.effort_words),
        ("effort", f"{signals.effort_kind.replace('_', ' ')}, {gains}"),
    )


def dropped_rows(runs: Sequence[Run]) -> tuple[str, ...]:
    """One line for each run with invalid rows."""
    return tuple(f"{run.name}: {words}" for run in runs if (words := run.quality.dropped_rows))


def left_out_stretches(runs: Sequence[Run]) -> tuple[str, ...]:
    """One line for each stretch of a run that is left out."""
    pairs = ((run, stretch) for run in runs for stretch in run.recording.left_out)
    return tuple(f"{run.name}: {x.words(run.recording.signals.effort)}" for run, x in pairs)


def left_out(run: Run) -> tuple[str, ...]:
    """One line if rows of a run were dropped or times of it are not examined."""
    quality = run.quality
    times = [f"{start:.2f} to {stop:.2f} s" for start, stop in quality.unexamined]
    more = f" and {len(times) - LISTED_TIMES} more times" if len(times) > LISTED_TIMES else ""
    words = [quality.dropped_rows] if quality.dropped else []
    if times:
        words.append(f"not examined: {', '.join(times[:LISTED_TIMES])}{more}")
    return (f"{run.name}: {'; '.join(words)}",) if words else ()


def commanded_note(identified: IdentifiedModel, scores: Sequence[RunScore]) -> tuple[str, ...]:
    """That efforts are predicted from the commanded motion, if so."""
    columns = identified.signals.commanded_position
    if columns is None or not any(score.predicted_from == "commanded" for score in scores):
        return ()
    return (
        f"efforts are predicted from the commanded motion ({', '.join(columns)}), as feedforward "
        "would: the errors include those of tracking",
    )


def notes_of(runs: Sequence[Run]) -> tuple[str, ...]:
    """The cut-offs, the chain, and one line for whatever else of each run could not be used."""
    first = runs[0]
    cut = f"cut-offs: motion {first.motion_cutoff:g} Hz, "
    parallel = first.chain.processing.parallel_filter
    cut += f"regression {first.matched_cutoff:g} Hz" if parallel else "no parallel filter"
    cut += "" if first.rest_speed.any() else "; samples at standstill are fitted too"
    chains = {f"processing: {run.chain.words}": run.name for run in runs}
    steps = (words if len(chains) == 1 else f"{name}: {words}" for words, name in chains.items())
    return (cut, *steps, *(f"{run.name}: {loss}" for run in runs for loss in run.quality.losses))


def dropped(model: Model, runs: Sequence[Run]) -> tuple[str, ...]:
    """The stretches at which a loop does not close, where those are left out."""
    if model.robot.open_loops != "drop":
        return ()
    return tuple(str(one) for run in runs for one in open_stretches(run, model.robot))


def first_dropped(stretches: Sequence[str]) -> tuple[str, ...]:
    """The first of `dropped` and the number of the others; nothing without any."""
    more = f"; {len(stretches) - 1} more with -v" if len(stretches) > 1 else ""
    return tuple(f"{first}{more}" for first in stretches[:1])
