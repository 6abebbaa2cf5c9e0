r"""Closed chains: pins, their loop equations, and the passive joints that these determine.

A pin's residual is the vector between its two points, in the frame of the last body that carries
both ends: joints before that body cannot open it. A mechanism in one plane needs only two of the
three scalars, so the independent ones are chosen by rank where the loops are closed.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from steelyard.base.arrays import Array, frozen
from steelyard.base.errors import ModelError, refuse_unknown
from steelyard.robot.mechanism import Mechanism, Pin
from steelyard.robot.robot import Frame, LoopClosure, OpenLoops, Robot, bodies_along

CLOSED = 1e-5  # distance of a pin's two points up to which it counts as closed [m]
_ROUNDING = 1e-15  # closure error that is rounding alone [m]
_RANK = 1e-7  # singular values below this, relative to the largest, are zero

_NEARBY = 8
_TRIES = 40


@dataclass(frozen=True, eq=False)
class LoopEquations:
    """The scalar equations that determine the passive joints, one per passive joint.

    Each has the number of its loop and the direction along which its residual is taken, `(n_p, 3)`.
    `depends`, `(n_p, n_joints)`, is whether it changes with a joint; `assembly`, `(n_joints,)`, is
    where the loops are closed.
    """

    loops: tuple[int, ...]
    directions: Array
    depends: Array
    assembly: Array


@lru_cache(maxsize=128)
def chains(robot: Robot, loop: LoopClosure) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Bodies from behind the last one that carries both ends of a loop, down to each end."""
    return robot.apart(*loop.bodies)


def residual(robot: Robot, q: Array) -> tuple[Array, Array]:
    """What the pins lack at `q` along their axes, `(3 n_loops,)` [m]; and its derivative.

    The derivative has the shape `(3 n_loops, n_joints)`.
    """
    rotations, origins = ([x[0] for x in xs] for xs in bodies_along(robot, q[None]))
    lacks = np.zeros((len(robot.loops), 3))
    slopes = np.zeros((len(robot.loops), 3, robot.n_joints))
    for number, loop in enumerate(robot.loops):
        first, second = chains(robot, loop)
        back = rotations[robot.bodies[(first or second)[0]].parent + 1].T
        ends = zip((1.0, -1.0), (first, second), loop.bodies, loop.points, strict=True)
        for sign, chain, carrier, point in ends:
            tip = origins[carrier + 1] + rotations[carrier + 1] @ point
            lacks[number] += sign * back @ tip
            for k in chain:
                body = robot.bodies[k]
                lever = axis = rotations[body.parent + 1] @ (body.rotation @ body.axis)
                if body.kind == "revolute":
                    lever = np.cross(axis, tip - origins[k + 1])
                slopes[number, :, body.coordinate] += sign * body.ratio * back @ lever
    return lacks.ravel(), slopes.reshape(-1, robot.n_joints)


def gaps(robot: Robot, q: Array) -> Array:
    """Distance of the two points of every pin, shape `(n_loops,)` [m]."""
    return np.asarray(np.linalg.norm(residual(robot, q)[0].reshape(-1, 3), axis=1))


def closest(robot: Robot, q: Array, free: Sequence[int]) -> Array:
    """All joints, those of `free` moved to where the pins lack least (Levenberg-Marquardt)."""
    q, damping = np.array(q, dtype=np.float64), 1e-3
    lack, slope = residual(robot, q)
    for _ in range(100):
        if lack @ lack < _ROUNDING**2:
            break
        matrix = slope[:, free]
        normal = matrix.T @ matrix
        scale = max(float(np.trace(normal)), 1e-12)
        step = np.linalg.solve(normal + damping * scale * np.eye(len(free)), -matrix.T @ lack)
        trial = q.copy()
        trial[free] += np.clip(step, -0.5, 0.5)
        new_lack, new_slope = residual(robot, trial)
        if new_lack @ new_lack < lack @ lack:
            q, lack, slope, damping = trial, new_lack, new_slope, max(damping / 10.0, 1e-15)
        elif damping > 1e6 or np.abs(step).max() < 1e-15:
            break
        else:
            damping *= 10.0
    return q


@lru_cache(maxsize=32)
def loop_equations(robot: Robot) -> LoopEquations:
    """The equations of a robot's passive joints; a `ModelError` if they do not determine them."""
    return checked_equations(robot, [f"robot '{robot.name}', loop '{x.name}'" for x in robot.loops])


def checked_equations(robot: Robot, where: Sequence[str]) -> LoopEquations:
    """As `loop_equations`, with the place of every loop for messages."""
    rng, everything = np.random.default_rng(0), list(range(robot.n_joints))
    starts = [robot.assembly + 0.1 * rng.standard_normal(robot.n_joints) for _ in range(_NEARBY)]
    found = [closest(robot, start, everything) for start in starts]
    near = [q for q in found if gaps(robot, q).max() <= CLOSED]
    if near:
        _check_count(robot, near, where[0])
    assembly = _assembled(robot, list(range(robot.n, robot.n_joints)))
    worst = gaps(robot, assembly)
    if worst.max() > CLOSED:
        loop = int(worst.argmax())
        raise ModelError(
            f"loop '{robot.loops[loop].name}' does not close in the reference configuration: "
            f"closure error {worst[loop]:.3g} m",
            where=where[loop],
            fix="correct its points, or give [robot.assembly] positions of all joints near which "
            "it closes",
        )
    return _chosen(robot, assembly, near, where[0])


def _check_count(robot: Robot, near: Sequence[Array], where: str) -> None:
    """As many passive joints as the loops have independent equations."""
    slopes = [residual(robot, q)[1] for q in near]
    floors = [_RANK * float(np.linalg.norm(slope, 2) or 1.0) for slope in slopes]
    count = max(int(np.linalg.matrix_rank(*x)) for x in zip(slopes, floors, strict=True))
    if count == len(robot.passive):
        return
    names = ", ".join(c.name for c in robot.passive)
    equations = f"{count} independent equation{'s' if count != 1 else ''}"
    joints = "is 1 passive joint" if len(robot.passive) == 1 else ""
    joints = joints or f"are {len(robot.passive)} passive joints"
    raise ModelError(
        f"the loops give {equations}, but there {joints}: {names or 'none'}",
        where=where,
        fix=f"name {count} of the loops' joints: [robot] passive = [...]",
    )


def _assembled(robot: Robot, passive: Sequence[int]) -> Array:
    """The assembly, its passive joints where the loops close; another start if need be."""
    rng = np.random.default_rng(1)
    best = closest(robot, robot.assembly, passive)
    for k in range(_TRIES):
        if gaps(robot, best).max() <= CLOSED:
            break
        start = robot.assembly.copy()
        start[passive] += rng.uniform(-1.0, 1.0, len(passive)) * np.pi * (k + 1) / _TRIES
        trial = closest(robot, start, passive)
        best = min(best, trial, key=lambda q: float(gaps(robot, q).max()))
    return frozen(best)


def _chosen(robot: Robot, assembly: Array, near: Sequence[Array], where: str) -> LoopEquations:
    """The best conditioned equations in the reference configuration, one per passive joint."""
    from scipy.linalg import qr

    slopes = [residual(robot, q)[1] for q in (assembly, *near)]
    loops, directions, rows = [], [], []
    for number in range(len(robot.loops)):
        part = np.hstack([s[3 * number : 3 * number + 3] for s in slopes])
        for direction in _directions(part):
            loops.append(number)
            directions.append(direction)
            rows.append([direction @ s[3 * number : 3 * number + 3] for s in slopes])
    all_rows = np.array(rows)
    by_passive = all_rows[:, 0, robot.n :]
    triangle, order = qr(by_passive.T, mode="r", pivoting=True)  # the largest remainder first
    floor = _RANK * max(float(np.abs(by_passive).max(initial=0.0)), 1e-300)
    kept = sorted(int(k) for k in order[: int(np.sum(np.abs(np.diag(triangle)) > floor))])
    if len(kept) < len(robot.passive):
        names = ", ".join(c.name for c in robot.passive)
        raise ModelError(
            f"the loops do not determine {names} in the reference configuration: it is singular, "
            "or they are the wrong joints",
            where=where,
            fix="give [robot.assembly] positions away from singularities (bars in one line), or "
            "name other joints: [robot] passive = [...]",
        )
    depends = np.abs(all_rows[kept]).max(axis=1) > 1e-12
    return LoopEquations(
        tuple(loops[k] for k in kept), frozen(np.array(directions)[kept]), depends, assembly
    )


def _directions(slopes: Array) -> Array:
    """Directions in which a pin can open at all, shape `(1 to 3, 3)`: axes where that suffices."""
    left, sizes, _ = np.linalg.svd(slopes)
    count = int(np.sum(sizes > _RANK * max(float(sizes[0]), 1e-300)))
    moving = np.linalg.norm(slopes, axis=1) > _RANK * sizes[0]
    return np.eye(3)[moving] if moving.sum() == count else np.asarray(left[:, :count].T)


@dataclass(frozen=True)
class Closing:
    """What a robot file says of closed chains, beside what the model file says.

    More pins, and the joints that the loops determine, `None` if not given; positions of joints
    near which the loops close [rad; m].
    """

    pins: tuple[Pin, ...] = ()
    passive: tuple[str, ...] | None = None
    assembly: Mapping[str, float] = field(default_factory=dict)
    open_loops: OpenLoops = "stop"
    where: str = "the mechanism"


def passive_joints(
    mechanism: Mechanism, free: Sequence[str], joints: Sequence[str] | None, closing: Closing
) -> tuple[str, ...]:
    """Names of the joints that the loops determine.

    If nobody says which: those of the loops' joints, or of the ones that they follow,
    that are `free` and not to be identified (`joints`, if given), or that no actuator drives.
    """
    pins = (*mechanism.pins, *closing.pins)
    if not pins:
        if closing.passive or closing.assembly:
            raise ModelError(
                "passive joints or a reference configuration are given, but the robot has no loops",
                where=closing.where,
                fix="add [[robot.loops]] with links and points, or remove them",
            )
        return ()
    if closing.passive is not None:
        return closing.passive
    round_trip = {mechanism.drives[j].master for pin in pins for j in between(mechanism, pin)}
    candidates = [name for name in free if name in round_trip]
    active = mechanism.driven if joints is None else joints
    if candidates and not set(active) & set(free):
        raise ModelError(
            f"of the loop joints {', '.join(candidates)} the passive ones are not given",
            where=pins[0].where,
            fix="name them in a robot file: [robot] passive = [...]",
        )
    return tuple(name for name in candidates if name not in active)


def between(mechanism: Mechanism, pin: Pin) -> set[str]:
    """Joints that move one end of a pin and not the other."""
    first, second = ({j.name for j in mechanism.to_link(link) if j.movable} for link in pin.links)
    return first ^ second


def closed_robot(
    robot: Robot, mechanism: Mechanism, closing: Closing
) -> tuple[Robot, tuple[str, ...]]:
    """The robot with its loops, assembled where they close; a note on where its passive joints are.

    Pins between links that do not move against each other are checked and left out.
    """
    if not robot.coordinates:
        raise ModelError(
            "every joint is passive: none is left to identify",
            where=closing.where,
            fix="list under passive only the joints that the loops determine",
        )
    frames = {frame.name: frame for frame in robot.frames}
    loops, places = [], []
    for pin in (*mechanism.pins, *closing.pins):
        loop = _loop(pin, frames)
        if loop.bodies[0] != loop.bodies[1]:
            loops.append(loop)
            places.append(pin.where)
            continue
        gap = float(np.linalg.norm(loop.points[0] - loop.points[1]))
        if gap > CLOSED:
            raise ModelError(
                f"loop '{pin.name}' is locked open: closure error {gap:.3g} m",
                where=pin.where,
                fix="correct its points, or lock its joints where it closes",
            )
    if not loops and not robot.passive:
        return robot, ()
    if not loops:
        raise ModelError(
            f"joint '{robot.passive[0].name}' is passive, but every loop is locked",
            where=closing.where,
            fix="unlock the loops' joints, or lock the passive ones as well",
        )
    given = {**mechanism.rest, **closing.assembly}
    start = [
        given.get(c.name, float(np.clip(0.0, c.limits.lower, c.limits.upper))) for c in robot.joints
    ]
    robot = robot.changed(loops=tuple(loops), assembly=start, open_loops=closing.open_loops)
    assembly = checked_equations(robot, places).assembly
    names = [c.name for c in robot.joints]
    for name in closing.assembly:
        wrong = f"the reference configuration gives a position of joint '{name}', which is not "
        wrong += "identified or passive"
        refuse_unknown(name, names, wrong, closing.where, "joints that move")
    return robot.changed(assembly=assembly), _note(robot, assembly, closing)


def _loop(pin: Pin, frames: Mapping[str, Frame]) -> LoopClosure:
    bodies, points = [], []
    for link, point in zip(pin.links, pin.points, strict=True):
        if link not in frames:
            raise ModelError(
                f"link '{link}' of loop '{pin.name}' is not beyond the base link",
                where=pin.where,
                fix="choose a base before both links of the loop",
            )
        frame = frames[link]
        bodies.append(frame.body)
        points.append(frame.position + frame.rotation @ point)
    return LoopClosure(pin.name, (bodies[0], bodies[1]), np.array(points))


def _note(robot: Robot, assembly: Array, closing: Closing) -> tuple[str, ...]:
    """Where the loops were closed, if that was not given already."""
    given = closing.assembly
    at = dict(zip([c.name for c in robot.joints], assembly.tolist(), strict=True))
    if all(abs(given.get(c.name, np.inf) - at[c.name]) < 1e-3 for c in robot.passive):
        return ()
    moving = robot.joints[robot.n_base :]
    places = ", ".join(f"{c.name} at {at[c.name]:.4g} {c.unit}" for c in moving)
    return (f"the loops are closed in the reference configuration, with {places}",)
