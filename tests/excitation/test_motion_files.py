import json
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from steelyard.errors import DataError
from steelyard.excitation.files import read_motion, trajectory_from_dict
from steelyard.excitation.random_fourier import random_fourier
from steelyard.excitation.sampled import SampledMotion
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


def test_json_is_read(robot: Robot, tmp_path: Path) -> None:
    motion = random_fourier(robot, seed=0)
    path = tmp_path / "trajectory.json"
    path.write_text(json.dumps(motion.to_dict()))
    t = np.linspace(0.0, 10.0, 11)
    np.testing.assert_array_equal(read_motion(path, robot).sample(t).q, motion.sample(t).q)


BAD = [
    ("m.json", "{", "not a motion of ours"),
    ("m.json", '{"kind": "spiral"}', "its kind is 'spiral', and the known ones are fourier"),
    ("m.json", '{"kind": ["spiral"]}', "not a motion of ours"),
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
    ("m.json", "[1, 2]", "not a motion of ours"),
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
