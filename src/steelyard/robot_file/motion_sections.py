"""The `[excitation.motion]` table of the robot file: kinds of motion and their numbers."""

from typing import Annotated, Any, Literal, get_args

from pydantic import BeforeValidator, Field

from steelyard.robot_file.section import Name, Positive, Section, Vector

Share = Annotated[float, Field(gt=0.0, le=1.0)]
Count = Annotated[int, Field(ge=1)]
Span = Annotated[tuple[float, float], Field(strict=False)]
Posture = Annotated[tuple[float, ...], Field(strict=False)] | dict[str, float]


class BoxSpans(Section):
    """From least to greatest, along the axes of the base [m]; open where left out."""

    x: Span | None = None
    y: Span | None = None
    z: Span | None = None

    @property
    def bounded(self) -> bool:
        """Whether it is closed anywhere."""
        return not (self.x is None and self.y is None and self.z is None)


class FourierSection(Section):
    """A finite Fourier series that starts and ends at rest."""

    kind: Literal["fourier"] = "fourier"
    period: Positive = 10.0
    harmonics: Annotated[int, Field(ge=2)] = 5
    start: Posture | None = None
    end: Posture | None = None


class RawFourierSection(Section):
    """A finite Fourier series that need not rest anywhere: for rigs that get into it themselves."""

    kind: Literal["raw_fourier"]
    period: Positive = 10.0
    harmonics: Count = 5


class BlendedFourierSection(Section):
    """A Fourier series between two quintic blends, from rest and back to it."""

    kind: Literal["blended_fourier"]
    period: Positive = 10.0
    harmonics: Count = 5
    periods: Count = 1
    blend: Positive = 2.0
    start: Posture | None = None


class RampedFourierSection(Section):
    """A Fourier series whose amplitude rises from zero and falls back to it."""

    kind: Literal["ramped_fourier"]
    period: Positive = 10.0
    harmonics: Count = 5
    periods: Count = 1
    ramp: Positive = 2.0
    start: Posture | None = None


class SplineSection(Section):
    """B-splines from rest to rest."""

    kind: Literal["spline"]
    duration: Positive = 10.0
    points: Annotated[int, Field(ge=7)] = 15
    degree: Literal[3, 5] = 5
    start: Posture | None = None
    end: Posture | None = None


class ReachingSection(Section):
    """Minimum-jerk moves between postures."""

    kind: Literal["reaching"]
    targets: Count = 8
    move: Positive = 1.0
    dwell: Annotated[float, Field(ge=0.0)] = 0.2
    start: Posture | None = None


class PickAndPlaceSection(Section):
    """Random pick-and-place cycles between two boxes."""

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
    """The edges of a horizontal square."""

    kind: Literal["square"]
    centre: Vector
    side: Positive
    laps: Count = 2
    dwell: Annotated[float, Field(ge=0.0)] = 0.1
    speed: Positive = 1.0
    acceleration: Positive = 5.0
    tool_axis: Vector | None = None


class WaypointsSection(Section):
    """From point to point of the tool."""

    kind: Literal["waypoints"]
    points: Annotated[tuple[Vector, ...], Field(strict=False, min_length=2)]
    path: Literal["line", "joint"] = "line"
    dwell: Annotated[float, Field(ge=0.0)] = 0.1
    speed: Positive = 1.0
    acceleration: Positive = 5.0
    tool_axis: Vector | None = None


class SweepsSection(Section):
    """One joint after another, back and forth at several constant speeds."""

    kind: Literal["sweeps"]
    speeds: Count = 5
    slowest: Share = 0.05
    start: Posture | None = None


class PosturesSection(Section):
    """Standing still at many postures."""

    kind: Literal["postures"]
    count: Count = 20
    dwell: Positive = 1.0


class ReplaySection(Section):
    """A motion from a file."""

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
