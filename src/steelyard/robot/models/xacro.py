"""Xacro files as URDF: expanded in this process, without ROS and without running what they say.

A reference is a model file with its arguments behind it, as for the program `xacro`:
`arm.urdf.xacro name:=left hand:=false`.
"""

import atexit
import hashlib
import os
import re
import shutil
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from xml.etree import ElementTree

from steelyard.base.errors import ModelError, advice
from steelyard.base.files import cache_folder, whole_file
from steelyard.robot.models.urdf import of_xacro
from steelyard.robot.models.xacro_commands import Packages
from steelyard.robot.models.xacro_expand import Expander
from steelyard.robot.models.xacro_values import XacroError
from steelyard.robot.models.xml_reader import Element, read_xml

_ARGUMENT = re.compile(r"\s+(?=[A-Za-z_]\w*:=)")


@dataclass(frozen=True)
class Expansion:
    """A URDF made of a xacro file, as `note` says; meshes have absolute paths, but in `sha256`."""

    path: Path
    sha256: str
    note: str


def split_reference(reference: str | Path) -> tuple[Path, dict[str, str]]:
    """The file and the arguments of `FILE NAME:=VALUE...`."""
    path, *given = _ARGUMENT.split(str(reference))
    pairs = (words.split(":=", 1) for words in given)
    return Path(path), {name: value.strip() for name, value in pairs}


def joined_reference(path: Path, arguments: Mapping[str, str]) -> str:
    """The inverse of `split_reference`."""
    return " ".join([str(path), *(f"{name}:={value}" for name, value in arguments.items())])


def stem_of(reference: str | Path) -> str:
    """A model file's name without its endings and arguments: `arm` of `arm.urdf.xacro`."""
    path = split_reference(reference)[0]
    return Path(path.stem).stem if path.suffix.lower() == ".xacro" else path.stem


def is_xacro(path: Path) -> bool:
    """Whether a model file has to be expanded: by its ending, or by an element that is read."""
    return path.suffix.lower() == ".xacro" or of_xacro(read_xml(path)) is not None


def expand(
    path: Path, arguments: Mapping[str, str], packages: Sequence[Path] = ()
) -> Expansion | None:
    """The URDF that a xacro file stands for with its arguments; `None` for a file that is none.

    Packages are looked for in the folders given, those above the file and those of the environment.
    """
    if not is_xacro(path):
        if arguments:
            raise ModelError(
                f"'{path}' is not a xacro file, and has no arguments",
                where=joined_reference(path, arguments),
                fix="leave out the arguments after it",
            )
        return None
    places = Packages(tuple(packages), path)
    expander = Expander(places, arguments)
    root = expander.root()
    for name in arguments:
        if name not in expander.commands.declared:
            raise ModelError(
                f"the file has no argument '{name}'",
                where=str(path),
                fix=advice(name, sorted(expander.commands.declared), "arguments"),
            )
    _check_robot(path, root, expander.macros)
    portable = _xml(root, lambda name: name)
    words = " ".join(f"{name}:={value}" for name, value in arguments.items())
    note = f"{path.name} is expanded with {words or 'no arguments'}"
    return Expansion(
        _kept(_xml(root, lambda name: _mesh_path(name, places)), stem_of(path), root.tag),
        hashlib.sha256(portable).hexdigest(),
        note,
    )


def _check_robot(path: Path, root: Element, macros: set[str]) -> None:
    if root.children and root.tag == "mujoco" or root.all("link"):
        return
    if not macros:
        raise ModelError(
            "the file holds no links", where=str(path), fix="give the file of the whole robot"
        )
    users = _users(path)
    listed = f"here {', '.join(users)}" if users else "often NAME.urdf.xacro, or in ../robots"
    raise ModelError(
        f"the file only defines macros ({', '.join(sorted(macros))[:200]}), and no robot",
        where=str(path),
        fix=f"give the file that includes it and calls them: {listed}",
    )


def _users(path: Path) -> list[str]:
    """Files nearby that include the file."""
    folder = path.resolve().parent
    nearby = [*folder.glob("*.xacro"), *folder.parent.glob("*/*.xacro")][:200]
    found = []
    for file in sorted({file.resolve() for file in nearby}):
        try:
            text = file.read_text("utf-8", "replace")
        except OSError:
            continue
        if file.name != path.name and re.search(rf"[/\"]{re.escape(path.name)}\"", text):
            found.append(os.path.relpath(file, folder))
    return found[:5]


def _mesh_path(name: str, packages: Packages) -> str:
    """A mesh's path from anywhere; as it is where the file is not found."""
    try:
        path = packages.named(name, packages.model.parent).resolve()
    except (XacroError, OSError):
        return name
    return path.as_posix() if path.is_file() else name


def _xml(root: Element, mesh: Callable[[str], str]) -> bytes:
    """The text of an XML file, its meshes named by a function."""
    made = _element(root, mesh)
    ElementTree.indent(made)
    text: bytes = ElementTree.tostring(made, "utf-8")
    return b"<?xml version='1.0' encoding='utf-8'?>\n" + text


def _element(element: Element, mesh: Callable[[str], str]) -> ElementTree.Element:
    attributes = dict(element.attributes)
    if element.tag == "mesh" and "filename" in attributes:
        attributes["filename"] = mesh(attributes["filename"])
    made = ElementTree.Element(element.tag, attributes)
    made.text = "".join(element.texts).strip() or None
    made.extend([_element(child, mesh) for child in element.children])
    return made


def _kept(content: bytes, stem: str, tag: str) -> Path:
    """The content in a file of its own, in the cache."""
    key = hashlib.sha256(content).hexdigest()[:16]
    path = _folder() / key / f"{stem}{'.xml' if tag == 'mujoco' else '.urdf'}"
    if not path.is_file() or path.read_bytes() != content:
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as part:
            part.write_bytes(content)
    return path


def _folder() -> Path:
    """The folder of expanded files; a temporary one where there is no cache."""
    folder = cache_folder("models")
    return folder if folder is not None and os.access(folder, os.W_OK) else _temporary()


@cache
def _temporary() -> Path:
    folder = Path(tempfile.mkdtemp(prefix="steelyard-models-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder
