"""The virtual robot's own control, for estimators that simulate it."""

from steelyard.arrays import Array
from steelyard.estimation.closed_loop.experiment import Loop
from steelyard.motion import Trajectory
from steelyard.virtual.robot import VirtualRobot


def loop_of(rig: VirtualRobot, trajectory: Trajectory) -> Loop:
    """How a virtual robot is controlled along a trajectory; times are those of its log."""

    def wanted(t: Array) -> tuple[Array, Array]:
        return rig.wanted(trajectory, t)

    return Loop(rig.control, wanted)
