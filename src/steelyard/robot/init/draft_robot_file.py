"""The robot file that `steelyard init` writes, a comment on every key; its base, locked joints."""

import os
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from steelyard.base.arrays import by_key
from steelyard.base.errors import LogError, ModelError
from steelyard.robot.file import model_reading_and_loaded_robot as reading
from steelyard.robot.file.model_reading_and_loaded_robot import LoadedRobot, ModelFile
from steelyard.robot.file.sections import Side
from steelyard.robot.file.toml_edits import toml_key, toml_text
from steelyard.robot.floating_ball_and_coupled_joints import carried_joints, floating_trees
from steelyard.robot.init import draft_tables as tables
from steelyard.robot.init import guess_efforts_and_gears as efforts
from steelyard.robot.init.column_names import Column, by_name, finite, like_finger
from steelyard.robot.init.guess_columns import Guess, Sample, guess_columns
from steelyard.robot.init.guess_efforts_and_gears import Gears
from steelyard.robot.init.guess_targets import TargetGuess, guess_targets
from steelyard.robot.init.lerobot_calibration import Calibration
from steelyard.robot.loop_closures import between
from steelyard.robot.mechanism import Listed, Mechanism
from steelyard.robot.models.xacro import split_reference
from steelyard.robot.models.xml_and_urdf import read_xml
from steelyard.robot.robot import Coordinate, Robot


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
    model = reading.read_model(path, arguments)
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
            loaded = reading.robot_of_model(source, base=base, locked=rests | tied)
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
    masters = [mechanism.drives[name].master for name in mechanism.pulled]
    driven = dict.fromkeys((*mechanism.driven, *masters))
    return replace(model, mechanism=replace(mechanism, driven=[*driven]))


def _all_locked(
    mechanism: Mechanism, base: str | None, reasons: dict[str, str], hands: list[list[str]]
) -> ModelError | None:
    """The refusal of a hand alone; `None` if joints are left beside what is locked."""
    locked = dict.fromkeys((name for group in hands for name in group), _HAND) | reasons
    beyond = mechanism.from_link(base or mechanism.root)
    left = {mechanism.drives[j.name].master for j in beyond if j.movable} - {*locked}
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
    joints = by_key((reason, joint) for joint, reason in reasons.items())
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
    beyond = mechanism.from_link(base or mechanism.root)
    floating = floating_trees(mechanism, base or mechanism.root)
    loose = {j.name for tree in floating for j in mechanism.from_link(tree.child)}
    names = {joint.name for joint in beyond if joint.name not in loose}
    for ball in (j.name for j in beyond if j.kind == "ball" and j.name in names):
        locked[ball], reasons[ball] = 0.0, _BALL
    for coupling in mechanism.couplings:
        for name in coupling.joints:
            master = mechanism.drives[name].master
            if master in names:
                locked[master] = mechanism.rest.get(master, 0.0)
                reasons[master] = f"tied by {coupling.what}"
    return locked, reasons


def _loop_groups(mechanism: Mechanism, base: str | None) -> list[list[str]]:
    """Joints of the loops beyond the base, those of loops that share some together."""
    order = [joint.name for joint in mechanism.from_link(base or mechanism.root)]
    groups: list[set[str]] = []
    for pin in mechanism.pins:
        own = {mechanism.drives[name].master for name in between(mechanism, pin)}
        shared = [group for group in groups if group & own]
        groups = [group for group in groups if group not in shared]
        groups.append(own.union(*shared) & {*order})
    return [sorted(group, key=order.index) for group in groups if group]


_NOTHING = tables.Known()
FILL_IN = (
    "fill in [signals], which is commented out below the names of the log's columns, with a column "
    "in place of each ?, and remove the #"
)
GIVE_RATE = "give the sampling rate, --rate HZ: all other columns are recognised"


@dataclass(frozen=True, eq=False)
class Assignment:
    """Joints of a proposed robot and the columns of a log that they have.

    `columns` is `None` without a log; `free` are all joints but those of hands, `moving` those that
    are identified. Without a guess of the columns, `problem` says why, if there is a log; of a log
    without efforts there are `targets` in its place.
    """

    columns: tuple[str, ...] | None
    free: tuple[Coordinate, ...]
    moving: tuple[Coordinate, ...]
    guess: Guess | None = None
    problem: str = ""
    targets: TargetGuess | None = None


@dataclass(frozen=True)
class Draft:
    """A robot file that is proposed, and what it rests on."""

    text: str  # the robot file
    identified: tuple[str, ...]  # joints that it identifies
    hands: tuple[str, ...]  # joints that it locks because they are of a hand
    # joints that carry or are carried by identified ones, and are locked because the log has
    # no columns for them
    without_columns: tuple[str, ...]
    apart: tuple[str, ...]  # other joints without columns; their positions do not matter
    # what the log's columns seem to be; `None` without a log, or where they are unknown
    guess: Guess | None
    missing: tuple[tuple[str, str], ...]  # what the file lacks and what to do, one pair each
    unreadable: bool  # whether `load_robot` refuses the file until gear ratios are filled in
    targets: TargetGuess | None = None  # what a log without efforts seems to be

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why columns are taken for what they seem to be, one sentence each."""
        found = self.guess or self.targets
        doubt = self.targets.doubt if self.targets else ""
        return () if found is None else (*found.reasons, *([doubt] if doubt else []))


def assigned(
    proposal: Proposal,
    columns: Sequence[str] | None,
    sample: Sample | None,
    rate: float | None = None,
    geared: bool = False,
    side: Side | None = None,
    calibration: Calibration | None = None,
) -> Assignment:
    """Joints to identify, and the columns of a log, whose units some values tell.

    A `rate` [Hz] stands for a column of time; `geared` says that gear ratios are given,
    `side` that of the signals; a `calibration` is of targets and positions. It is a `LogError` if
    only the time is missing, and no rate given.
    """
    robot = proposal.loaded.robot
    hands = _hands(robot) - _logged(robot, columns or (), sample or {})
    hands |= {c.name for c in robot.coordinates if like_finger(c.name)}
    free = tuple(c for c in robot.coordinates if c.name not in hands) or robot.coordinates
    if columns is None:
        return Assignment(None, free, free)
    try:
        found = guess_columns(free, columns, sample, rate, geared, robot.coordinates, side)
        guess = _behind_the_gears(found, robot.name)
    except LogError as error:
        if rate is None:
            with suppress(LogError):
                guess_columns(free, columns, sample, 1.0, geared, robot.coordinates, side)
                error = LogError(error.wrong, where=error.where, fix=GIVE_RATE)
            if error.fix == GIVE_RATE:
                raise error from None
        arguments = (free, robot.coordinates, columns, sample or {}, rate, calibration)
        found_targets = guess_targets(*arguments)
        if found_targets is not None:
            moving = tuple(c for c in robot.coordinates if c.name in found_targets.joints)
            return Assignment(tuple(columns), moving, moving, None, "", found_targets)
        return Assignment(tuple(columns), free, free, None, error.wrong)
    return Assignment(tuple(columns), free, tuple(c for c in free if c.name in guess.joints), guess)


def _behind_the_gears(guess: Guess, robot: str) -> Guess:
    """The guess, with torques of a known robot as those of sensors on the link side."""
    name = efforts.link_side(robot, guess.joints)
    if not name or guess.section.effort.kind != "joint_torque":
        return guess
    stated = efforts.LINK_SIDE_TORQUE.format(name)
    reasons = (
        why.replace(efforts.TORQUE, stated).replace(efforts.UNSTATED, stated)
        for why in guess.reasons
    )
    return replace(tables.with_effort(guess, tables.Effort("link_torque")), reasons=tuple(reasons))


def drafted(
    proposal: Proposal, assignment: Assignment, output_path: Path, known: tables.Known = _NOTHING
) -> Draft:
    """A commented robot file; the model's path is given from where the text will be written.

    Joints of hands are locked, and so are joints that the log has no columns for. Where the
    columns of the log are unknown, `[signals]` is left as a comment that lists them; where gears
    are, `[robot.transmission]` is, and `load_robot` refuses the file until they are filled in.
    """
    robot, springs = proposal.loaded.robot, proposal.loaded.springs
    free, moving = assignment.free, assignment.moving
    springs = {c.name: springs[c.name] for c in moving if c.name in springs}
    guess = None if assignment.guess is None else tables.with_effort(assignment.guess, known.effort)
    gears = known.gears or (gears_of(proposal, moving, guess) if guess else None)
    text = tables.robot_file_text(
        **_robot_table(proposal, moving, output_path),
        **tables.gears_table(gears, moving),
        **tables.model_table(springs, guess, known),
        **tables.signals_table(guess, moving, known)
        if guess
        else tables.columns_table(assignment.columns, assignment.problem, moving),
        **tables.excitation_table(moving),
        guess=guess,
        targets=assignment.targets,
        known=known,
        motor_side=guess is not None and guess.motor_side,
    )
    without = [c.name for c in free if c not in moving]
    near = _near(robot, {c.name for c in moving})
    return Draft(
        text,
        tuple(c.name for c in moving),
        tuple(c.name for c in robot.coordinates if c not in free),
        tuple(name for name in without if name in near),
        tuple(name for name in without if name not in near),
        guess,
        tuple(_missing(assignment, guess, gears)),
        guess is not None and guess.motor_side and gears is None,
        assignment.targets,
    )


def gears_of(proposal: Proposal, moving: Sequence[Coordinate], guess: Guess) -> Gears | None:
    """Gears that the log or the model file contains; `None` where signals are not of motors."""
    if not guess.motor_side:
        return None
    model = read_xml(proposal.loaded.sources[0].path)
    return guess.gears or efforts.reductions(model, [c.name for c in moving])


def _missing(
    assignment: Assignment, guess: Guess | None, gears: Gears | None
) -> Iterator[tuple[str, str]]:
    """What the file lacks, and what to do."""
    if assignment.problem:
        yield assignment.problem, FILL_IN
    if guess is None:
        return
    if guess.motor_side and gears is None:
        what = "positions" if guess.section.coordinates == "motor" else "efforts"
        yield (
            f"the gear ratios are unknown, and {what} are of the motors",
            "remove this file and give them (data sheet): init MODEL LOG --ratios 100,-50,... and, "
            "if a motor turns with a second joint, --coupling MOTOR,JOINT,RATIO; or fill in ratios "
            "below [robot.transmission] and remove the # of both, and of coupling and the terms "
            "with motors. If joints are not at zero where motors are, --zeros, or position_offset",
        )
    for why in guess.contradictions:
        yield why, "correct the lines marked contradictory; `steelyard check` tests alternatives"


def _near(robot: Robot, moving: set[str]) -> set[str]:
    """Joints that carry a joint or are carried by one: their positions change its dynamics."""
    own = robot.joint_names
    names = [own[b.coordinate] if b.coordinate < len(own) else b.joint for b in robot.bodies]
    near: set[str] = set()
    for k in range(len(robot.bodies)):
        chain = {names[j] for j in robot.carriers(k)}
        near |= chain if chain & moving else set()
    return near


def notes_beside(bare: LoadedRobot, written: LoadedRobot) -> tuple[str, ...]:
    """Notes of a model file and of the robot file made from it, each statement once.

    A robot file repeats gravity and limits of the model, and so hides what they rest on. Of a
    statement with a list, the robot file's holds: it moves fewer joints.
    """
    ignored = {**bare.ignored, **written.ignored}
    assumed = {
        note.statement if isinstance(note, Listed) else note: note
        for loaded in (bare, written)
        for note in loaded.notes
        if note not in loaded.ignored.values()
    }
    return tuple(dict.fromkeys((*assumed.values(), *ignored.values())))


def _hands(robot: Robot) -> set[str]:
    """Joints like those of hands: leaves of the tree that follow each other or slide in pairs."""
    parents = {body.parent for body in robot.bodies}
    leaves = [b for k, b in enumerate(robot.bodies) if k not in parents]
    names = set()
    for index, coordinate in enumerate(robot.coordinates):
        moved = [b for b in robot.bodies if b.coordinate == index]
        if not all(body in leaves for body in moved):
            continue
        twins = [b for b in leaves if b not in moved and b.parent == moved[0].parent]
        sliding = coordinate.kind == "prismatic" and any(t.kind == "prismatic" for t in twins)
        if len(moved) > 1 or sliding:
            names.add(coordinate.name)
    return names


def _logged(robot: Robot, columns: Sequence[str], sample: Sample) -> set[str]:
    """Joints with columns of their names for position and effort, which change: of the arm."""
    values = {name: finite(x) for name, x in sample.items()}
    named = [
        by_name(robot.coordinates, [c for c in map(Column, columns) if c.quantity == quantity])
        for quantity in ("position", "effort")
    ]
    return {
        joint
        for joint in named[0].keys() & named[1].keys()
        if all(efforts.changes(of[joint].name, values) for of in named)
    }


def path_from(folder: Path, path: Path) -> str:
    """A path as seen from a folder: relative or absolute, whichever is shorter."""
    absolute = Path(os.path.abspath(path)).as_posix()
    try:
        relative = Path(os.path.relpath(path, folder)).as_posix()
    except ValueError:  # on another drive
        return absolute
    return min(relative, absolute, key=len)


def _robot_table(
    proposal: Proposal, moving: Sequence[Coordinate], output_path: Path
) -> dict[str, Any]:
    """The robot and its model file, and joints that are not identified with their positions."""
    loaded, reasons = proposal.loaded, proposal.reasons
    model, arguments = loaded.sources[0].path, None
    resting = [c for c in loaded.robot.coordinates if c not in moving]
    if len(loaded.sources) > 1:
        pairs = loaded.arguments.items()
        arguments = ", ".join(f"{toml_key(name)} = {toml_text(value)}" for name, value in pairs)
    return {
        "robot": loaded.robot,
        "kind": "mjcf" if read_xml(model).tag == "mujoco" else "urdf",
        "model": path_from(output_path.parent, model),
        "file": output_path.name,
        "arguments": arguments,
        "moving": moving,
        "base": proposal.base,
        "why_base": proposal.why_base or "as asked",
        "resting": [(c.name, np.clip(0.0, c.limits.lower, c.limits.upper)) for c in resting],
        "locked": {
            why: [(name, proposal.locked[name]) for name in reasons if reasons[name] == why]
            for why in dict.fromkeys(reasons.values())
        },
        "isfinite": np.isfinite,
    }
