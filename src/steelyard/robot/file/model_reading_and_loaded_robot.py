"""Models that robot files name (URDF, xacro, MJCF, DH tables), and robots as loaded."""

import copyreg
import hashlib
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import pi
from pathlib import Path
from types import MappingProxyType
from typing import Any

from steelyard.base.errors import ModelError, OpenModelError
from steelyard.robot.file import sections
from steelyard.robot.file.excitation_sections import ExcitationSection
from steelyard.robot.file.signals import Signals, TargetSignals
from steelyard.robot.file.signals_from_tables import Locate
from steelyard.robot.floating_ball_and_coupled_joints import floating_base
from steelyard.robot.mechanism import JointSpring, Mechanism
from steelyard.robot.models.denavit_hartenberg import dh_mechanism
from steelyard.robot.models.xacro import expand, joined_reference, stem_of
from steelyard.robot.models.xml_and_urdf import read_bytes, read_urdf, read_xml
from steelyard.robot.robot import Robot
from steelyard.robot.robot_from_mechanism import ignored_statements, reduced, springs_along


def read_mechanism(path: Path) -> Mechanism:
    """The mechanism of a URDF or an MJCF, distinguished by the outermost element."""
    if read_xml(path).tag != "mujoco":
        return read_urdf(path)
    from steelyard.robot.models.mjcf import read_mjcf  # loads MuJoCo

    return read_mjcf(path)


def _proxy(table: dict[Any, Any]) -> MappingProxyType[Any, Any]:
    return MappingProxyType(table)


copyreg.pickle(MappingProxyType, lambda table: (_proxy, (dict(table),)))


@dataclass(frozen=True)
class SourceFile:
    """A file that was read, and what was in it."""

    path: Path
    sha256: str


@dataclass(frozen=True)
class TermSpec:
    """A cause of torque as the robot file names it: a law's name, or a table with `law`."""

    description: str | Mapping[str, Any]
    where: str


@dataclass(frozen=True, eq=False, repr=False)
class LoadedRobot:
    """A robot and all that its file says.

    Attributes:
        robot: The robot, with the joints to identify.
        notes: What was assumed, one sentence each, for the user.
        signals: Columns of its logs; `None` if the file does not say.
        terms: Causes of torque; `None` if the file does not say.
        friction: How the friction laws are to be chosen from the data; `None` if they are not.
        processing: Filter settings; what is `None` is chosen from the data.
        estimation: How parameters are estimated.
        validation: Score settings.
        sources: The file given, then the model file it names, if any.
        where: Places in the file, for messages about what later rooms make of it.
        prior: What is known of links before the data, beside the model file.
        knowledge: Prior constraints, a table with its `kind` each.
        excitation: Which motion is wanted, and what it must keep.
        arguments: Of a xacro file that was given itself; those of a robot file stand there.
        springs: Springs of the model file along its coordinates, by name; no term has them unless
            it is listed.
        ignored: What the model file states of forces that the model ignores, a sentence
            for each kind.
        base: The link that is fixed to the world; `None` if it is the model's root, `"floating"` if
            none is.
        floats: Whether that link floats in the model: its being at rest is an assumption.
        couplings_stated: Whether the file states couplings of motors, or that there are none.
        targets: Columns of position targets and positions, where actuators are identified.
        actuator: What is known of the actuators that follow them.

    Example:
        >>> load_robot("arm.urdf").robot
        Robot('arm', 2 joints)
    """

    robot: Robot
    notes: tuple[str, ...]
    signals: Signals | None = None
    terms: tuple[TermSpec, ...] | None = None
    friction: sections.FrictionSelection | None = None
    processing: sections.ProcessingSection = sections.ProcessingSection()
    estimation: sections.EstimationSection = sections.EstimationSection()
    validation: sections.ValidationSection = sections.ValidationSection()
    sources: tuple[SourceFile, ...] = ()
    where: Locate = lambda *key: "the model"
    prior: sections.PriorSection = sections.PriorSection()
    knowledge: tuple[Mapping[str, Any], ...] = ()
    excitation: ExcitationSection = ExcitationSection()
    springs: Mapping[str, JointSpring] = field(default_factory=dict)
    ignored: Mapping[str, str] = field(default_factory=dict)
    arguments: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    base: str | None = None
    floats: bool = False
    couplings_stated: bool = True
    targets: TargetSignals | None = None
    actuator: sections.ActuatorSection = sections.ActuatorSection()

    def __repr__(self) -> str:
        return f"LoadedRobot('{self.reference}', {self.robot!r})"

    @property
    def reference(self) -> str:
        """What `load_robot` takes for the same robot."""
        return joined_reference(self.sources[0].path, self.arguments)

    @property
    def model_given(self) -> Path:
        """The model file as it was given, before a xacro file is expanded."""
        models = (s.path for s in self.sources if s.path.suffix.lower() != ".toml")
        return next(models, self.sources[-1].path)

    @property
    def stem(self) -> str:
        """The name of the file given, without its endings."""
        return stem_of(self.sources[0].path)


@dataclass(frozen=True, eq=False)
class ModelFile:
    """A model file that was read; the last source is what a xacro file was expanded to."""

    mechanism: Mechanism
    sources: tuple[SourceFile, ...]
    arguments: Mapping[str, str]
    notes: tuple[str, ...]


def read_model(
    path: Path, arguments: Mapping[str, str], packages: Sequence[Path] = ()
) -> ModelFile:
    """A URDF, a xacro file with its arguments and folders of packages, or an MJCF."""
    sources, notes = [source_of(path)], tuple[str, ...]()
    if expansion := expand(path, arguments, packages):
        sources.append(SourceFile(expansion.path, expansion.sha256))
        notes = (expansion.note,)
    mechanism = read_mechanism(sources[-1].path)
    return ModelFile(mechanism, tuple(sources), MappingProxyType(dict(arguments)), notes)


def model_of_tables(section: sections.RobotSection, path: Path, locate: Locate) -> ModelFile:
    """The model file that a robot file names, or its Denavit-Hartenberg table."""
    given = [key for key in ("urdf", "mjcf", "dh") if getattr(section, key) is not None]
    if len(given) != 1:
        raise ModelError(
            f"the robot has {' and '.join(given)}" if given else "the robot has no model",
            where=locate("robot"),
            fix='give exactly one of urdf = "FILE", mjcf = "FILE" and a table [robot.dh]',
        )
    if section.dh is not None:
        table, name = section.dh, section.name or path.stem
        angle, where = pi / 180.0 if table.angle_unit == "deg" else 1.0, locate("robot", "dh")
        mechanism = dh_mechanism(table.links, table.convention, name, where, angle)
        return ModelFile(mechanism, (), {}, ())
    text = str(getattr(section, given[0]))
    where = locate("robot", given[0])
    model_path = beside(path, text, where)
    if not os.path.isfile(model_path):  # also of a name that no file can have
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
    packages = [
        beside(path, folder, locate("robot", "xacro", "packages", index))
        for index, folder in enumerate(section.xacro.packages)
    ]
    written = section.xacro.arguments.items()
    arguments = {n: str(x).lower() if isinstance(x, bool) else str(x) for n, x in written}
    return read_model(model_path, arguments, packages)


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


def robot_of_model(
    model: ModelFile, *, base: str | None = None, locked: Mapping[str, float] | None = None
) -> LoadedRobot:
    """The robot of a model file alone; a `ModelError` if it leaves open what a robot is."""
    mechanism, path = model.mechanism, model.sources[0].path
    try:
        robot, notes = reduced(mechanism, base=base, locked=locked)
    except OpenModelError:
        raise
    except ModelError as error:
        if locked is not None or not mechanism.pins:
            raise
        fix = f"{error.fix}; `steelyard init` writes a robot file that locks the loops of hands"
        raise ModelError(error.wrong, where=error.where, fix=fix) from None
    ignored = ignored_statements(mechanism, robot, (), ())
    return LoadedRobot(
        robot,
        (*model.notes, *notes, *ignored.values()),
        sources=model.sources,
        where=lambda *key: str(path),
        arguments=model.arguments,
        springs=springs_along(mechanism, robot),
        ignored=ignored,
        base=base,
        floats=floating_base(mechanism, base) is not None,
    )


def source_of(path: Path) -> SourceFile:
    """A file as it is now."""
    return SourceFile(path, sha256_of(read_bytes(path, "a robot model")))


def sha256_of(data: bytes) -> str:
    """What identifies the content of a file."""
    return hashlib.sha256(data).hexdigest()
