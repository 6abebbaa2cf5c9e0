"""Clearances that are proven for all times."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from excite.colliding import joint, link, panda, snake, ur10, urdf, waves, written
from steelyard.excite.collision.clearance import Clearance, self_clearance
from steelyard.excite.collision.solids_and_shapes import (
    Ball,
    Box,
    Capsule,
    Cylinder,
    obstacle,
    placed,
    rates,
    wall,
)
from steelyard.excite.trajectories.exact_trajectories import SampledMotion
from steelyard.excite.trajectories.fourier import FourierMotion
from steelyard.robot.file.robot_file import LoadedRobot, load_robot

SAMPLES = 1001


def least(found: Clearance, motion: FourierMotion) -> np.ndarray:
    """Least margins on a grid, and on a closer one beside the least of each pair."""
    t = np.linspace(0.0, motion.duration, SAMPLES)
    coarse = found.distances(motion.derivative(t, 0))
    near = np.unique(coarse.argmin(axis=0))
    beside = t[near, None] + np.linspace(-t[1], t[1], 21)
    closer = np.clip(beside, 0.0, motion.duration).ravel()
    fine = found.distances(motion.derivative(closer, 0))
    return np.minimum(coarse.min(axis=0), fine.min(axis=0))


@pytest.mark.slow
@pytest.mark.parametrize(("name", "seed"), [("snake", 0), ("snake", 1), ("panda", 0), ("ur10", 1)])
def test_proven_is_below_the_least_sample_and_near(tmp_path: Path, name: str, seed: int) -> None:
    makers: dict[str, Callable[[], LoadedRobot]]
    makers = {"snake": lambda: snake(tmp_path), "panda": panda, "ur10": ur10}
    loaded = makers[name]()
    robot = loaded.robot
    others = (
        placed(robot.frames[-1], "load", Ball(0.08), (0.0, 0.0, 0.1), origin="tool"),
        obstacle("crate", Box((0.4, 0.4, 0.2)), (0.7, 0.0, 0.2)),
        obstacle("post", Cylinder(0.05, 1.5), (-0.2, 0.6, 0.7)),
        wall("floor", (0.0, 0.0, 1.0), -0.1),
    )
    found = self_clearance(loaded, others=others)
    motion = waves(robot, seed)
    proven = found.proven(motion)
    sampled = least(found, motion) - found.wanted
    assert np.all(proven <= sampled)
    near = sampled < found.activation_distance
    assert near.any()
    # depths of overlaps have sharp ends, which a grid of milliseconds cuts off
    loose = np.where(sampled > -0.01, 3e-4, 2e-3)
    assert np.all(proven >= np.minimum(sampled, found.activation_distance) - loose)


def test_a_short_touch_between_samples_is_seen(tmp_path: Path) -> None:
    """A rod sweeps past a thin pin within milliseconds."""
    text = urdf(
        link("base"),
        link("rod", '<box size="0.5 0.01 0.01"/>', xyz="0.35 0 0"),
        joint("base", "rod", axis="0 0 1"),
    )
    loaded = load_robot(written(tmp_path, text))
    pin = obstacle("pin", Ball(0.002), (0.55 * np.cos(0.3), 0.55 * np.sin(0.3), 0.0))
    found = self_clearance(loaded, others=(pin,), margin=0.0)
    series = np.array([[2.0, -1.0]])
    swing = FourierMotion(np.zeros(1), series, np.zeros((1, 2)), 3.0)
    proven = found.proven(swing)
    assert -0.0071 < proven[0] < -0.0069
    grid = np.linspace(0.0, 3.0, 50)
    angle = np.abs(swing.derivative(grid, 0)[:, 0] - 0.3).min()
    assert 0.55 * angle > 0.015, "the grid must miss the pin for this test to say anything"


def test_the_bound_is_exact_where_it_is_known(tmp_path: Path) -> None:
    text = urdf(
        link("base"),
        link("head", '<sphere radius="0.05"/>', xyz="0.4 0 0"),
        joint("base", "head", axis="0 1 0"),
    )
    floor, ball = wall("floor", (0.0, 0.0, 2.0), -0.7), obstacle("ball", Ball(0.1), (0.8, 0, 0))
    loaded = load_robot(written(tmp_path, text))
    found = self_clearance(loaded, others=(floor, ball))
    found = replace(found, activation_distance=np.ones(len(found.pairs)))
    swing = FourierMotion(np.array([0.2]), np.array([[0.4, -0.2]]), np.zeros((1, 2)), 4.0)
    low, high = (float(end[0]) for end in swing.extremes(0))
    closest = 0.0 if low <= 0.0 <= high else min(abs(low), abs(high))
    apart = np.hypot(0.8 - 0.4 * np.cos(closest), 0.4 * np.sin(closest)) - 0.15
    expected = {"floor": 0.35 - 0.4 * np.sin(high) - 0.05 - 0.01, "ball": apart - 0.01}
    assert [pair.second for pair in found.pairs] == ["floor", "ball"]
    for proven, exact in zip(found.proven(swing), expected.values(), strict=True):
        assert exact - 1.1e-4 <= proven <= exact + 1e-9


def test_a_motion_into_itself_is_not_certified() -> None:
    loaded = panda()
    found = self_clearance(loaded)
    lower, upper = (
        np.array([getattr(c.limits, e) for c in loaded.robot.coordinates])
        for e in ("lower", "upper")
    )
    folded = 0.5 * (lower + upper)
    folded[[1, 3, 5]] = 0.0, lower[3], lower[5]
    start = folded.copy()
    start[[3, 5]] = -1.5, 1.8
    assert found.distances(start[None]).min() > 0.01
    assert found.distances(folded[None]).min() < 0.0
    motion = SampledMotion(
        np.linspace(0.0, 4.0, 5), start + np.outer([0, 1, 1, 1, 0], folded - start)
    )
    assert found.proven(motion).min() < -0.01


def test_rates_of_a_hinge_are_its_reach(tmp_path: Path) -> None:
    text = urdf(
        link("base"),
        link("arm", '<sphere radius="0.1"/>', xyz="0.5 0 0.2"),
        link("hand", '<sphere radius="0.05"/>', xyz="0 0 0.3"),
        joint("base", "arm", axis="0 0 1"),
        joint("arm", "hand", "1 0 0", axis="0 0 1", kind="prismatic"),
    )
    loaded = load_robot(written(tmp_path, text))
    found = self_clearance(loaded, others=(obstacle("rod", Capsule(0.02, 0.3), (3.0, 0.0, 0.0)),))
    shapes = {shape.name: shape for shape in found.scene.shapes}
    ends = np.array([-0.5, -0.1]), np.array([0.5, 0.3])
    np.testing.assert_allclose(rates(loaded.robot, shapes["arm"], shapes["rod"], *ends), [0.6, 0])
    # the slide's ball is as long as its stroke: 1 m off the axis, 0.05 m and half of 0.4 m around
    expected = [1.25, 1.0]
    np.testing.assert_allclose(rates(loaded.robot, shapes["rod"], shapes["hand"], *ends), expected)
