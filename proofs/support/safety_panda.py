"""The Panda with and without clearance of its own bodies: time, cost, distances by coal.

Shapes are read by Pinocchio from the URDF, hulls are built by coal.
"""

import json
import re
import time
from itertools import pairwise
from typing import Any

import coal
import numpy as np
import pinocchio as pin
from proofs.support.claims import Claim, data_folder
from proofs.support.designs import PROBLEMS
from proofs.support.safety_motion import derivative, duration

from steelyard.excite.constraints.certificate import certify
from steelyard.excite.design_problem_and_information import Problem
from steelyard.excite.design_problem_from_tables import build
from steelyard.excite.search.repair_until_proven import finished
from steelyard.excite.search.search_methods import search_by_gradient, seeded
from steelyard.model.model import model_with_open_friction
from steelyard.robot.file.robot_file import load_robot

MARGIN = 0.02
SEARCHES = 5
SAMPLES = 10_000
CHAIN = [f"panda_link{k}" for k in range(8)]
NEIGHBOURS = {frozenset(pair) for pair in pairwise([*CHAIN, "panda_hand"])}
"""Links that a joint connects; the hand is fixed to the last of the chain."""


def problem_of(bodies: bool) -> Problem:
    """The committed problem, its bodies watched or not."""
    path = PROBLEMS / "panda.toml"
    wanted = f"bodies = true\nmargin = {MARGIN}" if bodies else "bodies = false"
    text = path.read_text().replace("bodies = false", wanted)
    loaded = load_robot(path, text)
    return build(loaded, model_with_open_friction(loaded))


class Clearances:
    """Distances of the Panda's links by coal, its fingers locked."""

    def __init__(self) -> None:
        models = data_folder().parent / "models"
        text = (models / "panda_description/urdf/panda.urdf").read_text()
        text = text.replace("package://example-robot-data/robots", str(models.resolve()))
        whole = pin.buildModelFromXML(text)
        solids = pin.buildGeomFromUrdfString(whole, text, pin.COLLISION)
        locked = [whole.getJointId(f"panda_finger_joint{k}") for k in (1, 2)]
        still = pin.neutral(whole)
        self.model, self.solids = pin.buildReducedModel(whole, solids, locked, still)
        for solid in self.solids.geometryObjects:
            if isinstance(solid.geometry, coal.BVHModelBase):
                solid.geometry.buildConvexHull(True, "Qt")
                solid.geometry = solid.geometry.convex
        self.names = [re.sub(r"_\d+$", "", s.name) for s in self.solids.geometryObjects]

    def least(self, motion: dict[str, Any], pairs: set[frozenset[str]]) -> float:
        """Least distance of some pairs on all samples [m]."""
        self.solids.removeAllCollisionPairs()
        for j, second in enumerate(self.names):
            for i, first in enumerate(self.names[:j]):
                if frozenset((first, second)) in pairs:
                    self.solids.addCollisionPair(pin.CollisionPair(i, j))
        data, found = self.model.createData(), pin.GeometryData(self.solids)
        least = np.inf
        for q in derivative(motion, np.linspace(0.0, duration(motion), SAMPLES), 0):
            pin.computeDistances(self.model, data, self.solids, found, q)
            least = min(least, *(result.min_distance for result in found.distanceResults))
        return float(least)

    def every(self) -> set[frozenset[str]]:
        """Pairs on different bodies that no joint connects."""
        joint = {
            name: solid.parentJoint
            for name, solid in zip(self.names, self.solids.geometryObjects, strict=True)
        }
        return {
            frozenset((a, b))
            for a in joint
            for b in joint
            if joint[a] != joint[b] and frozenset((a, b)) not in NEIGHBOURS
        }


def may_touch() -> set[frozenset[str]]:
    """Pairs that the manufacturer's SRDF does not look at."""
    text = (data_folder().parent / "models/panda_description/srdf/panda.srdf").read_text()
    found = re.findall(r'<disable_collisions link1="(\w+)" link2="(\w+)"', text)
    return {frozenset(pair) for pair in found}


def searched(problem: Problem, number: int) -> tuple[np.ndarray, float]:
    """What one search ends with, and its time on one core [s]."""
    begun = time.process_time()
    x = search_by_gradient(problem, seeded(0, number), lambda x: None)
    return x, time.process_time() - begun


def panda_claims() -> list[Claim]:
    """Time, clearance, cost."""
    free, watched = problem_of(False), problem_of(True)
    for problem in (free, watched):
        problem.objective(problem.basis.still(np.zeros(problem.robot.n)), 1.0)
        search_by_gradient(problem, seeded(1, 0), lambda x: None, 2)
    both = [(searched(free, k), searched(watched, k)) for k in range(SEARCHES)]
    seconds = np.median([[a[1], b[1]] for a, b in both], axis=0)
    best = [
        finished(problem, [pair[side][0] for pair in both])
        for side, problem in enumerate((free, watched))
    ]
    certificate = certify(watched.robot, best[1].trajectory, watched.limits, watched.constraints)
    proofs = {proof.name: proof for proof in certificate.proofs}["clearance"]
    pairs = {frozenset(label.split("'")[1::2]) for label in proofs.labels}
    stored = [json.loads(json.dumps(b.trajectory.to_dict())) for b in best]
    judge = Clearances()
    left = judge.every() - pairs
    seen, without = (judge.least(motion, pairs) for motion in reversed(stored))
    ratio = float(seconds[1] / seconds[0])
    kept = certificate.holds and seen >= MARGIN
    rise = best[1].criterion_value / best[0].criterion_value - 1.0
    return [
        Claim(
            "Panda, time of a search with clearance against without",
            f"{ratio:.2f} ({seconds[1]:.2f} / {seconds[0]:.2f} s)",
            "<= 4",
            ratio <= 4.0,
        ),
        Claim(
            f"Panda, least clearance of {len(pairs)} pairs on {SAMPLES} samples (without: "
            f"{1e3 * without:.1f} mm)",
            f"{1e3 * seen:.4f} mm, proven {1e3 * (MARGIN + min(proofs.proven)):.4f}",
            f">= {1e3 * MARGIN:g} mm",
            kept,
        ),
        Claim(
            f"Panda, condition with clearance, best of {SEARCHES}",
            f"{best[1].criterion_value:.2f} against {best[0].criterion_value:.2f} ({rise:+.1%})",
            "reported",
            True,
        ),
        Claim(
            f"Panda, pairs of links that may not touch by its SRDF and are left out of {len(left)}",
            f"{len(left - may_touch())}",
            "0",
            not left - may_touch(),
        ),
    ]
