"""Designs for Panda and UR10 within a time: value, certificate, limits on a finer grid.

Every figure is the median of five seeds; the value and the limits are found anew from the written
coefficients by Pinocchio, the time is that of the whole command.
"""

from pathlib import Path

import numpy as np
from proofs.support.claims import Claim, main_of
from proofs.support.designs import PROBLEMS, Judge, Run, designed, panda, ur10

SEEDS = range(5)
TIMED = True


def runs(problem: Path, seconds: float, *options: str) -> list[Run]:
    """One design per seed."""
    return [
        designed(problem, "--budget", str(seconds), "--seed", str(seed), *options) for seed in SEEDS
    ]


def claims_of(
    name: str, found: list[Run], judge: Judge, seconds: float, bound: float, normalised: bool
) -> list[Claim]:
    """Median value, longest time, least margin."""
    values = [judge.value(run.coefficients)[normalised] for run in found]
    printed = [run.result["figure"] for run in found]
    apart = max(abs(a / b - 1.0) for a, b in zip(values, printed, strict=True))
    margin = min(judge.worst(run.coefficients) for run in found)
    longest = max(run.seconds for run in found)
    proven = all(run.result["certified"] for run in found)
    each = " ".join(f"{value:.2f}" for value in sorted(values))
    middle = float(np.median(values))
    return [
        Claim(f"{name}, {seconds:g} s", f"{middle:.2f} ({each})", f"<= {bound}", middle <= bound),
        Claim(f"{name}, longest", f"{longest:.1f} s", f"<= {seconds:g} s", longest <= seconds),
        Claim(
            f"{name}, certified, least margin on 1e5 samples",
            f"{margin:.1e}" if proven else "not certified",
            ">= 0",
            proven and margin >= 0.0,
        ),
        Claim(f"{name}, printed against Pinocchio", f"{apart:.1e}", "<= 1e-6", apart <= 1e-6),
    ]


def main() -> list[Claim]:
    """All four."""
    franka, universal = panda(), ur10()
    found: list[Claim] = []
    cases = (
        ("Panda, raw condition", "panda", franka, 10.0, 36.0, False),
        ("Panda, raw condition", "panda", franka, 40.0, 34.5, False),
        ("UR10, raw condition", "ur10", universal, 40.0, 36.0, False),
        ("Panda, normalised condition", "panda", franka, 10.0, 4.9, True),
    )
    for name, problem, judge, seconds, bound, normalised in cases:
        options = ("--criterion", "normalised_condition") if normalised else ()
        made = runs(PROBLEMS / f"{problem}.toml", seconds, *options)
        found += claims_of(name, made, judge, seconds, bound, normalised)
    return found


if __name__ == "__main__":
    main_of(main)
