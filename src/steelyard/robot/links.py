"""Links and joints as a model file describes them."""

from dataclasses import dataclass, field, replace
from typing import Literal

from steelyard.arrays import Array, frozen
from steelyard.errors import ModelError
from steelyard.robot.geometry import DIRT, Placement, clean_axis, turn
from steelyard.robot.inertia import Inertia
from steelyard.robot.placeholders import is_placeholder
from steelyard.robot.robot import Limits
from steelyard.robot.ties import Mimic

MechanismJointKind = Literal[
    "fixed", "revolute", "continuous", "prismatic", "floating", "planar", "ball"
]


@dataclass(frozen=True, eq=False)
class Link:
    """A rigid link.

    Attributes:
        name: Unique in the mechanism.
        inertia: Mass properties in the link frame; `None` if the file gives none.
        where: File and line, for messages.
        massless: Whether it is only a frame between the joints of one body.
        lacks: The mesh that its inertia is computed from, where that is absent.
    """

    name: str
    inertia: Inertia | None = None
    where: str = "the mechanism"
    massless: bool = False
    lacks: str = ""


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint between two links; the child link's frame is the joint's frame.

    Attributes:
        name: Unique in the mechanism.
        kind: `fixed`, `revolute`, `continuous` or `prismatic`; or with more than one degree of
            freedom `floating`, `planar` or `ball`, which no robot keeps (`robot/free_joints.py`).
        parent: Name of the parent link.
        child: Name of the child link.
        placement: The joint's frame in the parent link's frame, at position zero.
        axis: Unit vector in the joint's frame, shape `(3,)`; of no meaning for a fixed joint.
        limits: Range, speed and effort; an effort that is a placeholder is taken as unknown.
        mimic: The joint this one follows, if any.
        where: File and line, for messages.
        placeholder: That effort, if the file gives one [Nm; N]; else zero.
    """

    name: str
    kind: MechanismJointKind
    parent: str
    child: str
    placement: Placement = field(default_factory=Placement)
    axis: Array = field(default_factory=lambda: frozen((1.0, 0.0, 0.0)))
    limits: Limits = field(default_factory=Limits)
    mimic: Mimic | None = None
    where: str = "the mechanism"
    placeholder: float = field(default=0.0, init=False)

    def __post_init__(self) -> None:
        if is_placeholder(self.limits.effort):
            object.__setattr__(self, "placeholder", self.limits.effort)
            object.__setattr__(self, "limits", replace(self.limits, effort=float("inf")))
        if not self.movable:
            object.__setattr__(self, "axis", frozen((1.0, 0.0, 0.0)))
            return
        try:
            axis = clean_axis(frozen(self.axis, (3,)), self.placement.dirt)
            object.__setattr__(self, "axis", frozen(axis))
        except ValueError:
            raise ModelError(
                f"the axis of joint '{self.name}' has no direction: {self.axis}",
                where=self.where,
                fix="give a vector that is not zero, e.g. xyz='0 0 1'",
            ) from None
        if self.limits.lower > self.limits.upper:
            raise ModelError(
                f"joint '{self.name}' has a lower limit above its upper one "
                f"({self.limits.lower:g} > {self.limits.upper:g})",
                where=self.where,
                fix="swap the two limits",
            )

    @property
    def movable(self) -> bool:
        """Whether the joint has one degree of freedom."""
        return self.kind in ("revolute", "continuous", "prismatic")

    @property
    def free(self) -> bool:
        """Whether the joint has more than one degree of freedom."""
        return self.kind in ("floating", "planar", "ball")

    def snapped(self) -> "Joint":
        """The same joint, with turns that are next to quarter turns, and axes, made exact."""
        placement = Placement(self.placement.rotation, self.placement.position, DIRT)
        return replace(self, placement=placement)

    def at(self, position: float) -> Placement:
        """The child link in the parent link's frame at a joint position [rad; m].

        A joint that has not one degree of freedom stays where the file has it.
        """
        if not self.movable:
            return self.placement
        if self.kind == "prismatic":
            return self.placement @ Placement(position=self.axis * position)
        return self.placement @ Placement(turn(self.axis, position))
