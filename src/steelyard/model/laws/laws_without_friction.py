"""Laws that are no friction: bodies and rotors; springs and cogging, by position alone; offset."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from steelyard.base.arrays import Array, Parameter
from steelyard.base.errors import ModelError, advice
from steelyard.model.equations import inverse_dynamics as rigid
from steelyard.model.equations.inverse_dynamics import JointState, Scalar, Scalars
from steelyard.model.terms import axes_and_fields as fields
from steelyard.model.terms import term as terms
from steelyard.model.terms.axes_and_fields import Axes, Field
from steelyard.model.terms.term import ActsOnAxes, Cause, Dissipation, Place, Placed
from steelyard.robot.inertia_and_placement import INERTIAL_NAMES, INERTIAL_UNITS
from steelyard.robot.robot import Robot
from steelyard.symbolic.symbols_and_tracing import Symbol, number_of
from steelyard.symbolic.tape_and_derivatives import Tape, backward, edges


def body_efforts(robot: Robot, state: JointState, numbers: Scalars) -> list[Scalar]:
    """Efforts of the bodies, from their numbers one after another; frames have none."""
    tens = [
        [0.0] * 10 if body.massless else numbers[10 * k : 10 * k + 10]
        for k, body in enumerate(robot.bodies)
    ]
    return rigid.inverse_dynamics(robot, state, tens)


@dataclass(frozen=True)
class RigidBody(terms.Term):
    r"""Newton-Euler torques of all bodies, $\tau = Y(q, \dot q, \ddot q)\,\phi$.

    Ten numbers per body, about the origin of its link frame, in Pinocchio's order; those of a frame
    between the joints of one body are zero and have no columns. The columns are
    the reverse derivative of the inverse dynamics, so they exist over symbols only; arrays go
    through the traced program.
    """

    law: ClassVar[str] = "rigid_body"
    dissipation: ClassVar[Dissipation] = "none"
    cause: ClassVar[Cause] = "inertia"
    role: ClassVar[terms.Role] = "body"
    shown_by: ClassVar[str] = "acceleration, one by one and together, of the joints up to"

    def parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        """Ten per body, named like `Izz.forearm`."""
        return tuple(
            Parameter(
                f"{name}.{body.name}",
                unit,
                lower=0.0 if name in ("m", "Ixx", "Iyy", "Izz") else float("-inf"),
                prior=float(value) if body.known else None,
            )
            for body in robot.bodies
            for name, unit, value in zip(
                INERTIAL_NAMES, INERTIAL_UNITS, body.inertia.ten, strict=True
            )
        )

    def columns(self, robot: Robot, state: JointState) -> terms.Columns:
        """Reverse derivative of the inverse dynamics, without what is zero by structure."""
        tape = Tape.current()
        numbers = [tape.variable() for _ in range(10 * len(robot.bodies))]
        flat: list[Scalar] = [Symbol(tape, number) for number in numbers]
        efforts = [number_of(tape, x) for x in body_efforts(robot, state, flat)]
        between, one = edges(tape, numbers), tape.constant(1.0)
        entries: dict[tuple[int, int], Scalar] = {}
        for row, effort in enumerate(efforts):
            slopes = backward(tape, between, {effort: one})
            for column, number in enumerate(numbers):
                if number in slopes and tape.known.get(slopes[number]) != 0.0:
                    entries[row, column] = Symbol(tape, slopes[number])
        return entries

    @staticmethod
    def numbers_of(robot: Robot, values: Mapping[str, float]) -> Array:
        """Ten numbers per body from those that are named, others zero, shape `(10 n_bodies,)`."""
        return np.array([values.get(p.name, 0.0) for p in RigidBody().parameters(robot)])

    def in_model_files(self, robot: Robot, values: terms.Values) -> Placed:
        """Nothing beside the bodies, which every format holds."""
        return Placed()


@dataclass(frozen=True)
class RotorInertia(ActsOnAxes):
    r"""Rotor inertia, $f = I_a\,a$ with the coordinate's acceleration $a$ [kg m²; kg].

    On a joint it is the inertia reflected through the gear. Gyroscopic effects of the spinning
    rotors are neglected, as is customary above a gear ratio of about 30 [Khalil2002, ch. 9].
    """

    law: ClassVar[str] = "rotor_inertia"
    dissipation: ClassVar[Dissipation] = "none"
    cause: ClassVar[Cause] = "inertia"
    shown_by: ClassVar[str] = "stronger acceleration of"
    in_model_files: ClassVar[Place] = terms.as_one("rotor")
    units: ClassVar[Mapping[str, str]] = {"": "{inertia}"}
    symbol: ClassVar[str] = "IA"
    role: ClassVar[terms.Role] = "rotor"
    on_motors: ClassVar[bool] = True
    """Rotors turn before the gears, whatever coordinates they are given along."""
    shares: ClassVar[Mapping[str, tuple[float, float]]] = {"rotor_inertia": (0.2, 0.6)}

    def efforts(self, axes: Axes, state: JointState) -> Scalars:
        """The coordinate's acceleration."""
        return [axis.of(state.ddq) for axis in axes]

    def typical_values(self, robot: Robot, at_torque: Array, inertia: terms.MovedInertia) -> Array:
        """The inertia that each coordinate moves."""
        return np.array([inertia(axis) for axis in self.axes(robot)])


@dataclass(frozen=True)
class Offset(ActsOnAxes):
    r"""Constant effort, $f = o$ [Nm; N if prismatic]."""

    law: ClassVar[str] = "offset"
    dissipation: ClassVar[Dissipation] = "none"
    cause: ClassVar[Cause] = "offset"
    shown_by: ClassVar[str] = "motion both ways of"
    in_model_files: ClassVar[Place] = terms.left_out("constant efforts")
    lower: ClassVar[float] = float("-inf")
    symbol: ClassVar[str] = "OFF"
    shares: ClassVar[Mapping[str, tuple[float, float]]] = {"offset": (-0.03, 0.03)}

    def efforts(self, axes: Axes, state: JointState) -> Scalars:
        """One."""
        return [0.0 * axis.of(state.dq) + 1.0 for axis in axes]


@dataclass(frozen=True)
class Spring(ActsOnAxes):
    r"""Spring along a coordinate, $f = k\,(x - x_0)$, the effort that holds it [N m/rad; N/m].

    With `free = "unknown"` the torque is $f = k\,x - p$ with a preload $p = k\,x_0$, a parameter of
    its own. A preload and the term `offset` on one coordinate cannot be distinguished.
    """

    law: ClassVar[str] = "spring"
    dissipation: ClassVar[Dissipation] = "none"
    cause: ClassVar[Cause] = "spring"
    shown_by: ClassVar[str] = "other configurations of"
    # position $x_0$ where the spring is free, one for all or one per coordinate [rad; m], or
    # `unknown`
    free: float | tuple[float, ...] | str = 0.0

    def __post_init__(self) -> None:
        numbers = self.free if isinstance(self.free, tuple) else (self.free,)
        known = all(isinstance(x, float | int) and abs(x) < float("inf") for x in numbers)
        if self.free != "unknown" and not known:
            raise fields.unfit(
                f"term 'spring' has free = {self.free!r}",
                "give the position where the spring is free [rad; m], one for all or a list, "
                'or free = "unknown"',
            )

    def parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        """Stiffness per coordinate, not negative; then the preloads, where they are unknown."""
        axes = self.axes(robot)
        stiffness = fields.each(axes, self.law, "{stiffness}", lower=0.0)
        if self.free != "unknown":
            return stiffness
        return (*stiffness, *fields.each(axes, f"{self.law}_preload", "{effort}"))

    def efforts(self, axes: Axes, state: JointState) -> Scalars:
        """The stretch; with unknown free positions, the position and minus one."""
        positions = [axis.of(state.q) for axis in axes]
        if self.free == "unknown":
            return [*positions, *(0.0 * x - 1.0 for x in positions)]
        return [x - free for x, free in zip(positions, self._free(axes), strict=True)]

    def in_model_files(self, robot: Robot, values: terms.Values) -> Placed:
        """Stiffness and preload."""
        stiffness = terms.under(self, robot, values, self.law, "stiffness")
        if self.free == "unknown":
            preload = terms.under(self, robot, values, f"{self.law}_preload", "preload")
            return Placed((*stiffness, *preload))
        pairs = zip(stiffness, self._free(self.axes(robot)), strict=True)
        return Placed(
            (*stiffness, *(terms.AxisPart(p.axis, "preload", p.value * x) for p, x in pairs))
        )

    def _free(self, axes: Axes) -> tuple[float, ...]:
        if not isinstance(self.free, tuple):
            return (float(self.free),) * len(axes)
        if len(self.free) != len(axes):
            raise fields.unfit(
                f"term 'spring' has {len(self.free)} free positions for {len(axes)} coordinates",
                "give one position for all, or a list with one per coordinate",
            )
        return self.free


@dataclass(frozen=True)
class PolynomialSpring(ActsOnAxes):
    r"""Square and cube of a position, $f = k_2\,x^2 + k_3\,x^3$: springs and cables that stiffen.

    With `spring` and `offset` beside it, a polynomial of the third degree along the coordinate.
    """

    law: ClassVar[str] = "polynomial_spring"
    dissipation: ClassVar[Dissipation] = "none"
    cause: ClassVar[Cause] = "spring"
    shown_by: ClassVar[str] = "other configurations of"
    in_model_files: ClassVar[Place] = terms.left_out("efforts of a polynomial in the position")
    lower: ClassVar[float] = float("-inf")
    units: ClassVar[Mapping[str, str]] = {"_2": "{force}/{position}²", "_3": "{force}/{position}³"}

    def efforts(self, axes: Axes, state: JointState) -> Scalars:
        """Squares of all positions, then cubes."""
        positions = [axis.of(state.q) for axis in axes]
        return [*(x * x for x in positions), *(x * x * x for x in positions)]


@dataclass(frozen=True)
class Cogging(ActsOnAxes):
    r"""Effort with a period in the position, $f = a\sin(2\pi x/p) + b\cos(2\pi x/p)$ [Nm; N].

    Of a motor with $c$ equal poles or teeth behind gears of ratio $r$ the period at the joint is
    $p = 2\pi / (c\,r)$ [rad]; a check of the residuals finds it.
    """

    law: ClassVar[str] = "cogging"
    dissipation: ClassVar[Dissipation] = "none"
    cause: ClassVar[Cause] = "spring"
    shown_by: ClassVar[str] = "slow motion over several periods of"
    in_model_files: ClassVar[Place] = terms.left_out("efforts periodic in the position")
    lower: ClassVar[float] = float("-inf")
    units: ClassVar[Mapping[str, str]] = {"_sin": "{effort}", "_cos": "{effort}"}
    shares: ClassVar[Mapping[str, tuple[float, float]]] = {
        "cogging_sin": (-0.1, 0.1),
        "cogging_cos": (-0.1, 0.1),
    }
    period: Field = 0.1  # $p$, one for all or one per coordinate [rad; m]

    def __post_init__(self) -> None:
        fields.refuse_not_positive(self.law, period=self.period)

    def efforts(self, axes: Axes, state: JointState) -> Scalars:
        """Sines of all axes, then cosines."""
        periods = fields.per_axis(self.period, axes, self.law)
        phases = [2.0 * np.pi / p * axis.of(state.q) for axis, p in zip(axes, periods, strict=True)]
        return [*(np.sin(x) for x in phases), *(np.cos(x) for x in phases)]


SHORT = 1e-18  # added to a squared length [m²], so that its root has a slope where the points meet

EXAMPLE = """give the springs' ends in the frames of their links [m]: \
{law = "gravity_compensator", links = ["base", "upper_arm"], \
points = [[-0.2, 0.0, 0.4], [0.0, 0.0, 0.3]]}"""


@dataclass(frozen=True)
class GravityCompensator(terms.Term):
    r"""Spring between two points, $f = k\,L(q) - p$; a joint bears $f\,\partial L / \partial q_j$.

    $L$ is the distance of the points; the spring is free at $L_0 = p/k$. It is the effort that
    holds the mechanism against the spring.
    """

    law: ClassVar[str] = "gravity_compensator"
    dissipation: ClassVar[Dissipation] = "none"
    cause: ClassVar[Cause] = "spring"
    shown_by: ClassVar[str] = "other configurations of the joints between the links of"
    name: str = ""  # name, for the parameters; the links' names if left out
    links: tuple[str, ...] = ()  # the two links
    points: tuple[tuple[float, ...], ...] = ()  # one point per link, in its frame [m]

    def __post_init__(self) -> None:
        for key in ("links", "points"):
            if not getattr(self, key):
                raise _unusable(f"without its geometry: `{key}` is missing")
        if not isinstance(self.name, str):
            raise _unusable(f"with the name {self.name!r}")
        links = self.links
        if not isinstance(links, tuple) or list(map(type, links)) != [str, str]:
            raise _unusable(f"between the links {self.links!r}")
        values: Array = np.zeros(0)
        with suppress(TypeError, ValueError):
            values = np.array(self.points, dtype=np.float64)
        if values.shape != (2, 3) or not np.isfinite(values).all():
            raise _unusable(f"between the points {self.points!r}")

    @property
    def _name(self) -> str:
        return self.name or "-".join(self.links)

    def parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        """Stiffness, not negative, and preload."""
        return (
            Parameter(f"{self.law}.{self._name}", "N/m", lower=0.0),
            Parameter(f"{self.law}_preload.{self._name}", "N"),
        )

    def columns(self, robot: Robot, state: JointState) -> terms.Columns:
        """The slopes of half the squared length, and minus those of the length."""
        length, slopes = self.length(robot, state.q)
        return {
            **{(joint, 0): length * slope for joint, slope in slopes.items()},
            **{(joint, 1): -slope for joint, slope in slopes.items()},
        }

    def in_model_files(self, robot: Robot, values: terms.Values) -> Placed:
        """A spring between points."""
        stiffness, preload = (values[p.name] for p in self.parameters(robot))
        return Placed(pulls=(terms.Pull(self._name, self.links, self.points, stiffness, preload),))

    def length(self, robot: Robot, q: Any) -> tuple[Scalar, dict[int, Scalar]]:
        """The spring's length [m] at all joints `q`, and its slopes by joints that stretch it."""
        (first, near), (second, far) = (
            _on_body(robot, *end) for end in zip(self.links, self.points, strict=True)
        )
        if first == second:
            raise _unusable(f"between '{self.links[0]}' and '{self.links[1]}', which move as one")
        near_side, far_side = robot.apart(first, second)
        fork = robot.bodies[(near_side or far_side)[0]].parent
        start, start_slopes = rigid.carried_point(robot, q, first, near, fork)
        end, end_slopes = rigid.carried_point(robot, q, second, far, fork)
        line = end - start
        length = np.sqrt(line[0] * line[0] + line[1] * line[1] + line[2] * line[2] + SHORT)
        slopes: dict[int, Scalar] = {}
        for joint in sorted({*start_slopes, *end_slopes}):
            rate = end_slopes.get(joint, 0.0) - start_slopes.get(joint, 0.0)
            along = line[0] * rate[0] + line[1] * rate[1] + line[2] * rate[2]
            slopes[joint] = along / length
        return length, slopes


def _on_body(robot: Robot, link: str, point: tuple[float, ...]) -> tuple[int, Any]:
    """The body that carries a link, and the point in the body's frame."""
    for frame in robot.frames:
        if frame.name == link:
            return frame.body, frame.rotation @ np.array(point) + frame.position
    bodies = [body.name for body in robot.bodies]
    if link in bodies:
        return bodies.index(link), np.array(point)
    raise fields.unfit(
        f"a gravity compensator is fixed to link '{link}', which the robot does not have",
        advice(link, dict.fromkeys([*(frame.name for frame in robot.frames), *bodies]), "links"),
        robot,
    )


def _unusable(what: str) -> ModelError:
    return fields.unfit(f"a gravity compensator {what}", EXAMPLE)
