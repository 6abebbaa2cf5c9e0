"""The robot file that `steelyard init` writes: the best guess, with a comment on every key."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from steelyard.errors import LogError
from steelyard.robot.model_notes import JointSpring, Listed
from steelyard.robot.robot import Coordinate, Robot
from steelyard.robot.xml_reader import read_xml
from steelyard.robot_file.column_names import like_finger
from steelyard.robot_file.file import LoadedRobot
from steelyard.robot_file.template.guess_columns import Guess, Sample, guess_columns
from steelyard.robot_file.template.proposal import Proposal
from steelyard.robot_file.template.settings import SETTINGS
from steelyard.robot_file.template.signals import signals_part, signals_template
from steelyard.robot_file.template.text import comment, toml_key, toml_text


@dataclass(frozen=True)
class Draft:
    """A robot file that is proposed, and what it rests on.

    Attributes:
        text: The robot file.
        identified: Joints that it identifies.
        hands: Joints that it locks because they are of a hand.
        without_columns: Joints that it locks because the log has no columns for them.
        guess: What the log's columns seem to be; `None` without a log, or where they are unknown.
        problem: Why the columns are unknown; empty otherwise.
    """

    text: str
    identified: tuple[str, ...]
    hands: tuple[str, ...]
    without_columns: tuple[str, ...]
    guess: Guess | None
    problem: str


def drafted(
    proposal: Proposal,
    columns: Sequence[str] | None,
    sample: Sample | None,
    output_path: Path,
    rate: float | None = None,
) -> Draft:
    """A commented robot file, which `load_robot` reads.

    Joints of hands are locked, and so are joints that the log has no columns for. Where the
    columns of the log cannot be told, `[signals]` is left as a comment that lists them.

    Args:
        proposal: What `proposed` gave for the model file.
        columns: Names of the log's columns; `None` without a log.
        sample: Some values of the columns, for their units.
        output_path: Where the text will be written: the model's path is given from there.
        rate: Of the log's rows [Hz], if it has no column of time.
    """
    robot, springs = proposal.loaded.robot, proposal.loaded.springs
    hands = _hands(robot)
    free = [c for c in robot.coordinates if c.name not in hands] or [*robot.coordinates]
    guess, problem = None, ""
    if columns is not None:
        try:
            guess = guess_columns(free, columns, sample, rate)
        except LogError as error:
            problem = error.wrong
    moving = [c for c in free if guess is None or c.name in guess.joints]
    resting = [c for c in robot.coordinates if c not in moving]
    parts = [
        _robot_part(proposal, moving, output_path),
        _locked_part(resting, proposal),
        _limits_part(moving),
        _model_part({c.name: springs[c.name] for c in moving if c.name in springs}),
        signals_part(guess, moving) if guess else signals_template(columns, problem, moving),
        SETTINGS,
    ]
    return Draft(
        "\n\n".join(parts) + "\n",
        tuple(c.name for c in moving),
        tuple(c.name for c in robot.coordinates if c not in free),
        tuple(c.name for c in free if c not in moving),
        guess,
        problem,
    )


def notes_beside(bare: LoadedRobot, written: LoadedRobot) -> tuple[str, ...]:
    """Notes of a model file and of the robot file made from it, each statement once.

    A robot file repeats gravity and limits of the model, and so hides what they rest on. Of a
    statement with a list, the robot file's holds: it moves fewer joints.
    """
    told = {**bare.ignored, **written.ignored}
    assumed = {
        note.statement if isinstance(note, Listed) else note: note
        for loaded in (bare, written)
        for note in loaded.notes
        if note not in loaded.ignored.values()
    }
    return tuple(dict.fromkeys((*assumed.values(), *told.values())))


def _hands(robot: Robot) -> set[str]:
    """Joints of hands: by name, or leaves of the tree that follow each other or slide in pairs."""
    parents = {body.parent for body in robot.bodies}
    leaves = [b for k, b in enumerate(robot.bodies) if k not in parents]
    names = {c.name for c in robot.coordinates if like_finger(c.name)}
    for index, coordinate in enumerate(robot.coordinates):
        moved = [b for b in robot.bodies if b.coordinate == index]
        if not all(body in leaves for body in moved):
            continue
        twins = [b for b in leaves if b not in moved and b.parent == moved[0].parent]
        sliding = coordinate.kind == "prismatic" and any(t.kind == "prismatic" for t in twins)
        if len(moved) > 1 or sliding:
            names.add(coordinate.name)
    return names


def _relative(model_path: Path, output_path: Path) -> str:
    """The model's path from the robot file's folder; absolute on another drive."""
    try:
        return Path(os.path.relpath(model_path, output_path.parent)).as_posix()
    except ValueError:
        return model_path.resolve().as_posix()


def _xacro_lines(loaded: LoadedRobot) -> str:
    """How a xacro file is expanded."""
    if len(loaded.sources) == 1:
        return ""
    given = ", ".join(
        f"{toml_key(name)} = {toml_text(value)}" for name, value in loaded.arguments.items()
    )
    mark = "" if given else "# "
    return f"""
# Arguments of the xacro file, and folders of ROS packages, in addition to those above the file.
{mark}xacro.arguments = {{{given}}}
# xacro.packages = ["../src"]"""


def _robot_part(proposal: Proposal, moving: Sequence[Coordinate], output_path: Path) -> str:
    robot, model_path = proposal.loaded.robot, proposal.loaded.sources[0].path
    kind = "mjcf" if read_xml(model_path).tag == "mujoco" else "urdf"
    names = "".join(f"  {toml_text(c.name)},\n" for c in moving)
    return f"""\
# Robot file for steelyard, written by `steelyard init`. Check the lines marked CHECK.

[robot]
name = {toml_text(robot.name)}
# Where the model and the logs come from, for the report.
# source = "https://..."
# Path relative to this file; ${{NAME}} is an environment variable.
{kind} = {toml_text(_relative(model_path, output_path))}{_xacro_lines(proposal.loaded)}
# Joints to identify, in the order of the columns below. All others are locked.
joints = [
{names}]
{_base_lines(proposal)}
# tip = "tool0"
# CHECK: gravity [m/s²] in the frame of the base. Change it for wall or ceiling mounting;
# instead, mounting = {{roll = 0.0, pitch = 90.0, yaw = 0.0}} gives the base's rotation [deg].
gravity = {toml_text(robot.gravity.tolist())}"""


def _base_lines(proposal: Proposal) -> str:
    """The base, and what is assumed of it."""
    if proposal.base is None:
        return """\
# The link taken as fixed base, and the last link of the chain, if not the model's.
# base = "base_link\""""
    why = f"CHECK: the link fixed to the world, {proposal.why_base or 'as asked'}. "
    why += "It must be at rest in every log."
    return f"{comment(why)}\nbase = {toml_text(proposal.base)}\n# The last link of the chain."


def _locked_part(resting: Sequence[Coordinate], proposal: Proposal) -> str:
    lines = ["# Positions of joints that are not identified [rad; m]; zero, or the nearest limit."]
    lines.append("[robot.locked]")
    for c in resting:
        lines.append(
            f"{toml_key(c.name)} = {toml_text(np.clip(0.0, c.limits.lower, c.limits.upper))}"
        )
    reasons = proposal.reasons
    for why in dict.fromkeys(reasons.values()):
        lines.append(comment(f"Locked: {why}."))
        names = [name for name in reasons if reasons[name] == why]
        lines += [f"{toml_key(name)} = {toml_text(proposal.locked[name])}" for name in names]
    return "\n".join(lines)


def _limits_part(moving: Sequence[Coordinate]) -> str:
    lines = [
        "# Limits from the model: position [rad; m], speed [rad/s; m/s], effort [Nm; N].",
        "# What is left out is unlimited or unknown.",
    ]
    for c in moving:
        given = [
            f"{name} = {toml_text(value)}"
            for name in ("lower", "upper", "velocity", "effort")
            if np.isfinite(value := getattr(c.limits, name))
        ]
        lines.append("\n".join([f"[robot.limits.{toml_key(c.name)}]", *given]))
    return "\n".join(lines)


def _model_part(springs: Mapping[str, JointSpring]) -> str:
    """The customary terms, and one for the springs of the model file."""
    if not springs:
        return _MODEL_PART + _CUSTOMARY + "]"
    free = [round(spring.free, 12) for spring in springs.values()]
    each = (
        f"{name} {s.stiffness:g}{'' if s.linear else ' and higher powers'}"
        for name, s in springs.items()
    )
    told = f"Springs of the model file, their stiffness there [Nm/rad; N/m]: {', '.join(each)}."
    term = f'{{law = "spring", joints = {toml_text([*springs])}, free = {toml_text(free)}}}'
    return f"{_MODEL_PART}\n  {_CUSTOMARY},\n{comment(told, '  # ')}\n  {term},\n]"


_MODEL_PART = """\
[model]
# Torque terms. CHECK: motor torques and currents include "rotor_inertia"; torque sensors behind the
# gears do not: remove it there, together with kind = "link_torque" below, which excludes it.
# A table gives a law its settings: {law = "coulomb", smoothing = 0.005, joints = ["..."]}.
terms = ["""

_CUSTOMARY = '"rigid_body", "rotor_inertia", "coulomb", "viscous", "offset"'
