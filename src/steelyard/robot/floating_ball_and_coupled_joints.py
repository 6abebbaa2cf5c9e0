"""Joints that are not coordinates of a robot: floating, ball and coupled joints.

Each joint of a robot has one degree of freedom. A floating body with joints beyond it is a robot
once it is the base, at rest or floating; one without is a loose object.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

from steelyard.base.errors import ModelError, OpenModelError
from steelyard.robot.mechanism import Joint, Listed, Mechanism
from steelyard.robot.robot import FLOATING


def floating_trees(mechanism: Mechanism, base: str) -> dict[Joint, int]:
    """The floating joints next to a link, each with the count of joints that move beyond it."""
    trees = dict[Joint, int]()
    for joint in mechanism.from_link(base):
        if joint.kind in ("floating", "planar"):
            before = mechanism.to_link(joint.parent)
            if not any(tree in before for tree in trees):
                trees[joint] = _moving(mechanism.from_link(joint.child))
    return trees


def carried_joints(mechanism: Mechanism, base: str) -> int:
    """How many joints move on their own beyond a link, floating trees left out."""
    return _moving(mechanism.from_link(base)) - sum(floating_trees(mechanism, base).values())


def floating_base(mechanism: Mechanism, base: str | None) -> Joint | None:
    """The floating joint before a base, which is taken to be at rest; `None` if there is none."""
    before = mechanism.to_link(mechanism.root if base is None else base)
    floating = [joint for joint in before if joint.kind in ("floating", "planar")]
    return floating[-1] if floating else None


def floating_link(mechanism: Mechanism) -> str:
    """The base of a floating robot: the link that floats with joints beyond it, or the root.

    It is a `ModelError` if several do.
    """
    trees = floating_trees(mechanism, mechanism.root)
    robots = [joint for joint, count in trees.items() if count]
    if len(robots) > 1:
        raise ModelError(
            "several robots float: " + ", ".join(joint.child for joint in robots),
            where=mechanism.where,
            fix="leave one of them in the model file",
        )
    return robots[0].child if robots else mechanism.root


def without_free_joints(
    mechanism: Mechanism,
    base: str | None,
    joints: Sequence[str] | None,
    locked: Mapping[str, float],
    floating: bool = False,
) -> tuple[Mechanism, dict[str, float], tuple[str, ...]]:
    """The mechanism without free joints beyond the base, what stays locked, and notes on it.

    Loose bodies are left out, and what floats beside a base that is given. Ball joints stay if they
    are locked, or others listed. A base that is not `floating` is assumed to be at rest.
    """
    root = mechanism.root if base is None else base
    trees = floating_trees(mechanism, root)
    if base is None and any(trees.values()):
        raise _floats(mechanism, trees)
    kept, notes = mechanism, list(mechanism.notes)
    if joint := floating_base(mechanism, base):
        rests = f"base '{root}' is assumed to be at rest, in the orientation of the model file"
        if not floating:
            notes.append(Listed(rests, f"the {_word(joint)} joint of '{joint.child}' is left out"))
        others = floating_trees(mechanism, mechanism.root)
        trees = trees | {j: n for j, n in others.items() if j not in mechanism.to_link(root)}
        kept = _without(mechanism, trees, root)
    if trees:
        names = ", ".join(tree.child for tree in trees)
        notes.append(Listed("left out, as it is not part of the robot", names))
        kept = _without(mechanism, trees, root)
    beyond = kept.from_link(root)
    aside = [joint.name for joint in kept.joints if joint.movable and joint not in beyond]
    if aside and joints is None:
        notes.append(
            Listed(f"left out, as the base '{root}' does not carry them", ", ".join(aside))
        )
    balls = [joint for joint in beyond if joint.kind == "ball"]
    _check_balls(balls, joints, locked)
    if assumed := [ball.name for ball in balls if ball.name not in locked]:
        ball_joints = f"ball joint {', '.join(assumed)}"
        notes.append(Listed("locked at its position in the model file", ball_joints))
    fixed = {ball.name for ball in balls}
    return kept, {n: x for n, x in locked.items() if n not in fixed}, tuple(notes)


def _moving(joints: Collection[Joint]) -> int:
    return sum(joint.movable and joint.mimic is None for joint in joints)


def _word(joint: Joint) -> str:
    return "free" if joint.kind == "floating" else joint.kind


def _floats(mechanism: Mechanism, trees: Mapping[Joint, int]) -> ModelError:
    most = max(trees, key=lambda joint: trees[joint])
    choices = {joint.child: count for joint, count in trees.items() if count}
    if fixed := carried_joints(mechanism, mechanism.root):
        choices = {mechanism.root: fixed} | choices
    listed = " or ".join(f'base = "{name}" ({count} joints)' for name, count in choices.items())
    return OpenModelError(
        f"link '{most.child}' floats: its joint '{most.name}' is a {_word(most)} joint, and a "
        "base at rest is needed",
        where=most.where,
        fix=f"say which link is fixed to the world: {listed} under [robot] in a robot file, "
        f"as `steelyard init` writes it, or --fixed-base {most.child} on the command line; or that "
        f'none is: base = "{FLOATING}"',
    )


def _check_balls(
    balls: Sequence[Joint], joints: Sequence[str] | None, locked: Mapping[str, float]
) -> None:
    for ball in balls:
        if locked.get(ball.name, 0.0) != 0.0:
            raise ModelError(
                f"ball joint '{ball.name}' is locked at {locked[ball.name]:g}, but has no such "
                "position",
                where=ball.where,
                fix=f"write {ball.name} = 0.0: it is locked at its position in the model file",
            )
        if ball.name not in locked and joints is None:
            raise OpenModelError(
                f"joint '{ball.name}' is a ball joint, which has three degrees of freedom",
                where=ball.where,
                fix=f"lock it at its position in the model file: {ball.name} = 0.0 under "
                "[robot.locked] in a robot file, as `steelyard init` writes it",
            )


def _without(mechanism: Mechanism, trees: Collection[Joint], base: str) -> Mechanism:
    """The mechanism without what hangs on some joints, and without pins beside the robot."""
    gone = {*trees, *(j for tree in trees for j in mechanism.from_link(tree.child))}
    links, names = {joint.child for joint in gone}, {joint.name for joint in gone}
    robot = {base, *(joint.child for joint in mechanism.from_link(base))}
    couplings = (
        replace(c, joints=tuple(n for n in c.joints if n not in names)) for c in mechanism.couplings
    )
    return replace(
        mechanism,
        links=[link for link in mechanism.links if link.name not in links],
        joints=[joint for joint in mechanism.joints if joint not in gone],
        pins=[pin for pin in mechanism.pins if not links & {*pin.links} and robot & {*pin.links}],
        driven=[name for name in mechanism.driven if name not in names],
        pulled=[name for name in mechanism.pulled if name not in names],
        rest={name: x for name, x in mechanism.rest.items() if name not in names},
        couplings=[coupling for coupling in couplings if coupling.joints],
    )


def refuse_coupled(mechanism: Mechanism, moving: Collection[str]) -> None:
    """Raise if one of the joints that move, or of their masters, is tied by a coupling."""
    for coupling in mechanism.couplings:
        drives = [mechanism.drives[name] for name in coupling.joints if name in mechanism.drives]
        tied = dict.fromkeys(drive.master for drive in drives)
        if not any(name in moving for name in tied):
            continue
        lines = ", ".join(f"{name} = {mechanism.rest.get(name, 0.0):.6g}" for name in tied)
        raise OpenModelError(
            f"joints are tied by {coupling.what}, which is not supported: "
            + ", ".join(coupling.joints),
            where=coupling.where,
            fix=f"lock them: {lines} under [robot.locked] in a robot file, as `steelyard init` "
            "writes it",
        )
