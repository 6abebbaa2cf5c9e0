"""The robot file that `steelyard init` writes: the best guess, with a comment on every key."""

import os
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from steelyard.base.errors import LogError
from steelyard.robot.file.model_reading_and_loaded_robot import LoadedRobot
from steelyard.robot.file.sections import Side
from steelyard.robot.file.toml_edits import toml_key, toml_text
from steelyard.robot.init.base_and_locked_joints import Proposal
from steelyard.robot.init.column_names import Column, by_name, finite, like_finger
from steelyard.robot.init.draft_tables import (
    Effort,
    Known,
    columns_table,
    excitation_table,
    gears_table,
    model_table,
    robot_file_text,
    signals_table,
    with_effort,
)
from steelyard.robot.init.guess_columns import Guess, Sample, guess_columns
from steelyard.robot.init.guess_efforts_and_gears import (
    LINK_SIDE_TORQUE,
    TORQUE,
    UNSTATED,
    Gears,
    changes,
    link_side,
    reductions,
)
from steelyard.robot.mechanism import Listed
from steelyard.robot.models.xml_reader import read_xml
from steelyard.robot.robot import Coordinate, Robot

_NOTHING = Known()
FILL_IN = (
    "fill in [signals], which is commented out below the names of the log's columns, with a column "
    "in place of each ?, and remove the #"
)
GIVE_RATE = "give the sampling rate, --rate HZ: all other columns are recognised"


@dataclass(frozen=True, eq=False)
class Assignment:
    """Joints of a proposed robot and the columns of a log that they have.

    `columns` is `None` without a log; `free` are all joints but those of hands, `moving` those that
    are identified. Without a guess of the columns, `problem` says why, if there is a log.
    """

    columns: tuple[str, ...] | None
    free: tuple[Coordinate, ...]
    moving: tuple[Coordinate, ...]
    guess: Guess | None = None
    problem: str = ""


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


def assigned(
    proposal: Proposal,
    columns: Sequence[str] | None,
    sample: Sample | None,
    rate: float | None = None,
    geared: bool = False,
    side: Side | None = None,
) -> Assignment:
    """Joints to identify, and the columns of a log, whose units some values tell.

    A `rate` [Hz] stands for a column of time; `geared` says that gear ratios are given,
    `side` that of the signals. It is a `LogError` if only the time is missing, and no rate given.
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
        return Assignment(tuple(columns), free, free, None, error.wrong)
    moving = tuple(c for c in free if c.name in guess.joints)
    return Assignment(tuple(columns), free, moving, guess)


def _behind_the_gears(guess: Guess, robot: str) -> Guess:
    """The guess, with torques of a known robot as those of sensors on the link side."""
    name = link_side(robot, guess.joints)
    if not name or guess.section.effort.kind != "joint_torque":
        return guess
    stated = LINK_SIDE_TORQUE.format(name)
    reasons = (why.replace(TORQUE, stated).replace(UNSTATED, stated) for why in guess.reasons)
    return replace(with_effort(guess, Effort("link_torque")), reasons=tuple(reasons))


def drafted(
    proposal: Proposal, assignment: Assignment, output_path: Path, known: Known = _NOTHING
) -> Draft:
    """A commented robot file; the model's path is given from where the text will be written.

    Joints of hands are locked, and so are joints that the log has no columns for. Where the
    columns of the log are unknown, `[signals]` is left as a comment that lists them; where gears
    are, `[robot.transmission]` is, and `load_robot` refuses the file until they are filled in.
    """
    robot, springs = proposal.loaded.robot, proposal.loaded.springs
    free, moving = assignment.free, assignment.moving
    guess = None if assignment.guess is None else with_effort(assignment.guess, known.effort)
    resting = [c for c in robot.coordinates if c not in moving]
    gears = known.gears or (gears_of(proposal, moving, guess) if guess else None)
    text = robot_file_text(
        **_robot_table(proposal, moving, resting, output_path),
        **gears_table(gears, moving),
        **model_table({c.name: springs[c.name] for c in moving if c.name in springs}, guess, known),
        **signals_table(guess, moving, known)
        if guess
        else columns_table(assignment.columns, assignment.problem, moving),
        **excitation_table(moving),
        guess=guess,
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
    )


def gears_of(proposal: Proposal, moving: Sequence[Coordinate], guess: Guess) -> Gears | None:
    """Gears that the log or the model file contains; `None` where signals are not of motors."""
    if not guess.motor_side:
        return None
    model = read_xml(proposal.loaded.sources[0].path)
    return guess.gears or reductions(model, [c.name for c in moving])


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
        if all(changes(of[joint].name, values) for of in named)
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
    proposal: Proposal,
    moving: Sequence[Coordinate],
    resting: Sequence[Coordinate],
    output_path: Path,
) -> dict[str, Any]:
    """The robot and its model file, and joints that are not identified with their positions."""
    loaded, reasons = proposal.loaded, proposal.reasons
    model, arguments = loaded.sources[0].path, None
    if len(loaded.sources) > 1:
        pairs = loaded.arguments.items()
        arguments = ", ".join(f"{toml_key(name)} = {toml_text(value)}" for name, value in pairs)
    places = [(c.name, np.clip(0.0, c.limits.lower, c.limits.upper)) for c in resting]
    return {
        "robot": loaded.robot,
        "kind": "mjcf" if read_xml(model).tag == "mujoco" else "urdf",
        "model": path_from(output_path.parent, model),
        "file": output_path.name,
        "arguments": arguments,
        "moving": moving,
        "base": proposal.base,
        "why_base": proposal.why_base or "as asked",
        "resting": places,
        "locked": {
            why: [(name, proposal.locked[name]) for name in reasons if reasons[name] == why]
            for why in dict.fromkeys(reasons.values())
        },
        "isfinite": np.isfinite,
    }
