r"""What of an identified model a model file holds, its friction fitted, and what is left out.

Along a coordinate all friction laws together give a curve $f(v)$, odd in speed. Where each of them
has a place, and a coefficient that is not negative, all stay as they are. Else what the format
holds of $f_c + d_1 v + d_2 v^2 + d_3 v^3$ is fitted to the whole curve by non-negative least
squares: a part of the laws alone may be several times the friction that they give together.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from steelyard.base.arrays import Array
from steelyard.base.errors import ModelError
from steelyard.estimate.covariance_and_band_widths import EDGES
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.model.terms.axes_and_fields import Axis
from steelyard.model.terms.term import AxisPartKind, Curve, Placed, Pull, listed, placed
from steelyard.robot.inertia_and_placement import INERTIAL_NAMES, LEAST_INERTIA, Inertia
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


EFFECTS: dict[AxisPartKind, tuple[str, int, str]] = {
    "rotor": ("rotor inertia", 2, "{inertia}"),
    "dry": ("dry friction", 1, "{effort}"),
    "viscous": ("viscous friction", 2, "{rate}"),
    "quadratic": ("friction with the square of speed", 3, "{force}/({speed})²"),
    "cubic": ("friction with the cube of speed", 4, "{force}/({speed})³"),
    "stiffness": ("stiffness of springs", 2, "{stiffness}"),
    "preload": ("preload of springs", 1, "{effort}"),
}
"""Words, with which power of `c` it acts on a joint `q` if it acts along `c q`, and its unit."""

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
            factor = c if part.kind == "preload" else abs(c) ** EFFECTS[part.kind][1]
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
    return Axis(joint.name, tuple(float(k == index) for k in range(robot.n_joints)), joint.kind)


def _multiple(axis: Axis) -> float | None:
    """The coefficient of the only joint that moves with an axis; `None` if there are more."""
    moving = [c for c in axis.row if c]
    return moving[0] if len(moving) == 1 else None


def _own(robot: Robot, axis: Axis) -> Axis:
    """The joint of which an axis is a multiple, or the axis."""
    c = _multiple(axis)
    return axis if c is None else joint_axis(robot, axis.row.index(c))


Format = Literal["urdf", "mjcf"]
FORMAT_NAMES: dict[Format, str] = {"urdf": "URDF", "mjcf": "MJCF"}

FLAT_MASS = 1e-13  # a body is none if its mass is spread this little in a direction, of its inertia
GRAVITY = (0.0, 0.0, -9.81)  # what readers of a URDF take for granted, in the base frame [m/s²]

SUPPORTED: dict[Format, tuple[AxisPartKind, ...]] = {
    "urdf": ("dry", "viscous"),
    "mjcf": tuple(EFFECTS),
}

FIT_HEADING = "nonlinear friction curve; fitted by the format's friction laws, largest error"
"""Heads the joints where not every law has a place."""

Effects = Mapping[AxisPartKind, float]


class Sum(NamedTuple):
    """What acts along a sum of several joints."""

    axis: Axis
    effects: Effects


@dataclass(frozen=True, eq=False)
class Content:
    """What a file of one format holds of a model."""

    robot: Robot
    inertias: tuple[Inertia, ...]
    joints: tuple[Effects, ...]  # what acts along each of `robot.joints`
    sums: tuple[Sum, ...]  # what acts along sums of joints
    pulls: tuple[Pull, ...]  # springs between links
    unsupported: tuple[str, ...]  # what the format does not support, one sentence each


def content_of(identified: IdentifiedModel, form: Format) -> Content:
    """What a file of a format holds of a model."""
    model, robot = identified.model, identified.model.robot
    values = _standard(identified)
    terms = [placed(term, robot, values) for term in model.terms]
    joints, sums, unsupported = _gathered(identified, terms, form)
    pulls, slack = _pulls(terms, form)
    scaled, scales = [], identified.effort_scales
    if scales is not None:
        scaled = [f"scales of the efforts: logged efforts are {scales.words} times as large"]
    inertias = tuple(_inertia(robot, k, values) for k in range(len(robot.bodies)))
    lost = [x for term in terms for x in term.unsupported]
    unsupported = (*_of_robot(robot, form), *scaled, *unsupported, *slack, *lost)
    return Content(robot, inertias, joints, sums, pulls, unsupported)


def carriers_of(robot: Robot) -> tuple[int, ...]:
    """Per joint of `robot.joints` the body that its own joint carries."""
    found: dict[int, int] = {}
    for index, body in enumerate(robot.bodies):
        if (body.ratio, body.offset) == (1.0, 0.0):
            found.setdefault(body.coordinate, index)
    found |= dict.fromkeys(range(robot.n_base), 0)
    for index, joint in enumerate(robot.joints):
        if index not in found:
            raise ModelError(
                f"joint '{joint.name}' moves bodies by mimic joints alone",
                where=f"robot '{robot.name}'",
                fix="include the joint that the mimic joints follow",
            )
    return tuple(found[index] for index in range(robot.n_joints))


def base_of(robot: Robot) -> str:
    """Name of the base link."""
    for frame in robot.frames:
        moved = frame.position.any() or not np.array_equal(frame.rotation, np.eye(3))
        if frame.body < 0 and not moved:
            return frame.name
    return "base" if "base" not in [body.name for body in robot.bodies] else "base_" + robot.name


def _standard(identified: IdentifiedModel) -> dict[str, float]:
    name, estimate = identified.model.robot.name, identified.estimate
    if estimate.standard is None:
        raise ModelError(
            "the model has base parameters only, not the mass and inertia of every link",
            where=f"model of '{name}', estimated by {estimate.estimator}",
            fix="remove method from [estimation] of the robot file (or --method) and identify "
            "again: the default estimator takes from the prior what the data do not determine",
        )
    if not identified.model.has_bodies:
        raise ModelError(
            "the model has no rigid bodies",
            where=f"terms of the model of '{name}'",
            fix='identify with "rigid_body" among the terms',
        )
    return identified.valued.values.as_dict()


def _inertia(robot: Robot, index: int, values: Mapping[str, float]) -> Inertia:
    """Mass properties of a physically consistent body; the least ones for one without mass."""
    name = robot.bodies[index].name
    inertia = Inertia.from_ten([values[f"{number}.{name}"] for number in INERTIAL_NAMES])
    if not inertia.ten.any():
        return Inertia.about_com(LEAST_INERTIA, np.zeros(3), LEAST_INERTIA * np.eye(3))
    flaw = inertia.flaw()
    if flaw is None:
        about = inertia.inertia_com
        spread = np.linalg.eigvalsh(0.5 * np.trace(about) * np.eye(3) - about)[0]
        if spread <= FLAT_MASS * np.trace(inertia.inertia_origin):
            flaw = "its pseudo-inertia is not positive definite: its mass lies in a plane or a line"
    if flaw is not None:
        raise ModelError(
            f"link '{name}' is not physically consistent: {flaw}",
            where=f"estimated mass properties of link '{name}'",
            fix="identify with the default estimator: its links are physically consistent",
        )
    return inertia


def _gathered(
    identified: IdentifiedModel, terms: Sequence[Placed], form: Format
) -> tuple[tuple[Effects, ...], tuple[Sum, ...], tuple[str, ...]]:
    """What acts along joints and along sums of them, and what is left out."""
    robot = identified.model.robot
    axes, totals, curves = merged(robot, terms)
    kept: dict[Row, dict[AxisPartKind, float]] = {row: {} for row in axes}
    unsupported: dict[str, list[str]] = {}
    for row, axis in axes.items():
        values = totals.get(row, {})
        if form == "mjcf" or sum(map(bool, row)) == 1:
            own = {kind: values.pop(kind) for kind in FRICTION_KINDS if kind in values}
            top = greatest_speed(identified, axis)
            forces = [along(axis, curve) for curve in curves.get(row, [])]
            supported = supported_friction(own, forces, SUPPORTED[form], top)
            kept[row] = supported.effects
            if supported.fit:
                errors = f"{supported.largest:.3g} {axis.effort_unit} (rms {supported.rms:.2g})"
                unsupported.setdefault(FIT_HEADING, []).append(
                    f"{axis.name} {errors} up to {top:.3g} {axis.speed_unit}"
                )
        else:
            for curve in curves.get(row, []):
                named = listed([(curve.axis.name, curve.value, curve.unit)])
                unsupported.setdefault(curve.words, []).append(named)
        for kind, value in values.items():
            if value != 0.0 and _fits(robot, axis, kind, value, values, form):
                kept[row][kind] = value
            elif value > 0.0 or value < -FRICTION_ROUNDING or kind == "preload":
                words, _, unit = EFFECTS[kind]
                named = listed([(axis.name, value, axis.unit(unit))])
                unsupported.setdefault(words, []).append(named)
    joints = [kept.get(joint_axis(robot, k).row, {}) for k in range(robot.n_joints)]
    sums = [Sum(axes[row], e) for row, e in kept.items() if sum(map(bool, row)) > 1 and e]
    left_out = ((what, ", ".join(filter(None, x))) for what, x in unsupported.items())
    return tuple(joints), tuple(sums), tuple(f"{what}: {x}" for what, x in left_out if x)


def _fits(
    robot: Robot, axis: Axis, kind: AxisPartKind, value: float, beside: Effects, form: Format
) -> bool:
    """Whether a format has a place for something along a coordinate."""
    if kind not in SUPPORTED[form] or (value < 0.0 and kind != "preload"):
        return False
    moving = [j for j, c in enumerate(axis.row) if c]
    if len(moving) > 1 and (form == "urdf" or (kind == "rotor" and not _chain(robot, moving))):
        return False
    return kind != "preload" or beside.get("stiffness", 0.0) > 0.0


def _chain(robot: Robot, joints: Iterable[int]) -> bool:
    """Whether the joints carry each other: MuJoCo couples inertia along chains only."""
    carriers = carriers_of(robot)
    bodies = {carriers[j] for j in joints}
    return bodies.issubset(robot.carriers(max(bodies)))


def _pulls(terms: Sequence[Placed], form: Format) -> tuple[tuple[Pull, ...], tuple[str, ...]]:
    """Springs between links that a format can hold, and those that it cannot."""
    supported, unsupported = [], []
    for pull in (pull for term in terms for pull in term.pulls):
        if form == "mjcf" and pull.stiffness > 0.0 and pull.preload >= 0.0:
            supported.append(pull)
        elif pull.stiffness or pull.preload:
            unsupported.append(
                f"spring between '{pull.links[0]}' and '{pull.links[1]}' ({pull.name}): "
                f"{pull.stiffness:.4g} N/m, preload {pull.preload:.4g} N"
            )
    return tuple(supported), tuple(unsupported)


def _of_robot(robot: Robot, form: Format) -> tuple[str, ...]:
    """What of the robot itself a format has no place for."""
    unsupported = []
    if form == "urdf" and not np.allclose(robot.gravity, GRAVITY, rtol=0.0, atol=1e-6):
        x, y, z = robot.gravity
        frame = "world" if robot.floating else "base frame"
        unsupported.append(f"gravity: set it to ({x:.6g}, {y:.6g}, {z:.6g}) m/s² in the {frame}")
    if form == "urdf" and robot.loops:
        names = ", ".join(loop.name for loop in robot.loops)
        unsupported.append(f"closed loops: the file has the open kinematic tree without {names}")
    if form == "mjcf" and any(np.isfinite(c.limits.velocity) for c in robot.joints):
        unsupported.append("speed limits of the joints")
    if robot.transmission is not None:
        words = "coupled gears" if robot.transmission.coupled else "gears"
        unsupported.append(f"{words}: efforts are those of the joints, not of the motors")
    return tuple(unsupported)
