"""What a robot picks up and puts down along a run, when, and how heavy it is."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import DataError
from steelyard.estimate.estimate import Z95
from steelyard.estimate.identified import IdentifiedModel
from steelyard.estimate.information.information import Information, Window, packed
from steelyard.estimate.information.regressor import Layout
from steelyard.estimate.information.samples import FilteredSamples
from steelyard.estimate.payload.load_case import carrier, combined, drifting, payload_lift
from steelyard.estimate.payload.payload_estimate import PayloadEstimate
from steelyard.robot.robot import Frame
from steelyard.uses.payload.payload_body import PayloadKnowledge
from steelyard.uses.payload.payload_changes import (
    CHANGE_SPAN,
    CHANGE_STEP,
    FALSE_EVENTS_PER_HOUR,
    LEAST_TIME_OF_CHANGES,
    LEAST_WINDOWS_OF_LOG,
    PayloadChange,
    PayloadChanges,
    SlidingMass,
    changes_of,
    payload_windows,
)
from steelyard.uses.payload.payload_of_runs import (
    FRICTION_DRIFT,
    gain_share,
    refuse_uncertainties,
    refuse_unexplained_case,
)
from steelyard.uses.payload.weighing import fitted_case, weighed

CERTAIN_MASS_STD = 3.0
"""Standard deviations of a mass, or of its change, from which on it counts."""

LARGEST_PAYLOAD_SHARE = 0.1
"""Mass that a payload may have, over that of the moving links."""

Kind = Literal["picked up", "put down"]


@dataclass(frozen=True, eq=False)
class Carried:
    """A payload between two times.

    Attributes:
        start: When it is there first [s].
        stop: When it is there last [s].
        payload: What it is.
    """

    start: float
    stop: float
    payload: PayloadEstimate


@dataclass(frozen=True)
class PayloadEvent:
    """A change of what is carried.

    Attributes:
        kind: What happens.
        time: When [s] from the start of the log; the middle of a pause in which it happens.
        earliest: Start of that interval [s].
        latest: Its end.
        mass: By how much the mass changes [kg].
        mass_half_width: Half-width of its 95 % interval.
        ratio: Squares that it explains over the threshold.
    """

    kind: Kind
    time: float
    earliest: float
    latest: float
    mass: float
    mass_half_width: float
    ratio: float


@dataclass(frozen=True, eq=False)
class PayloadEvents:
    """All changes of what a robot carries along a run.

    Attributes:
        run: Name of the run.
        frame: The frame of the payloads.
        body: The link that carries them.
        events: In order of time.
        carried: What is carried, in order of time.
        alarms_per_hour: False events that the threshold allows.
        inflation: How many times larger the statistic is than by normal, white residuals.
        least_mass: Change by a mass at the frame's origin that half of the log would show [kg].
        conclusive: Whether changes are found, or one by as much as a payload may have
            (`LARGEST_PAYLOAD_SHARE`) would be.
        notes: What was taken for granted, for people to read.
        sliding: The mass over time.
        unexplained: What the model does not explain with any payload; empty if there is nothing.
    """

    run: str
    frame: str
    body: str
    events: tuple[PayloadEvent, ...]
    carried: tuple[Carried, ...]
    alarms_per_hour: float
    inflation: float
    least_mass: float
    conclusive: bool
    notes: tuple[str, ...]
    sliding: SlidingMass
    unexplained: str = ""

    def __str__(self) -> str:
        events = (
            f"{one.kind} at {one.time:.2f} s ({one.earliest:.2f} to {one.latest:.2f} s): "
            f"{one.mass:+.3g} ± {one.mass_half_width:.2g} kg"
            for one in self.events
        )
        notes = (f"note: {note}" for note in self.notes)
        return "\n".join([f"{self.run}: {len(self.events)} changes", *events, *notes])

    def to_dict(self) -> dict[str, Any]:
        """As JSON values."""
        return {
            "run": self.run,
            "frame": self.frame,
            "link": self.body,
            "events": [{"run": self.run, **vars(event)} for event in self.events],
            "carried": [
                {"start": one.start, "stop": one.stop, "payload": one.payload.to_dict()}
                for one in self.carried
            ],
            "alarms_per_hour": self.alarms_per_hour,
            "residual_inflation": self.inflation,
            "least_mass": self.least_mass if np.isfinite(self.least_mass) else None,
            "conclusive": self.conclusive,
            "unexplained": self.unexplained or None,
            "notes": list(self.notes),
        }


def events_dict(found: Sequence[PayloadEvents]) -> dict[str, Any]:
    """Events of some logs as JSON values, all together and log by log."""
    logs = [one.to_dict() for one in found]
    return {
        "schema": "steelyard.payload_events",
        "schema_version": 1,
        "events": [event for log in logs for event in log["events"]],
        "logs": logs,
    }


def find_payload_events(
    identified: IdentifiedModel,
    samples: FilteredSamples,
    frame: str | None = None,
    *,
    drift: float = FRICTION_DRIFT,
    gain: float | None = None,
) -> PayloadEvents:
    """Find when a payload changes along one run, and weigh what is carried between.

    Args:
        identified: The robot without payload.
        samples: Filtered samples of the run, efforts as logged.
        frame: The frame of the payloads; that of the last link if `None`.
        drift: Standard deviation of the run's friction and offset, see `identify_payload`.
        gain: Relative standard deviation of each gain of the efforts, likewise.

    Raises:
        ModelError: There is no such frame, or it does not move.
        DataError: The run is too short, or the data see nothing of a payload.
    """
    share = gain_share(identified, gain)
    refuse_uncertainties(drift, share)
    carries = carrier(identified.model.robot, frame)
    samples = samples.scaled(identified.signals.gains, identified.model.robot.effort_units)
    found = _changes(identified, samples, carries, drift)
    weigher = _Weigher(identified, samples, carries, drift, share)
    changes = list(found.changes)
    while True:
        stretches = weigher.stretches(changes)
        payloads, unexplained = weigher.payloads(stretches)
        kept = [
            change
            for change, one, other in zip(changes, payloads[:-1], payloads[1:], strict=True)
            if _differ(one, other)
        ]
        if len(kept) == len(changes):
            break
        changes = kept
    events = [
        _event(change, one, other)
        for change, one, other in zip(changes, payloads[:-1], payloads[1:], strict=True)
    ]
    carried = tuple(
        Carried(window.start, window.stop, payload)
        for window, payload in zip(stretches, payloads, strict=True)
        if payload is not None
    )
    return PayloadEvents(
        samples.sources[0].run,
        carries.name,
        identified.model.robot.bodies[carries.body].name,
        tuple(events),
        carried,
        FALSE_EVENTS_PER_HOUR,
        found.inflation,
        found.least_mass,
        bool(events) or found.least_mass <= _largest_payload(identified),
        _notes(found, carried),
        found.sliding,
        unexplained,
    )


def _notes(found: PayloadChanges, carried: tuple[Carried, ...]) -> tuple[str, ...]:
    """How an event is decided, which would be seen, and what the masses rest on."""
    digits = 0 if found.inflation >= 10.0 else 1
    return (
        f"threshold for {FALSE_EVENTS_PER_HOUR:g} false events per hour; residuals along the "
        "log make the "
        f"statistic {found.inflation:.{digits}f} times larger than normal, white ones would",
        f"smallest change of the mass that would be detected: {found.least_mass:.2g} kg (for a "
        "mass at the frame's origin, in at least half of the log)",
        *(carried[0].payload.notes if carried else ()),
    )


def _differ(one: PayloadEstimate | None, other: PayloadEstimate | None) -> bool:
    """Whether the masses of two payloads differ beyond doubt."""
    change, half = _change(one, other)
    return abs(change) > CERTAIN_MASS_STD / Z95 * half


def _change(one: PayloadEstimate | None, other: PayloadEstimate | None) -> tuple[float, float]:
    """Change of the mass and half-width of its 95 % interval; nothing weighs nothing."""
    masses = [0.0 if payload is None else payload.mass for payload in (one, other)]
    widths = [0.0 if payload is None else payload.half_width[0] for payload in (one, other)]
    return masses[1] - masses[0], float(np.linalg.norm(widths))


def _event(
    change: PayloadChange, one: PayloadEstimate | None, other: PayloadEstimate | None
) -> PayloadEvent:
    mass, half = _change(one, other)
    return PayloadEvent(
        "picked up" if mass > 0.0 else "put down",
        change.time,
        change.earliest,
        change.latest,
        abs(mass),
        half,
        change.ratio,
    )


@dataclass(frozen=True, eq=False)
class _Weigher:
    """Weighs what is carried between changes; arm, friction and payloads in one fit."""

    identified: IdentifiedModel
    samples: FilteredSamples
    carries: Frame
    drift: float
    gain: float

    def stretches(self, changes: list[PayloadChange]) -> list[Window]:
        """Time between the changes, without their intervals where that leaves enough."""
        run, t = self.samples.sources[0].run, self.samples.t
        bare = [float(t[0]), *(change.time for change in changes), float(t[-1])]
        starts = [float(t[0]), *(change.latest for change in changes)]
        stops = [*(change.earliest for change in changes), float(t[-1])]
        apart = [b - a >= LEAST_TIME_OF_CHANGES for a, b in zip(starts, stops, strict=True)]
        return [
            Window(run, starts[k], stops[k]) if apart[k] else Window(run, bare[k], bare[k + 1])
            for k in range(len(apart))
        ]

    def payloads(self, stretches: list[Window]) -> tuple[list[PayloadEstimate | None], str]:
        """What each stretch carries, and what no payload explains.

        A stretch in which no mass is beyond doubt carries `None`.
        """
        loads: list[int | None] = list(range(len(stretches)))
        found = self._weighed(stretches, loads)
        unexplained = next((payload.unexplained for payload in found if payload is not None), "")
        if all(payload is None or np.isnan(payload.mass) for payload in found):
            raise DataError(
                "the mass of a payload is not identifiable from this log and model",
                where=self.samples.sources[0].run,
                fix="log motion that turns the payload against gravity, and identify the model "
                "from logs in which all joints move",
            )
        heavy = [p is not None and p.mass > CERTAIN_MASS_STD / Z95 * p.half_width[0] for p in found]
        if all(heavy):
            return found, unexplained
        numbers = iter(range(len(stretches)))
        loads = [next(numbers) if some else None for some in heavy]
        none: list[PayloadEstimate | None] = [None] * len(stretches)
        return (self._weighed(stretches, loads) if any(heavy) else none), unexplained

    def _weighed(
        self, stretches: list[Window], loads: list[int | None]
    ) -> list[PayloadEstimate | None]:
        model = self.identified
        case = combined(
            model.model,
            model.base,
            self.carries,
            [self.samples.during([window]).information() for window in stretches],
            loads,
            [0] * len(stretches),
            drifts=self.drift > 0.0,
            zero={one.name for one in model.estimate.removed},
        )
        fit = fitted_case(model, case, False, self.drift)
        refuse_unexplained_case(model, case, fit)
        return [
            None
            if load is None
            else weighed(
                model, case, fit, case.payloads[load], self.carries, False, self.drift,
                self.gain, PayloadKnowledge(),
            )
            for load in loads
        ]  # fmt: skip


def _changes(
    identified: IdentifiedModel, samples: FilteredSamples, carries: Frame, drift: float
) -> PayloadChanges:
    """Where the statistic exceeds its threshold."""
    columns = samples.layout.columns
    known = identified.estimate.parameters.as_dict()
    values = np.array([known.get(name, 0.0) for name in columns])
    moving = drifting(identified.model, columns) if drift > 0.0 else ()
    deviations = drift * np.abs(values[list(moving)])
    information = _short_windows(identified, samples, carries, values, moving)
    if len(information.windows) < LEAST_WINDOWS_OF_LOG * round(CHANGE_SPAN / CHANGE_STEP):
        raise DataError(
            f"the log has {CHANGE_STEP * len(information.windows):.1f} s in which joints move: "
            "too short "
            "to find when a payload changes",
            where=samples.sources[0].run,
            fix=f"give a log with at least {LEAST_WINDOWS_OF_LOG * CHANGE_SPAN:g} s of motion, "
            "or weigh without --when",
        )
    return changes_of(
        payload_windows(
            information,
            len(moving),
            deviations,
            np.square(identified.estimate.sigma),
            _largest_payload(identified),
        )
    )


def _largest_payload(identified: IdentifiedModel) -> float:
    """Mass that a payload may have [kg]."""
    return max(
        LARGEST_PAYLOAD_SHARE * sum(body.inertia.mass for body in identified.model.robot.bodies),
        1.0,
    )


def _short_windows(
    identified: IdentifiedModel,
    samples: FilteredSamples,
    carries: Frame,
    values: Array,
    moving: tuple[int, ...],
) -> Information:
    """Windows of `CHANGE_STEP`: friction's deviations and a payload; efforts less the model's."""
    columns, model = samples.layout.columns, identified.model
    place = {name: k for k, name in enumerate(identified.base.base_names)}
    lift = payload_lift(model.robot, identified.base, carries)[[place[name] for name in columns]]
    transform = np.zeros((len(columns), len(moving) + 10))
    transform[list(moving), range(len(moving))] = 1.0
    transform[:, len(moving) :] = lift
    number = np.floor((samples.t - samples.t[0]) / CHANGE_STEP).astype(np.intp)
    count = int(number[-1]) + 1
    sees, grams, counts = [], [], np.zeros((count, len(samples.rows)))
    residuals = samples.residuals(values)
    for row, seen in enumerate(samples.layout.sees):
        mine = transform[list(seen)]
        seen_here = np.flatnonzero(np.any(mine != 0.0, axis=0))
        root = np.sqrt(samples.weights[row] * samples.shares[row])[:, None]
        part = root * np.column_stack(
            [samples.rows[row][:, :-1] @ mine[:, seen_here], residuals[row]]
        )
        at = number[samples.at[row]]
        sums = np.zeros((count, part.shape[1], part.shape[1]))
        for window in np.unique(at):
            some = part[at == window]
            sums[window] = some.T @ some
        sees.append(tuple(int(k) for k in seen_here))
        grams.append(packed(sums))
        counts[:, row] = np.bincount(at, weights=root[:, 0] ** 2, minlength=count)
    full = counts.any(axis=1)
    names = (*(columns[k] for k in moving), *(f"payload {k}" for k in range(10)))
    layout = Layout(names, ("1",) * len(names), samples.layout.rows, tuple(sees))
    start = float(samples.t[0])
    return Information(
        layout,
        samples.signature,
        tuple(
            Window(samples.sources[0].run, start + CHANGE_STEP * k, start + CHANGE_STEP * (k + 1))
            for k in np.flatnonzero(full)
        ),
        np.concatenate(grams, axis=1)[full],
        np.full((int(full.sum()), sum(layout.widths)), np.nan),
        counts[full],
    )
