"""The figure of a designed motion against time: ours, and three other ways to search.

They search one after another on the same core, each for the same time and from the same seeds, and
for the same motion: limits, tool box, base columns. Imports and compiling are not on the clock.

- steelyard: random starts, exact slopes, Newton's method within a barrier;
- SLSQP as tools of this kind do it: the condition number of a regressor that a Python loop over
  Pinocchio fills, slopes by finite differences, limits and box at 100 samples. It gets exact
  slopes of limits and box, our random starts, and begins at the best of as many of them as ours;
- CMA-ES and a genetic algorithm on our own fast criterion.

Of every tenth of a second the last motion is looked at, and the end of every search. A motion
counts once every joint is scaled into its exact limits and the box is proven for all times, whoever
found it.
"""

import os
import time
from dataclasses import dataclass
from functools import cached_property
from itertools import count
from pathlib import Path

import numpy as np
import pinocchio as pin
from scipy.optimize import minimize

from oracles import pinocchio_model
from steelyard.base.progress import Stopped
from steelyard.excite.constraints.tool_workspace import HalfSpaces
from steelyard.excite.design_problem_and_information import Problem
from steelyard.excite.design_problem_from_tables import build
from steelyard.excite.search.feasibility import each_start
from steelyard.excite.search.margins_barrier_and_newton import InequalityConstraints, StepWatch
from steelyard.excite.search.repair_until_proven import scaled
from steelyard.excite.search.search_methods import (
    Method,
    search_by_cma_es,
    search_by_genes,
    search_by_gradient,
    seeded,
)
from steelyard.model.laws.friction_over_speed import Coulomb, Viscous
from steelyard.model.laws.laws_without_friction import RigidBody
from steelyard.model.model import Model
from steelyard.robot.file.robot_file import load_robot

SECONDS = float(os.environ.get("STEELYARD_BENCH_SECONDS", "20"))
"""How long each way searches."""

MARKS = (0.05, 0.1, 0.25, 0.5, 1.0)
"""Shares of the time after which the criterion's value is reported."""

WANTED = 36.0
"""Value of the criterion whose time is reported."""

SAMPLES, STEP, ENOUGH, ROUNDS = 100, 1e-6, 1e-4, 1000
"""Of SLSQP: samples, finite difference, gain at which it ends, most iterations."""

SHARES = (1.0, 0.999, 0.997, 0.99, 0.97, 0.9, 0.7, 0.4)
"""Of a motion about its start, until its box is proven."""

TICK, SEED = 0.1, 0
ROOT = Path(__file__).parent.parent
Course = list[tuple[float, float]]
"""Time [s] and figure of every improvement."""


@dataclass(frozen=True, eq=False)
class PinocchioLoop:
    """Criterion, limits and box of a problem as a loop over Pinocchio has them.

    Attributes:
        problem: What is designed.
    """

    problem: Problem

    @cached_property
    def model(self) -> pin.Model:
        """The robot; the point that stays in the box is its last frame."""
        model = pinocchio_model(self.problem.robot)
        if self.box:
            points = self.box.points
            at = pin.SE3(np.eye(3), np.array(points.places[0]))
            kind = pin.FrameType.OP_FRAME
            model.addFrame(pin.Frame("tool", points.carriers[0] + 1, 0, at, kind))
        return model

    @cached_property
    def data(self) -> pin.Data:
        """Where Pinocchio writes."""
        return self.model.createData()

    @cached_property
    def box(self) -> HalfSpaces | None:
        """What the tool keeps, if anything."""
        boxes = [box for box in self.problem.constraints if isinstance(box, HalfSpaces)]
        return boxes[0] if boxes else None

    @cached_property
    def inequalities(self) -> InequalityConstraints:
        """Limits of the joints at the samples."""
        basis = self.problem.basis
        t = np.linspace(0.0, basis.duration, SAMPLES, endpoint=False)
        return InequalityConstraints(basis, self.problem.limits, (), t)

    def state(self, x: np.ndarray) -> list[np.ndarray]:
        """Position, speed and acceleration at all samples."""
        pairs = zip(self.inequalities.shapes[:3], self.inequalities.offsets[:3], strict=True)
        return [shape @ x.T + offset for shape, offset in pairs]

    def regressor(self, x: np.ndarray) -> np.ndarray:
        """Stacked base columns, the jump of Coulomb friction as steep as in our criterion."""
        shows, n = self.problem.cases[0].shows, self.problem.robot.n
        q, dq, ddq = self.state(x)
        whole = np.zeros((SAMPLES, n, len(shows.base.names)))
        for k in range(SAMPLES):
            whole[k, :, : 10 * n] = pin.computeJointTorqueRegressor(
                self.model, self.data, q[k], dq[k], ddq[k]
            )
        joints = np.arange(n)
        whole[:, joints, 10 * n + joints] = dq
        whole[:, joints, 11 * n + joints] = np.tanh(dq / shows.widths)
        return whole.reshape(SAMPLES * n, -1)[:, list(shows.base.independent)]

    def cost(self, x: np.ndarray) -> float:
        """Logarithm of the condition number; by the Gram matrix, three times faster than SVD."""
        stacked = self.regressor(x)
        values = np.linalg.eigvalsh(stacked.T @ stacked)
        return 0.5 * float(np.log(values[-1] / max(values[0], 1e-16 * values[-1])))

    def room(self, x: np.ndarray) -> np.ndarray:
        """Distances from the sides of the box at the samples [m]."""
        places, tool = np.empty((SAMPLES, 3)), self.model.nframes - 1
        for k, posture in enumerate(self.state(x)[0]):
            pin.framesForwardKinematics(self.model, self.data, posture)
            places[k] = self.data.oMf[tool].translation
        return (places @ self.box.normals.T - self.box.levels).ravel()

    def room_slopes(self, x: np.ndarray) -> np.ndarray:
        """Slopes of these distances by the coefficients, `(rows, n m)`."""
        ways, tool = np.empty((SAMPLES, 3, self.model.nv)), self.model.nframes - 1
        axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        for k, posture in enumerate(self.state(x)[0]):
            ways[k] = pin.computeFrameJacobian(self.model, self.data, posture, tool, axes)[:3]
        by_q = self.box.normals @ ways
        return (by_q[..., None] * self.inequalities.shapes[0][:, None, None, :]).reshape(-1, x.size)

    def kept(self, shape: tuple[int, int]) -> list[dict]:
        """Limits and box as SLSQP takes them, with exact slopes by the coefficients."""
        units = np.eye(shape[0] * shape[1])
        slopes = np.array(
            [self.inequalities.margin_rates(unit.reshape(shape)).ravel() for unit in units]
        ).T
        limits = {
            "type": "ineq",
            "fun": lambda z: self.inequalities.limit_margins(z.reshape(shape)).ravel(),
            "jac": lambda z: slopes,
        }
        box = {
            "type": "ineq",
            "fun": lambda z: self.room(z.reshape(shape)),
            "jac": lambda z: self.room_slopes(z.reshape(shape)),
        }
        return [limits, box] if self.box else [limits]


def search_by_differences(
    problem: Problem, random: np.random.Generator, watch: StepWatch, screened: int = 60
) -> np.ndarray:
    """SLSQP on a loop over Pinocchio, from the best of some random starts."""
    loop = PinocchioLoop(problem)
    starts = list(each_start(problem.inequalities, random, screened))
    watch(starts[0])
    start = min(starts, key=loop.cost)
    found = minimize(
        lambda z: loop.cost(z.reshape(start.shape)),
        start.ravel(),
        method="SLSQP",
        constraints=loop.kept(start.shape),
        callback=lambda z: watch(np.array(z).reshape(start.shape)),
        options={"eps": STEP, "ftol": ENOUGH, "maxiter": ROUNDS},
    )
    return np.asarray(found.x).reshape(start.shape)


def visited(
    problem: Problem, method: Method, seconds: float
) -> tuple[list[tuple[float, np.ndarray]], int]:
    """Times and motions that searches come by within some time, and how many were begun."""
    way: dict[int, tuple[float, np.ndarray]] = {}
    ends: list[tuple[float, np.ndarray]] = []
    begun = time.perf_counter()

    def watch(x: np.ndarray) -> None:
        now = time.perf_counter() - begun
        if now > seconds:
            raise Stopped("the time is spent")
        way[int(now / TICK)] = now, x

    try:
        for number in count():
            x = method(problem, seeded(SEED, number), watch)
            ends.append((time.perf_counter() - begun, x))
    except Stopped:
        pass
    inside = [(t, x) for t, x in (*way.values(), *ends) if t <= seconds]
    return sorted(inside, key=lambda one: one[0]), len(ends) + 1


def counted(problem: Problem, x: np.ndarray, best: float) -> float:
    """The figure of a motion once it is scaled and proven; infinite if it is not below `best`."""
    inside = scaled(problem, x)
    if inside is None or problem.criterion_value(inside) >= best:
        return np.inf
    still = problem.basis.still(problem.basis.motion(inside).derivative([0.0], 0)[0])
    for share in SHARES:
        moved = still + share * (inside - still)
        motion = problem.basis.motion(moved)
        if all(np.all(constraint.proven(motion) >= 0.0) for constraint in problem.constraints):
            return problem.criterion_value(moved)
    return np.inf


def course_of(problem: Problem, method: Method, seconds: float) -> tuple[Course, int]:
    """Improvements against time, and searches; what is imported and compiled first is not timed."""
    course, best = [], np.inf
    visited(problem, method, 0.0)
    motions, begun = visited(problem, method, seconds)
    for t, x in motions:
        figure = counted(problem, x, best)
        if figure < best:
            best = figure
            course.append((t, figure))
    return course, begun


def cells(course: Course, seconds: float) -> str:
    """Figures at the marks, and when the wanted one is reached."""
    figures = [[f for t, f in course if t <= share * seconds] for share in MARKS]
    reached = [t for t, f in course if f <= WANTED]
    values = [f"{f[-1]:.1f}" if f else "-" for f in figures]
    return " ".join(f"{x:>6}" for x in (*values, f"{reached[0]:.1f}" if reached else "-"))


def designs() -> list[tuple[str, str, str, bool]]:
    """Rows for the benchmark's table."""
    data = os.environ.get("STEELYARD_DATA")
    loaded = load_robot(
        ROOT / ("proofs/problems/panda.toml" if data else "studies/robots/p4_arm.toml")
    )
    name = loaded.robot.name
    problem = build(loaded, Model(loaded.robot, (RigidBody(), Viscous(), Coulomb())))
    ways: dict[str, Method] = {
        "steelyard": search_by_gradient,
        "SLSQP, finite differences, Pinocchio loop": search_by_differences,
        "CMA-ES, our criterion": search_by_cma_es,
        "genetic algorithm, our criterion": search_by_genes,
    }
    problem.objective(problem.basis.still(np.zeros(problem.robot.n)), 1.0)
    marks = " ".join(f"{f'{share * SECONDS:g} s':>6}" for share in MARKS)
    title = f"motion of {name}, {problem.basis.duration:g} s: condition after"
    rows = [(title, f"{marks} {f's to {WANTED:g}':>6}", "", True)]
    for way, method in ways.items():
        course, begun = course_of(problem, method, SECONDS)
        rows.append((f"{way}, searches: {begun}", cells(course, SECONDS), "", True))
    return rows
