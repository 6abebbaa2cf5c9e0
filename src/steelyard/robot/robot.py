"""The robot as the dynamics see it: a tree of bodies, fixed or floating, frames, its JSON form."""

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass, field, is_dataclass, replace
from typing import Any, Final, Literal

import numpy as np

from steelyard.base.arrays import Array, frozen, set_fields
from steelyard.base.checked_arguments import built
from steelyard.base.errors import ModelError
from steelyard.robot.inertia_and_placement import Inertia, skew

JointKind = Literal["revolute", "prismatic"]
BodyJointKind = Literal["revolute", "prismatic", "floating"]

FLOATING: Final = "floating"
"""Stands for the base of a robot whose base no joint carries."""

OpenLoops = Literal["stop", "drop"]
"""What to do where a loop cannot close: stop with an error, or drop the sample."""


@dataclass(frozen=True)
class Limits:
    """Range of one joint: position [rad; m], speed [rad/s; m/s], effort [Nm; N]; inf if unknown."""

    lower: float = -np.inf
    upper: float = np.inf
    velocity: float = np.inf
    effort: float = np.inf


@dataclass(frozen=True)
class Coordinate:
    """One independent joint coordinate: what a log has a position and an effort column for."""

    name: str
    kind: JointKind
    limits: Limits = field(default_factory=Limits)

    @property
    def unit(self) -> str:
        """Unit of the position."""
        return "m" if self.kind == "prismatic" else "rad"

    @property
    def effort_unit(self) -> str:
        """Unit of the joint's generalised force."""
        return "N" if self.kind == "prismatic" else "Nm"


BASE_COORDINATES = (
    *(Coordinate(f"base_{axis}", "prismatic") for axis in "xyz"),
    *(Coordinate(f"base_r{axis}", "revolute") for axis in "xyz"),
)
"""The first coordinates of a floating robot: their efforts are the force on its base and the moment
about the origin of its base frame, along the axes of that frame."""


@dataclass(frozen=True, eq=False)
class Body:
    """A moving body and the joint that carries it.

    The body's frame is the joint's frame. At position `x` of the joint, a point `p` of the body is
    at `rotation @ (turn(axis, x) @ p) + position` in the parent's frame (revolute), or at `rotation
    @ (p + axis * x) + position` (prismatic). `x = ratio * q[coordinate] + offset`, so a mimic joint
    is a body that follows its master's coordinate. A `floating` body is the base of a floating
    robot, its first body; it has all `BASE_COORDINATES`, and its frame is the base frame.

    `parent` is an index, -1 the base; `rotation` `(3, 3)` and `position` `(3,)` [m] are the joint's
    frame in the parent's, `axis` `(3,)` is a unit vector in the joint's. `inertia` is the nominal
    one (prior), fixed links included, zero unless it is `known` from the model file; a `massless`
    body is only a frame between the joints of one body, without parameters.
    """

    name: str
    joint: str
    kind: BodyJointKind
    parent: int
    rotation: Array
    position: Array
    axis: Array
    coordinate: int
    ratio: float = 1.0
    offset: float = 0.0
    inertia: Inertia = field(default_factory=Inertia.zero)
    known: bool = False
    massless: bool = False

    def __post_init__(self) -> None:
        rotation, position = frozen(self.rotation, (3, 3)), frozen(self.position, (3,))
        set_fields(self, rotation=rotation, position=position, axis=frozen(self.axis, (3,)))
        if not np.isclose(np.linalg.norm(self.axis), 1.0):
            raise ValueError(f"axis of joint '{self.joint}' is not a unit vector: {self.axis}")


@dataclass(frozen=True, eq=False)
class Frame:
    """A frame fixed to a body, -1 the base, such as a link that merged into it.

    `rotation` `(3, 3)` has its axes and `position` `(3,)` [m] its origin in the body's frame.
    """

    name: str
    body: int
    rotation: Array
    position: Array

    def __post_init__(self) -> None:
        rotation, position = frozen(self.rotation, (3, 3)), frozen(self.position, (3,))
        set_fields(self, rotation=rotation, position=position)


@dataclass(frozen=True, eq=False)
class Transmission:
    r"""Gears between motors and joints, $q_m = R\,q$, so that $\tau = R^T \tau_m$.

    The matrix $R$, `(n, n)`, has motor positions per joint position; it can be inverted.
    """

    motors: tuple[str, ...]
    matrix: Array

    def __post_init__(self) -> None:
        count = len(self.motors)
        set_fields(self, matrix=frozen(self.matrix, (count, count)))
        if np.linalg.matrix_rank(self.matrix) < count:
            raise ValueError("the transmission matrix cannot be inverted")

    @property
    def coupled(self) -> bool:
        """Whether a motor turns with more than its own joint."""
        return bool(np.any(self.matrix != np.diag(np.diag(self.matrix))))


@dataclass(frozen=True, eq=False)
class LoopClosure:
    """A pin: a point [m] of one body, in its frame, stays on a point of another; -1 is the base."""

    name: str
    bodies: tuple[int, int]
    points: Array

    def __post_init__(self) -> None:
        set_fields(self, points=frozen(self.points, (2, 3)))


@dataclass(frozen=True, eq=False, repr=False)
class Robot:
    r"""A tree of bodies on a fixed or a floating base, whose chains pins may close.

    Of a floating robot the first six coordinates are those of its base, `BASE_COORDINATES`: in `dq`
    its linear and its angular velocity, in `ddq` the proper acceleration $a - g$ of its origin, as
    an accelerometer there measures it, and the angular acceleration; all along its own axes. In `q`
    their entries are not used: neither place nor heading of the base enters the dynamics, and its
    inclination only as the direction of $g$.

    Attributes:
        name: The robot's name.
        bodies: Parents before children.
        coordinates: Independent joint coordinates, in the order of every `q`, `dq`, `ddq`, `tau`.
        gravity: Shape `(3,)` [m/s²], in the base frame; in the world's if the base floats.
        passive: Coordinates that the loops determine; bodies count them on after `coordinates`.
        loops: The pins.
        assembly: Positions of all joints near which the loops close, shape `(n_joints,)`.
        transmission: Gears between motors and joints; `None` if motors are not spoken of.
        frames: Named frames on the bodies.
        open_loops: What to do where measured positions cannot close a loop.

    Example:
        >>> load_robot("arm.toml").robot.joint_names
        ('joint1', 'joint2')
    """

    name: str
    bodies: tuple[Body, ...]
    coordinates: tuple[Coordinate, ...]
    gravity: Array = field(default_factory=lambda: frozen((0.0, 0.0, -9.81)))
    _: KW_ONLY
    passive: tuple[Coordinate, ...] = ()
    loops: tuple[LoopClosure, ...] = ()
    assembly: Array = None  # type: ignore[assignment]  # all joints at zero
    transmission: Transmission | None = None
    frames: tuple[Frame, ...] = ()
    open_loops: OpenLoops = "stop"

    def __repr__(self) -> str:
        return f"Robot('{self.name}', {self.n} joints)"

    def __post_init__(self) -> None:
        for name in ("bodies", "coordinates", "passive", "loops", "frames"):
            set_fields(self, **{name: tuple(getattr(self, name))})
        start = np.zeros(self.n_joints) if self.assembly is None else self.assembly
        set_fields(
            self, gravity=frozen(self.gravity, (3,)), assembly=frozen(start, (self.n_joints,))
        )
        for index, body in enumerate(self.bodies):
            if not -1 <= body.parent < index:
                raise ValueError(f"body '{body.name}' comes before its parent")
            if not 0 <= body.coordinate < self.n_joints:
                raise ValueError(f"body '{body.name}' follows a coordinate that does not exist")
            if body.kind == "floating" and (index, body.coordinate) != (0, 0):
                raise ValueError(f"body '{body.name}' floats, but is not the first one")
        carriers = [*(f.body for f in self.frames), *(b for x in self.loops for b in x.bodies)]
        if not all(-1 <= body < len(self.bodies) for body in carriers):
            raise ValueError("a frame or a loop is on a body that does not exist")
        if self.transmission is not None and len(self.transmission.motors) != self.n:
            raise ValueError(f"{len(self.transmission.motors)} motors for {self.n} joints")

    def changed(self, **fields: Any) -> "Robot":
        """The same robot with some of its attributes replaced."""
        return replace(self, **fields)

    def carriers(self, body: int) -> list[int]:
        """Indices of the bodies from the base's child to a body, itself included; none for -1."""
        line: list[int] = []
        while body >= 0:
            line.append(body)
            body = self.bodies[body].parent
        return line[::-1]

    def apart(self, first: int, second: int) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Bodies that carry one of two bodies and not the other, itself included, down to each."""
        mine, theirs = self.carriers(first), self.carriers(second)
        shared = {*mine} & {*theirs}
        mine, theirs = ([k for k in line if k not in shared] for line in (mine, theirs))
        return tuple(mine), tuple(theirs)

    @property
    def n(self) -> int:
        """Number of independent joint coordinates."""
        return len(self.coordinates)

    @property
    def floating(self) -> bool:
        """Whether the base floats."""
        return bool(self.bodies) and self.bodies[0].kind == "floating"

    @property
    def n_base(self) -> int:
        """Number of coordinates of the base: six if it floats, else none."""
        return len(BASE_COORDINATES) if self.floating else 0

    @property
    def joints(self) -> tuple[Coordinate, ...]:
        """All joint coordinates, those that loops determine last."""
        return (*self.coordinates, *self.passive)

    @property
    def n_joints(self) -> int:
        """Number of all joint coordinates."""
        return len(self.coordinates) + len(self.passive)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the coordinates."""
        return tuple(c.name for c in self.coordinates)

    @property
    def effort_units(self) -> tuple[str, ...]:
        """`Nm` or `N` per coordinate."""
        return tuple(c.effort_unit for c in self.coordinates)

    @property
    def nominal(self) -> Array:
        """The ten nominal numbers of every body, shape `(n_bodies, 10)`."""
        return frozen(np.array([b.inertia.ten for b in self.bodies]).reshape(len(self.bodies), 10))


def bodies_along(robot: Robot, q: Array) -> tuple[list[Array], list[Array]]:
    """Axes `(N, 3, 3)` and origins `(N, 3)` [m] of base and bodies; joints `q` `(N, n_joints)`."""
    count = len(q)
    rotations = [np.broadcast_to(np.eye(3), (count, 3, 3))]
    origins = [np.zeros((count, 3))]
    for body in robot.bodies:
        turn, origin = rotations[body.parent + 1], origins[body.parent + 1]
        own, slide = moved_by_joint(body, body.ratio * q[:, body.coordinate] + body.offset)
        origins.append(origin + (turn @ (body.position + slide)[..., None])[..., 0])
        rotations.append(turn @ own)
    return rotations, origins


def frame_origins(robot: Robot, frames: Sequence[Frame], joints: Array) -> Array:
    """Origins of frames, shape `(N, F, 3)` [m], at positions of all joints `(N, n_joints)`."""
    rotations, origins = bodies_along(robot, joints)
    at = [origins[f.body + 1] + rotations[f.body + 1] @ f.position for f in frames]
    return np.stack(at, axis=1)


def sticks(robot: Robot, joints: Array) -> Array:
    """The robot as one broken line from each joint to the next, with a gap of NaN behind each.

    Shape `(N, 3 bodies, 3)` [m] at positions `(N, n_joints)`; without `N` at one posture.
    """
    at = frame_origins(robot, body_frames(robot), np.atleast_2d(joints))
    found = np.full((len(at), 3 * len(robot.bodies), 3), np.nan)
    found[:, 0::3] = at[:, [body.parent + 1 for body in robot.bodies]]
    found[:, 1::3] = at[:, 1:]
    return found if joints.ndim > 1 else np.asarray(found[0])


def tips(robot: Robot, joints: Array) -> Array:
    """Lines from the last joints to the centres of mass of the bodies that they carry.

    With gaps, `(N, 3 last bodies, 3)` [m], at positions `(N, n_joints)`.
    """
    last = sorted(set(range(len(robot.bodies))) - {body.parent for body in robot.bodies})
    centre = [
        Frame(body.name, k, np.eye(3), body.inertia.com)
        for k, body in enumerate(robot.bodies)
        if k in last and not body.massless
    ]
    at = frame_origins(robot, [*body_frames(robot), *centre], joints)
    found = np.full((len(at), 3 * len(centre), 3), np.nan)
    found[:, 0::3] = at[:, [frame.body + 1 for frame in centre]]
    found[:, 1::3] = at[:, len(robot.bodies) + 1 :]
    return found


def refuse_floating(robot: Robot, what: str) -> None:
    """Refuse a robot with a floating base where one at rest is needed."""
    if robot.floating:
        raise ModelError(
            f"{what} needs a robot whose base is at rest, and the base of '{robot.name}' floats",
            where=f"robot '{robot.name}'",
            fix="it is done for robots with a fixed base only; if a link really was at rest, name "
            f'it instead of "{FLOATING}", such as base = "{robot.bodies[0].name}"',
        )


def body_frames(robot: Robot) -> list[Frame]:
    """Of the base and of all bodies."""
    names = ["base", *(body.name for body in robot.bodies)]
    return [Frame(name, k - 1, np.eye(3), np.zeros(3)) for k, name in enumerate(names)]


def moved_by_joint(body: Body, x: Array) -> tuple[Array, Array]:
    """Rotations `(N, 3, 3)` and shifts `(N, 3)` of a body in its parent's frame, at `x` `(N,)`."""
    if body.kind == "floating":
        return np.broadcast_to(np.eye(3), (len(x), 3, 3)), np.zeros((len(x), 3))
    if body.kind == "prismatic":
        slide = x[:, None] * (body.rotation @ body.axis)
        return np.broadcast_to(body.rotation, (len(x), 3, 3)), slide
    k = skew(body.axis)
    sine, versine = np.sin(x)[:, None, None], (1.0 - np.cos(x))[:, None, None]
    first, second = body.rotation @ k, body.rotation @ k @ k
    return body.rotation + sine * first + versine * second, np.zeros((len(x), 3))


_IN_FILES = "name gravity coordinates bodies passive loops assembly open_loops transmission frames"


def robot_to_dict(robot: Robot) -> dict[str, Any]:
    """Everything a robot is, as JSON values; unknown limits are left out."""
    return {name: _json(getattr(robot, name)) for name in _IN_FILES.split()}


def _json(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, tuple):
        return [_json(x) for x in value]
    if isinstance(value, Limits):
        return {name: x for name, x in vars(value).items() if np.isfinite(x)}
    if isinstance(value, Inertia):
        return value.ten.tolist()
    if not is_dataclass(value):
        return value
    return {k: _json(x) for k, x in vars(value).items() if k != "massless" or x}


def robot_from_dict(data: dict[str, Any]) -> Robot:
    """The robot that `robot_to_dict` wrote."""

    def coordinates(key: str) -> tuple[Coordinate, ...]:
        return tuple(
            built(Coordinate, **{**c, "limits": built(Limits, **c["limits"])}) for c in data[key]
        )

    bodies, gears = data["bodies"], data["transmission"]
    return Robot(
        data["name"],
        tuple(
            built(Body, **{**body, "inertia": Inertia.from_ten(body["inertia"])}) for body in bodies
        ),
        coordinates("coordinates"),
        data["gravity"],
        passive=coordinates("passive"),
        loops=tuple(LoopClosure(d["name"], tuple(d["bodies"]), d["points"]) for d in data["loops"]),
        assembly=data["assembly"],
        open_loops=data["open_loops"],
        transmission=gears and Transmission(tuple(gears["motors"]), gears["matrix"]),
        frames=tuple(built(Frame, **frame) for frame in data["frames"]),
    )
