"""Springs against the gradient of their energy, and against MuJoCo."""

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from invented import mimic
from moving import geared, torque
from steelyard.base.errors import ModelError
from steelyard.model.equations.inverse_dynamics import carried_point
from steelyard.model.laws.laws_without_friction import GravityCompensator, Spring
from steelyard.model.laws.register import term_of
from steelyard.model.terms.term import Term
from steelyard.robot.models.mjcf import read_mjcf
from steelyard.robot.robot import Robot
from steelyard.robot.robot_from_mechanism import reduced

POINTS = ((0.3, -0.4, 1.2), (0.1, 0.2, -0.3))
STIFFNESS, PRELOAD = 700.0, 250.0


def at(term: Term, robot: Robot, q: np.ndarray, values: Any) -> np.ndarray:
    """Torque at positions, shape `(n, N)`."""
    still = np.zeros_like(q)
    return torque(term, robot, np.stack([q, still, still]), values)


def gradient(energy: Any, q: np.ndarray) -> np.ndarray:
    """Slopes of an energy of `(n, N)` positions, by differences of fourth order."""
    slopes = np.empty_like(q)
    for joint in range(len(q)):
        step = np.zeros((len(q), 1))
        step[joint] = 1e-3
        near, far = (energy(q + k * step) - energy(q - k * step) for k in (1, 2))
        slopes[joint] = (8.0 * near - far) / 12e-3
    return slopes


def positions(n: int, count: int = 20) -> np.ndarray:
    return np.random.default_rng(1).uniform(-1.5, 1.5, (n, count))


@pytest.mark.parametrize(
    "spring",
    [Spring(free=0.3), Spring(free=(0.1, 0.2, -0.3, 0.0)), Spring(motors=("motor4",), free=-5.0)],
    ids=str,
)
def test_a_spring_holds_against_its_energy(spring: Spring) -> None:
    robot, q = geared(), positions(4)
    axes = spring.axes(robot)
    stiffness = np.arange(1.0, len(axes) + 1)

    def energy(at: np.ndarray) -> np.ndarray:
        stretch = np.array([axis.row for axis in axes]) @ at - np.reshape(spring.free, (-1, 1))
        return np.asarray(0.5 * stiffness @ stretch**2)

    found = at(spring, robot, q, stiffness)
    assert np.allclose(found, gradient(energy, q), rtol=1e-8, atol=1e-8)


def test_an_unknown_free_angle_is_a_preload() -> None:
    robot, q = geared(), positions(4)
    joints = ("left_joint", "tip_joint")
    unknown = at(Spring(joints=joints, free="unknown"), robot, q, [3.0, 5.0, 3.0 * 0.2, 5.0 * -0.7])
    known = at(Spring(joints=joints, free=(0.2, -0.7)), robot, q, [3.0, 5.0])
    assert np.allclose(unknown, known, atol=1e-13)
    parameters = Spring(joints=joints, free="unknown").parameters(robot)
    assert [(p.name, p.unit, p.lower) for p in parameters[1:3]] == [
        ("spring.tip_joint", "N m/rad", 0.0),
        ("spring_preload.left_joint", "Nm", -np.inf),
    ]


@pytest.mark.parametrize(
    "links", [("base", "tool"), ("slider", "left"), ("trunk", "tip"), ("tool", "base")]
)
def test_a_compensator_holds_against_its_energy(links: tuple[str, str]) -> None:
    robot, q = geared(), positions(4)
    term = GravityCompensator(links=links, points=POINTS)

    def energy(at: np.ndarray) -> np.ndarray:
        length, _ = term.length(robot, list(at))
        return np.asarray(0.5 * STIFFNESS * length**2 - PRELOAD * length)

    found = at(term, robot, q, [STIFFNESS, PRELOAD])
    assert np.allclose(found, gradient(energy, q), rtol=1e-8, atol=1e-7)


def test_only_joints_between_the_points_bear_it() -> None:
    robot = geared()
    q = list(positions(4))
    _, slopes = GravityCompensator(links=("slider", "left"), points=POINTS).length(robot, q)
    assert sorted(slopes) == [1, 2]


def test_followers_count_for_their_master(tmp_path: Path) -> None:
    robot = mimic(tmp_path)
    term = GravityCompensator(links=("base", "follower"), points=((1.0, 0.3, 0.5), (0.2, 0.1, 0.0)))
    q = positions(1)
    found = at(term, robot, q, [STIFFNESS, 0.0])

    def energy(at: np.ndarray) -> np.ndarray:
        return np.asarray(0.5 * STIFFNESS * term.length(robot, list(at))[0] ** 2)

    assert np.allclose(found, gradient(energy, q), rtol=1e-8)


def test_points_that_meet_give_finite_torques() -> None:
    """At positions zero both ends are at one place, where the length has no slope."""
    robot, q = geared(), np.zeros((4, 1))
    meeting, _ = carried_point(robot, [0.0] * 4, 3, POINTS[1])
    term = GravityCompensator(links=("base", "tip"), points=(tuple(map(float, meeting)), POINTS[1]))
    assert term.length(robot, list(q))[0][0] < 1e-8
    with np.errstate(all="raise"):
        found = at(term, robot, q, [STIFFNESS, 0.0])
    assert np.allclose(found, 0.0, atol=1e-5)
    assert np.isfinite(at(term, robot, q, [0.0, PRELOAD])).all()


MJCF = """
<mujoco>
  <option gravity="0 0 0"/>
  <worldbody>
    <site name="far" pos="-0.4 0.1 0.2"/>
    <body name="upper" pos="0 0 0.5" euler="10 20 30">
      <joint name="shoulder" axis="0 1 0.2" stiffness="30" springref="20"/>
      <inertial pos="0.1 0 0" mass="2" diaginertia="0.02 0.03 0.04"/>
      <body name="slide" pos="0.3 0 0.1" euler="0 40 0">
        <joint name="reach" type="slide" axis="1 0 0.5" stiffness="50" springref="0.1"/>
        <inertial pos="0 0 0.1" mass="1" diaginertia="0.01 0.01 0.01"/>
        <body name="hand" pos="0 0.1 0.2">
          <joint name="wrist" axis="1 0 0"/>
          <inertial pos="0 0.1 0" mass="0.5" diaginertia="0.001 0.001 0.001"/>
          <body name="finger" pos="0.05 0 0.1" euler="30 0 10"><site name="near" pos="0.1 0.2 0"/>
            <inertial pos="0 0 0.1" mass="0.1" diaginertia="0.001 0.001 0.001"/></body>
        </body>
      </body>
    </body>
  </worldbody>
  <tendon><spatial name="band" stiffness="700" springlength="0.3"><site site="far"/>
    <site site="near"/></spatial></tendon>
</mujoco>
"""


def mujoco_torque(path: Path, q: np.ndarray, tendon: bool) -> np.ndarray:
    """What motors must give against MuJoCo's springs: of the tendon, or of the joints."""
    model = mujoco.MjModel.from_xml_path(str(path))
    if tendon:
        model.jnt_stiffness[:] = 0.0
    else:
        model.tendon_stiffness[:] = 0.0
    data, efforts = mujoco.MjData(model), []
    for sample in q.T:
        data.qpos[:] = sample
        mujoco.mj_forward(model, data)
        efforts.append(-data.qfrc_passive)
    return np.array(efforts).T


def test_springs_are_those_of_mujoco(tmp_path: Path) -> None:
    path = tmp_path / "springs.xml"
    path.write_text(MJCF)
    robot, _ = reduced(read_mjcf(path))
    q = positions(3)
    band = GravityCompensator(links=("world", "finger"), points=((-0.4, 0.1, 0.2), (0.1, 0.2, 0.0)))
    found = at(band, robot, q, [700.0, 700.0 * 0.3])
    expected = mujoco_torque(path, q, tendon=True)
    assert np.abs(found - expected).max() < 1e-9 * np.abs(expected).max()
    springs = Spring(joints=("shoulder", "reach"), free=(np.deg2rad(20.0), 0.1))
    found = at(springs, robot, q, [30.0, 50.0])
    assert np.allclose(found, mujoco_torque(path, q, tendon=False), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({}, "without its geometry: `links` is missing"),
        ({"links": ["base", "tool"]}, "without its geometry: `points` is missing"),
        ({"links": ["base"], "points": POINTS}, r"between the links \('base',\)"),
        ({"links": ["base", "tool"], "points": [[0, 0, 0]]}, "between the points"),
        ({"links": ["base", "tool"], "points": [[0, 0, 0], ["a", 0, 0]]}, "between the points"),
    ],
)
def test_a_compensator_needs_its_geometry(fields: Any, words: str) -> None:
    with pytest.raises(ModelError, match=words) as caught:
        term_of({"law": "gravity_compensator", **fields}, "robot.toml")
    assert 'links = ["base", "upper_arm"]' in caught.value.fix


def test_links_of_a_compensator_exist_and_move() -> None:
    wrong = GravityCompensator(links=("base", "tol"), points=POINTS)
    with pytest.raises(ModelError, match="link 'tol'") as caught:
        at(wrong, geared(), positions(4), 1.0)
    assert "'tool'" in caught.value.fix
    rigid = GravityCompensator(links=("tip", "tool"), points=POINTS)
    with pytest.raises(ModelError, match="which move as one"):
        at(rigid, geared(), positions(4), 1.0)


@pytest.mark.parametrize("free", ["unknwon", float("nan"), [0.1, "a"]])
def test_free_positions_are_numbers(free: Any) -> None:
    with pytest.raises(ModelError, match="term 'spring' has free") as caught:
        term_of({"law": "spring", "free": free}, "robot.toml")
    assert 'free = "unknown"' in caught.value.fix


def test_free_positions_fit_the_coordinates() -> None:
    with pytest.raises(ModelError, match="has 2 free positions for 4 coordinates"):
        at(Spring(free=(0.1, 0.2)), geared(), positions(4), 1.0)
