"""Every key of the tables on limits, workspace, collision, loads and search has its effect."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from excite.colliding import link, urdf, written
from excite.tabled import OPEN, arm, designed, model_with_open_friction, problem_of
from oracles import body_positions, pinocchio_model, pinocchio_torque
from steelyard.base.arrays import Array
from steelyard.base.errors import ModelError
from steelyard.excite.constraints.constraint_and_limits import Constraint
from steelyard.excite.design_problem_from_tables import build
from steelyard.excite.search.search_methods import METHODS
from steelyard.model.equations.frame_and_point_kinematics import frame_of
from steelyard.robot.robot import Robot

Q, DQ, DDQ = np.array([[0.4, -0.6, 0.9], [0.3, -0.5, 0.8], [1.0, -2.0, 0.7]])[:, None, :]


def margin(constraint: Constraint, label: str) -> float:
    values = constraint.margins(Q, DQ, DDQ).values[0]
    return float(values[constraint.labels.index(label)])


def only(folder: Path, tables: str) -> Constraint:
    """The one constraint of tables without collisions."""
    (found,) = problem_of(folder, OPEN + tables).constraints
    return found


def place(robot: Robot, frame: str, point: Array) -> Array:
    """Pinocchio's word on where a point of a frame is at `Q`."""
    model = pinocchio_model(robot)
    data, of = model.createData(), frame_of(robot, frame)
    pin.forwardKinematics(model, data, body_positions(robot, Q[0]))
    carrier = data.oMi[of.body + 1]
    return np.asarray(carrier.act(of.rotation @ point + of.position))


@pytest.mark.parametrize(
    ("tables", "name", "expected"),
    [
        ("", "velocity", [2.85] * 3),
        ("share = 0.5", "velocity", [1.5] * 3),
        ("share = 0.5", "acceleration", [2.5] * 3),
        ("velocity = 2.0", "velocity", [1.9] * 3),
        ("velocity = [1.0, 2.0, 3.0]", "velocity", [0.95, 1.9, 2.85]),
        ("velocity = {boom_joint = 1.0}", "velocity", [2.85, 0.95, 2.85]),
        ("acceleration = 10.0", "acceleration", [9.5] * 3),
        ("acceleration = {stick_joint = 1.0}", "acceleration", [4.75, 4.75, 0.95]),
        ("share = 1.0\njerk = 50.0", "jerk", [50.0] * 3),
        ("jerk = {boom_joint = 50.0}", "jerk", [0.95e6, 47.5, 0.95e6]),
        ("", "upper", [2.4] * 3),
        ("position_margin = 0.5", "upper", [2.0] * 3),
        ("position_margin = 0.0", "lower", [-2.5] * 3),
        ("share = 0.5", "lower", [-2.4] * 3),
    ],
)
def test_limits_of_joints(tmp_path: Path, tables: str, name: str, expected: list[float]) -> None:
    limits = problem_of(tmp_path, f"{OPEN}[excitation.limits]\n{tables}\n").limits
    np.testing.assert_allclose(getattr(limits, name), expected, rtol=1e-12)


def test_jerk_is_free_unless_it_is_limited(tmp_path: Path) -> None:
    assert problem_of(tmp_path, OPEN).limits.jerk is None


@pytest.mark.parametrize(
    ("tables", "most"),
    [
        ("", 0.95 * 60.0),
        ("share = 0.5", 30.0),
        ("effort = 20.0", 19.0),
        ("effort = [10.0, 20.0, 30.0]", 19.0),
        ("effort = {boom_joint = 40.0}", 38.0),
    ],
)
def test_torque_by_pinocchio(tmp_path: Path, tables: str, most: float) -> None:
    torque = only(tmp_path, f"[excitation.limits]\n{tables}\n")
    label = f"torque of 'boom_joint' below {most:g} Nm"
    expected = most - pinocchio_torque(arm(tmp_path).robot, Q[0], DQ[0], DDQ[0])[1]
    assert margin(torque, label) == pytest.approx(expected, rel=1e-9)


def test_a_table_of_efforts_leaves_the_other_joints_as_they_are(tmp_path: Path) -> None:
    torque = only(tmp_path, "[excitation.limits]\neffort = {boom_joint = 40.0}\n")
    assert "torque of 'stick_joint' below 57 Nm" in torque.labels


def test_any_effort(tmp_path: Path) -> None:
    problem = problem_of(tmp_path, f'{OPEN}[excitation.limits]\neffort = "any"\n')
    assert problem.constraints == ()


@pytest.mark.parametrize(
    ("tables", "label"),
    [
        ("power = 30.0", "power of 'boom_joint' below 30 W"),
        ("power = {boom_joint = 30.0}", "power of 'boom_joint' below 30 W"),
        ("total_power = 30.0", "power of all joints below 30 W"),
    ],
)
def test_power_by_pinocchio(tmp_path: Path, tables: str, label: str) -> None:
    power = only(tmp_path, f'[excitation.limits]\neffort = "any"\n{tables}\n')
    each = pinocchio_torque(arm(tmp_path).robot, Q[0], DQ[0], DDQ[0]) * DQ[0]
    taken = each.sum() if "total" in tables else each[1]
    assert margin(power, label) == pytest.approx(30.0 - taken, rel=1e-9)
    assert any("stick_joint" in other for other in power.labels) == (tables == "power = 30.0")


def test_loads_are_cases_of_torque(tmp_path: Path) -> None:
    load = '[[excitation.loads]]\nmass = 2.0\nframe = "tool"\ncom = [0.1, 0.0, 0.2]\n'
    torque = only(tmp_path, load)
    robot = arm(tmp_path).robot
    weight = np.zeros(3)
    step = 1e-6
    for k in range(3):
        ends = [Q[0] + sign * step * np.eye(3)[k] for sign in (1.0, -1.0)]
        heights = [_height(robot, q, np.array([0.1, 0.0, 0.2])) for q in ends]
        weight[k] = 2.0 * 9.81 * (heights[0] - heights[1]) / (2.0 * step)
    still = np.zeros((1, 3))
    values = dict(zip(torque.labels, torque.margins(Q, still, still).values[0], strict=True))
    torques = "torque of 'boom_joint' below 57 Nm, "
    without = values[f"{torques}without load"]
    heavy = [values[label] for label in values if label.startswith(f"{torques}with load 1, 2 kg")]
    assert [without - x for x in heavy] == pytest.approx(2 * [weight[1]], rel=1e-6)


@pytest.mark.parametrize("share", [0.0, 2.0 / 5.0, 2.0 / 3.0], ids=["point", "solid", "hollow"])
def test_torques_hold_for_loads_from_a_point_to_a_hollow_ball(tmp_path: Path, share: float) -> None:
    load = '[[excitation.loads]]\nmass = 1.0\nframe = "tool"\nradius = 0.4\n'
    torque, robot = only(tmp_path, load), arm(tmp_path).robot
    model, of, ddq = pinocchio_model(robot), frame_of(robot, "tool"), 40.0 * DDQ
    ball = pin.Inertia(1.0, np.array(of.position), share * 0.4**2 * np.eye(3))
    model.inertias[of.body + 1] += ball
    needed = np.array(pin.rnea(model, model.createData(), Q[0], DQ[0], ddq[0]))
    values = torque.margins(Q, DQ, ddq).values[0]
    found = {label: x for label, x in zip(torque.labels, values, strict=True) if "load 1" in label}
    for joint, own in zip(robot.joint_names, needed, strict=True):
        for side, sign in (("below ", 1.0), ("above -", -1.0)):
            start = f"torque of '{joint}' {side}"
            label = next(label for label in found if label.startswith(start))
            limit = float(label.removeprefix(start).split(" Nm")[0])
            margins = [x for label, x in found.items() if label.startswith(start)]
            true = limit - sign * own
            assert len(margins) == 2 and min(margins) - 1e-9 <= true <= max(margins) + 1e-9


def _height(robot: Robot, q: Array, point: Array) -> float:
    model = pinocchio_model(robot)
    data, of = model.createData(), frame_of(robot, "tool")
    pin.forwardKinematics(model, data, body_positions(robot, q))
    return float(data.oMi[of.body + 1].act(of.rotation @ point + of.position)[2])


def test_loads_that_change_nothing_are_reported(tmp_path: Path) -> None:
    load = "[[excitation.loads]]\nmass = 2.0\n"
    idle = problem_of(tmp_path, f'{OPEN}[excitation.limits]\neffort = "any"\n{load}')
    assert any("loads have no effect" in note for note in idle.notes)
    assert not any("have no effect" in x for x in problem_of(tmp_path, OPEN + load).notes)


ANY = '[excitation.limits]\neffort = "any"\n[excitation.workspace]\n'


@pytest.mark.parametrize(
    ("tables", "frame", "point", "radius"),
    [
        ("", "tool", (0.0, 0.0, 0.0), 0.0),
        ('frame = "boom"', "boom", (0.0, 0.0, 0.0), 0.0),
        ("point = [0.1, 0.2, 0.3]", "tool", (0.1, 0.2, 0.3), 0.0),
        ("radius = 0.07", "tool", (0.0, 0.0, 0.0), 0.07),
        (
            'frame = "stick"\npoint = [0.1, 0.0, 0.0]\nradius = 0.02',
            "stick",
            (0.1, 0.0, 0.0),
            0.02,
        ),
    ],
)
def test_the_tool_in_its_box(
    tmp_path: Path, tables: str, frame: str, point: tuple[float, ...], radius: float
) -> None:
    box = only(tmp_path, f"{ANY}{tables}\nbox = {{x = [-0.5, 0.6], z = [0.1, 0.9]}}\n")
    at = place(arm(tmp_path).robot, frame, np.array(point))
    expected = [at[0] + 0.5, 0.6 - at[0], at[2] - 0.1, 0.9 - at[2]]
    values = box.margins(Q, DQ, DDQ).values[0]
    np.testing.assert_allclose(values, np.array(expected) - radius, atol=1e-12)


def test_planes(tmp_path: Path) -> None:
    tables = "planes = [{normal = [0.0, 3.0, 4.0], above = -1.0}]\nonly_tool = true\n"
    at = place(arm(tmp_path).robot, "tool", np.zeros(3))
    values = only(tmp_path, ANY + tables).margins(Q, DQ, DDQ).values[0]
    np.testing.assert_allclose(values, [0.6 * at[1] + 0.8 * at[2] + 0.2], atol=1e-12)


def test_boxes_to_keep_out_of(tmp_path: Path) -> None:
    at = place(arm(tmp_path).robot, "tool", np.zeros(3))
    spans = [f"{axis} = [{x - 0.9:.6f}, {x - 0.3:.6f}]" for axis, x in zip("xyz", at, strict=True)]
    far = only(
        tmp_path, f"{ANY}only_tool = true\nradius = 0.05\nkeep_out = [{{{', '.join(spans)}}}]\n"
    )
    assert far.margins(Q, DQ, DDQ).values[0, 0] == pytest.approx(0.3 * 3**0.5 - 0.05, abs=1e-5)


CELL = urdf(link("post", '<sphere radius="0.1"/>', xyz="2.0 0 0.5"), name="cell")


def labels_of(folder: Path, tables: str) -> set[frozenset[str]]:
    """Pairs whose distance is kept."""
    written(folder, CELL, "cell.urdf")
    any_effort = '[excitation.limits]\neffort = "any"\n'
    found = problem_of(folder, f"{any_effort}[excitation.collision]\n{tables}\n").constraints
    return {frozenset(label.split("'")[1::2]) for one in found for label in one.labels}


def pair(one: str, other: str) -> frozenset[str]:
    return frozenset({one, other})


def test_pairs_that_are_looked_at(tmp_path: Path) -> None:
    own = {pair("base", "boom"), pair("base", "stick"), pair("tower", "stick")}
    every = labels_of(tmp_path, "")
    assert every == own
    assert labels_of(tmp_path, "bodies = false") == set()
    assert labels_of(tmp_path, 'ignore = [["base", "stick"]]') == own - {pair("base", "stick")}
    assert labels_of(tmp_path, 'without = ["stick"]') == {pair("base", "boom")}
    world = {pair(name, "post") for name in ("tower", "boom", "stick")}
    assert labels_of(tmp_path, 'world = "cell.urdf"') - {pair("base", "post")} == own | world
    alone = labels_of(tmp_path, 'world = "cell.urdf"\nbodies = false')
    assert alone - {pair("base", "post")} == world


def test_paths_with_environment_variables(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "cells").mkdir()
    written(tmp_path / "cells", CELL, "cell.urdf")
    monkeypatch.setenv("CELLS", "cells")
    pairs = labels_of(tmp_path, 'world = "${CELLS}/cell.urdf"\nbodies = false')
    assert pair("stick", "post") in pairs
    monkeypatch.delenv("CELLS")
    with pytest.raises(ModelError, match="variable 'CELLS' is not set"):
        labels_of(tmp_path, 'world = "${CELLS}/cell.urdf"')


def test_the_margin_of_clearance(tmp_path: Path) -> None:
    found = []
    for text in ("", "margin = 0.03", "margin = 0.0"):
        tables = f'[excitation.limits]\neffort = "any"\n[excitation.collision]\n{text}\n'
        (clearance,) = problem_of(tmp_path, tables).constraints
        found.append(clearance.margins(Q, DQ, DDQ).values[0])
    np.testing.assert_allclose(found[0] - found[1], 0.02, atol=1e-9)
    np.testing.assert_allclose(found[2] - found[0], 0.01, atol=1e-9)


def test_samples_of_the_figure(tmp_path: Path) -> None:
    tables = f'{OPEN}[excitation.limits]\neffort = "any"\n'
    few = problem_of(tmp_path, f"[excitation]\nsamples = 20\n{tables}")
    many = problem_of(tmp_path, tables)
    assert (few.samples, many.samples) == (20, 1000)
    x = np.random.default_rng(0).standard_normal((3, few.basis.count))
    assert few.criterion_value(x) != many.criterion_value(x)


def test_what_is_assumed_is_noted(tmp_path: Path) -> None:
    notes = problem_of(tmp_path).notes
    assert any("accelerations are kept below 5 rad/s²" in note for note in notes)
    assert any("torques are limited with the values" in note for note in notes)
    given = problem_of(tmp_path, f"{OPEN}[excitation.limits]\nacceleration = 5.0\n").notes
    assert not any("accelerations" in note for note in given)


def test_a_law_with_memory_is_left_out_and_named(tmp_path: Path) -> None:
    loaded = arm(tmp_path, OPEN, terms='"rigid_body", {law = "dahl", length = 0.01}')
    problem = build(loaded, model_with_open_friction(loaded))
    assert any("'dahl' has internal states" in note for note in problem.notes)
    (case,) = problem.cases
    assert not any("dahl" in name for name in case.shows.base.base_names)


@pytest.mark.slow
def test_every_method_is_by_name(tmp_path: Path) -> None:
    assert set(METHODS) == {"gradient", "genetic", "cma_es"}
    seen = {}
    seconds = {"gradient": 60.0, "genetic": 3.0, "cma_es": 3.0}
    for name in METHODS:
        tables = f'[excitation.search]\nmethod = "{name}"\n[excitation.limits]\neffort = "any"\n'
        motion = "[excitation.motion]\nperiod = 4.0\nharmonics = 2\n"
        found = designed(tmp_path, OPEN + tables + motion, seconds=seconds[name])
        assert found.certificate.holds
        seen[name] = found.shown.criterion_value
    assert np.isfinite(list(seen.values())).all() and len(set(seen.values())) == 3
