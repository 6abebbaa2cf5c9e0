"""The reverse kernel's slopes against central differences, and its time against theirs.

All criteria and all laws without memory, on the Panda's problem; and value and slope for 57
columns on 100 samples, on one core.
"""

import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from proofs.support.claims import Claim, data_folder, main_of
from proofs.support.designs import PROBLEMS, panda, regressor

sys.path.append(str(Path(__file__).parents[2] / "tests"))

from steelyard.excite.design_problem_and_information import (
    Case,
    InformationEvaluator,
    Objective,
    Problem,
)
from steelyard.excite.design_problem_from_tables import build
from steelyard.excite.optimality_criteria import CRITERIA, measure
from steelyard.excite.search.feasibility import each_start
from steelyard.excite.search.search_methods import seeded
from steelyard.excite.trajectories.motion_families import Basis, rest_fourier
from steelyard.model.laws.laws_without_friction import RigidBody
from steelyard.model.model import Model
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.robot import Robot

TIMED = True  # nothing else may run beside it

SHARPNESS = 16.0
SIZES = (0.01, 0.03, 0.1, 0.3, 1.0, 3.0)
"""Motions of which the one that shows a law best is taken: differences need figures."""

BOUND = 1e-6


def slope_error(objective: Objective, x: np.ndarray, seed: int) -> float:
    """Error along a random direction over the slope's length; differences of order four."""
    along = np.random.default_rng(seed).standard_normal(x.shape)
    whole = objective(x, SHARPNESS)[1]
    slope, size = float((whole * along).sum()), float(np.linalg.norm(whole))
    errors = []
    for step in (1e-3, 1e-4, 1e-5, 3e-6, 1e-6):
        value = [objective(x + k * step * along, SHARPNESS)[0] for k in (-2, -1, 1, 2)]
        central = (value[0] - 8.0 * value[1] + 8.0 * value[2] - value[3]) / (12.0 * step)
        errors.append(abs(central - slope) / size)
    return min(errors)


def of_laws() -> Claim:
    """Every law without memory beside rigid bodies, by every criterion."""
    from law_cases import memoryless
    from moving import geared

    robot = geared()
    basis = rest_fourier(robot.n, 4.0, 4)
    random = np.random.default_rng(3)
    t = np.linspace(0.0, 4.0, 80)
    worst, judged = 0.0, 0
    for law in memoryless(robot):
        if law.role == "body":
            continue
        model = Model(robot, (RigidBody(), law))
        shows = InformationEvaluator(
            model, random.uniform(0.5, 2.0, robot.n), np.full(robot.n, 0.3)
        )
        plain = Objective(basis, (Case(shows, CRITERIA["condition"]),), t)
        x = min(
            (size * random.standard_normal((robot.n, basis.count)) for size in SIZES),
            key=lambda x: plain(x, SHARPNESS)[0],
        )
        for criterion in CRITERIA.values():
            objective = Objective(basis, (Case(shows, criterion),), t)
            worst, judged = max(worst, slope_error(objective, x, judged)), judged + 1
    name = f"slopes, {judged} pairs of law and criterion"
    return Claim(name, f"{worst:.1e}", "<= 1e-6", worst <= BOUND)


def of_panda() -> list[Claim]:
    """The five criteria on the Panda's problem; time of the first."""
    problem = panda_problem()
    worst = 0.0
    x = next(each_start(problem.inequalities, seeded(0, 0), 1))
    case = problem.cases[0]
    for criterion in CRITERIA.values():
        objective = replace(problem.objective, cases=(replace(case, criterion=criterion),))
        worst = max(worst, slope_error(objective, x, 0))
    composed_error = composed(problem, x)
    t = np.linspace(0.0, 10.0, 100, endpoint=False)
    objective = Objective(problem.basis, problem.cases, t)
    ours = 1e3 * least(lambda: objective(x, SHARPNESS), 200)
    values = 1e3 * least(lambda: differences(objective, x), 3)
    one = least(lambda: pinocchio_value(problem.robot, problem.basis, x, t), 3)
    loop = 1e3 * one * (x.size + 1)
    return [
        Claim("slopes, Panda, five criteria", f"{worst:.1e}", "<= 1e-6", worst <= BOUND),
        Claim(
            "the same of chosen columns, after a prior, in sizes, worst of two loads",
            f"{composed_error:.1e}",
            "<= 1e-6",
            composed_error <= BOUND,
        ),
        Claim(
            "value and slope, 57 columns, 100 samples", f"{ours:.2f} ms", "<= 1.5 ms", ours <= 1.5
        ),
        Claim("our values differenced, against it", f"{values / ours:.0f} times", "reported", True),
        Claim(
            "a Pinocchio loop differenced, against it", f"{loop / ours:.0f} times", "reported", True
        ),
    ]


def composed(problem: Problem, x: np.ndarray) -> float:
    """Greatest error of criteria of part of the columns, with prior, sizes and two loads."""
    case = problem.cases[0]
    count = len(case.shows.base)
    random = np.random.default_rng(5)
    root = random.standard_normal((count, count))
    sizes = [np.exp(random.standard_normal(count)) for _ in range(2)]
    worst = 0.0
    for kind in CRITERIA.values():
        measures = [measure(kind, 1e-2 * root @ root.T, tuple(range(30)), s) for s in sizes]
        cases = tuple(replace(case, criterion=measure) for measure in measures)
        worst = max(worst, slope_error(replace(problem.objective, cases=cases), x, 1))
    return worst


def panda_problem() -> Problem:
    """The Panda's problem."""
    from steelyard.model.model import model_with_open_friction

    loaded = load_robot(PROBLEMS / "panda.toml")
    return build(loaded, model_with_open_friction(loaded))


def differences(objective: Objective, x: np.ndarray) -> np.ndarray:
    """The slope by forward differences."""
    here = objective(x, SHARPNESS)[0]
    slope = np.empty(x.size)
    for k in range(x.size):
        moved = x.ravel().copy()
        moved[k] += 1e-6
        slope[k] = (objective(moved.reshape(x.shape), SHARPNESS)[0] - here) / 1e-6
    return slope


def pinocchio_value(robot: Robot, basis: Basis, x: np.ndarray, t: np.ndarray) -> float:
    """One value by a loop over Pinocchio's regressor."""
    judge = panda()
    q, dq, ddq = (basis.shapes(t, k) @ x.T + basis.offset(t, k) for k in range(3))
    start = time.perf_counter()
    rows = regressor(judge.model, q, dq, ddq)[:, judge.columns]
    n = robot.n
    viscous, coulomb = np.zeros((2, len(t), n, n))
    viscous[:, range(n), range(n)] = dq
    coulomb[:, range(n), range(n)] = np.sign(dq)
    np.linalg.cond(np.hstack([rows, viscous.reshape(-1, n), coulomb.reshape(-1, n)]))
    return time.perf_counter() - start


def least(work: Callable[[], object], repeats: int) -> float:
    """Least time of some repetitions, or what they say they took [s]."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        measured = work()
        times.append(measured if isinstance(measured, float) else time.perf_counter() - start)
    return min(times)


def main() -> list[Claim]:
    """Slopes and times."""
    data_folder()
    return [of_laws(), *of_panda()]


if __name__ == "__main__":
    main_of(main)
