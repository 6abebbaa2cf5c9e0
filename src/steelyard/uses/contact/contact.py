r"""Contact in a log, without a force sensor: events and links; what `steelyard contact` does.

A force on a link loads the joints between it and the base, and no joint beyond it: if the residual
of a joint exceeds its threshold, the contact is on a link that this joint carries.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from itertools import pairwise
from operator import add
from pathlib import Path
from typing import Any

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.checked_arguments import checked
from steelyard.base.errors import DataError, LogError
from steelyard.base.progress import Progress, silent
from steelyard.estimate.covariance_and_band_widths import EDGES, rest_speed_of
from steelyard.estimate.external.contact_thresholds import ONSET, ContactThresholds, ResidualPeaks
from steelyard.estimate.identified_model import IdentifiedModel, load_model
from steelyard.estimate.information.base_parameters_and_regressor import base_regressor
from steelyard.estimate.information.gather import gather
from steelyard.estimate.scores import residual_traces_and_band_calibration as residual_noise
from steelyard.estimate.scores.effort_errors import effort_reference
from steelyard.identify.runs_and_notes_of_logs import left_out, notes_of, runs_for, was_fitted
from steelyard.robot.robot import Robot, refuse_floating
from steelyard.runs.prepare import rest_speed_of_runs
from steelyard.runs.run import Run
from steelyard.runs.runs_of_named_logs import log_file, log_files, paths_of, refuse_overlaps
from steelyard.uses.contact.contact_page import LEAST_LASTING_SHARE, Contacts
from steelyard.uses.effort_plausibility import refuse_other_efforts
from steelyard.uses.payload.payload_fit import unknown_payload

RELEASE = 0.5  # a contact ends below that share of the threshold that was exceeded
LEAST_TIME_APART = 0.5  # least time between two events [s]
CALIBRATION_STRETCHES = 4  # stretches that a single calibration run is compared in
EXPECTED_EXCEEDANCES = 0.02  # of thresholds of contact, in all calibration runs together
SUSPECT_MARGIN = 1.0  # time beside a suspected contact that is left out with it [s]


@dataclass(frozen=True)
class JointLoad:
    """What one joint shows of a contact."""

    joint: str
    unit: str
    # largest residual, measured minus predicted effort, or largest change of it at rest: that which
    # exceeds its threshold more
    peak: float
    sigmas: float  # its size in standard deviations of the residual of the fit
    ratio: float  # of its size to the threshold
    change: bool


class OnLinks:
    """What is on one of some links."""

    links: tuple[str, ...]

    @property
    def place(self) -> str:
        """Where the contact is, for people to read."""
        if not self.links:
            return "several branches"
        return self.links[0] if len(self.links) == 1 else f"{self.links[0]} or beyond"


@dataclass(frozen=True)
class ContactEvent(OnLinks):
    """A stretch in which residuals exceed their thresholds."""

    start: float  # when a threshold was exceeded first, from the log's start [s]
    end: float  # when the last joint was released [s]
    known: float  # when it can be known [s]: changes at rest are decided a little later
    joints: tuple[JointLoad, ...]  # joints that exceed their thresholds, the clearest first
    links: tuple[str, ...]  # links that the contact may be on: those that all these joints carry

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


@dataclass(frozen=True)
class ContactStart(OnLinks):
    """A residual exceeds its threshold, and none did just before."""

    time: float
    known: float  # when that is known [s]: a change at rest is decided a little later
    joint: JointLoad
    links: tuple[str, ...]


CHANGE_TEST = 1  # row of changes at rest in the tests of a sample, below the residual's


class ContactStream:
    """Finds contacts sample by sample."""

    def __init__(self, robot: Robot, sigma: Array, lasting: float = 0.0) -> None:
        """Begin; `sigma` is the standard deviation of the fit's residual, shape `(n,)` [Nm; N].

        A residual is contact that exceeds its threshold, sample after sample, for a time `lasting`.
        """
        self._robot, self._sigma, self._lasting = robot, sigma, lasting
        self._released = np.full((2, robot.n), np.nan)
        self._since = np.full((2, robot.n), np.nan)
        self._loads: dict[int, JointLoad] = {}
        self._start = self._end = self._known = -np.inf

    @property
    def active(self) -> bool:
        """Whether there is a contact now."""
        return bool(self._loads)

    @property
    def held(self) -> bool:
        """Whether a residual that exceeded its threshold has not been released."""
        return not np.isnan(self._released).all()

    def step(
        self,
        t: float,
        signal: Array,
        limits: Array,
        times: Sequence[float],
        *,
        known: Sequence[float] | None = None,
        gap: bool = False,
    ) -> Iterator[ContactStart | ContactEvent]:
        """Take the next sample, at time `t` [s]; there is a `gap` if some are missing before it.

        Rows of `signal` are measured minus predicted effort, and its change at rest that is decided
        now, shape `(2, n)` [Nm; N], NaN where nothing is compared; `limits` are thresholds, NaN of
        a joint without. The rows are of samples at `times`, and `known` [s], at `t` if `None`.
        """
        size, at = np.abs(signal), np.array(times)[:, None]
        held = (size >= self._released) & (not gap)
        exceeds = size > limits
        begins = exceeds & (np.isnan(self._since) | gap)
        self._since = np.where(begins, at, np.where(exceeds, self._since, np.nan))
        exceeds &= at - self._since >= self._lasting
        if self._loads and not held.any() and t - self._end > LEAST_TIME_APART:
            yield self.ended()
        self._released = np.where(held, self._released, np.where(exceeds, RELEASE * limits, np.nan))
        touched = held | exceeds
        if not touched.any():
            return
        first, tests = not self._loads, touched.any(axis=1)
        for k, j in np.argwhere(touched).tolist():
            known_load, ratio = self._loads.get(j), float(size[k, j] / limits[k, j])
            if known_load is None or known_load.ratio < ratio:
                axis, sigmas = self._robot.coordinates[j], float(size[k, j]) / float(self._sigma[j])
                peak = axis.name, axis.effort_unit, float(signal[k, j])
                self._loads[j] = JointLoad(*peak, sigmas, ratio, k == CHANGE_TEST)
        latest = float(at[tests].max())
        decided = float(np.array((t, t) if known is None else known)[tests].min())
        if first:
            self._start, self._end = float(self._since[touched].min()), latest
            self._known = decided
            event = self._event()
            yield ContactStart(event.start, t, event.joints[0], event.links)
        self._end, self._known = max(self._end, latest), min(self._known, decided)

    def ended(self) -> ContactEvent:
        """The contact that ends, now or with the stream; there must be one."""
        event = self._event()
        self._loads.clear()
        self._released[:] = np.nan
        return event

    def _event(self) -> ContactEvent:
        links = links_carried_by(self._robot, list(self._loads))
        joints = sorted(self._loads.values(), key=lambda load: -load.ratio)
        return ContactEvent(self._start, self._end, self._known, tuple(joints), links)


def contacts_in(
    trace: residual_noise.ResidualTrace, thresholds: ContactThresholds, robot: Robot, sigma: Array
) -> tuple[ContactEvent, ...]:
    """Stretches of a run in which residuals exceed their thresholds.

    `sigma` is the standard deviation of the residual of the fit per joint, shape `(n,)` [Nm; N].
    """
    changes = trace.changes(thresholds.edges)
    signal = np.stack([trace.residual, changes])
    levels = thresholds.at(trace.ranges(thresholds.edges))
    limits = np.stack([levels, np.broadcast_to(thresholds.changes[:, None], changes.shape)])
    gaps = np.diff(trace.t, prepend=trace.t[:1]) > 2.0 * trace.step
    stream, found, k = ContactStream(robot, sigma), list[ContactStart | ContactEvent](), 0
    for begin in np.flatnonzero(np.any(np.abs(signal) > limits, axis=(0, 1))).tolist():
        k = max(k, begin)
        while k == begin or (stream.held and k < len(trace.t)):
            t, gap = float(trace.t[k]), bool(gaps[k])
            known = (t, t + ONSET)
            found += stream.step(t, signal[..., k], limits[..., k], (t, t), known=known, gap=gap)
            k += 1
    found += [stream.ended()] if stream.active else []
    return tuple(event for event in found if isinstance(event, ContactEvent))


def links_carried_by(robot: Robot, joints: Sequence[int]) -> tuple[str, ...]:
    """Links that all of some joints carry, parents before children."""
    bodies = robot.bodies
    carried = [{bodies[one].coordinate for one in robot.carriers(k)} for k in range(len(bodies))]
    each = zip(bodies, carried, strict=True)
    return tuple(x.name for x, by in each if by.issuperset(joints) and not x.massless)


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
    traces: Sequence[residual_noise.ResidualTrace],
    edges: Array,
    cutoff: float,
    robot: Robot,
    sigma: Array,
    known: ResidualPeaks | None = None,
) -> tuple[ResidualPeaks, tuple[SuspectedContact, ...]]:
    """Largest residuals of calibration runs, without stretches that contain contact.

    Every run is compared with thresholds from all others, which all of them together exceed with a
    probability of `EXPECTED_EXCEEDANCES`; the run that exceeds them most loses what exceeds them,
    until none does. A single run is compared in `CALIBRATION_STRETCHES` parts. What the model knows
    of its own left-out motion is compared with, too.
    """
    alike = known is not None and known.cutoff == cutoff and np.array_equal(known.edges, edges)
    beside = [known] if known is not None and alike else []
    parts = list(traces)
    if len(parts) + len(beside) < 2:
        ends = np.linspace(0, len(parts[0].t), CALIBRATION_STRETCHES + 1).astype(int)
        parts = [parts[0].of(slice(a, b)) for a, b in pairwise(ends)]
    peaks = [part.peaks(edges, cutoff) for part in parts]
    suspected: list[SuspectedContact] = []
    while len(peaks) + len(beside) > 1 and any(part.duration for part in parts):
        rate = EXPECTED_EXCEEDANCES * 3600.0 / sum(part.duration for part in parts)
        found = []
        for k, part in enumerate(parts):
            limits = reduce(add, [*peaks[:k], *peaks[k + 1 :], *beside]).thresholds(rate)
            found.append(contacts_in(part, limits, robot, sigma))
        ratios = [max((event.joints[0].ratio for event in one), default=0.0) for one in found]
        worst = int(np.argmax(ratios))
        if not found[worst]:
            break
        suspected += [SuspectedContact(parts[worst].run, event) for event in found[worst]]
        t, inside = parts[worst].t, np.zeros(len(parts[worst].t), dtype=bool)
        for event in found[worst]:
            inside |= (t >= event.start - SUSPECT_MARGIN) & (t <= event.end + SUSPECT_MARGIN)
        parts[worst] = parts[worst].of(~inside)
        peaks[worst] = parts[worst].peaks(edges, cutoff)
    return reduce(add, peaks), tuple(sorted(suspected, key=lambda one: (one.run, one.event.start)))


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
    refuse_floating(identified.robot, "the detection of contacts")
    inspected, given = [log_file(str(log))], log_files(paths_of(calibrate))
    refuse_overlaps(given, inspected)
    (run,) = runs_for(identified, inspected, progress, at_rest=True)
    free = runs_for(identified, given, progress, at_rest=True)
    fitted = [was_fitted(identified, one, other) for one, other in zip(given, free, strict=True)]
    notes = [fitted_note(one.name) for one, old in zip(free, fitted, strict=True) if old]
    unseen = [one for one, old in zip(free, fitted, strict=True) if not old]
    own = None if identified.calibration is None else identified.calibration.peaks
    cutoff = residual_noise.residual_cutoff(identified, unseen) if own is None else own.cutoff
    sigma = np.asarray(identified.estimate.sigma)
    rest = common_rest_speed(identified, [one.rest_speed for one in unseen or [run]])
    suspected: tuple[SuspectedContact, ...] = ()
    if given:
        traces = []
        for other in unseen:
            free_trace = residual_noise.residual_trace(
                identified, replace(other, rest_speed=rest), cutoff
            )
            refuse_other_efforts(free_trace, sigma, identified.joints)
            carried = _carried(identified, other)
            if carried is None:
                traces.append(free_trace)
            else:
                notes.append(f"left out of the calibration: {carried}")
        if not traces:
            wrong = f"no calibration log is left: {'; '.join(notes)}"
            fix = "give logs of other motion without contact, or leave --calibrate out"
            raise DataError(wrong, where="--calibrate", fix=fix)
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
    thresholds = residual_noise.thresholds_of(identified, peaks, rate)
    trace = residual_noise.residual_trace(identified, replace(run, rest_speed=rest), cutoff)
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
        fitted=was_fitted(identified, inspected[0], run),
        notes=(*notes, *(one.text for one in suspected), *left_out(run)),
        details=notes_of([run]),
    )
    lasts = found.busy > LEAST_LASTING_SHARE
    return replace(found, carried=_carried(identified, run) if lasts else None)


def _carried(identified: IdentifiedModel, run: Run) -> str | None:
    """A payload that a run has beyond doubt, in words; `None` without, or if it is too short."""
    try:
        whole = gather(base_regressor(identified.model), run, rests=identified.model.has_memory)
    except LogError:
        return None
    return unknown_payload(identified, whole) or None


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
    traces: Sequence[residual_noise.ResidualTrace],
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
