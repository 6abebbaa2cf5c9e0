"""What controllers do between the points of a file, against the motion."""

from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from excite.exportable import arm as plain_arm
from excite.exportable import motions
from excite.tabled import problem_of
from steelyard.excite.controller_file_formats import even_times
from steelyard.excite.excite import error_between

WALLS = """
[excitation.limits]
effort = "any"
[excitation.workspace]
floor = -2.0
box = {x = [-3.0, 3.0]}
keep_out = [{x = [0.3, 0.5], y = [0.3, 0.5], z = [0.3, 0.5]}]
point = [0.1, 0.0, 0.2]
"""
MOTIONS = motions(plain_arm(6))


@pytest.mark.parametrize("name", MOTIONS)
@pytest.mark.parametrize("rate", [3.0, 10.0, 100.0])
def test_controllers_stay_within_the_bound(name: str, rate: float) -> None:
    motion = MOTIONS[name]
    points = even_times(motion.duration, rate)
    q = motion.derivative(points, 0)
    t = np.linspace(0.0, motion.duration, 20011)
    true = motion.derivative(t, 0)
    lines = np.stack([np.interp(t, points, x) for x in q.T], axis=1)
    half = np.minimum(0.5 * points[1], np.minimum(t, motion.duration - t))[:, None]
    early, late = (
        np.stack([np.interp(t + sign * half[:, 0], points, x) for x in q.T], axis=1)
        for sign in (-1.0, 1.0)
    )
    spline = CubicSpline(points, q, bc_type="clamped")(t)
    for between, way in {
        "lines": lines,
        "rounded lines": 0.5 * (early + late),
        "cubic spline": spline,
    }.items():
        bound = error_between(motion, between, rate)
        assert (np.abs(way - true).max(axis=0) <= bound + 1e-12).all(), between


@pytest.mark.parametrize("only_tool", ["true", "false"])
def test_margins_change_no_faster_than_they_may(tmp_path: Path, only_tool: str) -> None:
    problem = problem_of(tmp_path, f"{WALLS}only_tool = {only_tool}\n")
    rng = np.random.default_rng(0)
    first = rng.uniform(-1.0, 1.0, (200, 3))
    away = rng.uniform(-0.05, 0.05, first.shape)
    second, still = first + away, np.zeros_like(first)
    every = np.vstack([first, second])
    found = [c for c in problem.constraints if c.reaches(first[0], first[0]) is not None]
    assert len(found) == (4 if only_tool == "true" else 3)
    for constraint in found:
        reaches = constraint.reaches(every.min(axis=0), every.max(axis=0))
        a, b = (constraint.margins(q, still, still).values for q in (first, second))
        seen = np.minimum(a, b) < constraint.activation_distance
        assert (np.abs(b - a) <= np.abs(away) @ reaches.T + 1e-6)[seen].all()
        assert seen.any() or constraint.name != "clearance"
