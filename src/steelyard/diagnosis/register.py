"""All checks, in the order in which they are run and shown."""

from steelyard.diagnosis.check import Check
from steelyard.diagnosis.decision.checks import (
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
from steelyard.diagnosis.decision.transmission import TransmissionCheck
from steelyard.diagnosis.drift import Drift
from steelyard.diagnosis.gear_side import GearSide
from steelyard.diagnosis.identifiability import Identifiability
from steelyard.diagnosis.joint_zeros import JointZeros
from steelyard.diagnosis.signals.clock import Clock
from steelyard.diagnosis.signals.computed import ComputedEfforts
from steelyard.diagnosis.signals.excitation import Excitation
from steelyard.diagnosis.signals.moving_base import MovingBase
from steelyard.diagnosis.signals.noise import Noise
from steelyard.diagnosis.signals.position import Position
from steelyard.diagnosis.signals.repeats import Repeats
from steelyard.diagnosis.signals.rests import Rests
from steelyard.diagnosis.signals.rows import Rows
from steelyard.diagnosis.signals.saturation import Saturation, Signed
from steelyard.diagnosis.signals.set_points import SetPoints
from steelyard.diagnosis.signals.velocity import Velocity

OF_SIGNALS: tuple[Check, ...] = (
    Clock(),
    Rows(),
    Repeats(),
    Noise(),
    SetPoints(),
    ComputedEfforts(),
    Saturation(),
    Signed(),
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
    Drift(),
    Identifiability(),
)
"""Checks that compare efforts with a model: by velocities and accelerations, in true seconds."""

CHECKS = (*OF_SIGNALS, *OF_MOTION)
