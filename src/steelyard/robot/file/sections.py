"""The sections of the robot file, as pydantic checks them."""

from typing import Annotated, Any, Literal, get_args

from pydantic import Field, field_validator
from pydantic_core import PydanticCustomError

from steelyard.robot.file.base_sections import BaseSection
from steelyard.robot.file.excitation_sections import ExcitationSection as ExcitationSection
from steelyard.robot.file.toml_schema import ADVICE, Many, Pair, key
from steelyard.robot.file.toml_schema import Name as Name
from steelyard.robot.file.toml_schema import Names as Names
from steelyard.robot.file.toml_schema import Numbers as Numbers
from steelyard.robot.file.toml_schema import Positive as Positive
from steelyard.robot.file.toml_schema import Section as Section
from steelyard.robot.file.toml_schema import Vector as Vector

EffortKind = Literal[
    "motor_current", "motor_torque", "joint_torque", "link_torque", "gravity_compensated_torque"
]
Side = Literal["joint", "motor"]
PositionUnit = (
    Literal["rad", "deg", "m", "mm"] | Annotated[float, Field(ge=1e-9, le=1e3)]  # rad (m) per unit
)
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

    roll: float = key(0.0, "Rotation about the base's x axis, first [deg].")
    pitch: float = key(0.0, "Rotation about the fixed y axis, second [deg].")
    yaw: float = key(0.0, "Rotation about the fixed z axis, last [deg].")


class LimitsSection(Section):
    """Limits of one joint that replace the model's; what is left out is taken from there."""

    lower: float | None = key(None, "Least position [rad; m].")
    upper: float | None = key(None, "Greatest position [rad; m].")
    velocity: Positive | None = key(None, "Greatest speed [rad/s; m/s].")
    effort: Positive | None = key(None, "Greatest effort [Nm; N].")


class DHRow(Section):
    """One row of a Denavit-Hartenberg table: one joint and its link, see `dh_mechanism`."""

    joint: Name | None = key(None, "Name of the joint; `joint_1`, `joint_2`, ... if left out.")
    kind: Literal["revolute", "prismatic"] = key("revolute", "Type of the joint.")
    a: float = key(0.0, "Length of the link [m].")
    alpha: float = key(0.0, "Twist of the link, in `angle_unit`.")
    d: float = key(0.0, "Offset along the joint's axis [m].")
    theta: float = key(0.0, "Joint angle at position zero, in `angle_unit`.")
    mass: float | None = key(None, "Mass [kg].")
    com: Vector = key((0.0, 0.0, 0.0), "Centre of mass in the link's DH frame [m].")
    inertia_com: Six = key(
        (0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        "`Ixx, Ixy, Iyy, Ixz, Iyz, Izz` about the centre of mass [kg m²].",
    )


class DHSection(Section):
    """A Denavit-Hartenberg table."""

    convention: Literal["standard", "modified"] = key(
        ..., "`modified` (Craig, Khalil) or `standard`."
    )
    angle_unit: Literal["rad", "deg"] = key("rad", "Unit of `alpha` and `theta`.")
    links: Annotated[tuple[DHRow, ...], Field(strict=False, min_length=1)] = key(
        ..., "Rows of the table, from base to tip."
    )


class CouplingSection(Section):
    """A motor that turns with a joint that is not its own."""

    motor: Name = key(..., "The motor.")
    joint: Name = key(..., "The joint that it turns with besides its own.")
    ratio: float = key(..., "Motor positions per joint position.")


class TransmissionSection(Section):
    """Gears between motors and joints, see `robot.Transmission`."""

    motors: Names | None = key(None, "Names of motors; `motor_1`, `motor_2`, ... if left out.")
    ratios: Numbers | None = key(
        None, "Diagonal of R in motor positions q_m = R q, in the order of the joints."
    )
    coupling: Many[CouplingSection] = key(
        (), "Entries of R outside its diagonal; `[]` states that there are none."
    )
    matrix: Many[Numbers] | None = key(
        None, "R in full, one row per motor, instead of `ratios` and `coupling`."
    )

    @property
    def couplings_stated(self) -> bool:
        """Whether the couplings are given, or that there are none."""
        return self.matrix is not None or "coupling" in self.model_fields_set


class LoopSection(Section):
    """A pin that closes a chain: a point of one link, in its frame, stays on one of another."""

    name: Name | None = key(None, "Name in messages; `loop1`, `loop2`, ... if left out.")
    links: Pair = key(..., "The two links that meet.")
    points: Annotated[tuple[Vector, Vector], Field(strict=False)] = key(
        ..., "The loop-closure joint in the frame of each link [m]."
    )


class XacroSection(Section):
    """How the model file is expanded, if it is a xacro file."""

    arguments: dict[str, str | bool | int | float] = key({}, "Values of `$(arg NAME)`.")
    packages: Names = key((), "Folders of ROS packages, or packages, relative to the robot file.")


class RobotSection(Section):
    """Which robot, which of its joints move, and how it is mounted."""

    name: Name | None = key(None, "Name of the robot; the model's if left out.")
    source: str | None = key(None, "Origin of the model and of the data, for the report.")
    urdf: Name | None = key(None, "URDF or xacro file.")
    mjcf: Name | None = key(None, "MJCF file.")
    dh: DHSection | None = key(None, "Denavit-Hartenberg table, instead of a file.")
    xacro: XacroSection = key(XacroSection(), "Expansion of a xacro file.")
    joints: Names | None = key(
        None, "Joints to identify, in the order of the log's columns; all if left out."
    )
    base: Name | None = key(
        None,
        "Link that is fixed to the world, the model's root if left out; or `floating`, if none is.",
    )
    tip: Name | Names | None = key(None, "Last link, or links, of the robot; all if left out.")
    gravity: Vector | None = key(
        None,
        "Gravity in the base frame [m/s²], instead of `mounting`; of a floating base in the world.",
    )
    mounting: MountingSection | None = key(None, "Orientation of the base relative to upright.")
    snap_angles: bool = key(
        True, "Whether entries of rotations and axes below 2e-5 are rounded to exact ones."
    )
    locked: dict[str, float] = key({}, "Positions of joints that do not move [rad; m].")
    limits: dict[str, LimitsSection] = key({}, "Limits that replace those of the model, by joint.")
    transmission: TransmissionSection | None = key(None, "Gears between motors and joints.")
    loops: Many[LoopSection] = key((), "Loop-closure joints of closed chains.")
    passive: Names | None = key(None, "Joints whose positions follow from the loops; not logged.")
    assembly: dict[str, float] = key(
        {}, "Approximate reference configuration of closed chains, by joint [rad; m]."
    )
    open_loops: Literal["stop", "drop"] = key(
        "stop",
        "What is done with samples at which a loop cannot close: `stop` with an error, or `drop` "
        "them.",
    )


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
    """What the effort columns hold."""

    columns: Name | Names = key(
        ..., "Columns, or one name with `{}` for 1, 2, ... or `{joint}` for the joint's name."
    )
    kind: EffortKind = key(..., "Content of the columns.")
    unit: EffortUnit | Many[EffortUnit] = key(..., "Unit, one for all columns or one each.")
    side: Side = key("joint", "Whether efforts are those of joints or of motors.")
    gain: Gain | Many[Gain] | None = key(
        None, "Effort per A, Nm, N or %, one for all columns or one each; `identify` estimates it."
    )
    delay: Delay = key(0.0, "Delay relative to positions [s]; it is corrected.")
    unactuated: Names = key(
        (), "Joints without a motor: their effort is zero, and they need no column."
    )


NO_EFFORTS = EffortSection.model_construct(columns=(), kind="joint_torque", unit="Nm")
"""Stands for efforts that are not logged."""


class SignalsSection(Section):
    """Which columns of a log are what.

    Attributes:
        time: Column of time.
        time_unit: Unit of time.
        rate: Sampling rate of a log with evenly spaced rows, instead of `time` [Hz].
        coordinates: Whether positions and velocities are those of joints or of motors.
        position: Columns of positions, or one name with `{}` or `{joint}`.
        position_unit: Unit, or rad (m) per logged unit, such as those of an encoder; one for all
            columns or one each; rad or m by the joint's type if left out.
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
        target: Columns of the targets of position-controlled joints, in the unit and with the signs
            of `position`; without efforts, or with `[actuator]`, actuators are identified from
            them.
        supply_voltage: Column of the voltage that the actuators are fed with.
        nominal_voltage: The voltage that identified values are for, in the unit of that column.
        effort: Columns of efforts.
        base: Columns of the motion of a floating base.
    """

    time: Name | None = None
    time_unit: TimeUnit = "s"
    rate: Rate | None = None
    coordinates: Side = "joint"
    position: Name | Names
    position_unit: PositionUnit | Many[PositionUnit] | None = None
    position_sign: Many[Sign] | None = None
    position_offset: Literal["identify"] | Many[ZeroOffset] | None = None
    velocity: Name | Names | None = None
    velocity_unit: VelocityUnit | Many[VelocityUnit] | None = None
    velocity_sign: Many[Sign] | None = None
    velocity_delay: Delay = 0.0
    commanded_position: Name | Names | None = None
    commanded_velocity: Name | Names | None = None
    target: Name | Names | None = None
    supply_voltage: Name | None = None
    nominal_voltage: Positive | None = None
    effort: EffortSection = NO_EFFORTS
    base: BaseSection | None = None

    @property
    def has_efforts(self) -> bool:
        """Whether columns of efforts are named."""
        return self.effort is not NO_EFFORTS


Actuated = Positive | Literal["identify"]
Seconds = Annotated[float, Field(ge=0.0, le=2.0)]
ActuatorDelay = Seconds | Literal["identify"]


class ActuatorSection(Section):
    """Actuators of joints that follow position targets: what is known of them.

    A value is one for all joints, or one each; `identify` estimates it.
    """

    law: Literal["auto", "position_pd"] = key(
        "auto",
        "`auto`: parts of the law are chosen by motion that is left out; `position_pd`: "
        "controller, dry friction, rotor inertia and delay, and what is listed below.",
    )
    stiffness: Actuated | Many[Actuated] = key("identify", "Proportional gain [Nm/rad; N/m].")
    damping: Actuated | Many[Actuated] = key(
        "identify", "Derivative gain and viscous friction together [Nm s/rad; N s/m]."
    )
    integral: Actuated | Many[Actuated] | None = key(None, "Integral gain [Nm/(rad s); N/(m s)].")
    back_emf: Actuated | Many[Actuated] | None = key(
        None, "Damping that acts beside the torque limit: back-EMF [Nm s/rad; N s/m]."
    )
    coulomb: Actuated | Many[Actuated] = key("identify", "Dry friction [Nm; N].")
    stribeck: Actuated | Many[Actuated] | None = key(
        None, "Dry friction at rest, beyond that of fast motion [Nm; N]."
    )
    stribeck_speed: Actuated | Many[Actuated] | None = key(
        None, "Speed over which it falls [rad/s; m/s]."
    )
    armature: Actuated | Many[Actuated] = key(
        "identify", "Inertia of rotor and gears at the joint [kg m²; kg]."
    )
    delay: ActuatorDelay | Many[ActuatorDelay] = key(
        "identify", "From a target in the log to its effect, of all joints or each [s]."
    )
    load_friction: Actuated | Many[Actuated] | None = key(
        None, "Dry friction per torque of the motor."
    )
    torque_limit: Actuated | Many[Actuated] | None = key(None, "Largest torque [Nm; N].")
    dead_band: Actuated | Many[Actuated] | None = key(
        None, "Error up to which the controller does nothing [rad; m]."
    )
    mass_factor: Literal["identify"] | None = key(
        None, "Masses of the links behind the joints, over those of the model file."
    )


class RepetitionsTable(Section):
    """That a log repeats one motion; a period that is left out is found."""

    period: Positive | None = key(None, "Period [s]; found from the data if left out.")
    drop_first: Annotated[int, Field(ge=0)] = key(1, "Periods that are left out at the start.")
    drop_last: Annotated[int, Field(ge=0)] = key(1, "Periods that are left out at the end.")


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
            chosen from the data if left out; `off`: no parallel filter.
        rest_speed: Speed up to which a joint is at standstill, where its effort is not fitted
            [rad/s; m/s]; chosen from the data if left out; `off`: all samples are fitted.
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
    matched_cutoff: Positive | Literal["off"] | None = None
    rest_speed: Positive | Literal["off"] | None = None
    repetitions: Literal["find"] | RepetitionsTable | None = None


class GeneticSection(Section):
    """The genetic algorithm of `method = "genetic"`."""

    population: Annotated[int, Field(ge=4, le=10_000)] = key(30, "Individuals of a generation.")
    generations: Annotated[int, Field(ge=1, le=100_000)] = key(100, "Generations.")
    sufficient: Positive | None = key(None, "Root mean square error at which it ends [Nm; N].")
    seed: Annotated[int, Field(ge=0, lt=2**32)] = key(0, "Of all random choices.")


class EstimationSection(Section):
    """How parameters are estimated.

    Attributes:
        method: `consistent`: physically consistent, with a prior; `least_squares`: without; or the
            name of another estimator.
        weights: `noise`: joints are weighted by the variance of their residuals; or `equal`.
        effort_scales: `auto`: a scale of each joint's efforts is estimated if it is significant; or
            `off`.
        genetic: Settings of `method = "genetic"`.
    """

    method: Name = "consistent"
    weights: Literal["noise", "equal"] = "noise"
    effort_scales: Literal["auto", "off"] = "auto"
    genetic: GeneticSection = GeneticSection()


class BoxSection(Section):
    """A solid box: its edges [m] along the axes of the link's frame, and its centre there."""

    size: Annotated[tuple[Positive, Positive, Positive], Field(strict=False)] = key(
        ..., "Lengths along the axes of the link's frame [m]."
    )
    centre: Vector = key((0.0, 0.0, 0.0), "Centre in that frame [m].")


class CapsuleSection(Section):
    """A solid rod with round ends: centres of the end balls in the link's frame, radius [m]."""

    start: Vector = key((0.0, 0.0, 0.0), "Centre of one end's ball in the link's frame [m].")
    end: Vector = key(..., "Centre of the other's [m].")
    radius: Positive = key(..., "Radius [m].")


class LinkPriorSection(Section):
    """What is known of one link before the data, in its own frame."""

    source: Literal["model", "none"] = key(
        "model", "Where the rest of the prior comes from: the `model` file, or `none`."
    )
    mass: Positive | None = key(None, "Mass [kg].")
    com: Vector | None = key(None, "Centre of mass [m].")
    inertia_com: Six | None = key(
        None, "`Ixx, Ixy, Iyy, Ixz, Iyz, Izz` about the centre of mass [kg m²]."
    )
    box: BoxSection | None = key(None, "Solid box that gives centre and inertia.")
    capsule: CapsuleSection | None = key(None, "Solid capsule that gives centre and inertia.")


class PriorSection(Section):
    """Mass properties before the data."""

    source: Literal["model", "none"] = key(
        "model", "Where prior masses come from: the `model` file, or `none`."
    )
    uncertainty: Annotated[float, Field(ge=1e-4)] | None = key(
        None, "Relative standard deviation; estimated from the data if left out."
    )
    symmetry: Literal["xy", "xz", "yz"] | None = key(
        None,
        "Plane of the base link's frame across which limbs mirror each other, such as `xz` of legs "
        "to the left and right; their links are found by the places and axes of their joints.",
    )
    links: dict[str, LinkPriorSection] = key({}, "Priors of single links.")


class ValidationSection(Section):
    """How scores are formed."""

    cutoff: Positive | None = key(
        None,
        "Cut-off of the low-pass of measured and predicted efforts [Hz]; if left out, 5 Hz for "
        "the headline and that of the parallel filter for the other errors.",
    )


class RobotFile(Section):
    """The whole robot file."""

    robot: RobotSection = key(..., "The robot.")
    model: ModelSection | None = key(None, "Torque terms.")
    signals: SignalsSection | None = key(None, "Columns of logs.")
    actuator: ActuatorSection = key(ActuatorSection(), "Actuators of joints that follow targets.")
    processing: ProcessingSection = key(ProcessingSection(), "From rows to motion.")
    estimation: EstimationSection = key(EstimationSection(), "The estimator.")
    prior: PriorSection = key(PriorSection(), "Prior of the mass properties.")
    knowledge: Many[dict[str, Any]] = key((), "Prior constraints, see Prior knowledge.")
    validation: ValidationSection = key(ValidationSection(), "Scores.")
    excitation: ExcitationSection = key(
        ExcitationSection(), "The motion that `steelyard excite` designs."
    )
