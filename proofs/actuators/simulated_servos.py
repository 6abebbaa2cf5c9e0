"""Intervals of actuators, and errors on unseen motion, of servo arms that MuJoCo simulates.

Three robots (a pendulum, an arm of two joints, one with a waist beneath it) with five kinds of
servo: plain ones, friction that falls with speed, friction that grows with the load, a torque limit
that is reached, and one that falls with speed. Stiffness, damping, friction, rotor inertia and
delay are drawn; encoders have 12 bit and noise, clocks jitter at 50 to 200 Hz. Each log has 90 s,
motion that is predicted 30 s. Zero code: the law is chosen from the log.
`python -m proofs.actuators.simulated_servos N` takes N arms.
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
from proofs.support.servo_arm import JOINTS, ROBOT_FILE, URDFS, Servos, log

import steelyard
from steelyard.actuators.actuator_parameters import ActuatorValues

ARMS, PROCESSES = 30, 2
COVERED = (0.93, 0.97)
"""Share of the 95 % intervals that hold the truth."""
STEP = 2.5e-5
"""Of MuJoCo [s]: at 0.1 ms its steps change the delay by as much as the intervals are wide."""
UNSEEN = 1.05
"""Error of unseen motion over that of the true parameters."""
ROBOTS = (2, 1, 3)  # numbers of joints
KINDS = ("plain", "Stribeck", "load", "torque limit", "back-EMF")


def drawn(rng: np.random.Generator, n: int, kind: str) -> Servos:
    """Servos between a toy's and an arm's."""

    def of(low: float, high: float, used: bool = True) -> tuple[float, ...]:
        found = np.exp(rng.uniform(np.log(low), np.log(high), n))
        return tuple(found.tolist()) if used else (0.0,) * n

    stiffness, coulomb = of(6.0, 25.0), of(0.03, 0.25)
    limited = kind in ("torque limit", "back-EMF")
    falls = tuple(f * x for f, x in zip(coulomb, of(0.5, 1.5, kind == "Stribeck"), strict=True))
    limits = of(0.5, 0.9)  # over a load of about 1 Nm, and over what fast motion asks for
    return Servos(
        stiffness,
        of(0.2, 0.9),
        coulomb,
        of(0.005, 0.04),
        torque_limit=tuple(0.12 * k * x + 0.5 for k, x in zip(stiffness, limits, strict=True))
        if limited
        else (1e3,) * n,
        delay=round(float(rng.uniform(0.0, 0.03)), 4),
        back_emf=of(0.05, 0.2, kind == "back-EMF"),
        stribeck=falls,
        stribeck_speed=of(0.1, 0.4),
        load_friction=of(0.08, 0.25, kind == "load"),
    )


def one(seed: int) -> tuple[str, dict[str, list[bool]], float, list[float]]:
    """Of one arm: its kind, which intervals hold, the error ratio, and errors of stiffness."""
    rng = np.random.default_rng(900 + seed)
    n, kind = ROBOTS[seed % len(ROBOTS)], KINDS[seed % len(KINDS)]
    servos, rate = drawn(rng, n, kind), float(rng.choice([50.0, 100.0, 200.0]))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "servos.urdf").write_text(URDFS[n])
        (folder / "servos.toml").write_text(ROBOT_FILE)
        for k, (what, seconds) in enumerate((("fit", 90.0), ("unseen", 30.0))):
            table = log(servos, seconds, 10 * seed + k, rate, jitter=0.05 / rate, step=STEP)
            pl.DataFrame(table).write_parquet(folder / f"{what}.parquet")
        found = steelyard.identify_actuators(
            folder / "servos.toml", folder / "fit.parquet", folder / "unseen.parquet", threads=1
        )
        values = ActuatorValues.of((1.0,) * n, **vars(servos))
        true = steelyard.validate_actuators(
            replace(found.model, values=values), folder / "unseen.parquet", threads=1
        )
    hold, joints = defaultdict(list), (*JOINTS[n], "all")
    told = {(p.name, p.joint): p.interval for p in found.parameters if p.interval is not None}
    for (name, joint), (low, high) in told.items():
        given = getattr(servos, name, 0.0)
        real = given[joints.index(joint)] if isinstance(given, tuple) else given
        if name == "damping" and ("back_emf", joint) not in told:  # they are one below the limit
            real += servos.back_emf[joints.index(joint)]
        if name in vars(servos) or name in ("offset", "zero"):
            hold[name].append(low <= real <= high)
    ratio = float(np.mean(found.validation[0].rms / true.validation[0].rms))
    sure = [p for p in found.parameters if p.name == "stiffness" and p.status == "identified"]
    off = [p.value / servos.stiffness[joints.index(p.joint)] - 1.0 for p in sure]
    print(seed, n, kind, f"{ratio:.3f}", dict(hold), off, file=sys.stderr, flush=True)
    return kind, dict(hold), ratio, off


def main(arms: int = ARMS) -> list[Claim]:
    """Coverage by parameter and kind, and errors."""
    with ProcessPoolExecutor(PROCESSES, mp_context=get_context("spawn")) as pool:
        found = list(pool.map(one, range(arms)))
    hold = defaultdict[str, list[bool]](list)
    kinds = defaultdict[str, list[bool]](list)
    for kind, by, _, _ in found:
        for name, some in by.items():
            hold[name] += some
            kinds[kind] += some
    every = [x for some in hold.values() for x in some]
    share, ratios = float(np.mean(every)), [ratio for _, _, ratio, _ in found]
    scatter = float(np.sqrt(0.95 * 0.05 / len(found)))
    listed, by_kind = (
        ", ".join(f"{name} {np.mean(x):.0%}" for name, x in some.items()) for some in (hold, kinds)
    )
    off = np.abs(np.concatenate([x for _, _, _, x in found]))
    return [
        Claim(
            f"95 % intervals of {arms} simulated arms hold the truth",
            f"{share:.1%} of {len(every)} ({listed}; {by_kind})",
            f"{COVERED[0]:.0%} to {COVERED[1]:.0%}, ± {scatter:.0%} for {arms} arms",
            COVERED[0] - scatter <= share <= COVERED[1] + scatter,
        ),
        Claim(
            "error of unseen motion over that of the true parameters",
            f"mean {np.mean(ratios):.3f}, worst {max(ratios):.3f}",
            f"mean <= {UNSEEN:g}",
            float(np.mean(ratios)) <= UNSEEN,
        ),
        Claim("stiffness, where identified", f"off by {off.mean():.2%} on average", "reported",
              True),
    ]  # fmt: skip


if __name__ == "__main__":
    main_of(lambda: main(*map(int, sys.argv[1:2])))
