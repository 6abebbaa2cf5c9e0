"""The `[excitation.motion]` table of the robot file: kinds of motion and their numbers."""

from typing import Annotated, Any, Literal, get_args

from pydantic import BeforeValidator, Field

from steelyard.robot.file.toml import Name, Positive, Section, Vector

Share = Annotated[float, Field(gt=0.0, le=1.0)]
Count = Annotated[int, Field(ge=1)]
Span = Annotated[tuple[float, float], Field(strict=False)]
Posture = Annotated[tuple[float, ...], Field(strict=False)] | dict[str, float]


class BoxSpans(Section):
    """From least to greatest, along the axes of the base [m]; open where left out.

    Attributes:
        x: Range along x [m].
        y: Range along y [m].
        z: Range along z [m].
    """

    x: Span | None = None
    y: Span | None = None
    z: Span | None = None

    @property
    def bounded(self) -> bool:
        """Whether it is closed anywhere."""
        return not (self.x is None and self.y is None and self.z is None)


class FourierSection(Section):
    """A finite Fourier series that starts and ends at rest.

    Attributes:
        kind: Kind of motion.
        period: Length of one period [s].
        harmonics: Number of harmonics.
        start: First configuration, a list or by joint [rad; m]; chosen by the search if left out.
        end: Last configuration, likewise.
    """

    kind: Literal["fourier"] = "fourier"
    period: Positive = 10.0
    harmonics: Annotated[int, Field(ge=2)] = 5
    start: Posture | None = None
    end: Posture | None = None


class RawFourierSection(Section):
    """A finite Fourier series that need not rest anywhere: for rigs that get into it themselves.

    Attributes:
        kind: Kind of motion.
        period: Length of one period [s].
        harmonics: Number of harmonics.
    """

    kind: Literal["raw_fourier"]
    period: Positive = 10.0
    harmonics: Count = 5


class BlendedFourierSection(Section):
    """A Fourier series between two quintic blends, from rest and back to it.

    Attributes:
        kind: Kind of motion.
        period: Length of one period [s].
        harmonics: Number of harmonics.
        periods: Number of periods.
        blend: Length of each blend [s].
        start: First configuration, a list or by joint [rad; m]; chosen by the search if left out.
    """

    kind: Literal["blended_fourier"]
    period: Positive = 10.0
    harmonics: Count = 5
    periods: Count = 1
    blend: Positive = 2.0
    start: Posture | None = None


class RampedFourierSection(Section):
    """A Fourier series whose amplitude rises from zero and falls back to it.

    Attributes:
        kind: Kind of motion.
        period: Length of one period [s].
        harmonics: Number of harmonics.
        periods: Number of periods.
        ramp: Length of each ramp [s].
        start: First configuration, a list or by joint [rad; m]; chosen by the search if left out.
    """

    kind: Literal["ramped_fourier"]
    period: Positive = 10.0
    harmonics: Count = 5
    periods: Count = 1
    ramp: Positive = 2.0
    start: Posture | None = None


class SplineSection(Section):
    """B-splines from rest to rest.

    Attributes:
        kind: Kind of motion.
        duration: Length of the motion [s].
        points: Number of control points.
        degree: Degree of the splines.
        start: First configuration, a list or by joint [rad; m]; chosen by the search if left out.
        end: Last configuration, likewise.
    """

    kind: Literal["spline"]
    duration: Positive = 10.0
    points: Annotated[int, Field(ge=7)] = 15
    degree: Literal[3, 5] = 5
    start: Posture | None = None
    end: Posture | None = None


class ReachingSection(Section):
    """Minimum-jerk moves between postures.

    Attributes:
        kind: Kind of motion.
        targets: Number of configurations.
        move: Length of each move [s].
        dwell: Standstill at each configuration [s].
        start: First configuration, a list or by joint [rad; m]; chosen by the search if left out.
    """

    kind: Literal["reaching"]
    targets: Count = 8
    move: Positive = 1.0
    dwell: Annotated[float, Field(ge=0.0)] = 0.2
    start: Posture | None = None


class PickAndPlaceSection(Section):
    """Random pick-and-place cycles between two boxes.

    Attributes:
        kind: Kind of motion.
        pick: Box of the first points.
        place: Box of the second points.
        cycles: Number of cycles.
        lift: Height of the lift [m].
        path: Path of the tool: a straight `line`, or straight in `joint` space.
        dwell: Standstill between moves [s].
        speed: Greatest speed of the tool [m/s].
        acceleration: Greatest acceleration of the tool [m/s²].
        tool_axis: Direction of the tool's z axis in the base frame; free if left out.
    """

    kind: Literal["pick_and_place"]
    pick: BoxSpans
    place: BoxSpans
    cycles: Count = 8
    lift: Annotated[float, Field(ge=0.0)] = 0.1
    path: Literal["line", "joint"] = "line"
    dwell: Annotated[float, Field(ge=0.0)] = 0.1
    speed: Positive = 1.0
    acceleration: Positive = 5.0
    tool_axis: Vector | None = None


class SquareSection(Section):
    """The edges of a horizontal square.

    Attributes:
        kind: Kind of motion.
        centre: Centre in the base frame [m].
        side: Length of an edge [m].
        laps: Number of laps.
        dwell: Standstill between moves [s].
        speed: Greatest speed of the tool [m/s].
        acceleration: Greatest acceleration of the tool [m/s²].
        tool_axis: Direction of the tool's z axis in the base frame; free if left out.
    """

    kind: Literal["square"]
    centre: Vector
    side: Positive
    laps: Count = 2
    dwell: Annotated[float, Field(ge=0.0)] = 0.1
    speed: Positive = 1.0
    acceleration: Positive = 5.0
    tool_axis: Vector | None = None


class WaypointsSection(Section):
    """From point to point of the tool.

    Attributes:
        kind: Kind of motion.
        points: Points of the tool in the base frame [m].
        path: Path of the tool: a straight `line`, or straight in `joint` space.
        dwell: Standstill between moves [s].
        speed: Greatest speed of the tool [m/s].
        acceleration: Greatest acceleration of the tool [m/s²].
        tool_axis: Direction of the tool's z axis in the base frame; free if left out.
    """

    kind: Literal["waypoints"]
    points: Annotated[tuple[Vector, ...], Field(strict=False, min_length=2)]
    path: Literal["line", "joint"] = "line"
    dwell: Annotated[float, Field(ge=0.0)] = 0.1
    speed: Positive = 1.0
    acceleration: Positive = 5.0
    tool_axis: Vector | None = None


class CircleSection(Section):
    """A circle of the tool at a constant speed, started and stopped smoothly.

    Attributes:
        kind: Kind of motion.
        centre: Centre in the base frame [m].
        radius: Radius [m].
        period: Time of a lap at full speed [s].
        laps: Number of whole turns, ramps included.
        ramp: Time in which the speed rises, and in which it falls [s].
        normal: Axis of the turn, right-handed, in the base frame; against gravity if left out.
        angle: Where it starts [rad], from the base's x axis in its plane.
        tool_axis: Direction of the tool's z axis in the base frame; free if left out.
        start: Configuration near which it starts, a list or by joint [rad; m].
    """

    kind: Literal["circle"]
    centre: Vector
    radius: Positive
    period: Positive = 5.0
    laps: Count = 2
    ramp: Positive = 1.0
    normal: Vector | None = None
    angle: float = 0.0
    tool_axis: Vector | None = None
    start: Posture | None = None


class CartesianReachingSection(Section):
    """Straight minimum-jerk reaches of the tool from a home to targets and back.

    Attributes:
        kind: Kind of motion.
        home: Where every reach begins and returns to, in the base frame [m].
        targets: Number of targets on a circle about the home, or their positions [m].
        radius: Radius of that circle [m].
        normal: Normal of its plane, in the base frame; against gravity if left out.
        angle: Direction of the first of them [rad], from the base's x axis in that plane.
        move: Time of each reach, out or back [s].
        dwell: Standstill after each reach [s].
        cycles: How often all targets are visited.
        tool_axis: Direction of the tool's z axis in the base frame; free if left out.
        start: Configuration near which it starts, a list or by joint [rad; m].
    """

    kind: Literal["cartesian_reaching"]
    home: Vector
    targets: Count | Annotated[tuple[Vector, ...], Field(strict=False, min_length=1)] = 8
    radius: Positive | None = None
    normal: Vector | None = None
    angle: float = 0.0
    move: Positive = 1.0
    dwell: Annotated[float, Field(ge=0.0)] = 0.2
    cycles: Count = 1
    tool_axis: Vector | None = None
    start: Posture | None = None


class SweepsSection(Section):
    """One joint after another, back and forth at several constant speeds.

    Attributes:
        kind: Kind of motion.
        speeds: Number of speeds.
        slowest: Lowest speed, as a share of the greatest.
        start: First configuration, a list or by joint [rad; m]; chosen by the search if left out.
    """

    kind: Literal["sweeps"]
    speeds: Count = 5
    slowest: Share = 0.05
    start: Posture | None = None


class PosturesSection(Section):
    """Standing still at many postures.

    Attributes:
        kind: Kind of motion.
        count: Number of configurations.
        dwell: Standstill at each [s].
    """

    kind: Literal["postures"]
    count: Count = 20
    dwell: Positive = 1.0


class ReplaySection(Section):
    """A motion from a file.

    Attributes:
        kind: Kind of motion.
        file: A `trajectory.json` or a table of samples.
    """

    kind: Literal["replay"]
    file: Name


def _of_a_kind(table: Any) -> Any:
    """The table, of the usual kind of motion where it names none."""
    if isinstance(table, dict) and "kind" not in table:
        return {"kind": "fourier", **table}
    return table


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
    BeforeValidator(_of_a_kind),
]


MOTIONS: tuple[type[Section], ...] = get_args(get_args(MotionSection)[0])
"""Sections of all kinds of motion."""

KINDS: tuple[str, ...] = tuple(get_args(m.model_fields["kind"].annotation)[0] for m in MOTIONS)
"""Names of all kinds of motion."""
