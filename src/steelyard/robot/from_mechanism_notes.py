"""What a robot made of a mechanism rests on, for the user."""

from collections.abc import Mapping

from steelyard.robot.mechanism import Mechanism
from steelyard.robot.mimic import Drive, limit_notes
from steelyard.robot.model_notes import Listed
from steelyard.robot.robot import Robot


def reduction_notes(
    mechanism: Mechanism,
    drives: Mapping[str, Drive],
    robot: Robot,
    base: str,
    assumed: tuple[str, ...],
    positions: Mapping[str, float],
) -> tuple[str, ...]:
    """What was assumed and matters to the robot's dynamics, one sentence each."""
    notes = list[str]()
    carried = {b.joint for b in robot.bodies}
    touched = {
        j.name
        for j in mechanism.from_link(base)
        if carried & {k.name for k in (*mechanism.to_link(j.child), *mechanism.from_link(j.child))}
    }
    if matter := [n for n in assumed if n in touched]:
        places = ", ".join(
            f"{n} at {positions[n]:.4g} {'m' if mechanism.joint(n).kind == 'prismatic' else 'rad'}"
            for n in matter
        )
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
        absent = "nominal mass is zero, as the mesh is missing"
        notes.append(Listed(absent, names + more))
    for body in robot.bodies:
        if flaw := body.inertia.flaw():
            notes.append(Listed(f"the inertial is not physically consistent: '{body.name}'", flaw))
    return (*notes, *limit_notes(mechanism, drives, robot))
