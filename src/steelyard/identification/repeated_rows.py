"""Logs that hold rows, or repeat the motion, of logs that were fitted."""

from collections.abc import Sequence
from dataclasses import replace

from steelyard.errors import LogError
from steelyard.estimation.identified import IdentifiedModel
from steelyard.measurement import Run
from steelyard.measurement.motion_samples import motion_samples
from steelyard.validation.repeated_motion import repeat_of
from steelyard.validation.score import RunScore


def refuse_same_rows(fitted: Sequence[Run], unseen: Sequence[Run]) -> None:
    """The same rows neither count twice in a fit nor test it, whatever their log is called.

    Raises:
        LogError: A run holds rows of another one: trimmed, thinned, shifted in time or rounded.
    """
    known = motion_samples(fitted)
    pairs = [
        (run, known[:number], "they would count twice in the fit")
        for number, run in enumerate(fitted)
    ]
    pairs += [(run, known, "they would be both fitted and validated") for run in unseen]
    for run, others, role in pairs:
        repeat = repeat_of(others, run)
        if repeat is not None and repeat.same:
            raise LogError(
                f"'{run.name}' holds the same samples as '{repeat.run}': {role}",
                where=f"{run.name} {repeat.words}",
                fix="give every part once; cut a log with LOG@START:STOP",
            )


def holds_fitted_rows(identified: IdentifiedModel, run: Run) -> bool:
    """Whether the model was fitted to rows of this run, whatever its log is called now."""
    repeat = repeat_of(identified.motions, run)
    return repeat is not None and repeat.same


def marked_repeats(
    identified: IdentifiedModel, runs: Sequence[Run], scores: Sequence[RunScore]
) -> tuple[RunScore, ...]:
    """The scores of runs that were not fitted, with the fitted run whose motion each repeats."""
    repeats = [repeat_of(identified.motions, run) for run in runs]
    return tuple(
        score if repeat is None else replace(score, repeats=repeat.run)
        for score, repeat in zip(scores, repeats, strict=True)
    )
