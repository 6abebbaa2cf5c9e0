"""What a robot carries, from logs and an identified model: what `steelyard payload` does."""

import os
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from steelyard.base.arguments import checked
from steelyard.base.errors import DataError
from steelyard.base.progress import Progress, silent
from steelyard.estimate.identified_model import IdentifiedModel, load_model
from steelyard.estimate.information.base_regressor import base_regressor
from steelyard.estimate.information.filtered_samples import gather_samples
from steelyard.estimate.information.gather import gather
from steelyard.estimate.payload.payload_estimate import PayloadEstimate
from steelyard.estimate.payload.runs_with_payload import carrier
from steelyard.estimate.scores.residuals import residual_cutoff, residual_trace
from steelyard.identify.notes_and_provenance import dropped
from steelyard.identify.scores_and_residuals import fitted_before, runs_for
from steelyard.runs.run import Run
from steelyard.runs.runs_of_named_logs import LogArgument, log_files, paths_of, refuse_overlaps
from steelyard.uses.efforts_unlike_the_model import refuse_without
from steelyard.uses.payload.consistent_payload_body import PayloadKnowledge, SolidShape
from steelyard.uses.payload.payload_fit import identify_payload as payload_of_informations
from steelyard.uses.payload.pick_up_and_put_down import PayloadEvents, find_payload_events


def _logs(
    identified: IdentifiedModel, logs: Sequence[str], unloaded: Sequence[str], frame: str | None
) -> tuple[list[LogArgument], list[LogArgument]]:
    """Logs with a payload and without, refused where that is possible before reading."""
    carrier(identified.model.robot, frame)
    if identified.signals.effort_kind == "gravity_compensated_torque":
        raise DataError(
            "the efforts of this model are gravity-compensated: they do not contain the weight of "
            "what the controller compensates",
            where=f"robot '{identified.model.robot.name}', [signals.effort] kind",
            fix="log efforts with gravity (currents or joint torques), and identify from these",
        )
    with_it, without = log_files(logs), log_files(unloaded)
    refuse_overlaps([*with_it, *without], [])
    return with_it, without


def _runs(
    identified: IdentifiedModel, logs: Sequence[LogArgument], progress: Progress
) -> tuple[Run, ...]:
    """Runs whose efforts contain gravity and friction as those of the model."""
    runs = runs_for(identified, logs, progress, at_rest=False)
    cutoff, sigma = residual_cutoff(identified, runs), np.asarray(identified.estimate.sigma)
    for run in runs:
        refuse_without(residual_trace(identified, run, cutoff), sigma, identified.joints)
    return runs


def events_of_logs(
    model: str | Path | IdentifiedModel,
    logs: str | Path | Iterable[str | Path],
    frame: str | None,
    gain_uncertainty: float | None,
    progress: Progress,
) -> tuple[PayloadEvents, ...]:
    """When the payload changes along each log; the arguments are those of `payload_events`."""
    identified, found = load_model(model), []
    files, _ = _logs(identified, paths_of(logs, least=1), [], frame)
    regressor, threads = base_regressor(identified.model), os.cpu_count() or 1
    rests = identified.model.has_memory
    for run in _runs(identified, files, progress):
        samples = gather_samples(regressor, run, rests=rests, threads=threads, progress=progress)
        found.append(find_payload_events(identified, samples, frame, gain=gain_uncertainty))
    return tuple(found)


def known_of(
    mass: float | None,
    com: Sequence[float] | None,
    box: Sequence[float] | None,
    cylinder: Sequence[float] | None,
    sphere: float | None,
) -> PayloadKnowledge:
    """What is known of a payload; the arguments and errors are those of `identify_payload`."""
    for name, given, count in (("box", box, 3), ("cylinder", cylinder, 2), ("com", com, 3)):
        if given is not None and len(given) != count:
            raise DataError(
                f"'{name}' has {len(given)} numbers",
                where="what is known of the payload",
                fix=f"give {count}, in metres",
            )
    shapes = [] if box is None else [SolidShape.box(tuple(box))]
    shapes += [] if cylinder is None else [SolidShape.cylinder(*cylinder)]
    shapes += [] if sphere is None else [SolidShape.sphere(sphere)]
    if len(shapes) > 1:
        raise DataError(
            f"the payload is {' and '.join(shape.words for shape in shapes)}",
            where="what is known of the payload",
            fix="give one of box, cylinder and sphere",
        )
    centre = None if com is None else tuple(com)
    return PayloadKnowledge(mass, centre, shapes[0] if shapes else None)


@checked(gain_uncertainty=0.0)
def identify_payload(
    model: str | Path | IdentifiedModel,
    logs: str | Path | Iterable[str | Path],
    frame: str | None = None,
    *,
    unloaded: str | Path | Iterable[str | Path] = (),
    gain_uncertainty: float | None = None,
    mass: float | None = None,
    com: Sequence[float] | None = None,
    box: Sequence[float] | None = None,
    cylinder: Sequence[float] | None = None,
    sphere: float | None = None,
    progress: Progress = silent,
) -> PayloadEstimate:
    """Identify a payload: physically consistent mass, centre and inertia, with 95 % intervals.

    Args:
        model: The model, its `model.json`, or the folder that contains it.
        logs: Logs with the payload.
        frame: Frame of the results; that of the last link if `None`.
        unloaded: Logs without the payload: arm and payload are then identified together, and the
            parameter values of the model are not used.
        gain_uncertainty: Relative standard deviation of each gain of the efforts; if `None`, 0.02
            for motor currents and motor torques; 0 for joint torques, and where scales of the
            efforts were identified with the model.
        mass: Known mass [kg].
        com: Known centre of mass in the frame, x, y and z [m].
        box: Prior of the inertia: a box with these edges along the frame's axes, x, y and z [m].
        cylinder: Prior of the inertia: a cylinder along z, diameter and length [m].
        sphere: Prior of the inertia: a sphere of this diameter [m].
        progress: Receives events of progress; an exception from it stops the work.

    Raises:
        SteelyardError: A file cannot be used, or there is no such frame.

    Example:
        >>> carried = identify_payload("arm-model", "other.csv")
        >>> abs(carried.mass) < 0.1
        True
    """
    known, identified = known_of(mass, com, box, cylinder, sphere), load_model(model)
    loaded, without = _logs(identified, paths_of(logs, least=1), paths_of(unloaded), frame)
    runs = _runs(identified, [*loaded, *without], progress)
    regressor, threads = base_regressor(identified.model), os.cpu_count() or 1
    rests = identified.model.has_memory
    of_runs = [
        gather(regressor, run, rests=rests, threads=threads, progress=progress) for run in runs
    ]
    found = payload_of_informations(
        identified,
        of_runs[: len(loaded)],
        frame,
        unloaded=of_runs[len(loaded) :],
        gain=gain_uncertainty,
        known=known,
    )
    compared = (
        f"the model was identified from {log.path.name}: compared with itself it has no payload"
        for log in loaded
        if not without and fitted_before(identified, log)
    )
    return replace(found, notes=(*found.notes, *dropped(identified.model, runs), *compared))


@checked(gain_uncertainty=0.0)
def payload_events(
    model: str | Path | IdentifiedModel,
    log: str | Path,
    frame: str | None = None,
    *,
    gain_uncertainty: float | None = None,
    progress: Progress = silent,
) -> PayloadEvents:
    """Find when a robot picks something up and puts it down, and how heavy it is.

    Args:
        model: The model, its `model.json`, or the folder that contains it.
        log: A log in which the payload may change.
        frame: Frame of the payloads; that of the last link if `None`.
        gain_uncertainty: Relative standard deviation of each gain of the efforts, see
            `identify_payload`.
        progress: Receives events of progress; an exception from it stops the work.

    Raises:
        SteelyardError: A file cannot be used, the log is too short, or there is no such frame.

    Example:
        >>> payload_events("arm-model", "other.csv").events
        ()
    """
    return events_of_logs(model, log, frame, gain_uncertainty, progress)[0]
