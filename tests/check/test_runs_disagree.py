"""Fits of several runs: of one robot, of two, of one with a load in one run or in all."""

from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np
import pytest

from check.fitted import case, demo_arm, log
from steelyard.base.arrays import Parameters, frozen
from steelyard.check.finding import Finding, Severity
from steelyard.check.fitted.disagreeing_runs_and_passing_forces import (
    last_link_check,
    runs_disagree_check,
)
from steelyard.check.fitted.fitted_case_causes_and_constraints import FittedCase
from steelyard.estimate.estimate import Estimate, StandardEstimate
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.robot.file.robot_file import LoadedRobot
from steelyard.robot.inertia_and_placement import INERTIAL_NAMES, Inertia
from steelyard.runs.run import Run
from steelyard.simulate.ground_truth import Truth, random_truth


@pytest.fixture(scope="module")
def loaded(tmp_path_factory: pytest.TempPathFactory) -> LoadedRobot:
    return demo_arm(tmp_path_factory.mktemp("arm"))


def carrying(truth: Truth, mass: float) -> Truth:
    """The truth with a load at its last link."""
    load = Inertia.about_com(mass, [0.02, -0.01, 0.08], np.eye(3) * 0.0025 * mass).ten
    names = [f"{name}.{truth.robot.bodies[-1].name}" for name in INERTIAL_NAMES]
    own = truth.inertial[-1]
    return truth.changed(**dict(zip(names, (own + load).tolist(), strict=True)))


def found(loaded: LoadedRobot, folder: Path, *truths: Truth) -> tuple[Finding, ...]:
    """The check of one run of each of some robots."""
    paths = [folder / f"run{seed}.parquet" for seed in range(1, len(truths) + 1)]
    for seed, (path, truth) in enumerate(zip(paths, truths, strict=True), start=1):
        log(path, truth, seed)
    return runs_disagree_check(case(loaded, paths))


@pytest.mark.slow
def test_runs_of_one_robot_agree_whatever_its_friction(loaded: LoadedRobot, tmp_path: Path) -> None:
    truth = random_truth(loaded.robot, 1)
    warm = {n: 0.6 * v for n, v in truth.values.as_dict().items() if n.startswith("viscous")}
    assert found(loaded, tmp_path, truth, truth.changed(**warm)) == ()


@pytest.mark.slow
def test_runs_of_two_robots_disagree(loaded: LoadedRobot, tmp_path: Path) -> None:
    truths = random_truth(loaded.robot, 1), random_truth(loaded.robot, 2)
    (finding,) = found(loaded, tmp_path, *truths)
    assert finding.severity == Severity.WRONG and finding.log == ""
    assert "two robots" in finding.says and "run1 and run2 differ" in finding.says


@pytest.mark.slow
def test_of_three_runs_the_odd_one_is_named(loaded: LoadedRobot, tmp_path: Path) -> None:
    one, other = random_truth(loaded.robot, 1), random_truth(loaded.robot, 2)
    (finding,) = found(loaded, tmp_path, one, other, one)
    assert "the link inertias of run2 differ from the others'" in finding.says


def test_a_load_in_one_run_is_weighed(loaded: LoadedRobot, tmp_path: Path) -> None:
    truth = random_truth(loaded.robot, 1)
    (finding,) = found(loaded, tmp_path, truth, carrying(truth, 1.5))
    assert finding.log == "run2" and "carries a payload of 1.5 " in finding.says


def weighed(loaded: LoadedRobot, *masses: float, learned: float = 0.9) -> tuple[Finding, ...]:
    """The check of an estimate with these masses over the model file's, known to 5 %."""
    bodies = loaded.robot.bodies
    values = [m * b.inertia.mass for m, b in zip(masses, bodies, strict=True)]
    named = Parameters([f"m.{b.name}" for b in bodies], ["kg"] * len(bodies), values)
    spread = frozen(np.diag(np.square(0.05 * np.array(values))))
    standard = StandardEstimate(named, spread, frozen(np.full(len(bodies), learned)))
    estimate = replace(
        Estimate("", named, spread, (), np.ones(6), np.ones(6), 1.0, 1.0), standard=standard
    )
    model = cast(IdentifiedModel, type("Model", (), {})())
    object.__setattr__(model, "estimate", estimate)
    object.__setattr__(model, "model", type("Model", (), {"robot": loaded.robot})())
    return last_link_check(FittedCase(model, (cast(Run, None),)))


def test_a_last_link_that_is_much_heavier_than_the_file_says(loaded: LoadedRobot) -> None:
    (finding,) = weighed(loaded, 1.0, 0.8, 1.1, 0.9, 1.0, 3.5)
    assert finding.severity == Severity.DOUBTFUL
    assert "(flange) is estimated 1 kg heavier than in the model file" in finding.says


@pytest.mark.parametrize(
    "masses",
    [(1.0, 1.3, 0.7, 1.2, 0.8, 1.5), (3.0,) * 6, (0.3,) * 6, (1.0, 4.0, 1.0, 1.0, 1.0, 1.0)],
)
def test_masses_that_are_off_alike_are_no_load(
    masses: tuple[float, ...], loaded: LoadedRobot
) -> None:
    assert weighed(loaded, *masses) == ()


def test_a_mass_that_the_prior_decides_is_not_compared(loaded: LoadedRobot) -> None:
    assert weighed(loaded, 1.0, 0.8, 1.1, 0.9, 1.0, 3.5, learned=0.2) == ()
