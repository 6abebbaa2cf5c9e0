"""Intervals of actuators: what repeats, what a law lacks, and what has no scale of its own."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from proofs.actuators.motor_bench import drawn
from proofs.support.servo_arm import BENCH_FILE, BENCH_URDF, ROBOT_FILE, URDF, Servos, log, targets

import steelyard
from steelyard.actuators.actuator_model import arm_step
from steelyard.actuators.actuator_parameters import ActuatorValues, free_parameters
from steelyard.actuators.assumed_scales import spread_of_stiffness, with_assumed_scales
from steelyard.actuators.fit import Fitted, Task, motions, predictable
from steelyard.actuators.halves import halves
from steelyard.actuators.rollout import rollouts
from steelyard.actuators.target_runs import TargetRun, windows_of
from steelyard.robot.file.robot_file import load_robot


def run_of(name: str, seconds: float) -> TargetRun:
    t = np.arange(0.0, seconds, 0.02)
    still = np.zeros((len(t), 2))
    return TargetRun(name, t, still, still)


def test_motions_are_logs_and_parts_of_long_ones() -> None:
    place = motions(windows_of([run_of("one", 400.0), run_of("two", 40.0)], 4.0))
    counts = [len(set(part.tolist())) for part in (place[:100], place[100:])]
    assert counts == [7, 1]
    assert (np.diff(place) >= 0).all() and place.max() == 7


def test_halves_are_logs_where_there_are_enough() -> None:
    some = [run_of("a", 40.0), run_of("b", 80.0), run_of("c", 40.0)]
    assert halves(windows_of(some, 4.0)).tolist() == [1] * 10 + [0] * 20 + [1] * 10
    one = halves(windows_of([run_of("a", 160.0), run_of("b", 8.0)], 4.0))
    assert set(one[:40].tolist()) == {0, 1}


@pytest.fixture
def place(tmp_path: Path) -> Path:
    (tmp_path / "servos.urdf").write_text(URDF)
    (tmp_path / "servos.toml").write_text(ROBOT_FILE)
    return tmp_path


def task_of(place: Path, values: ActuatorValues, parts: tuple[str, ...]) -> Task:
    """Motion of these values themselves, in windows."""
    step = arm_step(load_robot(place / "servos.toml").robot)
    t, target = targets(40.0, seed=4)
    run = TargetRun("log", t, target, np.tile(target[0], (len(t), 1)))
    (whole,) = rollouts(step, values, windows_of([run], None))
    noise = np.random.default_rng(1).normal(0.0, 5e-4, whole.q.shape)
    windows = windows_of([replace(run, q=whole.q + noise)], 4.0)
    return Task.of(step, windows, free_parameters(parts, {}, 2), values)


def test_rollouts_that_depend_on_chance_do_not_count(place: Path) -> None:
    values = ActuatorValues.of((1.0, 1.0), **vars(Servos()))
    task = task_of(place, values, ("stiffness", "damping"))
    rolled = task.rolled(values, slopes=True)
    assert predictable(task, rolled)[0].windows == task.windows
    for wild in (1e30, np.nan, np.inf):
        some = [replace(one, slopes=np.full_like(one.slopes, wild)) for one in rolled[:3]]
        clear, left = predictable(task, [*some, *rolled[3:]])
        assert clear.windows == task.windows[3:] and len(left) == len(rolled) - 3
    none, still = predictable(
        task, [replace(x, slopes=np.full_like(x.slopes, np.inf)) for x in rolled]
    )
    assert none.windows == task.windows and not any(x.slopes.any() for x in still)


def test_logs_that_contradict_each_other_widen_the_intervals(place: Path) -> None:
    logs = []
    for k, coulomb in enumerate(((0.12, 0.06), (0.2, 0.1), (0.2, 0.1), (0.12, 0.06))):
        logs.append(place / f"log{k}.parquet")
        table = log(Servos(coulomb=coulomb), 20.0 + k, seed=k)
        pl.DataFrame(table).write_parquet(logs[-1])
    (place / "plain.toml").write_text(ROBOT_FILE + '[actuator]\nlaw = "position_pd"\n')
    found = steelyard.identify_actuators(place / "plain.toml", logs)
    (friction,) = (p for p in found.parameters if (p.name, p.joint) == ("coulomb", "shoulder"))
    assert friction.interval is not None
    assert friction.interval[0] < 0.125 and friction.interval[1] > 0.195
    assert "intervals" in str(found)


def test_the_scale_of_a_joint_without_one_is_as_uncertain_as_the_others_differ(place: Path) -> None:
    values = ActuatorValues.of((1.0, 1.0), stiffness=(10.0, 20.0), damping=0.3)
    task = task_of(place, values, ("damping",))
    found = Fitted(task, values, np.ones(2), 1e-4 * np.eye(2), 0.0)
    assert spread_of_stiffness(values, [0]) == spread_of_stiffness(values, [0, 1]) == 1.0
    near = values.changed(stiffness=(10.0, 10.2))
    assert spread_of_stiffness(near, [0, 1]) == pytest.approx(0.111, abs=0.002)
    free, covariance, _ = with_assumed_scales(replace(found, values=near), [1], [0, 1])
    at = {(one.name, one.joint): k for k, one in enumerate(free)}
    own, scale = at["damping", 1], at["stiffness", 1]
    spread = spread_of_stiffness(near, [0, 1]) ** 2
    assert covariance[own, own] == pytest.approx(1e-4 + spread)
    ratio = covariance[own, own] + covariance[scale, scale] - 2.0 * covariance[own, scale]
    assert ratio == pytest.approx(1e-4)
    assert covariance[at["damping", 0], at["damping", 0]] == pytest.approx(1e-4)


def test_a_part_is_tried_again_beside_one_that_was_added(tmp_path: Path) -> None:
    servo = drawn(np.random.default_rng(7003), stribeck=True, load=True)
    (tmp_path / "bench.urdf").write_text(BENCH_URDF)
    (tmp_path / "bench.toml").write_text(BENCH_FILE)
    pl.DataFrame(log(servo, 60.0, 3, 100.0)).write_parquet(tmp_path / "log.parquet")
    found = steelyard.identify_actuators(tmp_path / "bench.toml", tmp_path / "log.parquet")
    tried = [(one.tried, one.kept) for one in found.law]
    order = [("+ stribeck", False), ("+ load_friction", True), ("+ stribeck", True)]
    assert [one for one in tried if one in order] == order
    assert "Stribeck" not in str(found).partition("not needed")[2].partition("\n")[0]
