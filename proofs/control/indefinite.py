"""The parameters that [WangC] prints (tables II to IV) are those of no body: the law refuses them.

The arm is that of `proofs/estimation/parallel_arm.py`; its tip follows their circle of 0.2 m radius
in 7.2 s. The tracking errors of the laws are in `studies/p5_five_bar.py`.
"""

import numpy as np
from proofs.estimation.parallel_arm import CENTRE, L2, MODELS, RADIUS, TIP, arm
from proofs.support.claims import Claim, main_of

from steelyard.base.arrays import Parameters
from steelyard.base.errors import ModelError
from steelyard.excite.constraints.constraint_and_limits import motion_limits
from steelyard.excite.planned.joints_along_path import along_path
from steelyard.excite.planned.tool_paths_lines_and_reach import Circle
from steelyard.excite.trajectories.exact_trajectories import ExactTrajectory
from steelyard.model.model import Model
from steelyard.robot.robot import Coordinate, Limits
from steelyard.uses.control.joint_controllers import refuse_indefinite

PERIOD = 7.2
PRINTED = {
    "table II": (0.0593, 0.1609, 0.2380),
    "table III": (0.0744, 0.1843, 0.2390),
    "table IV": (0.0776, 0.1843, 0.2297),
}
"""Their inertial parameters [kg m²]."""


def circle() -> ExactTrajectory:
    """The circle: a lap at constant speed after one turn of two ramps, half before, half behind."""
    path = Circle(
        centre=np.array([0.0, CENTRE, 0.0]),
        radius=RADIUS,
        period=PERIOD,
        laps=2,
        ramp=PERIOD,
        normal=np.array([0.0, 0.0, 1.0]),
    )
    robot = five_bar(11).robot
    return along_path(robot, motion_limits(robot), TIP, path).trajectory


def five_bar(terms: int) -> Model:
    """The arm, its joints' ranges wide enough for the circle.

    The paper's table I has -20 to 80 and 80 to 190 degrees. It does not print the lengths of the
    bars; with those of `parallel_arm` the circle needs -27 to 61 and 104 to 167 degrees.
    """
    model = arm(MODELS[terms])
    ranges = ((-0.5, 1.39), (1.4, 3.3))
    joints = tuple(
        Coordinate(c.name, c.kind, Limits(low, high, 3.0, 20.0))
        for c, (low, high) in zip(model.robot.coordinates, ranges, strict=True)
    )
    return Model(model.robot.changed(coordinates=joints), model.terms)


def refused(values: tuple[float, float, float]) -> str:
    """What the law says of inertial parameters that are printed; empty if it accepts them.

    In the order of eq. 14: of the first joint, of the coupling, of the second joint. The law finds
    them as inertias of links 1 and 2 and a first moment of link 3.
    """
    first, coupled, second = values
    names = ("Izz.link1", "Izz.link2", "mx.link3")
    known = Parameters(names, ("kg m²", "kg m²", "kg m"), (first, second, coupled / L2))
    model = five_bar(11).at(known)
    try:
        motion = circle()
        refuse_indefinite(model, motion.sample(np.linspace(0.0, motion.duration, 500)))
    except ModelError as error:
        return error.wrong
    return ""


def main() -> list[Claim]:
    """What the law says of each table."""
    claims = []
    for name, values in PRINTED.items():
        words = refused(values)
        stated = words.split(":")[0] or "accepted"
        claims.append(Claim(f"printed parameters, {name}", stated, "refused", bool(words)))
    return claims


if __name__ == "__main__":
    main_of(main)
