"""Designs in the settings of two papers: seven joints (fmincon), six joints (genetic algorithm).

The papers publish neither arm nor limits: the arms and limits are in `problems/`, fixed beforehand.
The seven-joint paper prints the coefficients of its own motion, so this is also judged on our arm.
Five seeds each, ten seconds on two processes; the value is found anew by Pinocchio.
"""

import sys
from pathlib import Path

import numpy as np
from proofs.support.claims import Claim, main_of
from proofs.support.designs import PROBLEMS, designed, independent, regressor, series, sign

sys.path.append(str(Path(__file__).parents[2] / "tests"))
from oracles import pinocchio_model
from steelyard.robot_file.file import load_robot

SEEDS = range(5)
SINE = """
 1.1318 -1.4863 -0.35916 -2.7582 -0.99332 -0.34652 -2.369
 0.42525 -0.71812 0.12917 0.52948 -1.2149 0.24585 1.3629
 0.81248 1.0781 -0.29338 -0.71537 1.4274 -1.5854 0.27264
-1.2358 -0.64219 2.0571 -0.58536 0.021041 -1.8848 -1.0537
-1.1337 1.7684 -1.5337 3.5295 0.75979 3.5709 1.7871
"""
COSINE = """
 0.090313 -0.71072 0.098464 -0.10925 -0.11717 0.69369 -0.71614
-1.1092 0.080641 -1.5471 0.29085 1.1663 -1.6948 1.0262
-0.58771 0.8885 -0.27425 -0.14694 -0.4319 -0.18596 1.4161
 0.90503 -0.15831 1.3792 0.89334 0.96067 0.004065 -1.3927
 2.1697 2.0691 2.1086 -1.0527 -2.8109 1.0734 0.39577
"""
"""Table 1 of the paper: a row per harmonic, a column per joint [rad/s]."""


def conditions(problem: str, motion: dict, samples: int, rigid: int) -> tuple[float, float]:
    """Condition of the regressor, raw and with columns of unit norm."""
    model = pinocchio_model(load_robot(PROBLEMS / f"{problem}.toml").robot)
    t = np.linspace(0.0, motion["period_s"], samples, endpoint=False)
    q, dq, ddq = series(motion, t)
    n = q.shape[1]
    rows = regressor(model, q, dq, ddq)[:, independent(model, rigid)]
    viscous, coulomb = np.zeros((2, len(t), n, n))
    viscous[:, range(n), range(n)] = dq
    coulomb[:, range(n), range(n)] = sign(dq)
    whole = np.hstack([rows, viscous.reshape(-1, n), coulomb.reshape(-1, n)])
    return np.linalg.cond(whole), np.linalg.cond(whole / np.linalg.norm(whole, axis=0))


def of_paper() -> dict:
    """The paper's motion, from its speeds' coefficients; it begins at zero."""
    sine, cosine = (np.array(text.split(), dtype=float).reshape(5, 7).T for text in (SINE, COSINE))
    rate = 2.0 * np.pi / 20.0 * np.arange(1, 6)
    return {"period_s": 20.0, "start": [0.0] * 7, "sine": sine / rate, "cosine": -cosine / rate}


def main() -> list[Claim]:
    """Three settings, and the printed motion."""
    found = []
    for name, problem, samples, rigid, raw, bound in (
        ("seven joints, raw (paper 75.5)", "srs_arm", 2000, 43, True, 75.5 / 2.0),
        ("six joints, normalised, full (paper 6.76)", "welder_full", 1000, 36, False, 6.8),
        ("six joints, normalised, box (paper 7.71)", "welder_restrained", 1000, 36, False, 7.7),
    ):
        values = []
        for seed in SEEDS:
            run = designed(PROBLEMS / f"{problem}.toml", "--seed", str(seed))
            if not run.result["certified"]:
                return [Claim(name, "not certified", "certified", False)]
            both = conditions(problem, run.coefficients, samples, rigid)
            values.append(both[0] if raw else both[1])
        middle = float(np.median(values))
        each = " ".join(f"{value:.2f}" for value in sorted(values))
        found.append(Claim(name, f"{middle:.2f} ({each})", f"<= {bound:.2f}", middle <= bound))
    printed = conditions("srs_arm", of_paper(), 2000, 43)[0]
    speed = np.abs(series(of_paper(), np.linspace(0.0, 20.0, 2000))[1]).max()
    figures = f"{printed:.1f}, speeds to {speed:.1f} rad/s"
    found.append(Claim("the paper's printed motion on our seven joints", figures, "reported", True))
    return found


if __name__ == "__main__":
    main_of(main)
