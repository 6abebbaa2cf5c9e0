"""All suspicions, in the order in which they are asked and shown."""

from steelyard.diagnosis.clock import Clock
from steelyard.diagnosis.computed import ComputedEfforts
from steelyard.diagnosis.drift import Drift
from steelyard.diagnosis.effort_delay import EffortDelay
from steelyard.diagnosis.effort_kind import EffortKind
from steelyard.diagnosis.effort_sign import EffortSign
from steelyard.diagnosis.effort_unit import EffortUnit
from steelyard.diagnosis.excitation import Excitation
from steelyard.diagnosis.gain import Gain
from steelyard.diagnosis.identifiability import Identifiability
from steelyard.diagnosis.joint_order import JointOrder
from steelyard.diagnosis.joint_zeros import JointZeros
from steelyard.diagnosis.mounting import Mounting
from steelyard.diagnosis.moving_base import MovingBase
from steelyard.diagnosis.noise import Noise
from steelyard.diagnosis.payload_left import PayloadLeft
from steelyard.diagnosis.position import Position
from steelyard.diagnosis.position_sign import PositionSign
from steelyard.diagnosis.repeats import Repeats
from steelyard.diagnosis.rests import Rests
from steelyard.diagnosis.rows import Rows
from steelyard.diagnosis.saturation import Saturation
from steelyard.diagnosis.suspicion import Suspicion
from steelyard.diagnosis.velocity import Velocity

SUSPICIONS: tuple[Suspicion, ...] = (
    Clock(),
    Rows(),
    Repeats(),
    Noise(),
    ComputedEfforts(),
    Saturation(),
    Rests(),
    Excitation(),
    Position(),
    Velocity(),
    JointOrder(),
    PositionSign(),
    EffortSign(),
    EffortUnit(),
    EffortKind(),
    Gain(),
    EffortDelay(),
    JointZeros(),
    Mounting(),
    MovingBase(),
    PayloadLeft(),
    Drift(),
    Identifiability(),
)
