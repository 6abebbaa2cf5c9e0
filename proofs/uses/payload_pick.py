"""A virtual arm of the RX-160's size picks up 2 kg at 13 s and lets go at 54 s, as in p3.

The model is identified from two other logs of the same arm; torques are those of motors, with 2 %
for each gain in the intervals. The relative absolute error is p3's equation 17, of the weight that
hangs on the tool and of the wrench that `steelyard wrench` estimates from the same log. Run by
itself it prints a table as p3's table 7. (The paper's own figures are not in the text at hand.)
"""

import tempfile
from pathlib import Path

import numpy as np
from proofs.support.claims import Claim, main_of
from studies.support.robots import ROBOTS

from steelyard import load_runs
from steelyard.base.arrays import Array
from steelyard.base.motion import run
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.excite.trajectories.fourier import random_fourier
from steelyard.identify.identify import identify
from steelyard.model.equations.frame_and_point_kinematics import frame_kinematics
from steelyard.model.model import model_with_open_friction
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.inertia_and_placement import Inertia
from steelyard.simulate.drives_sensors_and_loads import Payload
from steelyard.simulate.ground_truth import random_truth
from steelyard.simulate.virtual_robot import VirtualRobot, customary_sensors
from steelyard.uses.payload.payload import payload_events
from steelyard.uses.payload.pick_up_and_put_down import PayloadEvents
from steelyard.uses.wrench.wrench import MethodName, external_wrench

ROBOT = ROBOTS / "p3_rx160.toml"
MASS, PICK, RELEASE = 2.0, 13.0, 54.0
LOAD = Inertia.about_com(MASS, (0.0, 0.01, 0.08), 0.0033 * np.eye(3))
COMPONENTS = ("Fx [N]", "Fy [N]", "Fz [N]", "Mx [Nm]", "My [Nm]", "Mz [Nm]")
TOLERANCE = 0.3
"""Of the times [s]."""


def logs(folder: Path) -> tuple[Path, ...]:
    """Logs of the arm: two to identify it, the pick, and ten minutes without payload."""
    loaded = load_robot(ROBOT)
    robot = loaded.robot
    truth = random_truth(robot, 1, terms=model_with_open_friction(loaded).terms)
    sensors = customary_sensors(robot, truth)
    carried = Payload(LOAD, robot.bodies[-1].name, PICK, RELEASE)
    paths = []
    for name, seed, period, harmonics, periods, share, payload in (
        ("fit1", 5, 20.0, 5, 1, 0.6, None),
        ("fit2", 6, 20.0, 5, 1, 0.6, None),
        ("pick", 7, 66.0, 14, 1, 0.4, carried),
        ("free", 8, 60.0, 14, 10, 0.4, None),
    ):
        rig = VirtualRobot(
            robot, truth, sensors, seed=seed, payload=payload, signals=loaded.signals
        )
        motion = random_fourier(
            robot,
            seed=seed,
            period=period,
            harmonics=harmonics,
            periods=periods,
            limits_fraction=share,
        )
        paths.append(folder / f"{name}.csv")
        run(rig, motion, paths[-1])
    return tuple(paths)


def relative_error(found: PayloadEvents) -> float:
    """p3's equation 17 of the carried weight over the 68 s of the log."""
    t = np.arange(0.0, 68.0, 0.01)
    true = np.where((t >= PICK) & (t < RELEASE), MASS, 0.0)
    estimated = np.zeros(len(t))
    for event in found.events:
        estimated[t >= event.time] += event.mass if event.kind == "picked up" else -event.mass
    return float(np.abs(true - estimated).sum() / np.abs(true - true.mean()).sum())


def load_wrench(log: Path) -> tuple[Array, Array]:
    r"""Times of a log `(N,)`, and what the load exerts on the last link, base's axes, `(N, 6)`.

    Force $-m(\ddot p_c - g)$, moment about the link frame's origin.
    """
    (whole,) = load_runs(ROBOT, log)
    motion = whole.whole().motion
    robot = load_robot(ROBOT).robot
    place, rotation = frame_kinematics(robot, robot.bodies[-1].name)(motion.q)[:2]
    arm = rotation @ LOAD.com
    acceleration = _rate(_rate(place + arm, motion.t), motion.t)
    force = LOAD.mass * (robot.gravity - acceleration)
    turning = np.einsum("nij,nkj->nik", _rate(rotation, motion.t), rotation)
    speed = np.stack([turning[:, 2, 1], turning[:, 0, 2], turning[:, 1, 0]], axis=1)
    moment = np.cross(arm, force) - LOAD.inertia_com[0, 0] * _rate(speed, motion.t)
    held = (motion.t >= PICK) & (motion.t < RELEASE)
    return motion.t, np.hstack([force, moment]) * held[:, None]


def _rate(values: Array, t: Array) -> Array:
    return np.asarray(np.gradient(values, t, axis=0))


def wrench_errors(
    model: IdentifiedModel, log: Path, method: MethodName
) -> tuple[Array, Array, Array]:
    """Mean and standard deviation of the errors, and p3's equation 17, each shape `(6,)`."""
    frame = model.model.robot.bodies[-1].name
    found = external_wrench(model, log, frame, method=method, axes="base")
    t, wrench = load_wrench(log)
    true = np.column_stack([np.interp(found.t, t, row) for row in wrench.T])
    error = found.wrench - true
    spread = np.abs(true - true.mean(axis=0)).sum(axis=0)
    return error.mean(axis=0), error.std(axis=0), np.abs(error).sum(axis=0) / spread


def _table(errors: tuple[Array, Array, Array], inverse: Array) -> None:
    """Print errors as p3's table 7, beside the relative ones of the inverse Jacobian."""
    print("  wrench of the load   mean of error   deviation   relative error   by inverse Jacobian")
    for name, mean, std, relative, other in zip(COMPONENTS, *errors, inverse, strict=True):
        print(f"  {name:19}  {mean:13.3f}   {std:9.3f}   {relative:14.3f}   {other:19.3g}")


def main() -> list[Claim]:
    """Times, mass and interval of the pick; no event without one."""
    with tempfile.TemporaryDirectory() as name:
        *fit, pick, free = logs(Path(name))
        model = identify(ROBOT, fit).model
        found, quiet = (payload_events(model, log) for log in (pick, free))
        errors = wrench_errors(model, pick, "smoothed")
        inverse = wrench_errors(model, pick, "inverse")[2]
    _table(errors, inverse)
    kinds = [event.kind for event in found.events]
    first, last = found.events[0], found.events[-1]
    inside = all(
        abs(event.mass - MASS) <= event.mass_half_width
        and event.earliest - 0.05 <= when <= event.latest + 0.05
        for event, when in ((first, PICK), (last, RELEASE))
    )
    error = relative_error(found)
    return [
        Claim(
            "events", ", ".join(kinds), "picked up, put down", kinds == ["picked up", "put down"]
        ),
        Claim(
            "times of 13 s and 54 s",
            f"{first.time:.2f} s, {last.time:.2f} s",
            f"± {TOLERANCE} s",
            abs(first.time - PICK) <= TOLERANCE and abs(last.time - RELEASE) <= TOLERANCE,
        ),
        Claim(
            "mass of 2 kg",
            f"{first.mass:.3f} ± {first.mass_half_width:.3f} kg",
            "± 5 %",
            abs(first.mass / MASS - 1.0) <= 0.05,
        ),
        Claim("intervals of times and masses", f"{inside}", "contain the truth", inside),
        Claim(
            "events in ten minutes without payload",
            f"{len(quiet.events)} events, {len(quiet.carried)} payloads",
            "none",
            not quiet.events and not quiet.carried,
        ),
        Claim(
            "relative absolute error of the weight (p3, eq. 17)",
            f"{error:.3f}",
            "<= 0.05",
            error <= 0.05,
        ),
        Claim(
            "relative absolute error of the vertical force of the wrench (p3, eq. 17)",
            f"{errors[2][2]:.3f}",
            "<= 0.2",
            errors[2][2] <= 0.2,
        ),
    ]


if __name__ == "__main__":
    main_of(main)
