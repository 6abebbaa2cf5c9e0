"""Drives as `steelyard init` learns of them: by questions at a terminal, or by options."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from steelyard.base.errors import ModelError, advice
from steelyard.robot.file.sections import Side
from steelyard.robot.file.signals import looks_like_degrees
from steelyard.robot.init.draft_tables import Effort, Known, needs_gains, with_effort
from steelyard.robot.init.guess_columns import Guess
from steelyard.robot.init.guess_efforts_and_gears import Gears
from steelyard.robot.robot import Coordinate


def parsed(text: str, count: int) -> tuple[float, ...] | None:
    """So many finite numbers, separated by commas or spaces; `None` if they are not."""
    try:
        values = tuple(float(word) for word in text.replace(",", " ").split())
    except ValueError:
        return None
    finite = all(abs(value) < float("inf") for value in values)
    return values if len(values) == count and finite else None


def numbers(text: str, moving: Sequence[Coordinate], option: str) -> tuple[float, ...]:
    """One number other than zero for each joint, separated by commas."""
    found = parsed(text, len(moving))
    if found is None or not all(found):
        wrong = f"'{text}' is not {len(moving)} numbers other than zero"
        fix = f"give one for each of {_names(moving)}, with commas"
        raise ModelError(wrong, where=option, fix=fix)
    return found


def positions(text: str, moving: Sequence[Coordinate]) -> tuple[float, ...]:
    """One position for each joint [rad; m]: numbers in rad (m), or with `deg` behind them."""
    words = text.replace(",", " ").split()
    turned = [word.endswith("deg") for word in words]
    plain = parsed(" ".join(word.removesuffix("deg") for word in words), len(moving))
    if plain is None:
        wrong = f"'{text}' is not {len(moving)} positions"
        fix = f"give one for each of {_names(moving)}, with commas, such as 0,-90deg,1.5708"
        raise ModelError(wrong, where="--zeros", fix=fix)
    for x, in_degrees, coordinate in zip(plain, turned, moving, strict=True):
        if not in_degrees and looks_like_degrees(x, coordinate):
            wrong = f"positions are in rad: {x:g} of '{coordinate.name}' looks like degrees"
            fix = f"write {x:g}deg"
            raise ModelError(wrong, where="--zeros", fix=fix)
    return tuple(float(np.deg2rad(x)) if d else x for x, d in zip(plain, turned, strict=True))


def coupled(text: str, moving: Sequence[Coordinate]) -> tuple[int, int, float]:
    """Motor and second joint by number, and the ratio, of MOTOR,JOINT,RATIO.

    A motor is named by the joint that it drives, or by its number, as `motor_6`.
    """
    names = [c.name for c in moving]
    words = [word.strip() for word in text.split(",")]
    ratio = parsed(words[-1], 1)
    if len(words) != 3 or ratio is None or not ratio[0]:
        raise ModelError(
            f"'{text}' is not MOTOR,JOINT,RATIO",
            where="--coupling",
            fix="write the motor by the joint that it drives, such as "
            f"{names[-1]},{names[-2:][0]},32",
        )
    motors = {f"motor_{k + 1}": name for k, name in enumerate(names)}
    words[0] = motors.get(words[0], words[0]) if words[0] not in names else words[0]
    for name in words[:2]:
        if name not in names:
            raise ModelError(
                f"there is no joint '{name}'", where="--coupling", fix=advice(name, names, "joints")
            )
    return names.index(words[0]), names.index(words[1]), ratio[0]


T = TypeVar("T")
Ask = Callable[[str, str], str]  # question and default to the answer

GRAVITY_ACCELERATION = 9.81
MOUNTINGS = {"upright": None, "ceiling": (0.0, 0.0, GRAVITY_ACCELERATION)}
"""Gravity in the base frame [m/s²]; `None` as in the model file."""
EFFORT_ANSWERS = {
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
    question = f"{_KIND}Number"
    while (answer := ask(question, guessed).strip()) not in EFFORT_ANSWERS:
        question = f"'{answer}' is none of {', '.join(EFFORT_ANSWERS)}"
    return None if answer == guessed else EFFORT_ANSWERS[answer]


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
    pairs = _answered(
        ask, question, "none", lambda text: [coupled(w, moving) for w in text.split()]
    )
    return tuple(pairs or ())


def zeros_of(moving: Sequence[Coordinate], ask: Ask) -> tuple[float, ...]:
    """Joint positions where the motors' positions are zero [rad; m]; none if unknown."""
    question = (
        "Joint positions where the motors' positions are zero, in rad (m) or as -90deg "
        f"({_names(moving)}), separated by commas"
    )
    return _answered(ask, question, "all zero", lambda text: positions(text, moving)) or ()


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


def _answered(ask: Ask, question: str, default: str, read: Callable[[str], T]) -> T | None:
    """What an answer says, asked again until it can be read; `None` for the default."""
    asked = question
    while (text := ask(asked, default).strip()) != default:
        try:
            return read(text)
        except ModelError as error:
            asked = f"{error.wrong}: {error.fix}. {question}"
    return None


@dataclass(frozen=True)
class Stated:
    """The texts of the options; `None` or empty where they are not given."""

    ratios: str | None = None  # turns of each motor per turn of its joint
    coupling: Sequence[str] = ()  # motor, joint and ratio of motors that turn with a second joint
    gains: str | None = None  # nm (N) at the joint per A
    zeros: str | None = None  # where the log says zero [rad; m], or with `deg` behind a number
    side: Side | None = None  # of the gears, on which efforts are measured

    def gears(self, guess: Guess, moving: Sequence[Coordinate]) -> Gears | None:
        """The gears, where they are stated."""
        if self.ratios is None and not self.coupling:
            return None
        if not guess.motor_side:
            raise ModelError(
                "the log's signals are of joints, "
                + ("as --side joint says" if self.side else "by their names"),
                where="--ratios" if self.ratios is not None else "--coupling",
                fix="leave the option out, or give --side motor and --ratios",
            )
        if self.ratios is None:
            wrong = "a coupling is given without gear ratios"
            fix = "give --ratios as well, one number for each joint"
            raise ModelError(wrong, where="--coupling", fix=fix)
        ratios = numbers(self.ratios, moving, "--ratios")
        coupling = tuple(coupled(text, moving) for text in self.coupling)
        return Gears(ratios, coupling, "ratios as stated by --ratios")

    def effort(self, guess: Guess) -> Effort | None:
        """That efforts are currents, where gains are stated and names say something else."""
        stated = self.gains is not None and not needs_gains(guess)
        return Effort("motor_current", "A") if stated else None

    def added(self, known: Known, moving: Sequence[Coordinate]) -> Known:
        """What is known, with the stated zeros and gains."""
        if self.zeros is not None:
            known = replace(known, zeros=positions(self.zeros, moving))
        if self.gains is None:
            return known
        return replace(known, gains=numbers(self.gains, moving, "--gains"), gains_source="--gains")
