"""A virtual arm of the RX-160's size picks up 2 kg at 13 s and lets go at 54 s, as in p3.

The model is identified from two other logs of the same arm; torques are those of motors, with 2 %
for each gain in the intervals. The relative absolute error is p3's equation 17, of the weight that
hangs on the tool. (The paper's own figures, its table 7, are not in the text at hand.)
"""

import tempfile
from pathlib import Path

import numpy as np
from proofs.support.claims import Claim, main_of

from steelyard.application.payload_events import PayloadEvents
from steelyard.excitation.trajectories.random_fourier import random_fourier
from steelyard.identification.identify import identify
from steelyard.identification.logs import model_of
from steelyard.identification.payload import payload_events
from steelyard.motion import run
from steelyard.robot.inertia import Inertia
from steelyard.robot_file.file import load_robot
from steelyard.virtual.invent import random_truth
from steelyard.virtual.payload import Payload
from steelyard.virtual.robot import VirtualRobot
from steelyard.virtual.simulate import customary_sensors

ROBOT = Path(__file__).parents[1] / "problems" / "rx160.toml"
MASS, PICK, RELEASE = 2.0, 13.0, 54.0
LOAD = Inertia.about_com(MASS, (0.0, 0.01, 0.08), 0.0033 * np.eye(3))
TOLERANCE = 0.3
"""Of the times [s]."""


def logs(folder: Path) -> tuple[Path, ...]:
    """Logs of the arm: two to identify it, the pick, and ten minutes without payload."""
    loaded = load_robot(ROBOT)
    robot = loaded.robot
    truth = random_truth(robot, 1, terms=model_of(loaded).terms)
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


def main() -> list[Claim]:
    """Times, mass and interval of the pick; no event without one."""
    with tempfile.TemporaryDirectory() as name:
        *fit, pick, free = logs(Path(name))
        model = identify(ROBOT, fit).model
        found, quiet = (payload_events(model, log) for log in (pick, free))
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
    ]


if __name__ == "__main__":
    main_of(main)
