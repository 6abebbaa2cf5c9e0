"""Legged robots from simulated logs: whole bodies with a floating base, by all kinds of contacts.

An A1 sways on its feet and trots, and is predicted in another gait. It is fitted with the wrenches
of its feet, with nothing but which feet touch, and hung on a hoist of unknown force; values must
agree. A G1 hangs on a hoist whose force is measured, or is not. Bodies are not those of the model
file, by 15 % in mass and 1 cm in their centres.
"""

import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from proofs.support.claims import Claim, main_of
from proofs.support.legged_trials import (
    claims_of,
    identified,
    intervals,
    pooled,
    total_mass,
    trial,
)

LEAST = 93.0  # share of intervals that hold the truth, at least [%]
LOAD, OFF = 2.0, 0.2  # planted on the back, and how far it may be off [kg]


def agreement(
    what: str, one: Mapping[str, tuple[float, float]], other: Mapping[str, tuple[float, float]]
) -> Claim:
    """How many of the parameters that two models have differ by no more than their intervals."""
    both = [name for name in one if name in other]
    apart = [abs(one[x][0] - other[x][0]) <= np.hypot(one[x][1], other[x][1]) for x in both]
    share = 100.0 * float(np.mean(apart))
    name = f"{what}: agree within intervals, of {len(both)}"
    return Claim(name, f"{share:.0f} %", f">= {LEAST:g} %", share >= LEAST)


def of_a1(folder: Path) -> list[Claim]:
    """The quadruped with all kinds of contacts, and with a load."""
    claims, walking = list[Claim](), trial("A1", folder, [0.0, 2.0, 3.0])
    measured = identified(walking, "least_squares")
    claims += claims_of("A1, wrenches of the feet", walking, measured, LEAST)
    consistent = identified(walking, "consistent")
    claims += claims_of("the same, consistent", walking, consistent, LEAST)
    flags = identified(walking, "least_squares", walking.flags)
    claims += claims_of("A1, only which feet touch", walking, flags, LEAST, walking.flags)
    hung = trial("A1 on a hoist", folder, [0.0, 0.0, 0.0])
    text = hung.file.read_text()
    hung.file.write_text(text[: text.index("[[signals.base")] + 'wrench = "unknown"\n')
    free = intervals(identified(hung, "least_squares").model)
    a, b = intervals(measured.model), intervals(flags.model)
    claims.append(agreement("wrenches and flags", a, b))
    claims.append(agreement("wrenches and no contact", a, free))
    claims.append(agreement("flags and no contact", b, free))
    carrying = trial("A1", folder, [0.0, 2.0, 3.0], LOAD)
    for name, file, plain in (
        ("wrenches", carrying.file, measured),
        ("flags", carrying.flags, flags),
    ):
        more = total_mass(identified(carrying, "least_squares", file))[0] - total_mass(plain)[0]
        bound = f"{LOAD:g} ± {OFF:g} kg"
        what = f"A1, more on its back, {name}"
        claims.append(Claim(what, f"{more:.3f} kg", bound, abs(more - LOAD) <= OFF))
    return claims


def of_g1(folder: Path) -> list[Claim]:
    """The humanoid on a hoist, its force measured and not."""
    hung = trial("G1", folder, [0.0, 0.0, 0.0, 0.0])  # 45 s for 329 parameters
    claims = list(claims_of("G1 on a hoist", hung, identified(hung, "least_squares"), LEAST))
    text = hung.file.read_text()
    hung.file.write_text(text[: text.index("[[signals.base")] + 'wrench = "unknown"\n')
    alone = identified(hung, "least_squares")
    seen = "m.pelvis" in alone.model.estimate.parameters.names
    error = pooled(alone.content.scores[0])
    name = "G1, force of the hoist unknown: base mass, error on the unseen log"
    value = f"{'seen' if seen else 'not seen'}, {error:.3f} Nm"
    return [*claims, Claim(name, value, "not seen", not seen)]


def main() -> list[Claim]:
    """Both robots."""
    with tempfile.TemporaryDirectory() as place:
        return [*of_a1(Path(place)), *of_g1(Path(place))]


if __name__ == "__main__":
    main_of(main)
