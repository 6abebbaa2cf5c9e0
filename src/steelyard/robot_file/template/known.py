"""What is known beyond the columns of a log: from its values, or answered at the terminal."""

from dataclasses import dataclass, replace

from steelyard.robot_file.sections import EffortKind, EffortUnit, Gain
from steelyard.robot_file.template.guess_columns import Guess
from steelyard.robot_file.template.guess_motors import Gears

CURRENT_UNITS = ("A", "mA")


@dataclass(frozen=True)
class Effort:
    """Content of the effort columns, as answered.

    Attributes:
        kind: Content.
        unit: Unit of all columns; as guessed if `None`.
    """

    kind: EffortKind
    unit: EffortUnit | None = None


@dataclass(frozen=True)
class Known:
    """What the robot file states beyond the columns.

    Attributes:
        effort: Content of the effort columns; as guessed if `None`.
        gains: Joint torque per logged base unit, or `identify`, one per joint; none if unknown.
        gains_source: Where they come from, in words.
        reference: Number of the joint whose gain is set to 1 where none is known.
        gravity: Gravity in the base frame [m/s²]; the model's if `None`.
        gears: Gears between motors and joints.
        zeros: Joint positions where the log says zero [rad; m]; none if unknown.
        auto: Whether friction laws are chosen from the data.
        friction: Why, or why not, in words; empty without a log.
    """

    effort: Effort | None = None
    gains: tuple[Gain, ...] = ()
    gains_source: str = ""
    reference: int = 0
    gravity: tuple[float, float, float] | None = None
    gears: Gears | None = None
    zeros: tuple[float, ...] = ()
    auto: bool = False
    friction: str = ""


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


def gains_of(guess: Guess, known: Known) -> tuple[Gain, ...]:
    """Gains that the file states: known ones; else relative to one joint or to the torques beside.

    Without any, the gain of one joint is 1: results are then up to one common scale.
    """
    if known.gains:
        return known.gains
    currents = current_units(guess)
    given: list[Gain] = ["identify" if current else 1.0 for current in currents]
    if all(currents):
        given[known.reference] = 1.0
    return tuple(given)
