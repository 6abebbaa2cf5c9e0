"""The mechanism as a model file describes it: links, joints, mimics and pins, nothing merged."""

from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from functools import cached_property
from types import MappingProxyType
from typing import Literal

from steelyard.base.arrays import Array, by_key, frozen, set_fields
from steelyard.base.errors import ModelError, advice, refuse_unknown
from steelyard.robot.inertia_and_placement import DIRT, Inertia, Placement, clean_axis, turn
from steelyard.robot.robot import Limits

Answer = Literal["gravity", "weight", "efforts", "springs"]
"""What a robot file says instead: its gravity, that efforts are without the robot's weight, limits
of effort, terms for springs."""


class Listed(str):
    """A note of a statement that two notes may share and what it is about: `statement: a, b`."""

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
    """A statement of a model file that is not followed, and what holds instead.

    `item` is what it is about, listed after other items of the same statement; `joints` that it
    concerns, none if it concerns the whole robot; `answer` what in a robot file resolves it.
    """

    what: str
    item: str = ""
    joints: tuple[str, ...] = ()
    answer: Answer | None = None


@dataclass(frozen=True)
class JointSpring:
    """It pulls with `stiffness * (x - free)` [Nm/rad; N/m], [rad; m], if linear; else more."""

    stiffness: float
    free: float
    linear: bool = True


_LEAST_PLACEHOLDER_POWER, _LEAST_PLACEHOLDER_EFFORT = 3, 1e6
"""Powers of ten from this one on, and efforts beyond, that nobody has measured."""


def is_placeholder(effort: float) -> bool:
    """Whether a limit of effort [Nm; N] only fills its place.

    That is what is not above zero; 1000, 10000, ... and one below these (999, 99999); and all from
    a million on. An infinite one says itself that there is none.
    """
    powers = (10**power for power in range(_LEAST_PLACEHOLDER_POWER, 7))
    rounded = any(effort in (power, power - 1) for power in powers)
    return effort <= 0.0 or rounded or _LEAST_PLACEHOLDER_EFFORT <= effort < float("inf")


@dataclass(frozen=True)
class Mimic:
    """`position = ratio * master's position + offset` [rad; m]."""

    master: str
    ratio: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True, eq=False)
class Pin:
    """A point of one link that stays on a point of another, in the links' frames, `(2, 3)` [m]."""

    name: str
    links: tuple[str, str]
    points: Array
    where: str = "the mechanism"

    def __post_init__(self) -> None:
        set_fields(self, points=frozen(self.points, (2, 3)))


@dataclass(frozen=True)
class Coupling:
    """Joints tied in a way that no equation of a robot here says; `what` says it: "a weld"."""

    name: str
    what: str
    joints: tuple[str, ...]
    where: str


MechanismJointKind = Literal[
    "fixed", "revolute", "continuous", "prismatic", "floating", "planar", "ball"
]


@dataclass(frozen=True, eq=False)
class Link:
    """A rigid link; its inertia is in the link's frame, `None` if the file gives none.

    A `massless` one is only a frame between joints of one body; it `lacks` a mesh that its inertia
    would be computed from.
    """

    name: str
    inertia: Inertia | None = None
    where: str = "the mechanism"
    massless: bool = False
    lacks: str = ""


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint between two links; the child link's frame is the joint's frame.

    A kind with more than one degree of freedom no robot keeps. The
    `placement` is the joint's frame in the parent link's at position zero, the `axis` `(3,)` a unit
    vector there. An effort limit that only fills its place is taken as unknown, and is the
    `placeholder` [Nm; N].
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
            unlimited = replace(self.limits, effort=float("inf"))
            set_fields(self, placeholder=self.limits.effort, limits=unlimited)
        if not self.movable:
            set_fields(self, axis=frozen((1.0, 0.0, 0.0)))
            return
        try:
            axis = clean_axis(frozen(self.axis, (3,)), self.placement.dirt)
            set_fields(self, axis=frozen(axis))
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

    def snapped(self) -> "Joint":
        """The same joint, with turns that are next to quarter turns, and axes, made exact."""
        placement = Placement(self.placement.rotation, self.placement.position, DIRT)
        return replace(self, placement=placement)

    def at(self, position: float) -> Placement:
        """The child in the parent's frame at a position [rad; m]; fixed and free ones stay."""
        if not self.movable:
            return self.placement
        if self.kind == "prismatic":
            return self.placement @ Placement(position=self.axis * position)
        return self.placement @ Placement(turn(self.axis, position))


@dataclass(frozen=True, eq=False)
class Mechanism:
    """A tree of links and joints with one root, whose chains pins may close.

    The gravity `(3,)` [m/s²] is in the root link's frame. Actuators drive the `driven` joints, and
    their tendons run over the `pulled` ones. The pins close at the positions `rest`, where the file
    says so [rad; m]. `statements` are what the mechanism is without, `couplings` what forbids
    joints to move, `notes` what was assumed in reading, a sentence each.
    """

    name: str
    links: Sequence[Link]
    joints: Sequence[Joint]
    gravity: Array = field(default_factory=lambda: frozen((0.0, 0.0, -9.81)))
    where: str = "the mechanism"
    _: KW_ONLY
    pins: Sequence[Pin] = ()
    driven: Sequence[str] = ()
    pulled: Sequence[str] = ()
    rest: Mapping[str, float] = field(default_factory=dict)
    springs: Mapping[str, JointSpring] = field(default_factory=dict)
    statements: Sequence[ModelNote] = ()
    couplings: Sequence[Coupling] = ()
    notes: Sequence[str] = ()

    def __post_init__(self) -> None:
        for name in "links joints pins driven pulled statements couplings notes".split():
            set_fields(self, **{name: tuple(getattr(self, name))})
        for name in ("rest", "springs"):
            set_fields(self, **{name: MappingProxyType(dict(getattr(self, name)))})
        set_fields(self, gravity=frozen(self.gravity, (3,)))
        _check_names(self)
        _check_tree(self)
        _check_mimics(self)

    @property
    def root(self) -> str:
        """Name of the link that no joint carries."""
        children = {j.child for j in self.joints}
        return next(link.name for link in self.links if link.name not in children)

    @property
    def movable(self) -> tuple[Joint, ...]:
        """Joints of one degree of freedom that follow no other, parents before children."""
        return tuple(j for j in self.from_link(self.root) if j.movable and j.mimic is None)

    @cached_property
    def drives(self) -> Mapping[str, Mimic]:
        """How every movable joint follows the independent one behind it, itself if need be."""
        found = {}
        for joint in (j for j in self.joints if j.movable):
            master, ratio, offset = joint, 1.0, 0.0
            while master.mimic is not None:
                offset += ratio * master.mimic.offset
                ratio *= master.mimic.ratio
                master = self.joint(master.mimic.master)
            found[joint.name] = Mimic(master.name, ratio, offset)
        return found

    def joint(self, name: str) -> Joint:
        """The joint of that name; `KeyError` if there is none."""
        for joint in self.joints:
            if joint.name == name:
                return joint
        raise KeyError(name)

    def from_link(self, link: str) -> tuple[Joint, ...]:
        """The joints beyond a link, depth first, parents before children, in the file's order."""
        carried = by_key((joint.parent, joint) for joint in self.joints)
        found: list[Joint] = []
        waiting = carried.get(link, [])[::-1]
        while waiting:
            joint = waiting.pop()
            found.append(joint)
            waiting.extend(carried.get(joint.child, [])[::-1])
        return tuple(found)

    def to_link(self, link: str) -> tuple[Joint, ...]:
        """The joints that lead from the root to a link, in that order."""
        carrier = {j.child: j for j in self.joints}
        found: list[Joint] = []
        while link in carrier:
            found.append(carrier[link])
            link = carrier[link].parent
        return tuple(found[::-1])


def _check_names(mechanism: Mechanism) -> None:
    for kind, items in (("link", mechanism.links), ("joint", mechanism.joints)):
        seen: set[str] = set()
        for item in items:
            if item.name in seen:
                raise ModelError(
                    f"{kind} name '{item.name}' is given twice",
                    where=item.where,
                    fix=f"give every {kind} a name of its own",
                )
            seen.add(item.name)
    links = [link.name for link in mechanism.links]
    for joint in mechanism.joints:
        for role, name in (("parent", joint.parent), ("child", joint.child)):
            wrong = f"the {role} link '{name}' of joint '{joint.name}' does not exist"
            refuse_unknown(name, links, wrong, joint.where, "links")


def _check_tree(mechanism: Mechanism) -> None:
    if not mechanism.links:
        raise ModelError(
            "the robot has no links",
            where=mechanism.where,
            fix="give a model with links and joints",
        )
    carrier: dict[str, Joint] = {}
    for joint in mechanism.joints:
        if joint.child in carrier:
            raise ModelError(
                f"link '{joint.child}' has two parent joints, "
                f"'{carrier[joint.child].name}' and '{joint.name}'",
                where=joint.where,
                fix="a link has one parent joint: cut the loop by removing one of the two, and "
                "close it with [[robot.loops]] in a robot file",
            )
        carrier[joint.child] = joint
    roots = [link for link in mechanism.links if link.name not in carrier]
    if len(roots) > 1:
        names = ", ".join(f"'{r.name}'" for r in roots)
        raise ModelError(
            f"the links are not connected: {names} have no parent joint",
            where=roots[1].where,
            fix="join them to one root link with fixed joints, or remove those not needed",
        )
    reached = {j.child for root in roots for j in mechanism.from_link(root.name)}
    if loose := [j for j in mechanism.joints if j.child not in reached]:
        raise ModelError(
            "the joints form a closed cycle: " + ", ".join(f"'{j.name}'" for j in loose[:6]),
            where=loose[0].where,
            fix="every link must lead back to one root link: correct a parent or a child",
        )


def _check_mimics(mechanism: Mechanism) -> None:
    followed = {j.name: j for j in mechanism.joints}
    for joint in mechanism.joints:
        seen = [joint.name]
        while joint.mimic is not None:
            master = followed.get(joint.mimic.master)
            if master is None or not master.movable:
                fixed = "is fixed" if master else "does not exist"
                wrong = f"joint '{joint.name}' mimics joint '{joint.mimic.master}', which {fixed}"
                moving = [j.name for j in mechanism.joints if j.movable and j is not joint]
                fix = advice(joint.mimic.master, moving, "joints that move")
                raise ModelError(wrong, where=joint.where, fix=fix)
            if master.name in seen:
                raise ModelError(
                    "mimic joints follow each other in a circle: " + " -> ".join(seen),
                    where=joint.where,
                    fix="one of them must move on its own: remove its mimic",
                )
            seen.append(master.name)
            joint = master
