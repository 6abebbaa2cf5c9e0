"""From a mechanism to a robot: which joints move, where the others are locked, what merges."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from steelyard.errors import ModelError
from steelyard.robot.couplings import refuse_coupled
from steelyard.robot.free_joints import without_free_joints
from steelyard.robot.from_mechanism_notes import reduction_notes
from steelyard.robot.geometry import Placement
from steelyard.robot.inertia import LEAST, Inertia
from steelyard.robot.links import Joint, Link
from steelyard.robot.loop_closures import Closing, closed_robot, passive_joints
from steelyard.robot.mechanism import Mechanism
from steelyard.robot.mimic import (
    Drive,
    drive_of,
    followers_of,
    merged,
    narrowed,
    unlimited_if_empty,
)
from steelyard.robot.robot import Body, Coordinate, Frame, JointKind, Limits, Robot
from steelyard.suggest import advice, listing


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
    """The robot in which `joints` move and all others are locked.

    Locked and fixed links merge with their inertia into the moving link that carries them; what
    is fixed to the base vanishes. A mimic joint moves with its master, which keeps within the
    limits of both, or is locked where a locked master puts it. Joints neither moving nor in
    `locked` are locked at zero, or at the limit nearest to it.

    Args:
        mechanism: What the model file says.
        joints: Names in the order of the log. `None`: every joint between base and tip that is
            neither fixed, nor mimic, nor locked, in tree order.
        locked: Positions of locked joints [rad; m].
        base: The link taken as fixed base; `None` is the root link.
        tip: The link, or links, where the moving chain ends; `None` is every leaf.
        gravity: Shape `(3,)` [m/s²], in the base link's frame; `None` is the mechanism's own.
        limits: Limits by joint that replace the file's, and its mimic joints' where they differ.
        closing: What the robot file says of closed chains. Passive joints move like those to
            identify, and are listed apart from them.
        snap: Whether entries of rotations and axes below `DIRT` are rounding errors of the file.

    Returns:
        The robot, and notes for the user on what was assumed.

    Raises:
        ModelError: A name is none of the mechanism's, a robot floats without a base, or a joint
            moves that a coupling, or a ball joint, forbids.
    """
    mechanism = mechanism.snapped() if snap else mechanism
    _check_links(mechanism, mechanism.root if base is None else base, tip)
    free_less = without_free_joints(mechanism, base, joints, locked or {})
    mechanism, locked = free_less.mechanism, dict(free_less.locked)
    limits, closing = dict(limits or {}), closing or Closing()
    base = mechanism.root if base is None else base
    drives = {j.name: drive_of(mechanism, j) for j in mechanism.joints if j.movable}
    free = _moving(mechanism, None, locked, base, tip)
    masters = {name: drive.master for name, drive in drives.items()}
    passive = passive_joints(mechanism, masters, free, joints, closing)
    _refuse_both(joints, passive, closing.where)
    active = [n for n in free if n not in passive] if joints is None else joints
    moving = _moving(mechanism, [*active, *passive], locked, base, tip)
    refuse_coupled(mechanism, masters, moving)
    _check_joints(mechanism, [*locked], "locked")
    _check_joints(mechanism, [*limits], "given limits")
    positions, assumed = _locked_positions(mechanism, moving, locked)
    resting = {
        name: drive.ratio * positions[drive.master] + drive.offset
        for name, drive in drives.items()
        if drive.master in positions
    }
    bodies, frames = _Merging(mechanism, drives, moving, resting).run(base)
    root_gravity = _base_placement(mechanism, base, resting).rotation.T @ mechanism.gravity
    coordinates = tuple(_coordinate(mechanism, drives, n, limits.get(n)) for n in moving)
    robot = Robot(
        mechanism.name,
        bodies,
        coordinates[: len(active)],
        root_gravity if gravity is None else gravity,
        passive=coordinates[len(active) :],
        frames=frames,
    )
    robot, closed = closed_robot(robot, mechanism, closing)
    notes = reduction_notes(mechanism, drives, robot, base, assumed, positions)
    return robot, (*free_less.notes, *notes, *closed)


def _refuse_both(joints: Sequence[str] | None, passive: Sequence[str], where: str) -> None:
    """A joint is identified or passive."""
    both = [name for name in joints or () if name in passive]
    if both:
        raise ModelError(
            f"joint '{both[0]}' is to be identified, and passive at once",
            where=where,
            fix="list each joint of a loop under joints if it is logged, else under passive",
        )


def _check_links(mechanism: Mechanism, base: str, tip: str | Sequence[str] | None) -> None:
    links = [link.name for link in mechanism.links]
    below = {base, *(j.child for j in mechanism.from_link(base))}
    for role, name in [("base", base)] + [("tip", t) for t in _tips(tip)]:
        if name not in links:
            raise ModelError(
                f"the {role} link '{name}' does not exist",
                where=mechanism.where,
                fix=advice(name, links, "links"),
            )
        if name not in below:
            raise ModelError(
                f"the tip link '{name}' is not beyond the base link '{base}'",
                where=mechanism.where,
                fix="choose a tip beyond the base, or another base",
            )


def _tips(tip: str | Sequence[str] | None) -> list[str]:
    return [] if tip is None else [tip] if isinstance(tip, str) else list(tip)


def _check_joints(mechanism: Mechanism, names: Sequence[str], use: str) -> None:
    """Each name is a joint that moves on its own."""
    known = {j.name: j for j in mechanism.joints}
    for name in names:
        joint = known.get(name)
        if joint is not None and joint.movable and joint.mimic is None:
            continue
        if joint is None:
            wrong = f"joint '{name}' is to be {use}, but the model has no such joint"
        elif joint.mimic is not None:
            wrong = f"joint '{name}' cannot be {use}: it follows joint '{joint.mimic.master}'"
        else:
            wrong = f"joint '{name}' cannot be {use}: it is fixed in the model"
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
    tip: str | Sequence[str] | None,
) -> tuple[str, ...]:
    """Names of the joints that are identified, in the order of the coordinates."""
    inside = mechanism.from_link(base)
    if tips := _tips(tip):
        chain = {j.name for t in tips for j in mechanism.to_link(t)}
        inside = tuple(j for j in inside if j.name in chain)
    free = [j.name for j in inside if j.movable and j.mimic is None]
    if joints is None:
        joints = [name for name in free if name not in locked]
    _check_joints(mechanism, joints, "identified")
    for name in joints:
        if name in locked or joints.count(name) > 1 or name not in free:
            raise ModelError(
                f"joint '{name}' is to be identified but "
                + (
                    "also locked"
                    if name in locked
                    else "listed twice"
                    if joints.count(name) > 1
                    else "is not between base and tip"
                ),
                where=mechanism.where,
                fix="list every joint once, between base and tip, either as identified or locked",
            )
    if not joints:
        raise ModelError(
            "no joint is left to identify",
            where=mechanism.where,
            fix="leave at least one revolute, continuous or prismatic joint unlocked",
        )
    return tuple(joints)


def _locked_positions(
    mechanism: Mechanism, moving: tuple[str, ...], locked: Mapping[str, float]
) -> tuple[dict[str, float], tuple[str, ...]]:
    """Position of every independent joint that does not move, and which of them were assumed."""
    positions = dict(locked)
    assumed = [j for j in mechanism.movable if j.name not in moving and j.name not in locked]
    for joint in assumed:
        positions[joint.name] = float(np.clip(0.0, joint.limits.lower, joint.limits.upper))
    return positions, tuple(j.name for j in assumed)


def _base_placement(mechanism: Mechanism, base: str, resting: Mapping[str, float]) -> Placement:
    """The base link in the root link, all joints between them at rest."""
    placement = Placement()
    for joint in mechanism.to_link(base):
        placement = placement @ joint.at(resting.get(joint.name, 0.0))
    return placement


def _coordinate(
    mechanism: Mechanism, drives: Mapping[str, Drive], name: str, given: Limits | None
) -> Coordinate:
    """A joint that moves, within its limits and those of the joints that follow it."""
    joint = mechanism.joint(name)
    narrow, _ = narrowed(unlimited_if_empty(joint.limits), followers_of(mechanism, drives, name))
    limits = narrow if given is None else merged(given, joint.limits, narrow)
    return Coordinate(name, _kind(joint), unlimited_if_empty(limits))


def _kind(joint: Joint) -> JointKind:
    return "prismatic" if joint.kind == "prismatic" else "revolute"


@dataclass(frozen=True)
class _Merging:
    """One walk over the tree that merges what does not move into what carries it."""

    mechanism: Mechanism
    drives: Mapping[str, Drive]
    moving: tuple[str, ...]
    resting: Mapping[str, float]

    def run(self, base: str) -> tuple[tuple[Body, ...], tuple[Frame, ...]]:
        """The moving bodies beyond the base link, parents first, and where every link is."""
        links = {link.name: link for link in self.mechanism.links}
        bodies: list[dict[str, Any]] = []
        carriers = {base: (-1, Placement())}
        for joint in self.mechanism.from_link(base):
            index, placement = carriers[joint.parent]
            if joint.movable and joint.name not in self.resting:
                bodies.append(self._body(joint, index, placement @ joint.placement))
                index, placement = len(bodies) - 1, Placement()
            else:
                placement = placement @ joint.at(self.resting.get(joint.name, 0.0))
            carriers[joint.child] = (index, placement)
            if index >= 0:
                _add_link(bodies[index], _as_exported(links[joint.child], joint), placement)
        frames = (Frame(n, k, p.rotation, p.position) for n, (k, p) in carriers.items())
        return tuple(Body(**body) for body in bodies), tuple(frames)

    def _body(self, joint: Joint, parent: int, placement: Placement) -> dict[str, Any]:
        drive = self.drives[joint.name]
        return {
            "name": joint.child,
            "joint": joint.name,
            "kind": _kind(joint),
            "parent": parent,
            "rotation": placement.rotation,
            "position": placement.position,
            "axis": joint.axis,
            "coordinate": self.moving.index(drive.master),
            "ratio": drive.ratio,
            "offset": drive.offset,
            "inertia": Inertia.zero(),
            "known": False,
            "massless": True,
        }


def _as_exported(link: Link, joint: Joint) -> Link:
    """The link; a frame without mass where a file of `export` holds the least inertia for one."""
    named = link.name.endswith(f"/{joint.name}")
    if named and link.inertia is not None and link.inertia.mass <= LEAST:
        return replace(link, inertia=Inertia.zero(), massless=True)
    return link


def _add_link(body: dict[str, Any], link: Link, placement: Placement) -> None:
    body["massless"] = body["massless"] and link.massless
    if link.inertia is not None:
        moved = link.inertia.moved(placement.rotation, placement.position)
        body["inertia"] = body["inertia"] + moved
        body["known"] = True
