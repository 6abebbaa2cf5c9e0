"""Statements of a model file that the robot ignores, unless the robot file replaces them."""

from collections.abc import Collection, Iterator

from steelyard.robot.links import Joint
from steelyard.robot.mechanism import Mechanism
from steelyard.robot.model_notes import Answer, JointSpring, ModelNote
from steelyard.robot.robot import Robot


def ignored_statements(
    mechanism: Mechanism, robot: Robot, answered: Collection[Answer], limited: Collection[str]
) -> dict[str, str]:
    """Statements of the model file that are ignored, and a line of each with all it is about.

    Args:
        mechanism: What the model file says.
        robot: Its robot; what is about joints that do not move is left out.
        answered: What the robot file says itself.
        limited: Joints whose limit of effort the robot file gives.
    """
    moving = {body.joint for body in robot.bodies}
    unlimited = set(robot.joint_names) - set(limited)
    lines: dict[str, list[str]] = {}
    for note in (*mechanism.statements, *_placeholders(mechanism), *_springs(mechanism)):
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


def _placeholders(mechanism: Mechanism) -> Iterator[ModelNote]:
    what = "placeholder effort limits are treated as unknown (state [robot.limits.JOINT] effort): "
    for joint in mechanism.joints:
        if joint.placeholder > 0.0:
            item = f"{joint.name} ({joint.placeholder:g} {_units(joint)[0]})"
            yield ModelNote(what, item, (joint.name,), "efforts")


def _springs(mechanism: Mechanism) -> Iterator[ModelNote]:
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
    """Units of effort and position."""
    return ("N", "m") if joint.kind == "prismatic" else ("Nm", "rad")
