"""Folders of ROS packages, without ROS."""

import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from steelyard.errors import ModelError
from steelyard.robot.xacro.values import XacroError
from steelyard.robot.xml_reader import read_xml


@dataclass(frozen=True)
class Packages:
    """Where packages are looked for.

    Attributes:
        given: Folders of packages, or packages themselves, that are named in the robot file.
        model: The model file: a package may be a folder above it, or lie in one.
    """

    given: tuple[Path, ...]
    model: Path

    def find(self, name: str) -> Path:
        """The folder of a package.

        Raises:
            XacroError: There is none.
        """
        if re.fullmatch(r"[\w-][\w.-]*", name):
            for place in self._places():
                for folder in (place / name, place):
                    if os.path.isdir(folder) and (
                        folder.name == name or package_name(folder) == name
                    ):
                        return folder
            for place in self.given:
                for manifest in sorted(place.glob("*/package.xml")):
                    if package_name(manifest.parent) == name:
                        return manifest.parent
        places = [str(place) for place in (*self.given, *self._environment())]
        looked = ", ".join(["the folders above the file", *places])
        raise XacroError(
            f"the package '{name}' is not found; looked in {looked}",
            'name the folder that holds it: [robot.xacro] packages = ["FOLDER"] in the robot file, '
            "or ROS_PACKAGE_PATH=FOLDER in the environment",
        )

    def named(self, text: str, folder: Path) -> Path:
        """A file as models name it: `package://...`, absolute, or relative to a folder.

        A file of a package that is not found may lie below a folder above the model all the same:
        copies of packages often have other names.

        Raises:
            XacroError: The package is not found, and the file neither.
        """
        text = text.removeprefix("file://")
        if not text.startswith("package://"):
            return folder / text
        name, _, rest = text.removeprefix("package://").partition("/")
        try:
            return self.find(name) / rest
        except XacroError:
            for above in self.model.resolve().parents:
                if os.path.isfile(above / rest):
                    return above / rest
            raise

    def _places(self) -> Iterator[Path]:
        yield from self.given
        yield from self.model.resolve().parents
        yield from self._environment()

    def _environment(self) -> list[Path]:
        """`ROS_PACKAGE_PATH` of ROS 1, `AMENT_PREFIX_PATH` of ROS 2."""
        ros1 = os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep)
        ros2 = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
        return [Path(p) for p in ros1 if p] + [Path(p) / "share" for p in ros2 if p]


def package_name(folder: Path) -> str | None:
    """The name in a folder's `package.xml`; `None` where there is none."""
    manifest = folder / "package.xml"
    if not os.path.isfile(manifest):
        return None
    try:
        names = read_xml(manifest).all("name")
    except ModelError:
        return None
    return "".join(names[0].texts).strip() if names else None
