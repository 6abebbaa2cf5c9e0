"""Designs in the settings of two papers: seven joints (fmincon), six joints (genetic algorithm).

The papers publish neither arm nor limits: the arms and limits are in `problems/` and
`studies/robots/`, fixed beforehand.
The seven-joint paper prints the coefficients of its own motion, so this is also judged on our arm.
Five seeds each, ten seconds on two processes; the value is found anew by Pinocchio.
"""

import json
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from proofs.support.claims import Claim, main_of
from proofs.support.designs import PROBLEMS, designed, independent, regressor, series, sign

sys.path.append(str(Path(__file__).parents[2] / "tests"))
from studies.p4_seven_joints import printed_motion
from studies.support.robots import ROBOTS

from oracles import pinocchio_model
from steelyard.robot.file.robot_file import load_robot

SEEDS = range(5)
ARM = ROBOTS / "p4_arm.toml"
FULL, RESTRAINED = ROBOTS / "p2_arm.toml", PROBLEMS / "welder_restrained.toml"


def conditions(problem: Path, motion: dict, samples: int, rigid: int) -> tuple[float, float]:
    """Condition of the regressor, raw and with columns of unit norm."""
    model = pinocchio_model(load_robot(problem).robot)
    t = np.linspace(0.0, motion["period_s"], samples, endpoint=False)
    q, dq, ddq = series(motion, t)
    n = q.shape[1]
    rows = regressor(model, q, dq, ddq)[:, independent(model, rigid)]
    viscous, coulomb = np.zeros((2, len(t), n, n))
    viscous[:, range(n), range(n)] = dq
    coulomb[:, range(n), range(n)] = sign(dq)
    whole = np.hstack([rows, viscous.reshape(-1, n), coulomb.reshape(-1, n)])
    return np.linalg.cond(whole), np.linalg.cond(whole / np.linalg.norm(whole, axis=0))


def main() -> list[Claim]:
    """Three settings, and the printed motion."""
    found = []
    for name, problem, samples, rigid, raw, bound in (
        ("seven joints, raw (paper 75.5)", ARM, 2000, 43, True, 75.5 / 2.0),
        ("six joints, normalised, full (paper 6.76)", FULL, 1000, 36, False, 6.8),
        ("six joints, normalised, box (paper 7.71)", RESTRAINED, 1000, 36, False, 7.7),
    ):
        values = []
        for seed in SEEDS:
            run = designed(problem, "--seed", str(seed))
            if not run.result["certified"]:
                return [Claim(name, "not certified", "certified", False)]
            both = conditions(problem, run.coefficients, samples, rigid)
            values.append(both[0] if raw else both[1])
        middle = float(np.median(values))
        each = " ".join(f"{value:.2f}" for value in sorted(values))
        found.append(Claim(name, f"{middle:.2f} ({each})", f"<= {bound:.2f}", middle <= bound))
    with TemporaryDirectory() as folder:
        motion = json.loads(printed_motion(Path(folder) / "table1.json").read_text())
    printed = conditions(ARM, motion, 2000, 43)[0]
    speed = np.abs(series(motion, np.linspace(0.0, 20.0, 2000))[1]).max()
    figures = f"{printed:.1f}, speeds to {speed:.1f} rad/s"
    found.append(Claim("the paper's printed motion on our seven joints", figures, "reported", True))
    return found


if __name__ == "__main__":
    main_of(main)
