"""The sections of the robot file, as pydantic checks them."""

from typing import Annotated, Any, Literal, get_args

from pydantic import ConfigDict, Field, TypeAdapter, ValidationError, field_validator
from pydantic_core import PydanticCustomError

from steelyard.robot.file.excitation_sections import ExcitationSection as ExcitationSection
from steelyard.robot.file.toml import ADVICE
from steelyard.robot.file.toml import Name as Name
from steelyard.robot.file.toml import Names as Names
from steelyard.robot.file.toml import Numbers as Numbers
from steelyard.robot.file.toml import Positive as Positive
from steelyard.robot.file.toml import Section as Section
from steelyard.robot.file.toml import Vector as Vector

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
    """How the base is turned against the upright world: R = Rz(yaw) Ry(pitch) Rx(roll) [deg].

    Attributes:
        roll: Rotation about the base's x axis, first [deg].
        pitch: Rotation about the fixed y axis, second [deg].
        yaw: Rotation about the fixed z axis, last [deg].
    """

    roll: float = 0.0
    pitch: float = 0.0
    yaw: float = 0.0


class LimitsSection(Section):
    """Limits of one joint that replace the model's; what is left out is taken from there.

    Attributes:
        lower: Least position [rad; m].
        upper: Greatest position [rad; m].
        velocity: Greatest speed [rad/s; m/s].
        effort: Greatest effort [Nm; N].
    """

    lower: float | None = None
    upper: float | None = None
    velocity: Positive | None = None
    effort: Positive | None = None


class DHLinkSection(Section):
    """One row of a Denavit-Hartenberg table, see `dh.DHRow`.

    Attributes:
        joint: Name of the joint; `joint_1`, `joint_2`, ... if left out.
        kind: Type of the joint.
        a: Length of the link [m].
        alpha: Twist of the link, in `angle_unit`.
        d: Offset along the joint's axis [m].
        theta: Joint angle at position zero, in `angle_unit`.
        mass: Mass [kg].
        com: Centre of mass in the link's DH frame [m].
        inertia_com: `Ixx, Ixy, Iyy, Ixz, Iyz, Izz` about the centre of mass [kg m²].
    """

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
    """A Denavit-Hartenberg table.

    Attributes:
        convention: `modified` (Craig, Khalil) or `standard`.
        angle_unit: Unit of `alpha` and `theta`.
        links: Rows of the table, from base to tip.
    """

    convention: Literal["standard", "modified"]
    angle_unit: Literal["rad", "deg"] = "rad"
    links: Annotated[tuple[DHLinkSection, ...], Field(strict=False, min_length=1)]


class CouplingSection(Section):
    """A motor that turns with a joint that is not its own.

    Attributes:
        motor: The motor.
        joint: The joint that it turns with besides its own.
        ratio: Motor positions per joint position.
    """

    motor: Name
    joint: Name
    ratio: float


class TransmissionSection(Section):
    """Gears between motors and joints, see `robot.Transmission`.

    Attributes:
        motors: Names of motors; `motor_1`, `motor_2`, ... if left out.
        ratios: Diagonal of R in motor positions q_m = R q, in the order of the joints.
        coupling: Entries of R outside its diagonal; `[]` states that there are none.
        matrix: R in full, one row per motor, instead of `ratios` and `coupling`.
    """

    motors: Names | None = None
    ratios: Numbers | None = None
    coupling: Annotated[tuple[CouplingSection, ...], Field(strict=False)] = ()
    matrix: Annotated[tuple[Numbers, ...], Field(strict=False)] | None = None

    @property
    def couplings_stated(self) -> bool:
        """Whether the couplings are given, or that there are none."""
        return self.matrix is not None or "coupling" in self.model_fields_set


class LoopSection(Section):
    """A pin that closes a chain: a point of one link, in its frame, stays on one of another.

    Attributes:
        name: Name in messages; `loop1`, `loop2`, ... if left out.
        links: The two links that meet.
        points: The loop-closure joint in the frame of each link [m].
    """

    name: Name | None = None
    links: Annotated[tuple[Name, Name], Field(strict=False)]
    points: Annotated[tuple[Vector, Vector], Field(strict=False)]


class XacroSection(Section):
    """How the model file is expanded, if it is a xacro file.

    Attributes:
        arguments: Values of `$(arg NAME)`.
        packages: Folders of ROS packages, or packages, relative to the robot file.
    """

    arguments: dict[str, str | bool | int | float] = {}
    packages: Names = ()


class RobotSection(Section):
    """Which robot, which of its joints move, and how it is mounted.

    Attributes:
        name: Name of the robot; the model's if left out.
        source: Origin of the model and of the data, for the report.
        urdf: URDF or xacro file.
        mjcf: MJCF file.
        dh: Denavit-Hartenberg table, instead of a file.
        xacro: Expansion of a xacro file.
        joints: Joints to identify, in the order of the log's columns; all if left out.
        base: Link that is fixed to the world; the model's root if left out.
        tip: Last link, or links, of the robot; all if left out.
        gravity: Gravity in the base frame [m/s²], instead of `mounting`.
        mounting: Orientation of the base relative to upright.
        snap_angles: Whether entries of rotations and axes below 2e-5 are rounded to exact ones.
        locked: Positions of joints that do not move [rad; m].
        limits: Limits that replace those of the model, by joint.
        transmission: Gears between motors and joints.
        loops: Loop-closure joints of closed chains.
        passive: Joints whose positions follow from the loops; not logged.
        assembly: Approximate reference configuration of closed chains, by joint [rad; m].
        open_loops: What is done with samples at which a loop cannot close: `stop` with an error, or
            `drop` them.
    """

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


FrictionSelection = Literal["auto", "auto_memoryless"]
"""How friction laws are chosen from the data."""


class ModelSection(Section):
    """The causes of torque: law names, or tables with the name under `law`.

    Attributes:
        terms: Torque terms: names of laws, or tables with the name under `law`; the default terms
            if left out.
        friction: `auto`: friction laws are chosen from the data; `auto_memoryless`: from laws of
            position and velocity alone, without memory and without load.
    """

    terms: (
        Annotated[tuple[Name | dict[str, Any], ...], Field(strict=False, min_length=1)] | None
    ) = None
    friction: FrictionSelection | None = None

    @field_validator("friction", mode="before")
    @classmethod
    def _only_auto(cls, given: Any) -> Any:
        """Fixed laws are terms."""
        if given in get_args(FrictionSelection):
            return given
        raise PydanticCustomError(
            ADVICE,
            'it should be "auto" or "auto_memoryless"; fixed laws go into terms, such as terms = '
            '["rigid_body", "rotor_inertia", "coulomb", "viscous"]',
        )


class EffortSection(Section):
    """What the effort columns hold.

    Attributes:
        columns: Columns, or one name with `{}` for 1, 2, ... or `{joint}` for the joint's name.
        kind: Content of the columns.
        unit: Unit, one for all columns or one each.
        side: Whether efforts are those of joints or of motors.
        gain: Effort per A, Nm, N or %, one for all columns or one each; `identify` estimates it.
        delay: Delay relative to positions [s]; it is corrected.
    """

    columns: Name | Names
    kind: EffortKind
    unit: EffortUnit | Annotated[tuple[EffortUnit, ...], Field(strict=False)]
    side: Side = "joint"
    gain: Gain | Annotated[tuple[Gain, ...], Field(strict=False)] | None = None
    delay: Delay = 0.0


class SignalsSection(Section):
    """Which columns of a log are what.

    Attributes:
        time: Column of time.
        time_unit: Unit of time.
        rate: Sampling rate of a log with evenly spaced rows, instead of `time` [Hz].
        coordinates: Whether positions and velocities are those of joints or of motors.
        position: Columns of positions, or one name with `{}` or `{joint}`.
        position_unit: Unit, one for all columns or one each; rad or m by the joint's type if left
            out.
        position_sign: -1 for columns that count in the opposite direction.
        position_offset: Joint positions at logged zero [rad; m]; `identify` estimates them.
        velocity: Columns of velocities; positions are differentiated if left out.
        velocity_unit: Unit, one for all columns or one each.
        velocity_sign: -1 for columns that count in the opposite direction.
        velocity_delay: Delay of velocities relative to positions [s]; it is corrected.
        commanded_position: Columns of the commanded (desired) positions, in the unit, with the
            signs and of the side of `position`; for scores from commanded motion.
        commanded_velocity: Columns of the commanded velocities, likewise; commanded positions are
            differentiated if left out.
        effort: Columns of efforts.
    """

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
    commanded_position: Name | Names | None = None
    commanded_velocity: Name | Names | None = None
    effort: EffortSection


class RepetitionsTable(Section):
    """That a log repeats one motion; a period that is left out is found.

    Attributes:
        period: Period [s]; found from the data if left out.
        drop_first: Periods that are left out at the start.
        drop_last: Periods that are left out at the end.
    """

    period: Positive | None = None
    drop_first: Annotated[int, Field(ge=0)] = 1
    drop_last: Annotated[int, Field(ge=0)] = 1


class ProcessingSection(Section):
    """The chain from rows to motion; what is left out is chosen from the data.

    Attributes:
        outliers: Threshold of the Hampel filter in scaled MAD; `keep` disables it.
        repeats: Whether repeated rows are interpolated.
        saturation: Whether saturated efforts have weight zero.
        rate: Rate of the uniform clock [Hz]; that of the log if left out.
        resampling: Interpolation to that clock.
        motion: Method that computes the motion: its name, or a table with the name under `method`.
        motion_cutoff: Cut-off of the low-pass of positions and velocities [Hz]; chosen from the
            data if left out.
        effort: Filter of efforts, like `motion`; as logged if left out.
        matched_cutoff: Cut-off of the parallel filter, the low-pass of regressor and efforts [Hz];
            chosen from the data if left out.
        rest_speed: Speed up to which a joint is at standstill [rad/s; m/s]; chosen from the data if
            left out.
        repetitions: `find`, or a table, if a log repeats one motion.
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

    Attributes:
        method: `consistent`: physically consistent, with a prior; `least_squares`: without; or the
            name of another estimator.
        weights: `noise`: joints are weighted by the variance of their residuals; or `equal`.
        effort_scales: `auto`: a scale of each joint's efforts is estimated if it is significant; or
            `off`.
    """

    method: Name = "consistent"
    weights: Literal["noise", "equal"] = "noise"
    effort_scales: Literal["auto", "off"] = "auto"


class BoxSection(Section):
    """A solid box: its edges [m] along the axes of the link's frame, and its centre there.

    Attributes:
        size: Lengths along the axes of the link's frame [m].
        centre: Centre in that frame [m].
    """

    size: Annotated[tuple[Positive, Positive, Positive], Field(strict=False)]
    centre: Vector = (0.0, 0.0, 0.0)


class CapsuleSection(Section):
    """A solid rod with round ends: centres of the end balls in the link's frame, radius [m].

    Attributes:
        start: Centre of one end's ball in the link's frame [m].
        end: Centre of the other's [m].
        radius: Radius [m].
    """

    start: Vector = (0.0, 0.0, 0.0)
    end: Vector
    radius: Positive


class LinkPriorSection(Section):
    """What is known of one link before the data, in its own frame.

    Attributes:
        source: Where the rest of the prior comes from: the `model` file, or `none`.
        mass: Mass [kg].
        com: Centre of mass [m].
        inertia_com: `Ixx, Ixy, Iyy, Ixz, Iyz, Izz` about the centre of mass [kg m²].
        box: Solid box that gives centre and inertia.
        capsule: Solid capsule that gives centre and inertia.
    """

    source: Literal["model", "none"] = "model"
    mass: Positive | None = None
    com: Vector | None = None
    inertia_com: Six | None = None
    box: BoxSection | None = None
    capsule: CapsuleSection | None = None


class PriorSection(Section):
    """Mass properties before the data.

    Attributes:
        source: Where prior masses come from: the `model` file, or `none`.
        uncertainty: Relative standard deviation; estimated from the data if left out.
        links: Priors of single links.
    """

    source: Literal["model", "none"] = "model"
    uncertainty: Annotated[float, Field(ge=1e-4)] | None = None
    links: dict[str, LinkPriorSection] = {}


class ValidationSection(Section):
    """How scores are formed.

    Attributes:
        cutoff: Cut-off of the low-pass of measured and predicted efforts [Hz]; if left out, 5 Hz
            for the headline and that of the parallel filter for the other errors.
    """

    cutoff: Positive | None = None


class RobotFile(Section):
    """The whole robot file.

    Attributes:
        robot: The robot.
        model: Torque terms.
        signals: Columns of logs.
        processing: From rows to motion.
        estimation: The estimator.
        prior: Prior of the mass properties.
        knowledge: Prior constraints, see Prior knowledge.
        validation: Scores.
        excitation: The motion that `steelyard excite` designs.
    """

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

    A `ValueError` says which type is wanted, where it is of another.
    """
    strict = ConfigDict(strict=True, allow_inf_nan=False)
    value = tuple(value) if isinstance(value, list) else value
    try:
        return TypeAdapter(declared, config=strict).validate_python(value)
    except ValidationError as error:
        raise ValueError(error.errors()[0]["msg"].lower()) from None
