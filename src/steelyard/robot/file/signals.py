"""Which columns of a log hold what, resolved to SI units and joint order."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from math import pi
from typing import TYPE_CHECKING, Any

import numpy as np

from steelyard.base.arrays import Array, frozen
from steelyard.base.errors import ModelError
from steelyard.robot.robot import BASE_COORDINATES, Coordinate

if TYPE_CHECKING:
    from steelyard.robot.file.base_sections import OrientationKind
    from steelyard.robot.file.sections import EffortKind, Side

TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
POSITION_UNITS = {
    "revolute": {"rad": 1.0, "deg": pi / 180.0},
    "prismatic": {"m": 1.0, "mm": 1e-3},
}
VELOCITY_UNITS = {
    "revolute": {"rad/s": 1.0, "deg/s": pi / 180.0, "rpm": pi / 30.0},
    "prismatic": {"m/s": 1.0, "mm/s": 1e-3},
}

MOTOR_KINDS = ("motor_current", "motor_torque")
EFFORT_UNITS = {"mA": ("A", 1e-3), **{unit: (unit, 1.0) for unit in ("A", "Nm", "N", "%")}}
WITHOUT_TORQUE = {"A": "motor current", "%": "percent of an unknown effort"}
"""Base units that are no torque or force, and what columns in them hold."""

NOT_OF_SAMPLES = {
    "effort_kind",
    "effort_units",
    "gains",
    "unknown_gains",
    "unknown_offsets",
    "commanded_position",
    "commanded_velocity",
    "commanded_velocity_scale",
    "base",
}
"""Fields of `Signals` that say nothing of how samples are read, but what they mean."""

ROW = "row number"
"""Column that a log without a clock is read with: the numbers of its rows, from zero."""


@dataclass(frozen=True)
class Contact:
    """Columns of a wrench on a link: a force, or a force and a moment, and whose axes it has."""

    frame: str
    columns: tuple[str, ...]
    in_world: bool


@dataclass(frozen=True)
class Touch:
    """A contact without a measured force, and the column that is above a threshold where it is.

    Forces act at a `place` in the frame of a link `(3,)` [m], or below it on a ball of `radius`
    [m]; moments as well on a `sole`. It may touch a `margin` [s] before and after.
    """

    frame: str
    column: str
    threshold: float
    sole: bool
    place: tuple[float, ...]
    radius: float
    margin: float


@dataclass(frozen=True)
class BaseSignals:
    """Columns of a floating base and how to read them.

    `translation` is the proper acceleration, or the place in the world if `tracked`; angular
    velocities and orientations are empty if they are not logged. Scales are in m/s² (m) and rad/s
    per logged unit; `bias` and `angular_bias` are what an accelerometer and a gyroscope show too
    much along their axes, `(3,)` [m/s²; rad/s]. A point of the sensor is at `axes @ p + place` in
    the base link's frame, `(9,)` row by row and `(3,)` [m]; `gravity` `(3,)` [m/s²] is in the
    world. With an unknown `wrench` on the base its rows do not count. The `tree` has what places of
    contacts depend on.

    Where `touches` are, contact forces are unknown; `spread` are the standard deviations of the
    efforts' errors `(n,)` [Nm; N] by which rows without these forces are made, all 1 if empty.
    """

    translation: tuple[str, ...]
    tracked: bool
    scale: float
    angular_velocity: tuple[str, ...]
    angular_scale: float
    orientation: tuple[str, ...]
    orientation_kind: OrientationKind
    axes: tuple[float, ...]
    place: tuple[float, ...]
    gravity: tuple[float, ...]
    delay: float
    wrench_known: bool
    contacts: tuple[Contact, ...]
    tree: Mapping[str, Any]
    touches: tuple[Touch, ...] = ()
    spread: tuple[float, ...] = ()
    bias: tuple[float, ...] = (0.0, 0.0, 0.0)
    angular_bias: tuple[float, ...] = (0.0, 0.0, 0.0)

    @property
    def motion(self) -> tuple[str, ...]:
        """Columns of its motion."""
        return (*self.translation, *self.angular_velocity, *self.orientation)

    @property
    def pushes(self) -> tuple[str, ...]:
        """Columns of its contacts."""
        return tuple(name for contact in self.contacts for name in contact.columns)

    @property
    def flags(self) -> tuple[str, ...]:
        """Columns that say whether contacts touch."""
        return tuple(touch.column for touch in self.touches)

    @property
    def rolls(self) -> bool:
        """Whether what touches depends on where up is."""
        return any(touch.radius > 0.0 for touch in self.touches)

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> BaseSignals:
        """The signals of `json_values`; `KeyError`, `ValueError` or `TypeError` if damaged."""
        values: dict[str, Any] = {
            name: tuple(x) if isinstance(x, list) else x for name, x in data.items()
        }
        contacts = (Contact(**{**c, "columns": tuple(c["columns"])}) for c in data["contacts"])
        touches = (Touch(**{**c, "place": tuple(c["place"])}) for c in data.get("touches", ()))
        return cls(**{**values, "contacts": tuple(contacts), "touches": tuple(touches)})


@dataclass(frozen=True, eq=False)
class Signals:
    """Columns of a log and how to read them; entries are in the order of the coordinates.

    Scales and offsets have the shape `(n,)`, in rad or m, rad/s or m/s, and base units `A`, `Nm`,
    `N` or `%` per logged unit, negative where a column counts the other way. `time` is `ROW` where
    a rate is declared instead, `time_scale` in seconds per unit.

    Velocities are `None` if positions are to be differentiated. `gains` are the joint torque [Nm; N
    on a prismatic joint] per base unit, 1 where it is to be identified; `position_offset` is where
    the log says zero [rad; m], 0 where that is to be identified. The maps `(n, n)` lead from logged
    positions and velocities, and from logged efforts, to the joints'; units and gains count behind
    that; `None` if they are the joints' already. Delays are against positions [s].

    Joints that are `unactuated`, by number, have no effort, and their columns are not read. The
    coordinates of a floating `base` come first, and have columns of their own. Columns of the
    commanded motion are `None` if they are not known; the signals `of_commanded` only read
    them, positions with the scales of `position`.
    """

    time: str
    time_scale: float
    position: tuple[str, ...]
    position_scale: Array
    velocity: tuple[str, ...] | None
    velocity_scale: Array | None
    effort: tuple[str, ...]
    effort_scale: Array
    effort_kind: EffortKind
    effort_units: tuple[str, ...]
    gains: Array
    effort_side: Side = "joint"
    unknown_gains: tuple[bool, ...] = ()
    position_map: Array | None = None
    position_offset: Array | None = None
    effort_map: Array | None = None
    velocity_delay: float = 0.0
    effort_delay: float = 0.0
    unknown_offsets: tuple[bool, ...] = ()
    unactuated: tuple[int, ...] = ()
    commanded_position: tuple[str, ...] | None = None
    commanded_velocity: tuple[str, ...] | None = None
    commanded_velocity_scale: Array | None = None
    base: BaseSignals | None = None

    def of_commanded(self) -> Signals:
        """The same efforts beside the commanded motion instead of the measured one."""
        if self.commanded_position is None:
            raise ModelError(
                "the columns of the commanded motion are not known",
                where="[signals] of the robot file",
                fix='add commanded_position = "...", and commanded_velocity = "..." if it is '
                "logged; a model keeps those of the robot file that it was identified with",
            )
        return replace(
            self,
            position=self.commanded_position,
            velocity=self.commanded_velocity,
            velocity_scale=self.commanded_velocity_scale,
            velocity_delay=0.0,
        )

    @property
    def columns(self) -> tuple[str, ...]:
        """All columns that are read: no efforts of joints without a motor."""
        measured = [name for j, name in enumerate(self.effort) if j not in self.unactuated]
        if self.base is None:
            return (self.time, *self.position, *(self.velocity or ()), *measured)
        joints = self.position[self.n_base :]
        base = self.base
        return (self.time, *joints, *measured, *base.motion, *base.pushes, *base.flags)

    @property
    def delays(self) -> tuple[float, ...]:
        """Delays of signals against positions [s]."""
        base = () if self.base is None else (self.base.delay,)
        return (self.velocity_delay, self.effort_delay, *base)

    @property
    def n_base(self) -> int:
        """Number of coordinates of the base: six if it floats, else none."""
        return 0 if self.base is None else len(BASE_COORDINATES)

    def reads_alike(self, other: Signals) -> bool:
        """Whether both make the same samples of a log: gains and commanded columns do not count."""
        names = {field.name for field in fields(self)} - NOT_OF_SAMPLES
        if not all(np.array_equal(getattr(self, name), getattr(other, name)) for name in names):
            return False
        bases = [base and replace(base, spread=()) for base in (self.base, other.base)]
        return bases[0] == bases[1]

    @property
    def time_units(self) -> Mapping[str, float]:
        """Seconds per unit that time may be logged in; rows come at the rate that is declared."""
        return {"row": self.time_scale} if self.time == ROW else TIME_UNITS

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.position)

    def logged_efforts(self, torque: Array) -> Array:
        r"""Effort columns of joint torques, $y = S^{-1} E^{-1} \operatorname{diag}(k)^{-1} \tau$.

        Torques have the shape `(..., n)` [Nm; N]; columns the units, signs and side of `effort`.
        """
        base = torque / self.gains
        if self.effort_map is not None:
            base = base @ np.linalg.inv(self.effort_map).T
        return np.asarray(base / self.effort_scale)


LATER_FIELDS = (
    *("commanded_position", "commanded_velocity", "commanded_velocity_scale"),
    *("unknown_offsets", "unactuated", "base"),
)
"""Fields that files of earlier versions do not have."""


def signals_from_dict(data: Mapping[str, Any]) -> Signals:
    """The signals of `json_values`; `KeyError`, `ValueError` or `TypeError` if damaged."""
    n, values = len(data["position"]), dict(data)
    for field in fields(Signals):
        name, kind = field.name, str(field.type)
        given = values.get(name) if name in LATER_FIELDS else values[name]
        if given is None:
            continue
        if name == "base":
            values[name] = BaseSignals.from_dict(given)
        elif kind.startswith("tuple"):
            values[name] = tuple(given)
        elif kind.startswith("Array"):
            values[name] = frozen(given, (n, n) if name.endswith("map") else (n,))
            useless = ~np.isfinite(values[name]) | (values[name] == 0.0)
            if (name.endswith("scale") or name == "gains") and useless.any():
                raise ValueError(f"'{name}' of the signals holds a value that cannot be used")
    if len(values["effort"]) != n or len(values["effort_units"]) != n:
        raise ValueError("the signals' lists differ in length")
    return Signals(**values)


OF_EFFORTS = ("effort", "effort_units", "effort_scale", "effort_gain")


@dataclass(frozen=True, eq=False)
class TargetSignals:
    """Columns of targets and positions and how to read them, in the order of the coordinates.

    `scale` is in rad or m per logged unit, without signs. `signs` and `zeros` are those stated:
    positions of the model are `sign * scale * logged + zero`; `None` where they are not stated.

    `effort` are columns of efforts beside them, none or one a joint, of drives or of sensors
    `at_joint`; `effort_scale` is in base units `effort_units` per logged unit, `effort_gain` in Nm
    (N) per base unit, `None` where that is to be identified. `supply` is the column of the voltage
    that actuators are fed with, `nominal` the one that values are for; empty and 1 without it.
    """

    time: str
    time_scale: float
    position: tuple[str, ...]
    target: tuple[str, ...]
    scale: Array
    signs: tuple[float | None, ...]
    zeros: tuple[float | None, ...]
    effort: tuple[str, ...] = ()
    effort_units: tuple[str, ...] = ()
    effort_scale: tuple[float, ...] = ()
    effort_gain: tuple[float | None, ...] = ()
    effort_at_joint: bool = False
    supply: str = ""
    nominal: float = 1.0

    @property
    def columns(self) -> tuple[str, ...]:
        """All columns that are read."""
        last = (self.supply,) if self.supply else ()
        return (self.time, *self.position, *self.target, *self.effort, *last)

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.position)

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> TargetSignals:
        """The signals of `json_values`; `KeyError`, `ValueError` or `TypeError` if damaged."""
        n, given = len(data["position"]), bool(data.get("effort"))
        earlier = {"supply": "", "nominal": 1.0, **data}  # files of earlier versions lack these
        every = [field.name for field in fields(cls)]
        values = {x: earlier[x] for x in every if given or not x.startswith("effort")}
        values["scale"] = frozen(values["scale"], (n,))
        lists = {name: tuple(x) for name, x in values.items() if isinstance(x, list)}
        if any(len(x) != n for x in lists.values()):
            raise ValueError("the signals' lists differ in length")
        named = (values["time"], values["supply"])
        names = [*named, *lists["position"], *lists["target"], *lists.get("effort", ())]
        if not all(isinstance(name, str) for name in names):
            raise ValueError("a column's name is no text")
        if not 0.0 < float(values["time_scale"]) < 1e6 or (values["scale"] <= 0.0).any():
            raise ValueError("a unit of the signals cannot be used")
        if not all(sign in (None, 1, -1) for sign in lists["signs"]):
            raise ValueError("a sign is not 1 or -1")
        if given and not {*OF_EFFORTS} <= lists.keys():
            raise ValueError("a column of efforts is no list")
        gains = [x for x in lists.get("effort_gain", ()) if x is not None]
        sizes = [float(x) for x in (*lists.get("effort_scale", ()), *gains, values["nominal"])]
        texts = lists.get("effort_units", ())
        if not (np.isfinite(sizes).all() and all(sizes) and sizes[-1] > 0.0):
            raise ValueError("a gain of efforts, or a voltage, cannot be used")
        if not all(isinstance(x, str) for x in texts) or len(set(names)) < len(names):
            raise ValueError("a unit is no text, or two signals have one column")
        return cls(**{**values, **lists, "effort_at_joint": bool(values.get("effort_at_joint"))})


def expanded(pattern: str, coordinates: Sequence[Coordinate]) -> tuple[str, ...]:
    """Columns of a pattern: `{}` stands for 1, 2, ..., `{joint}` for the joint's name."""
    return tuple(
        pattern.replace("{}", str(number)).replace("{joint}", coordinate.name)
        for number, coordinate in enumerate(coordinates, start=1)
    )


LEAST_DEGREES = 15.0  # offset from which on a multiple of five is taken for degrees


def looks_like_degrees(offset: float, coordinate: Coordinate) -> bool:
    """Whether a position offset in rad was most likely given in degrees."""
    return coordinate.kind == "revolute" and abs(offset) >= LEAST_DEGREES and offset % 5.0 == 0.0
