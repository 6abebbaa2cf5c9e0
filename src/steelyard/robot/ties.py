"""What ties joints of a mechanism to each other beside its links."""

from dataclasses import dataclass

from numpy.typing import ArrayLike

from steelyard.arrays import Array, frozen


@dataclass(frozen=True)
class Mimic:
    """`position = ratio * master's position + offset` [rad; m]."""

    master: str
    ratio: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True, eq=False)
class Pin:
    """A point of one link that stays on a point of another.

    Attributes:
        name: For messages.
        links: Names of the two links.
        points: Shape `(2, 3)` [m], the point in each link's frame.
        where: File and line, for messages.
    """

    name: str
    links: tuple[str, str]
    points: Array
    where: str

    def __init__(
        self, name: str, links: tuple[str, str], points: ArrayLike, where: str = "the mechanism"
    ) -> None:
        object.__setattr__(self, "name", name)
        object.__setattr__(self, "links", links)
        object.__setattr__(self, "points", frozen(points, (2, 3)))
        object.__setattr__(self, "where", where)


@dataclass(frozen=True)
class Coupling:
    """Joints that a model file ties in a way that no equation of a robot here says.

    Attributes:
        name: For messages.
        what: What ties them, for messages: "a joint equality that is not proportional".
        joints: Names of the joints that cannot move on their own.
        where: File and line, for messages.
    """

    name: str
    what: str
    joints: tuple[str, ...]
    where: str
