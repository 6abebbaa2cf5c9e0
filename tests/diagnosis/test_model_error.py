"""What residuals say of a model: errors planted into simulated logs are named, noise is not."""

import shutil
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

from steelyard.cli import river
from steelyard.diagnosis import Finding, Judgement
from steelyard.diagnosis.fitted_case import FittedCase
from steelyard.diagnosis.model_error import ModelError
from steelyard.estimation.fields import said_by
from steelyard.estimation.identified import Cutoffs, IdentifiedModel, Provenance
from steelyard.estimation.least_squares import WeightedLeastSquares
from steelyard.measurement import Run
from steelyard.motion import Motion
from steelyard.regression.base import base_map
from steelyard.regression.regressor import base_regressor
from steelyard.robot.robot import Body, Robot
from steelyard.robot.robot_file import LoadedRobot, load_robot
from steelyard.terms.load_dependent import LoadDependent
from steelyard.terms.register import DEFAULT_TERMS
from steelyard.terms.stribeck import Stribeck
from steelyard.terms.term import Term
from steelyard.virtual.demo import _ROBOT_FILE
from steelyard.virtual.invent import random_truth

RATE, SECONDS = 250.0, 20.0


@pytest.fixture(scope="module")
def loaded(tmp_path_factory: pytest.TempPathFactory) -> LoadedRobot:
    folder = tmp_path_factory.mktemp("arm")
    shutil.copy(str(files("steelyard.virtual") / "demo_arm.urdf"), folder / "demo_arm.urdf")
    (folder / "arm.toml").write_text(_ROBOT_FILE)
    return load_robot(folder / "arm.toml")


def motion(robot: Robot, seed: int) -> Motion:
    """Five harmonics of 0.1 Hz."""
    rng, t = np.random.default_rng(seed), np.arange(int(RATE * SECONDS)) / RATE
    q, dq, ddq = np.zeros((3, len(t), robot.n))
    for k in range(1, 6):
        w = 0.2 * np.pi * k
        a, b = 0.8 * rng.normal(size=(2, robot.n)) / k
        s, c = np.sin(w * t)[:, None], np.cos(w * t)[:, None]
        q, dq, ddq = q + a * s + b * c, dq + w * (a * c - b * s), ddq - w * w * (a * s + b * c)
    return Motion(t, q, dq, ddq)


def log(
    path: Path, robot: Robot, seed: int, terms: Sequence[Term], offset: Sequence[float]
) -> None:
    """A run of the true robot, with 1 % noise on its torques."""
    truth, rng, moved = random_truth(robot, 1, terms=terms), np.random.default_rng(seed), motion
    path_of = moved(robot, seed)
    tau = truth.model.at(truth.values).torque(path_of)
    tau = tau + 0.01 * np.sqrt(np.mean(tau**2, axis=0)) * rng.normal(size=tau.shape)
    q = path_of.q + 2e-5 * rng.normal(size=tau.shape) - np.array(offset)
    dq = path_of.dq + 1e-3 * rng.normal(size=tau.shape)
    named = {"time_s": path_of.t}
    for k in range(robot.n):
        named |= {
            f"q{k + 1}_rad": q[:, k],
            f"dq{k + 1}_rad_s": dq[:, k],
            f"tau{k + 1}_Nm": tau[:, k],
        }
    pl.DataFrame(named).write_parquet(path)


def found(
    loaded: LoadedRobot,
    folder: Path,
    robot: Robot | None = None,
    terms: Sequence[Term] = DEFAULT_TERMS,
    offset: Sequence[float] = (0.0,) * 6,
) -> tuple[Finding, ...]:
    """The check of a plain fit of two runs of a robot that is not what its file says."""
    paths = [folder / f"run{seed}.parquet" for seed in (1, 2)]
    for seed, path in enumerate(paths, start=1):
        log(path, loaded.robot if robot is None else robot, seed, terms, offset)
    return ModelError()(case(loaded, paths))


def case(loaded: LoadedRobot, paths: Sequence[Path]) -> FittedCase:
    signals, model = loaded.signals, river.model_of(loaded)
    assert signals is not None
    runs: Sequence[Run] = river.runs_of(
        loaded, signals, river.log_files([str(p) for p in paths]), (), lambda _: True
    )[0]
    estimate = WeightedLeastSquares()(said_by(runs)(base_regressor(model)))
    cutoffs = Cutoffs(runs[0].motion_cutoff, runs[0].matched_cutoff, runs[0].matched_cutoff)
    origin = Provenance("0", {}, (), ())
    identified = IdentifiedModel(model, base_map(model), estimate, (), signals, cutoffs, origin)
    return FittedCase(identified, tuple(runs))


def with_body(robot: Robot, index: int, **fields: Any) -> Robot:
    bodies = [
        Body(**{**vars(body), **(fields if k == index else {})})
        for k, body in enumerate(robot.bodies)
    ]
    return robot.changed(bodies=tuple(bodies))


def test_noise_alone_says_nothing(loaded: LoadedRobot, tmp_path: Path) -> None:
    assert found(loaded, tmp_path) == ()


def test_a_zero_offset_is_named_with_its_value(loaded: LoadedRobot, tmp_path: Path) -> None:
    (finding,) = found(loaded, tmp_path, offset=(0.0, 0.0, 0.1, 0.0, 0.0, 0.0))
    assert finding.judgement == Judgement.DOUBTFUL and finding.joints == ("elbow",)
    assert "zero offset of elbow 0.1" in finding.says and "x the measurement noise" in finding.says
    assert finding.mend is not None
    (edit,) = finding.mend.edits
    assert edit.path == ("signals", "position_offset")
    assert edit.value[2] == pytest.approx(0.1, abs=0.005)
    assert [x for k, x in enumerate(edit.value) if k != 2] == [0.0] * 5


def test_the_last_joint_turns_its_body_and_nothing_else(
    loaded: LoadedRobot, tmp_path: Path
) -> None:
    assert found(loaded, tmp_path, offset=(0.3, 0.0, 0.0, 0.0, 0.0, 0.3)) == ()


def test_a_longer_link_is_named(loaded: LoadedRobot, tmp_path: Path) -> None:
    body = loaded.robot.bodies[2]
    (finding,) = found(loaded, tmp_path, with_body(loaded.robot, 2, position=1.1 * body.position))
    assert finding.judgement == Judgement.DOUBTFUL
    assert "position of joint elbow" in finding.says


def test_a_tilted_axis_is_named(loaded: LoadedRobot, tmp_path: Path) -> None:
    body, tilt = loaded.robot.bodies[4], np.deg2rad(5.0)
    turn = np.array([[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]])
    axes = turn if abs(body.axis[0]) < 0.9 else turn[[1, 2, 0]][:, [1, 2, 0]]
    (finding,) = found(loaded, tmp_path, with_body(loaded.robot, 4, rotation=body.rotation @ axes))
    assert finding.judgement == Judgement.DOUBTFUL and "axis of joint wrist_bend" in finding.says


@pytest.mark.parametrize("term", [Stribeck(speed=0.1), LoadDependent()], ids=lambda t: t.law)
def test_a_friction_law_that_lacks_is_a_remark(
    term: Term, loaded: LoadedRobot, tmp_path: Path
) -> None:
    (finding,) = found(loaded, tmp_path, terms=(*DEFAULT_TERMS, term))
    assert finding.judgement == Judgement.OK and finding.headline
    causes = finding.says.partition("explain of it: ")[2]
    assert f"(term {term.law})" in causes.split(",")[0]
