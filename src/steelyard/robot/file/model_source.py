"""The model that a robot file names: a URDF, xacro or MJCF file, or a table of DH parameters."""

import math
import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import numpy as np

from steelyard.base.arrays import frozen
from steelyard.base.errors import ModelError
from steelyard.robot.file.sections import DHRow, DHSection, RobotSection
from steelyard.robot.file.toml import Places
from steelyard.robot.mechanism import Joint, Link, Mechanism
from steelyard.robot.models.urdf import read_urdf
from steelyard.robot.models.xml_reader import read_xml
from steelyard.robot.rigid_body import Inertia, Placement, symmetric, turn

DHConvention = Literal["standard", "modified"]
_X, _Z = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])


def dh_mechanism(
    rows: Sequence[DHRow],
    convention: DHConvention = "standard",
    name: str = "dh_robot",
    gravity: Sequence[float] = (0.0, 0.0, -9.81),
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
    Masses in the table are given in DH frame `i` in both, angles in rad. The base is DH frame 0.
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
        joint, carrier = row.joint or f"joint_{number}", links[-1].name
        joints.append(Joint(joint, row.kind, carrier, link, placement, frozen(_Z), where=at))
        inertia = None
        if row.mass is not None:
            in_dh = Inertia.about_com(row.mass, row.com, symmetric(row.inertia_com))
            inertia = in_dh.moved(end.rotation, end.position)
        links.append(Link(link, inertia, at))
    return Mechanism(name, links, joints, frozen(gravity), where)


def read_mechanism(path: Path) -> Mechanism:
    """The mechanism of a URDF or an MJCF, distinguished by the outermost element."""
    if read_xml(path).tag != "mujoco":
        return read_urdf(path)
    from steelyard.robot.models.mjcf import read_mjcf  # loads MuJoCo

    return read_mjcf(path)


def model_path_of(section: RobotSection, path: Path, places: Places) -> Path | None:
    """The model file that is named; `None` for a DH table."""
    given = [key for key in ("urdf", "mjcf", "dh") if getattr(section, key) is not None]
    if len(given) != 1:
        raise ModelError(
            f"the robot has {' and '.join(given)}" if given else "the robot has no model",
            where=places.where("robot"),
            fix='give exactly one of urdf = "FILE", mjcf = "FILE" and a table [robot.dh]',
        )
    if given == ["dh"]:
        return None
    text = str(getattr(section, given[0]))
    where = places.where("robot", given[0])
    model_path = beside(path, text, where)
    if not model_path.is_file():
        raise ModelError(
            f"the robot's {given[0]} '{model_path}' does not exist",
            where=where,
            fix="give its path relative to the robot file; ${NAME} stands for an environment "
            "variable",
        )
    if (read_xml(model_path).tag == "mujoco") != (given == ["mjcf"]):
        raise ModelError(
            f"'{model_path}' is not what its key '{given[0]}' says",
            where=where,
            fix=f"write {'urdf' if given == ['mjcf'] else 'mjcf'} = ... instead",
        )
    return model_path


def xacro_settings(
    section: RobotSection, path: Path, places: Places
) -> tuple[dict[str, str], tuple[Path, ...]]:
    """Arguments of a xacro file as its texts, and folders of packages."""
    folders = tuple(
        beside(path, folder, places.where("robot", "xacro", "packages", index))
        for index, folder in enumerate(section.xacro.packages)
    )
    given = section.xacro.arguments.items()
    return {n: str(x).lower() if isinstance(x, bool) else str(x) for n, x in given}, folders


def beside(path: Path, text: str, where: str) -> Path:
    """A file named in the robot file at `path`: relative to it, `${NAME}` from the environment."""

    def value(match: re.Match[str]) -> str:
        name = match.group(1)
        if name not in os.environ:
            raise ModelError(
                f"the environment variable '{name}' is not set",
                where=where,
                fix=f"set it to the folder the path starts from: export {name}=/path/to/folder",
            )
        return os.environ[name]

    return path.parent / re.sub(r"\$\{(\w+)\}", value, text)


def dh_table(section: RobotSection, places: Places) -> Mechanism:
    """The mechanism of a Denavit-Hartenberg table."""
    table: DHSection = section.dh  # type: ignore[assignment]  # the only model given
    angle = math.pi / 180.0 if table.angle_unit == "deg" else 1.0
    rows = [
        row.model_copy(update={"alpha": row.alpha * angle, "theta": row.theta * angle})
        for row in table.links
    ]
    name = section.name or places.path.stem
    return dh_mechanism(rows, table.convention, name, where=places.where("robot", "dh"))
