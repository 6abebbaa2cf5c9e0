"""What checks look at: logs of a robot, and efforts that it is known to need; what a check is."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property, partial, reduce, wraps
from operator import add
from typing import Any, Generic, ParamSpec, TypeVar, cast
from weakref import WeakKeyDictionary

import numpy as np

from steelyard.base.arrays import Array, Parameters
from steelyard.base.errors import DataError, LogError, SteelyardError
from steelyard.base.motion import Motion
from steelyard.base.progress import Progress, silent
from steelyard.check.finding import Finding
from steelyard.check.signals.usable_rows import (
    LEAST_ROWS,
    SHORTEST_STRETCH,
    SignalOverview,
    good_rows,
)
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.estimate.information.base_parameters_and_regressor import Regressor, base_regressor
from steelyard.estimate.information.gather import gather
from steelyard.estimate.information.information import Information
from steelyard.estimate.payload.runs_with_payload import carrier
from steelyard.logs.log_and_errors import Log
from steelyard.model.laws.friction_over_speed import Coulomb, Viscous
from steelyard.model.laws.laws_without_friction import RigidBody
from steelyard.model.laws.register import DEFAULT_TERMS, term_of
from steelyard.model.model import Model, ValuedModel
from steelyard.model.terms.axes_and_fields import finds_of
from steelyard.robot.file.model_reading_and_loaded_robot import LoadedRobot
from steelyard.robot.inertia_and_placement import INERTIAL_NAMES
from steelyard.robot.robot import Robot
from steelyard.runs.first_pass_over_recording import EXCERPT_ROWS
from steelyard.runs.prepare import prepare
from steelyard.runs.processing_choices import Processing
from steelyard.runs.recording import Channels, Recording
from steelyard.runs.rows.clock_and_row_scan import rows_between
from steelyard.runs.run import Run

AtStates = Callable[[ValuedModel, Array, Array, Array], Array]


@dataclass(frozen=True, eq=False)
class EffortPredictor:
    """Predicts what a robot's joints need, friction left out."""

    steady: ValuedModel  # bodies, rotors and springs with their values
    whole: ValuedModel | None = None  # the same with friction; `None` if friction is not known
    sigma: Array | None = None  # std of the reference's residuals, joint efforts, shape `(n,)`
    _turned: dict[bytes, ValuedModel] = field(default_factory=dict)

    @property
    def robot(self) -> Robot:
        """The robot, with the gravity that the values belong to."""
        return self.steady.model.robot

    @property
    def identified(self) -> bool:
        """Whether it comes from measurements of this robot."""
        return self.whole is not None

    def torque(self, q: Array, dq: Array, ddq: Array, gravity: Array) -> Array:
        """Joint efforts under any gravity, shape `(n, N)`; NaN where the states are impossible."""
        return self.under_any(gravity, self._of, q, dq, ddq)

    def under_any(self, gravity: Array, of: AtStates, q: Array, dq: Array, ddq: Array) -> Array:
        """What is linear in gravity, under another one than the robot's put together from four."""
        if np.allclose(gravity, self.robot.gravity):
            return of(self.steady, q, dq, ddq)
        still, free = np.zeros_like(q), self.under(np.zeros(3))
        result, rest = of(free, q, dq, ddq), of(free, q, still, still)
        for axis in np.flatnonzero(gravity):
            turned = self.under(np.eye(3)[axis])
            result = result + gravity[axis] * (of(turned, q, still, still) - rest)
        return result

    def pulls(self, q: Array) -> Array:
        """Joint efforts that hold against gravity 1 m/s² along x, y and z, shape `(3, n, N)`."""
        still = np.zeros_like(q)
        rest = self._of(self.under(np.zeros(3)), q, still, still)
        return np.array([self._of(self.under(x), q, still, still) - rest for x in np.eye(3)])

    def friction(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Friction and offset of the reference along a motion, shape `(n, N)`."""
        if self.whole is None:
            return np.zeros_like(q)
        return self._of(self.whole, q, dq, ddq) - self._of(self.steady, q, dq, ddq)

    def payload(self, q: Array, dq: Array, ddq: Array, gravity: Array) -> Array:
        """Joint efforts per unit of a payload's ten numbers in the last body's frame."""
        body = self.robot.bodies[carrier(self.robot).body].name
        bare = Model(self.robot.changed(gravity=np.asarray(gravity)), (RigidBody(),))
        found = []
        for name in INERTIAL_NAMES:
            column = f"{name}.{body}"
            one = Parameters([column], [bare.units[bare.names.index(column)]], [1.0])
            found.append(self._of(bare.at(one), q, dq, ddq))
        return np.array(found)

    def under(self, gravity: Array) -> ValuedModel:
        """The bodies, rotors and springs under another gravity [m/s²], shape `(3,)`."""
        key = np.asarray(gravity, dtype=np.float64).tobytes()
        if key not in self._turned:
            robot = self.robot.changed(gravity=np.asarray(gravity))
            model = replace(self.steady.model, robot=robot)
            self._turned[key] = ValuedModel(model, self.steady.values)
        return self._turned[key]

    def _of(self, valued: ValuedModel, q: Array, dq: Array, ddq: Array) -> Array:
        try:
            motion = Motion(np.arange(q.shape[1], dtype=np.float64), q.T, dq.T, ddq.T)
            return valued.torque(motion).T
        except (DataError, ValueError):
            return np.full(q.shape, np.nan)


def effort_predictor(reference: IdentifiedModel | None, robot: Robot) -> EffortPredictor | None:
    """What is known: the reference, or the nominal bodies; `None` where these are not given."""
    if reference is None:
        nominal = Model(robot, (RigidBody(),)).prior
        return None if nominal is None else EffortPredictor(nominal)
    model = reference.model
    steady = Model(model.robot, tuple(term for term in model.terms if not term.drifts()))
    known = reference.estimate.parameters.as_dict()
    values = [known.get(name, 0.0) for name in steady.names]
    return EffortPredictor(
        ValuedModel(steady, Parameters(steady.names, steady.units, values)),
        reference.valued,
        np.asarray(reference.estimate.sigma),
    )


@dataclass(frozen=True, eq=False)
class CheckedLog:
    """One log as the robot file reads it; whatever takes time is computed once, on first use."""

    recording: Recording  # the log, with the signals that are declared or that were guessed
    processing: Processing  # how it is made a run
    name: str  # the log's name

    @property
    def log(self) -> Log:
        """The table itself, with all its columns, declared or not."""
        return self.recording.log

    @property
    def channels(self) -> Channels:
        """Order of the channels in `excerpt`."""
        return self.recording.channels

    @cached_property
    def window(self) -> tuple[int, int]:
        """Start and stop of the rows that are looked at one by one; the log may end before."""
        cut = self.recording.cut
        start, stop = cut.rows
        if np.isfinite(cut.seconds).any():
            with suppress(LogError):
                within = rows_between(self.recording, cut.seconds, EXCERPT_ROWS)
                # of fewer the clock may be misread, which only the whole log shows
                if within[1] - within[0] >= SHORTEST_STRETCH:
                    start, stop = within
        return start, start + EXCERPT_ROWS if stop is None else min(stop, start + EXCERPT_ROWS)

    @cached_property
    def rows(self) -> tuple[Array, Array]:
        """Time `(N,)` [s] and channels `(N, C)` of `window`, SI as declared, broken rows too."""
        parts = list(self.recording.raw(self.window))
        if not parts:
            return np.zeros(0), np.zeros((0, self.channels.count))
        return np.concatenate([t for t, _ in parts]), np.concatenate([x for _, x in parts])

    @cached_property
    def overview(self) -> SignalOverview:
        """What the good ones of these rows show without trusted units."""
        return good_rows(*self.rows, self.channels)

    @cached_property
    def run(self) -> Run | LogError:
        """The clean run of all that was logged, no mean over repetitions; or why there is none."""
        try:
            return prepare(self.recording, replace(self.processing, repetitions=None))
        except LogError as error:
            return error


@dataclass(frozen=True, eq=False)
class Case:
    """All that a check may look at."""

    loaded: LoadedRobot  # the robot and what its file says
    logs: tuple[CheckedLog, ...]  # the logs, in the order given
    # a model identified from clean runs; without it the robot's nominal model is all that is known
    # beforehand
    reference: IdentifiedModel | None = None
    # columns of the logs that the robot file does not use, by what they seem to hold: `velocity` to
    # the columns' names in joint order
    guesses: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    progress: Progress = silent  # told about long work
    quick: bool = False  # only what is wrong or doubtful is sought, as before a fit

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints, in the order of the columns."""
        return self.loaded.robot.joint_names

    @cached_property
    def knowledge(self) -> EffortPredictor | None:
        """What is known of the robot."""
        return effort_predictor(self.reference, self.loaded.robot)

    @cached_property
    def model(self) -> Model:
        """The model that is to be identified; Coulomb and viscous friction where that is open."""
        if self.reference is not None:
            return self.reference.model
        loaded = self.loaded
        if loaded.terms is None:
            behind = loaded.signals is not None and loaded.signals.effort_kind == "link_torque"
            terms = [t for t in DEFAULT_TERMS if not (behind and t.on_motors)]
            return Model(loaded.robot, tuple(terms))
        terms = [term_of(t.description, t.where) for t in loaded.terms]
        known = tuple(t for t in terms if not finds_of(t))
        return Model(loaded.robot, (*known, *((Coulomb(), Viscous()) if loaded.friction else ())))

    @cached_property
    def runs(self) -> tuple[Run, ...]:
        """Clean runs of the logs, with common cut-offs; logs that cannot be read are left out."""
        runs = [(e, e.run) for e in self.logs if isinstance(e.run, Run)]
        motion = max((run.motion_cutoff for _, run in runs), default=0.0)
        matched = max((run.matched_cutoff for _, run in runs), default=0.0)
        common = []
        for number, (log, run) in enumerate(runs):
            processing = replace(log.processing, motion_cutoff=motion, matched_cutoff=matched)
            if (run.motion_cutoff, run.matched_cutoff) != (motion, matched):
                try:
                    run = prepare(log.recording, processing)
                except SteelyardError:
                    continue
            common.append(replace(run, name=f"{number} {run.name}"))
        return tuple(common)

    @cached_property
    def regressor(self) -> Regressor:
        """The base columns of the model."""
        return base_regressor(self.model)

    @cached_property
    def information(self) -> Information:
        """That of all clean runs together, of which there is one at least."""
        return reduce(add, [gather(self.regressor, run) for run in self.runs])

    def only(self, log: CheckedLog) -> "Case":
        """The same with one log."""
        return replace(self, logs=(log,))

    def longest_run(self, of: Callable[[CheckedLog], bool] = bool) -> tuple[CheckedLog, Run] | None:
        """The log with the longest clean run of those that something holds for, and that run."""
        runs = [
            (e.run.duration, k) for k, e in enumerate(self.logs) if isinstance(e.run, Run) and of(e)
        ]
        if not runs:
            return None
        log = self.logs[max(runs)[1]]
        return log, self.only(log).runs[0]

    def listed(self, joints: Sequence[int]) -> str:
        """Names of joints in a sentence, given by number; of three or more that are all, none."""
        if len(joints) > 2 and len(joints) == len(self.joints):
            return f"all {len(joints)} joints"
        return ", ".join(self.joints[j] for j in joints)


CaseType = TypeVar("CaseType")


@dataclass(frozen=True)
class CaseCheck(Generic[CaseType]):
    """One thing that may be wrong with logs, or with a fitted model."""

    name: str  # one word or two, as users see it: `clock`
    look: Callable[[CaseType], Iterable[Finding]]  # findings, without the check's name
    question: str = ""  # the question in a few words: "Is the clock regular?"
    quick: bool = False  # whether `identify` runs it before the fit

    def __call__(self, case: CaseType) -> tuple[Finding, ...]:
        """One finding per log, or one for all logs together."""
        return tuple(found.by(self.name) for found in self.look(case))


def case_check(
    name: str, question: str = "", *, quick: bool = True
) -> Callable[[Callable[[CaseType], Iterable[Finding]]], CaseCheck[CaseType]]:
    """The check that a function makes of all logs together, or of a fitted model.

    One of a fitted model has no question: those that are not ok lower the verdict.
    """
    return lambda look: CaseCheck(name, look, question, quick)


def log_check(
    name: str, question: str, *, of_rows: bool = False
) -> Callable[[Callable[[Case, CheckedLog], Finding | None]], CaseCheck[Case]]:
    """The quick check that a function makes of one log after the other; `None` for no finding.

    With `of_rows` only of logs that have enough good rows to say anything of single signals.
    """

    def each(look: Callable[[Case, CheckedLog], Finding | None], case: Case) -> Iterator[Finding]:
        for log in case.logs:
            usable = not of_rows or len(log.overview.t) >= LEAST_ROWS
            if usable and (found := look(case, log)) is not None:
                yield replace(found, log=log.name)

    return lambda look: CaseCheck(name, partial(each, look), question, quick=True)


P = ParamSpec("P")

T = TypeVar("T")


def remembered(question: Callable[P, T]) -> Callable[P, T]:
    """The question, answered once for as long as what it is about lives, such as case and log."""
    known: WeakKeyDictionary[Any, Any] = WeakKeyDictionary()

    @wraps(question)
    def answer(*about: P.args, **none: P.kwargs) -> T:
        of = known
        for one in about[:-1]:
            of = of.setdefault(one, WeakKeyDictionary())
        if about[-1] not in of:
            of[about[-1]] = question(*about, **none)
        return cast(T, of[about[-1]])

    return answer
