r"""Contact from residuals: events, the links that were touched, calibration runs without contact.

A force on a link loads the joints between it and the base, and no joint beyond it: if the residual
of a joint exceeds its threshold, the contact is on a link that this joint carries.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from steelyard.base.arrays import Array
from steelyard.estimate.external.residual_peaks import ContactThresholds, ResidualPeaks
from steelyard.estimate.external.rest_changes import ONSET
from steelyard.estimate.scores.residuals import ResidualTrace
from steelyard.robot.robot import Robot

RELEASE = 0.5
"""A contact ends where the residual falls below that share of the threshold that it exceeded."""

LEAST_TIME_APART = 0.5
"""Least time between two events [s]."""


CALIBRATION_STRETCHES = 4
"""Stretches that a single calibration run is compared in."""

EXPECTED_EXCEEDANCES = 0.02
"""Exceedances expected in all calibration runs together at the thresholds of contact."""

SUSPECT_MARGIN = 1.0
"""Time beside a suspected contact that is left out with it [s]."""


@dataclass(frozen=True)
class JointLoad:
    """What one joint shows of a contact.

    Attributes:
        joint: Its name.
        unit: Of its effort, `Nm` or `N`.
        peak: Largest residual, measured minus predicted effort, or largest change of it at rest:
            that which exceeds its threshold more.
        sigmas: Its size in standard deviations of the residual of the fit.
        ratio: Of its size to the threshold.
        change: Whether it is a change at rest.
    """

    joint: str
    unit: str
    peak: float
    sigmas: float
    ratio: float
    change: bool


@dataclass(frozen=True)
class ContactEvent:
    """A stretch in which residuals exceed their thresholds.

    Attributes:
        start: When a threshold was exceeded first, from the log's start [s].
        end: When the last joint was released [s].
        known: When it can be known [s]: changes at rest are decided a little later than they begin.
        joints: Joints that exceed their thresholds, the clearest first.
        links: Links that the contact may be on: those that all these joints carry.
    """

    start: float
    end: float
    known: float
    joints: tuple[JointLoad, ...]
    links: tuple[str, ...]

    @property
    def place(self) -> str:
        """Where the contact is, for people to read."""
        return place_of(self.links)

    def to_dict(self) -> dict[str, Any]:
        """As JSON values; `link` is known where only one is possible."""
        return {
            "start_s": self.start,
            "end_s": self.end,
            "known_s": self.known,
            "joint": self.joints[0].joint,
            "joints": [vars(joint) for joint in self.joints],
            "link": self.links[0] if len(self.links) == 1 else None,
            "links": list(self.links),
        }


def place_of(links: Sequence[str]) -> str:
    """Where a contact on one of some links is, for people to read."""
    if not links:
        return "several branches"
    return links[0] if len(links) == 1 else f"{links[0]} or beyond"


def contacts_in(
    trace: ResidualTrace, thresholds: ContactThresholds, robot: Robot, sigma: Array
) -> tuple[ContactEvent, ...]:
    """Stretches of a run in which residuals exceed their thresholds.

    Args:
        trace: Residuals behind the low-pass of the thresholds.
        thresholds: Per joint and speed.
        robot: The robot.
        sigma: Standard deviation of the residual of the fit per joint, shape `(n,)` [Nm; N].
    """
    tests = _tests(trace, thresholds)
    spans = sorted(
        _Span(start, stop, j, k)
        for k, (signal, limits) in enumerate(tests)
        for j in range(len(signal))
        for start, stop in _exceeded(np.abs(signal[j]), limits[j], trace.t, trace.step)
    )
    groups: list[list[_Span]] = []
    latest = -np.inf
    for span in spans:
        if not groups or trace.t[span.start] - latest > LEAST_TIME_APART:
            groups.append([])
        groups[-1].append(span)
        latest = max(latest, float(trace.t[span.stop - 1]))
    return tuple(_event(group, trace, tests, robot, sigma) for group in groups)


class _Span(NamedTuple):
    """Samples in which a joint exceeds the thresholds of a test."""

    start: int
    stop: int
    joint: int
    test: int


REST_CHANGE_TEST = 1
"""Number of the test of changes at rest."""

_Tests = tuple[tuple[Array, Array], tuple[Array, Array]]
"""Residuals and their thresholds, changes at rest and theirs, shapes `(n, N)`."""


def _tests(trace: ResidualTrace, thresholds: ContactThresholds) -> _Tests:
    changes = trace.changes(thresholds.edges)
    levels = thresholds.at(trace.ranges(thresholds.edges))
    limits = np.broadcast_to(thresholds.changes[:, None], changes.shape)
    return (trace.residual, levels), (changes, limits)


def _exceeded(size: Array, limit: Array, t: Array, step: float) -> list[tuple[int, int]]:
    """First sample, and the one after the last, of every stretch of one joint; none over a gap."""
    found, at = [], 0
    above = np.flatnonzero(size > limit)
    while (left := above[above >= at]).size:
        start = int(left[0])
        ends = ~(size[start:] >= RELEASE * limit[start]) | (
            np.diff(t[start:], prepend=t[start]) > 2.0 * step
        )
        at = start + int(np.argmax(ends)) if ends.any() else len(size)
        found.append((start, at))
    return found


def _event(
    spans: Sequence[_Span], trace: ResidualTrace, tests: _Tests, robot: Robot, sigma: Array
) -> ContactEvent:
    joints = sorted({span.joint for span in spans})
    loads = [
        _load([span for span in spans if span.joint == j], tests, robot, sigma) for j in joints
    ]
    return ContactEvent(
        float(trace.t[min(span.start for span in spans)]),
        float(trace.t[max(span.stop for span in spans) - 1]),
        min(float(trace.t[span.start]) + ONSET * (span.test == REST_CHANGE_TEST) for span in spans),
        tuple(sorted(loads, key=lambda load: -load.ratio)),
        links_carried_by(robot, joints),
    )


def _load(spans: Sequence[_Span], tests: _Tests, robot: Robot, sigma: Array) -> JointLoad:
    """What one joint shows in its spans: the sample that exceeds its threshold most."""
    j, found = spans[0].joint, []
    for start, stop, _, k in spans:
        signal, limits = (x[j, start:stop] for x in tests[k])
        ratios = np.abs(signal) / limits
        most = int(np.argmax(ratios))
        found.append((float(ratios[most]), float(signal[most]), k == REST_CHANGE_TEST))
    ratio, peak, change = max(found)
    coordinate = robot.coordinates[j]
    sigmas = abs(peak) / float(sigma[j])
    return JointLoad(coordinate.name, coordinate.effort_unit, peak, sigmas, ratio, change)


def links_carried_by(robot: Robot, joints: Sequence[int]) -> tuple[str, ...]:
    """Links that all of some joints carry, parents before children."""
    carried: list[set[int]] = []
    for body in robot.bodies:
        before = carried[body.parent] if body.parent >= 0 else set()
        carried.append(before | {body.coordinate})
    return tuple(
        body.name
        for body, by in zip(robot.bodies, carried, strict=True)
        if by.issuperset(joints) and not body.massless
    )


@dataclass(frozen=True)
class SuspectedContact:
    """A stretch of a calibration run that other motion does not explain."""

    run: str
    event: ContactEvent

    @property
    def text(self) -> str:
        """For people to read."""
        load = self.event.joints[0]
        return (
            f"{self.run} contains contact at {self.event.start:.1f} to {self.event.end:.1f} s "
            f"({load.joint}: {abs(load.peak):.3g} {load.unit}, {load.ratio:.2g} times what the "
            "other calibration motion explains): left out of the calibration"
        )


def without_contact(
    traces: Sequence[ResidualTrace],
    edges: Array,
    cutoff: float,
    robot: Robot,
    sigma: Array,
    known: ResidualPeaks | None = None,
) -> tuple[ResidualPeaks, tuple[SuspectedContact, ...]]:
    """Largest residuals of calibration runs, without stretches that contain contact.

    Every run is compared with thresholds from all others, which all of them together exceed with a
    probability of `EXPECTED_EXCEEDANCES`; the run that exceeds them most loses what exceeds them,
    until none does. A single run is compared in stretches.

    Args:
        traces: Residuals of the runs.
        edges: Ranges of speed, see `ResidualPeaks`.
        cutoff: Low-pass of the residuals [Hz].
        robot: The robot.
        sigma: Standard deviation of the residual of the fit per joint, shape `(n,)` [Nm; N].
        known: What the model knows of its own left-out motion, to compare with.
    """
    alike = known is not None and known.cutoff == cutoff and np.array_equal(known.edges, edges)
    beside = [known] if known is not None and alike else []
    parts = list(traces) if len(traces) + len(beside) > 1 else _stretches(traces[0])
    peaks = [part.peaks(edges, cutoff) for part in parts]
    suspected: list[SuspectedContact] = []
    while len(peaks) + len(beside) > 1 and any(part.duration for part in parts):
        rate = EXPECTED_EXCEEDANCES * 3600.0 / sum(part.duration for part in parts)
        found = [
            contacts_in(
                part, _sum([*peaks[:k], *peaks[k + 1 :], *beside]).thresholds(rate), robot, sigma
            )
            for k, part in enumerate(parts)
        ]
        worst = max(range(len(parts)), key=lambda k: _worst(found[k]))
        if not found[worst]:
            break
        suspected += [SuspectedContact(parts[worst].run, event) for event in found[worst]]
        parts[worst] = _outside(parts[worst], found[worst])
        peaks[worst] = parts[worst].peaks(edges, cutoff)
    return _sum(peaks), tuple(sorted(suspected, key=lambda one: (one.run, one.event.start)))


def _worst(events: Sequence[ContactEvent]) -> float:
    return max((event.joints[0].ratio for event in events), default=0.0)


def _sum(peaks: Sequence[ResidualPeaks]) -> ResidualPeaks:
    return sum(peaks[1:], peaks[0])


def _stretches(trace: ResidualTrace) -> list[ResidualTrace]:
    """`CALIBRATION_STRETCHES` parts of a run."""
    edges = np.linspace(0, len(trace.t), CALIBRATION_STRETCHES + 1).astype(int)
    return [trace.of(slice(a, b)) for a, b in zip(edges[:-1], edges[1:], strict=True)]


def _outside(trace: ResidualTrace, events: Sequence[ContactEvent]) -> ResidualTrace:
    """The samples away from events."""
    inside = np.zeros(len(trace.t), dtype=bool)
    for event in events:
        inside |= (trace.t >= event.start - SUSPECT_MARGIN) & (
            trace.t <= event.end + SUSPECT_MARGIN
        )
    return trace.of(~inside)
