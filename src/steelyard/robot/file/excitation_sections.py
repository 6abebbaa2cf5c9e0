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
from steelyard.robot.file.toml import (
    Many,
    Name,
    Names,
    Numbers,
    Pair,
    Positive,
    Section,
    Vector,
    key,
)

PerJoint = Positive | Many[Positive] | dict[str, Positive]
Pairs = Many[Pair]

WATER = 1000.0
"""Density that a load without a radius is taken to have [kg/m³]."""


class MotionLimitsSection(Section):
    """What joints may do; what is left out says the robot, or is assumed and noted."""

    share: Share = key(0.95, "Share of the robot's limits that the motion may use.")
    position_margin: Annotated[float, Field(ge=0.0)] | None = key(
        None, "Distance from each end of the range [rad; m]; 2 % of it if left out."
    )
    velocity: PerJoint | None = key(
        None,
        "Greatest speed, one for all joints, one each, or by joint [rad/s; m/s]; the robot's if "
        "left out.",
    )
    acceleration: PerJoint | None = key(None, "Greatest acceleration, likewise [rad/s²; m/s²].")
    jerk: PerJoint | None = key(None, "Greatest jerk, likewise [rad/s³; m/s³].")
    effort: PerJoint | Literal["robot", "any"] = key(
        "robot", "Greatest effort, likewise [Nm; N]; `robot`: the robot's limits; `any`: none."
    )
    power: PerJoint | None = key(None, "Greatest mechanical power, likewise [W].")
    total_power: Positive | None = key(
        None, "Greatest mechanical power of all joints together [W]."
    )


class PlaneSection(Section):
    """A half-space: normal . point >= above."""

    normal: Vector = key(..., "Normal in the base frame.")
    above: float = key(..., "Least value of normal · point [m].")


class WorkspaceSection(Section):
    """Where the robot may be, in the frame of its base.

    `floor`, `planes` and `keep_out` hold for all links but those in `without`, the tool and the
    loads; with `only_tool`, planes and boxes hold for the tool's ball alone. `box` is always of the
    tool's ball alone.
    """

    frame: Name | None = key(None, "Frame of the tool; the last of the robot if left out.")
    point: Vector = key((0.0, 0.0, 0.0), "Centre of the tool's ball in its frame [m].")
    radius: Annotated[float, Field(ge=0.0)] = key(0.0, "Radius of that ball [m].")
    floor: float | None = key(None, "Height of the floor above the origin of the base [m].")
    box: BoxSpans = key(BoxSpans(), "Where the tool's ball may be.")
    planes: Many[PlaneSection] = key((), "Planes that nothing may cross.")
    keep_out: Many[BoxSpans] = key((), "Boxes that nothing may enter.")
    only_tool: bool = key(
        False,
        "Whether planes and boxes hold for the tool's ball only; the floor always holds for all.",
    )
    without: Names = key((), "Links that floor, planes and boxes ignore.")

    @property
    def limits_links(self) -> bool:
        """Whether anything keeps all links away from something."""
        return self.floor is not None or bool(not self.only_tool and (self.planes or self.keep_out))


class CollisionSection(Section):
    """What may not touch: the robot's bodies and the world; workspace limits ignore `without`."""

    bodies: bool = key(True, "Whether the robot's links may not touch each other.")
    margin: Annotated[float, Field(ge=0.0)] = key(0.01, "Least distance [m].")
    world: Name | None = key(None, "URDF or MJCF of obstacles, fixed to the base.")
    ignore: Pairs = key((), "Pairs of links that may touch.")
    without: Names = key((), "Links that are ignored.")


class CriterionSection(Section):
    """What is minimised."""

    kind: Name = key("d_optimal", "Criterion, such as `d_optimal`.")
    chosen: Names | None = key(None, "Laws or base parameters of interest; all if left out.")
    without: Names | None = key(
        None,
        "Laws or base parameters that the model does without: zero, not unknown. Those that an "
        "earlier model was reduced by if left out.",
    )
    weights: Literal["equal", "noise"] | Numbers = key(
        "equal", "Weights of the joints: `equal`, by the `noise` of an earlier log, or numbers."
    )
    relative: bool = key(False, "Whether variances are relative to the parameters' earlier values.")
    after_earlier: bool = key(False, "Whether the information of earlier runs is added.")


class LoadSection(Section):
    """A load that may hang on the robot: a ball for walls, with its inertia in the torques."""

    mass: Positive = key(..., "Mass [kg].")
    frame: Name | None = key(None, "Frame that carries it; the last of the robot if left out.")
    com: Vector = key((0.0, 0.0, 0.0), "Centre of mass in the link's frame [m].")
    radius: Positive | None = key(
        None, "Radius of its ball [m]; that of as much water if left out."
    )

    @property
    def ball(self) -> float:
        """Radius of the ball [m]."""
        return self.radius or float((0.75 * self.mass / (pi * WATER)) ** (1.0 / 3.0))


class SearchSection(Section):
    """How the motion is looked for."""

    method: Name = key("gradient", "Search method: `gradient`, `genetic` or `cma_es`.")


class ExcitationSection(Section):
    """All about the motion that is wanted."""

    motion: MotionSection = key(FourierSection(), "Family of motions.")
    limits: MotionLimitsSection = key(MotionLimitsSection(), "Limits of the motion.")
    workspace: WorkspaceSection | None = key(None, "Where the robot may be.")
    collision: CollisionSection | None = key(None, "What may not touch.")
    criterion: CriterionSection = key(CriterionSection(), "What is minimised.")
    loads: Many[LoadSection] = key((), "Loads that may hang on the robot.")
    search: SearchSection = key(SearchSection(), "How the motion is searched.")
    samples: Annotated[int, Field(ge=20, le=1_000_000)] = key(
        1000, "Samples of the motion at which the criterion is computed."
    )


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

    Another kind of motion has its usual numbers; `period` is also the length of a motion without
    one [s]; `still_unknown`: what earlier runs show counts too. A `ValueError` says which number a
    kind of motion does not have, or cannot.
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
