"""Base parameters behind slightly tilted axes are as many as the singular values say.

Arms with parallel, perpendicular and intersecting axes, each joint tilted by 1e-5 to 1e-2 rad or
not at all, as in calibrated model files: the number of base parameters is compared with the largest
gap of the singular values, the condition of the chosen columns with that of all of them.
`--draws N`
"""

import argparse
import sys
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from proofs.support.claims import Claim, main_of

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))

from steelyard.estimate.information.base_parameters_and_regressor import (
    full_regressor,  # noqa: E402
    independent_columns,  # noqa: E402
)
from steelyard.model.laws.laws_without_friction import (
    RigidBody,  # noqa: E402
    RotorInertia,  # noqa: E402
)
from steelyard.model.model import Model  # noqa: E402
from tilted import drawn, rank_by_gap, singular_values  # noqa: E402

DRAWS, PROCESSES = 2000, 2


def compared(seed: int) -> tuple[int, int, float]:
    """Columns chosen, rank, and how much smaller the least singular value of the choice is."""
    regressor = full_regressor(Model(drawn(seed), (RigidBody(), RotorInertia())), seed)
    columns, rank = independent_columns(regressor), rank_by_gap(regressor)
    whole = singular_values(regressor)[rank - 1]
    chosen = singular_values(regressor[:, columns])[-1]
    return len(columns), rank, float(whole / chosen)


def main(draws: int = DRAWS) -> list[Claim]:
    """All draws, on two processes."""
    with get_context("spawn").Pool(PROCESSES) as pool:
        found = pool.map(compared, range(draws), chunksize=20)
    wrong = [seed for seed, (count, rank, _) in enumerate(found) if count != rank]
    ratios = [ratio for _, _, ratio in found]
    return [
        Claim(
            f"base parameters of {draws} arms with tilted axes against singular values",
            f"{len(wrong)} differ" + (f": {wrong[:5]}" if wrong else ""),
            "none",
            not wrong,
        ),
        Claim(
            "least singular value of all columns over that of the chosen ones",
            f"median {np.median(ratios):.2f}, greatest {max(ratios):.1f}",
            "<= 30",
            max(ratios) <= 30.0,
        ),
    ]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=DRAWS)
    chosen = parser.parse_args()
    main_of(lambda: main(chosen.draws))
