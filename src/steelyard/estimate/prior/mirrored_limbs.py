r"""Limbs that are mirror images of each other: pairs of links, and what is equal in them.

Links are paired by kinematics, with all joints at zero: a link's joint is where the mirror image of
the other's is, its axis along that of the other's image or against it, and what carries them is
itself paired, or on the plane. Names decide only where several links fit. With $R, p$ the frame of
one link, $R', p'$ that of the other and the mirror $S$, the image of a point $x$ of the first is at
$R'^T S R\, x + R'^T (S p - p')$ in the second, at all positions of the joints that are images.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from difflib import SequenceMatcher
from typing import Literal

import numpy as np

from steelyard.base.arrays import Z95, Array
from steelyard.base.errors import ModelError
from steelyard.estimate.estimate import Estimate
from steelyard.estimate.information.base_parameters_and_regressor import BaseMap
from steelyard.estimate.prior.body_priors import Row, rigid_bodies
from steelyard.model.model import Model
from steelyard.robot.inertia_and_placement import INERTIAL_NAMES, Inertia, turn
from steelyard.robot.robot import Body, Robot

Plane = Literal["xy", "xz", "yz"]
NORMALS: dict[Plane, int] = {"xy": 2, "xz": 1, "yz": 0}

FAR = 2e-3  # distance of a joint from the image of another up to which they are a pair [m]
ALIKE = 1e-3  # difference of directions, likewise
TINY = 1e-12  # factor of an image that is rounding
OF_JOINTS = ("rotor_inertia", "coulomb", "viscous")
"""Parameters of joints that are equal in mirrored limbs."""


@dataclass(frozen=True, eq=False)
class Pair:
    """Two bodies, by number, and how the ten numbers of the first make those of the second."""

    one: int
    other: int
    image: Array  # `(10, 10)`


def mirrored_links(robot: Robot, plane: Plane) -> tuple[Pair, ...]:
    """Pairs of links across a plane of the base, in both orders; links on it are their own."""
    mirror = np.eye(3)
    mirror[NORMALS[plane], NORMALS[plane]] = -1.0
    frames = _frames(robot)
    partner: dict[int, int] = {-1: -1}
    for k, body in enumerate(robot.bodies):
        rotation, position = frames[k]
        fits = []
        for j, other in enumerate(robot.bodies):
            if other.kind != body.kind or partner.get(body.parent) != other.parent:
                continue
            turned, place = frames[j]
            axis, image = turned @ other.axis, mirror @ rotation @ body.axis
            along = min(np.abs(axis - image).max(), np.abs(axis + image).max())
            if np.linalg.norm(place - mirror @ position) < FAR and along < ALIKE:
                fits.append(j)
        if fits:
            partner[k] = max(fits, key=lambda j: _similar(body.name, robot.bodies[j].name, j == k))
    found = []
    for k, j in partner.items():
        if k < 0 or partner.get(j) != k or robot.bodies[k].massless:
            continue
        (first, at), (second, place) = frames[k], frames[j]
        rotation, position = second.T @ mirror @ first, second.T @ (mirror @ at - place)
        columns = [Inertia.from_ten(x).moved(rotation, position).ten for x in np.eye(10)]
        found.append(Pair(k, j, np.array(columns).T))
    return tuple(found)


def _similar(name: str, other: str, same: bool) -> float:
    """Of several links that fit, that on the plane itself first, then the likest name."""
    return 2.0 if same else SequenceMatcher(None, name, other).ratio()


def _frames(robot: Robot) -> list[tuple[Array, Array]]:
    """Axes `(3, 3)` and origin `(3,)` of each body in the base frame, joints at zero."""
    found: list[tuple[Array, Array]] = []
    for body in robot.bodies:
        axes, origin = found[body.parent] if body.parent >= 0 else (np.eye(3), np.zeros(3))
        rotation, position = _joint(body)
        found.append((axes @ rotation, axes @ position + origin))
    return found


def _joint(body: Body) -> tuple[Array, Array]:
    if body.kind == "prismatic":
        return body.rotation, body.position + body.rotation @ body.axis * body.offset
    return body.rotation @ turn(body.axis, body.offset), body.position


def symmetry_rows(model: Model, plane: Plane, where: str) -> list[Row]:
    """Ten equations for each pair of links, and those of their rotors; a `ModelError` of none."""
    bodies, names = model.robot.bodies, set(model.names)
    known, rows = rigid_bodies(model), list[Row]()
    pairs = [pair for pair in mirrored_links(model.robot, plane) if pair.one < pair.other]
    for pair in pairs:
        one, other = bodies[pair.one], bodies[pair.other]
        label = f"links '{one.name}' and '{other.name}' mirror each other ({where})"
        if {pair.one, pair.other} <= known.keys():
            rows += image_rows(label, one.name, other.name, pair.image)
        rotors = [f"{OF_JOINTS[0]}.{body.joint}" for body in (one, other)]
        if names.issuperset(rotors):
            rows.append(Row(label, {rotors[1]: 1.0, rotors[0]: -1.0}, 0.0, 0.0))
    if not pairs:
        raise ModelError(
            f"no link of '{model.robot.name}' is the mirror image of another across the {plane} "
            "plane of its base, with all joints at zero",
            where=where,
            fix="give the plane that mirrors its limbs, xy, xz or yz; or name pairs as "
            '[[knowledge]] kind = "mirrored"',
        )
    return rows


def image_rows(label: str, one: str, other: str, image: Array) -> list[Row]:
    """Ten equations: the numbers of a link are those of another one behind an image `(10, 10)`."""
    rows = []
    for name, factors in zip(INERTIAL_NAMES, image.tolist(), strict=True):
        each = zip(INERTIAL_NAMES, factors, strict=True)
        given = {f"{x}.{one}": -a for x, a in each if abs(a) > TINY}
        rows.append(Row(label, {f"{name}.{other}": 1.0, **given}, 0.0, 0.0))
    return rows


@dataclass(frozen=True)
class Sides:
    """A base parameter of one side beside the image of that of the other.

    Attributes:
        name: Its name on one side.
        value: What it is.
        image: What the other side says that it is.
        half_width: Of the 95 % interval of their difference.
        known: Half of the 95 % interval of their mean.
    """

    name: str
    value: float
    image: float
    half_width: float
    known: float

    @property
    def variation(self) -> float:
        """Coefficient of variation of both: standard deviation over mean."""
        mean = 0.5 * abs(self.value + self.image)
        return float(abs(self.value - self.image) / np.sqrt(2.0) / max(mean, 1e-300))

    @property
    def sure(self) -> bool:
        """Whether their mean is known to `SURE` of itself."""
        return self.known <= SURE * 0.5 * abs(self.value + self.image)


SURE = 0.03  # half of the 95 % interval over the value, up to which a parameter is compared


def compared_sides(base: BaseMap, robot: Robot, estimate: Estimate, plane: Plane) -> list[Sides]:
    """Parameters of mirrored limbs, each with its image on the other side."""
    pairs = mirrored_links(robot, plane)
    image, lift = _image(base, robot, pairs), base.lift
    known = estimate.parameters.as_dict()
    at = [k for k, name in enumerate(base.base_names) if name in known]
    names = [base.base_names[k] for k in at]
    values, covariance = np.array([known[n] for n in names]), estimate.covariance_of(names)
    once = {name for k in _first(pairs) for name in (robot.bodies[k].name, robot.bodies[k].joint)}
    found = []
    for place, k in enumerate(at):
        name = base.base_names[k]
        if name.partition(".")[2] not in once or name.partition(".")[0] == "offset":
            continue
        wanted = lift[k] @ image
        weights = np.linalg.lstsq(lift[at].T, wanted, rcond=None)[0]
        if np.abs(weights @ lift[at] - wanted).max() > 1e-6 * np.abs(wanted).max():
            continue
        apart, mean = -weights, 0.5 * weights
        apart[place] += 1.0
        mean[place] += 0.5
        half, sure = (Z95 * np.sqrt(max(x @ covariance @ x, 0.0)) for x in (apart, mean))
        other = float(weights @ values)
        found.append(Sides(name, float(values[place]), other, float(half), float(sure)))
    return found


def _first(pairs: Sequence[Pair]) -> list[int]:
    return [pair.one for pair in pairs if pair.one < pair.other]


def _image(base: BaseMap, robot: Robot, pairs: Sequence[Pair]) -> Array:
    """Standard parameters of the mirrored robot `(p, p)`, of those of the robot."""
    place = {name: k for k, name in enumerate(base.names)}
    found = np.eye(len(place))
    for pair in pairs:
        one, other = robot.bodies[pair.one], robot.bodies[pair.other]
        tens = [[place.get(f"{x}.{b.name}", -1) for x in INERTIAL_NAMES] for b in (one, other)]
        if min(map(min, tens)) >= 0:
            found[tens[1]] = 0.0
            found[np.ix_(tens[1], tens[0])] = pair.image
        for kind in OF_JOINTS:
            first, second = (place.get(f"{kind}.{body.joint}", -1) for body in (one, other))
            if min(first, second) >= 0 and first != second:
                found[second] = 0.0
                found[second, first] = 1.0
    return found


def symmetry_note(base: BaseMap, robot: Robot, estimate: Estimate, plane: Plane) -> str:
    """How far both sides of a free estimate are apart, for people to read."""
    sides = [one for one in compared_sides(base, robot, estimate, plane) if one.sure]
    if not sides:
        return f"no parameter is known well enough to compare both sides of the {plane} plane"
    worst = max(sides, key=lambda one: abs(one.value - one.image) / max(one.half_width, 1e-300))
    inside = sum(abs(one.value - one.image) <= one.half_width for one in sides)
    usual = 100.0 * float(np.median([one.variation for one in sides]))
    return (
        f"without symmetry as prior knowledge, both sides of the {plane} plane have "
        f"{len(sides)} parameters known to {100.0 * SURE:g} %, with a coefficient of variation of "
        f"{usual:.2g} % (median); {inside} agree within 95 % intervals; farthest apart: "
        f"{worst.name}, {worst.value:.4g} and {worst.image:.4g}"
    )
