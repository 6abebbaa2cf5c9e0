"""Springs on the coordinates themselves, linear and stiffening."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from steelyard.base.arrays import Parameter
from steelyard.model.equations.inverse_dynamics import JointState, Scalars
from steelyard.model.terms.axes import Axes, each, unfit
from steelyard.model.terms.term import ActsOnAxes, Cause, Dissipation
from steelyard.model.terms.terms_in_model_files import (
    AxisPart,
    Place,
    Placed,
    Values,
    left_out,
    under,
)
from steelyard.robot.robot import Robot


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
            raise unfit(
                f"term 'spring' has free = {self.free!r}",
                "give the position where the spring is free [rad; m], one for all or a list, "
                'or free = "unknown"',
            )

    def parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        """Stiffness per coordinate, not negative; then the preloads, where they are unknown."""
        axes = self.axes(robot)
        stiffness = each(axes, self.law, "{stiffness}", lower=0.0)
        if self.free != "unknown":
            return stiffness
        return (*stiffness, *each(axes, f"{self.law}_preload", "{effort}"))

    def efforts(self, axes: Axes, state: JointState) -> Scalars:
        """The stretch; with unknown free positions, the position and minus one."""
        positions = [axis.of(state.q) for axis in axes]
        if self.free == "unknown":
            return [*positions, *(0.0 * x - 1.0 for x in positions)]
        return [x - free for x, free in zip(positions, self._free(axes), strict=True)]

    def in_model_files(self, robot: Robot, values: Values) -> Placed:
        """Stiffness and preload."""
        stiffness = under(self, robot, values, self.law, "stiffness")
        if self.free == "unknown":
            preload = under(self, robot, values, f"{self.law}_preload", "preload")
            return Placed((*stiffness, *preload))
        free = self._free(self.axes(robot))
        pairs = zip(stiffness, free, strict=True)
        return Placed((*stiffness, *(AxisPart(p.axis, "preload", p.value * x) for p, x in pairs)))

    def _free(self, axes: Axes) -> tuple[float, ...]:
        if not isinstance(self.free, tuple):
            return (float(self.free),) * len(axes)
        if len(self.free) != len(axes):
            raise unfit(
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
    in_model_files: ClassVar[Place] = left_out("efforts of a polynomial in the position")
    lower: ClassVar[float] = float("-inf")
    units: ClassVar[Mapping[str, str]] = {
        "_2": "{force}/{position}²",
        "_3": "{force}/{position}³",
    }

    def efforts(self, axes: Axes, state: JointState) -> Scalars:
        """Squares of all positions, then cubes."""
        positions = [axis.of(state.q) for axis in axes]
        return [*(x * x for x in positions), *(x * x * x for x in positions)]
