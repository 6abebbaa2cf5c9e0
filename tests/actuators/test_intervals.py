"""Intervals of actuators: what repeats, what a law lacks, and what has no scale of its own."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import mujoco
import numpy as np
import polars as pl
import pytest
from proofs.actuators.motor_bench import drawn
from proofs.support.servo_arm import BENCH_FILE, BENCH_URDF, ROBOT_FILE, URDF, Servos, log, targets

import steelyard
from steelyard.actuators.actuator_model import ActuatorModel, arm_step
from steelyard.actuators.actuator_parameters import ActuatorValues, free_parameters
from steelyard.actuators.actuator_words_and_tables import interval_words
from steelyard.actuators.assumed_scales import (
    LEAST_SPREAD,
    like_the_others,
    spread_of_stiffness,
    with_assumed_scales,
)
from steelyard.actuators.choice import Search, split
from steelyard.actuators.fit import Fitted, Task, fit, motions, predictable, usual_stiffness
from steelyard.actuators.halves import halves, halves_apart, widened
from steelyard.actuators.rollout import rollouts
from steelyard.actuators.target_runs import TargetRun, windows_of
from steelyard.export.model_files.actuators_mjcf import actuators_mjcf
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
    wild_ones = [replace(x, slopes=np.full_like(x.slopes, np.inf)) for x in rolled]
    assert predictable(task, wild_ones)[1] == []


def test_of_motion_that_all_depends_on_chance_nothing_is_known(
    place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    values = ActuatorValues.of((1.0, 1.0), **vars(Servos()))
    task = task_of(place, values, ("stiffness", "damping"))
    assert fit(task, values, 1).chance == 0.0
    monkeypatch.setattr("steelyard.actuators.fit.LARGEST_SLOPE", 0.0)
    found = fit(task, values, 1)
    assert found.chance == 1.0
    np.testing.assert_allclose(found.std, task.spread)


def test_one_motion_or_one_window_claims_no_more_than_it_shows(place: Path) -> None:
    values = ActuatorValues.of((1.0, 1.0), **vars(Servos()))
    task = task_of(place, values, ("stiffness", "damping"))
    whole = fit(task, values, 1)
    one = fit(replace(task, windows=task.windows[:1]), values, 1)
    assert (one.std >= task.spread).all() and (whole.std < 0.1 * task.spread).all()
    some = fit(replace(task, windows=task.windows[:3]), values, 1)
    assert (some.std > whole.std).all()


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


def test_a_joint_that_moves_in_one_half_alone_does_not_widen_the_intervals(place: Path) -> None:
    t, target = targets(90.0, seed=4)
    step = arm_step(load_robot(place / "servos.toml").robot)
    values = ActuatorValues.of((1.0, 1.0), **vars(Servos()))
    noise, runs = np.random.default_rng(1), []
    for k in (0, 1):
        own = target.copy()
        own[:, 1 - k] = own[0, 1 - k]
        run = TargetRun(f"log{k}", t, own, np.tile(own[0], (len(t), 1)))
        (moved,) = rollouts(step, values, windows_of([run], None))
        runs.append(replace(run, q=moved.q + noise.normal(0.0, 2e-4, moved.q.shape)))
    parts = ("stiffness", "damping", "coulomb", "armature")
    search = Search(step, tuple(windows_of(runs, 4.0)), {}, {}, values, 0.005, 2)
    found = fit(search.task(search.windows, parts), values, 8)
    assert (halves_apart(search, values, parts, found) or 9.0) < 3.0


def test_where_nothing_is_compared_no_agreement_is_claimed(
    place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    values = ActuatorValues.of((1.0, 1.0), **vars(Servos()))
    task, parts = task_of(place, values, ("stiffness", "damping")), ("stiffness", "damping")
    search = Search(task.step, task.windows, {}, {}, values, 0.005, 2)
    found = fit(task, values, 1)
    assert halves_apart(search, values, parts, found) is not None
    monkeypatch.setattr("steelyard.actuators.halves.LESS", 0.0)
    assert halves_apart(search, values, parts, found) is None


@pytest.mark.parametrize(
    ("wider", "words"),
    [(None, "nothing tests"), (1.0, "agree in 95 %"), (2.5, "a factor of 2.5")],
)
def test_words_say_what_the_intervals_rest_on(wider: float | None, words: str) -> None:
    model = cast(ActuatorModel, SimpleNamespace(wider=wider, masses_searched=False))
    assert words in interval_words(model)


def test_a_stated_torque_gives_its_joint_a_scale_and_stays(place: Path) -> None:
    roll = URDF.replace('<origin xyz="0.12 0 0"/><axis xyz="0 1 0"/>',
                        '<origin xyz="0.12 0 0"/><axis xyz="1 0 0"/>')  # fmt: skip
    identified(place, roll, ActuatorValues.of((1.0, 1.0), **vars(Servos(stiffness=(12.0, 20.0)))))
    known = '[actuator]\nlaw = "position_pd"\ncoulomb = ["identify", 0.06]\n'
    (place / "known.toml").write_text(ROBOT_FILE + known)
    found = steelyard.identify_actuators(place / "known.toml", place / "log.parquet").model
    assert found.assumed == () and found.values["coulomb"][1] == 0.06
    assert found.values["stiffness"][1] == pytest.approx(20.0, rel=0.05)


def test_widened_intervals_are_those_that_motions_tell(place: Path) -> None:
    values = ActuatorValues.of((1.0, 1.0), **vars(Servos()))
    found = fit(task_of(place, values, ("stiffness", "damping")), values, 1)
    wide = widened(found, 3.0)
    np.testing.assert_allclose(wide.covariance - found.covariance, 8.0 * found.scatter)
    most = widened(found, 1e6)
    assert (most.std <= 3.0 * found.task.spread * (1.0 + 1e-9)).all()
    assert most.std.max() == pytest.approx(3.0 * found.task.spread.max())


def test_the_scale_of_a_joint_without_one_is_as_uncertain_as_the_others(place: Path) -> None:
    values = ActuatorValues.of((1.0, 1.0), stiffness=(10.0, 20.0), damping=0.3)
    task = task_of(place, values, ("stiffness", "damping"))
    task = replace(task, free=task.free[:1] + task.free[2:], spread=np.ones(3))
    assert spread_of_stiffness([10.0], [0.0]) == 1.0
    assert spread_of_stiffness([10.0, 10.2], [0.0, 0.0]) == pytest.approx(0.111, abs=0.002)
    assert spread_of_stiffness([10.0, 10.0], [0.04, 0.04]) == pytest.approx(0.2)
    assert spread_of_stiffness([10.0, 15.0], [0.1, 0.1]) == pytest.approx(np.sqrt(0.1))
    assert spread_of_stiffness([10.0, 10.0], [0.0, 0.0]) == LEAST_SPREAD
    covariance = 1e-4 * np.eye(3)
    found = Fitted(task, values, np.ones(2), covariance, covariance, np.ones(3), 1.0, 0.0)
    free, wide, _ = with_assumed_scales(found, [1], [0], ("revolute", "revolute"))
    at = {(one.name, one.joint): k for k, one in enumerate(free)}
    own, scale = at["damping", 1], at["stiffness", 1]
    assert wide[own, own] == pytest.approx(1e-4 + 1.0)
    assert wide[own, own] + wide[scale, scale] - 2.0 * wide[own, scale] == pytest.approx(1e-4)
    assert wide[at["damping", 0], at["damping", 0]] == pytest.approx(1e-4)


def test_only_joints_of_the_same_kind_are_alike_and_what_is_stated_stays() -> None:
    values = ActuatorValues.of(
        (1.0, 1.0, 1.0), stiffness=(10.0, 5.0, 5000.0), damping=0.5, coulomb=0.1
    )
    kinds = ("revolute", "revolute", "prismatic")
    alike = like_the_others(values, [0], kinds, {"coulomb": values["coulomb"]})
    assert alike["stiffness"].tolist() == [10.0, 10.0, 5000.0]
    assert alike["damping"].tolist() == [0.5, 1.0, 0.5]
    assert alike["coulomb"].tolist() == [0.1, 0.1, 0.1]
    np.testing.assert_allclose(usual_stiffness(values, kinds), [7.5, 7.5, 5000.0])


def identified(place: Path, urdf: str, true: ActuatorValues) -> ActuatorModel:
    """From a log of motion of these values themselves, without any choice of the law."""
    (place / "servos.urdf").write_text(urdf)
    (place / "servos.toml").write_text(ROBOT_FILE + '[actuator]\nlaw = "position_pd"\n')
    step = arm_step(load_robot(place / "servos.toml").robot)
    t, target = targets(60.0, seed=4)
    run = TargetRun("log", t, target, np.tile(target[0], (len(t), 1)))
    (moved,) = rollouts(step, true, windows_of([run], None))
    q = moved.q + np.random.default_rng(1).normal(0.0, 2e-4, moved.q.shape)
    columns = {
        f"{name}{j + 1}": x[:, j] for name, x in (("q", q), ("target", target)) for j in (0, 1)
    }
    pl.DataFrame({"time": t, **columns}).write_parquet(place / "log.parquet")
    return steelyard.identify_actuators(place / "servos.toml", place / "log.parquet").model


def test_the_inertia_of_links_shows_a_stiffness_that_gravity_does_not(place: Path) -> None:
    upright = URDF.replace('<axis xyz="0 1 0"/><limit', '<axis xyz="0 0 1"/><limit', 1)
    true = ActuatorValues.of((1.0, 1.0), **vars(Servos(stiffness=(20.0, 8.0))))
    model = identified(place, upright, true)
    assert model.assumed == ()
    (one,) = (p for p in model.parameters if (p.name, p.joint) == ("stiffness", "shoulder"))
    assert one.status == "identified" and one.interval is not None
    assert one.interval[0] < 20.0 < one.interval[1] < 30.0


def test_a_stiffness_that_nothing_shows_is_like_the_others(place: Path) -> None:
    roll = URDF.replace('<origin xyz="0.08 0.005 0"/><mass value="0.2"/>',
                        '<origin xyz="0.08 0 0"/><mass value="0.2"/>')  # fmt: skip
    roll = roll.replace('<origin xyz="0.12 0 0"/><axis xyz="0 1 0"/>',
                        '<origin xyz="0.12 0 0"/><axis xyz="1 0 0"/>')  # fmt: skip
    true = ActuatorValues.of((1.0, 1.0), **vars(Servos(stiffness=(12.0, 20.0))))
    model = identified(place, roll, true)
    assert model.assumed == ("elbow",)
    values = {(p.name, p.joint): p for p in model.parameters}
    one, friction = values["stiffness", "elbow"], values["coulomb", "elbow"]
    assert one.status == "assumed" and one.value == pytest.approx(12.0, rel=0.1)
    assert one.interval is not None and one.interval[0] < 20.0 < one.interval[1]
    assert friction.status == "not identifiable"
    ratio = model.ratio("coulomb", 1)
    assert ratio is not None and ratio[0] == pytest.approx(0.06 / 20.0, rel=0.1) and ratio[1] < 0.1


@pytest.mark.parametrize(
    ("lengths", "whole"),
    [([20.0] * 8, True), ([20.0] * 7 + [300.0], False), ([20.0] * 7, False)],
    ids=["eight alike", "a long one", "seven"],
)
def test_about_a_quarter_of_the_motion_is_left_out(lengths: list[float], whole: bool) -> None:
    windows = windows_of([run_of(f"log{k}", x) for k, x in enumerate(lengths)], 4.0)
    fitted, left = split(windows, np.ones((len(windows), 2)))
    assert 0.15 < len(left) / len(windows) < 0.35
    shared = {w.run.name for w in fitted} & {w.run.name for w in left}
    assert (not shared) is whole


def test_what_few_windows_show_is_fitted_and_left_out() -> None:
    windows = windows_of([run_of("log", 80.0)], 4.0)
    misfit = np.ones((len(windows), 2))
    misfit[[3, 8], 0] = misfit[[4, 5], 1] = 9.0
    _, left = split(windows, misfit)
    out = {k for k, w in enumerate(windows) if w in left}
    assert len(out & {3, 8}) == len(out & {4, 5}) == 1


def test_a_part_is_tried_again_beside_one_that_was_added(tmp_path: Path) -> None:
    servo = drawn(np.random.default_rng(7003), stribeck=True, load=True)
    (tmp_path / "bench.urdf").write_text(BENCH_URDF)
    (tmp_path / "bench.toml").write_text(BENCH_FILE)
    pl.DataFrame(log(servo, 60.0, 3, 100.0)).write_parquet(tmp_path / "log.parquet")
    found = steelyard.identify_actuators(tmp_path / "bench.toml", tmp_path / "log.parquet")
    tried = [(one.tried, one.kept) for one in found.law]
    order = [("+ stribeck", False), ("+ load_friction", True), ("+ stribeck", True)]
    assert [one for one in tried if one in order] == order
    # friction that falls with speed is in MJCF that at standstill
    arm = mujoco.MjModel.from_xml_string(actuators_mjcf(found.model).text)
    values = found.model.values
    standstill = float(values["coulomb"][0] + values["stribeck"][0])
    assert arm.dof_frictionloss[0] == pytest.approx(standstill, rel=1e-6)
    assert standstill > 1.2 * values["coulomb"][0]
    assert "Stribeck" not in str(found).partition("not needed")[2].partition("\n")[0]
