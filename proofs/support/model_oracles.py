"""What another reader makes of a model file: Pinocchio of a URDF; for an MJCF see `mujoco_oracle`.

Oracles give torques and regressors of the file's tree by joint names, and how its followers follow.
`cleaned` puts rounded angles right, as the reader says it does (entries of a rotation or an axis
below `ROUNDED` are zero).
"""

import copy
from collections.abc import Mapping
from typing import Any, NamedTuple, Protocol
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from steelyard.base.arrays import Array

ROUNDED = 2e-5
"""`1.5708` for pi/2 leaves 4e-6."""


class Following(NamedTuple):
    """`position = ratio * master's position + offset`."""

    master: str
    ratio: float
    offset: float


class Oracle(Protocol):
    """A tree by names of its joints with one degree of freedom.

    Attributes:
        joints: Names.
        following: Of joints that follow others, how.
        rest: Positions of joints that nobody speaks of [rad; m].
    """

    joints: tuple[str, ...]
    following: Mapping[str, Following]
    rest: Mapping[str, float]

    def pull(self, gravity: Array) -> None:
        """Set gravity [m/s²] in the root's frame."""

    def torque(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Torques of bodies and gravity alone; all shapes `(n_joints, N)`."""

    def regressor(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Of all bodies' ten numbers, shape `(n_joints, N, p)`."""

    def gaps(self, q: Array) -> tuple[Array, Array, Any]:
        """Of pins at a state `(n_joints,)`: gaps `(c,)`, slopes `(c, n_joints)`, and their rate."""


class PinocchioOracle:
    """A tree of Pinocchio."""

    def __init__(self, model: Any, following: Mapping[str, Following]) -> None:
        self.model = model
        self.data = self.model.createData()
        single = [k for k in range(1, self.model.njoints) if self.model.joints[k].nv == 1]
        self.joints = tuple(self.model.names[k] for k in single)
        self._columns = [self.model.joints[k].idx_v for k in single]
        self._places = [(self.model.joints[k].idx_q, self.model.joints[k].nq) for k in single]
        self.following = following
        self.rest = dict.fromkeys(self.joints, 0.0)

    def pull(self, gravity: Array) -> None:
        """Set gravity [m/s²] in the root's frame."""
        self.model.gravity.linear = np.array(gravity)

    def torque(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Torques of bodies and gravity alone; all shapes `(n_joints, N)`."""
        states = (self._state(*x) for x in zip(q.T, dq.T, ddq.T, strict=True))
        return np.array([pin.rnea(self.model, self.data, *s)[self._columns] for s in states]).T

    def regressor(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Of all bodies' ten numbers, shape `(n_joints, N, p)`."""
        found = [
            pin.computeJointTorqueRegressor(self.model, self.data, *self._state(*x))
            for x in zip(q.T, dq.T, ddq.T, strict=True)
        ]
        full = np.array(found).reshape(q.shape[1], self.model.nv, -1)
        return np.asarray(full[:, self._columns].transpose(1, 0, 2))

    def gaps(self, q: Array) -> tuple[Array, Array, Any]:
        """Of pins at one state, see `Oracle`."""
        return np.zeros(0), np.zeros((0, len(q))), lambda dq: np.zeros(0)

    def _state(self, q: Array, dq: Array, ddq: Array) -> tuple[Array, Array, Array]:
        at = pin.neutral(self.model)
        for x, (place, count) in zip(q, self._places, strict=True):
            at[place : place + count] = [x] if count == 1 else [np.cos(x), np.sin(x)]
        v, a = np.zeros((2, self.model.nv))
        v[self._columns], a[self._columns] = dq, ddq
        return at, v, a


def urdf_oracle(root: Any, cleaned: bool) -> PinocchioOracle:
    """Pinocchio's tree of a URDF's elements."""
    following = {
        joint.get("name"): _following(mimic)
        for joint in root.findall("joint")
        if (mimic := joint.find("mimic")) is not None and joint.get("type") != "fixed"
    }
    return PinocchioOracle(pin.buildModelFromXML(_urdf_text(root, cleaned)), following)


def _following(mimic: Any) -> Following:
    return Following(
        mimic.get("joint"), float(mimic.get("multiplier", 1.0)), float(mimic.get("offset", 0.0))
    )


def _urdf_text(root: Any, cleaned: bool) -> str:
    """Links and joints alone; limits that Pinocchio wants to see are added."""
    robot = ElementTree.Element("robot", name="oracle")
    for element in root:
        if element.tag not in ("link", "joint"):
            continue
        kept = copy.deepcopy(element)
        for child in list(kept):
            if child.tag in ("visual", "collision", "mimic", "safety_controller", "calibration"):
                kept.remove(child)
        if kept.tag == "joint" and (limit := kept.find("limit")) is not None:
            kept.remove(limit)
        if kept.tag == "joint" and kept.get("type") in ("revolute", "prismatic"):
            ElementTree.SubElement(kept, "limit", lower="-9", upper="9", effort="1", velocity="1")
        if cleaned:
            for child in kept.iter():
                _clean(child)
        robot.append(kept)
    return ElementTree.tostring(robot, encoding="unicode")


def _clean(element: Any) -> None:
    if element.tag == "origin" and element.get("rpy"):
        turned = pin.rpy.rpyToMatrix(np.array([float(x) for x in element.get("rpy").split()]))
        element.set("rpy", _words(pin.rpy.matrixToRpy(without_dirt(turned))))
    if element.tag == "axis" and element.get("xyz"):
        axis = np.array([float(x) for x in element.get("xyz").split()])
        element.set("xyz", _words(np.where(np.abs(axis) < ROUNDED * np.abs(axis).max(), 0.0, axis)))


def _words(values: Array) -> str:
    return " ".join(repr(float(x)) for x in values)


def without_dirt(rotation: Array) -> Array:
    """The rotation nearest to the matrix without its small entries."""
    left, _, right = np.linalg.svd(np.where(np.abs(rotation) < ROUNDED, 0.0, rotation))
    return np.asarray(left @ right)
