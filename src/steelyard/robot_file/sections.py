"""The sections of the robot file, as pydantic checks them."""

from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field, TypeAdapter, ValidationError

from steelyard.robot_file.excitation_sections import ExcitationSection as ExcitationSection
from steelyard.robot_file.section import Name as Name
from steelyard.robot_file.section import Names as Names
from steelyard.robot_file.section import Numbers as Numbers
from steelyard.robot_file.section import Positive as Positive
from steelyard.robot_file.section import Section as Section
from steelyard.robot_file.section import Vector as Vector

EffortKind = Literal[
    "motor_current", "motor_torque", "joint_torque", "link_torque", "gravity_compensated_torque"
]
Side = Literal["joint", "motor"]
PositionUnit = Literal["rad", "deg", "m", "mm"]
VelocityUnit = Literal["rad/s", "deg/s", "rpm", "m/s", "mm/s"]
EffortUnit = Literal["A", "mA", "Nm", "N", "%"]
Sign = Literal[1, -1]
TimeUnit = Literal["s", "ms", "us", "ns"]

Gain = float | Literal["identify"]
ZeroOffset = float | Literal["identify"]
Rate = Annotated[float, Field(gt=0.0, le=1e6)]
Delay = Annotated[float, Field(ge=-2.0, le=2.0)]
Six = Annotated[tuple[float, float, float, float, float, float], Field(strict=False)]


class MountingSection(Section):
    """How the base is turned against the upright world: R = Rz(yaw) Ry(pitch) Rx(roll) [deg]."""

    roll: float = 0.0
    pitch: float = 0.0
    yaw: float = 0.0


class LimitsSection(Section):
    """Limits of one joint that replace the model's; what is left out is taken from there."""

    lower: float | None = None
    upper: float | None = None
    velocity: Positive | None = None
    effort: Positive | None = None


class DHLinkSection(Section):
    """One row of a Denavit-Hartenberg table, see `dh.DHRow`."""

    joint: Name | None = None
    kind: Literal["revolute", "prismatic"] = "revolute"
    a: float = 0.0
    alpha: float = 0.0
    d: float = 0.0
    theta: float = 0.0
    mass: float | None = None
    com: Vector = (0.0, 0.0, 0.0)
    inertia_com: Six = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class DHSection(Section):
    """A Denavit-Hartenberg table."""

    convention: Literal["standard", "modified"]
    angle_unit: Literal["rad", "deg"] = "rad"
    links: Annotated[tuple[DHLinkSection, ...], Field(strict=False, min_length=1)]


class CouplingSection(Section):
    """A motor that turns with a joint that is not its own."""

    motor: Name
    joint: Name
    ratio: float


class TransmissionSection(Section):
    """Gears between motors and joints, see `robot.Transmission`."""

    motors: Names | None = None
    ratios: Numbers | None = None
    coupling: Annotated[tuple[CouplingSection, ...], Field(strict=False)] = ()
    matrix: Annotated[tuple[Numbers, ...], Field(strict=False)] | None = None


class LoopSection(Section):
    """A pin that closes a chain: a point of one link, in its frame, stays on one of another."""

    name: Name | None = None
    links: Annotated[tuple[Name, Name], Field(strict=False)]
    points: Annotated[tuple[Vector, Vector], Field(strict=False)]


class XacroSection(Section):
    """How the model file is expanded, if it is a xacro file.

    `arguments`: what `$(arg NAME)` stands for. `packages`: folders of ROS packages, from the robot
    file's folder.
    """

    arguments: dict[str, str | bool | int | float] = {}
    packages: Names = ()


class RobotSection(Section):
    """Which robot, which of its joints move, and how it is mounted."""

    name: Name | None = None
    source: str | None = None
    urdf: Name | None = None
    mjcf: Name | None = None
    dh: DHSection | None = None
    xacro: XacroSection = XacroSection()
    joints: Names | None = None
    base: Name | None = None
    tip: Name | Names | None = None
    gravity: Vector | None = None
    mounting: MountingSection | None = None
    snap_angles: bool = True
    locked: dict[str, float] = {}
    limits: dict[str, LimitsSection] = {}
    transmission: TransmissionSection | None = None
    loops: Annotated[tuple[LoopSection, ...], Field(strict=False)] = ()
    passive: Names | None = None
    assembly: dict[str, float] = {}
    open_loops: Literal["stop", "drop"] = "stop"


class ModelSection(Section):
    """The causes of torque: law names, or tables with the name under `law`.

    With `friction = "auto"` the friction laws are chosen from the data, beside the terms listed.
    """

    terms: (
        Annotated[tuple[Name | dict[str, Any], ...], Field(strict=False, min_length=1)] | None
    ) = None
    friction: Literal["auto"] | None = None


class EffortSection(Section):
    """What the effort columns hold."""

    columns: Name | Names
    kind: EffortKind
    unit: EffortUnit | Annotated[tuple[EffortUnit, ...], Field(strict=False)]
    side: Side = "joint"
    gain: Gain | Annotated[tuple[Gain, ...], Field(strict=False)] | None = None
    delay: Delay = 0.0


class SignalsSection(Section):
    """Which columns of a log are what."""

    time: Name | None = None
    time_unit: TimeUnit = "s"
    rate: Rate | None = None
    coordinates: Side = "joint"
    position: Name | Names
    position_unit: (
        PositionUnit | Annotated[tuple[PositionUnit, ...], Field(strict=False)] | None
    ) = None
    position_sign: Annotated[tuple[Sign, ...], Field(strict=False)] | None = None
    position_offset: (
        Literal["identify"] | Annotated[tuple[ZeroOffset, ...], Field(strict=False)] | None
    ) = None
    velocity: Name | Names | None = None
    velocity_unit: (
        VelocityUnit | Annotated[tuple[VelocityUnit, ...], Field(strict=False)] | None
    ) = None
    velocity_sign: Annotated[tuple[Sign, ...], Field(strict=False)] | None = None
    velocity_delay: Delay = 0.0
    effort: EffortSection


class RepetitionsTable(Section):
    """That a log repeats one motion; a period that is left out is found."""

    period: Positive | None = None
    drop_first: Annotated[int, Field(ge=0)] = 1
    drop_last: Annotated[int, Field(ge=0)] = 1


class ProcessingSection(Section):
    """The chain from rows to motion; what is left out is chosen from the data.

    `motion` and `effort` are a method's name, or a table with the name under `method` and its
    settings; what they may be, the measurement room knows.
    """

    outliers: Positive | Literal["keep"] = 15.0
    repeats: Literal["bridge", "keep"] = "bridge"
    saturation: Literal["leave_out", "keep"] = "leave_out"
    rate: Positive | None = None
    resampling: Literal["cubic", "linear", "pchip", "spline"] = "cubic"
    motion: Name | dict[str, Any] | None = None
    motion_cutoff: Positive | None = None
    effort: Name | dict[str, Any] | None = None
    matched_cutoff: Positive | None = None
    rest_speed: Positive | None = None
    repetitions: Literal["find"] | RepetitionsTable | None = None


class EstimationSection(Section):
    """How parameters are estimated.

    `method`: `consistent` with physics and what is known beforehand, plain `least_squares`, or
    any other estimator by its name.
    `weights`: joints weigh by the `noise` of their own residuals, or are `equal`.
    `effort_scales`: a scale of each joint's efforts, where the data ask for it; or none.
    """

    method: Name = "consistent"
    weights: Literal["noise", "equal"] = "noise"
    effort_scales: Literal["auto", "off"] = "auto"


class BoxSection(Section):
    """A solid box: its edges [m] along the axes of the link's frame, and its centre there."""

    size: Annotated[tuple[Positive, Positive, Positive], Field(strict=False)]
    centre: Vector = (0.0, 0.0, 0.0)


class CapsuleSection(Section):
    """A solid rod with round ends: centres of the end balls in the link's frame, radius [m]."""

    start: Vector = (0.0, 0.0, 0.0)
    end: Vector
    radius: Positive


class LinkPriorSection(Section):
    """What is known of one link before the data, in its own frame.

    `source`: what is left out says the `model` file; or `none`: nothing is known of the link.
    """

    source: Literal["model", "none"] = "model"
    mass: Positive | None = None
    com: Vector | None = None
    inertia_com: Six | None = None
    box: BoxSection | None = None
    capsule: CapsuleSection | None = None


class PriorSection(Section):
    """Mass properties before the data.

    `source`: those of the `model` file, or `none` but for the links listed. `uncertainty`: how
    far they are off, relatively; found from the data if left out.
    """

    source: Literal["model", "none"] = "model"
    uncertainty: Annotated[float, Field(ge=1e-4)] | None = None
    links: dict[str, LinkPriorSection] = {}


class ValidationSection(Section):
    """How scores are formed."""

    cutoff: Positive | None = None


class RobotFile(Section):
    """The whole robot file."""

    robot: RobotSection
    model: ModelSection | None = None
    signals: SignalsSection | None = None
    processing: ProcessingSection = ProcessingSection()
    estimation: EstimationSection = EstimationSection()
    prior: PriorSection = PriorSection()
    knowledge: Annotated[tuple[dict[str, Any], ...], Field(strict=False)] = ()
    validation: ValidationSection = ValidationSection()
    excitation: ExcitationSection = ExcitationSection()


def as_declared(declared: Any, value: Any) -> Any:
    """A value from a file as a type says it, strictly; lists are tuples.

    Raises:
        ValueError: It is of another type; the message says which is wanted.
    """
    strict = ConfigDict(strict=True, allow_inf_nan=False)
    value = tuple(value) if isinstance(value, list) else value
    try:
        return TypeAdapter(declared, config=strict).validate_python(value)
    except ValidationError as error:
        raise ValueError(error.errors()[0]["msg"].lower()) from None
