"""A quadruped that walks, many draws of its bodies and of all noise: intervals, errors, masses.

Each draw has other bodies (15 % in mass, 1 cm in their centres), other motions and other noise.
`python -m proofs.robots.walking_draws 10` makes fewer draws.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np
from proofs.support.claims import Claim, main_of
from proofs.support.legged_trials import (
    WORSE,
    covered,
    errors_unseen,
    identified,
    total_mass,
    trial,
)

DRAWS = 30
TROTS = 0.0, 2.0, 3.0  # frequencies of the gaits; zero: sways; the last one is not fitted [Hz]
COVERED = 93.0, 97.0  # share of the 95 % intervals that hold the truth [%]
LOAD, OFF = 2.0, 0.2  # planted on the back, and how far it may be off [kg]


def main(draws: int = DRAWS) -> list[Claim]:
    """All draws of one robot."""
    inside, ratios, loads = list[bool](), list[float](), list[float]()
    held = 0
    with tempfile.TemporaryDirectory() as place:
        for draw in range(1, draws + 1):
            walking = trial("A1", Path(place), TROTS, draw=draw)
            found = identified(walking, "least_squares")
            mass, half = total_mass(found)
            held += abs(mass - float(walking.simulation.model.body_mass.sum())) <= half
            own = covered(walking, found)
            inside += own
            error, best = errors_unseen(walking, found)
            ratios.append(error / best)
            carrying = trial("A1", Path(place), TROTS, LOAD, draw)
            loads.append(total_mass(identified(carrying, "least_squares"))[0] - mass)
            print(
                f"draw {draw}: {100.0 * np.mean(own):.1f} % covered, error x {ratios[-1]:.3f}, "
                f"mass {mass:.4f} ± {half:.4f} kg, {loads[-1]:.3f} kg more",
                flush=True,
            )
    share, worst = 100.0 * float(np.mean(inside)), max(ratios)
    low, high = COVERED
    least = draws - 1 - draws // 10  # of intervals of 95 %, one in 20 may miss
    far = max(abs(load - LOAD) for load in loads)
    return [
        Claim(
            f"A1 walks, {draws} draws: within 95 % intervals, of {len(inside)}",
            f"{share:.1f} %",
            f"{low:g} to {high:g} %",
            low <= share <= high,
        ),
        Claim(
            "error on an unseen gait over that of the true values, at most",
            f"{worst:.3f}",
            f"<= {WORSE:g}",
            worst <= WORSE,
        ),
        Claim("total mass in its interval", f"{held} of {draws}", f">= {least}", held >= least),
        Claim(
            "2 kg more on its back, at most off by", f"{far:.3f} kg", f"<= {OFF:g} kg", far <= OFF
        ),
    ]


if __name__ == "__main__":
    main_of(lambda: main(*map(int, sys.argv[1:2])))
