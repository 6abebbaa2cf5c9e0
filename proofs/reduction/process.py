"""Algorithm 1 of [Volkmann] on an arm of six joints in two processes.

The paper prints neither the arm nor its masses: the arm is `studies/robots/p2_arm.toml`, fixed
beforehand, with links that are symmetric about a plane, as the paper assumes of its own, and
10.621 kg at the flange. Pick and place between two areas, and the edges of a horizontal square, 50
repetitions averaged; the efforts have friction and slow errors of control that the
model lacks, as large as the errors of the paper's table V. The tolerance is 5 % of the
mean absolute error, and friction of joints that move is essential from the start.
"""

import sys
import tempfile
from functools import cache
from pathlib import Path

import numpy as np
from proofs.support.claims import Claim, main_of

sys.path.append(str(Path(__file__).parents[2] / "tests"))
from studies.support.robots import ROBOTS

from drawn import samples_of
from steelyard.base.arrays import Array
from steelyard.estimate.information.base_parameters_and_regressor import Regressor, base_regressor
from steelyard.estimate.information.kept_filtered_samples import FilteredSamples
from steelyard.estimate.least_squares.normal_equations import condition_of
from steelyard.estimate.reduction.backward_elimination_and_left_out_errors import State
from steelyard.estimate.reduction.stopping_rules_and_reduction import (
    Reduction,
    criterion_of,
    reduce,
    within_tolerance,
)
from steelyard.excite.design_problem_from_tables import limits_of
from steelyard.excite.planned.plans_from_tables import planned
from steelyard.excite.trajectories.exact_trajectories import ExactTrajectory
from steelyard.model.model import model_of
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.inertia_and_placement import INERTIAL_NAMES, Inertia
from steelyard.robot.robot import Robot

ARM = ROBOTS / "p2_arm.toml"
PICK = """kind = "pick_and_place"
pick = { x = [0.9, 1.3], y = [-0.7, -0.3], z = [0.3, 0.6] }
place = { x = [0.9, 1.3], y = [0.3, 0.7], z = [0.3, 0.6] }
cycles = 8
speed = 1.5
tool_axis = [0.0, 0.0, -1.0]
"""
SQUARE = """kind = "square"
centre = [1.1, 0.0, 0.6]
side = 0.4
laps = 4
speed = 0.8
tool_axis = [0.0, 0.0, -1.0]
"""
STEP, REPETITIONS, STILL, TOLERANCE = 0.004, 50, 0.05, 0.05
MASSES = (60.0, 45.0, 35.0, 15.0, 8.0, 3.0)
ERRORS = {
    "pick and place": (0.232, 0.089, 0.071, 0.315, 0.123, 0.320),
    "square": (0.226, 0.146, 0.124, 0.500, 0.525, 0.272),
}
"""Errors of the paper's table V, as far as a model can have them: joint 4 hardly moves on the
square,
where the paper's error is above that of predicting zero."""
LENGTHS = (0.3, 0.75, 0.3, 0.6, 0.15, 0.1)


def true_values(robot: Robot) -> dict[str, float]:
    """True standard parameters of the arm, by name."""
    random = np.random.default_rng(7)
    standard: dict[str, float] = {}
    bodies = [body.name for body in robot.bodies]
    for number, (name, mass, length) in enumerate(zip(bodies, MASSES, LENGTHS, strict=True)):
        com = np.array([0.4 * length, 0.0, 0.1 * length]) * random.uniform(0.6, 1.2, 3)
        spread = mass * length**2 / 12.0 * random.uniform(0.5, 1.2, 3) + 0.01
        body = Inertia.about_com(mass, tuple(com), np.diag(spread))
        ten = body.ten
        if number == len(bodies) - 1:
            load = Inertia.about_com(10.621, (0.02, 0.0, 0.12), 0.02 * np.eye(3))
            ten = ten + load.ten
        for kind, value in zip(INERTIAL_NAMES, ten, strict=True):
            standard[f"{kind}.{name}"] = float(value)
    effort = np.array([70.0, 110.0, 45.0, 8.0, 5.0, 3.0])
    for joint, size in zip(robot.joint_names, effort, strict=True):
        standard[f"coulomb.{joint}"] = 0.5 * size
        standard[f"viscous.{joint}"] = 0.4 * size
    return standard


@cache
def columns() -> tuple[Regressor, Array, tuple[str, ...]]:
    """Columns of the arm, true base values, and names of those that symmetry leaves."""
    regressor = base_regressor(model_of(ARM))
    standard = true_values(regressor.model.robot)
    values = regressor.base.base_values([standard[name] for name in regressor.base.names])
    names = regressor.layout.columns
    left = tuple(n for n, value in zip(names, values, strict=True) if abs(value) > 1e-9)
    return regressor, values, left


def planned_motion(motion: str, seed: int) -> ExactTrajectory:
    """The motion of a process.

    Args:
        motion: Table of the motion.
        seed: Same seed, same points.
    """
    text = ARM.read_text(encoding="utf-8")
    head, _, tail = text.partition("[excitation.motion]\n")
    rest = tail[tail.index("\n[") + 1 :]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "process.toml"
        file.write_text(f"{head}[excitation.motion]\n{motion}\n{rest}", encoding="utf-8")
        loaded = load_robot(file)
        limits = limits_of(loaded.robot, loaded.excitation.limits)
        trajectory, _notes = planned(loaded, limits, seed)
    return trajectory


def recorded(motion: str, shares: tuple[float, ...], seed: int) -> FilteredSamples:
    """A process as it is averaged over its repetitions.

    Args:
        motion: Table of the motion.
        shares: Mean absolute value of what the model lacks, over that of the effort, per joint.
        seed: Same seed, same points and noise.
    """
    regressor, values, _ = columns()
    trajectory = planned_motion(motion, seed)
    found = trajectory.sample(np.arange(0.0, trajectory.duration, STEP))
    states = np.array([found.q.T, found.dq.T, found.ddq.T])
    exact = regressor.dense(*states) @ values
    random = np.random.default_rng(seed)
    q, dq, _ = states
    lacking = np.tanh(dq / 0.02) * np.exp(-np.abs(dq) / 0.15)
    drift = random.normal(size=q.shape)
    for k in range(1, q.shape[1]):
        drift[:, k] = 0.9 * drift[:, k - 1] + np.sqrt(1.0 - 0.81) * drift[:, k]
    lacking = 0.3 * lacking + drift
    size = np.abs(exact).mean(axis=1, keepdims=True)
    lacking *= np.array(shares)[:, None] * size / np.abs(lacking).mean(axis=1, keepdims=True)
    noise = 0.2 * size * random.normal(size=exact.shape) / np.sqrt(REPETITIONS)
    return samples_of(regressor, states, exact + lacking + noise, f"process{seed}")


def reduced(samples: FilteredSamples) -> Reduction:
    """Algorithm 1 with the mean absolute error of the samples."""
    _, _, left = columns()
    speeds = np.abs(samples.dq).max(axis=0)
    rows = samples.layout.rows
    moving = [row for row, speed in zip(rows, speeds, strict=True) if speed > STILL * speeds.max()]
    information = samples.information().select(left)
    keep = [f"{law}.{row}" for row in moving for law in ("coulomb", "viscous")]
    rule = within_tolerance(TOLERANCE, samples)
    return reduce(information, criterion_of("mean_column"), rule, keep=keep)


def condition(state: State, *, unit: bool) -> float:
    """Condition number of the design matrix of a model."""
    matrix, _, _ = state.full.information.select(state.names).normal()
    lengths = np.sqrt(np.diag(matrix)) if unit else np.ones(len(matrix))
    return condition_of(matrix / lengths[:, None] / lengths)


def unseen(found: Reduction, place: int, samples: FilteredSamples) -> Array:
    """Relative mean absolute errors of a model on another run of the process [%]."""
    regressor, _, _ = columns()
    state = found.path.states[place]
    known = dict(zip(state.names, state.values, strict=True))
    values = np.array([known.get(name, 0.0) for name in regressor.layout.columns])
    errors = []
    for rows, seen in zip(samples.rows, samples.layout.sees, strict=True):
        rest = np.abs(rows[:, -1] - rows[:, :-1] @ values[list(seen)]).mean()
        errors.append(100.0 * rest / np.abs(rows[:, -1]).mean())
    return np.array(errors)


def main() -> list[Claim]:
    """Both processes; what is not seen; errors on another run of the same process."""
    claims = []
    for name, motion, least, paper in (
        ("pick and place", PICK, 5.0, "35 to 20, 61.7 to 8.46"),
        ("square", SQUARE, 100.0, "35 to 16, 1632 to 2.73"),
    ):
        samples = recorded(motion, ERRORS[name], 1)
        found = reduced(samples)
        first, last = found.path.states[0], found.state
        hidden = [one.name for one in found.path.full.blind]
        count = len(columns()[2])
        gone = count - len(last.active)
        bound = ">= 15 out" if name == "pick and place" else "printed"
        told = f"{count} to {len(last.active)} parameters, {len(hidden)} of them not identifiable"
        claims.append(Claim(f"{name}: parameters (paper: {paper})", told, bound, gone >= 15))
        for kind, unit in (("columns as they are", False), ("columns of unit norm", True)):
            before, after = (condition(state, unit=unit) for state in (first, last))
            claims.append(
                Claim(
                    f"{name}: condition number, {kind}",
                    f"{before:.3g} to {after:.3g}",
                    f"divided by >= {least:g}",
                    before / after >= least,
                )
            )
        other = recorded(motion, ERRORS[name], 2)
        before, after = (unseen(found, k, other) for k in (0, found.chosen))
        worst = float(np.max(after / before))
        pairs = ", ".join(f"{a:.1f} to {b:.1f}" for a, b in zip(before, after, strict=True))
        claims.append(
            Claim(
                f"{name}: error of each joint on another run [%]",
                pairs,
                "<= 1.05 x the full model's (mean)",
                float(np.mean(after / before)) <= 1.05,
            )
        )
        print(f"{name}: removed {', '.join(one.name for one in found.estimate.removed)}")
        print(f"{name}: worst joint x {worst:.3f}; not identifiable: {', '.join(hidden) or 'none'}")
    return claims


if __name__ == "__main__":
    main_of(main)
