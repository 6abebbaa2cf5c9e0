"""A model file alone, a URDF, a xacro file or an MJCF, and the robot that it describes."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from steelyard.errors import ModelError, OpenModelError
from steelyard.robot.free_joints import floating_base
from steelyard.robot.from_mechanism import reduced
from steelyard.robot.ignored_statements import ignored_statements, springs_along
from steelyard.robot.mechanism import Mechanism
from steelyard.robot.robot import Robot
from steelyard.robot.xacro.read import expand
from steelyard.robot.xml_reader import read_bytes
from steelyard.robot_file.loaded import LoadedRobot, Source
from steelyard.robot_file.model_source import read_mechanism
from steelyard.robot_file.sections import EstimationSection, ProcessingSection, ValidationSection


@dataclass(frozen=True, eq=False)
class ModelFile:
    """A model file that was read.

    Attributes:
        mechanism: What it describes.
        sources: The file given, then what it was expanded to, if it is a xacro file.
        arguments: Of a xacro file.
        notes: How it was read, for the user.
    """

    mechanism: Mechanism
    sources: tuple[Source, ...]
    arguments: Mapping[str, str]
    notes: tuple[str, ...]


def read_model(path: Path, arguments: Mapping[str, str]) -> ModelFile:
    """A URDF, a xacro file with its arguments, or an MJCF."""
    sources, notes = model_sources(path, arguments, ())
    mechanism = read_mechanism(sources[-1].path)
    return ModelFile(mechanism, sources, MappingProxyType(dict(arguments)), notes)


def robot_of_model(
    model: ModelFile, *, base: str | None = None, locked: Mapping[str, float] | None = None
) -> LoadedRobot:
    """The robot of a model file alone.

    Args:
        model: The file.
        base: The link that is fixed to the world; `None` is its root.
        locked: Positions of joints that do not move [rad; m].

    Raises:
        ModelError: The file leaves open what a robot is, such as the base of one that floats.
    """
    mechanism, path = model.mechanism, model.sources[0].path
    robot, notes = _whole(mechanism, base, locked)
    ignored = ignored_statements(mechanism, robot, (), ())
    return LoadedRobot(
        robot,
        (*model.notes, *notes, *ignored.values()),
        None,
        None,
        None,
        ProcessingSection(),
        EstimationSection(),
        ValidationSection(),
        model.sources,
        lambda *key: str(path),
        arguments=model.arguments,
        springs=springs_along(mechanism, robot),
        ignored=ignored,
        base=base,
        floats=floating_base(mechanism, base) is not None,
    )


def _whole(
    mechanism: Mechanism, base: str | None, locked: Mapping[str, float] | None
) -> tuple[Robot, tuple[str, ...]]:
    """The robot of a model file alone, with the advice that `init` locks what cannot move."""
    try:
        return reduced(mechanism, base=base, locked=locked)
    except OpenModelError:
        raise
    except ModelError as error:
        if locked is not None or not mechanism.pins:
            raise
        fix = f"{error.fix}; `steelyard init` writes a robot file that locks the loops of hands"
        raise ModelError(error.wrong, where=error.where, fix=fix) from None


def source_of(path: Path) -> Source:
    """A file as it is now."""
    return Source(path, sha256_of(read_bytes(path, "a robot model")))


def model_sources(
    path: Path, arguments: Mapping[str, str], packages: Sequence[Path]
) -> tuple[tuple[Source, ...], tuple[str, ...]]:
    """A model file, behind it what a xacro file is expanded to; and a note on that."""
    source = source_of(path)
    expansion = expand(path, arguments, packages)
    if expansion is None:
        return (source,), ()
    return (source, Source(expansion.path, expansion.sha256)), (expansion.note,)


def sha256_of(data: bytes) -> str:
    """What identifies the content of a file."""
    return hashlib.sha256(data).hexdigest()
