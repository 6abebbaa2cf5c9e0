"""A payload under a cable's torque that no term describes: what the mass's 95 % interval covers.

Arms of `contact_rates` are simulated by Pinocchio; a cable that runs along the second or third
joint pulls with a fifth of its typical torque, as a function of its position. A model is identified
from four unloaded logs of 45 s, and one loaded log is weighed: with the model, and with an unloaded
log of the same day beside it.
"""

import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin
from proofs.support.claims import Claim, main_of
from proofs.uses.contact_rates import Arm

import steelyard
from steelyard.base.arrays import Array
from steelyard.logs.formats import write_table

CABLES: dict[str, Callable[[Array], Array]] = {
    "linear": lambda x: 0.4 * x,
    "saturating": lambda x: np.tanh(2.0 * x),
    "periodic": lambda x: np.sin(3.0 * x),
    "cubic": lambda x: 1.5 * (0.4 * x) ** 3,
}
"""Torque over its size, from the position [rad] off where the cable is slack."""
SIZE, SECONDS, DRAWS = 0.2, 45.0, 15
BAND = 0.90
"""Least share of the intervals that hold the mass: 1.8 standard deviations below 95 % of 60."""
LEVER, GYRATION = np.array([0.02, 0.01, 0.1]), 0.003


def draw(seed: int, cable: Callable[[Array], Array], folder: Path) -> list[bool | None]:
    """Whether the intervals by the model, and beside an unloaded log, hold the mass, if there."""
    arm, rng = Arm(seed), np.random.default_rng([seed, 3])
    joint, slack = int(rng.integers(1, min(3, arm.n))), rng.uniform(-1.5, 1.5)
    bodies = [pin.Inertia(one) for one in arm.model.inertias]
    mass = 0.3 * rng.uniform(0.15, 0.5) * sum(one.mass for one in bodies[1:])

    def log(name: str, number: int, carried: float) -> str:
        arm.model.inertias[arm.n] = bodies[arm.n]
        if carried:
            load = pin.Inertia(carried, LEVER, carried * GYRATION * np.eye(3))
            arm.model.inertias[arm.n] = bodies[arm.n] + load
        columns = arm.move(1000 * seed + number, SECONDS)
        pull = SIZE * 0.3 * arm.limit[joint] * cable(columns[f"q{joint + 1}"] - slack)
        columns[f"tau{joint + 1}"] = columns[f"tau{joint + 1}"] + pull
        write_table(folder / f"{name}.parquet", columns)
        return str(folder / f"{name}.parquet")

    (folder / "arm.urdf").write_text(arm.urdf)
    fitted = [log(f"fit{k}", k, 0.0) for k in range(4)]
    model = steelyard.identify(str(folder / "arm.urdf"), fitted, check=False).model
    unloaded, loaded = log("unloaded", 50, 0.0), log("loaded", 60, mass)
    found = (
        steelyard.identify_payload(model, [loaded]),
        steelyard.identify_payload(model, [loaded], unloaded=[unloaded]),
    )
    return [
        abs(one.mass - mass) <= float(one.half_width[0]) if np.isfinite(one.mass) else None
        for one in found
    ]


def main(draws: int = DRAWS) -> list[Claim]:
    """Coverage over all kinds of cables."""
    held: list[list[bool | None]] = []
    for number, (kind, cable) in enumerate(CABLES.items()):
        for seed in range(1 + number * draws, 1 + (number + 1) * draws):
            with tempfile.TemporaryDirectory() as folder:
                held.append(draw(seed, cable, Path(folder)))
            print(f"{kind} {seed}: {held[-1]}", file=sys.stderr, flush=True)
    claims = []
    for k, how in enumerate(("by the model", "beside an unloaded log")):
        known = [one[k] for one in held if one[k] is not None]
        share, name = float(np.mean(known)), f"payload under a cable's torque, {how}"
        told = f"{share:.1%} of {len(known)}, {len(held) - len(known)} not identifiable"
        claims.append(Claim(name, told, f">= {BAND:.0%}", share >= BAND))
    return claims


if __name__ == "__main__":
    main_of(main)
