"""Which joints move, how far and how fast; how much of a log is rest; does the base move?

Efforts of the joints do not identify it: an acceleration of the base acts as a change of gravity
does, and so do errors of a model that several limbs share. An inertial sensor in the log does.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array, stretches
from steelyard.check.cases_and_checks import Case, CheckedLog, case_check, log_check
from steelyard.check.finding import Finding, Fix, Picture, Severity, of_joints, trace
from steelyard.check.signals.motion_units import driven_joints, motion_in_units, unit_reading
from steelyard.check.signals.usable_rows import SLOPE_ENDS, width_of
from steelyard.robot.file.model_reading_and_loaded_robot import LoadedRobot
from steelyard.robot.init.column_names import words_of
from steelyard.robot.robot import Coordinate
from steelyard.runs.spectrum_and_period import motion_band

LITTLE_RANGE = {"revolute": 0.05, "prismatic": 0.01}
"""Range below which a joint hardly moves [rad; m]."""
USEFUL_RANGE = {"revolute": "1 rad", "prismatic": "a tenth of a metre"}
"""A range from which something can be learnt."""
FAST_SPEED_SHARE = 0.3  # share of a joint's speed limit that a motion should reach
POSITION_QUANTILE = 0.005  # positions outside these quantiles, on each side, do not count


@case_check("excitation", "Which joints move?")
def excitation_check(case: Case) -> Iterable[Finding]:
    """Joints that move, and those that hardly do, of which little can be learnt."""
    logs = [log for log in case.logs if log.overview.step > 0.0]
    motions = [_joint_motion(case, log) for log in logs]
    alone = len(motions) == 1
    for log, motion in zip(logs, motions, strict=True):
        yield replace(_excitation_found(case, *motion, alone), log=log.name)
    if len(motions) < 2:
        return
    moves = np.any([moves for _, moves, _ in motions], axis=0)
    still = np.flatnonzero(~moves)
    names = tuple(case.joints[case.loaded.robot.n_base :][j] for j in still)
    figure = f"{np.count_nonzero(moves)} of {len(moves)} joints move"
    if not names:
        yield Finding.ok("every joint moves", figure)
        return
    yield Finding.of(
        Severity.DOUBTFUL if moves.any() else Severity.WRONG,
        f"hardly any motion of {', '.join(names)} in any log",
        figure,
        joints=names,
        fix=Fix(_help(case, still)),
    )


def _excitation_found(
    case: Case, reach: Array, moves: NDArray[np.bool_], band: Array, alone: bool
) -> Finding:
    coordinates, still = _joints(case), np.flatnonzero(~moves)
    bound = np.array([LITTLE_RANGE[c.kind] for c in coordinates])
    names = tuple(coordinates[j].name for j in still)
    severity, says, fix = Severity.OK, "no joint moves", None
    if len(still) and (alone or not moves.any()):
        severity = Severity.DOUBTFUL if moves.any() or not alone else Severity.WRONG
        fix = Fix(_help(case, still) if alone else "leave this log out: nothing moves in it")
    if moves.any():
        low, high = band[moves].min(), band[moves].max()
        says = f"hardly any motion of {', '.join(names)}" if names else "every joint moves"
        says += f"; motion up to {low:.2g} to {high:.2g} Hz, by joint"
    least = int(np.argmin(reach / bound))
    unit = coordinates[least].unit
    return Finding.of(
        severity,
        says,
        f"{coordinates[least].name} moves least: range {reach[least]:.2g} {unit}, at least "
        f"{bound[least]:g} {unit} required",
        joints=names if severity else (),
        fix=fix,
        picture=of_joints(
            "range [rad; m]", (("range", reach, "bars"), ("hardly moves", bound, "points"))
        ),
    )


def _joint_motion(case: Case, log: CheckedLog) -> tuple[Array, NDArray[np.bool_], Array]:
    """Range of each joint, whether it moves enough, and where its motion ends, each `(n,)`.

    Ranges [rad; m] are in true units or, if that is more, as declared; frequencies [Hz] are 0 at
    rest.
    """
    overview, units = log.overview, unit_reading(case, log)
    coordinates, joints = _joints(case), overview.channels.encoders
    n, q = len(coordinates), overview.x[:, joints]
    if len(q) < 2:
        return np.zeros(n), np.zeros(n, dtype=np.bool_), np.zeros(n)
    low, high = np.quantile(q, [POSITION_QUANTILE, 1.0 - POSITION_QUANTILE], axis=0)
    reach = (high - low) * np.maximum([one.position_scale for one in units.joints[joints]], 1.0)
    enough = reach >= [LITTLE_RANGE[c.kind] for c in coordinates]
    moves = enough & motion_in_units(case, log).moving[joints]
    even, rate = overview.even(q, units.second)
    longest = max(even, key=lambda x: x.shape[1], default=np.zeros((n, 0)))
    band = [motion_band(longest[j : j + 1], rate).frequency if moves[j] else 0.0 for j in range(n)]
    return reach, moves, np.array(band)


def _joints(case: Case) -> tuple[Coordinate, ...]:
    """Joints, without the coordinates of a floating base."""
    return case.loaded.robot.coordinates[case.loaded.robot.n_base :]


def _help(case: Case, still: NDArray[np.intp]) -> str:
    parts = []
    for c in (_joints(case)[j] for j in still):
        limit = c.limits.velocity
        speed = f", up to {FAST_SPEED_SHARE * limit:.2g} {c.unit}/s" if np.isfinite(limit) else ""
        parts.append(f"{c.name} by {USEFUL_RANGE[c.kind]} or more{speed}")
    return "record a motion of " + "; ".join(parts) + ", at several speeds in both directions"


REST_SHARE = 0.01  # speed of a joint at rest, over the speed that it exceeds 1 % of the time
MOSTLY_AT_REST = 0.8  # share of the time at rest from which on a log is doubtful


@log_check("rests", "How much of the log is standstill?")
def rests_check(case: Case, log: CheckedLog) -> Finding | None:
    """Time in which no joint moves: friction is anywhere in its dead zone there."""
    if not (driven_joints(case, log).any() and log.overview.moves):
        return None
    slope, clock = motion_in_units(case, log), log.overview.clock
    second = unit_reading(case, log).second
    speed = np.abs(slope.v[driven_joints(case, log)])
    share = speed / np.quantile(speed, 0.99, axis=1)[:, None]
    rests = (share <= REST_SHARE).all(axis=0)
    longest = 2.0 * SLOPE_ENDS * width_of(slope.rate) * slope.rate
    for start, stop in stretches(rests):  # shorter than the low-pass, joints turn round together
        rests[start:stop] = stop - start > longest
    t, rest, speed = (slope.t - clock[0]) * second, float(rests.mean()), share.max(axis=0)
    says = "no standstill"
    if rests.any():  # the ends, where the low-pass does not reach, are as what is next to them
        moves = t[~rests]
        before = float(moves[0]) if rests[0] else 0.0
        after = float(clock[-1] - clock[0]) * second - float(moves[-1]) if rests[-1] else 0.0
        says = (
            f"{100.0 * rest:.1f} % of the time no joint moves, {before:.1f} s of it at the start "
            f"and {after:.1f} s at the end"
        )
    return Finding.doubtful_if(
        rest > MOSTLY_AT_REST,
        says,
        f"{100.0 * rest:.1f} % at rest, at most {100.0 * MOSTLY_AT_REST:g} % allowed",
        Fix("cut off the standstill (LOG@START:STOP), and record more motion"),
        picture=Picture(
            "time [s]",
            "speed of the fastest joint relative to its maximum",
            (trace("speed", t, speed), trace("rest", t, np.full(len(t), REST_SHARE))),
        ),
    )


TURN_WORDS = {*"gyro gyroscope omega angular".split()}
ACCELERATION_WORDS = {*"acc accel accelerometer acceleration".split()}
INERTIAL_SENSOR_WORDS = {*"imu gyro gyroscope accelerometer base trunk torso pelvis body".split()}
"""Words of columns of an inertial sensor, of its place, and of what it measures."""
LEAST_TURN = 0.05  # root mean square about its mean from which on a rate of turn is motion [rad/s]
LEAST_PULL = 0.03  # the same of a measured acceleration, over its mean length, which is gravity's
SMOOTH_STEP_SHARE = 0.7  # root mean square of steps over that of values; of noise it is 1.4
FIX_BASE = Fix(
    "log with the base fixed (on a stand, or hung up rigidly): the model assumes a base at rest"
)


@log_check("moving base", "Is the base at rest?")
def moving_base_check(case: Case, log: CheckedLog) -> Finding | None:
    """A base that is taken to be at rest, though it floats in the model file."""
    if not case.loaded.floats:
        return None
    base = case.loaded.base
    turns = _inertial_columns(log, TURN_WORDS)
    pulls = _inertial_columns(log, ACCELERATION_WORDS)
    moves = []
    for column in turns:
        unit = np.pi / 180.0 if {"deg", "dps"} & {*words_of(column)} else 1.0
        rates = unit * _inertial_values(log, [column])[:, 0]
        if len(rates) > 2 and rates.std() > LEAST_TURN and _is_smooth(rates):
            moves.append(f"'{column}' varies by {rates.std():.2g} rad/s")
    # accelerations only of all three axes together
    if len(pulls) == 3 and len(values := _inertial_values(log, pulls)) > 2:
        length, spread = float(np.mean(np.linalg.norm(values, axis=1))), values.std(axis=0)
        moves += [
            f"'{column}' varies by {100.0 * std / length:.2g} % of its mean length"
            for column, std, x in zip(pulls, spread, values.T, strict=True)
            if std > LEAST_PULL * length and _is_smooth(x)
        ]
    if moves:
        says = f"base '{base}' is assumed to be at rest, but its sensor measures motion"
        return Finding.doubtful(says, ", ".join(moves), fix=FIX_BASE)
    if turns or pulls:
        says = f"base '{base}' is at rest according to its sensor"
        return Finding.ok(says, ", ".join((*turns, *pulls)))
    figure = "no gyroscope or accelerometer of the base in the log"
    return Finding.ok(_assumed(case.loaded), figure, answered=False, headline=True)


def of_base(loaded: LoadedRobot, findings: Sequence[Finding]) -> tuple[Finding, ...]:
    """What stands beside the headline of a fit: that the base moves, or is only assumed to rest."""
    if not loaded.floats:
        return ()
    known = [f for f in findings if f.check == moving_base_check.name]
    moving = tuple(f for f in known if f.severity)
    if moving or (known and all(f.answered for f in known)):
        return moving
    return (Finding.ok(_assumed(loaded), headline=True).by(moving_base_check.name),)


def _assumed(loaded: LoadedRobot) -> str:
    return f"base '{loaded.base}' floats in the model, and is assumed to be at rest: not tested"


def _inertial_columns(log: CheckedLog, kinds: set[str]) -> tuple[str, ...]:
    """Columns of an inertial sensor that the robot file gives no other meaning."""
    used = log.recording.signals.columns
    named = {c: {*words_of(c)} for c in log.log.columns if c not in used}
    return tuple(
        column
        for column, words in named.items()
        if words & kinds and words & INERTIAL_SENSOR_WORDS and "joint" not in words
    )


def _inertial_values(log: CheckedLog, columns: Sequence[str]) -> Array:
    start, stop = log.window
    x = np.concatenate([*log.log.parts(columns, (start, stop)), np.zeros((0, len(columns)))])
    return np.asarray(x[np.isfinite(x).all(axis=1)])


def _is_smooth(values: Array) -> bool:
    return bool(np.sqrt(np.mean(np.square(np.diff(values)))) < SMOOTH_STEP_SHARE * values.std())
