"""External torque, contacts, payload and wrench on rows as they arrive."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import LogError
from steelyard.estimate.effort_uncertainty import rest_speed_of
from steelyard.estimate.external.observer import Observer
from steelyard.estimate.external.residual_peaks import ContactThresholds
from steelyard.estimate.external.rest_changes import ChangeStepper
from steelyard.estimate.friction.mixes import has_memory
from steelyard.estimate.identified import IdentifiedModel
from steelyard.runs.sample_stream import SampleStream, StreamSample
from steelyard.uses.contact.contact_events import ContactEvent
from steelyard.uses.other_efforts import LARGE_RESIDUAL, LEAST_EXPLAINED
from steelyard.uses.payload.payload_events import PayloadEvent
from steelyard.uses.watch.stream_events import (
    ContactStart,
    ContactStream,
    ContactTest,
    PayloadStream,
)

DOUBT_SHARE = 0.5
"""Share of the time from which on residuals beyond their thresholds mean that something lasts."""

LEAST_DOUBT_TIME = 5.0
"""Time of samples, or of residuals beyond their thresholds, from which on it is said [s]."""

LIKELIER = "other efforts, units or signs, a payload or another tool are likelier than contact"


class Doubt:
    """Counts what `steelyard contact` refuses or warns of, sample by sample.

    Attributes:
        text: Why residuals may be no contact, for people to read; empty without doubt.
    """

    def __init__(self, sigma: Array) -> None:
        """Begin.

        Args:
            sigma: Standard deviation of the residual of the fit per joint, shape `(n,)` [Nm; N].
        """
        self.text = ""
        self._weights = 1.0 / np.square(sigma)
        self._seconds = self._beyond = 0.0
        self._squares = np.zeros(2)

    def step(self, seconds: float, beyond: bool, residual: Array, measured: Array) -> None:
        """Take the next sample.

        Args:
            seconds: Time since the sample before; zero after a pause.
            beyond: Whether a residual is beyond its threshold.
            residual: Shape `(n,)` [Nm; N].
            measured: Measured effort, likewise.
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

LEAST_USED_SHARE = 0.01
"""Share of the samples that must follow another one without a pause."""


@dataclass(frozen=True, eq=False)
class StreamEstimate:
    """External efforts at a sample.

    Attributes:
        time: When [s].
        torque: Of each joint, shape `(n,)` [Nm; N].
        half_width: Half-widths of the 95 % intervals, likewise.
        wrench: Force [N] and moment [Nm] on the frame, shape `(6,)`; `None` without a frame.
        wrench_half_width: Likewise.
    """

    time: float
    torque: Array
    half_width: Array
    wrench: Array | None
    wrench_half_width: Array | None


@dataclass(frozen=True)
class StreamNote:
    """Something about the samples that whoever reads the results should know.

    Attributes:
        time: When [s].
    """

    time: float
    text: str


StreamEvent = ContactStart | ContactEvent | PayloadEvent | StreamEstimate | StreamNote
"""What a stream reports, in the order in which it becomes known."""


@dataclass(frozen=True)
class StreamSummary:
    """What was seen of a stream.

    Attributes:
        duration: Time from the first to the last sample [s].
        dropped: Rows that were left out, and why.
        gaps: Pauses after which the observer began anew.
        payload_changes: Number of changes of the payload.
        largest: Largest external effort of each joint by size [Nm; N].
        payload: Why the last search for changes of the payload was not possible; empty if it was.
        doubt: Why residuals may be no contact; empty without doubt.
        least_mass: Change of the payload's mass that half of the searches would have seen,
            infinite if they would have seen none [kg]; `None` without a search.
        carried: Mass of the payload at the last search and half-width of its 95 % interval [kg];
            `None` if there was none, or no search.
    """

    duration: float
    samples: int
    dropped: dict[str, int]
    gaps: int
    contacts: int
    payload_changes: int
    largest: tuple[float, ...]
    payload: str
    doubt: str
    least_mass: float | None = None
    carried: tuple[float, float] | None = None


def rests_of(identified: IdentifiedModel) -> Array:
    """Speed up to which friction of each joint is anywhere in its dead zone, `(n,)` [rad/s; m/s].

    Friction with memory predicts where, so that it is zero.
    """
    n = identified.robot.n
    if has_memory(identified.model.terms):
        return np.zeros(n)
    return rest_speed_of(n, identified.calibration, identified.processing.rest_speed)


def velocity_of(dq: Array, rest: Array) -> Array:
    """Velocities, zero where joints rest: friction of either sign by noise is none there."""
    return np.where(np.abs(dq) > rest, dq, 0.0)


class Watcher:
    """Takes rows, reports what happens.

    Attributes:
        frame: Frame of the wrench; `None` without.
        thresholds: Of contact; `None` if it is not sought.
        samples: What makes samples of the rows.
        observer: External efforts at the last sample.
        payload: What seeks changes of the payload; `None` if nothing does.
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
    ) -> None:
        """Begin.

        Args:
            identified: The model.
            observer: A new one, with the cut-off of the thresholds as bandwidth.
            frame: Its frame, if the wrench is wanted.
            thresholds: Of contact.
            payload: What seeks changes of the payload.
            every: Time between two estimates that are reported [s]; of every sample if `None`.
        """
        robot = identified.model.robot
        self.frame, self.thresholds, self.observer = frame, thresholds, observer
        self.payload = payload
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
        self._doubt = Doubt(np.asarray(identified.estimate.sigma))

    def take(self, rows: Array) -> Iterator[StreamEvent]:
        """Take consecutive rows of the columns `samples.columns`.

        Raises:
            DataError: Samples come less than ten times per period of the bandwidth.
        """
        for sample in self.samples.samples(rows):
            yield from self._sample(sample)
        yield from self._rows_noted()

    def end(self) -> Iterator[StreamEvent]:
        """What is left to report at the end of the stream: a contact that lasts."""
        if self._contact.active:
            yield self._counted(self._contact.ended())

    @property
    def summary(self) -> StreamSummary:
        """What was seen so far."""
        failed = "" if self.payload is None else self.payload.failed
        state = None if self.payload is None else self.payload.state
        if self.payload is not None and not self.payload.searches:
            failed = failed or "too few samples"
        return StreamSummary(
            self.time,
            self.observer.steps,
            {verdict.reason: count for verdict, count in self.samples.dropped.items()},
            max(self.observer.gaps - 1, 0),
            self._counts["contact"],
            self._counts["payload"],
            tuple(self._largest.tolist()),
            failed,
            self._doubt.text,
            None if self.payload is None else self.payload.least_mass,
            None if state is None or not state.mass else (state.mass, state.half_width),
        )

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
        why = [f"{left_out} of {samples + left_out} rows are left out ({reasons})"] * bool(left_out)
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
        velocity = velocity_of(sample.dq, self._rest)
        observer.step(sample.t, sample.q, velocity, self._gains * sample.effort)
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
        if self._stepper is not None:
            for event in self._touched(sample, -torque, gap):
                yield self._counted(event)
        effort = self._gains * sample.effort
        self._doubt.step(0.0 if gap else since, self._contact.active, torque, effort)
        yield from self._once("doubt", self._doubt.text, bool(self._doubt.text))
        if self.payload is not None:
            for change in self.payload.step(sample.t, sample.row):
                self._counts["payload"] += 1
                yield change
        if sample.t >= self._due:
            self._due = sample.t + self._every
            yield self._estimate(torque)

    def _touched(
        self, sample: StreamSample, residual: Array, gap: bool
    ) -> Iterator[ContactStart | ContactEvent]:
        """Contacts that begin or end at a sample."""
        stepper, changes, thresholds = self._stepper, self._changes, self.thresholds
        assert stepper is not None and changes is not None and thresholds is not None
        limits = stepper.step(sample.t, sample.dq)
        if gap:
            changes.begin()
        changes.step(sample.t, stepper.resting, residual)
        level = ContactTest(sample.t, residual, limits)
        change = ContactTest(changes.time, changes.change, thresholds.changes)
        sizes = np.abs([residual / limits, changes.change / thresholds.changes])
        self.ratio = float(np.nanmax(sizes, initial=0.0))
        yield from self._contact.step(sample.t, level, change, gap)

    def _counted(self, event: ContactStart | ContactEvent) -> ContactStart | ContactEvent:
        self._counts["contact"] += isinstance(event, ContactStart)
        return event

    def _estimate(self, torque: Array) -> StreamEstimate:
        observer, on = self.observer, self.frame is not None
        return StreamEstimate(
            self.time,
            torque,
            observer.torque_half_width,
            observer.wrench if on else None,
            observer.half_width if on else None,
        )

    def _rows_noted(self) -> Iterator[StreamNote]:
        for verdict in self.samples.dropped:
            yield from self._once(
                verdict, f"a row has {verdict.reason}: it is left out, as all such rows"
            )
        yield from self._once(
            ("restart", self.samples.restarts),
            "the clock was set back: times go on one second later",
            self.samples.restarts > 0,
        )

    def _once(self, key: object, text: str, holds: bool = True) -> Iterator[StreamNote]:
        if holds and key not in self._noted:
            self._noted.add(key)
            yield StreamNote(self.time, text)
