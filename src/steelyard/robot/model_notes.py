"""What a model file says beyond the mechanism: values that others tell or offer."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

Naming = Callable[[str, int], str]
"""Name of a model file's object by its kind and number."""

Answer = Literal["gravity", "weight", "efforts", "springs"]
"""What a robot file says instead: its gravity, that efforts are without the robot's weight, limits
of effort, terms for springs."""


@dataclass(frozen=True)
class ModelNote:
    """A statement of a model file that is not followed.

    Attributes:
        what: What is stated and what holds instead; items of the same statement are listed after.
        item: What it is about, such as a joint with a number; empty if `what` says it all.
        joints: Joints that it concerns; empty if it concerns the whole robot.
        answer: What in a robot file settles it, if anything.
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
