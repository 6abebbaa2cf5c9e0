"""Random serial robots and cells as URDF text: consistent bodies, some with simple shapes."""

from dataclasses import dataclass, replace

import numpy as np

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Part:
    """A shape at a place.

    Attributes:
        shape: The element within `<geometry>`.
        xyz: Where it is [m].
        rpy: How it is turned [rad].
    """

    shape: str
    xyz: Vector
    rpy: Vector


@dataclass(frozen=True)
class Link:
    """A moving body and the joint that carries it.

    Attributes:
        kind: `revolute` or `prismatic`.
        xyz: Of the joint in the link before [m].
        rpy: Likewise [rad].
        axis: Of the joint.
        lower: Least position [rad; m].
        upper: Greatest position.
        velocity: Greatest speed.
        effort: Greatest effort [Nm; N].
        mass: Of the body [kg].
        com: Where its centre is [m].
        moments: `Ixx Iyy Izz Ixy Ixz Iyz` about the centre [kg m²].
        parts: Its shapes.
    """

    kind: str
    xyz: Vector
    rpy: Vector
    axis: Vector
    lower: float
    upper: float
    velocity: float
    effort: float
    mass: float
    com: Vector
    moments: tuple[float, ...]
    parts: tuple[Part, ...]


@dataclass(frozen=True)
class Arm:
    """A serial robot.

    Attributes:
        base: Shapes of what stands still.
        links: One a joint.
        tool: Where the tool is in the last link [m].
        tip: Shapes of the tool.
    """

    base: tuple[Part, ...]
    links: tuple[Link, ...]
    tool: Vector
    tip: tuple[Part, ...]

    def with_efforts(self, efforts: np.ndarray) -> "Arm":
        """The same with other limits of effort."""
        links = zip(self.links, efforts, strict=True)
        return replace(self, links=tuple(replace(link, effort=float(e)) for link, e in links))


def random_arm(random: np.random.Generator, shaped: bool, joints: tuple[int, int] = (2, 7)) -> Arm:
    """An arm with a number of joints between two, one in seven of them prismatic."""
    count = int(random.integers(joints[0], joints[1] + 1))
    spans = [_span(random) for _ in range(count + 1)]
    kinds = ["prismatic" if random.random() < 0.15 else "revolute" for _ in range(count)]
    places = [(0.0, 0.0, float(random.uniform(0.1, 0.4))), *spans]
    links = tuple(
        _link(random, kind, place, beyond, shaped)
        for kind, place, beyond in zip(kinds, places, spans, strict=False)
    )
    base = (Part('<box size="0.2 0.2 0.04"/>', (0.0, 0.0, 0.02), (0.0, 0.0, 0.0)),)
    tip = (Part('<sphere radius="0.03"/>', (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),)
    with_tip = shaped and random.random() < 0.5
    return Arm(base if shaped else (), links, places[count], tip if with_tip else ())


def _link(
    random: np.random.Generator, kind: str, xyz: Vector, beyond: Vector, shaped: bool
) -> Link:
    turning = kind == "revolute"
    span = random.uniform(1.0, 5.5) if turning else random.uniform(0.15, 0.8)
    lower = random.uniform(-0.8, -0.2) * span
    straight = random.random() < 0.6
    rpy = random.choice([0.0, 0.5, -0.5], 3) * np.pi if straight else random.uniform(-2, 2, 3)
    axis = np.eye(3)[random.integers(3)] if straight else random.standard_normal(3)
    mass = float(np.exp(random.uniform(np.log(0.3), np.log(8.0))))
    return Link(
        kind,
        xyz,
        _vector(rpy),
        _vector(axis / np.linalg.norm(axis)),
        float(lower),
        float(lower + span),
        float(random.uniform(0.8, 4.0) if turning else random.uniform(0.1, 0.8)),
        1e4,
        mass,
        _vector(0.5 * np.array(beyond) + random.uniform(-0.05, 0.05, 3)),
        _moments(random, mass),
        _along(random, beyond) if shaped and random.random() < 0.8 else (),
    )


def _span(random: np.random.Generator) -> Vector:
    """From a joint to the next: a direction of any kind, 0.05 to 0.5 m long."""
    way = np.eye(3)[random.integers(3)] if random.random() < 0.6 else random.standard_normal(3)
    return _vector(way / np.linalg.norm(way) * random.uniform(0.05, 0.5))


def _moments(random: np.random.Generator, mass: float) -> tuple[float, ...]:
    """Those of a turned box of even mass."""
    sides = random.uniform(0.03, 0.4, 3) ** 2
    turn = np.linalg.qr(random.standard_normal((3, 3)))[0]
    whole = turn @ np.diag(mass / 12.0 * (sides.sum() - sides)) @ turn.T
    return tuple(float(whole[i, j]) for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))


def _along(random: np.random.Generator, beyond: Vector) -> tuple[Part, ...]:
    """One or two shapes on the way to the next joint."""
    way = np.array(beyond)
    length = float(np.linalg.norm(way))
    pitch, yaw = np.arccos(way[2] / length), np.arctan2(way[1], way[0])
    turned = (0.0, float(pitch), float(yaw))
    wide = random.uniform(0.02, 0.06)
    long = 0.7 * length
    every = (
        f'<cylinder radius="{wide:.4f}" length="{long:.4f}"/>',
        f'<box size="{1.6 * wide:.4f} {2.0 * wide:.4f} {long:.4f}"/>',
        f'<sphere radius="{wide:.4f}"/>',
    )
    chosen = random.choice(3, 1 + (random.random() < 0.2), replace=False)
    return tuple(Part(every[k], _vector(0.5 * way), turned) for k in chosen)


def random_obstacle(random: np.random.Generator, place: np.ndarray) -> Part:
    """A ball, a box or a cylinder at a place."""
    a, b, c = random.uniform(0.05, 0.3, 3)
    every = (
        f'<sphere radius="{a:.4f}"/>',
        f'<box size="{a:.4f} {b:.4f} {c:.4f}"/>',
        f'<cylinder radius="{0.5 * a:.4f}" length="{c:.4f}"/>',
    )
    return Part(every[random.integers(3)], _vector(place), _vector(random.uniform(-2, 2, 3)))


def arm_urdf(arm: Arm) -> str:
    """The robot as a URDF; joints `j1`.., links `base`, `link1`.., `tool`."""
    lines = ['<robot name="invented">', f'<link name="base">{_parts(arm.base)}</link>']
    for number, link in enumerate(arm.links, start=1):
        moments = zip(("ixx", "iyy", "izz", "ixy", "ixz", "iyz"), link.moments, strict=True)
        inertia = " ".join(f'{name}="{value!r}"' for name, value in moments)
        parent = "base" if number == 1 else f"link{number - 1}"
        lines += [
            f'<link name="link{number}"><inertial><origin xyz="{_words(link.com)}"/>'
            f'<mass value="{link.mass!r}"/><inertia {inertia}/></inertial>'
            f"{_parts(link.parts)}</link>",
            f'<joint name="j{number}" type="{link.kind}"><parent link="{parent}"/>'
            f'<child link="link{number}"/><origin xyz="{_words(link.xyz)}" '
            f'rpy="{_words(link.rpy)}"/><axis xyz="{_words(link.axis)}"/>'
            f'<limit lower="{link.lower!r}" upper="{link.upper!r}" effort="{link.effort!r}" '
            f'velocity="{link.velocity!r}"/></joint>',
        ]
    lines += [
        f'<link name="tool">{_parts(arm.tip)}</link>',
        f'<joint name="to_tool" type="fixed"><parent link="link{len(arm.links)}"/>'
        f'<child link="tool"/><origin xyz="{_words(arm.tool)}"/></joint></robot>',
    ]
    return "\n".join(lines)


def cell_urdf(parts: list[Part]) -> str:
    """Things that stand in a cell as a URDF, `thing1`.. on `cell`."""
    lines = ['<robot name="cell">', '<link name="cell"/>']
    for number, part in enumerate(parts, start=1):
        lines += [
            f'<link name="thing{number}">{_parts((part,))}</link>',
            f'<joint name="to{number}" type="fixed"><parent link="cell"/>'
            f'<child link="thing{number}"/></joint>',
        ]
    return "\n".join([*lines, "</robot>"])


def _parts(parts: tuple[Part, ...]) -> str:
    return "".join(
        f'<collision><origin xyz="{_words(part.xyz)}" rpy="{_words(part.rpy)}"/>'
        f"<geometry>{part.shape}</geometry></collision>"
        for part in parts
    )


def _words(values: Vector) -> str:
    return " ".join(repr(value) for value in values)


def _vector(values: np.ndarray) -> Vector:
    x, y, z = (float(value) for value in values)
    return x, y, z
