"""The `[excitation]` tables of the robot file: which motion is wanted, and what it must keep."""

from math import pi
from typing import Annotated, Literal

from pydantic import Field, ValidationError

from steelyard.robot.file.motion_sections import (
    KINDS,
    MOTIONS,
    FourierSection,
    MotionSection,
    Share,
)
from steelyard.robot.file.motion_sections import BoxSpans as BoxSpans
from steelyard.robot.file.toml import Name, Names, Numbers, Positive, Section, Vector

PerJoint = Positive | Annotated[tuple[Positive, ...], Field(strict=False)] | dict[str, Positive]
Pairs = Annotated[
    tuple[Annotated[tuple[Name, Name], Field(strict=False)], ...], Field(strict=False)
]

WATER = 1000.0
"""Density that a load without a radius is taken to have [kg/m³]."""


class MotionLimitsSection(Section):
    """What joints may do; what is left out says the robot, or is assumed and noted.

    Attributes:
        share: Share of the robot's limits that the motion may use.
        position_margin: Distance from each end of the range [rad; m]; 2 % of it if left out.
        velocity: Greatest speed, one for all joints, one each, or by joint [rad/s; m/s]; the
            robot's if left out.
        acceleration: Greatest acceleration, likewise [rad/s²; m/s²].
        jerk: Greatest jerk, likewise [rad/s³; m/s³].
        effort: Greatest effort, likewise [Nm; N]; `robot`: the robot's limits; `any`: none.
        power: Greatest mechanical power, likewise [W].
        total_power: Greatest mechanical power of all joints together [W].
    """

    share: Share = 0.95
    position_margin: Annotated[float, Field(ge=0.0)] | None = None
    velocity: PerJoint | None = None
    acceleration: PerJoint | None = None
    jerk: PerJoint | None = None
    effort: PerJoint | Literal["robot", "any"] = "robot"
    power: PerJoint | None = None
    total_power: Positive | None = None


class PlaneSection(Section):
    """A half-space: normal . point >= above.

    Attributes:
        normal: Normal in the base frame.
        above: Least value of normal · point [m].
    """

    normal: Vector
    above: float


class WorkspaceSection(Section):
    """Where the robot may be, in the frame of its base.

    `floor`, `planes` and `keep_out` hold for all links but those in `without`, the tool and the
    loads; with `only_tool`, planes and boxes hold for the tool's ball alone. `box` is always of the
    tool's ball alone.

    Attributes:
        frame: Frame of the tool; the last of the robot if left out.
        point: Centre of the tool's ball in its frame [m].
        radius: Radius of that ball [m].
        floor: Height of the floor above the origin of the base [m].
        box: Where the tool's ball may be.
        planes: Planes that nothing may cross.
        keep_out: Boxes that nothing may enter.
        only_tool: Whether planes and boxes hold for the tool's ball only; the floor always
            holds for all.
        without: Links that floor, planes and boxes ignore.
    """

    frame: Name | None = None
    point: Vector = (0.0, 0.0, 0.0)
    radius: Annotated[float, Field(ge=0.0)] = 0.0
    floor: float | None = None
    box: BoxSpans = BoxSpans()
    planes: Annotated[tuple[PlaneSection, ...], Field(strict=False)] = ()
    keep_out: Annotated[tuple[BoxSpans, ...], Field(strict=False)] = ()
    only_tool: bool = False
    without: Names = ()

    @property
    def limits_links(self) -> bool:
        """Whether anything keeps all links away from something."""
        return self.floor is not None or bool(not self.only_tool and (self.planes or self.keep_out))


class CollisionSection(Section):
    """What may not touch: the robot's bodies and the world; workspace limits ignore `without`.

    Attributes:
        bodies: Whether the robot's links may not touch each other.
        margin: Least distance [m].
        world: URDF or MJCF of obstacles, fixed to the base.
        ignore: Pairs of links that may touch.
        without: Links that are ignored.
    """

    bodies: bool = True
    margin: Annotated[float, Field(ge=0.0)] = 0.01
    world: Name | None = None
    ignore: Pairs = ()
    without: Names = ()


class CriterionSection(Section):
    """What is minimised.

    Attributes:
        kind: Criterion, such as `d_optimal`.
        chosen: Laws or base parameters of interest; all if left out.
        without: Laws or base parameters that the model does without: zero, not unknown. Those that
            an earlier model was reduced by if left out.
        weights: Weights of the joints: `equal`, by the `noise` of an earlier log, or numbers.
        relative: Whether variances are relative to the parameters' earlier values.
        after_earlier: Whether the information of earlier runs is added.
    """

    kind: Name = "d_optimal"
    chosen: Names | None = None
    without: Names | None = None
    weights: Literal["equal", "noise"] | Numbers = "equal"
    relative: bool = False
    after_earlier: bool = False


class LoadSection(Section):
    """A load that may hang on the robot: a ball, to walls and for the inertia that torques count.

    Attributes:
        mass: Mass [kg].
        frame: Frame that carries it; the last of the robot if left out.
        com: Centre of mass in the link's frame [m].
        radius: Radius of its ball [m]; that of as much water if left out.
    """

    mass: Positive
    frame: Name | None = None
    com: Vector = (0.0, 0.0, 0.0)
    radius: Positive | None = None

    @property
    def ball(self) -> float:
        """Radius of the ball [m]."""
        return self.radius or float((0.75 * self.mass / (pi * WATER)) ** (1.0 / 3.0))


class SearchSection(Section):
    """How the motion is looked for.

    Attributes:
        method: Search method: `gradient`, `genetic` or `cma_es`.
    """

    method: Name = "gradient"


class ExcitationSection(Section):
    """All about the motion that is wanted.

    Attributes:
        motion: Family of motions.
        limits: Limits of the motion.
        workspace: Where the robot may be.
        collision: What may not touch.
        criterion: What is minimised.
        loads: Loads that may hang on the robot.
        search: How the motion is searched.
        samples: Samples of the motion at which the criterion is computed.
    """

    motion: MotionSection = FourierSection()
    limits: MotionLimitsSection = MotionLimitsSection()
    workspace: WorkspaceSection | None = None
    collision: CollisionSection | None = None
    criterion: CriterionSection = CriterionSection()
    loads: Annotated[tuple[LoadSection, ...], Field(strict=False)] = ()
    search: SearchSection = SearchSection()
    samples: Annotated[int, Field(ge=20, le=1_000_000)] = 1000


def changed_excitation(
    section: ExcitationSection,
    *,
    motion: str | None = None,
    period: float | None = None,
    harmonics: int | None = None,
    criterion: str | None = None,
    method: str | None = None,
    still_unknown: bool = False,
) -> ExcitationSection:
    """The tables with some values replaced.

    Args:
        section: The tables.
        motion: Another kind of motion; its numbers are then the usual ones.
        period: Length of the period or of the motion [s].
        harmonics: Of a Fourier series.
        criterion: Kind of criterion.
        method: Search method.
        still_unknown: Whether what earlier runs show counts too.

    Raises:
        ValueError: The kind of motion has no such number, or cannot have it; says which.
    """
    tables = section.model_dump()
    if motion is not None and motion != section.motion.kind:
        tables["motion"] = {"kind": motion}
    kind = tables["motion"]["kind"]
    if kind not in KINDS:
        raise ValueError(f"there is no motion '{kind}', but " + ", ".join(KINDS))
    known = MOTIONS[KINDS.index(kind)].model_fields
    for name, value in (("period", period), ("harmonics", harmonics)):
        key = "duration" if name == "period" and "duration" in known else name
        if value is not None and key not in known:
            raise ValueError(f"a motion of kind '{kind}' has no {name}")
        if value is not None:
            tables["motion"][key] = value
    if criterion is not None:
        tables["criterion"]["kind"] = criterion
    if method is not None:
        tables["search"]["method"] = method
    if still_unknown:
        tables["criterion"]["after_earlier"] = True
    try:
        return ExcitationSection.model_validate(tables)
    except ValidationError as error:
        flaw = error.errors()[0]
        what = ".".join(str(part) for part in flaw["loc"] if part != kind)
        message = flaw["msg"].replace("Field required", "is missing")
        raise ValueError(f"[excitation] {what}: {message[:1].lower()}{message[1:]}") from None
