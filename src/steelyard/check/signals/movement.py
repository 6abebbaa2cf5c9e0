"""Which joints move, how far and how fast; how much of a log is rest; does the base move?

Efforts of the joints do not identify it: an acceleration of the base acts as a change of gravity
does, and so do errors of a model that several limbs share. An inertial sensor in the log does.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array
from steelyard.check.case import Case, Evidence
from steelyard.check.finding import Finding, Fix, Picture, Severity, of_joints, trace
from steelyard.check.signals.overview import SLOPE_ENDS, signal_overview, width_of
from steelyard.check.signals.units import driven_joints, motion_in_units, unit_reading
from steelyard.robot.file.loaded_robot import LoadedRobot
from steelyard.robot.init.column_names import words_of
from steelyard.runs.rows.faulty_rows import stretches
from steelyard.runs.spectrum import motion_band

LITTLE_RANGE = {"revolute": 0.05, "prismatic": 0.01}
"""Range below which a joint hardly moves [rad; m]."""
USEFUL_RANGE = {"revolute": "1 rad", "prismatic": "a tenth of a metre"}
"""A range from which something can be learnt."""
FAST_SPEED_SHARE = 0.3
"""Share of a joint's speed limit that a motion should reach."""
POSITION_QUANTILE = 0.005
"""Positions outside these quantiles, on each side, do not count."""


@dataclass(frozen=True, eq=False)
class _JointMotion:
    """What each joint does, in true units.

    Attributes:
        range: From lowest to highest position, in true units or, if that is more, as declared,
            shape `(n,)` [rad; m].
        fast: Nearly its highest speed, shape `(n,)` [rad/s; m/s].
        moves: Whether it moves enough, shape `(n,)`.
        band: Frequency below which each joint's motion lives, shape `(n,)` [Hz]; 0 at rest.
    """

    range: Array
    fast: Array
    moves: NDArray[np.bool_]
    band: Array


@dataclass(frozen=True)
class Excitation:
    """Joints that move, and those that hardly do, of which little can be learnt."""

    name: ClassVar[str] = "excitation"
    question: ClassVar[str] = "Which joints move?"
    quick: ClassVar[bool] = True

    def __call__(self, case: Case) -> tuple[Finding, ...]:
        """One finding per log, and one for all together if there are several."""
        logs = [evidence for evidence in case.logs if signal_overview(case, evidence).step > 0.0]
        if not logs:
            return ()
        motions = [_joint_motion(case, evidence) for evidence in logs]
        alone = len(motions) == 1
        found = [
            self._look(case, evidence, done, alone)
            for evidence, done in zip(logs, motions, strict=True)
        ]
        return tuple(found) if alone else (*found, self._together(case, motions))

    def _look(self, case: Case, evidence: Evidence, done: _JointMotion, alone: bool) -> Finding:
        still = np.flatnonzero(~done.moves)
        severity = Severity.OK
        if not done.moves.any():
            severity = Severity.WRONG if alone else Severity.DOUBTFUL
        elif len(still) and alone:
            severity = Severity.DOUBTFUL
        names = [case.joints[j] for j in still]
        fix = None
        if severity != Severity.OK:
            fix = Fix(_help(case, still) if alone else "leave this log out: nothing moves in it")
        return Finding(
            self.name,
            evidence.name,
            severity,
            _excitation_words(done, names),
            _value_text(case, done),
            joints=tuple(names) if severity != Severity.OK else (),
            fix=fix,
            picture=_excitation_picture(case, done),
        )

    def _together(self, case: Case, motions: Sequence[_JointMotion]) -> Finding:
        moves = np.any([done.moves for done in motions], axis=0)
        still = np.flatnonzero(~moves)
        names = tuple(case.joints[j] for j in still)
        severity = Severity.OK
        if len(still):
            severity = Severity.DOUBTFUL if moves.any() else Severity.WRONG
        return Finding(
            self.name,
            "",
            severity,
            f"hardly any motion of {', '.join(names)} in any log" if names else "every joint moves",
            f"{np.count_nonzero(moves)} of {len(moves)} joints move",
            joints=names,
            fix=Fix(_help(case, still)) if names else None,
        )


def _joint_motion(case: Case, evidence: Evidence) -> _JointMotion:
    overview, units = signal_overview(case, evidence), unit_reading(case, evidence)
    coordinates = case.loaded.robot.coordinates
    n = len(coordinates)
    slope = motion_in_units(case, evidence)
    scale = np.array([joint.position_scale for joint in units.joints])
    if len(overview.q) < 2:
        return _JointMotion(np.zeros(n), np.zeros(n), np.zeros(n, dtype=np.bool_), np.zeros(n))
    low, high = np.quantile(overview.q, [POSITION_QUANTILE, 1.0 - POSITION_QUANTILE], axis=0)
    reach = (high - low) * np.maximum(scale, 1.0)
    enough = reach >= [LITTLE_RANGE[c.kind] for c in coordinates]
    moves = enough & slope.moving
    fast = np.zeros(n)
    if slope.v.shape[1]:
        fast = np.quantile(np.abs(slope.v), 1.0 - POSITION_QUANTILE, axis=1) * scale
    even, rate = overview.even(overview.q, units.second)
    longest = max(even, key=lambda x: x.shape[1], default=np.zeros((n, 0)))
    band = [motion_band(longest[j : j + 1], rate).frequency if moves[j] else 0.0 for j in range(n)]
    return _JointMotion(reach, fast, moves, np.array(band))


def _excitation_words(done: _JointMotion, still: Sequence[str]) -> str:
    if not done.moves.any():
        return "no joint moves"
    band = done.band[done.moves]
    facts = f"motion up to {band.min():.2g} to {band.max():.2g} Hz, by joint"
    if still:
        return f"hardly any motion of {', '.join(still)}; {facts}"
    return f"every joint moves; {facts}"


def _value_text(case: Case, done: _JointMotion) -> str:
    coordinates = case.loaded.robot.coordinates
    share = [r / LITTLE_RANGE[c.kind] for r, c in zip(done.range, coordinates, strict=True)]
    least = int(np.argmin(share))
    c = coordinates[least]
    return (
        f"{case.joints[least]} moves least: range {done.range[least]:.2g} {c.unit}, at least "
        f"{LITTLE_RANGE[c.kind]:g} {c.unit} required"
    )


def _help(case: Case, still: NDArray[np.intp]) -> str:
    """Which motion would help."""
    coordinates = [case.loaded.robot.coordinates[j] for j in still]
    parts = []
    for c in coordinates:
        limit = c.limits.velocity
        speed = f", up to {FAST_SPEED_SHARE * limit:.2g} {c.unit}/s" if np.isfinite(limit) else ""
        parts.append(f"{c.name} by {USEFUL_RANGE[c.kind]} or more{speed}")
    return "record a motion of " + "; ".join(parts) + ", at several speeds in both directions"


def _excitation_picture(case: Case, done: _JointMotion) -> Picture:
    bound = np.array([LITTLE_RANGE[c.kind] for c in case.loaded.robot.coordinates])
    return of_joints(
        "range [rad; m]", (("range", done.range, "bars"), ("hardly moves", bound, "points"))
    )


REST_SHARE = 0.01
"""Speed of a joint at rest, over the speed that it exceeds 1 % of the time."""
MOSTLY_AT_REST = 0.8
"""Share of the time at rest from which on a log is doubtful."""


@dataclass(frozen=True)
class Rests:
    """Time in which no joint moves: friction is anywhere in its dead zone there."""

    name: ClassVar[str] = "rests"
    question: ClassVar[str] = "How much of the log is standstill?"
    quick: ClassVar[bool] = True

    def __call__(self, case: Case) -> tuple[Finding, ...]:
        """One finding per log in which something moves."""
        found = []
        for evidence in case.logs:
            if driven_joints(case, evidence).any() and signal_overview(case, evidence).moves:
                found.append(self._look(case, evidence))
        return tuple(found)

    def _look(self, case: Case, evidence: Evidence) -> Finding:
        slope, clock = motion_in_units(case, evidence), signal_overview(case, evidence).clock
        second = unit_reading(case, evidence).second
        speed = np.abs(slope.v[driven_joints(case, evidence)])
        share = speed / np.quantile(speed, 0.99, axis=1)[:, None]
        rests = _long_rests((share <= REST_SHARE).all(axis=0), slope.rate)
        t = (slope.t - clock[0]) * second
        rest, often = float(rests.mean()), float(rests.mean()) > MOSTLY_AT_REST
        return Finding(
            self.name,
            evidence.name,
            Severity.DOUBTFUL if often else Severity.OK,
            _rest_words(rests, t, float(clock[-1] - clock[0]) * second),
            f"{100.0 * rest:.1f} % at rest, at most {100.0 * MOSTLY_AT_REST:g} % allowed",
            fix=Fix("cut off the standstill (LOG@START:STOP), and record more motion")
            if often
            else None,
            picture=_rests_picture(t, share.max(axis=0)),
        )


def _long_rests(still: NDArray[np.bool_], rate: float) -> NDArray[np.bool_]:
    """Stillness that lasts longer than the low-pass; shorter, joints turn round together."""
    kept = np.zeros_like(still)
    for start, stop in stretches(still):
        kept[start:stop] = stop - start > 2.0 * SLOPE_ENDS * width_of(rate) * rate
    return kept


def _rest_words(rests: NDArray[np.bool_], t: Array, duration: float) -> str:
    """How much is rest; the ends, where the low-pass does not reach, are as what is next to them.

    Args:
        rests: Whether no joint moves, shape `(N,)`.
        t: Time since the log's start, shape `(N,)` [s].
        duration: Of the log [s].
    """
    if not rests.any():
        return "no standstill"
    moves = np.flatnonzero(~rests)
    start = float(t[moves[0]]) if rests[0] else 0.0
    stop = duration - float(t[moves[-1]]) if rests[-1] else 0.0
    return (
        f"{100.0 * float(rests.mean()):.1f} % of the time no joint moves, {start:.1f} s of it at "
        f"the start and {stop:.1f} s at the end"
    )


def _rests_picture(t: Array, speed: Array) -> Picture:
    """The fastest joint's speed over time."""
    return Picture(
        "time [s]",
        "speed of the fastest joint relative to its maximum",
        (trace("speed", t, speed), trace("rest", t, np.full(len(t), REST_SHARE))),
    )


TURN_WORDS = {"gyro", "gyroscope", "omega", "angular"}
ACCELERATION_WORDS = {"acc", "accel", "accelerometer", "acceleration"}
INERTIAL_SENSOR_WORDS = {
    "imu",
    "gyro",
    "gyroscope",
    "accelerometer",
    "base",
    "trunk",
    "torso",
    "pelvis",
    "body",
}
"""Words of columns of an inertial sensor, of its place, and of what it measures."""
BASE_ROWS = 20_000
"""Rows that are looked at."""
LEAST_TURN = 0.05
"""Root mean square about its mean from which on a rate of turn is motion [rad/s]."""
LEAST_PULL = 0.03
"""The same of a measured acceleration, over its mean length, which is gravity's."""
SMOOTH_STEP_SHARE = 0.7
"""Root mean square of steps over that of values; of noise it is 1.4."""
FIX_BASE = Fix(
    "log with the base fixed (on a stand, or hung up rigidly): the model assumes a base at rest"
)


class MovingBase:
    """A base that is taken to be at rest, though it floats in the model file."""

    name: ClassVar[str] = "moving base"
    question: ClassVar[str] = "Is the base at rest?"
    quick: ClassVar[bool] = True

    def __call__(self, case: Case) -> tuple[Finding, ...]:
        """One finding per log of a robot whose base floats in the model file."""
        if not case.loaded.floats:
            return ()
        return tuple(_base_found(case.loaded, evidence) for evidence in case.logs)


def of_base(loaded: LoadedRobot, findings: Sequence[Finding]) -> tuple[Finding, ...]:
    """What stands beside the headline of a fit: that the base moves, or is only assumed to rest.

    Args:
        loaded: The robot.
        findings: What was found in its logs before.
    """
    if not loaded.floats:
        return ()
    known = [f for f in findings if f.check == MovingBase.name]
    moving = tuple(f for f in known if f.severity)
    if moving or (known and all(f.answered for f in known)):
        return moving
    return (Finding(MovingBase.name, "", Severity.OK, _assumed(loaded), "", headline=True),)


def _assumed(loaded: LoadedRobot) -> str:
    return f"base '{loaded.base}' floats in the model, and is assumed to be at rest: not tested"


def _base_found(loaded: LoadedRobot, evidence: Evidence) -> Finding:
    turns, pulls = (
        _inertial_columns(evidence, TURN_WORDS),
        _inertial_columns(evidence, ACCELERATION_WORDS),
    )
    moves = [*_turning_words(evidence, turns), *_acceleration_words(evidence, pulls)]
    if moves:
        says = f"base '{loaded.base}' is assumed to be at rest, but its sensor measures motion"
        name, severity = MovingBase.name, Severity.DOUBTFUL
        return Finding(name, evidence.name, severity, says, ", ".join(moves), fix=FIX_BASE)
    if turns or pulls:
        says = f"base '{loaded.base}' is at rest according to its sensor"
        figure = ", ".join((*turns, *pulls))
        return Finding(MovingBase.name, evidence.name, Severity.OK, says, figure)
    figure = "no gyroscope or accelerometer of the base in the log"
    says = _assumed(loaded)
    name, ok = MovingBase.name, Severity.OK
    return Finding(name, evidence.name, ok, says, figure, answered=False, headline=True)


def _inertial_columns(evidence: Evidence, kinds: set[str]) -> tuple[str, ...]:
    """Columns of an inertial sensor that the robot file gives no other meaning."""
    used = evidence.recording.signals.columns
    named = {c: {*words_of(c)} for c in evidence.log.columns if c not in used}
    return tuple(
        column
        for column, words in named.items()
        if words & kinds and words & INERTIAL_SENSOR_WORDS and "joint" not in words
    )


def _inertial_values(evidence: Evidence, columns: Sequence[str]) -> Array:
    """Rows without gaps, shape `(N, columns)`."""
    start, stop = evidence.window
    last = min(stop, start + BASE_ROWS)
    x = np.concatenate([*evidence.log.parts(columns, (start, last)), np.zeros((0, len(columns)))])
    return np.asarray(x[np.isfinite(x).all(axis=1)])


def _turning_words(evidence: Evidence, columns: tuple[str, ...]) -> list[str]:
    """Rates of turn that are motion, in words."""
    clauses = []
    for column in columns:
        degrees = bool({"deg", "dps"} & {*words_of(column)})
        rates = _inertial_values(evidence, [column])[:, 0] * (np.pi / 180.0 if degrees else 1.0)
        if len(rates) > 2 and rates.std() > LEAST_TURN and _is_smooth(rates):
            clauses.append(f"'{column}' varies by {rates.std():.2g} rad/s")
    return clauses


def _acceleration_words(evidence: Evidence, columns: tuple[str, ...]) -> list[str]:
    """Accelerations that vary, in words; only of all three axes together."""
    if len(columns) != 3:
        return []
    pulls = _inertial_values(evidence, columns)
    if len(pulls) < 3:
        return []
    length = float(np.mean(np.linalg.norm(pulls, axis=1)))
    spread = pulls.std(axis=0)
    moving = [x for x in range(3) if spread[x] > LEAST_PULL * length and _is_smooth(pulls[:, x])]
    return [
        f"'{columns[x]}' varies by {100.0 * spread[x] / length:.2g} % of its mean length"
        for x in moving
    ]


def _is_smooth(values: Array) -> bool:
    """Whether values are motion rather than noise."""
    return bool(np.sqrt(np.mean(np.square(np.diff(values)))) < SMOOTH_STEP_SHARE * values.std())
