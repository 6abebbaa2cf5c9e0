r"""Do feet that carry force stay where they are?

A foot touches at the point $p$ of its frame for which its moment is $p \times F$. Two such points
that both stay have no velocity against each other: along the base's axes, with Jacobians of the
joints alone,

$$ \omega \times (p_a - p_b) + \dot p_a - \dot p_b = 0. $$
"""

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array
from steelyard.check.cases_and_checks import Case, CheckedLog, log_check
from steelyard.check.decision.verdict_of_log import judge_log
from steelyard.check.finding import Finding, Fix, Picture, trace
from steelyard.check.hypotheses.readings_and_likelihood import Reading
from steelyard.model.equations.frame_and_point_kinematics import frame_kinematics

LOADED = 0.15  # force over what all contacts carry from which on a foot carries
SLIPPING = 0.1  # velocity from which on one slips [m/s]
OFTEN_LOADED = 0.2  # share of the time that two feet carry in together for them to be compared
OFTEN_SLIPPING = 0.35  # share of that time from which on they slip
POINT_RIDGE = 1e-3  # of the square of forces, that keeps a point near its frame's origin


@dataclass(frozen=True, eq=False)
class _Foot:
    """A contact: velocity of its point without that of the base, and where it carries."""

    name: str
    place: Array  # `(3, B)` [m]
    velocity: Array  # `(3, B)` [m/s]
    loaded: NDArray[np.bool_]


@log_check("slipping feet", "Do feet that carry force stay where they are?")
def slipping_feet_check(case: Case, log: CheckedLog) -> Finding | None:
    """Pairs of contacts that carry force and move against each other."""
    decision = judge_log(case, log)
    if decision is None or decision.likelihood.base is None:
        return None
    last = decision.last if decision.search is None else decision.search.best
    return _of_reading(last.reading)


def _of_reading(reading: Reading) -> Finding:
    feet, t = feet_of(reading), reading.likelihood.excerpt.t
    omega = reading.motion()[1][3:6]
    speeds, shares = dict[tuple[str, str], Array](), dict[tuple[str, str], float]()
    for a, b in combinations(feet, 2):
        both = a.loaded & b.loaded
        if both.mean() < OFTEN_LOADED:
            continue
        apart = np.cross(omega, a.place - b.place, axis=0) + a.velocity - b.velocity
        speed = np.where(both, np.linalg.norm(apart, axis=0), 0.0)
        speeds[a.name, b.name], shares[a.name, b.name] = (
            speed,
            float((speed[both] > SLIPPING).mean()),
        )
    if not shares:
        says = "undecided: no two feet on links that move carry force for long enough together"
        return Finding.ok(says, answered=False)
    # one that stays beside any other foot does not slip
    least = {
        foot.name: min(mine)
        for foot in feet
        if (mine := [share for pair, share in shares.items() if foot.name in pair])
    }
    names = [name for name, share in least.items() if share >= OFTEN_SLIPPING]
    most = max(least.values())
    figure = (
        f"{100.0 * most:.0f} % of the time that it carries, the foot that moves most is faster "
        f"than {SLIPPING:g} m/s against any other one, at most {100.0 * OFTEN_SLIPPING:.0f} % "
        "allowed"
    )
    if not names:
        return Finding.ok("feet that carry force stay where they are", figure)
    pair = max((pair for pair in shares if names[0] in pair), key=lambda pair: shares[pair])
    first, last = t[np.flatnonzero(speeds[pair] > SLIPPING)[[0, -1]]]
    listed = " or ".join(f"'{name}'" for name in names)
    return Finding.doubtful(
        f"{listed} slips while it carries force, from {first:.3g} to {last:.3g} s",
        figure,
        fix=Fix(
            "if feet do slip, wrenches that are measured count all the same; if not, compare "
            "columns, signs and zeros of the legs' joints, and the angular velocity, with the robot"
        ),
        picture=Picture(
            "time [s]",
            "velocity of two feet against each other while both carry [m/s]",
            (trace(" and ".join(pair), t, speeds[pair]),),
        ),
    )


def feet_of(reading: Reading) -> list[_Foot]:
    """The contacts on links that move against the base, and where they touch."""
    log, base = reading.likelihood, reading.base
    assert log.base is not None and base is not None and log.excerpt.base is not None
    q, dq, _ = reading.motion()
    joints, samples, found = slice(log.signals.n_base, None), log.excerpt.base, list[_Foot]()
    sizes = np.linalg.norm(samples.wrenches[:, :3], axis=1)
    most = float(np.median(sizes.sum(axis=0)))
    for number, contact in enumerate(log.base.signals.contacts):
        at, turn, jacobian = frame_kinematics(log.base.robot, contact.frame)(q.T)
        if not np.abs(jacobian[:, :, joints]).max() > 0.0:
            continue
        wrench = samples.wrenches[base.contacts[number]].reshape(2, 3, -1)
        if base.in_world[number] and samples.axes is not None:
            own = turn.transpose(0, 2, 1) @ base.turn @ samples.axes.transpose(0, 2, 1)
            wrench = np.einsum("bij,kjb->kib", own, wrench)
        loaded = sizes[base.contacts[number]] > LOADED * most
        arm = turn @ _point(wrench[0].T[loaded], wrench[1].T[loaded])
        moved = jacobian[:, :, joints] @ dq[joints].T[..., None]
        velocity = moved[:, :3, 0] + np.cross(moved[:, 3:, 0], arm)
        found.append(_Foot(contact.frame, (at + arm).T, velocity.T, loaded))
    return found


def _point(force: Array, moment: Array) -> Array:
    """The point `(3,)` [m] of a frame about which forces and moments `(N, 3)` touch."""
    cross = -np.cross(force[:, None, :], np.eye(3)[None], axis=-1).transpose(0, 2, 1)
    gram = np.einsum("nij,nik->jk", cross, cross)
    right = np.einsum("nij,ni->j", cross, moment)
    return np.asarray(
        np.linalg.solve(gram + POINT_RIDGE * max(np.trace(gram), 1e-12) * np.eye(3), right)
    )
