"""The models that benchmarks build."""

import sys
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"


def test_the_parallelogram_of_the_genetic_algorithm(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "path", [*sys.path, str(BENCHMARKS)])
    from genetic import model_with

    assert len(model_with(0.1).parameters) == 9
