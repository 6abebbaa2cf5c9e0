"""Serial arms from a table of Denavit-Hartenberg parameters."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from steelyard.arrays import frozen
from steelyard.errors import ModelError
from steelyard.robot.geometry import Placement, turn
from steelyard.robot.inertia import Inertia, symmetric
from steelyard.robot.links import Joint, Link
from steelyard.robot.mechanism import Mechanism
from steelyard.robot.robot import JointKind, Limits

DHConvention = Literal["standard", "modified"]
_X, _Z = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class DHRow:
    r"""One joint and its link.

    Attributes:
        a: Distance along x [m]; of the link (standard), or $a_{i-1}$ (modified).
        alpha: Twist about x [rad]; of the link (standard), or $\alpha_{i-1}$ (modified).
        d: Distance along z [m]; the offset at position zero of a prismatic joint.
        theta: Angle about z [rad]; the offset at position zero of a revolute joint.
        kind: `revolute` or `prismatic`.
        joint: The joint's name; `joint_i` if empty.
        mass: [kg]; `None` if the mass properties are unknown.
        com: Centre of mass [m], in DH frame i.
        inertia_com: `Ixx, Ixy, Iyy, Ixz, Iyz, Izz` about the centre of mass [kg m²], axes of DH
            frame i.
        limits: Range, speed and effort.
    """

    a: float = 0.0
    alpha: float = 0.0
    d: float = 0.0
    theta: float = 0.0
    kind: JointKind = "revolute"
    joint: str = ""
    mass: float | None = None
    com: tuple[float, float, float] = (0.0, 0.0, 0.0)
    inertia_com: tuple[float, float, float, float, float, float] = (0.0,) * 6
    limits: Limits = field(default_factory=Limits)


def dh_mechanism(
    rows: Sequence[DHRow],
    convention: DHConvention = "standard",
    name: str = "dh_robot",
    gravity: ArrayLike = (0.0, 0.0, -9.81),
    where: str = "the DH table",
) -> Mechanism:
    r"""The chain of a DH table; joint `i` turns or slides along z of the link's frame.

    From DH frame $i-1$ to $i$, with the joint's position added to `theta` (revolute) or `d`
    (prismatic):

    * standard (Denavit, Hartenberg; Spong): $R_z(\theta_i) T_z(d_i) T_x(a_i) R_x(\alpha_i)$,
    * modified (Craig; Khalil): $R_x(\alpha_{i-1}) T_x(a_{i-1}) R_z(\theta_i) T_z(d_i)$.

    The link's frame, to which its ten inertial parameters refer, is DH frame `i` in the modified
    convention. In the standard one DH frame `i` does not lie on the joint's axis, and the link's
    frame is the one after $R_z(\theta_i) T_z(d_i)$: on the axis, with the x axis of DH frame `i`.
    Masses in the table are given in DH frame `i` in both. The base is DH frame 0.
    """
    if not rows:
        raise ModelError("the DH table has no rows", where=where, fix="give one row per joint")
    links, joints = [Link("base", None, where)], []
    end = Placement()
    for number, row in enumerate(rows, start=1):
        screw_x = Placement(turn(_X, row.alpha), row.a * _X)
        screw_z = Placement(turn(_Z, row.theta), row.d * _Z)
        modified = convention == "modified"
        placement = screw_x @ screw_z if modified else end @ screw_z
        end = Placement() if modified else screw_x
        link, at = f"link_{number}", f"{where}, row {number}"
        joint = row.joint or f"joint_{number}"
        joints.append(
            Joint(
                joint, row.kind, links[-1].name, link, placement, frozen(_Z), row.limits, None, at
            )
        )
        links.append(Link(link, _inertia(row, end), at))
    return Mechanism(name, links, joints, gravity, where)


def _inertia(row: DHRow, frame: Placement) -> Inertia | None:
    """The row's mass properties in the link's frame; `frame` is DH frame i in it."""
    if row.mass is None:
        return None
    in_dh = Inertia.about_com(row.mass, row.com, symmetric(row.inertia_com))
    return in_dh.moved(frame.rotation, frame.position)
