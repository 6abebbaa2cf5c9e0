"""Every key of `[excitation.motion]` has its effect, for every kind of motion."""

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from excite.colliding import joint, link, urdf
from excite.tabled import OPEN, arm, designed, model_with_open_friction, problem_of
from oracles import body_positions, pinocchio_model
from steelyard.base.arrays import Array
from steelyard.base.errors import DataError
from steelyard.base.files import write_json
from steelyard.excite.design_problem_from_tables import limits_of
from steelyard.excite.planned.plans_from_tables import PLANS, planned
from steelyard.excite.search.parallel_search import SearchBudget
from steelyard.excite.searched_or_planned_motion import design
from steelyard.excite.trajectories.exact_trajectories import ExactTrajectory
from steelyard.excite.trajectories.fourier import FourierMotion
from steelyard.excite.trajectories.motion_families import FAMILIES
from steelyard.excite.trajectories.trajectory_files import read_motion
from steelyard.model.equations.frame_and_point_kinematics import frame_of
from steelyard.robot.file.excitation_sections import KINDS
from steelyard.robot.file.robot_file import load_robot

FIVE_BAR = urdf(
    link("base"),
    *(link(f"l{k}") for k in range(1, 5)),
    link("tip"),
    joint("base", "l1", "0 0 0", "0 0 1"),
    joint("base", "l2", "0 0 0", "0 0 1", rpy="0 0 2"),
    joint("l2", "l3", "0.4 0 0", "0 0 1"),
    joint("l1", "l4", "0.3 0 0", "0 0 1"),
    joint("l4", "tip", "0.4 0 0", kind="fixed"),
)
FIVE_BAR_TABLES = """[robot]
urdf = "five_bar.urdf"
joints = ["l1_joint", "l2_joint"]
[[robot.loops]]
links = ["l3", "l4"]
points = [[0.3, 0.0, 0.0], [0.4, 0.0, 0.0]]
[robot.assembly]
l1_joint = 0.3
l2_joint = 0.0
l3_joint = -1.7
l4_joint = 1.7
[model]
terms = ["rigid_body", "viscous"]
[excitation.workspace]
frame = "tip"
[excitation.limits]
effort = "any"
"""

ANY = f'{OPEN}[excitation.limits]\neffort = "any"\n'
ALONE = "[excitation.motion]\n"


def table(kind: str, **keys: Any) -> str:
    """The motion's table."""
    lines = [f"{key} = {str(value).lower()}" for key, value in keys.items()]
    return "\n".join([ALONE + f'kind = "{kind}"', *lines, ""])


def test_every_kind_is_searched_or_planned() -> None:
    assert sorted([*FAMILIES, *PLANS]) == sorted(KINDS)
    assert not set(FAMILIES) & set(PLANS)


def test_a_table_without_kind_is_a_fourier_series(tmp_path: Path) -> None:
    basis = problem_of(tmp_path, f"{ANY}{ALONE}period = 20.0\n").basis
    motion = basis.motion(basis.still(np.zeros(basis.joints)))
    assert isinstance(motion, FourierMotion) and motion.rests and basis.duration == 20.0
    assert problem_of(tmp_path, ANY).basis.duration == 10.0


AT = "{boom_joint = 0.4}"


@pytest.mark.parametrize(
    ("kind", "keys", "duration", "highest", "count"),
    [
        ("fourier", {"period": 6.0, "harmonics": 4}, 6.0, 4 / 6.0, 7),
        ("raw_fourier", {"period": 6.0, "harmonics": 4}, 6.0, 4 / 6.0, 9),
        (
            "blended_fourier",
            {"period": 6.0, "harmonics": 4, "periods": 2, "blend": 0.5},
            13.0,
            2.0,
            9,
        ),
        (
            "ramped_fourier",
            {"period": 6.0, "harmonics": 4, "periods": 3, "ramp": 2.0},
            18.0,
            4 / 6 + 0.25,
            9,
        ),
        ("spline", {"duration": 7.0, "points": 12, "degree": 3}, 7.0, 0.5 * 9 / 7.0, 7),
        ("reaching", {"targets": 4, "move": 0.8, "dwell": 0.3}, 4 * 1.1, None, 4),
    ],
)
def test_families(
    tmp_path: Path,
    kind: str,
    keys: dict[str, Any],
    duration: float,
    highest: float | None,
    count: int,
) -> None:
    basis = problem_of(tmp_path, ANY + table(kind, **keys)).basis
    assert basis.duration == pytest.approx(duration)
    assert highest is None or basis.highest == pytest.approx(highest)
    assert basis.count == count
    for key, value in keys.items():
        other = problem_of(tmp_path, ANY + table(kind, **keys | {key: _other(key, value)})).basis
        t = np.linspace(0.0, min(basis.duration, other.duration), 7)
        same = basis.count == other.count and basis.duration == other.duration
        assert not same or not np.allclose(basis.shapes(t, 0), other.shapes(t, 0))


def _other(key: str, value: Any) -> Any:
    return {"degree": 5}.get(key, 2 * value)


@pytest.mark.parametrize("kind", [kind for kind in FAMILIES if kind != "raw_fourier"])
def test_a_start_posture(tmp_path: Path, kind: str) -> None:
    basis = problem_of(tmp_path, f'{ANY}{ALONE}kind = "{kind}"\nstart = {AT}\n').basis
    x = np.random.default_rng(0).standard_normal((3, basis.count))
    motion = basis.motion(x)
    np.testing.assert_allclose(motion.derivative([0.0], 0)[0], [0.0, 0.4, 0.0], atol=1e-12)
    np.testing.assert_allclose(motion.derivative([0.0], 1)[0], 0.0, atol=1e-12)


@pytest.mark.parametrize("kind", ["fourier", "spline"])
def test_an_end_posture(tmp_path: Path, kind: str) -> None:
    ends = f"start = {AT}\nend = [0.1, 0.2, 0.3]\n"
    basis = problem_of(tmp_path, f'{ANY}{ALONE}kind = "{kind}"\n{ends}').basis
    motion = basis.motion(np.random.default_rng(0).standard_normal((3, basis.count)))
    end = motion.derivative([motion.duration], 0)[0]
    np.testing.assert_allclose(end, [0.1, 0.2, 0.3], atol=1e-12)


@pytest.mark.slow
def test_a_ramped_design(tmp_path: Path) -> None:
    keys = {"period": 4.0, "harmonics": 3, "ramp": 1.5}
    found = designed(tmp_path, ANY + table("ramped_fourier", **keys))
    motion = found.trajectory
    assert found.certificate.holds and motion.duration == 4.0
    for order in (1, 2):
        np.testing.assert_allclose(motion.derivative([0.0, 4.0], order), 0.0, atol=1e-9)
    write_json(tmp_path / "trajectory.json", motion.to_dict())
    again = read_motion(tmp_path / "trajectory.json", found.robot)
    t = np.linspace(0.0, 4.0, 50)
    np.testing.assert_array_equal(again.derivative(t, 0), motion.derivative(t, 0))


def plan(folder: Path, tables: str, seed: int = 0) -> ExactTrajectory:
    loaded = arm(folder, tables)
    limits = limits_of(loaded.robot, loaded.excitation.limits)
    return planned(loaded, limits, seed)[0]


def path_of(folder: Path, motion: ExactTrajectory, point: Array | None = None) -> Array:
    """Where the tool is all along, by Pinocchio, shape `(N, 3)` [m]."""
    robot = arm(folder).robot
    model, of = pinocchio_model(robot), frame_of(robot, "tool")
    data, places = model.createData(), []
    offset = np.zeros(3) if point is None else point
    for q in motion.derivative(np.linspace(0.0, motion.duration, 2001), 0):
        pin.forwardKinematics(model, data, body_positions(robot, q))
        places.append(data.oMi[of.body + 1].act(of.rotation @ offset + of.position))
    return np.array(places)


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], ExactTrajectory]:
    """The motion of a table, planned once."""
    folder = tmp_path_factory.mktemp("plain")
    return cache(lambda motion: plan(folder, OPEN + motion))


SQUARE = {"centre": [0.45, 0.15, 0.35], "side": 0.12}


def corners(places: Array) -> Array:
    return np.array([places.min(axis=0), places.max(axis=0)])


def test_square(tmp_path: Path) -> None:
    motion = plan(tmp_path, OPEN + table("square", **SQUARE, laps=1))
    box = corners(path_of(tmp_path, motion))
    np.testing.assert_allclose(box, [[0.39, 0.09, 0.35], [0.51, 0.21, 0.35]], atol=2e-3)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("key", "value", "longer"),
    [
        ("laps", 2, True),
        ("dwell", 0.3, True),
        ("speed", 0.2, True),
        ("acceleration", 0.1, True),
        ("side", 0.06, False),
        ("centre", [0.4, 0.15, 0.35], None),
        ("tool_axis", [0.0, 0.2, 1.0], None),
    ],
)
def test_keys_of_a_square(
    tmp_path: Path,
    plain: Callable[[str], ExactTrajectory],
    key: str,
    value: Any,
    longer: bool | None,
) -> None:
    usual = SQUARE | {"laps": 1, "speed": 0.5}
    first = plain(table("square", **usual))
    if key == "tool_axis":
        with pytest.raises(Exception, match="attitude|reach"):
            plan(tmp_path, OPEN + table("square", **usual | {key: value}))
        return
    other = plan(tmp_path, OPEN + table("square", **usual | {key: value}))
    if longer is None:
        shift = corners(path_of(tmp_path, other)) - corners(path_of(tmp_path, first))
        np.testing.assert_allclose(shift[:, 0], -0.05, atol=2e-3)
    else:
        assert (other.duration > 1.02 * first.duration) == longer
        assert (other.duration < 0.98 * first.duration) == (not longer)


def test_the_point_of_the_tool_is_led(tmp_path: Path) -> None:
    tool = "[excitation.workspace]\npoint = [0.0, 0.0, 0.06]\n"
    motion = plan(tmp_path, OPEN + tool + table("square", **SQUARE, laps=1))
    box = corners(path_of(tmp_path, motion, np.array([0.0, 0.0, 0.06])))
    np.testing.assert_allclose(box, [[0.39, 0.09, 0.35], [0.51, 0.21, 0.35]], atol=2e-3)


PICK = {
    "pick": "{x = [0.4, 0.5], y = [0.1, 0.2], z = [0.3, 0.3]}",
    "place": "{x = [0.4, 0.5], y = [-0.2, -0.1], z = [0.3, 0.3]}",
    "cycles": 2,
}


@pytest.mark.slow
def test_pick_and_place(tmp_path: Path) -> None:
    motion = plan(tmp_path, OPEN + table("pick_and_place", **PICK, lift=0.08))
    places = path_of(tmp_path, motion)
    low = places[places[:, 2] < 0.301]
    assert np.all((np.abs(low[:, 1]) > 0.099) & (np.abs(low[:, 1]) < 0.201))
    assert {-1.0, 1.0} == set(np.sign(low[:, 1]))
    assert places[:, 2].max() >= 0.38 - 1e-3
    again = plan(tmp_path, OPEN + table("pick_and_place", **PICK, lift=0.08), seed=1)
    assert again.duration != motion.duration


@pytest.mark.slow
@pytest.mark.parametrize(
    "change",
    [{"cycles": 2}, {"lift": 0.0}, {"path": '"joint"'}, {"dwell": 0.5}, {"speed": 0.1}],
)
def test_keys_of_pick_and_place(
    tmp_path: Path, plain: Callable[[str], ExactTrajectory], change: dict[str, Any]
) -> None:
    once = PICK | {"cycles": 1}
    first = plain(table("pick_and_place", **once))
    other = plan(tmp_path, OPEN + table("pick_and_place", **once | change))
    assert abs(other.duration - first.duration) > 0.01 * first.duration


def test_an_open_box_to_pick_from(tmp_path: Path) -> None:
    with pytest.raises(Exception, match="the box 'pick' is open"):
        plan(tmp_path, OPEN + table("pick_and_place", **PICK | {"pick": "{x = [0.4, 0.5]}"}))


def test_waypoints(tmp_path: Path) -> None:
    points = [[0.4, 0.1, 0.3], [0.5, 0.1, 0.4], [0.45, -0.1, 0.35]]
    keys = {"points": points, "dwell": 0.2}
    motion = plan(tmp_path, OPEN + table("waypoints", **keys))
    places = path_of(tmp_path, motion)
    for point in points:
        assert np.linalg.norm(places - point, axis=1).min() < 2e-3
    bent = plan(tmp_path, OPEN + table("waypoints", **keys, path='"joint"'))
    assert bent.duration != motion.duration
    assert plan(tmp_path, OPEN + table("waypoints", **keys, speed=0.1)).duration > motion.duration


CIRCLE = {"centre": [0.45, 0.1, 0.35], "radius": 0.06}
REACHING = {"home": [0.45, 0.1, 0.35], "radius": 0.06, "targets": 4}


def tool_at(folder: Path, motion: ExactTrajectory, t: float) -> Array:
    """Where the tool is at a time, shape `(3,)` [m]."""
    places = path_of(folder, motion)
    return np.asarray(places[round(t / motion.duration * (len(places) - 1))])


def test_circle(tmp_path: Path) -> None:
    motion = plan(tmp_path, OPEN + table("circle", **CIRCLE, period=4.0, laps=1, ramp=2.0))
    assert motion.duration == pytest.approx(6.0)
    box = corners(path_of(tmp_path, motion))
    np.testing.assert_allclose(box, [[0.39, 0.04, 0.35], [0.51, 0.16, 0.35]], atol=2e-5)
    np.testing.assert_allclose(tool_at(tmp_path, motion, 0.0), [0.51, 0.1, 0.35], atol=1e-7)


@pytest.mark.parametrize(
    ("change", "duration"),
    [
        ({"period": 6.0}, 13.0),
        ({"laps": 3}, 16.0),
        ({"ramp": 4.0}, 14.0),
        ({"radius": 0.03}, 11.0),
        ({"normal": [1.0, 0.0, 0.0]}, 11.0),
        ({"angle": 1.0}, 11.0),
        ({"start": [0.2, -1.0, 2.0]}, 11.0),
        ({"start": [0.2, 1.0, -2.0]}, 11.0),
        ({"tool_axis": [0.0, 0.0, 1.0]}, None),
    ],
)
def test_keys_of_a_circle(
    tmp_path: Path,
    plain: Callable[[str], ExactTrajectory],
    change: dict[str, Any],
    duration: float | None,
) -> None:
    if duration is None:
        with pytest.raises(DataError, match="start of the path is out of reach"):
            plan(tmp_path, OPEN + table("circle", **CIRCLE | change))
        return
    first = plain(table("circle", **CIRCLE, start=[0.2, -1.0, 2.0]))
    assert first.duration == pytest.approx(11.0)
    other = plan(tmp_path, OPEN + table("circle", **CIRCLE | change))
    assert other.duration == pytest.approx({"period": 13.0}.get(next(iter(change)), duration))
    t = np.linspace(0.0, 11.0, 40)
    same = np.allclose(other.derivative(t, 0), first.derivative(t, 0), atol=1e-6)
    assert same == (change.get("start") == [0.2, -1.0, 2.0])


@pytest.mark.slow
def test_cartesian_reaching(tmp_path: Path) -> None:
    keys = {"move": 0.8, "dwell": 0.2, "cycles": 2, "angle": 0.5}
    motion = plan(tmp_path, OPEN + table("cartesian_reaching", **REACHING, **keys))
    assert motion.duration == pytest.approx(2 * 4 * 2 * 1.0)
    for cycle in range(2):
        for k in range(4):
            angle = 0.5 + 0.5 * np.pi * k
            target = [0.45 + 0.06 * np.cos(angle), 0.1 + 0.06 * np.sin(angle), 0.35]
            at = 8.0 * cycle + 2.0 * k
            np.testing.assert_allclose(tool_at(tmp_path, motion, at + 0.9), target, atol=1e-6)
            back = tool_at(tmp_path, motion, at + 1.9)
            np.testing.assert_allclose(back, REACHING["home"], atol=1e-6)
    given = [[0.5, 0.1, 0.4], [0.45, 0.2, 0.3]]
    listed = {"home": REACHING["home"], "targets": given, "move": 0.8, "dwell": 0.2}
    motion = plan(tmp_path, OPEN + table("cartesian_reaching", **listed))
    assert motion.duration == pytest.approx(4.0)
    np.testing.assert_allclose(tool_at(tmp_path, motion, 2.9), given[1], atol=1e-6)
    tilted = table("cartesian_reaching", **REACHING, normal=[0.0, 1.0, 0.0], move=0.8, dwell=0.2)
    at = tool_at(tmp_path, plan(tmp_path, OPEN + tilted), 2.9)
    np.testing.assert_allclose(at, [0.45, 0.1, 0.29], atol=1e-6)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"radius": None}, "4 targets without a radius"),
        ({"targets": [[0.5, 0.1, 0.4]]}, "have no effect where the targets are positions"),
        ({"targets": [[0.45, 0.1, 0.35]], "radius": None}, "differs from the one before"),
        ({"normal": [0.0, 0.0, 0.0]}, "has no direction"),
    ],
)
def test_reaches_that_cannot_be(tmp_path: Path, change: dict[str, Any], words: str) -> None:
    keys = {name: value for name, value in (REACHING | change).items() if value is not None}
    with pytest.raises(DataError, match=words):
        plan(tmp_path, OPEN + table("cartesian_reaching", **keys))


@pytest.mark.slow
def test_a_circle_that_is_too_fast_is_written_but_not_proven(tmp_path: Path) -> None:
    found = designed(tmp_path, ANY + table("circle", **CIRCLE, period=0.5, ramp=0.5))
    assert not found.certificate.holds
    (note,) = (note for note in found.notes if "exceeds its limit" in note)
    factor = float(note.split(" times the time")[0].split()[-1])
    slow = table("circle", **CIRCLE, period=0.501 * factor, ramp=0.501 * factor)
    assert designed(tmp_path, ANY + slow).certificate.holds


@pytest.mark.slow
def test_a_five_bar_is_designed_for_from_its_robot_file(tmp_path: Path) -> None:
    (tmp_path / "five_bar.urdf").write_text(FIVE_BAR, encoding="utf-8")
    motion = table("circle", centre=[0.0, 0.4, 0.0], radius=0.2, period=7.2, ramp=7.2)
    text = FIVE_BAR_TABLES + motion
    (tmp_path / "robot.toml").write_text(text, encoding="utf-8")
    loaded = load_robot(tmp_path / "robot.toml")
    found = design(
        (loaded, model_with_open_friction(loaded), None),
        SearchBudget(60.0, searches=1, processes=1),
    )
    assert found.certificate.holds and found.trajectory.duration == pytest.approx(21.6)
    assert any("loop closure is checked at samples" in note for note in found.notes)


def test_sweeps(tmp_path: Path) -> None:
    motion = plan(tmp_path, OPEN + table("sweeps", speeds=2, slowest=0.5, start=AT))
    t = np.linspace(0.0, motion.duration, 20001)
    speeds = motion.derivative(t, 1)
    assert np.count_nonzero(np.abs(speeds) > 1e-6, axis=1).max() == 1
    np.testing.assert_allclose(motion.derivative([0.0], 0)[0], [0.0, 0.4, 0.0], atol=1e-12)
    for k in range(3):
        steady = np.abs(motion.derivative(t, 2)[:, k]) < 1e-9
        found = np.unique(np.round(np.abs(speeds[steady, k]), 6))
        found = found[found > 1e-6]
        assert len(found) == 2 and found[0] == pytest.approx(0.5 * found[1], rel=1e-5)
    more = plan(tmp_path, OPEN + table("sweeps", speeds=4, slowest=0.5))
    assert more.duration > motion.duration


def test_a_start_of_sweeps_outside_is_refused_with_its_joint(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"outside the range of joint '\w+' by"):
        plan(tmp_path, OPEN + table("sweeps", start=[0.0, 90.0, 0.0]))


def test_postures(tmp_path: Path) -> None:
    motion = plan(tmp_path, OPEN + table("postures", count=4, dwell=0.7))
    t = np.linspace(0.0, motion.duration, 20001)
    still = np.abs(motion.derivative(t, 1)).max(axis=1) < 1e-9
    assert still.sum() * t[1] == pytest.approx(4 * 0.7, rel=0.05, abs=2 * 0.7)
    longer = plan(tmp_path, OPEN + table("postures", count=4, dwell=1.7))
    assert longer.duration - motion.duration == pytest.approx(4.0, abs=2.1)
    assert plan(tmp_path, OPEN + table("postures", count=8, dwell=0.7)).duration > motion.duration
    other = plan(tmp_path, OPEN + table("postures", count=4, dwell=0.7), seed=1)
    assert other.duration != motion.duration


@pytest.mark.parametrize("kind", ["sweeps", "postures", "square"])
def test_planned_motions_keep_a_limit_of_jerk(tmp_path: Path, kind: str) -> None:
    keys = SQUARE | {"laps": 1} if kind == "square" else {}
    free = plan(tmp_path, OPEN + table(kind, **keys))
    tables = f"{OPEN}[excitation.limits]\nshare = 1.0\njerk = 3.0\n"
    found = designed(tmp_path, tables + 'effort = "any"\n' + table(kind, **keys))
    assert found.certificate.holds and found.trajectory.duration > free.duration
    assert np.abs(found.trajectory.extremes(3)).max() == pytest.approx(3.0, rel=1e-6)
    assert any("by its jerk" in note for note in found.notes) == (kind != "square")


def test_replay(tmp_path: Path) -> None:
    motion = designed(tmp_path, ANY + table("postures", count=2)).trajectory
    write_json(tmp_path / "before.json", motion.to_dict())
    found = designed(tmp_path, ANY + table("replay", file='"before.json"'))
    assert found.certificate.holds and found.course == () and found.searches == 0
    t = np.linspace(0.0, motion.duration, 50)
    np.testing.assert_array_equal(found.trajectory.derivative(t, 0), motion.derivative(t, 0))
    strict = ANY.replace('"any"\n', '"any"\nvelocity = 0.01\n')
    replayed = designed(tmp_path, strict + table("replay", file='"before.json"'))
    assert not replayed.certificate.holds
    assert any("velocity" in failure for failure in replayed.certificate.failures)
