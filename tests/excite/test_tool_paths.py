"""Circles and reaches of a tool, followed by open and closed chains."""

from collections.abc import Callable

import mujoco
import numpy as np
import pytest

from closed_chains import Oracle, bar, five_bar, palletizer, parallelogram
from steelyard.base.arrays import Array
from steelyard.base.errors import DataError, ModelError
from steelyard.excite.constraints.constraint_and_limits import MotionLimits, motion_limits
from steelyard.excite.planned.joints_along_path import PathMotion, along_path
from steelyard.excite.planned.tool_paths_lines_and_reach import (
    Circle,
    Reaches,
    ToolPath,
    UnfollowableWay,
    on_circle,
    out_and_back,
    plane_axes,
)
from steelyard.model.equations.passive_joints import passive_positions
from steelyard.robot.inertia_and_placement import Inertia
from steelyard.robot.robot import Coordinate, Frame, Limits, Robot
from tooled import DOWN, arm

UP = np.array([0.0, 0.0, 1.0])
SKEW = np.array([0.2, -0.3, 0.9])


def circle(**changes: object) -> Circle:
    keys: dict[str, object] = {
        "centre": [0.4, 0.1, 0.3], "radius": 0.1, "period": 3.0, "laps": 2, "ramp": 1.5,
        "normal": SKEW, "angle": 0.4,
    }  # fmt: skip
    return Circle(**keys | changes)  # type: ignore[arg-type]


PATHS: dict[str, ToolPath] = {
    "circle": circle(),
    "circle of ramps alone": circle(laps=1, ramp=3.0),
    "reaches": Reaches(
        out_and_back(np.zeros(3), np.array([[0.1, 0, 0], [0, 0.2, 0.1]]), 2), 1, 0.3
    ),
    "reaches without rest": Reaches(np.array([[0.0, 0, 0], [0.1, 0.2, 0]]), 0.8, 0.0),
}


@pytest.mark.parametrize("name", PATHS)
def test_derivatives_of_paths(name: str) -> None:
    """Velocities and accelerations are those of the places, and there is rest at both ends."""
    path, step = PATHS[name], 1e-5
    duration = path.knots[-1]
    assert path.knots[0] == 0.0 and np.all(np.diff(path.knots) > 0.0)
    for t in np.random.default_rng(0).uniform(2 * step, duration - 2 * step, 50):
        (_, before, _), here, (_, after, _) = (path.at(t + s * step) for s in (-1.0, 0.0, 1.0))
        places = [path.at(t + s * step)[0] for s in (-1.0, 1.0)]
        np.testing.assert_allclose(here[1], (places[1] - places[0]) / (2 * step), atol=1e-7)
        np.testing.assert_allclose(here[2], (after - before) / (2 * step), atol=1e-6)
    for t in (0.0, duration):
        np.testing.assert_allclose(np.array(path.at(t)[1:]), 0.0, atol=1e-12)


def test_a_circle_is_one() -> None:
    """Distance, plane and sense of the turn; whole turns; the speed between the ramps."""
    path = circle()
    t = np.linspace(0.0, path.duration, 200)
    places = np.array([path.at(x)[0] for x in t]) - path.centre
    np.testing.assert_allclose(np.linalg.norm(places, axis=1), 0.1, rtol=1e-12)
    np.testing.assert_allclose(places @ SKEW, 0.0, atol=1e-12)
    np.testing.assert_allclose(places[0], places[-1], atol=1e-12)
    turned = np.cross(places[:-1], places[1:]) @ SKEW / np.linalg.norm(SKEW)
    assert np.all(turned >= -1e-12)
    assert np.arcsin(turned / 0.01).sum() == pytest.approx(2 * 2 * np.pi)
    ahead, aside = plane_axes(SKEW)
    first = 0.1 * (np.cos(0.4) * ahead + np.sin(0.4) * aside)
    np.testing.assert_allclose(places[0], first, atol=1e-12)
    speeds = [np.linalg.norm(path.at(x)[1]) for x in (1.5, 3.0, 6.0)]
    np.testing.assert_allclose(speeds, 0.1 * 2 * np.pi / 3.0)
    np.testing.assert_allclose(plane_axes(np.array([2.0, 0.0, 0.0]))[0], [0.0, 1.0, 0.0])


def test_reaches_stop_at_their_places() -> None:
    home, targets = np.array([0.3, 0.0, 0.2]), on_circle(np.zeros(3), 0.1, 4, UP, 0.0)
    np.testing.assert_allclose(targets[1], [0.0, 0.1, 0.0], atol=1e-12)
    path = Reaches(out_and_back(home, targets, 2), 1.0, 0.5)
    assert path.knots[-1] == pytest.approx(2 * 4 * 2 * 1.5)
    for k, place in enumerate(np.tile([*np.stack([targets, targets * 0 + home], 1)], (2, 1, 1))):
        for end, target in enumerate(place):
            for t in 1.5 * (2 * k + end) + np.array([1.0, 1.25, 1.5]):
                np.testing.assert_allclose(path.at(t)[0], target, atol=1e-9)
    middle = path.at(0.5)
    np.testing.assert_allclose(middle[0], 0.5 * (home + targets[0]), atol=1e-12)
    np.testing.assert_allclose(middle[1], 15 / 8 * (targets[0] - home), atol=1e-12)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"ramp": 7.0}, "a ramp of 7 s is longer than the circle's laps, 6 s in all"),
        ({"normal": [0.0, 0.0, 0.0]}, "no direction"),
    ],
)
def test_circles_that_are_none(change: dict[str, object], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        circle(**change)


def test_reaches_that_are_none() -> None:
    with pytest.raises(ValueError, match="differs from the one before"):
        Reaches(np.array([[0.0, 0, 0], [0, 0, 0]]), 1.0, 0.0)


def times_of(motion: PathMotion) -> Array:
    return np.random.default_rng(1).uniform(0.0, motion.trajectory.duration, 200)


def check(path: ToolPath, motion: PathMotion, limits: MotionLimits, places: Array) -> None:
    """The tool is on its path at times between knots, and joints keep their ranges."""
    expected = np.array([path.at(t)[0] for t in times_of(motion)])
    assert np.linalg.norm(places - expected, axis=1).max() < 3e-8
    low, high = motion.trajectory.extremes(0)
    assert np.all(low >= limits.lower) and np.all(high <= limits.upper)
    for order in (1, 2):
        ends = motion.trajectory.derivative([0.0, motion.trajectory.duration], order)
        np.testing.assert_allclose(ends, 0.0, atol=1e-9)
    factors = [
        (np.abs(motion.trajectory.extremes(k)).max(axis=0) / bound) ** (1.0 / k)
        for k, bound in ((1, limits.velocity), (2, limits.acceleration))
    ]
    assert motion.excess == pytest.approx(np.max(factors))
    inner = motion.trajectory.breaks[1:-1]
    for order in (1, 2):
        before = motion.trajectory.derivative(inner - 1e-9, order)
        after = motion.trajectory.derivative(inner, order)
        np.testing.assert_allclose(before, after, atol=2e-6)


@pytest.mark.parametrize("name", ["ur10", "panda"])
@pytest.mark.parametrize("pointing", [False, True])
def test_arms_follow_circles(name: str, pointing: bool) -> None:
    """Joints that the path does not need stand still; the tool's axis is kept."""
    tooled = arm(name)
    path = circle(centre=[0.5, 0.1, 0.4], normal=UP)
    attitude = DOWN if pointing else None
    motion = along_path(tooled.robot, tooled.limits, tooled.frame, path, attitude, seed=3)
    q = motion.trajectory.sample(times_of(motion)).q
    check(path, motion, tooled.limits, tooled.places(q))
    assert len(motion.still) == tooled.robot.n - (5 if pointing else 3)
    for joint in motion.still:
        moved = np.ptp(q[:, tooled.robot.joint_names.index(joint)])
        assert moved == 0.0
    if pointing:
        turned = np.array([tooled.pose(x)[1][:, 2] for x in q])
        assert np.abs(turned - [0.0, 0.0, -1.0]).max() < 3e-8


def test_an_arm_reaches_from_where_it_is_to_start() -> None:
    tooled = arm("ur10")
    home = np.array([0.6, 0.2, 0.4])
    path = Reaches(out_and_back(home, on_circle(home, 0.1, 3, SKEW, 0.0), 1), 0.8, 0.1)
    for start in ([0.3, -1.2, 1.5, 0, 0, 0], [0.3, 0.5, -1.5, 0, 0, 0]):
        motion = along_path(tooled.robot, tooled.limits, tooled.frame, path, start=start)
        q = motion.trajectory.sample(times_of(motion)).q
        check(path, motion, tooled.limits, tooled.places(q))
        assert np.sign(q[0, 2]) == np.sign(start[2])


def bars() -> Robot:
    bodies = tuple(Inertia.about_com(1.0, (0.1, 0, 0), np.diag([1e-4, 1e-2, 1e-2])) for _ in "1234")
    robot = parallelogram(bodies, 0.3, 0.4)
    ranges = ((-0.6, 1.35), (1.4, 3.3))
    joints = tuple(
        Coordinate(c.name, c.kind, Limits(*span, 3.0, 20.0))
        for c, span in zip(robot.coordinates, ranges, strict=True)
    )
    return robot.changed(coordinates=joints)


CLOSED: dict[str, tuple[Callable[[], Robot], Frame, ToolPath]] = {
    "parallelogram": (
        bars,
        Frame("tip", 2, np.eye(3), np.array([0.3, 0.0, 0.0])),
        circle(centre=[0.0, 0.4, 0.0], radius=0.2, period=7.2, ramp=7.2, normal=UP, angle=0.0),
    ),
    "five-bar": (
        five_bar,
        Frame("tip", 1, np.eye(3), np.array([0.4, 0.0, 0.0])),
        Reaches(
            out_and_back(
                np.array([0.12, 0.42, 0.0]), on_circle(np.array([0.12, 0.42, 0]), 0.04, 8, UP, 0), 1
            ),
            1.2,
            0.2,
        ),
    ),
    "palletizer": (
        palletizer,
        Frame("hand", 4, np.eye(3), np.array([0.1, 0.05, 0.2])),
        circle(centre=[0.551, 0.082, 1.329], radius=0.02, laps=1, normal=UP),
    ),
}


def places_behind_loops(robot: Robot, frame: Frame, q: Array) -> Array:
    """Origins of a frame by MuJoCo, shape `(N, 3)` [m]; positions are consecutive."""
    oracle, places = Oracle(robot), []
    passive = passive_positions(robot, q.T).T
    for row in np.hstack([q, passive]):
        assert oracle.gap(row) < 1e-9
        mujoco.mj_kinematics(oracle.model, oracle.data)
        body = oracle.data.body(f"{frame.body} {robot.bodies[frame.body].name}")
        places.append(body.xpos + body.xmat.reshape(3, 3) @ frame.position)
    return np.array(places)


@pytest.mark.slow
@pytest.mark.parametrize("name", CLOSED)
def test_closed_chains_follow_paths(name: str) -> None:
    build, frame, path = CLOSED[name]
    robot = build()
    limits = motion_limits(robot)
    if name != "parallelogram":
        middle = robot.assembly[: robot.n]
        limits = MotionLimits(middle - 1.0, middle + 1.0, limits.velocity, limits.acceleration)
    motion = along_path(robot, limits, frame, path)
    t = np.sort(times_of(motion))
    places = places_behind_loops(robot, frame, motion.trajectory.sample(t).q)
    order = np.argsort(np.argsort(times_of(motion)))
    check(path, motion, limits, places[order])
    assert motion.still == ()


def planar(reach: float = 2.0) -> tuple[Robot, MotionLimits]:
    """Two bars of 0.3 m in a horizontal plane."""
    bodies = (bar("near", -1, (0.0, 0.0, 0.0), 0), bar("far", 0, (0.3, 0.0, 0.0), 1))
    limits = Limits(-reach, reach, 3.0, 9.0)
    names = tuple(Coordinate(f"{n}_joint", "revolute", limits) for n in ("near", "far"))
    tip = Frame("tip", 1, np.eye(3), np.array([0.3, 0.0, 0.0]))
    robot = Robot("planar", bodies, names, (0.0, 0.0, -9.81), frames=(tip,))
    return robot, motion_limits(robot)


@pytest.mark.slow
def test_a_path_that_leaves_the_plane_or_the_reach_says_where() -> None:
    robot, limits = planar()
    with pytest.raises(
        UnfollowableWay, match=r"start of the path is out of reach: .* found is 0\.05 m"
    ) as e:
        along_path(robot, limits, "tip", circle(centre=[0.3, 0.0, 0.05], normal=UP))
    assert "frame 'tip' of robot 'planar', at (0.392, 0.039, 0.050) m, t = 0.000 s" == e.value.where
    far = Reaches(np.array([[0.4, 0.0, 0.0], [0.7, 0.0, 0.0]]), 1.0, 0.0)
    with pytest.raises(UnfollowableWay, match="singular there|out of reach") as e:
        along_path(robot, limits, "tip", far)
    assert 0.5 < e.value.progress < 0.7 and "at (0.6" in e.value.where
    tilted = circle(centre=[0.3, 0.0, 0.0], normal=[0.1, 0.0, 1.0], angle=np.pi / 2)
    with pytest.raises(UnfollowableWay, match="out of reach"):
        along_path(robot, limits, "tip", tilted)


@pytest.mark.slow
def test_a_path_through_a_singular_posture_is_refused_there() -> None:
    """Through the base: the first joint would have to turn at once."""
    robot, limits = planar(np.pi)
    path = Reaches(np.array([[0.3, 1e-5, 0.0], [-0.3, 1e-5, 0.0]]), 1.0, 0.0)
    with pytest.raises(UnfollowableWay, match="singular there|move too fast") as error:
        along_path(robot, limits, "tip", path)
    assert error.value.progress == pytest.approx(0.5, abs=0.05)
    start = Reaches(np.array([[0.6, 0.0, 0.0], [0.4, 0.0, 0.0]]), 1.0, 0.0)
    with pytest.raises(UnfollowableWay, match="the posture at the start of the path is singular"):
        along_path(robot, limits, "tip", start)


def test_a_joint_at_its_limit_is_named() -> None:
    robot, _ = planar()
    ranges = MotionLimits([-2.0, -2.0], [0.5, 2.0], [3.0, 3.0], [5.0, 5.0])
    path = circle(centre=[0.0, 0.0, 0.0], radius=0.4, normal=UP, angle=0.0)
    with pytest.raises(
        UnfollowableWay, match="joint 'near_joint' exceeds its upper limit of 0.5 rad there"
    ):
        along_path(robot, ranges, "tip", path)


def test_frames_and_starts_that_cannot_be_led() -> None:
    robot, limits = planar()
    path = circle(centre=[0.3, 0.0, 0.0], normal=UP)
    with pytest.raises(ModelError, match="is fixed to the base"):
        along_path(robot, limits, Frame("stand", -1, np.eye(3), np.zeros(3)), path)
    with pytest.raises(DataError, match="outside the range of joint 'far_joint'"):
        along_path(robot, limits, "tip", path, start=[0.0, 2.5])


@pytest.mark.slow
def test_a_fast_path_says_in_how_much_more_time_it_would_keep_the_limits() -> None:
    robot, limits = planar()
    places = {"centre": [0.4, 0.1, 0.0], "radius": 0.05, "normal": UP}
    slow, fast = (
        along_path(robot, limits, "tip", circle(period=p, ramp=p, **places)) for p in (0.5, 0.25)
    )
    assert slow.limited == fast.limited
    assert slow.excess > 1.0
    assert fast.excess == pytest.approx(2.0 * slow.excess, rel=1e-6)
