"""Every key of `[excitation.motion]` has its effect, for every kind of motion."""

from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from excitation.tabled import OPEN, arm, designed, problem_of
from oracles import body_positions, pinocchio_model
from steelyard.arrays import Array
from steelyard.excitation.bases.families import FAMILIES
from steelyard.excitation.from_tables import limits_of
from steelyard.excitation.planned.plans import PLANS, planned
from steelyard.excitation.trajectories.exact import ExactTrajectory
from steelyard.excitation.trajectories.files import read_motion
from steelyard.files import write_json
from steelyard.kernel.quantities.kinematics import frame_of
from steelyard.robot_file.motion_sections import KINDS

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
    assert (type(basis).__name__, basis.duration) == ("RestFourier", 20.0)
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


SQUARE = {"centre": [0.45, 0.15, 0.35], "side": 0.12}


def corners(places: Array) -> Array:
    return np.array([places.min(axis=0), places.max(axis=0)])


def test_square(tmp_path: Path) -> None:
    motion = plan(tmp_path, OPEN + table("square", **SQUARE, laps=1))
    box = corners(path_of(tmp_path, motion))
    np.testing.assert_allclose(box, [[0.39, 0.09, 0.35], [0.51, 0.21, 0.35]], atol=2e-3)


@pytest.mark.parametrize(
    ("key", "value", "longer"),
    [
        ("laps", 4, True),
        ("dwell", 1.0, True),
        ("speed", 0.05, True),
        ("acceleration", 0.1, True),
        ("side", 0.06, False),
        ("centre", [0.4, 0.15, 0.35], None),
        ("tool_axis", [0.0, 0.2, 1.0], None),
    ],
)
def test_keys_of_a_square(tmp_path: Path, key: str, value: Any, longer: bool | None) -> None:
    usual = SQUARE | {"laps": 1, "speed": 0.5}
    plain = plan(tmp_path, OPEN + table("square", **usual))
    if key == "tool_axis":
        with pytest.raises(Exception, match="attitude|reach"):
            plan(tmp_path, OPEN + table("square", **usual | {key: value}))
        return
    other = plan(tmp_path, OPEN + table("square", **usual | {key: value}))
    if longer is None:
        shift = corners(path_of(tmp_path, other)) - corners(path_of(tmp_path, plain))
        np.testing.assert_allclose(shift[:, 0], -0.05, atol=2e-3)
    else:
        assert (other.duration > 1.02 * plain.duration) == longer
        assert (other.duration < 0.98 * plain.duration) == (not longer)


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


def test_pick_and_place(tmp_path: Path) -> None:
    motion = plan(tmp_path, OPEN + table("pick_and_place", **PICK, lift=0.08))
    places = path_of(tmp_path, motion)
    low = places[places[:, 2] < 0.301]
    assert np.all((np.abs(low[:, 1]) > 0.099) & (np.abs(low[:, 1]) < 0.201))
    assert {-1.0, 1.0} == set(np.sign(low[:, 1]))
    assert places[:, 2].max() >= 0.38 - 1e-3
    again = plan(tmp_path, OPEN + table("pick_and_place", **PICK, lift=0.08), seed=1)
    assert again.duration != motion.duration


@pytest.mark.parametrize(
    "change",
    [{"cycles": 4}, {"lift": 0.0}, {"path": '"joint"'}, {"dwell": 0.5}, {"speed": 0.1}],
)
def test_keys_of_pick_and_place(tmp_path: Path, change: dict[str, Any]) -> None:
    plain = plan(tmp_path, OPEN + table("pick_and_place", **PICK))
    other = plan(tmp_path, OPEN + table("pick_and_place", **PICK | change))
    assert abs(other.duration - plain.duration) > 0.01 * plain.duration


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


def test_sweeps(tmp_path: Path) -> None:
    motion = plan(tmp_path, OPEN + table("sweeps", speeds=2, slowest=0.5, start=AT))
    t = np.linspace(0.0, motion.duration, 20001)
    speeds = motion.derivative(t, 1)
    assert np.count_nonzero(np.abs(speeds) > 1e-6, axis=1).max() == 1
    np.testing.assert_allclose(motion.derivative([0.0], 0)[0], [0.0, 0.4, 0.0], atol=1e-12)
    for joint in range(3):
        steady = np.abs(motion.derivative(t, 2)[:, joint]) < 1e-9
        found = np.unique(np.round(np.abs(speeds[steady, joint]), 6))
        found = found[found > 1e-6]
        assert len(found) == 2 and found[0] == pytest.approx(0.5 * found[1], rel=1e-5)
    more = plan(tmp_path, OPEN + table("sweeps", speeds=4, slowest=0.5))
    assert more.duration > motion.duration


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
