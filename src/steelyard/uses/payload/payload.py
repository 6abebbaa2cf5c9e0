"""What a robot carries, from logs and an identified model: what `steelyard payload` does."""

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.text import Text

from steelyard.base.checked_arguments import checked
from steelyard.base.errors import DataError
from steelyard.base.progress import Progress, silent
from steelyard.estimate.identified_model import IdentifiedModel, load_model
from steelyard.estimate.information.base_parameters_and_regressor import base_regressor
from steelyard.estimate.information.gather import gather
from steelyard.estimate.information.kept_filtered_samples import gather_samples
from steelyard.estimate.payload.payload_estimate import PayloadEstimate
from steelyard.estimate.payload.runs_with_payload import carrier
from steelyard.estimate.scores.residual_traces_and_band_calibration import (
    residual_cutoff,
    residual_trace,
)
from steelyard.identify.runs_and_notes_of_logs import dropped, fitted_before, runs_for
from steelyard.report.page import figures, notes, page_of
from steelyard.report.page_figures import Figure, Group, Key, area, evenly, line
from steelyard.report.result import Result
from steelyard.report.tables import PlainTable, light_table, table_of
from steelyard.report.words import rounded_to_uncertainty
from steelyard.robot.inertia_and_placement import INERTIAL_NAMES, INERTIAL_UNITS
from steelyard.runs.run import Run
from steelyard.runs.runs_of_named_logs import LogArgument, log_files, paths_of, refuse_overlaps
from steelyard.uses.effort_plausibility import refuse_without
from steelyard.uses.payload import pick_up_and_put_down as picking
from steelyard.uses.payload.change_detection import CHANGE_SPAN
from steelyard.uses.payload.known_and_consistent_payload_body import PayloadKnowledge, SolidShape
from steelyard.uses.payload.payload_fit import fit_payload


def rounded_mass(value: float, half: float) -> tuple[str, str]:
    """A value and its half-width, to two digits of the half-width; the latter empty without."""
    if not (isfinite(value) and isfinite(half)):
        return "not identifiable", ""
    return rounded_to_uncertainty(value, half), rounded_to_uncertainty(half, half)


def mass_with_interval(value: float, half: float) -> str:
    """A value with the half-width of its interval."""
    number, width = rounded_mass(value, half)
    return f"{number} ± {width}" if width else number


def counted_changes(found: picking.PayloadEvents) -> str:
    """How many changes of the payload there are, or which would be seen."""
    count, least = len(found.events), f"{found.least_mass:.2g} kg"
    if count:
        return f"{count} change{'s' * (count > 1)} of the payload"
    if found.conclusive:
        return f"no change of payload by {least} or more"
    return (
        f"cannot tell whether the payload changes: one by less than {least} would not be seen; the "
        "model does not describe this log (steelyard check names what differs)"
    )


MOST_POINTS_OF_MASS = 3000  # points of a line, at most


MASS_LEGEND = [
    Key("--measured", f"mass in a window of {CHANGE_SPAN:g} s"),
    Key("--interval", "its 95 % interval", "area"),
    Key("--vermillion", "carried between changes"),
]
MASS_WINDOW_NOTE = (
    "The window slides over the motion; a change appears as a slope of its length. The masses "
    "between changes are weighed with all their samples, arm and friction together; changes are "
    "decided by all ten numbers of the payload, not by this line."
)


def _tables(found: picking.PayloadEvents) -> list[PlainTable]:
    changes: dict[str, Callable[[tuple[int, picking.PayloadEvent]], str]] = {
        "#": lambda x: f"{x[0]}",
        "change": lambda x: x[1].kind,
        "time [s]": lambda x: f"{x[1].time:.2f}",
        "95 % interval [s]": lambda x: f"{x[1].earliest:.2f} to {x[1].latest:.2f}",
        "mass [kg]": lambda x: mass_with_interval(x[1].mass, x[1].mass_half_width),
        "× threshold": lambda x: f"{x[1].ratio:.3g}",
    }
    carried: dict[str, Callable[[picking.Carried], str]] = {
        "carried [s]": lambda x: f"{x.start:.2f} to {x.stop:.2f}",
        "mass [kg]": lambda x: mass_with_interval(x.payload.mass, float(x.payload.half_width[0])),
    }
    tables = (
        table_of(enumerate(found.events, start=1), changes, text=(1, 3, 4)),
        table_of(found.carried, carried, text=(0, 1)),
    )
    return [table for table in tables if table.rows]


def _figure(found: picking.PayloadEvents) -> Figure:
    sliding = found.sliding
    some = evenly(len(sliding.t), MOST_POINTS_OF_MASS)
    t, mass, half = sliding.t[some], sliding.mass[some], sliding.half_width[some]
    edges = np.array([sliding.t[0], *(e.time for e in found.events), sliding.t[-1]])
    between = [
        next((one.payload.mass for one in found.carried if one.start <= t <= one.stop), 0.0)
        for t in 0.5 * (edges[:-1] + edges[1:])
    ]
    steps, carried = np.repeat(edges, 2)[1:-1], np.repeat(between, 2)
    traces = [
        area("95 % interval", t, mass - half, mass + half, "--interval"),
        line("window", t, mass, "--measured", width=1.2),
        line("carried", steps, carried, "--vermillion", width=2.5),
    ]
    label = f"Mass of the payload along {found.run}, with its interval and the changes"
    return Figure("", label, "time [s]", "mass [kg]", traces, {"showlegend": False})


@dataclass(frozen=True, eq=False, repr=False)
class PayloadsOfLogs(Result):
    """When the payload changes along some logs."""

    robot: str
    logs: tuple[picking.PayloadEvents, ...]
    json_name = "payload.json"

    def report(self) -> str:
        """The report as one self-contained HTML page."""
        limits = [f"{one.run}: {one.unexplained}" for one in self.logs if one.unexplained]
        logs = (
            figures(
                f"log{number}",
                one.run,
                words=f"{one.run}: {counted_changes(one)}. Frame '{one.frame}'.",
                tables=_tables(one),
                legend=MASS_LEGEND,
                groups=[Group([_figure(one)], columns="one")],
                note=MASS_WINDOW_NOTE,
            )
            for number, one in enumerate(self.logs, start=1)
        )
        sections = (
            notes("limits", "Limits of this result", limits),
            *logs,
            notes("notes", "Notes", self.notes, folded=True),
        )
        title = f"{self.robot}: payload in {', '.join(one.run for one in self.logs)}"
        return page_of(title, self.robot, sections)

    @property
    def notes(self) -> tuple[str, ...]:
        """What was taken for granted."""
        return tuple(dict.fromkeys(note for one in self.logs for note in one.notes))

    def to_dict(self) -> dict[str, Any]:
        """Events as JSON values, all together and log by log."""
        logs = [one.to_dict() for one in self.logs]
        return {
            "schema": "steelyard.payload_events",
            "schema_version": 1,
            "events": [event for log in logs for event in log["events"]],
            "logs": logs,
        }

    def show(self, console: Console) -> None:
        """Print when the payload changes along each log."""
        for one in self.logs:
            console.print(Text(f"{one.run}: {counted_changes(one)}", style="bold"))
            if one.unexplained:
                console.print(Text(f"! {one.unexplained}", style="yellow"))
            for event in one.events:
                mass, half = rounded_mass(event.mass, event.mass_half_width)
                between = f"({event.earliest:.2f} to {event.latest:.2f} s)"
                text = f"  {event.time:8.2f} s  {between}  {event.kind:9}  {mass} ± {half} kg"
                console.print(Text(text))
            for some in one.carried:
                mass, half = rounded_mass(some.payload.mass, float(some.payload.half_width[0]))
                text = f"  carried from {some.start:.2f} to {some.stop:.2f} s: {mass} ± {half} kg"
                console.print(Text(text))
        for note in self.notes:
            console.print(Text(f"note: {note}"))


def payload_lines(estimate: PayloadEstimate, console: Console) -> None:
    """Print the mass in one line, the table and how far it can be trusted."""
    clear = estimate.weighs and not estimate.unexplained
    console.print(Text(payload_headline(estimate), style="bold green" if clear else "bold"))
    if estimate.unexplained:
        console.print(Text(f"! {estimate.unexplained}", style="yellow"))
    carried = "" if estimate.frame == estimate.body else f", on link '{estimate.body}'"
    console.print()
    what = "body removed from" if estimate.removed else "payload in"
    console.print(Text(f"{what} frame '{estimate.frame}'{carried}"))
    table = light_table(("", "value", "± 95 %", "unit"), (0, 3))
    for name, value, half, unit in _numbers(estimate):
        table.add_row(name, *rounded_mass(value, half), unit)
    console.print(table)
    remarks = (remark for remark in estimate.remarks if remark != estimate.unexplained)
    for text in (*remarks, *(f"note: {note}" for note in estimate.notes)):
        console.print(Text(text))


NAMES = (
    "mass",
    *(f"first moment {axis}" for axis in "xyz"),
    *(f"{name} about the frame's origin" for name in INERTIAL_NAMES[4:]),
)
"""The ten numbers of a payload in words."""


def payload_headline(estimate: PayloadEstimate) -> str:
    """The mass with its interval, or that there is none, in a sentence."""
    mass, half = rounded_mass(estimate.mass, float(estimate.half_width[0]))
    if not half:
        seen = np.isfinite(estimate.ten)
        moments = [NAMES[k] for k in np.flatnonzero(seen & (np.arange(10) < 4))]
        more = f"; identifiable: {', '.join(moments)}" * bool(moments)
        return f"The mass of the payload is not identifiable from these logs{more}"
    found = f"{mass} ± {half} kg (95 % interval)"
    if estimate.removed and estimate.weighs:
        less = f"{rounded_mass(-estimate.mass, float(estimate.half_width[0]))[0]} ± {half} kg"
        return (
            f"{less} less at '{estimate.frame}' than in the model's logs (95 % interval): a tool "
            "or payload was removed, or gains differ"
        )
    if estimate.negative_mass is not None:
        return (
            f"No payload: the data ask for a negative mass of about {estimate.negative_mass:.2g} kg"
        )
    return f"Payload: {found}" if estimate.weighs else f"No payload detected: {found}"


def _numbers(estimate: PayloadEstimate) -> Iterator[tuple[str, float, float, str]]:
    """Name, value, half-width and unit of mass, centre and inertia."""
    width = estimate.half_width
    if estimate.not_seen:  # without a mass there is no centre: what the data see of the ten
        for k in np.flatnonzero(np.isfinite(estimate.ten)).tolist():
            yield NAMES[k], float(estimate.ten[k]), float(width[k]), INERTIAL_UNITS[k]
        return
    yield "mass", abs(estimate.mass), float(width[0]), "kg"
    if not estimate.weighs:
        return
    centre, around = estimate.com, estimate.com_half_width
    for k, axis in enumerate("xyz"):
        yield f"centre {axis}", float(centre[k]), float(around[k]), "m"
    inertia, around = estimate.inertia_com, estimate.inertia_com_half_width
    for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)):
        name = f"I{'xyz'[i]}{'xyz'[j]} about the centre"
        yield name, float(inertia[i, j]), float(around[i, j]), "kg m²"


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
) -> PayloadsOfLogs:
    """When the payload changes along each log; the arguments are those of `payload_events`."""
    identified, found = load_model(model), []
    files, _ = _logs(identified, paths_of(logs, least=1), [], frame)
    regressor, threads = base_regressor(identified.model), os.cpu_count() or 1
    for run in _runs(identified, files, progress):
        samples = gather_samples(regressor, run, threads=threads, progress=progress)
        found.append(picking.find_payload_events(identified, samples, frame, gain=gain_uncertainty))
    return PayloadsOfLogs(identified.robot.name, tuple(found))


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
        frame: Frame of the results; that of the last link, or of a floating base, if `None`.
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
    for name, given, count in (("box", box, 3), ("cylinder", cylinder, 2), ("com", com, 3)):
        if given is not None and len(given) != count:
            wrong = f"'{name}' has {len(given)} numbers"
            fix = f"give {count}, in metres"
            raise DataError(wrong, where="what is known of the payload", fix=fix)
    shapes = [] if box is None else [SolidShape.of("box", box)]
    shapes += [] if cylinder is None else [SolidShape.of("cylinder", cylinder)]
    shapes += [] if sphere is None else [SolidShape.of("sphere", [sphere])]
    if len(shapes) > 1:
        wrong = f"the payload is {' and '.join(shape.words for shape in shapes)}"
        fix = "give one of box, cylinder and sphere"
        raise DataError(wrong, where="what is known of the payload", fix=fix)
    centre = None if com is None else tuple(com)
    known = PayloadKnowledge(mass, centre, shapes[0] if shapes else None)
    identified = load_model(model)
    loaded, without = _logs(identified, paths_of(logs, least=1), paths_of(unloaded), frame)
    runs = _runs(identified, [*loaded, *without], progress)
    regressor, threads = base_regressor(identified.model), os.cpu_count() or 1
    rests = identified.model.has_memory
    gather_all = partial(gather, regressor, rests=rests, threads=threads, progress=progress)
    of_runs = list(map(gather_all, runs))
    carrying, bare, gain = of_runs[: len(loaded)], of_runs[len(loaded) :], gain_uncertainty
    found = fit_payload(identified, carrying, frame, unloaded=bare, gain=gain, known=known)
    before = [x for x in loaded if not without and fitted_before(identified.provenance, x)]
    says = "the model was identified from {}: compared with itself it has no payload"
    compared = (says.format(log.path.name) for log in before)
    return replace(found, notes=(*found.notes, *dropped(identified.model, runs), *compared))


@checked(gain_uncertainty=0.0)
def payload_events(
    model: str | Path | IdentifiedModel,
    log: str | Path,
    frame: str | None = None,
    *,
    gain_uncertainty: float | None = None,
    progress: Progress = silent,
) -> picking.PayloadEvents:
    """Find when a robot picks something up and puts it down, and how heavy it is.

    Args:
        model: The model, its `model.json`, or the folder that contains it.
        log: A log in which the payload may change.
        frame: Frame of the payloads; that of the last link, or of a floating base, if `None`.
        gain_uncertainty: Relative standard deviation of each gain of the efforts, see
            `identify_payload`.
        progress: Receives events of progress; an exception from it stops the work.

    Raises:
        SteelyardError: A file cannot be used, the log is too short, or there is no such frame.

    Example:
        >>> payload_events("arm-model", "other.csv").events
        ()
    """
    return events_of_logs(model, log, frame, gain_uncertainty, progress).logs[0]
