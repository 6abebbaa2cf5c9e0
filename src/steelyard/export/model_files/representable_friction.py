r"""Friction and other forces along joints, in the laws that a model format has.

Along a coordinate all laws together give a curve $f(v)$, odd in speed. Where each of them has a
place, and a coefficient that is not negative, all stay as they are. Else what the format holds of
$f_c + d_1 v + d_2 v^2 + d_3 v^3$ is fitted to the whole curve by non-negative least squares: a part
of the laws alone may be several times the friction that they give together.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from steelyard.base.arrays import Array
from steelyard.estimate.effort_uncertainty import EDGES
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.model.terms.axes import Axis
from steelyard.model.terms.terms_in_model_files import AxisPartKind, Curve, Placed
from steelyard.robot.robot import Robot

FRICTION_KINDS: tuple[AxisPartKind, ...] = ("dry", "viscous", "quadratic", "cubic")
"""By power of speed."""

NEGLIGIBLE = 1e-6  # share of the greatest friction up to the greatest speed that is zero
FRICTION_ROUNDING = 1e-9  # friction this little is a solver's rounding, and zero [Nm; N]
FITTED = np.linspace(0.0, 1.0, 201)[1:]  # speeds of a fit, over the greatest

COMPARED = np.concatenate([np.geomspace(1e-4, 5e-3, 30), np.linspace(5e-3, 1.0, 1000)])
"""Speeds at which a fit is compared with the curve, over the greatest."""

UNKNOWN_SPEED = 1.0  # greatest speed where neither logs nor limits give one [rad/s; m/s]
Force = Callable[[Array], Array]  # friction at speeds above zero


class Supported(NamedTuple):
    """What a format supports of the friction along a coordinate."""

    effects: dict[AxisPartKind, float]  # coefficients by kind, above zero
    fit: bool = False  # whether they are a fit
    # largest difference to the friction of the model up to the greatest speed [Nm; N]
    largest: float = 0.0
    rms: float = 0.0  # root mean square of the difference over these speeds [Nm; N]


def supported_friction(
    own: Mapping[AxisPartKind, float],
    others: Sequence[Force],
    kinds: Iterable[AxisPartKind],
    top: float,
) -> Supported:
    """Friction along a coordinate in what a format supports, up to a greatest speed [rad/s; m/s].

    `own` are coefficients of the powers of speed, `others` what else there is of friction.
    """

    def curve(v: Array) -> Array:
        powers = [x * v ** FRICTION_KINDS.index(kind) for kind, x in own.items()]
        return np.asarray(sum([*powers, *(force(v) for force in others)], np.zeros_like(v)))

    whole, places = curve(top * FITTED), [kind for kind in FRICTION_KINDS if kind in kinds]
    least = max(NEGLIGIBLE * float(np.abs(whole).max()), FRICTION_ROUNDING)
    sizes = {kind: x * top ** FRICTION_KINDS.index(kind) for kind, x in own.items()}
    kept = {kind: own[kind] for kind, size in sizes.items() if abs(size) > least}
    beside = any(np.abs(force(top * FITTED)).max() > least for force in others)
    if not beside and all(x > 0.0 and kind in places for kind, x in kept.items()):
        return Supported(kept)
    effects = _fitted(whole, places, least, top)
    left = curve(top * COMPARED)
    for kind, x in effects.items():
        left -= x * (top * COMPARED) ** FRICTION_KINDS.index(kind)
    rms = np.sqrt(np.trapezoid(np.square(left), COMPARED))
    return Supported(effects, True, float(np.abs(left).max()), float(rms))


def _fitted(
    whole: Array, places: Sequence[AxisPartKind], least: float, top: float
) -> dict[AxisPartKind, float]:
    """Coefficients that are not negative, and not negligible, nearest to a curve at `FITTED`."""
    from scipy.optimize import nnls

    powers = np.array([FRICTION_KINDS.index(kind) for kind in places])
    sizes = nnls(FITTED[:, None] ** powers, whole)[0]
    return {
        kind: float(size / top**power)
        for kind, power, size in zip(places, powers, sizes, strict=True)
        if size > least
    }


def greatest_speed(identified: IdentifiedModel, axis: Axis) -> float:
    """Greatest speed along a coordinate in the fitted logs, or that of the limits [rad/s; m/s].

    Rows of long logs stand far apart; speed is then at least that of the sine of the same root mean
    square, where the calibration of the bands has them.
    """
    robot, row = identified.model.robot, np.array(axis.row)
    speeds = [0.0]
    if not row[robot.n :].any():
        mine = row[: robot.n]
        for samples in identified.motions:
            t, x = np.diff(samples.t), np.diff(samples.q @ mine)
            near = (t > 0.0) & (t < 1.5 * samples.step)
            speeds += (np.abs(x[near]) / t[near]).tolist()
        if identified.calibration is not None:
            typical = identified.calibration.edges[:, 0] / EDGES[0]
            speeds.append(float(np.sqrt(2.0) * np.linalg.norm(mine * typical)))
    if max(speeds) > 0.0:
        return max(speeds)
    limit = sum(abs(c) * x.limits.velocity for c, x in zip(row, robot.joints, strict=True) if c)
    return float(limit) if 0.0 < limit < np.inf else UNKNOWN_SPEED


POWERS: dict[AxisPartKind, tuple[str, int]] = {
    "rotor": ("rotor inertia", 2),
    "dry": ("dry friction", 1),
    "viscous": ("viscous friction", 2),
    "quadratic": ("friction with the square of speed", 3),
    "cubic": ("friction with the cube of speed", 4),
    "stiffness": ("stiffness of springs", 2),
    "preload": ("preload of springs", 1),
}
"""Words, and with which power of `c` it acts on a joint `q` if it acts along `c q`."""

Row = tuple[float, ...]  # coefficients of a coordinate, one per joint of `robot.joints`


def merged(
    robot: Robot, terms: Iterable[Placed]
) -> tuple[dict[Row, Axis], dict[Row, dict[AxisPartKind, float]], dict[Row, list[Curve]]]:
    """Coordinates by row, what acts along them, and friction over their speed.

    What acts along a multiple of one joint acts on the joint.
    """
    axes: dict[Row, Axis] = {}
    totals: dict[Row, dict[AxisPartKind, float]] = {}
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
