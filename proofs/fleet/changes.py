"""A hundred robots over thirty days, three of them with a fault; and smaller fleets without any.

Dry friction of a joint doubles, a gain drops by 5 %, a plate of 1 kg is left on, each on day 12,
while temperature swings by 10 K. Fleets of eight robots over ten days, whose links are not those of
the URDF, show how often the intervals of the shared bodies hold the truth, and whether robots
without a fault are named.
`python -m proofs.fleet.changes ROBOTS DAYS FLEETS` takes other numbers.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np
from proofs.support import simulated_fleet as simulated
from proofs.support.claims import Claim, main_of

import steelyard
from steelyard.fleet.fleet_result_and_page import Fleet

ROBOTS, DAYS, FLEETS, DAY = 100, 30, 12, 12
FAULTS = {
    17: simulated.Fault(DAY, joint=2, friction=2.0),
    42: simulated.Fault(DAY, joint=3, gain=0.95),
    77: simulated.Fault(DAY, mass=1.0),
}
PLANTED = {
    17: ("dry friction", "panda_joint3", 1.0),
    42: ("effort scale", "panda_joint4", 1.0 / 0.95 - 1.0),
    77: ("payload", "", 1.0),
}
COVERED = (0.93, 0.97)


def found_in(fleet: simulated.Fleet) -> Fleet:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        simulated.write(fleet, folder)
        return steelyard.fleet(
            folder / "arm.toml", folder / "logs", temperature="temp", store=folder / "store"
        )


def held(found: Fleet) -> list[bool]:
    """Whether the 95 % interval of each shared parameter of bodies holds the truth."""
    truth, base = simulated.true_bodies(), found.model.base
    values = base.base_values([truth.get(name, 0.0) for name in base.names])
    true = dict(zip(base.base_names, values.tolist(), strict=True))
    estimate = found.model.estimate
    each = zip(estimate.parameters.as_dict().items(), estimate.half_width, strict=True)
    return [abs(x - true[name]) <= half for (name, x), half in each if name in truth]


def main(robots: int = ROBOTS, days: int = DAYS, fleets: int = FLEETS) -> list[Claim]:
    faults = {robot: fault for robot, fault in FAULTS.items() if robot < robots}
    found = found_in(simulated.Fleet(robots, days, faults))
    claims, mine = [], {change.robot: change for change in found.changes}
    for robot in faults:
        what, joint, size = PLANTED[robot]
        name = f"robot{robot:03d}"
        change, begins = mine.get(name), str(np.datetime64("2026-05-01") + DAY)
        right = change is not None and (change.cause.what, change.cause.joint) == (what, joint)
        told = "not named"
        if change is not None:
            day = abs(int((np.datetime64(change.day) - np.datetime64(begins)).astype(int)))
            value, half = float(change.size[0]), 1.96 * float(change.std[0])
            told = f"{change.cause.what} {change.cause.joint} {value:+.3f} ± {half:.3f} (truth "
            told += f"{size:.3f}), off by {day} days"
            right = right and day <= 1
        claims.append(Claim(f"{name}: {what} {joint}", told, "robot, cause, joint, day ± 1", right))
    others = sorted(set(mine) - {f"robot{robot:03d}" for robot in faults})
    extra = len(found.changes) - len(faults)
    claims.append(
        Claim(
            f"others of {robots} robots over {days} days with swings of 10 K",
            f"{len(others)} named, {extra} changes too many",
            "0",
            not others and extra == 0,
        )
    )
    share = float(np.mean(held(found)))
    claims.append(
        Claim(
            f"95 % intervals of shared bodies of the {robots} robots hold the truth",
            f"{share:.1%} of {len(held(found))}",
            f"{COVERED[0]:.0%} to {COVERED[1]:.0%}",
            COVERED[0] <= share <= COVERED[1],
        )
    )
    inside, named = list[bool](), 0
    for seed in range(1, fleets + 1):
        small = found_in(simulated.Fleet(8, 10, seed=seed))
        inside += held(small)
        named += len(small.changes)
        print(seed, np.mean(inside), named, file=sys.stderr, flush=True)
    if fleets:
        share = float(np.mean(inside))
        claims += [
            Claim(
                f"95 % intervals of shared bodies of {fleets} fleets hold the truth",
                f"{share:.1%} of {len(inside)}",
                f"{COVERED[0]:.0%} to {COVERED[1]:.0%}",
                COVERED[0] <= share <= COVERED[1],
            ),
            Claim(
                f"false changes in {fleets} fleets of 8 robots over 10 days",
                str(named),
                f"expected {10 * fleets / 365:.2f}, at most 2",
                named <= 2,
            ),
        ]
    return claims


if __name__ == "__main__":
    main_of(lambda: main(*map(int, sys.argv[1:4])))
