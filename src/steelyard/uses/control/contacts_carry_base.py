r"""Forces of contacts that carry a floating base along a motion, and joint torques with them.

No motor drives the base: its six rows of the equations are met by the wrenches $F$ of contacts,
$\tau_b = J_b^T F$, and the joints have the torques $\tau_j - J_j^T F$. Where $F$ is not given, the
contacts share $\tau_b$ in a way that the motion does not determine; taken are the least forces,
$F = (J_b^T)^+ \tau_b$.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from steelyard.base.arrays import Array
from steelyard.base.errors import DataError, refuse_unknown
from steelyard.base.motion import Motion, numbers
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.model.equations.frame_and_point_kinematics import frame_of
from steelyard.robot.file.signals import BaseSignals, Touch
from steelyard.robot.robot import BASE_COORDINATES, Robot, robot_to_dict
from steelyard.runs.contact_projection import Touching
from steelyard.runs.floating_base import of_angles, with_base_motion

SHARED_NOTE = (
    "the contacts share the force and the moment on the base by the least forces; how real legs "
    "share them depends on their stiffness and on the floor"
)
MOST_MISSING = 0.02  # force on the base that no contact gives, over the weight, that is told
MOST_ASIDE = 0.01  # moment on the base that no contact gives, over the weight, that is told [m]
_BASE = len(BASE_COORDINATES)
_BLOCK = 2000  # samples whose Jacobians are in memory together


@dataclass(frozen=True, eq=False)
class CarriedBase:
    """What carries the base along a motion of `N` samples, and torques of the joints with it.

    `forces` are of the world on contacts by name, along the axes of the base: `(N, 3)` [N], of a
    sole with the moment about the point that touches, `(N, 6)` [N, Nm]. `missing` is what no
    contact gives of force and moment on the base, `(N, 6)` [N, Nm]; `up` the vertical along the
    base's axes, `(N, 3)`, `None` where it is not known; `weight` that of the robot [N], NaN where
    it is not seen.
    """

    torque: Array  # of the joints, shape `(N, n)` [Nm; N]
    forces: Mapping[str, Array]
    missing: Array
    up: Array | None
    weight: float

    def loads(self) -> Iterator[tuple[str, float, float, float]]:
        """Of each contact: its name, least and largest load [N], and the friction that it needs."""
        for name, force in self.forces.items():
            if self.up is None:
                size = np.linalg.norm(force[:, :3], axis=1)
                yield name, float(size.min()), float(size.max()), np.nan
                continue
            load = np.einsum("ni,ni->n", force[:, :3], self.up)
            along = np.linalg.norm(force[:, :3] - load[:, None] * self.up, axis=1)
            needed = along / np.maximum(load, 1e-9)
            yield (
                name,
                float(load.min()),
                float(load.max()),
                float(needed[load > 0.0].max(initial=0)),
            )

    def warnings(self, t: Array) -> Iterator[str]:
        """What speaks against the motion at times `(N,)` [s]: forces that contacts cannot give."""
        for part, most, unit in ((slice(0, 3), MOST_MISSING, "N"), (slice(3, 6), MOST_ASIDE, "Nm")):
            size = np.linalg.norm(self.missing[:, part], axis=1)
            if size.max() > most * self.weight:
                k = int(size.argmax())
                yield (
                    f"the contacts do not carry the base: {size[k]:.3g} {unit} are missing at "
                    f"{t[k]:.3f} s, of a robot of {self.weight:.4g} N: it cannot move so"
                )
        for name, least, _, _ in self.loads():
            if self.up is not None and least < 0.0:
                yield f"{name} would have to pull the floor by up to {-least:.3g} N"


def base_motion_of_table(base: BaseSignals, robot: Robot, motion: Motion) -> tuple[Motion, Array]:
    """The motion as the equations take it, and the vertical along the base's axes `(N, 3)`.

    Of a table whose base has its place in the world, then roll, pitch and yaw, as `excite` writes.
    """
    tracked = replace(
        base, translation=("x", "y", "z"), tracked=True, angular_velocity=(),
        axes=tuple(np.eye(3).ravel()), place=(0.0, 0.0, 0.0), gravity=tuple(robot.gravity),
    )  # fmt: skip
    q, dq, ddq = with_base_motion(tracked, motion.q.T, motion.dq.T, motion.ddq.T)
    return Motion(motion.t, q.T, dq.T, ddq.T), of_angles(motion.q[:, 3:_BASE].T)[:, 2]


def carried_base(
    identified: IdentifiedModel,
    motion: Motion,
    efforts: Array,
    up: Array | None,
    contacts: Sequence[str] | None,
    forces: Mapping[str, ArrayLike] | None,
) -> CarriedBase:
    """Torques of the joints where contacts carry the base.

    Args:
        identified: The model; its robot file names the contacts.
        motion: The motion with the base's in its first columns.
        efforts: Of the base and the joints without contacts, shape `(N, 6 + n)` [N, Nm].
        up: The vertical along the base's axes, shape `(N, 3)`.
        contacts: Frames of the robot file's contacts that carry; if `None` all of them, none of a
            robot that a hoist or a hand holds by an unknown wrench.
        forces: Of the world on frames, instead: along the base's axes, `(N, 3)` or with the moment
            about the frame's origin `(N, 6)` [N, Nm].
    """
    base, robot = identified.signals.base, identified.robot
    assert base is not None
    given: Array | None = None
    if forces is not None:
        shapes = [(len(motion), 3), (len(motion), 6)]
        listed = {name: numbers(f"forces of {name}", x, shapes) for name, x in forces.items()}
        touches = tuple(_at_frame(frame_of(robot, n).name, x.shape[1]) for n, x in listed.items())
        given = np.hstack([np.zeros((len(motion), 0)), *listed.values()])
    else:
        held = contacts is None and not base.wrench_known
        touches = () if held else _standing(base, robot, contacts)
    if up is None and any(touch.radius > 0.0 for touch in touches):
        raise DataError(
            "where a ball touches depends on the orientation of the base, which the samples of a "
            "motion do not have",
            where="motion",
            fix="give the motion as a file, with q_base_rx, q_base_ry and q_base_rz, or forces",
        )
    vertical = np.zeros((len(motion), 3)) if up is None else up
    every, torque, missing = list[Array](), list[Array](), list[Array]()
    for first in range(0, len(motion), _BLOCK):
        part = slice(first, first + _BLOCK)
        count = len(efforts[part])
        touching = Touching(
            replace(base, touches=touches, tree=robot_to_dict(robot)),
            np.ones(robot.n),
            np.ones((len(touches), count), dtype=np.bool_),
            vertical[part].T,
        )
        jacobian = touching.jacobian(motion.q[part].T)[:, : sum(map(_width, touches))]
        if given is not None:
            force = given[part]
        else:
            inverse = np.linalg.pinv(jacobian[:, :, :_BASE].transpose(0, 2, 1))
            force = np.einsum("nij,nj->ni", inverse, efforts[part, :_BASE])
        rest = efforts[part] - np.einsum("nmi,nm->ni", jacobian, force)
        every.append(force)
        torque.append(rest[:, _BASE:])
        missing.append(rest[:, :_BASE])
    ends = np.cumsum([_width(touch) for touch in touches])[:-1]
    split = np.split(np.concatenate(every), ends, axis=1) if touches else []
    named, weight = dict(zip(_names(touches), split, strict=True)), np.nan
    if base.wrench_known:
        mass = identified.mass_and_centre(motion.q[0]).mass
        weight = mass * float(np.linalg.norm(robot.gravity))
    return CarriedBase(np.concatenate(torque), named, np.concatenate(missing), up, weight)


def _at_frame(name: str, width: int) -> Touch:
    return Touch(name, "", 0.0, width == 6, (0.0, 0.0, 0.0), 0.0, 0.0)


def _width(touch: Touch) -> int:
    return 6 if touch.sole else 3


def _standing(base: BaseSignals, robot: Robot, asked: Sequence[str] | None) -> tuple[Touch, ...]:
    """Contacts of the robot file, those asked for."""
    every = (*(_at_frame(c.frame, len(c.columns)) for c in base.contacts), *base.touches)
    frames = [touch.frame for touch in every]
    for name in asked or ():
        wrong = f"the robot file has no contact on '{name}'"
        where = f"[[signals.base.contacts]] of '{robot.name}'"
        refuse_unknown(name, frames, wrong, where, "contacts", DataError)
    return tuple(touch for touch in every if asked is None or touch.frame in asked)


def _names(touches: Sequence[Touch]) -> list[str]:
    """Frames of contacts, with numbers where several are on one."""
    frames = [touch.frame for touch in touches]
    return [
        name if frames.count(name) == 1 else f"{name}, point {frames[: k + 1].count(name)}"
        for k, name in enumerate(frames)
    ]
