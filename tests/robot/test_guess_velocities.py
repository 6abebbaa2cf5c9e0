"""Velocities are used where a sample of the log shows that they are worth it."""

import numpy as np
import pytest

from robot.test_guess import TWO, numbered
from steelyard.robot.file.signals import POSITION_UNITS, VELOCITY_UNITS
from steelyard.robot.init.guess_clock_positions_and_velocities import compared
from steelyard.robot.init.guess_columns import guess_columns

T = np.arange(4000) * 0.005


def sampled(
    *, noise: float = 1e-3, late: float = 0.0, scale: float = 1.0, reach: float = 1.0
) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(0)
    q = [reach * np.sin(2.0 * np.pi * f * T) for f in (0.3, 0.5)]
    w = [2.0 * np.pi * f for f in (0.3, 0.5)]
    v = [reach * x * np.cos(x * (T - late)) for x in w]
    found = {"t": T} | {f"q{k + 1}": np.round(q[k] / 1e-3) * 1e-3 for k in range(2)}
    return found | {
        f"dq{k + 1}": scale * v[k] + noise * rng.standard_normal(len(T)) for k in range(2)
    }


def velocity_and_reason(sample: dict[str, np.ndarray]) -> tuple[object, str]:
    guess = guess_columns(TWO, ["t", *numbered("q#", "dq#", "tau#")], sample)
    return guess.section.velocity, guess.reasons[-1]


def test_good_velocities_are_used_beside_coarse_positions() -> None:
    velocity, reason = velocity_and_reason(sampled())
    assert velocity == "dq{}" and "are used: they are the derivative of the positions" in reason


@pytest.mark.parametrize(
    ("sample", "words"),
    [
        (sampled(late=0.02), r"they are 20 ms late"),
        (sampled(late=0.2), "and they are 220 ms late"),
        (sampled(scale=1.1), "they are 1.1 times the derivative"),
        (sampled(noise=0.03), "they are hardly less noisy than differentiated positions (noise 0."),
        (sampled(noise=3.0), "they are noisier than differentiated positions ("),
        (sampled(reach=1e-3), "the first 4000 rows do not show whether they are good"),
    ],
)
def test_others_are_left_out_with_the_reason(sample: dict[str, np.ndarray], words: str) -> None:
    velocity, reason = velocity_and_reason(sample)
    assert velocity is None and "are left out" in reason and words in reason


def test_velocities_in_degrees_are_used_with_their_unit() -> None:
    sample = sampled()
    for name in sample.keys() - {"t"}:
        sample[name] = np.rad2deg(sample[name])
    guess = guess_columns(TWO, ["t", *numbered("q#", "dq#", "tau#")], sample)
    assert (guess.section.position_unit, guess.section.velocity_unit) == ("deg", "deg/s")


@pytest.mark.parametrize(
    ("positions", "velocities", "unit"),
    [("rad", "deg/s", "deg/s"), ("deg", "rad/s", None), ("rad", "rpm", "rpm")],
)
def test_velocities_in_another_unit_than_positions_are_used_with_it(
    positions: str, velocities: str, unit: str | None
) -> None:
    sample = sampled()
    for k in (1, 2):
        sample[f"q{k}"] /= POSITION_UNITS["revolute"][positions]
        sample[f"dq{k}"] /= VELOCITY_UNITS["revolute"][velocities]
    guess = guess_columns(TWO, ["t", *numbered("q#", "dq#", "tau#")], sample)
    assert guess.section.velocity == "dq{}" and guess.section.velocity_unit == unit
    assert f"are used, in {velocities}: they are the derivative" in guess.reasons[-1]


@pytest.mark.parametrize("factor", [-1.0, 0.0, 3.0])
def test_one_joint_of_three_leaves_all_out(factor: float) -> None:
    sample = sampled()
    q, v = ([sample[f"{what}{k}"] for k in (1, 2, 1)] for what in ("q", "dq"))
    good = compared(T, q, v)
    assert good is not None and not good.faults
    one = compared(T, q, [v[0], factor * v[1], v[2]])
    assert one is not None and one.faults == ("one joint's are not the derivative of its position",)


def test_a_short_sample_does_not_judge() -> None:
    sample = sampled()
    q, v = ([sample[f"{what}1"]] for what in ("q", "dq"))
    assert compared(T, q, v) is not None
    assert compared(T[:300] * 0.1, [q[0][:300]], [v[0][:300]]) is None


def test_backward_differences_are_no_velocities() -> None:
    sample = sampled()
    for k in (1, 2):
        sample[f"dq{k}"] = np.diff(sample[f"q{k}"], prepend=sample[f"q{k}"][0]) / 0.005
    assert velocity_and_reason(sample)[0] is None


def test_the_comparison_is_of_the_truth() -> None:
    sample = sampled(late=0.012, scale=0.8)
    q, v = ([sample[f"{what}{k}"] for k in (1, 2)] for what in ("q", "dq"))
    found = compared(sample["t"], q, v)
    assert found is not None
    assert found.scale == pytest.approx(1.25, rel=2e-3)
    assert found.late == pytest.approx(0.012, rel=0.1)
    assert compared(sample["t"][::-1], q, v) is None
    q[0][::50], v[1][7] = 1e300, np.nan
    broken = compared(sample["t"], q, v)
    assert broken is not None and broken.scale == pytest.approx(1.25, rel=2e-3)
