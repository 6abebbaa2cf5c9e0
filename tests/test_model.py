"""The model: values by name, torque of whole runs and single steps, a start from the cache."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from invented import single, tree
from steelyard.base.arrays import Parameters
from steelyard.base.errors import DataError, ModelError
from steelyard.base.motion import Motion
from steelyard.model.compiled_quantity import BLOCK
from steelyard.model.laws.friction_over_speed import Coulomb, Viscous
from steelyard.model.laws.laws_without_friction import Offset, RigidBody
from steelyard.model.model import Model, ValuedModel
from steelyard.robot.robot import Robot
from steelyard.symbolic.native.llvm_vector_code import MAX_ANGLE


@pytest.fixture
def valued() -> ValuedModel:
    model = Model(tree())
    values = np.random.default_rng(0).normal(size=len(model.names))
    return model.at(Parameters(model.names, model.units, values))


def motion(count: int, n: int = 4) -> Motion:
    q, dq, ddq = np.random.default_rng(count).normal(size=(3, count, n))
    return Motion(np.arange(count), q, dq, ddq)


def test_long_runs_are_the_same_as_their_parts(valued: ValuedModel) -> None:
    whole = motion(2 * BLOCK + 5)
    torque = valued.torque(whole)
    last = slice(2 * BLOCK - 3, None)
    part = Motion(whole.t[last], whole.q[last], whole.dq[last], whole.ddq[last])
    assert torque.shape == whole.q.shape
    assert np.abs(valued.torque(part) - torque[last]).max() < 1e-12 * np.abs(torque).max()


def test_no_samples_are_no_torque(valued: ValuedModel) -> None:
    assert valued.torque(motion(0)).shape == (0, 4)


def test_steps_equal_the_whole_run(valued: ValuedModel) -> None:
    run, stepper = motion(20), valued.start()
    torque = valued.torque(run)
    steps = [stepper.step(run.q[k], run.dq[k], run.ddq[k]) for k in range(20)]
    assert np.abs(np.array(steps) - torque).max() < 1e-12 * np.abs(torque).max()


def test_two_steppers_do_not_share_their_buffers(valued: ValuedModel) -> None:
    run, first, second = motion(2), valued.start(), valued.start()
    one = first.step(run.q[0], run.dq[0], run.ddq[0])
    kept = one.copy()
    second.step(run.q[1], run.dq[1], run.ddq[1])
    first.step(run.q[1], run.dq[1], run.ddq[1])
    assert np.array_equal(one, kept)


def test_values_that_are_not_named_are_zero() -> None:
    model = Model(single(), (Viscous(), Offset()))
    valued = model.at(Parameters(["viscous.hinge"], ["N m s/rad"], [2.0]))
    assert valued.values.as_dict() == {"viscous.hinge": 2.0, "offset.hinge": 0.0}
    run = motion(6, 1)
    assert np.allclose(valued.torque(run), 2.0 * run.dq, rtol=0.0, atol=1e-15)


def test_strange_names_are_refused() -> None:
    with pytest.raises(DataError, match=r"has no parameter 'm\.wing'") as caught:
        Model(single()).at(Parameters(["m.wing"], ["kg"], [1.0]))
    assert "m.rod" in caught.value.fix


def test_motions_of_another_robot_are_refused(valued: ValuedModel) -> None:
    with pytest.raises(DataError, match="the motion has 6 joints, the model 4") as caught:
        valued.torque(motion(3, 6))
    assert "trunk_joint" in caught.value.fix


@pytest.mark.parametrize("angle", [1.01 * MAX_ANGLE, -1.01 * MAX_ANGLE, np.inf, np.nan])
def test_absurd_positions_are_refused(valued: ValuedModel, angle: float) -> None:
    still, q = np.zeros(4), np.array([0.0, angle, 0.0, 0.0])
    words = "beyond 100000 rad" if np.isfinite(angle) else "'q' holds a value that is not finite"
    with pytest.raises(DataError, match=words) as caught:
        valued.start().step(q, still, still)
    if np.isfinite(angle):
        assert "unit of the position columns" in caught.value.fix
        with pytest.raises(DataError, match="beyond 100000 rad"):
            valued.torque(Motion([0.0], [q], [still], [still]))


def test_a_parameter_cannot_come_twice() -> None:
    with pytest.raises(ModelError, match=r"two terms have the same parameter 'coulomb\.hinge'"):
        Model(single(), (Coulomb(), Coulomb(smoothing=0.1)))


def test_the_prior_is_the_nominal_robot_without_friction() -> None:
    robot = tree()
    prior = Model(robot, (RigidBody(), Coulomb())).prior
    assert prior is not None
    assert np.array_equal(prior.values.values[:40], robot.nominal.ravel())
    assert not prior.values.values[40:].any()
    unknown = type(robot.bodies[0])(**{**vars(robot.bodies[0]), "known": False})
    blank = Robot("blank", (unknown, *robot.bodies[1:]), robot.coordinates)
    assert Model(blank).prior is None


def test_the_fingerprint_is_of_the_content() -> None:
    model = Model(tree())
    assert Model(tree()).fingerprint == model.fingerprint
    assert Model.from_dict(model.to_dict()).fingerprint == model.fingerprint
    upright = Robot("tree", model.robot.bodies, model.robot.coordinates)
    others = [Model(upright), Model(tree(), (RigidBody(),)), Model(single())]
    assert len({model.fingerprint, *(other.fingerprint for other in others)}) == 4


START = """
from invented import tree
from steelyard.symbolic.native import compiler
from steelyard.model.model import Model
from steelyard.estimate.information.base_parameters_and_regressor import base_regressor
from steelyard.symbolic.native.compiled_programs import loops
from steelyard.symbolic.tape_and_derivatives import Tape
compiled, traced = [], []
compile_code = compiler.compile_code
compiler.compile_code = lambda *a: compiled.append(a) or compile_code(*a)
begin = Tape.__init__
Tape.__init__ = lambda tape: traced.append(tape) or begin(tape)
model = Model(tree())
base_regressor(model).code, loops(), model.torque_code
print(len(compiled), bool(traced))
"""


@pytest.mark.slow
def test_a_second_start_neither_traces_nor_compiles(tmp_path: Path) -> None:
    tests = str(Path(__file__).parent)
    env = {**os.environ, "STEELYARD_CACHE": str(tmp_path), "PYTHONPATH": tests}
    command = [sys.executable, "-c", START]
    lines = [
        subprocess.run(command, env=env, check=True, capture_output=True, text=True).stdout.strip()
        for _ in range(2)
    ]
    assert lines == ["3 True", "0 False"]


@pytest.mark.parametrize("values", [0.1, [0.1], [[0.1] * 4]])
def test_a_step_takes_one_value_per_joint(values: object) -> None:
    from invented import tree

    model = Model(tree())
    stepper = model.at(Parameters(("offset.tip_joint",), ("Nm",), [1.0])).start()
    good = np.zeros(4)
    assert stepper.step(good, good, good).tolist() == [0.0, 0.0, 0.0, 1.0]
    with pytest.raises(DataError, match="for 4 joints"):
        stepper.step(good, values, good)  # type: ignore[arg-type]
