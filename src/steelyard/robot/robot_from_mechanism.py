"""From a mechanism to a robot: joints that move, follow or are locked, merged links, and notes."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from steelyard.base.arrays import frozen
from steelyard.base.errors import ModelError, advice, listing, refuse_unknown
from steelyard.robot.floating_ball_and_coupled_joints import (
    floating_link,
    refuse_coupled,
    without_free_joints,
)
from steelyard.robot.inertia_and_placement import LEAST_INERTIA, Inertia, Placement
from steelyard.robot.loop_closures import Closing, closed_robot, passive_joints
from steelyard.robot.mechanism import (
    Answer,
    Joint,
    JointSpring,
    Link,
    Listed,
    Mechanism,
    ModelNote,
)
from steelyard.robot.robot import (
    BASE_COORDINATES,
    FLOATING,
    Body,
    Coordinate,
    Frame,
    JointKind,
    Limits,
    Robot,
)


def narrowed(mechanism: Mechanism, name: str) -> tuple[Limits, bool]:
    """Limits that keep the followers of a joint within theirs as well, and whether a range is left.

    A follower at `x = ratio * q + offset` within `[lower, upper]` keeps `q` between `(lower -
    offset) / ratio` and `(upper - offset) / ratio`, and its speed limit counts as `velocity /
    |ratio|`. A follower with an empty range is unlimited; the joint's range stays if none is left.
    """
    limits = unlimited_if_empty(mechanism.joint(name).limits)
    lower, upper, velocity = limits.lower, limits.upper, limits.velocity
    followers = [n for n, x in mechanism.drives.items() if x.master == name and n != name]
    for follower in followers:
        ratio, offset = mechanism.drives[follower].ratio, mechanism.drives[follower].offset
        own = mechanism.joint(follower).limits
        if ratio == 0.0:
            continue
        velocity = min(velocity, own.velocity / abs(ratio))
        if own.lower < own.upper:
            ends = sorted(((own.lower - offset) / ratio, (own.upper - offset) / ratio))
            lower, upper = max(lower, ends[0]), min(upper, ends[1])
    if left := not followers or lower < upper:
        return replace(limits, lower=lower, upper=upper, velocity=velocity), left
    return replace(limits, velocity=velocity), left


def merged(given: Limits, model: Limits, narrow: Limits) -> Limits:
    """Limits that a user gave; those left as the model has them are the narrowed ones."""
    lower, upper, velocity = (
        getattr(narrow if getattr(given, side) == getattr(model, side) else given, side)
        for side in ("lower", "upper", "velocity")
    )
    if not lower < upper:
        lower, upper = given.lower, given.upper
    return replace(given, lower=lower, upper=upper, velocity=velocity)


def unlimited_if_empty(limits: Limits) -> Limits:
    """A range of one point says nothing."""
    if limits.lower == limits.upper:
        return replace(limits, lower=-np.inf, upper=np.inf)
    return limits


def limit_notes(mechanism: Mechanism, robot: Robot) -> list[str]:
    """What was assumed of the coordinates' limits, a sentence each."""
    notes = []
    for c in robot.joints[robot.n_base :]:
        limits = mechanism.joint(c.name).limits
        if limits.lower == limits.upper and np.isinf(c.limits.lower):
            notes.append(f"joint '{c.name}' has an empty range in the model: taken as unlimited")
        if not narrowed(mechanism, c.name)[1]:
            notes.append(
                f"no position of '{c.name}' satisfies the ranges of its mimic joints: "
                "these are ignored"
            )
    return notes


def ignored_statements(
    mechanism: Mechanism, robot: Robot, answered: Collection[Answer], limited: Collection[str]
) -> dict[str, str]:
    """Ignored statements of the model file, each with a line of all it is about.

    Left out is what is about joints that do not move, what the robot file answers, and limits of
    effort of joints for which it gives them (`limited`).
    """
    moving = {body.joint for body in robot.bodies}
    unlimited = set(robot.joint_names) - set(limited)
    lines: dict[str, list[str]] = {}
    for note in _statements(mechanism):
        concerned = unlimited if note.answer == "efforts" else moving
        if note.answer in answered or (note.joints and concerned.isdisjoint(note.joints)):
            continue
        lines.setdefault(note.what, []).append(note.item)
    return {what: what + ", ".join(items) for what, items in lines.items()}


def springs_along(mechanism: Mechanism, robot: Robot) -> dict[str, JointSpring]:
    r"""The springs of the joints that move, one per coordinate, those of its followers included.

    A follower at $x = r q + o$ with a spring $k, x_0$ pulls its master with
    $k r\,(r q + o - x_0)$. Springs of which nothing is left are left out.
    """
    pulls: dict[str, list[float]] = {}
    linear: dict[str, bool] = {}
    for body in robot.bodies:
        spring = mechanism.springs.get(body.joint)
        if spring is None:
            continue
        name = robot.joints[body.coordinate].name
        along = spring.stiffness * body.ratio
        total = pulls.setdefault(name, [0.0, 0.0])
        total[0] += along * body.ratio
        total[1] += along * (spring.free - body.offset)
        linear[name] = linear.get(name, True) and spring.linear
    return {n: JointSpring(k, p / k, linear[n]) for n, (k, p) in pulls.items() if k}


def _statements(mechanism: Mechanism) -> Iterator[ModelNote]:
    """All that the model file says and no robot has: placeholders of limits and springs, too."""
    yield from mechanism.statements
    what = "placeholder effort limits are treated as unknown (state [robot.limits.JOINT] effort): "
    for joint in mechanism.joints:
        if joint.placeholder > 0.0:
            item = f"{joint.name} ({joint.placeholder:g} {_units(joint)[0]})"
            yield ModelNote(what, item, (joint.name,), "efforts")
    what = (
        'springs along joints are in the model file; a term {law = "spring", ...} under [model] '
        "terms represents them, none of the default terms does: "
    )
    for name, spring in mechanism.springs.items():
        effort, position = _units(mechanism.joint(name))
        more = "" if spring.linear else " and higher powers"
        item = (
            f"{name} ({spring.stiffness:g} {effort}/{position}{more}, "
            f"free at {spring.free:.4g} {position})"
        )
        yield ModelNote(what, item, (name,), "springs")


def _units(joint: Joint) -> tuple[str, str]:
    return ("N", "m") if joint.kind == "prismatic" else ("Nm", "rad")


def reduction_notes(
    mechanism: Mechanism, robot: Robot, base: str, assumed: Mapping[str, float]
) -> tuple[str, ...]:
    """What was assumed and matters to the robot's dynamics, one sentence each."""
    notes = list[str]()
    carried = {b.joint for b in robot.bodies}
    touched = {
        j.name
        for j in mechanism.from_link(base)
        if carried & {k.name for k in (*mechanism.to_link(j.child), *mechanism.from_link(j.child))}
    }
    matter = [(mechanism.joint(n), x) for n, x in assumed.items() if n in touched]
    if matter:
        places = ", ".join(f"{j.name} at {x:.4g} {_units(j)[1]}" for j, x in matter)
        notes.append(Listed("locked, as no position was given", places))
    carriers = {frame.name: frame.body for frame in robot.frames if frame.body >= 0}
    lacking = [link for link in mechanism.links if link.lacks and link.name in carriers]
    meshless = {carriers[link.name] for link in lacking}
    bare = [b.name for k, b in enumerate(robot.bodies) if not b.known and k not in meshless]
    if bare:
        notes.append(Listed("no inertial in the model, nominal mass is zero", ", ".join(bare)))
    if lacking:
        names = ", ".join(f"{link.name} ('{link.lacks}')" for link in lacking[:6])
        more = f" and {len(lacking) - 6} more" if len(lacking) > 6 else ""
        notes.append(Listed("nominal mass is zero, as the mesh is missing", names + more))
    for body in robot.bodies:
        if flaw := body.inertia.flaw():
            notes.append(Listed(f"the inertial is not physically consistent: '{body.name}'", flaw))
    return (*notes, *limit_notes(mechanism, robot))


def reduced(
    mechanism: Mechanism,
    joints: Sequence[str] | None = None,
    *,
    locked: Mapping[str, float] | None = None,
    base: str | None = None,
    tip: str | Sequence[str] | None = None,
    gravity: ArrayLike | None = None,
    limits: Mapping[str, Limits] | None = None,
    closing: Closing | None = None,
    snap: bool = True,
) -> tuple[Robot, tuple[str, ...]]:
    """The robot in which `joints` move and all others are locked; and notes on what was assumed.

    Locked and fixed links merge with their inertia into the moving link that carries them; what
    is fixed to the base vanishes. A mimic joint moves with its master, which keeps within the
    limits of both, or is locked where a locked master puts it. Joints neither moving nor in
    `locked` are locked at zero, or at the limit nearest to it.

    Args:
        mechanism: What the model file says.
        joints: Names in the order of the log. `None`: every joint between base and tip that is
            neither fixed, nor mimic, nor locked, in tree order.
        locked: Positions of locked joints [rad; m].
        base: The link taken as fixed base; `None` is the root link. `"floating"`: the link that
            floats with joints beyond it, or the root link, as floating base.
        tip: The link, or links, where the moving chain ends; `None` is every leaf.
        gravity: Shape `(3,)` [m/s²], in the base link's frame, or the world's if it floats; `None`
            is the mechanism's own.
        limits: Limits by joint that replace the file's, and its mimic joints' where they differ.
        closing: What the robot file says of closed chains. Passive joints move like those to
            identify, and are listed apart from them.
        snap: Whether entries of rotations and axes below `DIRT` are rounding errors of the file.
    """
    if snap:
        mechanism = replace(mechanism, joints=[joint.snapped() for joint in mechanism.joints])
    floating = base == FLOATING and all(link.name != FLOATING for link in mechanism.links)
    base = floating_link(mechanism) if floating else base
    tips = [] if tip is None else [tip] if isinstance(tip, str) else list(tip)
    _check_links(mechanism, mechanism.root if base is None else base, tips)
    mechanism, locked, left_out = without_free_joints(
        mechanism, base, joints, locked or {}, floating
    )
    limits, closing = dict(limits or {}), closing or Closing()
    base = mechanism.root if base is None else base
    free = _moving(mechanism, None, locked, base, tips)
    passive = passive_joints(mechanism, free, joints, closing)
    if both := [name for name in joints or () if name in passive]:
        raise ModelError(
            f"joint '{both[0]}' is to be identified, and passive at once",
            where=closing.where,
            fix="list each joint of a loop under joints if it is logged, else under passive",
        )
    active = [n for n in free if n not in passive] if joints is None else joints
    moving = _moving(mechanism, [*active, *passive], locked, base, tips)
    refuse_coupled(mechanism, moving)
    assumed = {
        j.name: float(np.clip(0.0, j.limits.lower, j.limits.upper))
        for j in mechanism.movable
        if j.name not in (*moving, *locked)
    }
    positions = {**locked, **assumed}
    resting = {
        name: drive.ratio * positions[drive.master] + drive.offset
        for name, drive in mechanism.drives.items()
        if drive.master in positions
    }
    before = BASE_COORDINATES if floating else ()
    if clash := {c.name for c in before} & set(moving):
        raise ModelError(
            f"joint '{min(clash)}' has the name of a coordinate of the floating base",
            where=mechanism.where,
            fix="give it another name",
        )
    places = {name: k for k, name in enumerate(moving, start=len(before))}
    bodies, frames = _merged_bodies(mechanism, places, resting, base, floating)
    _refuse_overflow(mechanism, bodies, frames)
    in_root = Placement()
    for joint in () if floating else mechanism.to_link(base):
        in_root = in_root @ joint.at(resting.get(joint.name, 0.0))
    root_gravity = in_root.rotation.T @ mechanism.gravity
    coordinates = tuple(_coordinate(mechanism, n, limits.get(n)) for n in moving)
    robot = Robot(
        mechanism.name,
        bodies,
        (*before, *coordinates[: len(active)]),
        root_gravity if gravity is None else frozen(gravity),
        passive=coordinates[len(active) :],
        frames=frames,
    )
    robot, closed = closed_robot(robot, mechanism, closing)
    notes = reduction_notes(mechanism, robot, base, assumed)
    return robot, (*left_out, *notes, *closed)


def _refuse_overflow(mechanism: Mechanism, bodies: Sequence[Body], frames: Sequence[Frame]) -> None:
    """Raise `ModelError` where numbers, each finite, are so large that placing them overflows."""
    numbers = [(body.name, [*body.inertia.ten, *body.position]) for body in bodies]
    numbers += [(frame.name, frame.position.tolist()) for frame in frames]
    for name, values in numbers:
        if not np.isfinite(values).all():
            raise ModelError(
                f"the numbers of link '{name}' are too large to compute with",
                where=f"link '{name}' of robot '{mechanism.name}'",
                fix="check the exponents of its inertial and of the origins up to it",
            )


def _check_links(mechanism: Mechanism, base: str, tips: Sequence[str]) -> None:
    links = [link.name for link in mechanism.links]
    below = {base, *(j.child for j in mechanism.from_link(base))}
    refuse_unknown(base, links, f"the base link '{base}' does not exist", mechanism.where, "links")
    for name in tips:
        if name not in below:
            raise ModelError(
                f"the tip link '{name}' is not beyond the base link '{base}'",
                where=mechanism.where,
                fix="choose a tip beyond the base, or another base",
            )


def _check_joints(mechanism: Mechanism, names: Sequence[str]) -> None:
    """Each name is a joint that moves on its own."""
    known = {j.name: j for j in mechanism.joints}
    for name in names:
        joint = known.get(name)
        if joint is not None and joint.movable and joint.mimic is None:
            continue
        if joint is None:
            wrong = f"joint '{name}' is to be identified, but the model has no such joint"
        elif joint.mimic is not None:
            wrong = f"joint '{name}' cannot be identified: it follows joint '{joint.mimic.master}'"
        else:
            wrong = f"joint '{name}' cannot be identified: it is fixed in the model"
        movable, what = [j.name for j in mechanism.movable], "joints that move on their own"
        raise ModelError(
            wrong,
            where=joint.where if joint else mechanism.where,
            fix=listing(movable, what) if joint else advice(name, movable, what),
        )


def _moving(
    mechanism: Mechanism,
    joints: Sequence[str] | None,
    locked: Mapping[str, float],
    base: str,
    tips: Sequence[str],
) -> tuple[str, ...]:
    """Names of the joints that are identified, in the order of the coordinates."""
    inside = mechanism.from_link(base)
    if tips:
        chain = {j.name for t in tips for j in mechanism.to_link(t)}
        inside = tuple(j for j in inside if j.name in chain)
    free = [j.name for j in inside if j.movable and j.mimic is None]
    if joints is None:
        joints = [name for name in free if name not in locked]
    _check_joints(mechanism, joints)
    for name in joints:
        if name not in free:
            raise ModelError(
                f"joint '{name}' is to be identified but is not between base and tip",
                where=mechanism.where,
                fix="list joints between base and tip only",
            )
    if not joints:
        raise ModelError(
            "no joint is left to identify",
            where=mechanism.where,
            fix="leave at least one revolute, continuous or prismatic joint unlocked",
        )
    return tuple(joints)


def _coordinate(mechanism: Mechanism, name: str, given: Limits | None) -> Coordinate:
    """A joint that moves, within its limits and those of the joints that follow it."""
    joint = mechanism.joint(name)
    narrow, _ = narrowed(mechanism, name)
    limits = narrow if given is None else merged(given, joint.limits, narrow)
    return Coordinate(name, _kind(joint), unlimited_if_empty(limits))


def _kind(joint: Joint) -> JointKind:
    return "prismatic" if joint.kind == "prismatic" else "revolute"


def _merged_bodies(
    mechanism: Mechanism,
    places: Mapping[str, int],
    resting: Mapping[str, float],
    base: str,
    floating: bool,
) -> tuple[tuple[Body, ...], tuple[Frame, ...]]:
    """The moving bodies, what rests merged into them, and where all links are.

    `places` are the numbers of the joints' coordinates. The base is a body if it floats.
    """
    links = {link.name: link for link in mechanism.links}
    bodies: list[Body] = []
    carriers = {base: (-1, Placement())}
    if floating:
        still = Placement()
        turn, place, axis = still.rotation, still.position, frozen((0.0, 0.0, 1.0))
        own = Body(base, FLOATING, FLOATING, -1, turn, place, axis, 0, massless=True)
        bodies.append(_joined(own, links[base], still))
        carriers[base] = (0, still)
    for joint in mechanism.from_link(base):
        index, placement = carriers[joint.parent]
        if joint.movable and joint.name not in resting:
            placed = placement @ joint.placement
            drive = mechanism.drives[joint.name]
            bodies.append(
                Body(
                    joint.child,
                    joint.name,
                    _kind(joint),
                    index,
                    placed.rotation,
                    placed.position,
                    joint.axis,
                    places[drive.master],
                    drive.ratio,
                    drive.offset,
                    massless=True,
                )
            )
            index, placement = len(bodies) - 1, Placement()
        else:
            placement = placement @ joint.at(resting.get(joint.name, 0.0))
        carriers[joint.child] = (index, placement)
        if index >= 0:
            bodies[index] = _joined(bodies[index], links[joint.child], placement, joint.name)
    frames = (Frame(n, k, p.rotation, p.position) for n, (k, p) in carriers.items())
    return tuple(bodies), tuple(frames)


def _joined(body: Body, link: Link, placement: Placement, joint: str = "") -> Body:
    """The body with a link that is fixed to it, behind a joint."""
    massless, inertia = link.massless, body.inertia
    if link.inertia is not None:
        # files of `export` give a frame without mass the least inertia
        frame = link.name.endswith(f"/{joint}") and link.inertia.mass <= LEAST_INERTIA
        own = Inertia.zero() if frame else link.inertia
        massless = massless or frame
        inertia = inertia + own.moved(placement.rotation, placement.position)
    return replace(
        body,
        massless=body.massless and massless,
        inertia=inertia,
        known=body.known or link.inertia is not None,
    )
