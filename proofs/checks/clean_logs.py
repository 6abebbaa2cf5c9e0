"""Clean logs are never refused, however far the nominal model is off.

500 random arms (2 to 7 joints, some prismatic) with friction, offsets and rotors of their own. The
nominal model has masses, centres and inertias that are off by 5 to 300 %, link by link, or all by
one factor. Torques come from the true model, with noise. No log may be refused by the quick check
of `steelyard identify`, and no line of the robot file may be proposed to be changed.
"""

import sys
import tempfile
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from proofs.support.claims import Claim, main_of
from proofs.support.safety_robots import Arm, Link, arm_urdf, random_arm

from steelyard.check.all_checks import examine
from steelyard.check.case_from_files_and_precheck import refusal
from steelyard.check.cases_and_checks import Case, CheckedLog
from steelyard.excite.trajectories.fourier import random_fourier
from steelyard.robot.file.robot_file import LoadedRobot, load_robot
from steelyard.runs.processing_choices import Processing
from steelyard.runs.recording import LogInMemory, Recording
from steelyard.simulate.ground_truth import random_truth

ROBOTS, PROCESSES = 500, 2
LEAST, MOST = 0.05, 3.0
"""Relative error of the nominal model."""
NOISE = 0.01
"""Of the efforts, over their standard deviation."""
ROBOT_FILE = """\
[robot]
urdf = "{urdf}"

[model]
terms = ["rigid_body", "rotor_inertia", "coulomb", "viscous", "offset"]

[signals]
time = "time_s"
position = "q{{}}"

[signals.effort]
columns = "tau{{}}"
kind = "joint_torque"
unit = {units}
"""


@dataclass(frozen=True)
class Outcome:
    """What the quick check says of one clean log.

    Attributes:
        robot: Its number.
        error: Of the nominal model.
        refused: Why it is refused; empty if it is not.
        edits: Keys that are proposed to be changed.
        doubtful: Checks that are doubtful.
    """

    robot: int
    error: float
    refused: str
    edits: tuple[str, ...]
    doubtful: tuple[str, ...]


def nominal(arm: Arm, error: float, rng: np.random.Generator) -> Arm:
    """The arm as a model file has it that is off by so much."""
    alike = rng.random() < 0.3
    one = _factor(error, rng)
    return replace(
        arm,
        links=tuple(_off(x, one if alike else _factor(error, rng), error, rng) for x in arm.links),
    )


def _factor(error: float, rng: np.random.Generator) -> float:
    """Off by the error, either way."""
    return float((1.0 + error) ** rng.choice([-1.0, 1.0]))


def _off(link: Link, factor: float, error: float, rng: np.random.Generator) -> Link:
    """A link of another mass, its centre off by up to 5 cm, its inertia with the mass."""
    moved = rng.uniform(-0.05, 0.05, 3) * min(error, 1.0)
    x, y, z = (float(c + d) for c, d in zip(link.com, moved, strict=True))
    moments = tuple(factor * m for m in link.moments)
    return replace(link, mass=factor * link.mass, com=(x, y, z), moments=moments)


def logged(loaded: LoadedRobot, seed: int, rng: np.random.Generator) -> np.ndarray:
    """Time, positions and torques of the true robot along a random motion."""
    truth = random_truth(loaded.robot, seed, spread=0.0)
    trajectory = random_fourier(loaded.robot, seed=seed, period=10.0, periods=2)
    t = np.arange(0.0, trajectory.duration, 0.005)
    motion = trajectory.sample(t)
    torque = truth.model.at(truth.values).torque(motion)
    torque = torque + NOISE * torque.std(axis=0) * rng.standard_normal(torque.shape)
    q = motion.q + 2e-5 * rng.standard_normal(motion.q.shape)
    return np.column_stack([t, q, torque])


def one_of(folder: Path, number: int) -> Outcome:
    """The quick check of one robot's clean log."""
    rng = np.random.default_rng(41_000 + number)
    arm = random_arm(rng, False)
    error = float(np.exp(rng.uniform(np.log(LEAST), np.log(MOST))))
    true, path = (folder / f"{number}{end}" for end in ("-true.toml", ".toml"))
    units = str(["Nm" if link.kind == "revolute" else "N" for link in arm.links])
    for file, one in ((true, arm), (path, nominal(arm, error, rng))):
        file.with_suffix(".urdf").write_text(arm_urdf(one))
        file.write_text(ROBOT_FILE.format(urdf=file.with_suffix(".urdf").name, units=units))
    table = logged(load_robot(true), number, rng)
    loaded = load_robot(path)
    if loaded.signals is None:
        raise ValueError(f"{path} says nothing about logs")
    recording = Recording(LogInMemory(Path("log"), loaded.signals.columns, table), loaded.signals)
    log = CheckedLog(recording, Processing(), "log")
    found = examine(Case(loaded, (log,), None), quick=True)
    refused = refusal(found, str(path))
    return Outcome(
        number,
        error,
        "" if refused is None else refused.wrong,
        tuple(".".join(edit.path) for edit in found.edits),
        tuple(f.check for f in found.findings if f.severity == 1),
    )


def main(count: int = ROBOTS) -> list[Claim]:
    """Refusals and proposed changes."""
    with tempfile.TemporaryDirectory() as folder, get_context("spawn").Pool(PROCESSES) as pool:
        found = pool.map(partial(one_of, Path(folder)), range(count), chunksize=5)
    for one in found:
        if one.refused or one.edits:
            print(f"robot {one.robot}, off by {one.error:.0%}: {one}", file=sys.stderr)
    refused = sum(bool(one.refused) for one in found)
    changed = sum(bool(one.edits) for one in found)
    doubtful = sum(bool(one.doubtful) for one in found)
    name = f"clean logs of {count} random arms, nominal models off by 5 to 300 %"
    return [
        Claim(f"{name}: refused", f"{refused}", "0", refused == 0),
        Claim(f"{name}: changes proposed", f"{changed}", "0", changed == 0),
        Claim(f"{name}: doubtful", f"{doubtful}", "at most a third", 3 * doubtful <= count),
    ]


if __name__ == "__main__":
    main_of(lambda: main(int(sys.argv[1]) if len(sys.argv) > 1 else ROBOTS))
