"""An invented arm that takes up a load, and what runs with and without it say."""

from collections.abc import Mapping

import numpy as np

from invented import ball, tree, turned
from steelyard.base.arrays import Array, Parameters
from steelyard.base.motion import Motion
from steelyard.estimate.information.base_parameters_and_regressor import base_regressor
from steelyard.estimate.information.filter_and_gram import Accumulator, Stretch
from steelyard.estimate.information.information import Information, Signature, Window
from steelyard.model.model import Model
from steelyard.robot.inertia_and_placement import Inertia
from steelyard.robot.robot import Frame, Robot

TOOL = Frame("tool", 3, turned(7), np.array([0.05, -0.1, 0.2]))
LOAD = Inertia.about_com(1.7, (0.03, -0.08, 0.12), ball(9).inertia_com)
"""What the arm carries, seen from the tool frame."""

COUNT = 500
UNITS = ("A", "A", "Nm", "A")
GAINS = np.array([12.0, -30.0, 1.0, 7.0])


def arm(robot: Robot | None = None) -> Model:
    """A model of the tree with a tool and a flange on the base."""
    base = Frame("flange_of_base", -1, np.eye(3), np.zeros(3))
    robot = tree().changed(frames=(TOOL, base)) if robot is None else robot
    return Model(robot)


MODEL = arm()
REGRESSOR = base_regressor(MODEL)


def truth(friction: float = 1.0, load: Inertia | None = None) -> Parameters:
    """Standard parameters: nominal bodies, some friction, and the load on its body."""
    robot = MODEL.robot
    tens = [body.inertia for body in robot.bodies]
    if load is not None:
        tens[TOOL.body] = tens[TOOL.body] + load.moved(TOOL.rotation, TOOL.position)
    values = np.concatenate([inertia.ten for inertia in tens])
    joints = np.arange(1.0, robot.n + 1.0)
    levels = {"rotor_inertia": 0.1, "coulomb": 0.8 * friction, "viscous": 0.5 * friction}
    rest = {
        f"{law}.{name}": level * joints[k]
        for law, level in {**levels, "offset": 0.2 * friction}.items()
        for k, name in enumerate(robot.joint_names)
    }
    full = {**dict(zip(MODEL.names, values, strict=False)), **rest}
    return Parameters(MODEL.names, MODEL.units, [full[name] for name in MODEL.names])


def run(
    seed: int,
    load: Inertia | None = None,
    noise: float = 0.0,
    *,
    friction: float = 1.0,
    gains: Array = GAINS,
    still: Mapping[int, float] | None = None,
    count: int = COUNT,
) -> Information:
    """A run over random states, efforts as logged behind `gains`, with noise of joint effort."""
    rng = np.random.default_rng(seed)
    q, dq, ddq = rng.normal(size=(3, 4, count))
    for joint, position in (still or {}).items():
        q[joint], dq[joint], ddq[joint] = position, 0.0, 0.0
    motion = Motion(np.arange(count), q.T, dq.T, ddq.T)
    torque = MODEL.at(truth(friction, load)).torque(motion).T
    effort = (torque + noise * rng.normal(size=torque.shape)) / gains[:, None]
    sums = Accumulator(REGRESSOR)(Stretch(q, dq, ddq, effort))
    return Information(
        REGRESSOR.layout,
        Signature(MODEL.fingerprint, REGRESSOR.layout.columns, UNITS, "none"),
        (Window(f"run{seed}", 0.0, 1.0),),
        sums.grams[None],
        sums.absolute[None],
        sums.counts[None],
    )
