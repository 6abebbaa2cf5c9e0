"""The `[excitation]` tables of the robot file: kinds of motion, and what a motion must keep."""

from math import pi
from typing import Annotated, Literal, get_args

from pydantic import BeforeValidator, Field, ValidationError

from steelyard.robot.file.toml_schema import (
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

Share = Annotated[float, Field(gt=0.0, le=1.0)]
Count = Annotated[int, Field(ge=1)]
Span = Annotated[tuple[float, float], Field(strict=False)]
Posture = Many[float] | dict[str, float]

Periods = Annotated[Count, Field(description="Number of periods.")]
_START = "First configuration, a list or by joint [rad; m]; chosen by the search if left out."
Start = Annotated[Posture | None, Field(description=_START)]
End = Annotated[Posture | None, Field(description="Last configuration, likewise.")]
_NEARBY = "Configuration near which it starts, a list or by joint [rad; m]."
StartNearby = Annotated[Posture | None, Field(description=_NEARBY)]
_PATH = "Path of the tool: a straight `line`, or straight in `joint` space."
ToolPath = Annotated[Literal["line", "joint"], Field(description=_PATH)]
_AXIS = "Direction of the tool's z axis in the base frame; free if left out."
ToolAxis = Annotated[Vector | None, Field(description=_AXIS)]


class BoxSpans(Section):
    """From least to greatest, along the axes of the base [m]; open where left out."""

    x: Span | None = key(None, "Range along x [m].")
    y: Span | None = key(None, "Range along y [m].")
    z: Span | None = key(None, "Range along z [m].")

    @property
    def spans(self) -> tuple[Span | None, Span | None, Span | None]:
        """Those along x, y and z."""
        return self.x, self.y, self.z

    @property
    def bounded(self) -> bool:
        """Whether it is closed anywhere."""
        return any(self.spans)


class MotionOfAKind(Section):
    """What all kinds of motion have."""

    kind: str = key(..., "Kind of motion.")


class SeriesOfAKind(MotionOfAKind):
    """What all Fourier series have."""

    period: Positive = key(10.0, "Length of one period [s].")
    harmonics: Count = key(5, "Number of harmonics.")


class ToolMotionOfAKind(MotionOfAKind):
    """What all moves of the tool from point to point have."""

    dwell: Annotated[float, Field(ge=0.0)] = key(0.1, "Standstill between moves [s].")
    speed: Positive = key(1.0, "Greatest speed of the tool [m/s].")
    acceleration: Positive = key(5.0, "Greatest acceleration of the tool [m/s²].")
    tool_axis: ToolAxis = None


class FourierSection(SeriesOfAKind):
    """A finite Fourier series that starts and ends at rest."""

    kind: Literal["fourier"] = "fourier"
    harmonics: Annotated[int, Field(ge=2)] = key(5, "Number of harmonics.")
    start: Start = None
    end: End = None


class RawFourierSection(SeriesOfAKind):
    """A finite Fourier series that need not rest anywhere: for rigs that get into it themselves."""

    kind: Literal["raw_fourier"]


class BlendedFourierSection(SeriesOfAKind):
    """A Fourier series between two quintic blends, from rest and back to it."""

    kind: Literal["blended_fourier"]
    periods: Periods = 1
    blend: Positive = key(2.0, "Length of each blend [s].")
    start: Start = None


class RampedFourierSection(SeriesOfAKind):
    """A Fourier series whose amplitude rises from zero and falls back to it."""

    kind: Literal["ramped_fourier"]
    periods: Periods = 1
    ramp: Positive = key(2.0, "Length of each ramp [s].")
    start: Start = None


class SplineSection(MotionOfAKind):
    """B-splines from rest to rest."""

    kind: Literal["spline"]
    duration: Positive = key(10.0, "Length of the motion [s].")
    points: Annotated[int, Field(ge=7)] = key(15, "Number of control points.")
    degree: Literal[3, 5] = key(5, "Degree of the splines.")
    start: Start = None
    end: End = None


class ReachingSection(MotionOfAKind):
    """Minimum-jerk moves between postures."""

    kind: Literal["reaching"]
    targets: Count = key(8, "Number of configurations.")
    move: Positive = key(1.0, "Length of each move [s].")
    dwell: Annotated[float, Field(ge=0.0)] = key(0.2, "Standstill at each configuration [s].")
    start: Start = None


class PickAndPlaceSection(ToolMotionOfAKind):
    """Random pick-and-place cycles between two boxes."""

    kind: Literal["pick_and_place"]
    pick: BoxSpans = key(..., "Box of the first points.")
    place: BoxSpans = key(..., "Box of the second points.")
    cycles: Count = key(8, "Number of cycles.")
    lift: Annotated[float, Field(ge=0.0)] = key(0.1, "Height of the lift [m].")
    path: ToolPath = "line"


class SquareSection(ToolMotionOfAKind):
    """The edges of a horizontal square."""

    kind: Literal["square"]
    centre: Vector = key(..., "Centre in the base frame [m].")
    side: Positive = key(..., "Length of an edge [m].")
    laps: Count = key(2, "Number of laps.")


class WaypointsSection(ToolMotionOfAKind):
    """From point to point of the tool."""

    kind: Literal["waypoints"]
    points: Annotated[tuple[Vector, ...], Field(strict=False, min_length=2)] = key(
        ..., "Points of the tool in the base frame [m]."
    )
    path: ToolPath = "line"


class CircleSection(MotionOfAKind):
    """A circle of the tool at a constant speed, started and stopped smoothly."""

    kind: Literal["circle"]
    centre: Vector = key(..., "Centre in the base frame [m].")
    radius: Positive = key(..., "Radius [m].")
    period: Positive = key(5.0, "Time of a lap at full speed [s].")
    laps: Count = key(2, "Number of whole turns, ramps included.")
    ramp: Positive = key(1.0, "Time in which the speed rises, and in which it falls [s].")
    normal: Vector | None = key(
        None, "Axis of the turn, right-handed, in the base frame; against gravity if left out."
    )
    angle: float = key(0.0, "Where it starts [rad], from the base's x axis in its plane.")
    tool_axis: ToolAxis = None
    start: StartNearby = None


class CartesianReachingSection(MotionOfAKind):
    """Straight minimum-jerk reaches of the tool from a home to targets and back."""

    kind: Literal["cartesian_reaching"]
    home: Vector = key(..., "Where every reach begins and returns to, in the base frame [m].")
    targets: Count | Annotated[tuple[Vector, ...], Field(strict=False, min_length=1)] = key(
        8, "Number of targets on a circle about the home, or their positions [m]."
    )
    radius: Positive | None = key(None, "Radius of that circle [m].")
    normal: Vector | None = key(
        None, "Normal of its plane, in the base frame; against gravity if left out."
    )
    angle: float = key(
        0.0, "Direction of the first of them [rad], from the base's x axis in that plane."
    )
    move: Positive = key(1.0, "Time of each reach, out or back [s].")
    dwell: Annotated[float, Field(ge=0.0)] = key(0.2, "Standstill after each reach [s].")
    cycles: Count = key(1, "How often all targets are visited.")
    tool_axis: ToolAxis = None
    start: StartNearby = None


class SweepsSection(MotionOfAKind):
    """One joint after another, back and forth at several constant speeds."""

    kind: Literal["sweeps"]
    speeds: Count = key(5, "Number of speeds.")
    slowest: Share = key(0.05, "Lowest speed, as a share of the greatest.")
    start: Start = None


class PosturesSection(MotionOfAKind):
    """Standing still at many postures."""

    kind: Literal["postures"]
    count: Count = key(20, "Number of configurations.")
    dwell: Positive = key(1.0, "Standstill at each [s].")


class ReplaySection(MotionOfAKind):
    """A motion from a file."""

    kind: Literal["replay"]
    file: Name = key(..., "A `trajectory.json` or a table of samples.")


MotionSection = Annotated[
    FourierSection
    | RawFourierSection
    | BlendedFourierSection
    | RampedFourierSection
    | SplineSection
    | ReachingSection
    | PickAndPlaceSection
    | SquareSection
    | WaypointsSection
    | CircleSection
    | CartesianReachingSection
    | SweepsSection
    | PosturesSection
    | ReplaySection,
    Field(discriminator="kind"),
    # a table that names no kind is of the usual one
    BeforeValidator(lambda x: {"kind": "fourier", **x} if isinstance(x, dict) else x),
]

MOTIONS: tuple[type[Section], ...] = get_args(get_args(MotionSection)[0])
"""Sections of all kinds of motion."""

KINDS: tuple[str, ...] = tuple(get_args(m.model_fields["kind"].annotation)[0] for m in MOTIONS)
"""Names of all kinds of motion."""

PerJoint = Positive | Many[Positive] | dict[str, Positive]
Pairs = Many[Pair]

WATER = 1000.0  # density that a load without a radius is taken to have [kg/m³]


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


class StanceSection(Section):
    """Feet that stay where they are on a horizontal floor while the robot moves above them."""

    feet: Annotated[tuple[Name, ...], Field(strict=False, min_length=1)] = key(
        ..., "Links or frames that stand."
    )
    points: Annotated[tuple[Vector, ...], Field(strict=False, min_length=1)] = key(
        ((0.0, 0.0, 0.0),),
        "Where each foot touches, in its frame [m]: one point, or the corners of a sole.",
    )
    radius: Annotated[float, Field(ge=0.0)] = key(
        0.0, "Radius of balls about these points, which roll on the floor [m]."
    )
    posture: Posture | None = key(
        None, "Configuration in which it stands upright, a list or by joint [rad; m]; zero else."
    )
    friction: Positive = key(0.4, "Coefficient of friction that the motion may use.")
    least_load: Share = key(0.2, "Least load of each point, over an equal share of the weight.")
    sway: Positive = key(0.1, "How far the base goes from there along each axis [m].")
    tilt: Positive = key(0.3, "How far it turns about each axis [rad].")


class ExcitationSection(Section):
    """All about the motion that is wanted."""

    motion: MotionSection = key(FourierSection(), "Family of motions.")
    limits: MotionLimitsSection = key(MotionLimitsSection(), "Limits of the motion.")
    workspace: WorkspaceSection | None = key(None, "Where the robot may be.")
    collision: CollisionSection | None = key(None, "What may not touch.")
    criterion: CriterionSection = key(CriterionSection(), "What is minimised.")
    loads: Many[LoadSection] = key((), "Loads that may hang on the robot.")
    stance: StanceSection | None = key(None, "Feet on which a robot stands meanwhile.")
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
