"""The tables of a floating base in the robot file: its sensors, and contacts with the world."""

from typing import Literal

from steelyard.robot.file.toml_schema import Many, Name, Names, NonNegative, Section, Vector, key

OrientationKind = Literal["wxyz", "xyzw", "rpy_rad", "rpy_deg", "matrix"]
ContactAxes = Literal["frame", "world"]
UnknownWrench = Literal["none", "unknown"]


class SensorMountingSection(Section):
    """Where a sensor is on the base link: R = Rz(yaw) Ry(pitch) Rx(roll) turns its axes [deg]."""

    roll: float = key(0.0, "Rotation about the base link's x axis, first [deg].")
    pitch: float = key(0.0, "Rotation about its y axis, second [deg].")
    yaw: float = key(0.0, "Rotation about its z axis, last [deg].")
    position: Vector = key((0.0, 0.0, 0.0), "Place in the base link's frame [m].")


class ContactSection(Section):
    """Where the world touches the robot: a measured wrench, or a column that says whether it does.

    A wrench is at the origin of the link's frame; of a contact with `touching`, forces are unknown.
    """

    frame: Name = key(..., "Link that it acts on, also one that is fixed to another.")
    force: Name | Names | None = key(
        None, "Columns of the force, or one name with `{}` for x, y, z [N]."
    )
    moment: Name | Names | None = key(
        None, "Columns of the moment about the frame's origin [Nm]; none if left out: a point."
    )
    axes: ContactAxes = key(
        "frame", "Whose axes it is along: those of the `frame`, or of the `world`."
    )
    touching: Name | None = key(
        None,
        "Instead of `force`: column of a flag, or of the size of a force, that is above the "
        "`threshold` while it touches.",
    )
    threshold: float = key(0.5, "Value of `touching` above which it touches, in its unit.")
    sole: bool = key(False, "Whether it also takes moments, as a foot with a sole does.")
    position: Vector = key((0.0, 0.0, 0.0), "The point that touches, in the link's frame [m].")
    radius: NonNegative = key(
        0.0,
        "Radius of a ball about `position`: the point that touches is below [m]. It needs "
        "`orientation`.",
    )
    margin: NonNegative = key(
        0.02, "Time before and after `touching` during which it may touch as well [s]."
    )


class BaseSection(Section):
    """Columns of the motion of a floating base, of an inertial sensor or of motion capture."""

    acceleration: Name | Names | None = key(
        None,
        "Columns of what an accelerometer measures, or one name with `{}` for x, y, z.",
    )
    acceleration_unit: Literal["m/s2", "g"] = key("m/s2", "Unit of `acceleration`.")
    acceleration_bias: Vector = key(
        (0.0, 0.0, 0.0),
        "What the accelerometer shows too much along its axes; it is subtracted [m/s²].",
    )
    angular_velocity: Name | Names | None = key(
        None, "Columns of the angular velocity of a gyroscope along its axes."
    )
    angular_velocity_bias: Vector = key(
        (0.0, 0.0, 0.0), "What the gyroscope shows too much; it is subtracted [rad/s]."
    )
    angular_velocity_unit: Literal["rad/s", "deg/s"] = key("rad/s", "Unit of `angular_velocity`.")
    position: Name | Names | None = key(
        None, "Columns of the place in the world, instead of `acceleration` [m]."
    )
    orientation: Name | Names | None = key(
        None,
        "Columns of the orientation in the world, whose z axis points up, or one name with `{}` "
        "for the letters or words of `orientation_kind`.",
    )
    orientation_kind: OrientationKind = key(
        "wxyz",
        "Quaternion in one of two orders, roll, pitch and yaw, or the nine entries of the rotation "
        "matrix, row by row.",
    )
    frame: Name | None = key(
        None, "Link that the sensor is on, fixed to the base; the base link if left out."
    )
    mounting: SensorMountingSection | None = key(
        None, "Where the sensor is on the base link, instead of `frame`."
    )
    delay: float = key(0.0, "Delay relative to joint positions [s]; it is corrected.")
    wrench: UnknownWrench = key(
        "none",
        "What acts on the base beside `contacts`: `none`; or `unknown`, as of a hoist: the six "
        "rows of the base are then left out.",
    )
    contacts: Many[ContactSection] = key((), "Contacts, measured or with flags.")
