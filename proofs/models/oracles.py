"""Inverse dynamics and regressor against Pinocchio and MuJoCo, and our backends with each other.

Six kinds of robot, states over the whole circle, 1, 3, 4 and 5 samples a call. Errors are relative
to the largest torque (or regressor entry) of a call where that is above one.
"""

import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from proofs.support.claims import Claim, data_folder, main_of

from steelyard.base.arrays import Array
from steelyard.base.motion import Motion
from steelyard.estimate.information.base_parameters_and_regressor import standard_regressor
from steelyard.model.equations.inverse_dynamics import JointState
from steelyard.model.laws.laws_without_friction import RigidBody
from steelyard.model.model import Model
from steelyard.robot.robot import Robot
from steelyard.simulate.mujoco_model import build, inverse_dynamics
from steelyard.symbolic import program_and_softening as numpy_backend
from steelyard.symbolic.program_and_softening import InputArray as Input
from steelyard.symbolic.program_and_softening import Program
from steelyard.symbolic.symbols_and_tracing import symbolic

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))
from invented import ROBOTS  # noqa: E402
from oracles import pinocchio_regressor, pinocchio_torque  # noqa: E402

COUNTS = (1, 3, 4, 5)
DRAWS = 25
"""Draws of each number of samples."""


@dataclass(frozen=True)
class Errors:
    """Largest relative errors of one robot over all its states."""

    regressor: float
    torque: float
    mujoco: float
    backends: float


def errors(robot: Robot) -> Errors:
    """Compare on drawn states, speeds up to some rad/s, standing still included."""
    rng = np.random.default_rng(0)
    model = Model(robot, (RigidBody(),))
    program = _torque_program(model)
    found = [_errors_at(model, program, _states(rng, robot.n, count)) for count in COUNTS * DRAWS]
    return Errors(*(max(values) for values in zip(*found, strict=True)))


def _states(rng: np.random.Generator, n: int, count: int) -> tuple[Array, Array, Array]:
    q = rng.uniform(-np.pi, np.pi, (count, n))
    dq, ddq = rng.normal(size=(2, count, n)) * rng.choice([0.0, 1.0, 5.0])
    return q, dq, ddq


def _errors_at(
    model: Model, program: Program, states: tuple[Array, Array, Array]
) -> tuple[float, float, float, float]:
    """Regressor and torque against Pinocchio, torque against MuJoCo, NumPy against machine code."""
    robot, prior = model.robot, model.prior
    if prior is None:
        raise ValueError(f"robot '{robot.name}' has a body of unknown mass")
    q, dq, ddq = states
    torque = prior.torque(Motion(np.arange(len(q)), q, dq, ddq))
    dense = standard_regressor(model).dense(q.T, dq.T, ddq.T).transpose(1, 0, 2)
    samples = list(zip(q, dq, ddq, strict=True))
    reference = numpy_backend.run(
        program,
        [*(x.T for x in states), np.empty((0, len(q))), robot.nominal.ravel()],
    ).T
    return (
        _error(dense, np.array([pinocchio_regressor(robot, *s) for s in samples])),
        _error(torque, np.array([pinocchio_torque(robot, *s) for s in samples])),
        _error(torque, inverse_dynamics(build(robot), q, dq, ddq)),
        _error(torque, reference),
    )


def _torque_program(model: Model) -> Program:
    """The program of the torque, traced anew."""
    inputs = (*model.inputs, Input("parameters", len(model.names), shared=True))
    return symbolic(lambda *x: model.torque_of(JointState(*x[:4]), x[4]), inputs)


def _error(got: Array, wanted: Array) -> float:
    return float(np.abs(got - wanted).max() / max(1.0, np.abs(wanted).max()))


def main() -> list[Claim]:
    """One line per robot and oracle."""
    data_folder()
    claims = []
    with tempfile.TemporaryDirectory() as folder:
        for name, make in ROBOTS.items():
            found = errors(make(Path(folder)))
            for what, figure, bound in (
                ("regressor against Pinocchio", found.regressor, 1e-10),
                ("torque against Pinocchio", found.torque, 1e-10),
                ("torque against MuJoCo", found.mujoco, 1e-8),
                ("NumPy against machine code", found.backends, 1e-12),
            ):
                claims.append(
                    Claim(f"{name}: {what}", f"{figure:.1e}", f"<= {bound:.0e}", figure <= bound)
                )
    return claims


if __name__ == "__main__":
    main_of(main)
