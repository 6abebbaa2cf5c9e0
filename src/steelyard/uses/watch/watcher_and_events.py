"""What a stream is watched by, and its events: external torque, contacts, payload and wrench."""

from collections import Counter, deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import LogError, SteelyardError
from steelyard.estimate.covariance_and_band_widths import rest_speed_of
from steelyard.estimate.external.contact_thresholds import ChangeStepper, ContactThresholds
from steelyard.estimate.external.momentum_observer_with_wrench_and_contact import Observer
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.runs.sample_stream import SampleStream, StreamSample
from steelyard.uses.contact.contact import ContactEvent, ContactStart, ContactStream
from steelyard.uses.effort_plausibility import LARGE_RESIDUAL, LEAST_EXPLAINED
from steelyard.uses.payload.pick_up_and_put_down import PayloadEvent, PayloadEvents
from steelyard.uses.watch.parameters_of_stream import ParameterStream, StreamParameters

SEARCH_PERIOD = 2.0  # time between two searches [s]
SEARCHED_SPAN = 40.0  # latest samples that are searched [s]
FIRST_SEARCH = 10.0  # time of samples before the first search [s]
SAME_EVENT_TIME = 3.0  # difference of the times of one event in two searches, at most [s]

Detect = Callable[[Array], PayloadEvents]
"""Finds the events of consecutive rows as logged; times count from the first one."""


@dataclass(frozen=True, eq=False)
class PayloadState:
    """What is carried at the end of a search."""

    mass: float  # its mass, zero if nothing is carried [kg]
    half_width: float
    least_mass: float  # smallest change of the mass that would be seen, infinite if none would [kg]


class PayloadStream:
    """Finds changes of a payload sample by sample.

    Every `SEARCH_PERIOD` changes are sought in the last `SEARCHED_SPAN`. One that is found twice in
    a row, at about the same time and of the same kind, is reported once.

    Attributes:
        state: What is carried; `None` before the first search that succeeds.
        failed: Why the last search failed; empty if it did not.
    """

    def __init__(self, detect: Detect) -> None:
        self.state: PayloadState | None = None
        self.failed = ""
        self.searches = 0
        self._detect = detect
        self._kept: deque[tuple[float, Array]] = deque()
        self._due = FIRST_SEARCH
        self._candidates: list[PayloadEvent] = []
        self._reported: list[PayloadEvent] = []
        self._least: list[float] = []

    @property
    def least_mass(self) -> float | None:
        """Change of the mass that half of the searches would have seen [kg]; `None` without any."""
        return float(np.quantile(self._least, 0.5, method="higher")) if self._least else None

    def step(self, t: float, row: Array) -> tuple[PayloadEvent, ...]:
        """Take the next sample, a row as logged; the events that are certain with it.

        Its time counts from the first sample [s].
        """
        self._kept.append((t, row))
        if t < self._due:
            return ()
        self._due = t + SEARCH_PERIOD
        while self._kept[0][0] < t - SEARCHED_SPAN:
            self._kept.popleft()
        try:
            found = self._detect(np.array([one for _, one in self._kept]))
        except SteelyardError as error:
            self.failed, self._candidates = error.wrong, []
            return ()
        self.failed, self.searches = "", self.searches + 1
        start = self._kept[0][0]
        last = [one for one in found.carried if one.stop >= t - start - SAME_EVENT_TIME]
        latest = last[-1].payload if last else None
        carried = (latest.mass, float(latest.half_width[0])) if latest else (0.0, np.nan)
        self.state = PayloadState(*carried, found.least_mass)
        self._least.append(found.least_mass)
        times = ((x, x.time + start, x.earliest + start, x.latest + start) for x in found.events)
        events = [replace(x, time=t, earliest=low, latest=high) for x, t, low, high in times]
        twice = [event for event in events if _known(event, self._candidates)]
        certain = [event for event in twice if not _known(event, self._reported)]
        self._candidates = events
        self._reported = [*self._reported, *certain][-100:]
        return tuple(certain)


def _known(event: PayloadEvent, others: list[PayloadEvent]) -> bool:
    return any(
        other.kind == event.kind
        and other.earliest - SAME_EVENT_TIME <= event.time <= other.latest + SAME_EVENT_TIME
        for other in others
    )


DOUBT_SHARE = 0.5  # share of the time with residuals beyond thresholds that means something lasts
LEAST_DOUBT_TIME = 5.0  # least time of samples, or beyond thresholds, until it is said [s]

LIKELIER = "other efforts, units or signs, a payload or another tool are likelier than contact"


class Doubt:
    """Counts what `steelyard contact` refuses or warns of, sample by sample.

    Attributes:
        text: Why residuals may be no contact, for people to read; empty without doubt.
    """

    def __init__(self, sigma: Array) -> None:
        """Begin; `sigma` is the standard deviation of the residual of the fit, `(n,)` [Nm; N]."""
        self.text = ""
        self._weights = 1.0 / np.square(sigma)
        self._seconds = self._beyond = 0.0
        self._squares = np.zeros(2)

    def step(self, seconds: float, beyond: bool, residual: Array, measured: Array) -> None:
        """Take the next sample, some seconds after the one before; zero after a pause.

        `beyond` says that a residual is beyond its threshold; efforts are `(n,)` [Nm; N].
        """
        self._seconds += seconds
        self._beyond += seconds * beyond
        sizes = (residual @ (self._weights * residual), measured @ (self._weights * measured))
        self._squares += seconds / len(residual) * np.array(sizes)
        if self._seconds < LEAST_DOUBT_TIME:
            return
        left, whole = (float(x) / self._seconds for x in self._squares)
        if left > LARGE_RESIDUAL**2 and left > (1.0 - LEAST_EXPLAINED) * whole:
            share = max(0.0, 1.0 - left / whole) if whole else 0.0
            self.text = (
                f"the model explains {100.0 * share:.0f} % of the squared efforts of "
                f"{self._seconds:.0f} s: {LIKELIER}"
            )
        elif self._beyond > max(LEAST_DOUBT_TIME, DOUBT_SHARE * self._seconds):
            self.text = (
                f"residuals exceed their thresholds in {self._beyond:.0f} of {self._seconds:.0f} "
                f"s: {LIKELIER}"
            )


LEAST_CONTACT_PERIODS = 0.05
"""Part of the period of the observer's bandwidth for which a residual exceeds its threshold in a
contact: a force makes it exceed for longer, a velocity that jumps for a single sample does not."""

LEAST_USED_SHARE = 0.01  # share of the samples that must follow another one without a pause


@dataclass(frozen=True, eq=False)
class StreamEstimate:
    """External efforts at a sample."""

    time: float
    torque: Array  # of each joint, shape `(n,)` [Nm; N]
    half_width: Array  # half-widths of the 95 % intervals, likewise
    wrench: Array | None  # force [N] and moment [Nm] on the frame, `(6,)`; `None` without
    wrench_half_width: Array | None  # likewise


@dataclass(frozen=True)
class StreamNote:
    """What whoever reads the results should know of samples up to a time [s]."""

    time: float
    text: str


StreamEvent = (
    ContactStart | ContactEvent | PayloadEvent | StreamEstimate | StreamNote | StreamParameters
)
"""What a stream reports, in the order in which it becomes known."""


def rests_of(identified: IdentifiedModel) -> Array:
    """Speed up to which friction of each joint is anywhere in its dead zone, `(n,)` [rad/s; m/s].

    Friction with memory predicts where, so that it is zero.
    """
    n = identified.robot.n
    if identified.model.has_memory:
        return np.zeros(n)
    return rest_speed_of(n, identified.calibration, identified.processing.rest_speed)


def velocity_of(dq: Array, rest: Array) -> Array:
    """Velocities, zero where joints rest: friction of either sign by noise is none there."""
    return np.where(np.abs(dq) > rest, dq, 0.0)


class Watcher:
    """Takes rows, reports what happens.

    Attributes:
        thresholds: Of contact; `None` if it is not sought.
        observer: External efforts at the last sample.
        payload: What seeks changes of the payload; `None` if nothing does.
        parameters: What estimates changes from the model; `None` if nothing does.
        time: Of the last sample, from the first one [s].
        ratio: Largest residual over its threshold there; NaN without thresholds.
    """

    def __init__(
        self,
        identified: IdentifiedModel,
        observer: Observer,
        frame: str | None = None,
        thresholds: ContactThresholds | None = None,
        payload: PayloadStream | None = None,
        every: float | None = None,
        parameters: ParameterStream | None = None,
    ) -> None:
        """Begin with a new observer, whose bandwidth is the cut-off of the thresholds of contact.

        Estimates are reported of every sample, or with a time between them [s].
        """
        robot = identified.model.robot
        self.frame, self.thresholds, self.observer = frame, thresholds, observer
        self.payload, self.parameters = payload, parameters
        self.samples = SampleStream(identified.signals, robot)
        self.time, self.ratio = 0.0, np.nan
        self._gains, self._rest = identified.signals.gains, rests_of(identified)
        self._stepper = None if thresholds is None else thresholds.start()
        self._changes = None if thresholds is None else ChangeStepper(thresholds.changes)
        sigma = np.asarray(identified.estimate.sigma)
        self._contact = ContactStream(robot, sigma, LEAST_CONTACT_PERIODS / observer.bandwidth)
        self._every, self._due = 0.0 if every is None else every, -np.inf
        self._largest = np.zeros(robot.n)
        self._counts: Counter[str] = Counter()
        self._noted: set[object] = set()
        self._doubt = Doubt(sigma)

    def take(self, rows: Array) -> Iterator[StreamEvent]:
        """Take consecutive rows of the columns `samples.columns`.

        Raises:
            DataError: Samples come less than ten times per period of the bandwidth.
        """
        for sample in self.samples.samples(rows):
            yield from self._sample(sample)
        for verdict in self.samples.dropped:
            why = f"a row has {verdict.reason}: it is left out, as all such rows"
            yield from self._once(verdict, why)
        if self.samples.restarts > 0:
            why = "the clock was set back: times go on one second later"
            yield from self._once(("restart", self.samples.restarts), why)

    def end(self) -> Iterator[StreamEvent]:
        """What is left to report at the end of the stream: a contact that lasts."""
        if self._contact.active:
            yield self._contact.ended()

    @property
    def summary(self) -> dict[str, Any]:
        """What was seen so far, as JSON values but for a `least_mass_kg` that may be infinite.

        `payload_not_sought` says why the last search for changes of the payload was not possible;
        `least_mass_kg` is the change of its mass that half of the searches would have seen.
        """
        failed, state, least = "", None, None
        if self.payload is not None:
            state, least = self.payload.state, self.payload.least_mass
            failed = self.payload.failed or ("" if self.payload.searches else "too few samples")
        carried = state if state is not None and state.mass else None
        return {
            "event": "summary",
            "duration_s": self.time,
            "samples": self.observer.steps,
            "dropped_rows": {one.reason: count for one, count in self.samples.dropped.items()},
            "gaps": max(self.observer.gaps - 1, 0),
            "contacts": self._counts["contact"],
            "payload_changes": self._counts["payload"],
            "largest_torque": self._largest.tolist(),
            "payload_not_sought": failed,
            "carried_kg": carried and carried.mass,
            "carried_half_width_kg": carried and carried.half_width,
            "least_mass_kg": least,
            "doubt": self._doubt.text or None,
        }

    @property
    def started(self) -> bool:
        """Whether samples followed another without a pause, so that something was observed."""
        return self.observer.steps > self.observer.gaps

    def refuse_unusable(self, source: str) -> None:
        """Rows that arrived can be watched."""
        samples, left_out = self.observer.steps, self.samples.dropped.total()
        if not samples + left_out or samples - self.observer.gaps > LEAST_USED_SHARE * samples:
            return
        kinds = self.samples.dropped.items()
        reasons = ", ".join(f"{count} with {verdict.reason}" for verdict, count in kinds)
        why = []
        if left_out:
            why.append(f"{left_out} of {samples + left_out} rows are left out ({reasons})")
        if samples:
            why.append(f"{samples} {'comes' if samples == 1 else 'come'} alone or after a pause")
        raise LogError(
            f"nothing was watched: {'; '.join(why)}",
            where=source,
            fix="give rows in the order of time, with the columns and units of the robot file, "
            "time_unit among them",
        )

    def _sample(self, sample: StreamSample) -> Iterator[StreamEvent]:
        observer, since, gaps = self.observer, sample.t - self.time, self.observer.gaps
        effort = self._gains * sample.effort
        observer.step(sample.t, sample.q, velocity_of(sample.dq, self._rest), effort)
        self.time = sample.t
        torque = observer.torque
        self._largest = np.maximum(self._largest, np.abs(torque))
        gap = observer.gaps > gaps
        if gap and gaps:
            yield from self._once(
                "gap",
                f"no samples for {since:.2g} s: the observer begins anew there, as after every "
                "such pause",
            )
        for event in self._touched(sample, -torque, gap):
            self._counts["contact"] += isinstance(event, ContactStart)
            yield event
        self._doubt.step(0.0 if gap else since, self._contact.active, torque, effort)
        if self._doubt.text:
            yield from self._once("doubt", self._doubt.text)
        if self.payload is not None:
            for change in self.payload.step(sample.t, sample.row):
                self._counts["payload"] += 1
                if self.parameters is not None:
                    self.parameters.spoil()
                yield change
        if self.parameters is not None:
            state = None if self.payload is None else self.payload.state
            if state is not None and state.mass:
                self.parameters.spoil()
            published = self.parameters.step(sample.t, sample.row)
            if published is not None:
                yield published
        if sample.t >= self._due:
            self._due = sample.t + self._every
            half, on = observer.torque_half_width, self.frame is not None
            wrench = (observer.wrench, observer.half_width) if on else (None, None)
            yield StreamEstimate(self.time, torque, half, *wrench)

    def _touched(
        self, sample: StreamSample, residual: Array, gap: bool
    ) -> Iterator[ContactStart | ContactEvent]:
        if self.thresholds is None or self._stepper is None or self._changes is None:
            return
        level = self._stepper.step(sample.t, sample.dq)
        if gap:
            self._changes.begin()
        self._changes.step(sample.t, self._stepper.resting, residual)
        signal = np.stack([residual, self._changes.change])
        limits = np.stack([level, self.thresholds.changes])
        self.ratio = float(np.nanmax(np.abs(signal / limits), initial=0.0))
        times = (sample.t, self._changes.time)
        yield from self._contact.step(sample.t, signal, limits, times, gap=gap)

    def _once(self, key: object, text: str) -> Iterator[StreamNote]:
        if key not in self._noted:
            self._noted.add(key)
            yield StreamNote(self.time, text)
