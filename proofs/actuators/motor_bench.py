"""A bench of one servo: a pendulum of known mass, whose friction law and parameters are found.

Each draw has a position controller of limited voltage (back-EMF) and one of four laws of dry
friction: Coulomb alone, Stribeck, with the load, or both. MuJoCo simulates it with a friction that
is set at each step. Logs of 60 s at 100 Hz, encoders of 12 bit.
`python -m proofs.actuators.motor_bench N` takes N draws.
"""

import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import polars as pl
from proofs.support.claims import Claim, main_of
from proofs.support.servo_arm import BENCH_FILE, BENCH_URDF, Servos, log

import steelyard

DRAWS, PROCESSES = 12, 2
RIGHT = 0.9
"""Share of the draws whose law of dry friction is chosen rightly."""
COVERED = 0.93
"""Share of the 95 % intervals that hold the truth."""
LAWS = {
    "Coulomb": (False, False),
    "Stribeck": (True, False),
    "load": (False, True),
    "Stribeck and load": (True, True),
}


def drawn(rng: np.random.Generator, stribeck: bool, load: bool) -> Servos:
    """A servo of a toy's size at the pendulum, of 1 to 2 Nm; the second joint is none."""

    def of(low: float, high: float, used: bool = True) -> tuple[float]:
        return (float(np.exp(rng.uniform(np.log(low), np.log(high)))) if used else 0.0,)

    coulomb = of(0.05, 0.15)
    return Servos(
        stiffness=of(8.0, 25.0),
        damping=of(0.2, 0.8),
        coulomb=coulomb,
        armature=of(0.005, 0.03),
        torque_limit=(1e3,),
        delay=round(float(rng.uniform(0.0, 0.02)), 4),
        back_emf=(0.0,),
        stribeck=(coulomb[0] * of(0.5, 1.5, stribeck)[0],),
        stribeck_speed=of(0.1, 0.4),
        load_friction=of(0.08, 0.25, load),
    )


def one(draw: int) -> tuple[str, bool, list[tuple[str, bool]]]:
    """Of one draw: its law, whether that was chosen, and which intervals hold."""
    rng = np.random.default_rng(7000 + draw)
    law = list(LAWS)[draw % len(LAWS)]
    servo = drawn(rng, *LAWS[law])
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "bench.urdf").write_text(BENCH_URDF)
        (folder / "bench.toml").write_text(BENCH_FILE)
        pl.DataFrame(log(servo, 60.0, draw, 100.0)).write_parquet(folder / "log.parquet")
        found = steelyard.identify_actuators(
            folder / "bench.toml", folder / "log.parquet", threads=1
        )
    used = {p.name for p in found.parameters if p.interval is not None}
    right = ("stribeck" in used, "load_friction" in used) == LAWS[law]
    held = []
    for p in found.parameters:
        if p.interval is not None and p.name in vars(servo) and p.status == "identified":
            given = getattr(servo, p.name)
            real = given[0] if isinstance(given, tuple) else given
            held.append((p.name, p.interval[0] <= real <= p.interval[1]))
    print(draw, law, right, held, file=sys.stderr, flush=True)
    return law, right, held


def main(draws: int = DRAWS) -> list[Claim]:
    """Laws that are chosen, and intervals."""
    with ProcessPoolExecutor(PROCESSES, mp_context=get_context("spawn")) as pool:
        found = list(pool.map(one, range(draws)))
    right = float(np.mean([good for _, good, _ in found]))
    held = [x for _, good, some in found if good for _, x in some]
    listed = ", ".join(
        f"{law} {np.mean([good for one, good, _ in found if one == law]):.0%}" for law in LAWS
    )
    return [
        Claim(
            f"law of dry friction of {draws} servos",
            f"{right:.0%} right ({listed})",
            f">= {RIGHT:.0%}",
            right >= RIGHT,
        ),
        Claim(
            "95 % intervals hold the truth, where the law is right",
            f"{np.mean(held):.1%} of {len(held)}",
            f">= {COVERED:.0%}",
            bool(np.mean(held) >= COVERED),
        ),
    ]


if __name__ == "__main__":
    main_of(lambda: main(*map(int, sys.argv[1:2])))
