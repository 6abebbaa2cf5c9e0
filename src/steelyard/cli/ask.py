"""The questions that `steelyard init` asks at a terminal; Enter skips each."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TypeVar

from steelyard.cli.stated_values import coupled, numbers, parsed, positions
from steelyard.errors import ModelError
from steelyard.robot.robot import Coordinate
from steelyard.robot_file.template.guess_columns import Guess
from steelyard.robot_file.template.guess_motors import Gears
from steelyard.robot_file.template.known import Effort, Known, needs_gains, with_effort

T = TypeVar("T")
Ask = Callable[[str, str], str]
"""Question and default to the answer."""

G = 9.81
MOUNTINGS = {"upright": None, "ceiling": (0.0, 0.0, G)}
"""Gravity in the base frame [m/s²]; `None` as in the model file."""
EFFORTS = {
    "1": Effort("joint_torque"),
    "2": Effort("link_torque"),
    "3": Effort("motor_current", "A"),
    "4": Effort("motor_current", "mA"),
    "5": Effort("gravity_compensated_torque"),
}
_KIND = """What do the effort columns contain?
  1  joint torques, computed from motor currents or including the rotors
  2  torques of sensors on the link side of the gears (Franka, KUKA iiwa, Kinova Gen3, Rokae xMate)
  3  motor currents in A
  4  motor currents in mA
  5  joint torques without the controller's gravity compensation
"""
_MOUNTING = (
    "How is the base mounted: upright (as in the model file), ceiling, or gravity in the base "
    "frame as x,y,z [m/s²]?"
)


def effort_of(guess: Guess, ask: Ask) -> Effort | None:
    """Content of the effort columns, where their names state a torque or nothing."""
    if needs_gains(guess) or guess.motor_side:
        return None
    guessed = "2" if guess.section.effort.kind == "link_torque" else "1"
    answer = _chosen(ask, f"{_KIND}Number", guessed, EFFORTS)
    return None if answer == guessed else EFFORTS[answer]


def gears_of(guess: Guess, moving: Sequence[Coordinate], ask: Ask) -> Gears | None:
    """Gear ratios, where signals are of the motors and neither log nor model contain them."""
    ratios = _answered(
        ask,
        "Positions or torques are of the motors. Turns of each motor per turn of its joint, "
        f"negative where opposite ({_names(moving)}), separated by commas",
        "unknown",
        lambda text: numbers(text, moving, "--ratios"),
    )
    return None if ratios is None else Gears(ratios, (), "ratios as answered")


def coupling_of(moving: Sequence[Coordinate], ask: Ask) -> tuple[tuple[int, int, float], ...]:
    """Motors that turn with a second joint: motor and joint by number, and ratio; none if none."""
    question = (
        "Motors that turn with a second joint, as MOTOR,JOINT,RATIO, the motor by the joint that "
        f"it drives ({moving[-1].name},{moving[-2:][0].name},32), separated by spaces"
    )

    def read(text: str) -> tuple[tuple[int, int, float], ...]:
        return tuple(coupled(word, moving, "--coupling") for word in text.split())

    return _answered(ask, question, "none", read) or ()


def zeros_of(moving: Sequence[Coordinate], ask: Ask) -> tuple[float, ...]:
    """Joint positions where the motors' positions are zero [rad; m]; none if unknown."""
    question = (
        "Joint positions where the motors' positions are zero, in rad (m) or as -90deg "
        f"({_names(moving)}), separated by commas"
    )
    return (
        _answered(ask, question, "all zero", lambda text: positions(text, moving, "--zeros")) or ()
    )


def mounting_of(ask: Ask) -> tuple[float, float, float] | None:
    """Gravity in the base frame [m/s²]; `None` as in the model file."""
    default, question = "upright", _MOUNTING
    while True:
        text = ask(question, default).strip().lower()
        if text in MOUNTINGS:
            return MOUNTINGS[text]
        found = parsed(text, 3)
        if found is not None and any(found):
            return found[0], found[1], found[2]
        question = f"'{text}' is none of these. {_MOUNTING}"


def with_gains(known: Known, guess: Guess, moving: Sequence[Coordinate], ask: Ask) -> Known:
    """Drive gains of currents, where the log does not contain them."""
    if known.gains or not needs_gains(with_effort(guess, known.effort)):
        return known
    gains = _answered(
        ask,
        "Drive gains: Nm at the joint per A, torque constant times gear ratio "
        f"({_names(moving)}), separated by commas",
        "unknown",
        lambda text: numbers(text, moving, "--gains"),
    )
    return known if gains is None else replace(known, gains=gains, gains_source="the answer given")


def _names(moving: Sequence[Coordinate]) -> str:
    return ", ".join(c.name for c in moving)


def _chosen(ask: Ask, question: str, default: str, choices: Mapping[str, object]) -> str:
    """One of the choices; the question is repeated until it is."""
    while (text := ask(question, default).strip()) not in choices:
        question = f"'{text}' is none of {', '.join(choices)}"
    return text


def _answered(ask: Ask, question: str, default: str, read: Callable[[str], T]) -> T | None:
    """What an answer says, asked again until it can be read; `None` for the default."""
    asked = question
    while (text := ask(asked, default).strip()) != default:
        try:
            return read(text)
        except ModelError as error:
            asked = f"{error.wrong}: {error.fix}. {question}"
    return None
