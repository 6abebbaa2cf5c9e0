"""What a model file leaves open: the base of a floating robot, and joints to be locked."""

from dataclasses import dataclass, field, replace
from pathlib import Path

from steelyard.base.errors import ModelError
from steelyard.robot.file.model_reading_and_loaded_robot import (
    LoadedRobot,
    ModelFile,
    read_model,
    robot_of_model,
)
from steelyard.robot.free_coupled_and_mimic_joints import carried_joints, drive_of, floating_trees
from steelyard.robot.init.column_names import like_finger
from steelyard.robot.loop_closures import between
from steelyard.robot.mechanism import Mechanism
from steelyard.robot.models.xacro import split_reference


@dataclass(frozen=True, eq=False)
class Proposal:
    """A robot as `steelyard init` proposes it, with a base, its root if `None`, and why that one.

    `locked` are positions of joints that have to be locked [rad; m]; `reasons` why.
    """

    loaded: LoadedRobot
    base: str | None
    why_base: str = ""
    locked: dict[str, float] = field(default_factory=dict)
    reasons: dict[str, str] = field(default_factory=dict)

    @property
    def notes(self) -> tuple[str, ...]:
        """What was decided, one sentence each."""
        base = [f'base = "{self.base}": {self.why_base}'] if self.why_base else []
        return (*base, *(f"locked {words}" for words in _by_reason(self.reasons)))


def proposed(reference: str | Path, base: str | None = None) -> Proposal:
    """The robot of a model file, with a base and locked joints where the file leaves none.

    The floating body with most joints becomes the base. Ball joints are locked, joints of
    couplings, and loops of hands; of other loops those that make none of the joints passive.
    """
    path, arguments = split_reference(reference)
    if path.suffix.lower() == ".toml":
        raise ModelError(
            "this is already a robot file", where=str(path), fix="give its URDF or MJCF"
        )
    model = read_model(path, arguments)
    mechanism, why_base = model.mechanism, ""
    if base is None:
        base, why_base = _base(mechanism)
    tied, reasons = _tied(mechanism, base)
    groups = _loop_groups(mechanism, base)
    hands = [
        group
        for group in groups
        if any(map(like_finger, group)) or not {*group} & {*mechanism.driven}
    ]
    refused: ModelError | None = None
    for source, loops, reason in (
        (model, hands, _HAND),
        (model, groups, _OPEN),
        (_with_tendons(model), [], ""),
    ):
        rests = {n: mechanism.rest.get(n, 0.0) for group in loops for n in group}
        try:
            loaded = robot_of_model(source, base=base, locked=rests | tied)
        except ModelError as error:
            refused = error
            continue
        why_locked = dict.fromkeys(rests, reason) | reasons
        return Proposal(loaded, base, why_base, rests | tied, why_locked)
    raise _all_locked(mechanism, base, reasons, hands) or refused or AssertionError


_BALL = "a ball joint"
_HAND = "in a loop of a hand, or in one whose joints have no actuator of their own"
_OPEN = "in a loop whose passive joints are ambiguous"


def _with_tendons(model: ModelFile) -> ModelFile:
    """The model with the tendons of its actuators as drives: a hand alone may have no others."""
    mechanism = model.mechanism
    masters = [drive_of(mechanism, mechanism.joint(name)).master for name in mechanism.pulled]
    driven = dict.fromkeys((*mechanism.driven, *masters))
    return replace(model, mechanism=mechanism.changed(driven=[*driven]))


def _all_locked(
    mechanism: Mechanism, base: str | None, reasons: dict[str, str], hands: list[list[str]]
) -> ModelError | None:
    """The refusal of a hand alone; `None` if joints are left beside what is locked."""
    locked = dict.fromkeys((name for group in hands for name in group), _HAND) | reasons
    beyond = mechanism.from_link(mechanism.root if base is None else base)
    left = {drive_of(mechanism, j).master for j in beyond if j.movable} - {*locked}
    if left or not locked:
        return None
    return ModelError(
        "every joint would have to be locked: " + "; ".join(_by_reason(locked)),
        where=mechanism.where,
        fix="give the robot that carries this hand; or write a robot file by hand, with the "
        "joints that are logged under joints and those that loops determine under passive"
        if {*locked.values()} != {_BALL}
        else "give a model with a joint of one degree of freedom",
    )


def _by_reason(reasons: dict[str, str]) -> list[str]:
    """Joints and the reason that they share, in words."""
    joints: dict[str, list[str]] = {}
    for joint, reason in reasons.items():
        joints.setdefault(reason, []).append(joint)
    return [f"{', '.join(names)} ({reason})" for reason, names in joints.items()]


def _base(mechanism: Mechanism) -> tuple[str | None, str]:
    """The link that most joints hang on, and why; none if that is the root."""
    counts = {j.child: n for j, n in floating_trees(mechanism, mechanism.root).items() if n}
    fixed = carried_joints(mechanism, mechanism.root)
    if not counts:
        return None, ""
    best = max(counts, key=lambda link: counts[link])
    if fixed > counts[best]:
        return mechanism.root, f"{fixed} joints move beyond it, and {counts[best]} beyond {best}"
    others = {mechanism.root: fixed} if fixed else {}
    others |= {link: n for link, n in counts.items() if link != best}
    if not others:
        return best, "the one link that floats and has joints beyond it"
    other_counts = ", ".join(f"{n} beyond {link}" for link, n in others.items())
    return best, f"{counts[best]} joints move beyond it, and {other_counts}"


def _tied(mechanism: Mechanism, base: str | None) -> tuple[dict[str, float], dict[str, str]]:
    """Positions of ball joints and of joints of couplings beyond the base, and why."""
    locked, reasons = dict[str, float](), dict[str, str]()
    beyond = mechanism.from_link(mechanism.root if base is None else base)
    floating = floating_trees(mechanism, mechanism.root if base is None else base)
    loose = {j.name for tree in floating for j in mechanism.from_link(tree.child)}
    names = {joint.name for joint in beyond if joint.name not in loose}
    for ball in (j.name for j in beyond if j.kind == "ball" and j.name in names):
        locked[ball], reasons[ball] = 0.0, _BALL
    for coupling in mechanism.couplings:
        for name in coupling.joints:
            master = drive_of(mechanism, mechanism.joint(name)).master
            if master in names:
                locked[master] = mechanism.rest.get(master, 0.0)
                reasons[master] = f"tied by {coupling.what}"
    return locked, reasons


def _loop_groups(mechanism: Mechanism, base: str | None) -> list[list[str]]:
    """Joints of the loops beyond the base, those of loops that share some together."""
    beyond = mechanism.from_link(mechanism.root if base is None else base)
    order = [joint.name for joint in beyond]
    groups: list[set[str]] = []
    for pin in mechanism.pins:
        own = {drive_of(mechanism, mechanism.joint(n)).master for n in between(mechanism, pin)}
        shared = [group for group in groups if group & own]
        groups = [group for group in groups if group not in shared]
        groups.append(own.union(*shared) & {*order})
    return [sorted(group, key=order.index) for group in groups if group]
