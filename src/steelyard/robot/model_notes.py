"""What a model file says beyond the mechanism, and notes: values that other modules print."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

Naming = Callable[[str, int], str]
"""Name of a model file's object by its kind and number."""

Answer = Literal["gravity", "weight", "efforts", "springs"]
"""What a robot file says instead: its gravity, that efforts are without the robot's weight, limits
of effort, terms for springs."""


class Listed(str):
    """A note of a statement and what it is about: `statement: a, b`.

    Attributes:
        statement: What two notes about the same have in common.
        about: What it is about, such as names of joints.
    """

    statement: str
    about: str

    def __new__(cls, statement: str, about: str) -> "Listed":
        """The note as one line."""
        note = super().__new__(cls, f"{statement}: {about}")
        note.statement, note.about = statement, about
        return note

    def __reduce__(self) -> tuple[type["Listed"], tuple[str, str]]:
        return Listed, (self.statement, self.about)


@dataclass(frozen=True)
class ModelNote:
    """A statement of a model file that is not followed.

    Attributes:
        what: What is stated and what holds instead; items of the same statement are listed after.
        item: What it is about, such as a joint with a number; empty if `what` says it all.
        joints: Joints that it concerns; empty if it concerns the whole robot.
        answer: What in a robot file resolves it, if anything.
    """

    what: str
    item: str = ""
    joints: tuple[str, ...] = ()
    answer: Answer | None = None


@dataclass(frozen=True)
class JointSpring:
    r"""A spring along a joint: it pulls back with $k\,(x - x_0)$.

    Attributes:
        stiffness: $k$ [Nm/rad; N/m].
        free: $x_0$ [rad; m].
        linear: Whether that is all; the file may add higher powers.
    """

    stiffness: float
    free: float
    linear: bool = True
