"""Chains of joints from tables of Denavit-Hartenberg parameters."""

from collections.abc import Sequence
from typing import Literal

import numpy as np

from steelyard.base.arrays import frozen
from steelyard.robot.file.sections import DHRow
from steelyard.robot.inertia_and_placement import Inertia, Placement, symmetric, turn
from steelyard.robot.mechanism import Joint, Link, Mechanism

DHConvention = Literal["standard", "modified"]
_X, _Z = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])


def dh_mechanism(
    rows: Sequence[DHRow],
    convention: DHConvention = "standard",
    name: str = "dh_robot",
    where: str = "the DH table",
    angle: float = 1.0,
) -> Mechanism:
    r"""The chain of a DH table; joint `i` turns or slides along z of the link's frame.

    From DH frame $i-1$ to $i$, with the joint's position added to `theta` (revolute) or `d`
    (prismatic):

    * standard (Denavit, Hartenberg; Spong): $R_z(\theta_i) T_z(d_i) T_x(a_i) R_x(\alpha_i)$,
    * modified (Craig; Khalil): $R_x(\alpha_{i-1}) T_x(a_{i-1}) R_z(\theta_i) T_z(d_i)$.

    The link's frame, to which its ten inertial parameters refer, is DH frame `i` in the modified
    convention. In the standard one DH frame `i` does not lie on the joint's axis, and the link's
    frame is the one after $R_z(\theta_i) T_z(d_i)$: on the axis, with the x axis of DH frame `i`.
    Masses in the table are given in DH frame `i` in both, angles in a unit of `angle` rad. The base
    is DH frame 0.
    """
    links, joints = [Link("base", None, where)], []
    end = Placement()
    for number, row in enumerate(rows, start=1):
        screw_x = Placement(turn(_X, row.alpha * angle), row.a * _X)
        screw_z = Placement(turn(_Z, row.theta * angle), row.d * _Z)
        modified = convention == "modified"
        placement = screw_x @ screw_z if modified else end @ screw_z
        end = Placement() if modified else screw_x
        link, at = f"link_{number}", f"{where}, row {number}"
        joint, carrier = row.joint or f"joint_{number}", links[-1].name
        joints.append(Joint(joint, row.kind, carrier, link, placement, frozen(_Z), where=at))
        inertia = None
        if row.mass is not None:
            in_dh = Inertia.about_com(row.mass, row.com, symmetric(row.inertia_com))
            inertia = in_dh.moved(end.rotation, end.position)
        links.append(Link(link, inertia, at))
    return Mechanism(name, links, joints, where=where)
