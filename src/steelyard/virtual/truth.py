r"""What a virtual robot really is: the parameters that identification should find.

Its torque is

$$\tau = \mathrm{ID}(q, \dot q, \ddot q) + I_r \ddot q + f_c \tanh(\dot q / v_s) + f_v \dot q + o.$$

The smoothing speed $v_s$ is there because a friction that jumps at zero speed makes an integration
with fixed steps chatter; it is some thousandths of the working speed.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from steelyard.arrays import Array, frozen
from steelyard.robot.inertia import INERTIAL_NAMES, Inertia
from steelyard.robot.robot import Robot
from steelyard.virtual.mujoco_model import TIMESTEP, build
from steelyard.virtual.scales import typical_inertia, typical_masses, typical_torque

_PER_JOINT = ("rotor_inertia", "coulomb", "viscous", "offset", "smoothing")
_LEAST_SMOOTHING = {"revolute": 0.005, "prismatic": 0.001}


@dataclass(frozen=True, eq=False)
class Truth:
    """The parameters of a virtual robot.

    Attributes:
        inertial: Ten numbers per body in Pinocchio's order, shape `(n_bodies, 10)`.
        rotor_inertia: Rotor inertia felt at the joint, shape `(n,)` [kg m²; kg].
        coulomb: Coulomb friction, shape `(n,)` [Nm; N].
        viscous: Viscous friction, shape `(n,)` [Nm s/rad; N s/m].
        offset: Constant torque, shape `(n,)` [Nm; N].
        smoothing: Speed over which Coulomb friction turns, shape `(n,)` [rad/s; m/s].
    """

    inertial: Array
    rotor_inertia: Array
    coulomb: Array
    viscous: Array
    offset: Array
    smoothing: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "inertial", frozen(self.inertial, (None, 10)))
        count = len(np.atleast_1d(self.rotor_inertia))
        for name in _PER_JOINT:
            object.__setattr__(self, name, frozen(getattr(self, name), (count,)))
        for name in ("rotor_inertia", "coulomb", "viscous"):
            if np.any(getattr(self, name) < 0.0):
                raise ValueError(f"{name} is negative")
        if not np.all(self.smoothing > 0.0):
            raise ValueError("smoothing is not positive")

    def friction(self, dq: Array) -> Array:
        """Coulomb, viscous and constant torque at velocities `dq`, shape `(..., n)`."""
        smooth = self.coulomb * np.tanh(dq / self.smoothing)
        return np.asarray(smooth + self.viscous * dq + self.offset)

    def to_dict(self, robot: Robot) -> dict[str, Any]:
        """As values for JSON, by the names of links and joints."""
        return {
            "schema": "steelyard-truth/1",
            "robot": robot.name,
            "links": {
                body.name: dict(zip(INERTIAL_NAMES, ten.tolist(), strict=True))
                for body, ten in zip(robot.bodies, self.inertial, strict=True)
            },
            "joints": {
                name: {key: float(getattr(self, key)[j]) for key in _PER_JOINT}
                for j, name in enumerate(robot.joint_names)
            },
        }

    @classmethod
    def from_dict(cls, values: Mapping[str, Any], robot: Robot) -> "Truth":
        """The inverse of `to_dict`."""
        links, joints = values["links"], values["joints"]
        inertial = [[links[body.name][key] for key in INERTIAL_NAMES] for body in robot.bodies]
        table = {key: [joints[name][key] for name in robot.joint_names] for key in _PER_JOINT}
        return cls(frozen(inertial), **{key: frozen(column) for key, column in table.items()})


def random_truth(robot: Robot, seed: int, spread: float = 0.15) -> Truth:
    """An invented truth near the robot's nominal model.

    Inertias are the nominal ones seen through a random deformation of the body, so they are
    those of a body that can exist; a link whose model file gives no mass properties, or impossible
    ones, becomes a ball of about 1 kg. Friction, rotor inertia and offset are drawn in proportion
    to the torques and inertias that each joint sees.

    Args:
        robot: The robot.
        seed: Same seed, same truth.
        spread: Size of the deformation; 0.15 moves masses and inertias by 20–30 %.
    """
    rng = np.random.default_rng(seed)
    inertial = [_deformed(_usable(b.inertia, b.known), rng, spread).ten for b in robot.bodies]
    bare = build(robot, inertial)
    masses = typical_masses(robot, bare)
    n, typical = robot.n, typical_torque(robot, bare)
    rotor = rng.uniform(0.2, 0.6, n) * typical_inertia(robot, masses)
    coulomb = rng.uniform(0.1, 0.25, n) * typical
    speed = np.array([min(c.limits.velocity, 2.0) for c in robot.coordinates])
    viscous = rng.uniform(0.1, 0.25, n) * typical / speed
    offset = rng.uniform(-0.03, 0.03, n) * typical
    smoothing = _smoothing(robot, masses + np.diag(rotor), coulomb)
    return Truth(frozen(inertial), rotor, coulomb, viscous, offset, smoothing)


def _usable(nominal: Inertia, known: bool) -> Inertia:
    """The nominal body, or a ball where there is none that can exist."""
    if nominal.flaw() is None and (known or nominal.mass > 0.0):
        return nominal
    return Inertia.about_com(1.0, [0.0, 0.0, 0.05], np.eye(3) * 1.5e-3)


def _deformed(nominal: Inertia, rng: np.random.Generator, spread: float) -> Inertia:
    r"""The body $J = L\,E E^T L^T$ with $J_0 = L L^T$ and $E$ random around the unit matrix.

    Any such $J$ is positive semidefinite: the body exists.
    """
    values, vectors = np.linalg.eigh(nominal.pseudo)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    deformed = root @ (np.eye(4) + spread * rng.standard_normal((4, 4)))
    return Inertia.from_pseudo(deformed @ deformed.T)


def _smoothing(robot: Robot, masses: Array, coulomb: Array) -> Array:
    r"""Smoothing speeds that an explicit step `h` of 0.125 ms follows, shape `(n,)`.

    Near zero speed Coulomb friction damps with $f_c / v_s$; the step is well inside its range of
    stability if $h\,(M^{-1})_{jj}\,f_c / v_s \le 1/2$ at every posture.
    """
    mobility = np.diagonal(np.linalg.inv(masses), axis1=1, axis2=2).max(axis=0)
    least = [_LEAST_SMOOTHING[c.kind] for c in robot.coordinates]
    return frozen(np.maximum(least, 2.0 * TIMESTEP * mobility * coulomb))
