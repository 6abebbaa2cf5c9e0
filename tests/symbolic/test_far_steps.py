import numpy as np

from closed_chains import twin_loops
from steelyard.base.arrays import Parameters
from steelyard.base.motion import Motion
from steelyard.model.laws.laws_without_friction import RigidBody
from steelyard.model.model import Model
from steelyard.robot.loop_closures import loop_equations


def test_far_steps_of_one_joint_are_the_torque_of_the_whole() -> None:
    """Steps so far apart that the loops are followed in halves: from where they were closed, even
    if the caller's buffer, which held it, is used again.
    """
    robot = twin_loops()
    model = Model(robot, (RigidBody(),))
    rng = np.random.default_rng(3)
    valued = model.at(Parameters(model.names, model.units, rng.uniform(0.1, 1.0, 50)))
    q = loop_equations(robot).assembly[:1] + np.array([[0.0], [0.7], [-0.4], [0.9]])
    still = np.zeros_like(q)
    stepper = valued.start()
    steps = [stepper.step(x, [0.0], [0.0]) for x in q]
    np.testing.assert_array_equal(steps, valued.torque(Motion(np.arange(4.0), q, still, still)))
