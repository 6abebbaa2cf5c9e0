"""What options of `steelyard init` state of the drives, from a data sheet."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from steelyard.cli.ask import parsed
from steelyard.errors import ModelError
from steelyard.robot.robot import Coordinate
from steelyard.robot_file.template.guess_columns import Guess
from steelyard.robot_file.template.guess_motors import Gears
from steelyard.robot_file.template.known import Known, needs_gains
from steelyard.suggest import advice


@dataclass(frozen=True)
class Stated:
    """The texts of the options; `None` or empty where they are not given.

    Attributes:
        ratios: Turns of each motor per turn of its joint.
        coupling: Motor, joint and ratio of motors that turn with a second joint.
        gains: Nm (N) at the joint per A.
        zeros: Joint positions where the log says zero [rad; m], or with `deg` behind a number.
    """

    ratios: str | None = None
    coupling: Sequence[str] = ()
    gains: str | None = None
    zeros: str | None = None

    def gears(self, guess: Guess, moving: Sequence[Coordinate]) -> Gears | None:
        """The gears, where they are stated.

        Raises:
            ModelError: They are incomplete, or the log's signals are not of motors.
        """
        if self.ratios is None and not self.coupling:
            return None
        if not guess.motor_side:
            raise ModelError(
                "the log's signals are of joints, by their names",
                where="--ratios" if self.ratios is not None else "--coupling",
                fix="leave the option out, or name the motors' columns in the robot file",
            )
        if self.ratios is None:
            raise ModelError(
                "a coupling is given without gear ratios",
                where="--coupling",
                fix="give --ratios as well, one number for each joint",
            )
        ratios = _counted("--ratios", self.ratios, moving)
        coupling = tuple(_coupled(text, moving) for text in self.coupling)
        return Gears(ratios, coupling, "ratios as stated by --ratios")

    def with_zeros(self, known: Known, moving: Sequence[Coordinate]) -> Known:
        """What is known, with the stated zeros.

        Raises:
            ModelError: They are not one per joint.
        """
        if self.zeros is None:
            return known
        words = self.zeros.replace(",", " ").split()
        turned = (word.endswith("deg") for word in words)
        plain = parsed(" ".join(word.removesuffix("deg") for word in words), len(moving))
        if plain is None:
            names = ", ".join(c.name for c in moving)
            raise ModelError(
                f"'{self.zeros}' is not {len(moving)} positions",
                where="--zeros",
                fix=f"give one for each of {names}, with commas, such as 0,-90deg,1.5708",
            )
        pairs = zip(plain, turned, strict=True)
        return replace(known, zeros=tuple(float(np.deg2rad(x)) if d else x for x, d in pairs))

    def with_gains(self, known: Known, guess: Guess, moving: Sequence[Coordinate]) -> Known:
        """What is known, with the stated gains.

        Raises:
            ModelError: They are not one per joint, or the log's efforts have no gains.
        """
        if self.gains is None:
            return known
        if not needs_gains(guess):
            raise ModelError(
                "the log's efforts are torques, by their names",
                where="--gains",
                fix="leave the option out, or state the kind of efforts in the robot file",
            )
        gains = _counted("--gains", self.gains, moving)
        return replace(known, gains=gains, gains_source="--gains")


def _counted(option: str, text: str, moving: Sequence[Coordinate]) -> tuple[float, ...]:
    """One number other than zero for each joint."""
    found = parsed(text, len(moving))
    if found is None or not all(found):
        raise ModelError(
            f"'{text}' is not {len(moving)} numbers other than zero",
            where=option,
            fix="give one for each of " + ", ".join(c.name for c in moving) + ", with commas",
        )
    return found


def _coupled(text: str, moving: Sequence[Coordinate]) -> tuple[int, int, float]:
    """Motor and second joint by number, and the ratio, of MOTOR,JOINT,RATIO."""
    names = [c.name for c in moving]
    words = [word.strip() for word in text.split(",")]
    ratio = parsed(words[-1], 1)
    if len(words) != 3 or ratio is None or not ratio[0]:
        raise ModelError(
            f"'{text}' is not MOTOR,JOINT,RATIO",
            where="--coupling",
            fix=f"write the motor by the joint that it drives, such as {names[-1]},{names[0]},32",
        )
    for name in words[:2]:
        if name not in names:
            raise ModelError(
                f"there is no joint '{name}'",
                where="--coupling",
                fix=advice(name, names, "joints"),
            )
    return names.index(words[0]), names.index(words[1]), ratio[0]
