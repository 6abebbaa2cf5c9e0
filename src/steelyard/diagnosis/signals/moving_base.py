"""Whether a base is at rest that floats in the model file, and is taken to be fixed.

Efforts of the joints do not identify it: an acceleration of the base acts as a change of gravity
does, and so do errors of a model that several limbs share. An inertial sensor in the log does.
"""

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from steelyard.arrays import Array
from steelyard.diagnosis.case import Case, Evidence
from steelyard.diagnosis.finding import Finding, Fix, Severity
from steelyard.robot_file.column_names import words_of
from steelyard.robot_file.loaded import LoadedRobot

TURNS = {"gyro", "gyroscope", "omega", "angular"}
PULLS = {"acc", "accel", "accelerometer", "acceleration"}
SENSORS = {"imu", "gyro", "gyroscope", "accelerometer", "base", "trunk", "torso", "pelvis", "body"}
"""Words of columns of an inertial sensor, of its place, and of what it measures."""
ROWS = 20_000
"""Rows that are looked at."""
LEAST_TURN = 0.05
"""Root mean square about its mean from which on a rate of turn is motion [rad/s]."""
LEAST_PULL = 0.03
"""The same of a measured acceleration, over its mean length, which is gravity's."""
SMOOTH = 0.7
"""Root mean square of steps over that of values; of noise it is 1.4."""
FIX = Fix(
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
        return tuple(_found(case.loaded, evidence) for evidence in case.logs)


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


def _found(loaded: LoadedRobot, evidence: Evidence) -> Finding:
    turns, pulls = _columns(evidence, TURNS), _columns(evidence, PULLS)
    moves = [*_turning(evidence, turns), *_pulled(evidence, pulls)]
    if moves:
        says = f"base '{loaded.base}' is assumed to be at rest, but its sensor measures motion"
        name, severity = MovingBase.name, Severity.DOUBTFUL
        return Finding(name, evidence.name, severity, says, ", ".join(moves), fix=FIX)
    if turns or pulls:
        says = f"base '{loaded.base}' is at rest according to its sensor"
        figure = ", ".join((*turns, *pulls))
        return Finding(MovingBase.name, evidence.name, Severity.OK, says, figure)
    figure = "no gyroscope or accelerometer of the base in the log"
    says = _assumed(loaded)
    name, ok = MovingBase.name, Severity.OK
    return Finding(name, evidence.name, ok, says, figure, answered=False, headline=True)


def _columns(evidence: Evidence, kinds: set[str]) -> tuple[str, ...]:
    """Columns of an inertial sensor that the robot file gives no other meaning."""
    used = evidence.recording.signals.columns
    named = {c: {*words_of(c)} for c in evidence.log.columns if c not in used}
    return tuple(
        column
        for column, words in named.items()
        if words & kinds and words & SENSORS and "joint" not in words
    )


def _values(evidence: Evidence, columns: Sequence[str]) -> Array:
    """Rows without gaps, shape `(N, columns)`."""
    start, stop = evidence.window
    last = min(stop, start + ROWS)
    x = np.concatenate([*evidence.log.parts(columns, (start, last)), np.zeros((0, len(columns)))])
    return np.asarray(x[np.isfinite(x).all(axis=1)])


def _turning(evidence: Evidence, columns: tuple[str, ...]) -> list[str]:
    """Rates of turn that are motion, in words."""
    clauses = []
    for column in columns:
        degrees = bool({"deg", "dps"} & {*words_of(column)})
        rates = _values(evidence, [column])[:, 0] * (np.pi / 180.0 if degrees else 1.0)
        if len(rates) > 2 and rates.std() > LEAST_TURN and _smooth(rates):
            clauses.append(f"'{column}' varies by {rates.std():.2g} rad/s")
    return clauses


def _pulled(evidence: Evidence, columns: tuple[str, ...]) -> list[str]:
    """Accelerations that vary, in words; only of all three axes together."""
    if len(columns) != 3:
        return []
    pulls = _values(evidence, columns)
    if len(pulls) < 3:
        return []
    length = float(np.mean(np.linalg.norm(pulls, axis=1)))
    spread = pulls.std(axis=0)
    moving = [x for x in range(3) if spread[x] > LEAST_PULL * length and _smooth(pulls[:, x])]
    return [
        f"'{columns[x]}' varies by {100.0 * spread[x] / length:.2g} % of its mean length"
        for x in moving
    ]


def _smooth(values: Array) -> bool:
    """Whether values are motion rather than noise."""
    return bool(np.sqrt(np.mean(np.square(np.diff(values)))) < SMOOTH * values.std())
