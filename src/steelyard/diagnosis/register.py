"""All suspicions, in the order in which they are asked and shown."""

from steelyard.diagnosis.check import Suspicion
from steelyard.diagnosis.drift import Drift
from steelyard.diagnosis.hypotheses.effort_delay import EffortDelay
from steelyard.diagnosis.hypotheses.effort_kind import EffortKind
from steelyard.diagnosis.hypotheses.effort_sign import EffortSign
from steelyard.diagnosis.hypotheses.effort_unit import EffortUnit
from steelyard.diagnosis.hypotheses.gain import Gain
from steelyard.diagnosis.hypotheses.joint_order import JointOrder
from steelyard.diagnosis.hypotheses.mounting import Mounting
from steelyard.diagnosis.hypotheses.payload_left import PayloadLeft
from steelyard.diagnosis.hypotheses.position_sign import PositionSign
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
from steelyard.diagnosis.signals.saturation import Saturation
from steelyard.diagnosis.signals.velocity import Velocity

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
