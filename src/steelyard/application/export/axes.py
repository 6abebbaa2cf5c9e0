"""What acts along joints and along sums of them, summed up over the laws."""

from collections.abc import Iterable

from steelyard.application.export.friction import Force
from steelyard.robot.robot import Robot
from steelyard.terms.axes import Axis
from steelyard.terms.model_files import Curve, Kind, Placed

POWERS: dict[Kind, tuple[str, int]] = {
    "rotor": ("rotor inertia", 2),
    "dry": ("dry friction", 1),
    "viscous": ("viscous friction", 2),
    "quadratic": ("friction with the square of speed", 3),
    "cubic": ("friction with the cube of speed", 4),
    "stiffness": ("stiffness of springs", 2),
    "preload": ("preload of springs", 1),
}
"""Words, and with which power of `c` it acts on a joint `q` if it acts along `c q`."""

Row = tuple[float, ...]
"""Coefficients of a coordinate, one per joint of `robot.joints`."""


def merged(
    robot: Robot, terms: Iterable[Placed]
) -> tuple[dict[Row, Axis], dict[Row, dict[Kind, float]], dict[Row, list[Curve]]]:
    """Coordinates by row, what acts along them, and friction over their speed.

    What acts along a multiple of one joint acts on the joint.
    """
    axes: dict[Row, Axis] = {}
    totals: dict[Row, dict[Kind, float]] = {}
    curves: dict[Row, list[Curve]] = {}
    for part in (part for term in terms for part in term.parts):
        axis = _own(robot, part.axis)
        c, factor = _multiple(part.axis), 1.0
        if c is not None:
            factor = c if part.kind == "preload" else abs(c) ** POWERS[part.kind][1]
        axes.setdefault(axis.row, axis)
        mine = totals.setdefault(axis.row, {})
        mine[part.kind] = mine.get(part.kind, 0.0) + factor * part.value
    for curve in (curve for term in terms for curve in term.curves):
        axis = _own(robot, curve.axis)
        axes.setdefault(axis.row, axis)
        curves.setdefault(axis.row, []).append(curve)
    return axes, totals, curves


def along(axis: Axis, curve: Curve) -> Force:
    """Friction over the speed of the joint of which a curve's coordinate is a multiple."""
    c = 1.0 if curve.axis.row == axis.row else abs(_multiple(curve.axis) or 1.0)
    return lambda speeds: c * curve.force(c * speeds)


def joint_axis(robot: Robot, index: int) -> Axis:
    """A joint of `robot.joints` as a coordinate."""
    joint = robot.joints[index]
    row = tuple(float(k == index) for k in range(robot.n_joints))
    return Axis(joint.name, row, joint.kind)


def _multiple(axis: Axis) -> float | None:
    """The coefficient of the only joint that moves with an axis; `None` if there are more."""
    moving = [c for c in axis.row if c]
    return moving[0] if len(moving) == 1 else None


def _own(robot: Robot, axis: Axis) -> Axis:
    """The joint of which an axis is a multiple, or the axis."""
    c = _multiple(axis)
    return axis if c is None else joint_axis(robot, axis.row.index(c))
