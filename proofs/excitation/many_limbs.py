"""Motions for robots with many limbs: error on another motion, and the time of the design.

Of public models in `models/menagerie` beside the data: excite, simulate, identify without prior
knowledge of the masses, and validate on a random motion of another seed. Meshes are not needed. A
model that is not there is skipped, with a line. Names of robots as arguments choose among them.

The design is timed twice, the first time with an empty cache of compiled programs. Times are those
of the clock: they mean something only where nothing else runs.
"""

import json
import os
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import polars as pl
from proofs.support.claims import Claim, data_folder, main_of

TIMED = True  # nothing else may run beside it

BUDGET = 30.0
"""Of every design [s]."""

LATE = 2.0
"""What a design may take beyond its budget [s]."""

CASES = (
    ("A1", "unitree_a1/a1.xml", "trunk", 3.0),
    ("ALOHA", "aloha/aloha.xml", None, 3.0),
    ("Allegro", "wonik_allegro/right_hand.xml", None, 3.0),
    ("G1", "unitree_g1/g1.xml", "pelvis", 5.0),
    ("TALOS", "pal_talos/talos.xml", "base_link", 5.0),
)
"""Name, file, link that is fixed, and most error [%]."""


def ran(*arguments: object) -> dict:
    """A command of steelyard, and what it says."""
    command = [str(Path(sys.executable).with_name("steelyard")), *map(str, arguments), "--json"]
    done = subprocess.run(
        command,
        capture_output=True,
        text=True,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
    )
    if done.returncode not in (0, 1, 3):  # 1: the model is poor, 3: something is not looked at
        sys.exit(done.stderr)
    return json.loads(done.stdout) if done.stdout else {}


def robot_file(model: Path, base: str | None, folder: Path) -> Path:
    """A robot file without knowledge of masses, with the columns that simulate writes."""
    bare = folder / "bare.toml"
    base_line = f'base = "{base}"\n' if base else ""
    bare.write_text(f'[robot]\nmjcf = "{model}"\n{base_line}')
    ran("simulate", bare, "--seed", 3, "-o", folder / "other")
    columns = pl.read_csv(folder / "other/log.csv").columns
    q, dq, tau = ([c for c in columns if re.match(f"{x}[0-9]", c)] for x in ("q", "dq", "tau"))
    signals = (
        f'[signals]\ntime = "time_s"\nposition = {q}\nposition_unit = {_units(q)}\n'
        f"velocity = {dq}\n"
        f'[signals.effort]\ncolumns = {tau}\nkind = "joint_torque"\nunit = {_units(tau)}\n'
        '[prior]\nsource = "none"\n'
    )
    terms = '[model]\nterms = ["rigid_body", "rotor_inertia", "coulomb", "viscous", "offset"]\n'
    full = folder / "robot.toml"
    full.write_text(bare.read_text() + terms + signals)
    return full


def _units(columns: list[str]) -> list[str]:
    """What stands behind the last underscore, column by column."""
    return [column.rpartition("_")[2] for column in columns]


def designed(robot: Path, folder: Path) -> tuple[dict, float]:
    """What `excite` says, and the seconds of the whole command."""
    start = time.perf_counter()
    values = ran("excite", robot, "--budget", BUDGET, "-o", folder)
    return values, time.perf_counter() - start


def claims_of(name: str, model: Path, base: str | None, most: float, folder: Path) -> list[Claim]:
    """Error on another motion, and the time of the design without and with its code compiled."""
    robot = robot_file(model, base, folder)
    os.environ["STEELYARD_CACHE"] = str(folder / "cache")
    _, cold = designed(robot, folder / "first")
    values, warm = designed(robot, folder / "motion")
    for run, motion in (("run", "motion"), ("unseen", "other")):
        path = folder / motion / "trajectory.json"
        ran("simulate", robot, "--seed", 1, "--motion", path, "-o", folder / run)
    logs = [folder / run / "log.csv" for run in ("run", "unseen")]
    found = ran("identify", robot, logs[0], "--validate", logs[1], "-o", folder / "model")
    unseen = found["validation"][0]
    # joints in N and in Nm have no common error
    error = unseen["pooled_percent_moving"] or unseen["mean_percent_moving"]
    condition = f"condition {values['condition']:.3g}"
    within = f"<= {BUDGET + LATE:g} s"
    return [
        Claim(
            f"{name}, error on another motion",
            f"{error:.2f} %, {condition}",
            f"<= {most} %",
            error <= most,
        ),
        Claim(f"{name}, time, empty cache", f"{cold:.1f} s", within, cold <= BUDGET + LATE),
        Claim(f"{name}, time", f"{warm:.1f} s", within, warm <= BUDGET + LATE),
    ]


def main() -> list[Claim]:
    """All robots that are there, or those that are named."""
    models = data_folder().parent / "models/menagerie"
    found = list[Claim]()
    named = {case[0] for case in CASES}.intersection(sys.argv[1:])
    for name, place, base, most in CASES:
        if named and name not in named:
            continue
        if not (models / place).exists():
            print(f"{name}: there is no {models / place}, so it is passed over", file=sys.stderr)
            continue
        with tempfile.TemporaryDirectory() as folder:
            found += claims_of(name, models / place, base, most, Path(folder))
    return found


if __name__ == "__main__":
    main_of(main)
