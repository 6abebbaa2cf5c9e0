"""Efforts logged beside targets: intervals of gains, and of what they give its scale.

Servo arms of two joints that MuJoCo simulates at 50 to 200 Hz, drawn as in `simulated_servos`
(plain ones), each with 45 s of motion. Currents of unknown gains, with noise, get gains; torques of
the motors give stiffness, friction and masses their scale where the links of the model file are
lighter or heavier by up to 50 %. `python -m proofs.actuators.logged_efforts N` takes N arms.
"""

import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import polars as pl
from proofs.actuators.simulated_servos import drawn
from proofs.support.claims import Claim, main_of
from proofs.support.servo_arm import JOINTS, ROBOT_FILE, URDF, log

import steelyard

ARMS, PROCESSES = 20, 2
COVERED = 0.90
"""Share of the 95 % intervals of so few arms that hold the truth, at least."""
MOST_OFF = 0.01
"""Of the stiffness by torques, on average."""
KNOWN = "position_sign = [1, 1]\nposition_offset = [0.0, 0.0]\n"
NAMES = ("stiffness", "damping", "coulomb", "armature")


def file_of(kind: str, unit: str) -> str:
    """A robot file with efforts beside targets."""
    columns = f'effort = {{columns = "tau{{}}", kind = "{kind}", unit = "{unit}"}}\n'
    return f'{ROBOT_FILE}{KNOWN}{columns}[actuator]\nlaw = "position_pd"\n'


def heavier(factor: float) -> str:
    """The model file with other masses and inertias."""
    robot = ElementTree.fromstring(URDF)
    for one in robot.iter("mass"):
        one.set("value", f"{factor * float(one.get('value', '0')):.9g}")
    for one in robot.iter("inertia"):
        for key, value in one.attrib.items():
            one.set(key, f"{factor * float(value):.9g}")
    return ElementTree.tostring(robot, encoding="unicode")


def one(seed: int) -> tuple[list[bool], list[bool], list[float]]:
    """Whether intervals of gains, and of values by torques, hold; errors of the stiffness."""
    rng = np.random.default_rng(4000 + seed)
    servos, rate = drawn(rng, 2, "plain"), float(rng.choice([50.0, 100.0, 200.0]))
    gains, factor = rng.uniform(0.3, 3.0, 2) * rng.choice([-1.0, 1.0], 2), rng.uniform(0.67, 1.5)
    table = dict(log(servos, 45.0, seed, rate, jitter=0.05 / rate, step=5e-5, torques=True))
    for j in (1, 2):
        table[f"tau{j}"] += 0.05 * table[f"tau{j}"].std() * rng.standard_normal(len(table["time"]))
    currents = {**table, **{f"tau{j}": table[f"tau{j}"] / gains[j - 1] for j in (1, 2)}}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "servos.urdf").write_text(URDF)
        (folder / "servos.toml").write_text(file_of("motor_current", "A"))
        pl.DataFrame(currents).write_parquet(folder / "log.parquet")
        found = steelyard.identify_actuators(
            folder / "servos.toml", folder / "log.parquet", threads=1
        )
        told = zip(found.model.efforts, gains, strict=True)
        hold = [bool(x.interval and x.interval[0] <= g <= x.interval[1]) for x, g in told]
        (folder / "servos.urdf").write_text(heavier(factor))
        (folder / "servos.toml").write_text(file_of("motor_torque", "Nm"))
        pl.DataFrame(table).write_parquet(folder / "log.parquet")
        scaled = steelyard.identify_actuators(
            folder / "servos.toml", folder / "log.parquet", threads=1
        )
    values = {(p.name, p.joint): p for p in scaled.parameters}
    inside, off = list[bool](), list[float]()
    for k, joint in enumerate(JOINTS[2]):
        for what in NAMES:
            p, true = values[what, joint], vars(servos)[what][k]
            inside.append(bool(p.interval and p.interval[0] <= true <= p.interval[1]))
            off += [abs(p.value / true - 1.0)] if what == "stiffness" else []
    print(seed, rate, f"{factor:.2f}", hold, inside, off, file=sys.stderr, flush=True)
    return hold, inside, off


def main(arms: int = ARMS) -> list[Claim]:
    """Coverage, and errors."""
    with ProcessPoolExecutor(PROCESSES, mp_context=get_context("spawn")) as pool:
        found = list(pool.map(one, range(arms)))
    hold, inside, off = (np.concatenate([x[k] for x in found]) for k in range(3))
    return [
        Claim("95 % intervals of gains hold the truth", f"{hold.mean():.1%} of {len(hold)}",
              f">= {COVERED:.0%}", float(hold.mean()) >= COVERED),
        Claim("intervals of values with the scale of torques, masses wrong by up to 50 %",
              f"{inside.mean():.1%} of {len(inside)}", f">= {COVERED:.0%}",
              float(inside.mean()) >= COVERED),
        Claim("stiffness with the scale of torques, off on average", f"{off.mean():.2%}",
              f"<= {MOST_OFF:.0%}", float(off.mean()) <= MOST_OFF),
    ]  # fmt: skip


if __name__ == "__main__":
    main_of(lambda: main(*map(int, sys.argv[1:2])))
