"""Torque feedforward of process models on an arm of six joints, as [Volkmann] in table VII.

The arm and its processes are those of `proofs/reduction/process.py`: pick and place between two
areas, the tool tilted and with its heading kept, so that all joints move, and the edges of a
horizontal square. A virtual robot runs each process once under cascade control, with the torque lag
of 2 ms, 20-bit encoders, a delay of one tick and sensor noise. A model is identified from that log
by weighted least squares and reduced as in algorithm 1. Then friction drifts by 20 %, and other
motions of the same process are run under the same control: without a model, with the full and
with the reduced one. Of the paper's six joints the errors without a model are 0.0039 to 0.0200°,
the ratios 0.49 to 0.76 (mean 0.61), and the overshoot at the corners of the square is halved.
"""

import tempfile
from pathlib import Path

import numpy as np
import tomlkit
from proofs.reduction.process import SQUARE, planned_motion, true_values
from proofs.support.claims import Claim, main_of
from studies.support.corners import overshoot
from studies.support.robots import ROBOTS
from studies.support.robots import robot_file as changed_robot

from steelyard.base.arrays import Array, Parameters
from steelyard.base.motion import run
from steelyard.excite.trajectories.exact_trajectories import ExactTrajectory, SampledMotion
from steelyard.identify.identify import identify
from steelyard.identify.reduce import reduce
from steelyard.model.equations.frame_and_point_kinematics import frame_of, last_frame
from steelyard.model.model import model_of
from steelyard.simulate.drives_sensors_and_loads import customary_drives
from steelyard.simulate.ground_truth import Truth
from steelyard.simulate.track import TrackedRun, Tracking, tracking
from steelyard.simulate.virtual_robot import VirtualRobot, customary_sensors
from steelyard.uses.control.joint_controllers import Cascade, Control, TorqueFeedforward

PICK = """kind = "pick_and_place"
pick = { x = [0.9, 1.3], y = [-0.7, -0.3], z = [0.3, 0.6] }
place = { x = [0.9, 1.3], y = [0.3, 0.7], z = [0.3, 0.6] }
cycles = 4
speed = 1.5
tool_axis = [0.3, 0.2, -0.93]
"""
LAG, DRIFT = 0.002, 1.2
DECADE = (0.003, 0.03)
"""About the paper's errors without a model [°]."""

STILL = 1e-6
"""Error of a joint that the process does not move [rad]."""

FILE = """
[model]
terms = ["rigid_body", "rotor_inertia", "viscous", "coulomb"]

[signals]
time = "time_s"
position = "q{}_rad"
velocity = "dq{}_rad_s"

[signals.effort]
columns = "tau{}_Nm"
kind = "joint_torque"
unit = "Nm"
"""


LAWS = ("rotor_inertia", "coulomb", "viscous")
"""Rotors on the link side, and friction of the paper's table IV."""


def robot_file(folder: Path) -> Path:
    """The arm with rotors and signals."""
    return changed_robot("p2_arm", folder / "arm.toml", FILE)


def arm() -> Truth:
    """The true arm with its load."""
    with tempfile.TemporaryDirectory() as folder:
        model = model_of(robot_file(Path(folder)))
    values = true_values(model.robot)
    sizes = tomlkit.parse((ROBOTS / "p2_truth.toml").read_text(encoding="utf-8")).unwrap()
    joints = model.robot.joint_names
    for law in LAWS:
        values |= {f"{law}.{n}": x for n, x in zip(joints, sizes[law], strict=True)}
    known = Parameters(model.names, model.units, [values[name] for name in model.names])
    return Truth(model, known, np.full(model.robot.n_joints, 0.005))


def process(table: str, seed: int) -> ExactTrajectory:
    """A motion of a process; where joint 6 is free, it keeps the heading of the tool."""
    found = planned_motion(table, seed)
    if table == SQUARE:
        return found
    t = np.arange(0.0, found.duration, 0.004)
    q = np.array(found.sample(t).q)
    q[:, 5] = q[:, 0] - q[0, 0]
    return SampledMotion(t, q)


def compared(truth: Truth, table: str) -> Tracking:
    """Another motion of a process, without a model, with the full and with the reduced one."""
    robot = truth.robot
    drives = customary_drives(robot, LAG)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        file, log = robot_file(folder), folder / "process.csv"
        sensors = customary_sensors(robot, truth)
        rig = VirtualRobot(robot, truth, sensors, control=Cascade(), drives=drives)
        run(rig, process(table, 1), log)
        full = identify(file, log, method="WLS").model
        small = reduce(full, log, criterion="mean_column", stop="tolerance=5").model
    counts = [len(model.estimate.parameters) for model in (full, small)]
    print(f"parameters: {counts[0]} identified, {counts[1]} in the reduced model")
    controllers: dict[str, Control] = {
        "no model": Cascade(),
        "full": TorqueFeedforward(Cascade(), full.valued),
        "reduced": TorqueFeedforward(Cascade(), small.valued),
    }
    frame = frame_of(robot, last_frame(robot))
    return tracking(robot, truth.drifted(DRIFT), process(table, 2), controllers, frame, drives)


def degrees(values: Array) -> str:
    """Errors of joints as words [°]."""
    return ", ".join(f"{x:.4f}" for x in np.degrees(values))


def words(name: str, one: TrackedRun) -> str:
    """A line about a run."""
    tool = f"tool {1e3 * one.tool_rms:.3f} mm"
    return f"{name}, {one.name}: RMS {degrees(one.rms)} °, {tool}"


def main() -> list[Claim]:
    """Both processes."""
    truth = arm()
    claims = []
    pick = compared(truth, PICK)
    bare, full, small = pick.runs
    ratios = pick.ratios(full)
    low, high = np.degrees(bare.rms).min(), np.degrees(bare.rms).max()
    for one in pick.runs:
        print(words("pick and place", one))
    claims += [
        Claim(
            "RMS errors of the joints without a model [°] (paper: 0.0039 to 0.0200)",
            degrees(bare.rms),
            f"{DECADE[0]:g} to {DECADE[1]:g}",
            bool(DECADE[0] <= low and high <= DECADE[1]),
        ),
        Claim(
            "with the identified process model / without, mean (paper: 0.61)",
            f"{ratios.mean():.3f}",
            "<= 0.50",
            bool(ratios.mean() <= 0.5),
        ),
        Claim(
            "the same of each joint (paper: 0.49 to 0.76)",
            ", ".join(f"{x:.2f}" for x in ratios),
            "<= 0.76",
            bool(ratios.max() <= 0.76),
        ),
        smaller("pick and place", full, small),
    ]
    square = compared(truth, SQUARE)
    bare, full, small = square.runs
    for one in square.runs:
        print(words("square", one))
    sizes = [overshoot(square.t, square.desired, one.tool) for one in square.runs]
    claims += [
        Claim(
            "overshoot at the corners of the square [mm], without and with (paper: about halved)",
            f"{1e3 * sizes[0]:.3f}, {1e3 * sizes[1]:.3f}",
            "ratio <= 0.50",
            sizes[1] <= 0.5 * sizes[0],
        ),
        smaller("square", full, small),
    ]
    return claims


def smaller(name: str, full: TrackedRun, small: TrackedRun) -> Claim:
    """The reduced model tracks as well; joints that stand still leave nothing to compare."""
    moving = full.rms > STILL
    ratio = float(np.mean(small.rms[moving] / full.rms[moving]))
    return Claim(
        f"{name}: reduced model / full model, mean of the joints",
        f"{ratio:.3f}",
        "<= 1.100",
        ratio <= 1.1,
    )


if __name__ == "__main__":
    main_of(main)
