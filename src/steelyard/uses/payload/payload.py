"""What a robot carries, from logs and an identified model: what `steelyard payload` does."""

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from steelyard.base.arguments import checked
from steelyard.base.errors import DataError
from steelyard.base.progress import Progress, silent
from steelyard.estimate.friction.mixes import has_memory
from steelyard.estimate.identified import IdentifiedModel, load_model
from steelyard.estimate.information.gather import gather
from steelyard.estimate.information.regressor import base_regressor
from steelyard.estimate.information.samples import gather_samples
from steelyard.estimate.payload.load_case import carrier
from steelyard.estimate.payload.payload_estimate import PayloadEstimate
from steelyard.estimate.scores.residuals import residual_cutoff, residual_trace
from steelyard.identify.run_notes import dropped
from steelyard.identify.scores import fitted_before, runs_for
from steelyard.runs.named_logs import (
    LogArgument,
    log_files,
    paths_of,
    refuse_overlaps,
)
from steelyard.runs.run import Run
from steelyard.uses.other_efforts import refuse_without
from steelyard.uses.payload.payload_body import PayloadKnowledge, SolidShape
from steelyard.uses.payload.payload_events import PayloadEvents, find_payload_events
from steelyard.uses.payload.payload_of_runs import NOTHING_KNOWN
from steelyard.uses.payload.payload_of_runs import identify_payload as payload_of_informations


@dataclass(frozen=True, eq=False)
class PayloadTask:
    """Logs with a payload and without, and the model; checked before they are read."""

    identified: IdentifiedModel
    loaded: list[LogArgument]
    unloaded: list[LogArgument]
    frame: str | None
    known: PayloadKnowledge = NOTHING_KNOWN

    def done(self, gain_uncertainty: float | None, progress: Progress) -> PayloadEstimate:
        """The estimate, with the model's cut-off frequencies."""
        identified, count = self.identified, len(self.loaded)
        runs = self._runs([*self.loaded, *self.unloaded], progress)
        regressor, threads = base_regressor(identified.model), os.cpu_count() or 1
        rests = has_memory(identified.model.terms)
        of_runs = [
            gather(regressor, run, rests=rests, threads=threads, progress=progress) for run in runs
        ]
        found = payload_of_informations(
            identified,
            of_runs[:count],
            self.frame,
            unloaded=of_runs[count:],
            gain=gain_uncertainty,
            known=self.known,
        )
        compared = (
            f"the model was identified from {log.path.name}: compared with itself it has no payload"
            for log in self.loaded
            if not self.unloaded and fitted_before(identified, log)
        )
        return replace(found, notes=(*found.notes, *dropped(identified.model, runs), *compared))

    def events(
        self, gain_uncertainty: float | None, progress: Progress
    ) -> tuple[PayloadEvents, ...]:
        """When the payload changes along each log with it."""
        if self.unloaded or self.known != NOTHING_KNOWN:
            raise DataError(
                "events are found with the model alone",
                where="--unloaded" if self.unloaded else "--mass, --com, --box, ...",
                fix="leave these out with --when, or weigh without --when",
            )
        identified, found = self.identified, []
        regressor, threads = base_regressor(identified.model), os.cpu_count() or 1
        rests = has_memory(identified.model.terms)
        for run in self._runs(self.loaded, progress):
            samples = gather_samples(
                regressor, run, rests=rests, threads=threads, progress=progress
            )
            found.append(
                find_payload_events(identified, samples, self.frame, gain=gain_uncertainty)
            )
        return tuple(found)

    def _runs(self, logs: Sequence[LogArgument], progress: Progress) -> tuple[Run, ...]:
        """Runs whose efforts contain gravity and friction as those of the model."""
        identified = self.identified
        runs = runs_for(identified, logs, progress, at_rest=False)
        cutoff, sigma = residual_cutoff(identified, runs), np.asarray(identified.estimate.sigma)
        for run in runs:
            refuse_without(residual_trace(identified, run, cutoff), sigma, identified.joints)
        return runs


def payload_inputs(
    model: str | Path | IdentifiedModel,
    logs: str | Path | Iterable[str | Path],
    frame: str | None,
    unloaded: str | Path | Iterable[str | Path],
    known: PayloadKnowledge,
) -> PayloadTask:
    """The model and the logs; the arguments and errors are those of `identify_payload`."""
    identified = load_model(model)
    carrier(identified.model.robot, frame)
    if identified.signals.effort_kind == "gravity_compensated_torque":
        raise DataError(
            "the efforts of this model are gravity-compensated: they do not contain the weight of "
            "what the controller compensates",
            where=f"robot '{identified.model.robot.name}', [signals.effort] kind",
            fix="log efforts with gravity (currents or joint torques), and identify from these",
        )
    with_it, without = log_files(paths_of(logs, least=1)), log_files(paths_of(unloaded))
    refuse_overlaps([*with_it, *without], [])
    return PayloadTask(identified, with_it, without, frame, known)


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
    known = known_of(mass, com, box, cylinder, sphere)
    return payload_inputs(model, logs, frame, unloaded, known).done(gain_uncertainty, progress)


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
    task = payload_inputs(model, log, frame, (), NOTHING_KNOWN)
    return task.events(gain_uncertainty, progress)[0]
