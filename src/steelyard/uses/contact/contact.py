"""Contact in a log, without a force sensor: what `steelyard contact` does."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from steelyard.base.arguments import checked
from steelyard.base.arrays import Array
from steelyard.base.errors import DataError, LogError
from steelyard.base.progress import Progress, silent
from steelyard.estimate.effort_uncertainty import EDGES, rest_speed_of, rest_speed_of_runs
from steelyard.estimate.external.contact_thresholds import ResidualPeaks
from steelyard.estimate.identified_model import IdentifiedModel, load_model
from steelyard.estimate.information.base_regressor import base_regressor
from steelyard.estimate.information.gather import gather
from steelyard.estimate.scores.effort_errors import effort_reference
from steelyard.estimate.scores.residuals import (
    ResidualTrace,
    residual_cutoff,
    residual_trace,
    thresholds_of,
)
from steelyard.identify.logs_and_notes import holds_fitted_rows, left_out, notes_of
from steelyard.identify.scores_and_residuals import fitted_before, runs_for
from steelyard.runs.run import Run
from steelyard.runs.runs_of_named_logs import log_files, paths_of, refuse_overlaps
from steelyard.uses.contact.contact_events import SuspectedContact, contacts_in, without_contact
from steelyard.uses.contact.contact_page import LEAST_LASTING_SHARE, Contacts
from steelyard.uses.efforts_unlike_the_model import refuse_other_efforts
from steelyard.uses.payload.payload_fit import payload_words, unknown_payload


@checked(rate=1e-9)
def contact(
    model: str | Path | IdentifiedModel,
    log: str | Path,
    *,
    calibrate: str | Path | Iterable[str | Path] = (),
    rate: float | None = None,
    progress: Progress = silent,
) -> Contacts:
    """Find contacts in a log: when, at which joints, how large, on which link.

    Args:
        model: The model, its `model.json`, or the folder that contains it.
        log: The log; `run.csv@5:20` is a window in seconds.
        calibrate: Logs of motion without contact, not fitted, to calibrate thresholds with; without
            any, the residuals of the cross-validation that are stored in the model.
        rate: False alarms per hour of all joints together; if `None` 1, or as few as the
            calibration supports.
        progress: Receives events of progress; an exception from it stops the work.

    Raises:
        SteelyardError: A file cannot be used, or the calibration does not support the rate.

    Example:
        >>> found = contact("arm-model", "other.csv")
        >>> found.events
        ()
    """
    identified = load_model(model)
    inspected, given = log_files([str(log)]), log_files(paths_of(calibrate))
    refuse_overlaps(given, inspected)
    (run,) = runs_for(identified, inspected, progress, at_rest=True)
    free = runs_for(identified, given, progress, at_rest=True)
    fitted = [
        fitted_before(identified, one) or holds_fitted_rows(identified, other)
        for one, other in zip(given, free, strict=True)
    ]
    notes = [fitted_note(one.name) for one, old in zip(free, fitted, strict=True) if old]
    unseen = [one for one, old in zip(free, fitted, strict=True) if not old]
    own = None if identified.calibration is None else identified.calibration.peaks
    cutoff = residual_cutoff(identified, unseen) if own is None else own.cutoff
    sigma = np.asarray(identified.estimate.sigma)
    rest = common_rest_speed(identified, [one.rest_speed for one in unseen or [run]])
    suspected: tuple[SuspectedContact, ...] = ()
    if given:
        traces = []
        for other in unseen:
            free_trace = residual_trace(identified, replace(other, rest_speed=rest), cutoff)
            refuse_other_efforts(free_trace, sigma, identified.joints)
            carried = _carried(identified, other)
            if carried is None:
                traces.append(free_trace)
            else:
                notes.append(f"left out of the calibration: {carried}")
        if not traces:
            raise DataError(
                f"no calibration log is left: {'; '.join(notes)}",
                where="--calibrate",
                fix="give logs of other motion without contact, or leave --calibrate out",
            )
        peaks, suspected = peaks_of_free_motion(identified, traces, rest, cutoff, own)
        source = f"{len(traces)} calibration {'log' if len(traces) == 1 else 'logs'}"
    elif own is not None:
        peaks, source = own, left_out_words(identified)
    else:
        raise DataError(
            "the model has no residuals of left-out motion to calibrate thresholds with",
            where=f"model of '{identified.model.robot.name}'",
            fix="give logs of motion without contact with --calibrate, or identify again from two "
            "or more motions",
        )
    thresholds = thresholds_of(identified, peaks, rate)
    trace = residual_trace(identified, replace(run, rest_speed=rest), cutoff)
    refuse_other_efforts(trace, sigma, identified.joints)
    robot = identified.model.robot
    found = Contacts(
        robot=robot.name,
        joints=robot.joint_names,
        units=robot.effort_units,
        trace=trace,
        thresholds=thresholds,
        events=contacts_in(trace, thresholds, robot, sigma),
        carried=None,
        sigma=sigma,
        usual=np.asarray(effort_reference(identified).fitted or np.zeros(robot.n)),
        source=source,
        suspected=suspected,
        wanted=rate,
        fitted=fitted_before(identified, inspected[0]) or holds_fitted_rows(identified, run),
        notes=(*notes, *(one.text for one in suspected), *left_out(run)),
        details=notes_of([run]),
    )
    lasts = found.busy > LEAST_LASTING_SHARE
    return replace(found, carried=_carried(identified, run) if lasts else None)


def _carried(identified: IdentifiedModel, run: Run) -> str | None:
    """A payload that a run has beyond doubt, for people to read; `None` if it is too short."""
    rests = identified.model.has_memory
    try:
        whole = gather(base_regressor(identified.model), run, rests=rests)
    except LogError:
        return None
    found = unknown_payload(identified, whole)
    return None if found is None else payload_words(found, run.name)


def fitted_note(log: str) -> str:
    """What to say of a calibration log that the model was fitted to."""
    return (
        f"{log} was fitted: its residuals say nothing of other motion; left out of the calibration"
    )


def left_out_words(identified: IdentifiedModel) -> str:
    """What the residuals of left-out motion in a model are of."""
    calibration = identified.calibration
    if calibration is None:
        return ""
    what = "runs" if calibration.kind == "runs" else "stretches"
    return f"{calibration.count} {what} that were left out when the model was identified"


def common_rest_speed(identified: IdentifiedModel, speeds: Sequence[Array]) -> Array:
    """Speed up to which joints rest in all logs that are compared, shape `(n,)` [rad/s; m/s].

    A residual is without friction below it: chosen for each log, it would change the residual of
    the same motion. That of the model's own left-out motion, else the largest of some runs.
    """
    calibration = identified.calibration
    if calibration is not None and calibration.peaks is not None:
        return calibration.peaks.edges[:, 0]
    usual = rest_speed_of(identified.robot.n, calibration, identified.processing.rest_speed)
    return rest_speed_of_runs(speeds, usual)


def peaks_of_free_motion(
    identified: IdentifiedModel,
    traces: Sequence[ResidualTrace],
    rest: Array,
    cutoff: float,
    known: ResidualPeaks | None,
) -> tuple[ResidualPeaks, tuple[SuspectedContact, ...]]:
    """Largest residuals of calibration runs, and what was left out of them.

    The model's own ranges of speed are used if it has some. Those of the runs otherwise, whose
    joints rest up to `rest`. Runs are compared with what is `known` of others.
    """
    calibration = identified.calibration
    if calibration is not None and calibration.peaks is not None:
        edges = calibration.peaks.edges
    else:
        speeds = np.concatenate([trace.slowest for trace in traces], axis=1)
        typical = np.sqrt(np.mean(np.square(speeds), axis=1))
        edges = np.maximum(np.column_stack([rest, np.outer(typical, EDGES)]), rest[:, None])
    robot, sigma = identified.model.robot, np.asarray(identified.estimate.sigma)
    return without_contact(traces, edges, cutoff, robot, sigma, known)
