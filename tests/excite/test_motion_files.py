import json
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from scipy.interpolate import CubicSpline

from steelyard.base.errors import DataError
from steelyard.excite.controller_file_formats import write_export
from steelyard.excite.trajectories.exact_trajectories import (
    SampledMotion,
    end_speeds,
    from_scipy,
)
from steelyard.excite.trajectories.fourier import FourierMotion, random_fourier
from steelyard.excite.trajectories.trajectory_files import (
    read_motion,
    read_table,
    trajectory_from_dict,
    write_motion,
)
from steelyard.robot.robot import Body, Coordinate, Robot


@pytest.fixture
def robot() -> Robot:
    joints = (Coordinate("lift", "prismatic"), Coordinate("elbow", "revolute"))
    bodies = tuple(
        Body(c.name, c.name, c.kind, k - 1, np.eye(3), np.zeros(3), np.array([0.0, 0, 1]), k)
        for k, c in enumerate(joints)
    )
    return Robot("two", bodies, joints)


def table(seconds: float = 4.0) -> tuple[np.ndarray, np.ndarray]:
    t = np.linspace(0.0, seconds, 401)
    wave = 0.5 - 0.5 * np.cos(2 * np.pi * t / seconds)
    return t, np.column_stack([0.1 * wave, 0.4 * wave])


def test_spline_follows_a_known_motion() -> None:
    t, q = table()
    motion = SampledMotion(t + 100.0, q)
    fine = np.linspace(0.0, 4.0, 997)
    w = 2 * np.pi / 4.0
    got = motion.sample(fine)
    assert motion.duration == 4.0
    np.testing.assert_allclose(got.q[:, 1], 0.2 - 0.2 * np.cos(w * fine), atol=1e-9)
    np.testing.assert_allclose(got.dq[:, 1], 0.2 * w * np.sin(w * fine), atol=1e-6)
    np.testing.assert_allclose(got.ddq[:, 1], 0.2 * w**2 * np.cos(w * fine), atol=1e-4)


def test_spline_is_at_rest_outside() -> None:
    t, q = table()
    outside = SampledMotion(t, q + 1.0).sample([-1.0, 0.0, 4.0, 5.0])
    np.testing.assert_allclose(outside.q, 1.0, atol=1e-12)
    np.testing.assert_allclose(outside.dq, 0.0, atol=1e-12)
    assert not outside.ddq[[0, 3]].any()


@pytest.mark.parametrize("t", [[0.0], [0.0, 0.0], [1.0, 0.5]])
def test_time_must_advance(t: list[float]) -> None:
    with pytest.raises(ValueError, match="each later than the one before"):
        SampledMotion(np.array(t), np.zeros((len(t), 1)))


def test_round_trip_of_samples() -> None:
    motion = SampledMotion(*table())
    back = trajectory_from_dict(json.loads(json.dumps(motion.to_dict())))
    assert isinstance(back, SampledMotion)
    np.testing.assert_array_equal(back.q, motion.q)
    np.testing.assert_array_equal(back.t, motion.t)


@pytest.mark.parametrize(
    "names",
    [
        ("time_s", "q1_m", "q2_rad"),
        ("t", "q1", "q2"),
        ("time", "q_lift", "q_elbow"),
        ("Time", "lift", "Elbow"),
    ],
)
@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_tables_are_read(robot: Robot, tmp_path: Path, names: tuple[str, ...], suffix: str) -> None:
    t, q = table()
    frame = pl.DataFrame(dict(zip(names, [t, *q.T], strict=True)) | {"other": ["x"] * len(t)})
    path = tmp_path / f"motion{suffix}"
    frame.write_csv(path) if suffix == ".csv" else frame.write_parquet(path)
    motion = read_motion(path, robot)
    assert isinstance(motion, SampledMotion)
    np.testing.assert_allclose(motion.q, q, atol=1e-15)


def raw() -> FourierMotion:
    """A series that runs through its ends at speed."""
    sine, cosine = np.random.default_rng(2).standard_normal((2, 2, 4)) * 0.1
    return FourierMotion(np.array([0.1, -0.2]), sine, cosine, 6.0, rests=False)


def test_our_own_table_is_the_same_motion(robot: Robot, tmp_path: Path) -> None:
    motion = raw()
    write_export(motion, robot, "csv", tmp_path, 500.0)
    back = read_motion(tmp_path / "trajectory.csv", robot)
    assert np.abs(motion.derivative([0.0], 1)).max() > 0.1
    t = np.linspace(0.0, motion.duration, 2999)
    for order, close in enumerate((1e-10, 1e-7, 1e-4)):
        wanted = motion.derivative(t, order)
        error = np.abs(back.derivative(t, order) - wanted).max()
        assert error < close * np.abs(wanted).max()
    again = trajectory_from_dict(json.loads(json.dumps(back.to_dict())))
    np.testing.assert_array_equal(again.derivative(t, 2), back.derivative(t, 2))


SPEEDS = [("dq1_m_s", "dq2_rad_s"), ("dq1", "dq2"), ("dq_Lift", "DQ_elbow")]


@pytest.mark.parametrize("names", SPEEDS)
def test_speeds_at_the_ends_are_those_of_the_table(
    robot: Robot, tmp_path: Path, names: tuple[str, str]
) -> None:
    t, q = table()
    values = {"t": t, "q1": q[:, 0], "q2": q[:, 1]}
    path = tmp_path / "motion.csv"
    pl.DataFrame(values | {names[0]: t + 0.5, names[1]: -t}).write_csv(path)
    ends = read_motion(path, robot).derivative([0.0, 4.0], 1)
    np.testing.assert_allclose(ends, [[0.5, 0.0], [4.5, -4.0]], atol=1e-9)
    clamped = from_scipy(CubicSpline(t, q, bc_type="clamped"))
    rest: list[dict] = [{}, {names[0]: t + 0.5}, {names[0]: 0 * t, names[1]: 0 * t - 1e-15}]
    for speeds in rest:
        pl.DataFrame(values | speeds).write_csv(path)
        motion, fine = read_motion(path, robot), np.linspace(0.0, 4.0, 99)
        assert "ends" not in motion.to_dict()
        for order in range(4):
            np.testing.assert_array_equal(
                motion.derivative(fine, order), clamped.derivative(fine, order)
            )


def test_a_table_may_begin_and_end_moving(robot: Robot, tmp_path: Path) -> None:
    motion, path = raw(), tmp_path / "part.csv"
    t = 1.0 + np.arange(1001) / 500.0
    values = dict(zip(("time_s", "q1", "q2"), [t, *motion.derivative(t, 0).T], strict=True))
    pl.DataFrame(values).write_csv(path)
    table = read_table(path, robot)
    assert table.start == 1.0 and not table.states_speeds
    for order, close in enumerate((1e-10, 1e-7, 1e-3)):
        wanted = motion.derivative(t, order)
        error = np.abs(table.unstopped.derivative(t - 1.0, order) - wanted).max()
        assert error < close * np.abs(wanted).max()
    assert np.abs(table.motion.derivative([0.0, 2.0], 1)).max() < 1e-9
    speeds = {"dq1": 0.0 * t, "dq2": 0.0 * t}
    pl.DataFrame(values | speeds).write_csv(path)
    stated = read_table(path, robot)
    assert stated.states_speeds and stated.unstopped is stated.motion


def test_speeds_of_ends_at_rest_are_zero() -> None:
    t, q = table()
    assert not end_speeds(t, q).any()
    assert not end_speeds(t[:3], q[100:103]).any()
    moving = end_speeds(t[:301], q[:301])
    assert not moving[0].any()
    np.testing.assert_allclose(moving[1], [-0.05 * np.pi / 2.0, -0.2 * np.pi / 2.0], rtol=1e-5)


def test_json_is_read(robot: Robot, tmp_path: Path) -> None:
    motion = random_fourier(robot, seed=0)
    path = tmp_path / "trajectory.json"
    path.write_text(json.dumps(motion.to_dict()))
    t = np.linspace(0.0, 10.0, 11)
    np.testing.assert_array_equal(read_motion(path, robot).sample(t).q, motion.sample(t).q)


BAD = [
    ("m.json", "{", "not JSON"),
    ("m.json", '{"kind": "spiral"}', "its kind is 'spiral', and the known ones are fourier"),
    ("m.json", '{"kind": ["spiral"]}', "not a steelyard motion"),
    ("m.json", '{"kind": "chained", "times": 1, "parts": [{"kind": "x"}]}', "its kind is 'x'"),
    ("m.json", '{"kind": "chained", "parts": []}', "it has no 'times'"),
    ("m.json", '{"kind": "sampled", "time_s": [0, 1], "q": [[0, 0], [1, NaN]]}', "not finite"),
    ("m.json", '{"kind": "sampled", "time_s": [0, 1e999], "q": [[0, 0], [1, 1]]}', "not finite"),
    (
        "m.json",
        '{"kind": "piecewise", "breaks_s": [0, 1, 2], "coefficients": [[[0, 0]], [[0, 1]]]}',
        "joint 2 jumps by 1 at 1 s",
    ),
    (
        "m.json",
        '{"kind": "fourier", "period_s": 1, "periods": 1, "start": [NaN, 0],'
        ' "sine": [[0], [0]], "cosine": [[0], [0]]}',
        "not finite",
    ),
    (
        "m.json",
        '{"kind": "sampled", "time_s": [0, 1], "q": [[0, 0], [1, 1]], "ends": [[0, 0], [NaN, 0]]}',
        "speed at the motion's start or end is not finite",
    ),
    ("m.csv", "time_s,q1_m,q2_rad,dq1,dq2\n", "two times or more"),
    ("m.json", "[1, 2]", "not a steelyard motion"),
    ("m.json", '{"kind": "sampled", "time_s": [0, 1], "q": [[0], [1]]}', "robot has 2"),
    ("m.parquet", "no parquet", "not a table"),
    ("m.csv", "", "not a table"),
    ("m.csv", "time_s,q1_m\n0,0\n1,1\n", "no column for joint 'elbow'"),
    ("m.csv", "q1_m,q2_rad\n0,0\n1,1\n", "no column for time"),
    ("m.csv", "time_s,q1_m,q2_rad\n0,0,0\n1,oops,1\n", "in row 2"),
    ("m.csv", "time_s,q1_m,q2_rad\n0,0,0\n1,,1\n", "in row 2"),
    ("m.csv", "time_s,q1_m,q2_rad\n0,0,0\n0,1,1\n", "each later than"),
]


@pytest.mark.parametrize("name, text, wrong", BAD)
def test_bad_files_are_refused(
    robot: Robot, tmp_path: Path, name: str, text: str, wrong: str
) -> None:
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(DataError, match=wrong) as caught:
        read_motion(path, robot)
    assert str(path) in caught.value.where


def test_missing_file_and_near_name(robot: Robot, tmp_path: Path) -> None:
    with pytest.raises(DataError, match="does not exist"):
        read_motion(tmp_path / "none.csv", robot)
    path = tmp_path / "m.csv"
    path.write_text("time_s,q1_m,q2_red\n0,0,0\n1,1,1\n")
    with pytest.raises(DataError, match="did you mean 'q2_red'"):
        read_motion(path, robot)


def test_a_motion_of_another_robot_is_refused(tmp_path: Path, robot: Robot) -> None:
    motion = random_fourier(robot, seed=1)
    path = tmp_path / "trajectory.json"
    write_motion(path, motion, robot)
    assert read_motion(path, robot).to_dict() == motion.to_dict()
    other = robot.changed(coordinates=robot.coordinates[::-1])
    with pytest.raises(DataError, match="the motion is for the joints"):
        read_motion(path, other)
