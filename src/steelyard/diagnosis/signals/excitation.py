"""Which joints move, how far, how fast, and in which band?"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from steelyard.arrays import Array
from steelyard.diagnosis.case import Case, Evidence
from steelyard.diagnosis.finding import Finding, Fix, Picture, Severity
from steelyard.diagnosis.pictures import of_joints
from steelyard.diagnosis.signal_overview import look
from steelyard.diagnosis.signals.units import motion, reading
from steelyard.measurement.spectrum import motion_band

LITTLE = {"revolute": 0.05, "prismatic": 0.01}
"""Range below which a joint hardly moves [rad; m]."""
USEFUL = {"revolute": "1 rad", "prismatic": "a tenth of a metre"}
"""A range from which something can be learnt."""
FAST = 0.3
"""Share of a joint's speed limit that a motion should reach."""
QUANTILE = 0.005
"""Positions outside these quantiles, on each side, do not count."""


@dataclass(frozen=True, eq=False)
class _Motion:
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
        logs = [evidence for evidence in case.logs if look(case, evidence).step > 0.0]
        if not logs:
            return ()
        motions = [_motion(case, evidence) for evidence in logs]
        alone = len(motions) == 1
        found = [
            self._look(case, evidence, done, alone)
            for evidence, done in zip(logs, motions, strict=True)
        ]
        return tuple(found) if alone else (*found, self._together(case, motions))

    def _look(self, case: Case, evidence: Evidence, done: _Motion, alone: bool) -> Finding:
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
            _says(done, names),
            _value_text(case, done),
            joints=tuple(names) if severity != Severity.OK else (),
            fix=fix,
            picture=_picture(case, done),
        )

    def _together(self, case: Case, motions: Sequence[_Motion]) -> Finding:
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


def _motion(case: Case, evidence: Evidence) -> _Motion:
    overview, units = look(case, evidence), reading(case, evidence)
    coordinates = case.loaded.robot.coordinates
    n = len(coordinates)
    slope = motion(case, evidence)
    scale = np.array([joint.position_scale for joint in units.joints])
    if len(overview.q) < 2:
        return _Motion(np.zeros(n), np.zeros(n), np.zeros(n, dtype=np.bool_), np.zeros(n))
    low, high = np.quantile(overview.q, [QUANTILE, 1.0 - QUANTILE], axis=0)
    reach = (high - low) * np.maximum(scale, 1.0)
    enough = reach >= [LITTLE[c.kind] for c in coordinates]
    moves = enough & slope.moving
    fast = np.zeros(n)
    if slope.v.shape[1]:
        fast = np.quantile(np.abs(slope.v), 1.0 - QUANTILE, axis=1) * scale
    even, rate = overview.even(overview.q, units.second)
    longest = max(even, key=lambda x: x.shape[1], default=np.zeros((n, 0)))
    band = [motion_band(longest[j : j + 1], rate).frequency if moves[j] else 0.0 for j in range(n)]
    return _Motion(reach, fast, moves, np.array(band))


def _says(done: _Motion, still: Sequence[str]) -> str:
    if not done.moves.any():
        return "no joint moves"
    band = done.band[done.moves]
    facts = f"motion up to {band.min():.2g} to {band.max():.2g} Hz, by joint"
    if still:
        return f"hardly any motion of {', '.join(still)}; {facts}"
    return f"every joint moves; {facts}"


def _value_text(case: Case, done: _Motion) -> str:
    coordinates = case.loaded.robot.coordinates
    share = [r / LITTLE[c.kind] for r, c in zip(done.range, coordinates, strict=True)]
    least = int(np.argmin(share))
    c = coordinates[least]
    return (
        f"{case.joints[least]} moves least: range {done.range[least]:.2g} {c.unit}, at least "
        f"{LITTLE[c.kind]:g} {c.unit} required"
    )


def _help(case: Case, still: NDArray[np.intp]) -> str:
    """Which motion would help."""
    coordinates = [case.loaded.robot.coordinates[j] for j in still]
    parts = []
    for c in coordinates:
        limit = c.limits.velocity
        speed = f", up to {FAST * limit:.2g} {c.unit}/s" if np.isfinite(limit) else ""
        parts.append(f"{c.name} by {USEFUL[c.kind]} or more{speed}")
    return "record a motion of " + "; ".join(parts) + ", at several speeds in both directions"


def _picture(case: Case, done: _Motion) -> Picture:
    bound = np.array([LITTLE[c.kind] for c in case.loaded.robot.coordinates])
    return of_joints(
        "range [rad; m]", (("range", done.range, "bars"), ("hardly moves", bound, "points"))
    )
