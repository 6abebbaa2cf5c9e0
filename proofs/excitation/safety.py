"""Safety: designs on random robots and limits, judged on a grid a hundred times finer.

Robots, limits and walls are drawn; each motion is found by one short search, scaled and certified.
Its file is evaluated anew, and judged by Pinocchio (places, torques) and coal (distances). Some
motions and limits are then spoilt: their certificates may not hold. Last, the Panda with and
without clearance of its own bodies.

Distances are taken at 1 500 times, and finer about each least one. All arms are serial, from URDF.
"""

import json
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from proofs.support.claims import Claim, data_folder, main_of
from proofs.support.safety_cases import Case, random_case, tightened
from proofs.support.safety_judge import Margin, Rules
from proofs.support.safety_panda import panda_claims

from steelyard.base.errors import SteelyardError
from steelyard.excite.collision.workspace_from_tables import WALLS_NAME
from steelyard.excite.constraints.certificate import Certificate, Proof, certify
from steelyard.excite.design_problem_and_information import Earlier, Problem
from steelyard.excite.design_problem_from_tables import build
from steelyard.excite.search.feasibility import refuse_impossible
from steelyard.excite.search.repair_until_proven import finished
from steelyard.excite.search.search_methods import search_by_gradient, seeded
from steelyard.excite.trajectories.exact_trajectories import ExactTrajectory
from steelyard.model.model import model_with_open_friction
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.inertia_and_placement import INERTIAL_NAMES

DESIGNS = 200
SPOILT = 50
SCREENED = 8
ROUNDING = 1e-9
"""Of a limit's half range: what counts as beyond it, or as proven above a sample."""

SOLVER = 2e-6
"""Tolerance of coal's distances [m]."""


@dataclass
class Tally:
    """What was found.

    Attributes:
        designs: Motions that were judged.
        refused: Words of those that were not made.
        violations: Margins that a sample misses, in words.
        uncertified: Motions whose certificate does not hold.
        wrong: Certificates that hold though a sample misses a margin.
        proofs: Proven margins that were compared with samples.
        above: Proven margins above a sample, in words.
        spoilt: Spoilt motions or limits that miss a margin.
        fooled: Certificates of such that hold.
        nearest: Per design how near it goes to a limit or wall, in units of that.
        kinds: Constraints that were kept, with how many designs.
        seconds: Of all searches, ends and certificates.
    """

    designs: int = 0
    refused: list[str] = field(default_factory=list)
    violations: list[str] = field(default_factory=list)
    uncertified: int = 0
    wrong: int = 0
    proofs: int = 0
    above: list[str] = field(default_factory=list)
    spoilt: int = 0
    fooled: int = 0
    nearest: list[float] = field(default_factory=list)
    kinds: dict[str, int] = field(default_factory=dict)
    seconds: float = 0.0


def problem_of(case: Case) -> Problem:
    """From the robot file; friction and masses as an earlier log would know them."""
    loaded = load_robot(case.file)
    earlier = None
    if case.standard is not None:
        standard = {
            f"{name}.{body.name}": float(value)
            for body in loaded.robot.bodies
            for name, value in zip(INERTIAL_NAMES, body.inertia.ten, strict=True)
        }
        noise = np.ones(loaded.robot.n)
        known = standard | case.standard
        earlier = Earlier(noise, 5.0, (), np.zeros(0), np.zeros((0, 0)), known)
    problem = build(loaded, model_with_open_friction(loaded), earlier)
    refuse_impossible(problem, loaded)
    return problem


def judged(
    tally: Tally, name: str, case: Case, rules: Rules, problem: Problem, motion: ExactTrajectory
) -> tuple[bool, bool]:
    """Whether the certificate holds, and whether every sample keeps every margin."""
    certificate = certify(problem.robot, motion, problem.limits, problem.constraints)
    stored = json.loads(json.dumps(motion.to_dict()))
    seen = case.judge.margins(rules, stored, max(20_000, 100 * len(problem.inequalities.t)))
    every = [(k, m, SOLVER if k == "clearance" else ROUNDING * m.size) for k, m in flat(seen)]
    missed = [f"{name}: {k} {m.value:.3g}" for k, m, loose in every if m.value < -loose]
    check_proofs(tally, name, certificate, seen, problem.notes)
    if not name.startswith("spoilt"):
        tally.violations += missed
        tally.nearest.append(min(m.value / m.size for _, m, _ in every))
        for proof in certificate.proofs:
            tally.kinds[proof.name] = tally.kinds.get(proof.name, 0) + 1
    return certificate.holds, not missed


def flat(seen: dict[str, Any]) -> list[tuple[str, Margin]]:
    """All margins with their constraint's name."""
    groups = (
        (k, group.values() if isinstance(group, dict) else group) for k, group in seen.items()
    )
    return [(k, margin) for k, group in groups for margin in group]


def check_proofs(
    tally: Tally, name: str, certificate: Certificate, seen: dict[str, Any], notes: tuple[str, ...]
) -> None:
    """Every proven margin is below the least sample, and there is one for every rule."""
    proofs = {proof.name: proof for proof in certificate.proofs}
    proofs.pop(WALLS_NAME, None)  # what the tool and loads keep from the cell is judged in cells.py
    if set(proofs) | {"limits"} != set(seen):
        tally.above.append(f"{name}: {sorted(proofs)} proven, {sorted(seen)} judged")
        return
    pairs = of_extremes(certificate, seen["limits"])
    for key, proof in proofs.items():
        if isinstance(seen[key], dict):
            pairs += of_pairs(proof, seen[key], notes)
        else:
            pairs += zip(proof.labels, proof.proven, seen[key], strict=True)
    for label, proven, margin in pairs:
        loose = SOLVER if label.startswith("distance") else ROUNDING * margin.size
        tally.proofs += 1
        if not proven <= margin.value + loose:
            tally.above.append(f"{name}: {label}: proven {proven:.6g}, seen {margin.value:.6g}")


def of_extremes(certificate: Certificate, seen: list[Margin]) -> list[tuple[str, float, Margin]]:
    """Margins of the joints' limits by the certificate, beside those of samples."""
    order = ("position", "velocity", "acceleration", "jerk")
    found = []
    joints = len(certificate.extremes) // len(order)
    for k, extreme in enumerate(certificate.extremes):
        if extreme.lower is None or extreme.upper is None:
            continue
        joint, number = divmod(k, len(order))
        label = f"{extreme.quantity} of '{extreme.joint}'"
        below, above = extreme.least - extreme.lower, extreme.upper - extreme.greatest
        if number == 0:
            found.append((label, below, seen[joint]))
            found.append((label, above, seen[joints + joint]))
        else:
            found.append((label, min(below, above), seen[(number + 1) * joints + joint]))
    return found


def of_pairs(
    proof: Proof, seen: dict[frozenset[str], Margin], notes: tuple[str, ...]
) -> list[tuple[str, float, Margin]]:
    """Clearances by the certificate; pairs that it does not speak of are named in the notes."""
    proven = {frozenset(label.split("'")[1::2]): k for k, label in enumerate(proof.labels)}
    left = [line for line in notes if "overlap in every tested posture" in line or "never" in line]
    declined = {frozenset(pair.split(" and ")) for line in left for pair in listed(line)}
    for pair in set(seen) - set(proven) - declined:
        seen[pair] = Margin(-np.inf, 1.0)
    for pair in declined & set(seen):
        del seen[pair]
    return [(proof.labels[k], proof.proven[k], seen[p]) for p, k in proven.items() if p in seen]


def listed(line: str) -> list[str]:
    """Pairs that a note lists behind its colon."""
    return line.split(": ", 1)[1].split(", ")


def design(tally: Tally, seed: int, folder: Path) -> None:
    """One case from its robot file to its verdict, and perhaps spoilt."""
    case = random_case(seed, folder)
    begun = time.process_time()
    try:
        problem = problem_of(case)
        x = search_by_gradient(problem, seeded(0, seed), lambda x: None, SCREENED)
        best = finished(problem, [x], time.monotonic())
    except SteelyardError as error:
        tally.refused.append(f"{seed} ({case.kind}): {error.wrong}")
        return
    tally.seconds += time.process_time() - begun
    tally.designs += 1
    name = f"{seed} ({case.kind})"
    holds, kept = judged(tally, name, case, case.rules, problem, best.trajectory)
    tally.uncertified += not holds
    tally.wrong += holds and not kept
    if tally.designs % (DESIGNS // SPOILT) == 0:
        spoil(tally, name, case, problem, best.x)


def spoil(tally: Tally, name: str, case: Case, problem: Problem, x: np.ndarray) -> None:
    """The motion 1.3 times as large, or the limits a little narrower."""
    motion, rules = problem.basis.motion(x), case.rules
    if tally.designs % (2 * DESIGNS // SPOILT) == 0:
        still = problem.basis.still(motion.derivative([0.0], 0)[0])
        motion = problem.basis.motion(still + 1.3 * (x - still))
    else:
        case, rules = tightened(case, 0.97)
        problem = problem_of(case)
    holds, kept = judged(tally, f"spoilt {name}", case, rules, problem, motion)
    tally.spoilt += not kept
    tally.fooled += holds and not kept


def claims_of(tally: Tally) -> list[Claim]:
    """What the tally says."""
    for word in ("refused", "violations", "above"):
        for line in getattr(tally, word):
            print(f"{word}: {line}", file=sys.stderr)
    attempts = tally.designs + len(tally.refused)
    share = len(tally.refused) / attempts
    near = np.array(tally.nearest)
    kinds = ", ".join(f"{name} {count}" for name, count in sorted(tally.kinds.items()))
    return [
        Claim(
            f"{tally.designs} designs of serial arms, margins missed on a 100 times finer grid",
            f"{len(tally.violations)}",
            "0",
            not tally.violations and tally.designs == DESIGNS,
        ),
        Claim("their certificates that are wrong", f"{tally.wrong}", "0", not tally.wrong),
        Claim("designs not certified", f"{tally.uncertified}", "0", not tally.uncertified),
        Claim(
            f"{tally.proofs} proven margins, above a sample's",
            f"{len(tally.above)}",
            "0",
            not tally.above,
        ),
        Claim(
            f"{tally.spoilt} spoilt motions and limits, certificates fooled",
            f"{tally.fooled}",
            f"0 of {SPOILT - 5} or more",
            not tally.fooled and tally.spoilt >= SPOILT - 5,
        ),
        Claim(
            f"refused in words, of {attempts}",
            f"{len(tally.refused)} ({share:.1%})",
            "<= 4 %",
            share <= 0.04,
        ),
        Claim(
            "nearest to a limit, in its own size: median, most",
            f"{np.median(near):.1e}, {near.max():.1e}",
            "median <= 1e-3",
            bool(np.median(near) <= 1e-3),
        ),
        Claim("designs with", kinds, "reported", True),
        Claim(
            "a design", f"{tally.seconds / max(tally.designs, 1):.2f} s of cpu", "reported", True
        ),
    ]


def random_claims() -> list[Claim]:
    """Designs until there are enough of them."""
    tally, seed = Tally(), 0
    while tally.designs < DESIGNS and seed < 1.2 * DESIGNS:
        with tempfile.TemporaryDirectory() as place:
            design(tally, seed, Path(place))
        seed += 1
    return claims_of(tally)


def main() -> list[Claim]:
    """Random robots, then the Panda."""
    data_folder()
    return [*random_claims(), *panda_claims()]


if __name__ == "__main__":
    main_of(main)
