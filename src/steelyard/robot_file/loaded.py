"""A robot with all that its files say."""

import copyreg
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

from steelyard.robot.model_notes import JointSpring
from steelyard.robot.robot import Robot
from steelyard.robot.xacro.read import joined_reference, stem_of
from steelyard.robot_file.efforts import Locate
from steelyard.robot_file.excitation_sections import ExcitationSection
from steelyard.robot_file.sections import (
    EstimationSection,
    FrictionSelection,
    PriorSection,
    ProcessingSection,
    ValidationSection,
)
from steelyard.robot_file.signals import Signals


def _proxy(table: dict[Any, Any]) -> MappingProxyType[Any, Any]:
    return MappingProxyType(table)


copyreg.pickle(MappingProxyType, lambda table: (_proxy, (dict(table),)))


@dataclass(frozen=True)
class Source:
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
        base: The link that is fixed to the world; `None` if it is the model's root.
        floats: Whether that link floats in the model: its being at rest is an assumption.
        couplings_stated: Whether the file states couplings of motors, or that there are none.

    Example:
        >>> load_robot("arm.urdf").robot
        Robot('arm', 2 joints)
    """

    robot: Robot
    notes: tuple[str, ...]
    signals: Signals | None
    terms: tuple[TermSpec, ...] | None
    friction: FrictionSelection | None
    processing: ProcessingSection
    estimation: EstimationSection
    validation: ValidationSection
    sources: tuple[Source, ...]
    where: Locate
    prior: PriorSection = PriorSection()
    knowledge: tuple[Mapping[str, Any], ...] = ()
    excitation: ExcitationSection = ExcitationSection()
    springs: Mapping[str, JointSpring] = field(default_factory=dict)
    ignored: Mapping[str, str] = field(default_factory=dict)
    arguments: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    base: str | None = None
    floats: bool = False
    couplings_stated: bool = True

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
