"""Left and right limbs: pairs by kinematics, both sides of one robot, and symmetry as a prior.

An A1 whose legs mirror each other walks, with bodies other than the model file's. Both sides of an
estimate without symmetry must agree; with it, both are the same, and predict another gait as well.
Legs that differ by 15 % in mass must not pass as mirror images.
"""

import tempfile
from pathlib import Path

import numpy as np
from proofs.support.claims import Claim, data_folder, main_of
from proofs.support.legged_trials import (
    covered,
    errors_unseen,
    identified,
    trial,
)

import steelyard
from steelyard.estimate.prior.mirrored_limbs import Sides, compared_sides, mirrored_links

ROBOTS = {
    "unitree_a1/a1.xml": 6,
    "unitree_g1/g1.xml": 13,
    "pal_talos/talos.xml": 20,
}
"""Model files, and pairs of links that are mirror images."""

TROTS = 0.0, 2.0, 3.0  # frequencies of the gaits; the last one is not fitted [Hz]
VARIATION = 5.0  # greatest coefficient of variation of a parameter that is known [%]
COVERED = 93.0  # share of the 95 % intervals that hold the truth, at least [%]


def sides_of(found: steelyard.Identification) -> list[Sides]:
    """Parameters that both sides show."""
    model = found.model
    every = compared_sides(model.base, model.robot, model.estimate, "xz")
    return [one for one in every if one.sure]


def main() -> list[Claim]:
    """Pairs of three robots, then the robot that walks."""
    claims, models = list[Claim](), data_folder().parent / "models" / "menagerie"
    for file, count in ROBOTS.items():
        robot = steelyard.load_robot(models / file, base="floating").robot
        pairs = [pair for pair in mirrored_links(robot, "xz") if pair.one < pair.other]
        claims.append(
            Claim(f"{robot.name}: pairs", f"{len(pairs)}", f"{count}", len(pairs) == count)
        )
    with tempfile.TemporaryDirectory() as place:
        alike = trial("A1", Path(place), TROTS, mirrored=True)
        free = identified(alike, "least_squares")
        sides = sides_of(free)
        worst = max(sides, key=lambda one: one.variation)
        value = f"{100.0 * worst.variation:.2f} % ({worst.name})"
        claims.append(
            Claim(
                f"A1: largest coefficient of variation, of {len(sides)} parameters",
                value,
                f"<= {VARIATION:g} %",
                len(sides) >= 20 and 100.0 * worst.variation <= VARIATION,
            )
        )
        agree = np.mean([abs(one.value - one.image) <= one.half_width for one in sides])
        claims.append(
            Claim(
                "both sides agree within 95 % intervals",
                f"{100.0 * agree:.0f} %",
                ">= 90 %",
                agree >= 0.9,
            )
        )
        file = alike.file.with_name("prior.toml")
        file.write_text(alike.file.read_text() + '[prior]\nsymmetry = "xz"\n')
        same = identified(alike, "consistent", file)
        links = [one for one in sides_of(same) if not one.name.startswith(("coulomb", "viscous"))]
        apart, what = max(one.variation for one in links), "symmetry as prior: both sides differ by"
        claims.append(Claim(what, f"{apart:.1g}", "<= 1e-6", apart <= 1e-6))
        error, best = errors_unseen(alike, same, file)
        claims.append(
            Claim("error, unseen", f"{error:.4f} Nm", f"<= 1.05 x {best:.4f}", error <= 1.05 * best)
        )
        share = 100.0 * float(np.mean(covered(alike, same)))
        claims.append(
            Claim("within 95 % intervals", f"{share:.0f} %", f">= {COVERED:g} %", share >= COVERED)
        )
        other = sides_of(identified(trial("A1", Path(place), TROTS), "least_squares"))
        other = [one for one in other if one.name.startswith(("m", "I"))]  # of links
        odd = np.mean([abs(one.value - one.image) <= one.half_width for one in other])
        claims.append(
            Claim(
                f"legs that differ by 15 %: agree within intervals, of {len(other)} of links",
                f"{100.0 * odd:.0f} %",
                "<= 30 %",
                odd <= 0.3,
            )
        )
    return claims


if __name__ == "__main__":
    main_of(main)
