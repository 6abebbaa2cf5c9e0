"""The mechanism as a model file describes it: links and joints, nothing locked or merged yet."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from numpy.typing import ArrayLike

from steelyard.arrays import Array, frozen
from steelyard.errors import ModelError
from steelyard.robot.links import Joint as Joint
from steelyard.robot.links import Link as Link
from steelyard.robot.links import MechanismJointKind as MechanismJointKind
from steelyard.robot.model_notes import JointSpring, ModelNote
from steelyard.robot.ties import Coupling as Coupling
from steelyard.robot.ties import Mimic as Mimic
from steelyard.robot.ties import Pin as Pin
from steelyard.suggest import advice


@dataclass(frozen=True, eq=False)
class Mechanism:
    """A tree of links and joints with one root, whose chains pins may close.

    Attributes:
        name: The robot's name.
        links: In the order of the file.
        joints: In the order of the file.
        gravity: Shape `(3,)` [m/s²], in the root link's frame.
        where: The file, for messages.
        pins: What closes chains.
        driven: Names of the joints that the file gives an actuator.
        pulled: Names of the joints that an actuator's tendon runs over.
        rest: Positions of joints at which the pins close, where the file says so [rad; m].
        springs: Springs along joints, by joint.
        statements: What else the file states and the mechanism is without.
        couplings: What else ties joints: they have to be locked.
        notes: What was assumed in reading, one sentence each, for the user.
    """

    name: str
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    gravity: Array
    where: str
    pins: tuple[Pin, ...]
    driven: tuple[str, ...]
    pulled: tuple[str, ...]
    rest: Mapping[str, float]
    springs: Mapping[str, JointSpring]
    statements: tuple[ModelNote, ...]
    couplings: tuple[Coupling, ...]
    notes: tuple[str, ...]

    def __init__(
        self,
        name: str,
        links: Sequence[Link],
        joints: Sequence[Joint],
        gravity: ArrayLike = (0.0, 0.0, -9.81),
        where: str = "the mechanism",
        *,
        pins: Sequence[Pin] = (),
        driven: Sequence[str] = (),
        pulled: Sequence[str] = (),
        rest: Mapping[str, float] = MappingProxyType({}),
        springs: Mapping[str, JointSpring] = MappingProxyType({}),
        statements: Sequence[ModelNote] = (),
        couplings: Sequence[Coupling] = (),
        notes: Sequence[str] = (),
    ) -> None:
        object.__setattr__(self, "name", name)
        object.__setattr__(self, "links", tuple(links))
        object.__setattr__(self, "joints", tuple(joints))
        object.__setattr__(self, "gravity", frozen(gravity, (3,)))
        object.__setattr__(self, "where", where)
        object.__setattr__(self, "pins", tuple(pins))
        object.__setattr__(self, "driven", tuple(driven))
        object.__setattr__(self, "pulled", tuple(pulled))
        object.__setattr__(self, "rest", MappingProxyType(dict(rest)))
        object.__setattr__(self, "springs", MappingProxyType(dict(springs)))
        object.__setattr__(self, "statements", tuple(statements))
        object.__setattr__(self, "couplings", tuple(couplings))
        object.__setattr__(self, "notes", tuple(notes))
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

    def snapped(self) -> "Mechanism":
        """The same mechanism, its angles and axes free of what rounding in the file left."""
        return self.changed(joints=[joint.snapped() for joint in self.joints])

    def changed(self, **fields: Any) -> "Mechanism":
        """The same mechanism with some of its attributes replaced."""
        return Mechanism(**{**vars(self), **fields})

    def joint(self, name: str) -> Joint:
        """The joint of that name; `KeyError` if there is none."""
        for joint in self.joints:
            if joint.name == name:
                return joint
        raise KeyError(name)

    def from_link(self, link: str) -> tuple[Joint, ...]:
        """The joints beyond a link, depth first, parents before children, in the file's order."""
        carried: dict[str, list[Joint]] = {}
        for joint in self.joints:
            carried.setdefault(joint.parent, []).append(joint)
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
            if name not in links:
                raise ModelError(
                    f"the {role} link '{name}' of joint '{joint.name}' does not exist",
                    where=joint.where,
                    fix=advice(name, links, "links"),
                )


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
                raise ModelError(
                    f"joint '{joint.name}' mimics joint '{joint.mimic.master}', which {fixed}",
                    where=joint.where,
                    fix=advice(
                        joint.mimic.master,
                        [j.name for j in mechanism.joints if j.movable and j is not joint],
                        "joints that move",
                    ),
                )
            if master.name in seen:
                raise ModelError(
                    "mimic joints follow each other in a circle: " + " -> ".join(seen),
                    where=joint.where,
                    fix="one of them must move on its own: remove its mimic",
                )
            seen.append(master.name)
            joint = master
