"""The sections of the robot file, as pydantic checks them."""

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

EffortKind = Literal["motor_current", "motor_torque", "joint_torque"]
PositionUnit = Literal["rad", "deg", "m", "mm"]
VelocityUnit = Literal["rad/s", "deg/s", "rpm", "m/s", "mm/s"]
EffortUnit = Literal["A", "mA", "Nm", "N"]
TimeUnit = Literal["s", "ms", "us", "ns"]

Positive = Annotated[float, Field(gt=0.0)]
Name = Annotated[str, Field(min_length=1)]
Vector = Annotated[tuple[float, float, float], Field(strict=False)]
Six = Annotated[tuple[float, float, float, float, float, float], Field(strict=False)]
Names = Annotated[tuple[Name, ...], Field(strict=False)]
Numbers = Annotated[tuple[float, ...], Field(strict=False)]


class Section(BaseModel):
    """A table of the robot file: no unknown keys, no silent conversions."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True, allow_inf_nan=False)


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


class RobotSection(Section):
    """Which robot, which of its joints move, and how it is mounted."""

    name: Name | None = None
    source: str | None = None
    urdf: Name | None = None
    mjcf: Name | None = None
    dh: DHSection | None = None
    joints: Names | None = None
    base: Name | None = None
    tip: Name | Names | None = None
    gravity: Vector | None = None
    mounting: MountingSection | None = None
    locked: dict[str, float] = {}
    limits: dict[str, LimitsSection] = {}


class ModelSection(Section):
    """The causes of torque: law names, or tables with the name under `law`."""

    terms: Annotated[tuple[Name | dict[str, Any], ...], Field(strict=False, min_length=1)]


class EffortSection(Section):
    """What the effort columns hold."""

    columns: Name | Names
    kind: EffortKind
    unit: EffortUnit | Annotated[tuple[EffortUnit, ...], Field(strict=False)]
    gain: float | Numbers | None = None


class SignalsSection(Section):
    """Which columns of a log are what."""

    time: Name
    time_unit: TimeUnit = "s"
    position: Name | Names
    position_unit: (
        PositionUnit | Annotated[tuple[PositionUnit, ...], Field(strict=False)] | None
    ) = None
    velocity: Name | Names | None = None
    velocity_unit: (
        VelocityUnit | Annotated[tuple[VelocityUnit, ...], Field(strict=False)] | None
    ) = None
    effort: EffortSection


class ProcessingSection(Section):
    """How logs are filtered; what is left out is chosen from the data."""

    motion_cutoff: Positive | None = None
    matched_cutoff: Positive | None = None
    rest_speed: Positive | None = None


class ValidationSection(Section):
    """How scores are formed."""

    cutoff: Positive | None = None


class RobotFile(Section):
    """The whole robot file."""

    robot: RobotSection
    model: ModelSection | None = None
    signals: SignalsSection | None = None
    processing: ProcessingSection = ProcessingSection()
    validation: ValidationSection = ValidationSection()
