"""A spring between two points of the mechanism, such as carries a heavy arm."""

from contextlib import suppress
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from steelyard.base.arrays import Array, Parameter
from steelyard.base.errors import ModelError, advice
from steelyard.model.equations.inverse_dynamics import JointState, Scalar, carried_point
from steelyard.model.terms.axes import unfit
from steelyard.model.terms.term import Cause, Columns, Dissipation, Term
from steelyard.model.terms.terms_in_model_files import Placed, Pull, Values
from steelyard.robot.robot import Robot

SHORT = 1e-18  # added to a squared length [m²], so that its root has a slope where the points meet

EXAMPLE = """give the springs' ends in the frames of their links [m]: \
{law = "gravity_compensator", links = ["base", "upper_arm"], \
points = [[-0.2, 0.0, 0.4], [0.0, 0.0, 0.3]]}"""


@dataclass(frozen=True)
class GravityCompensator(Term):
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

    def columns(self, robot: Robot, state: JointState) -> Columns:
        """The slopes of half the squared length, and minus those of the length."""
        length, slopes = self.length(robot, state.q)
        return {
            **{(joint, 0): length * slope for joint, slope in slopes.items()},
            **{(joint, 1): -slope for joint, slope in slopes.items()},
        }

    def in_model_files(self, robot: Robot, values: Values) -> Placed:
        """A spring between points."""
        stiffness, preload = (values[p.name] for p in self.parameters(robot))
        return Placed(pulls=(Pull(self._name, self.links, self.points, stiffness, preload),))

    def length(self, robot: Robot, q: Any) -> tuple[Scalar, dict[int, Scalar]]:
        """The spring's length [m] at all joints `q`, and its slopes by joints that stretch it."""
        (first, near), (second, far) = (
            _on_body(robot, *end) for end in zip(self.links, self.points, strict=True)
        )
        if first == second:
            raise _unusable(f"between '{self.links[0]}' and '{self.links[1]}', which move as one")
        shared = [k for k in robot.carriers(first) if k in robot.carriers(second)]
        fork = shared[-1] if shared else -1
        start, start_slopes = carried_point(robot, q, first, near, fork)
        end, end_slopes = carried_point(robot, q, second, far, fork)
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
    known = dict.fromkeys([*(frame.name for frame in robot.frames), *bodies])
    raise unfit(
        f"a gravity compensator is fixed to link '{link}', which the robot does not have",
        advice(link, known, "links"),
        robot,
    )


def _unusable(what: str) -> ModelError:
    return unfit(f"a gravity compensator {what}", EXAMPLE)
