"""Parameters that no motion shows while contacts of unknown force stay, and motions that show them.

Feet that stand still tie the base and the joints together, and their unknown forces take rows out
of the equations: what is left are those of the few motions that remain. Their regressor, at random
states about a posture that keep these feet where they are and behind the projection that takes the
forces out, has a null space: parameters in it are hidden, however long the robot moves so.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from steelyard.base.arrays import Array
from steelyard.estimate.information.base_parameters_and_regressor import Regressor
from steelyard.robot.file.signals import BaseSignals
from steelyard.robot.robot import BASE_COORDINATES
from steelyard.runs.contact_projection import Touching
from steelyard.runs.floating_base import of_angles
from steelyard.runs.frames_of_contacts import kinematics_of
from steelyard.runs.run import Run

STEP = 1e-5  # time over which a Jacobian's change is taken [s]
NULL = 1e-4  # singular value over the largest of unit columns that nobody sees
LEAST = 0.2  # time that a stance holds at least [s]
MOST = 4  # stances of the same contacts that are looked at
HIDDEN = 0.05  # length of a parameter's part in the null space from which on it is hidden
REACH = 0.3  # how far joints, and angles of the base, are from the posture [rad]
SHIFT = 0.05  # how far the base is from it [m]
SOLE = 0.05  # distance of points that stand for a sole [m]
NEWTON, CLOSED = 15, 1e-9  # steps that bring contacts to their places, and how far off they may be


@dataclass(frozen=True)
class Stance:
    """Contacts that touch together, and a posture in which they do, `(n,)`."""

    touching: tuple[bool, ...]
    posture: tuple[float, ...]


@dataclass(frozen=True)
class Hiding:
    """Parameters that are hidden in some stances, and what shows them.

    Attributes:
        names: Base parameters that are in hidden combinations.
        combinations: How many combinations of them are hidden.
        shows: Further motions, in words, with how many combinations each leaves hidden.
    """

    names: tuple[str, ...] = ()
    combinations: int = 0
    shows: tuple[tuple[str, int], ...] = ()

    @property
    def note(self) -> str:
        """For people to read; empty where nothing is hidden."""
        if not self.combinations:
            return ""
        some, each = ", ".join(self.names[:6]), "a combination" if self.combinations == 1 else ""
        each = each or f"{self.combinations} combinations"
        text = (
            f"contacts of unknown force hide {each} of {len(self.names)} parameters, however the "
            f"robot moves on them ({some}{', ...' if len(self.names) > 6 else ''}): they are "
            "from the prior, and without one their values and intervals are not to be used"
        )
        left, words = self.combinations, list[str]()
        for motion, count in self.shows:
            if count < left:
                words.append(f"{motion} would show {'all' if not count else left - count}")
            left = count
        return f"{text}; {', '.join(words)}" if words else text


def hidden_parameters(regressor: Regressor, base: BaseSignals, stances: Sequence[Stance]) -> Hiding:
    """What data of these stances hide, and motions that show it.

    Motions are, in this order, squats on all contacts, lifting one after the other, and hanging on
    a hoist of unknown force, from the first posture, until everything is shown.
    """
    count, names, first = len(base.touches), regressor.layout.columns, stances[0].posture
    seen = [_rows(regressor, base, stance) for stance in stances]
    hidden = _hidden(seen)
    if not len(hidden):
        return Hiding()
    lifted = [tuple(k != one for k in range(count)) for one in range(count)]
    hung = replace(base, wrench_known=False)
    motions = (
        ("a squat on all contacts", base, [(True,) * count]),
        ("lifting one contact after the other", base, lifted),
        ("hanging on a hoist", hung, [(False,) * count]),
    )
    shows = []
    for motion, given, patterns in motions:
        more = [_rows(regressor, given, Stance(pattern, first)) for pattern in patterns]
        shows.append((motion, len(_hidden([*seen, *more]))))
        if not shows[-1][1]:
            break
    among = np.linalg.norm(hidden, axis=0) > HIDDEN
    mine = tuple(name for name, is_one in zip(names, among, strict=True) if is_one)
    return Hiding(mine, len(hidden), tuple(shows))


def stances_of(runs: Sequence[Run]) -> tuple[Stance, ...]:
    """Stances that hold in runs for `LEAST` seconds, of those with the fewest contacts first."""
    found: dict[tuple[bool, ...], list[Array]] = {}
    for run in runs:
        least = max(2, round(LEAST * run.rate))
        for block in run.blocks():
            if block.touching is None:
                continue
            flags = block.touching.flags
            change = np.flatnonzero((flags[:, 1:] != flags[:, :-1]).any(axis=0)) + 1
            for first, stop in pairwise((0, *change.tolist(), flags.shape[1])):
                if stop - first >= least:
                    pattern = tuple(flags[:, first].tolist())
                    found.setdefault(pattern, []).append(block.q[:, (first + stop) // 2])
    chosen = list[Stance]()
    for pattern in sorted(found, key=sum):
        every = found[pattern]
        at = np.unique(np.linspace(0, len(every) - 1, MOST).round().astype(int))
        chosen += [Stance(pattern, tuple(every[k].tolist())) for k in at]
    return tuple(chosen[: MOST * MOST])


def touched_samples(runs: Sequence[Run], contacts: int) -> tuple[Array, Array, int]:
    """Samples in which each contact may touch, those in the margins of a change, and of all.

    The first two have the shape `(contacts,)`; margins are those of each run's rate.
    """
    touching, near, samples = np.zeros(contacts), np.zeros(contacts), 0
    for run in runs:
        base = run.recording.signals.base
        margins = [] if base is None else [touch.margin * run.rate for touch in base.touches]
        for block in run.blocks():
            if block.touching is not None:
                flags = block.touching.flags
                touching += flags.sum(axis=1)
                near += np.array(margins) * (flags[:, 1:] != flags[:, :-1]).sum(axis=1)
                samples += flags.shape[1]
    return touching, near, samples


def _hidden(rows: Sequence[Array]) -> Array:
    """Directions of unit length that no row sees, of columns of unit length, `(k, columns)`."""
    matrix = np.concatenate(rows)
    lengths = np.linalg.norm(matrix, axis=0)
    zero = lengths <= NULL * lengths.max(initial=1e-300)
    _, values, vectors = np.linalg.svd(
        np.linalg.qr(matrix[:, ~zero] / lengths[~zero], mode="r"), full_matrices=True
    )
    null = vectors[int(np.sum(values > NULL * values[0])) :]
    found = np.zeros((len(null) + zero.sum(), len(lengths)))
    found[: len(null), ~zero] = null
    found[range(len(null), len(found)), np.flatnonzero(zero)] = 1.0
    return found


def _rows(regressor: Regressor, base: BaseSignals, stance: Stance) -> Array:
    """Rows without the forces of contacts `(rows, columns)`, at states that keep these still.

    Rows of the base count only where its wrench is known.
    """
    robot, six = regressor.model.robot, len(BASE_COORDINATES)
    rng, columns = np.random.default_rng(0), len(regressor.layout.columns)
    q = _positions(base, stance, 2 * columns // six + 20, rng)
    count = q.shape[1]
    tilt = REACH * rng.normal(size=(2, count))
    up = np.stack([np.sin(tilt[0]), np.sin(tilt[1]), np.ones(count)])
    up /= np.linalg.norm(up, axis=0)
    flags = np.tile(np.array(stance.touching)[:, None], count)
    touching = Touching(replace(base, spread=()), np.ones(robot.n), flags, up[: 3 * base.rolls])
    jacobian = touching.jacobian(q)
    inverse = np.linalg.pinv(jacobian, rcond=1e-9)

    def still(values: Array, wanted: Array) -> Array:
        """Values `(n, N)` changed as little as gives the contacts what is wanted `(N, m)`."""
        off = wanted - np.einsum("nij,jn->ni", jacobian, values)
        return np.asarray(values + np.einsum("nij,nj->in", inverse, off))

    dq = still(rng.normal(size=q.shape), np.zeros(jacobian.shape[:2]))
    moved = dq.copy()
    moved[:six] = 0.0
    change = touching.jacobian(q + STEP * moved) - touching.jacobian(q - STEP * moved)
    ddq = still(rng.normal(size=q.shape), -np.einsum("nij,jn->ni", change / (2.0 * STEP), dq))
    # from numbers of the velocity along turning axes to the acceleration of the base's origin
    ddq[:3] += np.cross(dq[3:six], dq[:3], axis=0) + float(np.linalg.norm(base.gravity)) * up
    counted: NDArray[np.bool_] = np.ones(q.shape, dtype=np.bool_)
    counted[:six] = base.wrench_known
    dense = regressor.dense(q, dq, ddq).transpose(1, 0, 2)
    return np.asarray((touching.projection(q, counted) @ dense).reshape(-1, columns))


def _positions(base: BaseSignals, stance: Stance, count: int, rng: Any) -> Array:
    """Positions about a posture, with contacts where they are in it, `(n, N)`.

    Base and joints are moved at random, and Newton's steps bring the contacts back.
    """
    posture, six = np.array(stance.posture), len(BASE_COORDINATES)
    q = posture[:, None] + REACH * rng.uniform(-1.0, 1.0, (len(posture), count))
    q[:six] = 0.0
    place = SHIFT * rng.uniform(-1.0, 1.0, (count, 3))
    axes = of_angles(REACH * rng.uniform(-1.0, 1.0, (3, count)))
    wanted = _points(base, stance, posture[:, None])[0]
    for _ in range(NEWTON):
        points, slopes = _points(base, stance, q)
        off = np.einsum("nji,ncj->nci", axes, wanted - place[:, None]) - points
        inverse = np.linalg.pinv(slopes.reshape(count, -1, len(q)), rcond=1e-6)
        step = np.einsum("nij,nj->in", inverse, off.reshape(count, -1))
        step = np.clip(step, -REACH, REACH)
        q[six:] += step[six:]
        place += np.einsum("nij,jn->ni", axes, step[:3])
        axes = axes @ of_angles(step[3:six])
    points = np.einsum("nij,ncj->nci", axes, _points(base, stance, q)[0]) + place[:, None]
    far = np.abs(wanted - points).max(axis=(1, 2), initial=0.0)
    return np.asarray(q[:, far < CLOSED])


def _points(base: BaseSignals, stance: Stance, q: Array) -> tuple[Array, Array]:
    """Points `(N, c, 3)` [m] of contacts that touch, three of a sole, and slopes `(N, c, 3, n)`."""
    count, n = q.shape[1], len(q)
    places, slopes = [np.zeros((count, 0, 3))], [np.zeros((count, 0, 3, n))]
    frames = kinematics_of(base, tuple(touch.frame for touch in base.touches))
    for touch, kinematics, touches in zip(base.touches, frames, stance.touching, strict=True):
        if not touches:
            continue
        origin, axes, jacobian = kinematics(q.T)
        for offset in (np.zeros(3), *(SOLE * np.eye(3) if touch.sole else ())):
            arm = axes @ (np.array(touch.place) + offset)
            turned = np.cross(jacobian[:, 3:], arm[:, :, None], axis=1)
            places.append((origin + arm)[:, None])
            slopes.append((jacobian[:, :3] + turned)[:, None])
    return np.concatenate(places, axis=1), np.concatenate(slopes, axis=1)
