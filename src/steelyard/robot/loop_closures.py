"""Pins that close a mechanism's chains: which joints follow from them, and where they close."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from steelyard.arrays import Array
from steelyard.errors import ModelError
from steelyard.robot.loop_equations import CLOSED, checked_equations
from steelyard.robot.mechanism import Mechanism
from steelyard.robot.robot import Coordinate, Frame, Loop, OpenLoops, Robot
from steelyard.robot.ties import Pin
from steelyard.suggest import advice


@dataclass(frozen=True)
class Closing:
    """What a robot file says of closed chains, beside what the model file says.

    Attributes:
        pins: More pins.
        passive: Names of the joints that the loops determine; `None` if not given.
        assembly: Positions of joints near which the loops close [rad; m].
        open_loops: What to do where measured positions cannot close a loop.
        where: For messages.
    """

    pins: tuple[Pin, ...] = ()
    passive: tuple[str, ...] | None = None
    assembly: Mapping[str, float] = field(default_factory=dict)
    open_loops: OpenLoops = "stop"
    where: str = "the mechanism"


def passive_joints(
    mechanism: Mechanism,
    masters: Mapping[str, str],
    free: Sequence[str],
    joints: Sequence[str] | None,
    closing: Closing,
) -> tuple[str, ...]:
    """Names of the joints that the loops determine.

    If nobody says which: those of the loops' joints that are not to be identified, or that no
    actuator drives.

    Args:
        mechanism: The mechanism.
        masters: By joint, the joint that it follows, or itself.
        free: Joints that could move.
        joints: Those to be identified; `None` if not given.
        closing: What the robot file says.

    Raises:
        ModelError: Nothing says which.
    """
    pins = (*mechanism.pins, *closing.pins)
    if not pins:
        _refuse_without_loops(closing)
        return ()
    if closing.passive is not None:
        return closing.passive
    round_trip = {masters[j] for pin in pins for j in between(mechanism, pin)}
    candidates = [name for name in free if name in round_trip]
    active = mechanism.driven if joints is None else joints
    if candidates and not set(active) & set(free):
        raise ModelError(
            f"of the loop joints {', '.join(candidates)} the passive ones are not given",
            where=pins[0].where,
            fix="name them in a robot file: [robot] passive = [...]",
        )
    return tuple(name for name in candidates if name not in active)


def _refuse_without_loops(closing: Closing) -> None:
    if closing.passive or closing.assembly:
        raise ModelError(
            "passive joints or a reference configuration are given, but the robot has no loops",
            where=closing.where,
            fix="add [[robot.loops]] with links and points, or remove them",
        )


def between(mechanism: Mechanism, pin: Pin) -> set[str]:
    """Joints that move one end of a pin and not the other."""
    first, second = ({j.name for j in mechanism.to_link(link) if j.movable} for link in pin.links)
    return first ^ second


def closed_robot(
    robot: Robot, mechanism: Mechanism, closing: Closing
) -> tuple[Robot, tuple[str, ...]]:
    """The robot with its loops, assembled where they close.

    Pins between links that do not move against each other are checked and left out.

    Returns:
        The robot, and a note on where its passive joints are.

    Raises:
        ModelError: The loops do not close, or do not determine the passive joints.
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
    start = [
        closing.assembly.get(c.name, mechanism.rest.get(c.name, _near_zero(c)))
        for c in robot.joints
    ]
    robot = robot.changed(loops=tuple(loops), assembly=start, open_loops=closing.open_loops)
    assembly = checked_equations(robot, places).assembly
    _check_assembly(robot, closing)
    return robot.changed(assembly=assembly), _note(robot, assembly, closing)


def _loop(pin: Pin, frames: Mapping[str, Frame]) -> Loop:
    """The pin between bodies, from the pin between links."""
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
    return Loop(pin.name, (bodies[0], bodies[1]), np.array(points))


def _near_zero(coordinate: Coordinate) -> float:
    return float(np.clip(0.0, coordinate.limits.lower, coordinate.limits.upper))


def _check_assembly(robot: Robot, closing: Closing) -> None:
    names = [c.name for c in robot.joints]
    for name in closing.assembly:
        if name not in names:
            raise ModelError(
                f"the reference configuration gives a position of joint '{name}', which is not "
                "identified or passive",
                where=closing.where,
                fix=advice(name, names, "joints that move"),
            )


def _note(robot: Robot, assembly: Array, closing: Closing) -> tuple[str, ...]:
    """Where the loops were closed, if that was not given already."""
    given = closing.assembly
    at = dict(zip([c.name for c in robot.joints], assembly.tolist(), strict=True))
    if all(abs(given.get(c.name, np.inf) - at[c.name]) < 1e-3 for c in robot.passive):
        return ()
    places = ", ".join(f"{c.name} at {at[c.name]:.4g} {c.unit}" for c in robot.joints)
    return (f"the loops are closed in the reference configuration, with {places}",)
