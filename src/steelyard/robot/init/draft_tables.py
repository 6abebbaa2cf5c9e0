"""Tables of a new robot file: what is guessed, known from answers, or left to fill in."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from steelyard.base.templates import templates_of
from steelyard.robot.file.sections import EffortKind, EffortUnit, Gain
from steelyard.robot.file.signals import expanded
from steelyard.robot.file.toml_edits import comment, toml_key, toml_text
from steelyard.robot.init.column_names import Column
from steelyard.robot.init.guess_columns import Guess, recognised
from steelyard.robot.init.guess_efforts_and_gears import Gears, effort_units
from steelyard.robot.mechanism import JointSpring
from steelyard.robot.robot import Coordinate

CURRENT_UNITS = ("A", "mA")


@dataclass(frozen=True)
class Effort:
    """Content of the effort columns, as answered; their unit is as guessed if `None`."""

    kind: EffortKind
    unit: EffortUnit | None = None


@dataclass(frozen=True)
class Known:
    """What the robot file states beyond the columns."""

    effort: Effort | None = None  # content of the effort columns; as guessed if `None`
    gains: tuple[Gain, ...] = ()  # joint torque per logged base unit, or `identify`, by joint
    gains_source: str = ""  # where they come from, in words
    reference: int = 0  # number of the joint whose gain is set to 1 where none is known
    gravity: tuple[float, float, float] | None = None  # in the base frame [m/s²], not the model's
    gears: Gears | None = None  # gears between motors and joints
    zeros: tuple[float, ...] = ()  # joint positions where the log says zero [rad; m], if known
    auto: bool = False  # whether friction laws are chosen from the data
    friction: str = ""  # why, or why not, in words; empty without a log


def with_effort(guess: Guess, effort: Effort | None) -> Guess:
    """The guess with the content of its efforts as answered."""
    if effort is None:
        return guess
    section = guess.section
    changes = {"kind": effort.kind} | ({"unit": effort.unit} if effort.unit else {})
    changed = section.effort.model_copy(update=changes)
    left = () if effort.kind == "motor_current" else guess.contradictions
    section = section.model_copy(update={"effort": changed})
    return replace(guess, section=section, contradictions=left)


def current_units(guess: Guess) -> tuple[bool, ...]:
    """Whether each effort column holds a current."""
    unit = guess.section.effort.unit
    units = unit if isinstance(unit, tuple) else (unit,) * len(guess.joints)
    return tuple(one in CURRENT_UNITS for one in units)


def needs_gains(guess: Guess) -> bool:
    """Whether efforts are currents, whose gains the columns do not contain."""
    return any(current_units(guess))


TO_FILL = "?"  # stands for a column of the log that the user names

KINDS = (
    '"joint_torque": at the joints, with rotors and gears; "link_torque": sensors',
    'on the link side (then remove rotor_inertia from terms); "motor_torque": from the',
    'motors; "motor_current"; or "gravity_compensated_torque".',
)
"""Kinds of efforts, as a comment says them."""


def robot_file_text(**values: Any) -> str:
    """The robot file's text, filled in with what the tables below say."""
    template = _templates().get_template("robot_file.toml")
    return str(template.render(values, toml=toml_text, key=toml_key, comment=comment))


@cache
def _templates() -> Any:
    return templates_of(Path(__file__).parent / "templates", keep_trailing_newline=True)


def signals_table(guess: Guess, moving: Sequence[Coordinate], known: Known) -> dict[str, Any]:
    """What the columns of the log seem to be, and gains with where they come from."""
    units = tuple(c.unit for c in moving)
    currents = current_units(guess)
    gains = list(known.gains)
    if not gains:  # relative to one joint or to the torques beside
        gains = ["identify" if current else 1.0 for current in currents]
        gains[known.reference] = 1.0 if all(currents) else gains[known.reference]
    return {
        "section": guess.section,
        "kinds": KINDS,
        "position_unit": guess.section.position_unit
        or (units if len(set(units)) > 1 else units[0]),
        "currents": any(currents),
        "gains": gains,
        "scale_words": scale_words,
    }


def scale_words(guess: Guess) -> str:
    """What the gains without any further knowledge mean."""
    if all(current_units(guess)):
        return (
            "one gain is set to 1.0 and the others are identified relative to it: errors are "
            "valid in the unit of the log; masses, inertias and torques are up to one common scale."
        )
    return "torques and forces are taken as logged, and gains of currents identified beside them."


def columns_table(
    columns: Sequence[str] | None, problem: str, moving: Sequence[Coordinate]
) -> dict[str, Any]:
    """Columns to fill in, with those of the log if there is one."""
    why = f"{problem}. Fill this in and remove the leading #."
    if columns is None:
        why = "no log was given. Columns are guessed from each log; to set them, fill this in and "
        why += "remove the leading #."
    found = [recognised(q, moving, columns or ()) for q in ("position", "effort")]
    clock = next((c for c in columns or () if Column(c).quantity == "time"), "time")
    positions, efforts = (
        toml_text(expanded(pattern, moving))
        if columns is None
        else toml_text([c.name if c else TO_FILL for c in known or [None] * len(moving)])
        for pattern, known in zip(("q{}", "tau{}"), found, strict=True)
    )
    # kind, units and gains by the names of the columns that are recognised
    pairs = [(one, c) for one, c in zip(found[1], moving, strict=False) if one is not None]
    named = effort_units([one for one, _ in pairs], [c for _, c in pairs], {})[1]
    current = bool(named) and set(named) <= set(CURRENT_UNITS)
    return {
        "kinds": KINDS,
        "why_no_columns": why,
        "columns": ", ".join(map(toml_text, columns or ())),
        "time": clock,
        "positions": positions,
        "efforts": efforts,
        "effort_kind": "motor_current" if current else "joint_torque",
        "effort_units": [named[0] if current else c.effort_unit for c in moving],
        "effort_gains": ["identify" if current and k else 1.0 for k in range(len(moving))],
    }


def gears_table(gears: Gears | None, moving: Sequence[Coordinate]) -> dict[str, Any]:
    """The transmission, if motors are geared."""
    coupling = () if gears is None else gears.coupling
    return {
        "gears": gears,
        "motors": ", ".join(f"motor_{k + 1} of {c.name}" for k, c in enumerate(moving)),
        "coupled": [f"motor_{i + 1}" for i in sorted({i for i, _, _ in coupling})],
        "coupling": [
            f"{{motor = {toml_text(f'motor_{i + 1}')}, joint = {toml_text(moving[j].name)}, "
            f"ratio = {toml_text(ratio)}}}"
            for i, j, ratio in coupling
        ],
    }


def model_table(
    springs: Mapping[str, JointSpring], guess: Guess | None, known: Known
) -> dict[str, Any]:
    """The torque terms, and those of the model file's springs."""
    behind = guess is not None and guess.section.effort.kind == "link_torque"
    laws = [] if known.auto else ["coulomb", "viscous"]
    names = ["rigid_body", *([] if behind else ["rotor_inertia"]), *laws, "offset"]
    return {
        "terms": ", ".join(map(toml_text, names)),
        "springs": [*springs],
        "free": [round(spring.free, 12) for spring in springs.values()],
        "stiffness": ", ".join(
            f"{name} {s.stiffness:g}{'' if s.linear else ' and higher powers'}"
            for name, s in springs.items()
        ),
    }


def excitation_table(moving: Sequence[Coordinate]) -> dict[str, Any]:
    """Limits of motions that `steelyard excite` designs: those of the model."""
    limits = {name: [getattr(c.limits, name) for c in moving] for name in ("velocity", "effort")}
    return {
        "limits": {
            name: [x if np.isfinite(x) else 1.0 for x in values] for name, values in limits.items()
        },
        "unlimited": {
            name: ", ".join(
                c.name for c, x in zip(moving, values, strict=True) if not np.isfinite(x)
            )
            for name, values in limits.items()
        },
        "accelerations": [1.0 if c.kind == "prismatic" else 5.0 for c in moving],
    }
