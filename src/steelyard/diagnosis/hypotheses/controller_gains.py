r"""Drive gains from a controller's own targets, where a log has target torques and target currents.

A controller that turns torques into currents has gains for it. In motion its target current also
compensates friction, which is any function of speed here, and accelerates rotors:

$$ i^* = \tau^* / K + f(\dot q) + I_r \ddot q $$

The target torque is the controller's own and exact; what this lacks is an error of the current, so
least squares of the current are not biased. Intervals come from leaving out one part of the time
after the other (jackknife).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.diagnosis.case import Case, Evidence
from steelyard.diagnosis.likelihood.excerpt import Excerpt, excerpt_of
from steelyard.diagnosis.likelihood.nuisance import REST
from steelyard.robot_file.column_names import Column, by_number
from steelyard.robot_file.sections import Gain

TARGETS = frozenset("des desired target ref reference cmd command commanded setpoint".split())
TORQUES = frozenset("tau torque torques moment moments".split())
CURRENTS = frozenset("current currents curr i".split())
KNOTS = 24
"""Speeds between which friction is linear."""
PARTS = 12
"""Parts of the time for intervals."""
NARROW = 0.05
"""Half-width of a gain's 95 % interval, over the gain, up to which it is written."""


@dataclass(frozen=True, eq=False)
class ControllerGains:
    """Gains with their intervals.

    Attributes:
        columns: Those of target torque and target current of the first joint.
        values: Joint torque over current, shape `(n,)`; zero where it cannot be estimated.
        half_widths: Of 95 % intervals, shape `(n,)`.
    """

    columns: tuple[str, str]
    values: Array
    half_widths: Array

    @property
    def known(self) -> NDArray[np.bool_]:
        """Where the interval is narrow, shape `(n,)`."""
        return np.asarray(self.half_widths <= NARROW * self.values) & (self.values > 0.0)

    @property
    def entries(self) -> list[Gain]:
        """The robot file's `gain`: a number where it is known, else `"identify"`."""
        pairs = zip(self.values, self.known, strict=True)
        return [float(f"{value:.4g}") if known else "identify" for value, known in pairs]


_FOUND: "WeakKeyDictionary[Case, ControllerGains | None]" = WeakKeyDictionary()


def controller_gains(case: Case) -> ControllerGains | None:
    """Gains from all logs that have both targets; `None` where none is known."""
    if case not in _FOUND:
        _FOUND[case] = gains_of_logs(case.logs, len(case.joints))
    return _FOUND[case]


def gains_of_logs(logs: Sequence[Evidence], joints: int) -> ControllerGains | None:
    """Gains from all logs that have both targets; `None` where none is known.

    Args:
        logs: The logs.
        joints: Number of joints.
    """
    parts, names = [], ("", "")
    for evidence in logs:
        found = _columns(evidence)
        if found is None:
            continue
        pair = [_excerpt(evidence, columns) for columns in found]
        if pair[0] is not None and pair[1] is not None:
            parts.append(_joints(evidence, pair[0], pair[1]))
            names = found[0][0], found[1][0]
    if not parts:
        return None
    per_joint = [[part[j] for part in parts] for j in range(joints)]
    fits = np.array([_gain(np.concatenate(rows, axis=1)) for rows in per_joint])
    gains = ControllerGains(names, fits[:, 0], fits[:, 1])
    return gains if gains.known.any() else None


def _columns(evidence: Evidence) -> tuple[tuple[str, ...], tuple[str, ...]] | None:
    """Columns of target torque and target current, one per joint."""
    signals = evidence.recording.signals
    if set(signals.effort_units) != {"A"} or signals.effort_map is not None:
        return None
    named = [Column(name) for name in evidence.log.columns]
    targets = [column for column in named if TARGETS & set(column.words)]
    found = []
    for words in (TORQUES, CURRENTS):
        groups = by_number(signals.n, [c for c in targets if words & set(c.words)])
        if not groups:
            return None
        found.append(tuple(column.name for column in groups[0]))
    return found[0], found[1]


def _excerpt(evidence: Evidence, columns: Sequence[str]) -> Excerpt | None:
    """The log with other columns as its efforts, as logged."""
    signals = evidence.recording.signals
    changed = replace(signals, effort=tuple(columns), effort_scale=np.ones(signals.n))
    return excerpt_of(replace(evidence.recording, signals=changed), evidence.processing)


def _joints(evidence: Evidence, torque: Excerpt, current: Excerpt) -> list[Array]:
    """Per joint target torque, target current [A], speed and acceleration, shape `(4, N)`."""
    scale = evidence.recording.signals.position_scale[:, None]
    dq, ddq = scale * torque.dz, scale * torque.ddz
    current_e = current.e * evidence.recording.signals.effort_scale[:, None]
    fastest = np.quantile(np.abs(dq), 0.98, axis=1)
    rows = np.stack((torque.e, current_e, dq, ddq), axis=1)
    return [rows[j][:, np.abs(dq[j]) > REST * fastest[j]] for j in range(len(rows))]


def _gain(rows: Array) -> tuple[float, float]:
    """Gain of one joint and the half-width of its 95 % interval; zero where nothing shows it."""
    count = rows.shape[1]
    if count < 20 * KNOTS or not all(np.ptp(x) > 0.0 for x in rows[:2]):
        return 0.0, 0.0
    ends = np.linspace(0, count, PARTS + 1).astype(int)
    parts = zip(ends[:-1], ends[1:], strict=True)
    left_out = np.array([_inverse(np.delete(rows, slice(a, b), axis=1)) for a, b in parts])
    inverse = _inverse(rows)
    std = np.sqrt((PARTS - 1) / PARTS * np.sum(np.square(left_out - np.mean(left_out))))
    if inverse <= 0.0:
        return 0.0, 0.0
    return 1.0 / inverse, float(2.0 * std / inverse**2)


def _inverse(rows: Array) -> float:
    """Target current over target torque, friction and rotor inertia beside it."""
    torque, current, speed, acceleration = rows
    knots = np.unique(np.append(np.quantile(speed, np.linspace(0.0, 1.0, KNOTS)), 0.0))
    hats = [np.interp(speed, knots, row) for row in np.eye(len(knots))]
    columns = np.array([torque, acceleration, *hats]).T
    lengths = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    found = np.linalg.lstsq(columns / lengths, current, rcond=1e-10)[0]
    return float(found[0] / lengths[0])
