"""Intervals of actuators, and errors on unseen motion, of servo arms that MuJoCo simulates.

Arms of two joints with drawn stiffness, damping, friction, rotor inertia and delay, logged with an
encoder of 12 bit, noise, and a clock with jitter at 50 to 200 Hz. Each log has 90 s, motion that
is predicted 30 s. `python -m proofs.actuators.simulated_servos N` takes N arms.
"""

import sys
import tempfile
from collections import defaultdict
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import polars as pl
from proofs.support.claims import Claim, main_of
from proofs.support.servo_arm import ROBOT_FILE, URDF, Servos, log

import steelyard
from steelyard.actuators.actuator_parameters import ActuatorValues

ARMS, PROCESSES = 16, 2
COVERED = (0.93, 0.97)
"""Share of the 95 % intervals that hold the truth."""
STEP = 2.5e-5
"""Of MuJoCo [s]: at 0.1 ms its steps change the delay by as much as the intervals are wide."""
UNSEEN = 1.05
"""Error of unseen motion over that of the true parameters."""


def drawn(rng: np.random.Generator) -> Servos:
    """Servos between a toy's and an arm's."""

    def pair(low: float, high: float) -> tuple[float, float]:
        a, b = np.exp(rng.uniform(np.log(low), np.log(high), 2))
        return float(a), float(b)

    return Servos(
        pair(6.0, 25.0),
        pair(0.2, 0.9),
        pair(0.03, 0.25),
        pair(0.005, 0.04),
        delay=round(float(rng.uniform(0.0, 0.03)), 4),
    )


def one(seed: int) -> tuple[dict[str, list[bool]], float, list[float]]:
    """Of one arm: which intervals hold, the error ratio, and relative errors of stiffness."""
    rng = np.random.default_rng(900 + seed)
    servos, rate = drawn(rng), float(rng.choice([50.0, 100.0, 200.0]))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "servos.urdf").write_text(URDF)
        (folder / "servos.toml").write_text(ROBOT_FILE)
        for k, (what, seconds) in enumerate((("fit", 90.0), ("unseen", 30.0))):
            table = log(servos, seconds, 10 * seed + k, rate, jitter=0.05 / rate, step=STEP)
            pl.DataFrame(table).write_parquet(folder / f"{what}.parquet")
        found = steelyard.identify_actuators(
            folder / "servos.toml", folder / "fit.parquet", folder / "unseen.parquet", threads=1
        )
        values = ActuatorValues.of((1.0, 1.0), **vars(servos))
        true = steelyard.validate_actuators(
            replace(found.model, values=values), folder / "unseen.parquet", threads=1
        )
    hold = defaultdict(list)
    for p in found.parameters:
        if p.interval is not None and (p.name in vars(servos) or p.name in ("offset", "zero")):
            given = getattr(servos, p.name, 0.0)
            joint = ("shoulder", "elbow", "all").index(p.joint)
            real = given[joint] if isinstance(given, tuple) else given
            hold[p.name].append(p.interval[0] <= real <= p.interval[1])
    ratio = float(np.mean(found.validation[0].rms / true.validation[0].rms))
    off = (found.model.values["stiffness"] / servos.stiffness - 1.0).tolist()
    print(seed, f"{ratio:.3f}", dict(hold), file=sys.stderr, flush=True)
    return dict(hold), ratio, off


def main(arms: int = ARMS) -> list[Claim]:
    """Coverage by parameter, and errors."""
    with ProcessPoolExecutor(PROCESSES, mp_context=get_context("spawn")) as pool:
        found = list(pool.map(one, range(arms)))
    hold = defaultdict(list)
    for by, _, _ in found:
        for name, some in by.items():
            hold[name] += some
    every = [x for some in hold.values() for x in some]
    share, ratios = float(np.mean(every)), [ratio for _, ratio, _ in found]
    scatter = float(np.sqrt(0.95 * 0.05 / len(found)))
    listed = ", ".join(f"{name} {np.mean(x):.0%}" for name, x in hold.items())
    off = np.abs(np.concatenate([x for _, _, x in found]))
    return [
        Claim(
            f"95 % intervals of {arms} simulated arms hold the truth",
            f"{share:.1%} of {len(every)} ({listed})",
            f"{COVERED[0]:.0%} to {COVERED[1]:.0%}, ± {scatter:.0%} for {arms} arms",
            COVERED[0] - scatter <= share <= COVERED[1] + scatter,
        ),
        Claim(
            "error of unseen motion over that of the true parameters",
            f"mean {np.mean(ratios):.3f}, worst {max(ratios):.3f}",
            f"mean <= {UNSEEN:g}",
            float(np.mean(ratios)) <= UNSEEN,
        ),
        Claim("stiffness", f"off by {off.mean():.2%} on average", "reported", True),
    ]


if __name__ == "__main__":
    main_of(lambda: main(*map(int, sys.argv[1:2])))
