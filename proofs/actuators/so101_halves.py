"""An SO-101 arm fitted to each half of its motions: the values agree within their intervals."""

import tempfile
from pathlib import Path

import numpy as np
from proofs.checks.two_faults import run
from proofs.support.claims import Claim, data_folder, main_of

import steelyard

AGREE = 0.95
"""Share of the parameters whose difference is within its 95 % interval."""


def main() -> list[Claim]:
    """The differences, in standard deviations of a difference."""
    data = data_folder() / "so101"
    model = data.parent.parent / "models" / "so101" / "so101_new_calib.urdf"
    every = sorted(data.glob("*.parquet"))
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "so101.toml"
        run("init", model, every[0], "-o", file)
        one, two = (steelyard.identify_actuators(file, every[k::2]).model for k in (0, 1))
    shared = [free for free in one.free if free in two.free]
    off = []
    for free in shared:
        place = [known.free.index(free) for known in (one, two)]
        variance = sum(known.covariance[k, k] for known, k in zip((one, two), place, strict=True))
        off.append(abs(free.at(one.values) - free.at(two.values)) / np.sqrt(variance))
    agree = float(np.mean(np.array(off) < 1.96))
    worst = sorted(zip(off, shared, strict=True), key=lambda x: -x[0])[:5]
    words = ", ".join(f"{x.name} of {one.joints[x.joint]} {z:.1f}" for z, x in worst)
    return [
        Claim(
            f"SO-101, two halves of {len(every)} motions, {len(shared)} parameters",
            f"{agree:.0%} agree; farthest: {words} std",
            f">= {AGREE:.0%}",
            agree >= AGREE,
        )
    ]


if __name__ == "__main__":
    main_of(main)
