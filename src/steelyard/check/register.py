"""What every check can do, and all checks in the order in which they are run and shown."""

from typing import Protocol

from steelyard.check.case import Case
from steelyard.check.decision.checks import (
    EFFORT_DELAY,
    EFFORT_KIND,
    EFFORT_SIGN,
    EFFORT_UNIT,
    GAIN,
    JOINT_ORDER,
    JOINT_ZEROS,
    MOUNTING,
    PAYLOAD,
    POSITION_SIGN,
)
from steelyard.check.decision.joint_zeros import JointZeros
from steelyard.check.decision.transmission import TransmissionCheck
from steelyard.check.finding import Finding
from steelyard.check.fitted.gear_side import GearSide
from steelyard.check.identifiability import Identifiability
from steelyard.check.several_logs import FrictionDrift
from steelyard.check.signals.measured import ComputedEfforts, SetPoints
from steelyard.check.signals.movement import Excitation, MovingBase, Rests
from steelyard.check.signals.position import Position
from steelyard.check.signals.rows import CorruptRows, RepeatedRows
from steelyard.check.signals.sensor_limits import Noise, OneSignedEfforts, Saturation
from steelyard.check.signals.time_stamps import Clock
from steelyard.check.signals.velocity import Velocity


class Check(Protocol):
    """One thing that may be wrong with logs."""

    @property
    def name(self) -> str:
        """One word or two, as users see it: `clock`."""
        ...

    @property
    def question(self) -> str:
        """The question in a few words: "Is the clock regular?"."""
        ...

    @property
    def quick(self) -> bool:
        """Whether `identify` runs it before the fit."""
        ...

    def __call__(self, case: Case) -> tuple[Finding, ...]:
        """One finding per log, or one for all logs together; none where it does not apply."""
        ...


OF_SIGNALS: tuple[Check, ...] = (
    Clock(),
    CorruptRows(),
    RepeatedRows(),
    Noise(),
    SetPoints(),
    ComputedEfforts(),
    Saturation(),
    OneSignedEfforts(),
    Rests(),
    Excitation(),
    Position(),
    Velocity(),
)
"""Checks of the signals by themselves; those that differentiate know the unit of time."""

OF_MOTION: tuple[Check, ...] = (
    JOINT_ORDER,
    POSITION_SIGN,
    EFFORT_SIGN,
    EFFORT_UNIT,
    EFFORT_KIND,
    TransmissionCheck(),
    GearSide(),
    GAIN,
    EFFORT_DELAY,
    JOINT_ZEROS,
    JointZeros(),
    MOUNTING,
    MovingBase(),
    PAYLOAD,
    FrictionDrift(),
    Identifiability(),
)
"""Checks that compare efforts with a model: by velocities and accelerations, in true seconds."""

CHECKS = (*OF_SIGNALS, *OF_MOTION)
