"""The model that a robot file names: a URDF or MJCF file, or a table of its own."""

import math
import os
import re
from pathlib import Path

from steelyard.errors import ModelError
from steelyard.robot.mechanism import Mechanism
from steelyard.robot.model_files.dh import DHRow, dh_mechanism
from steelyard.robot.model_files.urdf import read_urdf
from steelyard.robot.xml_reader import read_xml
from steelyard.robot_file.sections import DHSection, RobotSection
from steelyard.robot_file.toml_check import Places


def read_mechanism(path: Path) -> Mechanism:
    """The mechanism of a URDF or an MJCF, distinguished by the outermost element."""
    if read_xml(path).tag != "mujoco":
        return read_urdf(path)
    from steelyard.robot.mjcf.read import read_mjcf  # loads MuJoCo

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

    def text(value: str | bool | int | float) -> str:
        return str(value).lower() if isinstance(value, bool) else str(value)

    folders = [
        beside(path, folder, places.where("robot", "xacro", "packages", index))
        for index, folder in enumerate(section.xacro.packages)
    ]
    return {name: text(value) for name, value in section.xacro.arguments.items()}, tuple(folders)


def beside(path: Path, text: str, where: str) -> Path:
    """A file named in the robot file at `path`: relative to it, with environment variables."""
    return path.parent / _expanded(text, where)


def _expanded(text: str, where: str) -> str:
    """The text with `${NAME}` replaced by environment variables."""

    def value(match: re.Match[str]) -> str:
        name = match.group(1)
        if name not in os.environ:
            raise ModelError(
                f"the environment variable '{name}' is not set",
                where=where,
                fix=f"set it to the folder the path starts from: export {name}=/path/to/folder",
            )
        return os.environ[name]

    return re.sub(r"\$\{(\w+)\}", value, text)


def dh_table(section: RobotSection, places: Places) -> Mechanism:
    """The mechanism of a Denavit-Hartenberg table."""
    table: DHSection = section.dh  # type: ignore[assignment]  # the only model given
    angle = math.pi / 180.0 if table.angle_unit == "deg" else 1.0
    rows = [
        DHRow(
            link.a,
            link.alpha * angle,
            link.d,
            link.theta * angle,
            link.kind,
            link.joint or "",
            link.mass,
            link.com,
            link.inertia_com,
        )
        for link in table.links
    ]
    name = section.name or places.path.stem
    return dh_mechanism(rows, table.convention, name, where=places.where("robot", "dh"))
