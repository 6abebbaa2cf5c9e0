"""A motion that was seen before is recognised, and so are the rows of a log."""

from pathlib import Path

import numpy as np
import pytest

from steelyard.base.arrays import Array
from steelyard.excite.trajectories.fourier import random_fourier
from steelyard.identify.repeated_motion_and_validation_split import repeat_of, repeat_within
from steelyard.robot.file.robot_file import LoadedRobot
from steelyard.runs.prepare import prepare
from steelyard.runs.processing_choices import Processing
from steelyard.runs.recording import LogInMemory, Recording
from steelyard.runs.run import (
    LEAST_MOTION_SAMPLES,
    MOST_MOTION_SAMPLES,
    MotionSamples,
    Run,
    motion_samples,
)
from steelyard.simulate.simulate import write_demo_arm

STEP = 2.0 * np.pi / 2**17


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> LoadedRobot:
    return write_demo_arm(tmp_path_factory.mktemp("arm"))


def rows(arm: LoadedRobot, motion: int, noise: int) -> Array:
    """A log of a motion, with noise of its own."""
    path = random_fourier(arm.robot, seed=motion, period=10.0)
    m = path.sample(np.arange(0.0, 10.0, 0.005))
    rng = np.random.default_rng(noise)
    tau = m.q + m.ddq + 0.01 * rng.standard_normal(m.q.shape)
    q = np.round((m.q + 1e-4 * rng.standard_normal(m.q.shape)) / STEP) * STEP
    return np.column_stack([m.t, q, m.dq, tau])


def run_of(arm: LoadedRobot, table: Array, name: str = "other") -> Run:
    assert arm.signals is not None
    log = LogInMemory(Path(name), arm.signals.columns, table)
    return prepare(Recording(log, arm.signals), Processing())


@pytest.fixture(scope="module")
def known(arm: LoadedRobot) -> tuple[MotionSamples, ...]:
    return motion_samples([run_of(arm, rows(arm, 0, 0), "first"), run_of(arm, rows(arm, 1, 1))])


@pytest.mark.parametrize("change", ["copy", "trimmed", "half", "thinned", "float32", "later"])
def test_rows_of_a_known_log_are_recognised(
    arm: LoadedRobot, known: tuple[MotionSamples, ...], change: str
) -> None:
    table = rows(arm, 0, 0)
    changed = {
        "copy": table,
        "trimmed": table[3:-5],
        "half": table[1000:],
        "thinned": table[::4],
        "float32": table.astype(np.float32).astype(np.float64),
        "later": table + np.eye(1, table.shape[1])[0] * 123.4,
    }[change]
    repeat = repeat_of(known, run_of(arm, changed))
    assert repeat is not None and repeat.same and repeat.run == "first"
    assert "contains rows of first" in repeat.words


def test_a_motion_once_more_is_repeated_but_not_the_same_log(
    arm: LoadedRobot, known: tuple[MotionSamples, ...]
) -> None:
    late = rows(arm, 0, 7)[200:]
    late[:, 0] += 3.0
    repeat = repeat_of(known, run_of(arm, late))
    assert repeat is not None and not repeat.same and repeat.share > 0.9
    assert repeat.distance < 1e-3 and "repeats the motion of first" in repeat.words


@pytest.mark.parametrize("noise", [0, 7])
def test_a_motion_with_other_zeros_of_joints_is_repeated(
    arm: LoadedRobot, known: tuple[MotionSamples, ...], noise: int
) -> None:
    table = rows(arm, 0, noise)[200:]
    table[:, 1] += 0.7
    table[:, 6] -= 0.6
    repeat = repeat_of(known, run_of(arm, table))
    assert repeat is not None and repeat.share > 0.9 and repeat.zeros
    assert repeat.same == (noise == 0) and "with other zeros of joints" in repeat.words


def test_a_motion_in_another_posture_is_another_one(
    arm: LoadedRobot, known: tuple[MotionSamples, ...]
) -> None:
    table = rows(arm, 0, 7)
    table[:, 1] += 0.7
    table[:, 13:] *= -1.0  # other efforts: gravity of another posture
    assert repeat_of(known, run_of(arm, table)) is None


def test_a_part_that_is_repeated_has_its_share(
    arm: LoadedRobot, known: tuple[MotionSamples, ...]
) -> None:
    new, old = rows(arm, 5, 5), rows(arm, 0, 6)[:1000]
    old[:, 0] += 20.0
    repeat = repeat_of(known, run_of(arm, np.concatenate([new, old])))
    assert repeat is not None and repeat.share == pytest.approx(1.0 / 3.0, abs=0.1)


@pytest.mark.parametrize("seed", range(2, 8))
def test_another_motion_is_not_repeated(
    arm: LoadedRobot, known: tuple[MotionSamples, ...], seed: int
) -> None:
    assert repeat_of(known, run_of(arm, rows(arm, seed, seed))) is None


def test_the_same_motion_slower_is_another_one(
    arm: LoadedRobot, known: tuple[MotionSamples, ...]
) -> None:
    slow = rows(arm, 0, 0)
    slow[:, 0] *= 1.5
    slow[:, 7:13] /= 1.5
    assert repeat_of(known, run_of(arm, slow)) is None


def test_samples_are_bounded_and_survive_json(known: tuple[MotionSamples, ...]) -> None:
    assert all(LEAST_MOTION_SAMPLES <= len(one.t) <= MOST_MOTION_SAMPLES for one in known)
    again = MotionSamples.from_dict(known[0].to_dict())
    assert again.run == "first" and again.step == known[0].step
    np.testing.assert_allclose(again.q, known[0].q, rtol=1e-8)
    np.testing.assert_allclose(again.effort, known[0].effort, rtol=1e-8)


def test_a_motion_is_repeated_within_a_run(arm: LoadedRobot) -> None:
    again = rows(arm, 0, 1)
    again[:, 0] += 10.0
    found = repeat_within(run_of(arm, np.concatenate([rows(arm, 0, 0), again])), 14.0, 20.0)
    assert found is not None and not found.same
    assert found.shift == pytest.approx(10.0, abs=0.02)


@pytest.mark.parametrize(("middle", "stop"), [(7.0, 10.0), (7.0, 7.0), (-1.0, 10.0)])
def test_a_motion_that_is_new_repeats_nothing_within_its_run(
    arm: LoadedRobot, middle: float, stop: float
) -> None:
    assert repeat_within(run_of(arm, rows(arm, 0, 0)), middle, stop) is None
