"""What options of `steelyard init` state of the drives, from a data sheet."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from steelyard.cli.stated_values import coupled, numbers, positions
from steelyard.errors import ModelError
from steelyard.robot.robot import Coordinate
from steelyard.robot_file.template.guess_columns import Guess
from steelyard.robot_file.template.guess_motors import Gears
from steelyard.robot_file.template.known import Known, needs_gains


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
        ratios = numbers(self.ratios, moving, "--ratios")
        coupling = tuple(coupled(text, moving, "--coupling") for text in self.coupling)
        return Gears(ratios, coupling, "ratios as stated by --ratios")

    def with_zeros(self, known: Known, moving: Sequence[Coordinate]) -> Known:
        """What is known, with the stated zeros.

        Raises:
            ModelError: They are not one per joint.
        """
        if self.zeros is None:
            return known
        return replace(known, zeros=positions(self.zeros, moving, "--zeros"))

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
        gains = numbers(self.gains, moving, "--gains")
        return replace(known, gains=gains, gains_source="--gains")
