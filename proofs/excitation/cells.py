"""Cells: floors, planes and boxes for all links, tool and loads, judged on a finer grid.

Robots, walls and loads are drawn: serial arms with revolute, prismatic, following and locked
joints, with shapes on all links, most or none. Each motion is found by one short search, finished
and certified. Its file is evaluated anew a hundred times finer than the search looks at it, and
judged by Pinocchio and coal; so are the files for controllers, as these interpolate them: a table
in straight lines, a ROS 2 trajectory by splines of degree five, URScript by its set points. Some
motions are then made larger: their certificates may not hold. The headline may claim every limit
only where every thing that moves is judged against every wall.
"""

import json
import multiprocessing
import os
import re
import sys
import tempfile
import time
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from proofs.support.cell_cases import Cell, random_cell
from proofs.support.claims import Claim, main_of
from proofs.support.safety_motion import derivative, fine_times

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))
from excite.interpreters import Follower, URController
from steelyard.base.errors import SteelyardError
from steelyard.excite.constraints.certificate import Certificate, certify
from steelyard.excite.controller_file_formats import exported
from steelyard.excite.design_problem_and_information import Problem
from steelyard.excite.design_problem_from_tables import build
from steelyard.excite.page.design_text import design_headline, design_level
from steelyard.excite.search.feasibility import refuse_impossible
from steelyard.excite.search.repair_until_proven import finished
from steelyard.excite.search.search_methods import search_by_gradient, seeded
from steelyard.excite.trajectories.exact_trajectories import ExactTrajectory
from steelyard.model.model import model_with_open_friction
from steelyard.robot.file.robot_file import load_robot

CELLS = 200
DRAWN = 230
SCREENED = 4
TABLE_RATE, SERVO_RATE = 500.0, 500.0
LARGER = 1.4
SOLVER = 2e-6
"""Tolerance of coal's distances [m]."""


@dataclass
class Found:
    """What one cell or all of them gave.

    Attributes:
        designs: Motions that were judged.
        refused: Words of those that were not made.
        violations: Constraints that a sample passes, in words.
        files: Files of controllers that were judged.
        samples: Postures that were judged.
        fooled: Enlarged motions that pass a wall though their certificate holds.
        spoilt: Enlarged motions that pass a wall.
        uncovered: Headlines that claim what is not covered.
        above: Proven margins above a sample's, in words.
        whole: Motions whose headline claims every limit.
        nearest: Least distances from any wall [m].
        kinds: Walls and joints that occurred.
    """

    designs: int = 0
    refused: list[str] = field(default_factory=list)
    violations: list[str] = field(default_factory=list)
    files: int = 0
    samples: int = 0
    fooled: int = 0
    spoilt: int = 0
    uncovered: list[str] = field(default_factory=list)
    above: list[str] = field(default_factory=list)
    whole: int = 0
    nearest: list[float] = field(default_factory=list)
    kinds: list[str] = field(default_factory=list)


def cell_found(seed: int) -> Found:
    """One cell from its robot file to its verdict."""
    found = Found()
    with tempfile.TemporaryDirectory() as place:
        cell = random_cell(seed, Path(place))
        try:
            loaded = load_robot(cell.file)
            problem = build(loaded, model_with_open_friction(loaded))
            refuse_impossible(problem, loaded)
            x = search_by_gradient(problem, seeded(0, seed), lambda x: None, SCREENED)
            best = finished(problem, [x], time.monotonic())
        except SteelyardError as error:
            found.refused.append(f"{seed} ({cell.kind}): {error.wrong}")
            return found
        found.designs = 1
        cell = with_radii(cell, problem.notes)
        name = f"{seed} ({cell.kind})"
        certificate = certified(problem, best.trajectory)
        check_headline(found, name, cell, certificate, problem.notes)
        seen = motion_seen(found, name, cell, best.trajectory, problem)
        check_proofs(found, name, cell, certificate, seen)
        judge_files(found, name, cell, best.trajectory, problem)
        spoil(found, cell, problem, best.x)
    return found


def with_radii(cell: Cell, notes: tuple[str, ...]) -> Cell:
    """The cell with the radii that the notes state for links without shapes."""
    text = " ".join(note for note in notes if "assumed capsules" in note)
    assumed = {
        name: 1e-3 * float(mm) for name, mm in re.findall(r"(link\d+) \(([\d.e+]+) mm\)", text)
    }
    radii = {name: 0.995 * assumed.get(name, 0.0) for name in cell.bare if name in assumed}
    return replace(cell, judge=replace(cell.judge, radii=radii))


def certified(problem: Problem, motion: ExactTrajectory) -> Certificate:
    """The certificate of a motion in a cell."""
    return certify(problem.robot, motion, problem.limits, problem.constraints, notes=problem.notes)


def check_headline(
    found: Found, name: str, cell: Cell, certificate: Certificate, notes: tuple[str, ...]
) -> None:
    """Every limit is claimed only of what is judged, and all that is judged is proven or named."""
    shown = SimpleNamespace(std=lambda prior: np.ones(1), gram=np.eye(1), names=("mass",))
    designed = SimpleNamespace(
        certificate=certificate,
        shown=shown,
        prior=None,
        kind=cell.kind,
        searches=1,
        faint=0,
        absent=(),
        chosen_parameters=(0,),
        gram=np.eye(1),
    )
    words, grade = design_headline(designed), design_level(designed)
    labels = [label for proof in certificate.proofs for label in proof.labels]
    proven = {tuple(label.split("'")[1::2]) for label in labels}
    missing = sorted({pair for pair in cell.judge.pairs if pair not in proven})
    left = " ".join(note for note in notes if "left out" in note)
    unnamed = [pair for pair in missing if not all(word in left for word in pair)]
    found.uncovered += [f"{name}: no note on {a} and {b}" for a, b in unnamed]
    inside = any("outside the workspace limits" in note for note in certificate.gaps)
    if grade == "good" and (cell.bare or inside):
        found.uncovered.append(f"{name}: green, though links have no shape or stay in a wall")
    if "every limit is proven" in words:
        found.whole += 1
        if cell.bare or not cell.every or missing:
            found.uncovered.append(f"{name}: claims every limit, though not all is looked at")
    if "is proven to hold at all times" not in words or not certificate.holds:
        found.uncovered.append(f"{name}: {words}")


def motion_seen(
    found: Found, name: str, cell: Cell, motion: ExactTrajectory, problem: Problem
) -> np.ndarray:
    """Least distances of all pairs along the motion's own file."""
    stored = json.loads(json.dumps(motion.to_dict()))
    t = fine_times(stored, 100 * len(problem.inequalities.t))
    return judged(found, f"{name}, motion", cell, derivative(stored, t, 0))


def judged(found: Found, name: str, cell: Cell, q: np.ndarray) -> np.ndarray:
    """Least distances of all pairs at postures; those below zero are violations."""
    least = cell.judge.distances(q).min(axis=0)
    found.samples += len(q)
    found.violations += [
        f"{name}: {a} in {b} by {-d:.3g} m"
        for (a, b), d in zip(cell.judge.pairs, least, strict=True)
        if d < -SOLVER and not constant(cell, (a, b))
    ]
    return least


def constant(cell: Cell, pair: tuple[str, str]) -> bool:
    """Whether no joint changes a distance; such pairs are named, see `check_headline`."""
    random = np.random.default_rng(1)
    q = np.array([cell.judge.within(random.uniform(0.0, 1.0, cell.judge.n)) for _ in range(5)])
    columns = [k for k, own in enumerate(cell.judge.pairs) if own == pair]
    return bool(np.ptp(cell.judge.distances(q)[:, columns], axis=0).max() < 1e-9)


def check_proofs(
    found: Found, name: str, cell: Cell, certificate: Certificate, seen: np.ndarray
) -> None:
    """Every proven margin is below the least sample."""
    least: dict[tuple[str, str], float] = {}
    for pair, d in zip(cell.judge.pairs, seen, strict=True):
        least[pair] = min(least.get(pair, np.inf), float(d))
    for proof in certificate.proofs:
        for label, own in zip(proof.labels, proof.proven, strict=True):
            pair = tuple(label.split("'")[1::2])
            if pair in least and own > least[pair] + SOLVER:
                found.above.append(f"{name}: {label}: proven {own:.6g}, seen {least[pair]:.6g}")
    found.nearest.append(min(least.values()))
    found.kinds += [wall.name.split()[0] for wall in cell.judge.walls]
    following = cell.judge.following
    found.kinds += ["following joint"] * (following.mimic is not None)
    found.kinds += ["locked joint"] * bool(following.locked) + ["no shapes"] * bool(cell.bare)
    found.kinds += ["loads"] * any("load" in name for name, *_ in cell.judge.balls)


def judge_files(
    found: Found, name: str, cell: Cell, motion: ExactTrajectory, problem: Problem
) -> None:
    """Files for controllers, as these interpolate them."""
    robot, t = problem.robot, np.linspace(0.0, motion.duration, 4000)
    table = np.genfromtxt(exported(motion, robot, "csv", TABLE_RATE).splitlines(), delimiter=",")
    rows = table[1:]
    middle = 0.5 * (rows[:-1, 1 : robot.n + 1] + rows[1:, 1 : robot.n + 1])
    judged(found, f"{name}, table", cell, middle)
    follower = Follower(exported(motion, robot, "ros2"))
    judged(found, f"{name}, ROS 2", cell, follower.at(t + follower.start))
    found.files += 2
    if cell.six:
        away = motion.derivative([0.0], 0)[0] + 0.5
        script = exported(motion, robot, "urscript", SERVO_RATE)
        points = URController(script, away, 1.0 / SERVO_RATE).set_points
        judged(found, f"{name}, URScript", cell, np.array([q for _, q in points]))
        found.files += 1


def spoil(found: Found, cell: Cell, problem: Problem, x: np.ndarray) -> None:
    """A larger motion: where it passes a wall, its certificate may not hold."""
    still = problem.basis.still(problem.basis.motion(x).derivative([0.0], 0)[0])
    motion = problem.basis.motion(still + LARGER * (x - still))
    q = motion.derivative(np.linspace(0.0, motion.duration, 4000), 0)
    pairs = cell.judge.pairs
    least = cell.judge.distances(q).min(axis=0)
    passed = [p for p, d in zip(pairs, least, strict=True) if d < -1e-4 and not constant(cell, p)]
    if passed:
        found.spoilt += 1
        inequalities = [
            proof for proof in certified(problem, motion).proofs if "all" in proof.scope
        ]
        found.fooled += all(own >= 0.0 for proof in inequalities for own in proof.proven)


def all_found(seeds: range) -> Found:
    """All cells, on two processes."""
    total = Found()
    context = multiprocessing.get_context("spawn")
    with context.Pool(min(2, os.cpu_count() or 1)) as pool:
        for one in pool.imap_unordered(cell_found, seeds):
            for key, value in vars(one).items():
                setattr(total, key, getattr(total, key) + value)
    return total


def main(drawn: int = DRAWN) -> list[Claim]:
    """What holds over all cells."""
    begun = time.monotonic()
    found = all_found(range(drawn))
    for word in ("refused", "violations", "above", "uncovered"):
        for line in getattr(found, word):
            print(f"{word}: {line}", file=sys.stderr)
    share = len(found.refused) / (found.designs + len(found.refused))
    near = np.array(found.nearest)
    kinds = {kind: found.kinds.count(kind) for kind in sorted(set(found.kinds))}
    return [
        Claim(
            f"{found.designs} cells and {found.files} files for controllers, walls passed at "
            f"{found.samples} postures",
            f"{len(found.violations)}",
            "0",
            not found.violations and found.designs >= CELLS,
        ),
        Claim("proven margins above a sample's", f"{len(found.above)}", "0", not found.above),
        Claim(
            "headlines and certificates that claim what is not covered",
            f"{len(found.uncovered)}",
            "0",
            not found.uncovered,
        ),
        Claim(
            f"{found.spoilt} enlarged motions that pass a wall, certificates fooled",
            f"{found.fooled}",
            "0 of 50 or more",
            not found.fooled and found.spoilt >= 50,
        ),
        Claim("headlines that claim every limit", f"{found.whole}", "reported", True),
        Claim("refused in words", f"{len(found.refused)} ({share:.1%})", "<= 12 %", share <= 0.12),
        Claim(
            "nearest to a wall: median",
            f"{1e3 * float(np.median(near)):.2f} mm",
            "<= 20 mm",
            bool(np.median(near) <= 0.02),
        ),
        Claim("cells with", ", ".join(f"{k} {c}" for k, c in kinds.items()), "reported", True),
        Claim("time", f"{time.monotonic() - begun:.0f} s", "reported", True),
    ]


if __name__ == "__main__":
    main_of(lambda: main(int(sys.argv[1]) if len(sys.argv) > 1 else DRAWN))
