"""What a robot picks up and puts down along a run, when, and how heavy it is."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import compress, count, pairwise
from math import hypot
from typing import Any, Literal

import numpy as np

from steelyard.base.arrays import Z95
from steelyard.base.errors import DataError
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.estimate.information.information import Window
from steelyard.estimate.information.kept_filtered_samples import FilteredSamples
from steelyard.estimate.payload.payload_estimate import PayloadEstimate
from steelyard.estimate.payload.runs_with_payload import carrier, combined, drifting, payload_lift
from steelyard.robot.robot import Frame
from steelyard.uses.payload import change_detection as detection
from steelyard.uses.payload.payload_fit import (
    FRICTION_DRIFT,
    NOTHING_KNOWN,
    fitted_case,
    gain_share,
    refuse_unexplained_case,
    weighed,
)

CERTAIN_MASS_STD = 3.0  # standard deviations of a mass, or of its change, from which on it counts
LARGEST_PAYLOAD_SHARE = 0.1  # mass that a payload may have, over that of the moving links

Kind = Literal["picked up", "put down"]


@dataclass(frozen=True, eq=False)
class Carried:
    """A payload between two times [s]."""

    start: float
    stop: float
    payload: PayloadEstimate


@dataclass(frozen=True, kw_only=True)
class PayloadEvent(detection.PayloadChange):
    """A change of what is carried; in a pause its time is the middle."""

    kind: Kind
    mass: float  # by how much the mass changes [kg]
    mass_half_width: float  # half-width of its 95 % interval


@dataclass(frozen=True, eq=False)
class PayloadEvents:
    """All changes of what a robot carries along a run."""

    run: str
    frame: str
    body: str  # the link that carries them
    events: tuple[PayloadEvent, ...]
    carried: tuple[Carried, ...]
    alarms_per_hour: float  # false events that the threshold allows
    inflation: float  # how many times larger the statistic is than by normal, white residuals
    least_mass: float  # change by a mass at the frame's origin that half of the log would show [kg]
    # whether changes are found, or one by as much as a payload may have (`LARGEST_PAYLOAD_SHARE`)
    # would be
    conclusive: bool
    notes: tuple[str, ...]  # what was taken for granted, for people to read
    sliding: detection.SlidingMass
    unexplained: str = ""  # what no payload explains; empty if there is nothing

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


def find_payload_events(
    identified: IdentifiedModel,
    samples: FilteredSamples,
    frame: str | None = None,
    *,
    gain: float | None = None,
) -> PayloadEvents:
    """Find when a payload changes along one run, and weigh what is carried between.

    Efforts are as logged; `gain` is as of `identify_payload`.
    """
    share = gain_share(identified, gain)
    carries = carrier(identified.model.robot, frame)
    samples = samples.scaled(identified.signals.gains, identified.model.robot.effort_units)
    found = _changes(identified, samples, carries)
    weigher = _Weigher(identified, samples, carries, share)
    changes = list(found.changes)
    while True:
        stretches = weigher.stretches(changes)
        payloads, unexplained = weigher.payloads(stretches)
        # mass and half-width of its interval of each payload, and of changes between them
        own = [(0.0, 0.0) if p is None else (p.mass, float(p.half_width[0])) for p in payloads]
        masses = [(new[0] - old[0], hypot(old[1], new[1])) for old, new in pairwise(own)]
        differ = [abs(mass) > CERTAIN_MASS_STD / Z95 * half for mass, half in masses]
        if all(differ):
            break
        changes = list(compress(changes, differ))
    events = tuple(
        PayloadEvent(
            **vars(change),
            kind="picked up" if mass > 0.0 else "put down",
            mass=abs(mass),
            mass_half_width=half,
        )
        for change, (mass, half) in zip(changes, masses, strict=True)
    )
    each = zip(stretches, payloads, strict=True)
    carried = tuple(Carried(at.start, at.stop, one) for at, one in each if one is not None)
    digits = 0 if found.inflation >= 10.0 else 1
    return PayloadEvents(
        run=samples.sources[0].run,
        frame=carries.name,
        body=identified.model.robot.bodies[carries.body].name,
        events=events,
        carried=carried,
        alarms_per_hour=detection.FALSE_EVENTS_PER_HOUR,
        inflation=found.inflation,
        least_mass=found.least_mass,
        conclusive=bool(events) or found.least_mass <= _largest_payload(identified),
        notes=(
            f"threshold for {detection.FALSE_EVENTS_PER_HOUR:g} false events per hour; residuals "
            f"along the log make the statistic {found.inflation:.{digits}f} times larger than "
            "normal, white ones would",
            f"smallest change of the mass that would be detected: {found.least_mass:.2g} kg (for a "
            "mass at the frame's origin, in at least half of the log)",
            *(carried[0].payload.notes if carried else ()),
        ),
        sliding=found.sliding,
        unexplained=unexplained,
    )


@dataclass(frozen=True, eq=False)
class _Weigher:
    """Weighs what is carried between changes; arm, friction and payloads in one fit."""

    identified: IdentifiedModel
    samples: FilteredSamples
    carries: Frame
    gain: float

    def stretches(self, changes: list[detection.PayloadChange]) -> list[Window]:
        """Time between the changes, without their intervals where that leaves enough."""
        run, first, last = self.samples.sources[0].run, *map(float, self.samples.t[[0, -1]])
        bare = pairwise([first, *(change.time for change in changes), last])
        starts = [first, *(change.latest for change in changes)]
        stops = [*(change.earliest for change in changes), last]
        return [
            Window(run, *((a, b) if b - a >= detection.LEAST_TIME_OF_CHANGES else ends))
            for a, b, ends in zip(starts, stops, bare, strict=True)
        ]

    def payloads(self, stretches: list[Window]) -> tuple[list[PayloadEstimate | None], str]:
        """What each stretch carries, `None` if its mass is in doubt, and what is unexplained."""
        found = self._weighed(stretches, list(range(len(stretches))))
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
        if not any(heavy):
            return [None] * len(stretches), unexplained
        numbers = count()
        loads = [next(numbers) if some else None for some in heavy]
        return self._weighed(stretches, loads), unexplained

    def _weighed(
        self, stretches: list[Window], loads: Sequence[int | None]
    ) -> list[PayloadEstimate | None]:
        model = self.identified
        parts = [self.samples.during([window]).information() for window in stretches]
        one_run, zero = [0] * len(parts), {one.name for one in model.estimate.removed}
        case = combined(model.model, model.base, self.carries, parts, loads, one_run, zero=zero)
        fit = fitted_case(model, case, False)
        refuse_unexplained_case(model, case, fit)
        given = self.carries, False, self.gain, NOTHING_KNOWN
        return [
            None if load is None else weighed(model, case, fit, case.payloads[load], *given)
            for load in loads
        ]


def _changes(
    identified: IdentifiedModel, samples: FilteredSamples, carries: Frame
) -> detection.PayloadChanges:
    """Where the statistic exceeds its threshold.

    It is computed from sums of products in windows of `CHANGE_STEP`: of friction's deviations, of
    a payload's columns, and of the efforts less the model's.
    """
    columns, model = samples.layout.columns, identified.model
    known = identified.estimate.parameters.as_dict()
    values = np.array([known.get(name, 0.0) for name in columns])
    moving = list(drifting(model, columns))
    place = {name: k for k, name in enumerate(identified.base.base_names)}
    lift = payload_lift(model.robot, identified.base, carries)[[place[name] for name in columns]]
    transform = np.hstack([np.eye(len(columns))[:, moving], lift])
    number = np.floor((samples.t - samples.t[0]) / detection.CHANGE_STEP).astype(np.intp)
    width, length = len(moving) + 11, int(number[-1]) + 1
    grams, full = np.zeros((length, width, width)), np.zeros(length, dtype=bool)
    for row, (seen, residual) in enumerate(
        zip(samples.layout.sees, samples.residuals(values), strict=True)
    ):
        mine, at = transform[list(seen)], number[samples.at[row]]
        seen_here = np.flatnonzero(np.any(mine != 0.0, axis=0))
        weights = samples.weights[row] * samples.shares[row]
        moved = samples.rows[row][:, :-1] @ mine[:, seen_here]
        part = np.sqrt(weights)[:, None] * np.column_stack([moved, residual])
        index = np.ix_([*seen_here, width - 1], [*seen_here, width - 1])
        for window in np.unique(at):
            some = part[at == window]
            grams[window][index] += some.T @ some / np.square(identified.estimate.sigma[row])
        full[at[weights != 0.0]] = True
    windows = round(detection.CHANGE_SPAN / detection.CHANGE_STEP)
    if full.sum() < detection.LEAST_WINDOWS_OF_LOG * windows:
        least = detection.LEAST_WINDOWS_OF_LOG * detection.CHANGE_SPAN
        raise DataError(
            f"the log has {detection.CHANGE_STEP * full.sum():.1f} s in which joints move: too "
            "short to find when a payload changes",
            where=samples.sources[0].run,
            fix=f"give a log with at least {least:g} s of motion, or weigh without --when",
        )
    starts = np.asarray(float(samples.t[0]) + detection.CHANGE_STEP * np.flatnonzero(full))
    deviations, most = FRICTION_DRIFT * np.abs(values[moving]), _largest_payload(identified)
    return detection.changes_of(
        detection.payload_windows(
            starts, starts + detection.CHANGE_STEP, grams[full], deviations, most
        )
    )


def _largest_payload(identified: IdentifiedModel) -> float:
    """Mass that a payload may have [kg]."""
    links = sum(body.inertia.mass for body in identified.model.robot.bodies)
    return max(LARGEST_PAYLOAD_SHARE * links, 1.0)
