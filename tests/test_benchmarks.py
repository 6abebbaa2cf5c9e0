"""The models that benchmarks build."""

import sys
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"


def test_the_parallelogram_of_the_genetic_algorithm(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "path", [*sys.path, str(BENCHMARKS)])
    from genetic import model_with

    assert len(model_with(0.1).parameters) == 9


def test_a_humanoid_without_model_files_floats(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "path", [*sys.path, str(BENCHMARKS)])
    monkeypatch.delenv("STEELYARD_DATA", raising=False)
    from floating_base import humanoid

    robot = humanoid()
    assert robot.floating and robot.n == 35
    assert all(body.inertia.mass > 0.0 for body in robot.bodies)


def test_seven_joints_without_measured_data_can_exist(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "path", [*sys.path, str(BENCHMARKS)])
    monkeypatch.delenv("STEELYARD_DATA", raising=False)
    from robots import seven_joints

    robot = seven_joints().robot
    assert robot.n == 7
    assert all(body.inertia.mass > 0.0 for body in robot.bodies)
