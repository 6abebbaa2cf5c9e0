import numpy as np
import pytest

from oracles import body_positions, pinocchio_torque
from steelyard.base.errors import ModelError
from steelyard.robot.inertia_and_placement import Inertia, Placement, rpy_rotation
from steelyard.robot.mechanism import Joint, Link, Mechanism, Mimic
from steelyard.robot.robot import Limits
from steelyard.robot.robot_from_mechanism import reduced

BALL = Inertia.about_com(1.0, [0.1, 0.2, 0.3], 0.01 * np.eye(3))
Z = np.array([0.0, 0.0, 1.0])


def chain(*kinds: str, **changes: object) -> Mechanism:
    """Links l0, l1, ... of one kilogram each, joints j1, j2, ..., half a metre apart along x."""
    links = [Link(f"l{k}", BALL) for k in range(len(kinds) + 1)]
    joints = [
        Joint(
            f"j{k}",
            kind,  # type: ignore[arg-type]
            f"l{k - 1}",
            f"l{k}",
            Placement(rpy_rotation(0.3 * k, 0.0, 0.1), [0.5, 0.0, 0.1]),
            Z,
            **changes.get(f"j{k}", {}),  # type: ignore[arg-type]
        )
        for k, kind in enumerate(kinds, start=1)
    ]
    return Mechanism("chain", links, joints)


def test_all_movable_joints_move_by_default() -> None:
    robot, notes = reduced(chain("revolute", "fixed", "prismatic", "continuous"))
    assert robot.joint_names == ("j1", "j3", "j4")
    assert [c.kind for c in robot.coordinates] == ["revolute", "prismatic", "revolute"]
    assert [b.inertia.mass for b in robot.bodies] == [2.0, 1.0, 1.0]
    assert notes == ()


def test_coordinates_follow_the_given_order_and_bodies_the_tree() -> None:
    mechanism = chain("revolute", "prismatic")
    robot, _ = reduced(mechanism, ["j2", "j1"])
    assert robot.joint_names == ("j2", "j1")
    assert [(b.joint, b.coordinate) for b in robot.bodies] == [("j1", 1), ("j2", 0)]
    straight, _ = reduced(mechanism)
    state = np.array([[0.3, -0.2], [1.0, 2.0], [-1.0, 0.5]])
    turned = pinocchio_torque(robot, *state[:, ::-1])
    assert np.allclose(turned[::-1], pinocchio_torque(straight, *state))


def test_locking_is_holding_still() -> None:
    """Torques of the joints that move are those of the whole robot with the others at rest."""
    mechanism = chain("revolute", "prismatic", "revolute", "revolute", "prismatic")
    robot, notes = reduced(mechanism, locked={"j2": 0.2, "j4": -0.7})
    whole, _ = reduced(mechanism)
    rng = np.random.default_rng(3)
    q, dq, ddq = rng.uniform(-1, 1, (3, 3))
    full = np.zeros((3, 5))
    full[:, [0, 2, 4]] = q, dq, ddq
    full[0, [1, 3]] = 0.2, -0.7
    assert robot.joint_names == ("j1", "j3", "j5") and notes == ()
    assert np.allclose(
        pinocchio_torque(robot, q, dq, ddq), pinocchio_torque(whole, *full)[[0, 2, 4]]
    )


def test_joints_left_out_are_locked_at_zero_or_the_nearest_limit_and_reported() -> None:
    mechanism = chain(
        "revolute", "revolute", "prismatic", j3={"limits": Limits(lower=0.002, upper=0.03)}
    )
    robot, notes = reduced(mechanism, ["j1"])
    assert notes == ("locked, as no position was given: j2 at 0 rad, j3 at 0.002 m",)
    explicit, silent = reduced(mechanism, ["j1"], locked={"j2": 0.0, "j3": 0.002})
    assert silent == ()
    assert np.array_equal(robot.bodies[0].inertia.ten, explicit.bodies[0].inertia.ten)


def test_locked_joints_beside_the_moving_ones_are_not_mentioned() -> None:
    links = [Link("base"), Link("wheel", BALL), Link("arm", BALL)]
    joints = [
        Joint("wheel_joint", "continuous", "base", "wheel"),
        Joint("arm_joint", "revolute", "base", "arm"),
    ]
    robot, notes = reduced(Mechanism("r", links, joints), ["arm_joint"])
    assert [b.name for b in robot.bodies] == ["arm"] and notes == ()


def test_base_and_tip() -> None:
    mechanism = chain("revolute", "revolute", "fixed", "revolute", "revolute")
    robot, notes = reduced(mechanism, base="l1", tip="l4", locked={"j1": 0.5})
    assert robot.joint_names == ("j2", "j4")
    assert robot.bodies[0].parent == -1
    assert robot.bodies[1].inertia.mass == pytest.approx(2.0)  # the link beyond the tip is locked
    assert notes == (
        "left out, as the base 'l1' does not carry them: j1",
        "locked, as no position was given: j5 at 0 rad",
    )
    rotation = mechanism.joint("j1").at(0.5).rotation
    assert np.allclose(robot.gravity, rotation.T @ [0.0, 0.0, -9.81])


def test_gravity_given_is_in_the_base_frame() -> None:
    robot, _ = reduced(chain("revolute", "revolute"), base="l1", gravity=[9.81, 0.0, 0.0])
    assert np.array_equal(robot.gravity, [9.81, 0.0, 0.0])


def test_several_tips() -> None:
    links = [Link(n, BALL) for n in ("base", "trunk", "left", "right", "head")]
    joints = [Joint("waist", "revolute", "base", "trunk")]
    joints += [Joint(f"{n}_joint", "revolute", "trunk", n) for n in ("left", "right", "head")]
    robot, _ = reduced(Mechanism("r", links, joints), tip=["left", "right"])
    assert robot.joint_names == ("waist", "left_joint", "right_joint")
    assert [b.parent for b in robot.bodies] == [-1, 0, 0]
    assert robot.bodies[0].inertia.mass == 2.0  # trunk and head


def test_mimics_follow_through_chains() -> None:
    mechanism = chain(
        "revolute",
        "revolute",
        "prismatic",
        j2={"mimic": Mimic("j1", 2.0, 0.1)},
        j3={"mimic": Mimic("j2", -0.5, 0.3)},
    )
    robot, _ = reduced(mechanism)
    assert robot.joint_names == ("j1",)
    assert [(b.ratio, b.offset) for b in robot.bodies] == [
        (1.0, 0.0),
        (2.0, 0.1),
        (-1.0, pytest.approx(0.25)),
    ]
    assert np.allclose(body_positions(robot, np.array([0.4])), [0.4, 0.9, -0.15])


def test_mimics_of_a_locked_master_are_locked_where_it_puts_them() -> None:
    mechanism = chain("revolute", "revolute", "revolute", j3={"mimic": Mimic("j2", 2.0, 0.1)})
    robot, _ = reduced(mechanism, ["j1"], locked={"j2": 0.3})
    free = chain("revolute", "revolute", "revolute")
    same, _ = reduced(free, ["j1"], locked={"j2": 0.3, "j3": 0.7})
    assert np.allclose(robot.bodies[0].inertia.ten, same.bodies[0].inertia.ten)


def test_a_follower_off_the_chain_still_follows() -> None:
    links = [Link(n, BALL) for n in ("base", "arm", "side")]
    joints = [
        Joint("arm_joint", "revolute", "base", "arm"),
        Joint("side_joint", "revolute", "base", "side", mimic=Mimic("arm_joint", -1.0)),
    ]
    robot, _ = reduced(Mechanism("r", links, joints), tip="arm")
    assert [b.joint for b in robot.bodies] == ["arm_joint", "side_joint"]


def followed(*followers: tuple[Mimic, Limits]) -> Mechanism:
    """A joint `j1` with followers `j2`, `j3`..., each with limits of its own."""
    changes = {
        f"j{k}": {"mimic": mimic, "limits": limits}
        for k, (mimic, limits) in enumerate(followers, start=2)
    }
    own = {"limits": Limits(-2.0, 2.0, 3.0, 50.0)}
    return chain(*["revolute"] * (len(followers) + 1), j1=own, **changes)


def test_followers_keep_their_own_limits() -> None:
    half, turned = Limits(-0.5, 1.0, 1.0, 5.0), Limits(-4.0, 1.3, 4.0)
    mechanism = followed((Mimic("j1", 2.0, 0.1), half), (Mimic("j2", -0.5, 0.05), turned))
    robot, notes = reduced(mechanism)
    limits = robot.coordinates[0].limits
    assert (limits.velocity, limits.effort, notes) == (0.5, 50.0, ())
    # j3 = -q and is the wider one
    assert (limits.lower, limits.upper) == (pytest.approx(-0.3), pytest.approx(0.45))
    for q in (limits.lower, limits.upper):
        x = body_positions(robot, np.array([q]))
        assert half.lower - 1e-12 <= x[1] <= half.upper + 1e-12
    robot, _ = reduced(followed((Mimic("j1", -1.0), Limits(-0.5, 1.5))))
    assert robot.coordinates[0].limits == Limits(-1.5, 0.5, 3.0, 50.0)
    given = Limits(-2.0, 0.2, 2.0, 50.0)
    robot, _ = reduced(followed((Mimic("j1", -1.0), Limits(-0.5, 1.5))), limits={"j1": given})
    assert robot.coordinates[0].limits == Limits(-1.5, 0.2, 2.0, 50.0)


def test_followers_that_leave_no_range_are_reported() -> None:
    robot, notes = reduced(followed((Mimic("j1", 1.0, 5.0), Limits(-1.0, 1.0, 0.1))))
    assert robot.coordinates[0].limits == Limits(-2.0, 2.0, 0.1, 50.0)
    assert notes == (
        "no position of 'j1' satisfies the ranges of its mimic joints: these are ignored",
    )
    robot, notes = reduced(
        followed((Mimic("j1"), Limits(0.0, 0.0)), (Mimic("j1", 0.0), Limits(1, 2)))
    )
    assert robot.coordinates[0].limits == Limits(-2.0, 2.0, 3.0, 50.0) and notes == ()


def test_limits_are_replaced() -> None:
    robot, _ = reduced(chain("revolute"), limits={"j1": Limits(upper=1.5)})
    assert robot.coordinates[0].limits.upper == 1.5


def test_an_empty_range_is_unlimited_and_reported() -> None:
    robot, notes = reduced(chain("revolute", j1={"limits": Limits(0.0, 0.0)}))
    assert robot.coordinates[0].limits.lower == -np.inf
    assert notes == ("joint 'j1' has an empty range in the model: taken as unlimited",)


def test_impossible_inertials_are_reported() -> None:
    bad = Inertia.about_com(1.0, [0.0, 0.0, 0.0], np.diag([0.1, 0.1, 0.5]))
    mechanism = Mechanism("r", [Link("a"), Link("b", bad)], [Joint("j", "revolute", "a", "b")])
    _, notes = reduced(mechanism)
    assert "the inertial is not physically consistent: 'b'" in notes[0] and "triangle" in notes[0]


MECHANISM = chain("revolute", "fixed", "revolute", "revolute", j4={"mimic": Mimic("j3")})


@pytest.mark.parametrize(
    ("options", "wrong", "fix"),
    [
        ({"joints": ["J1x"]}, "'J1x' is to be identified, but the model has no", "mean 'j1'"),
        ({"joints": ["j2"]}, "'j2' cannot be identified: it is fixed", "j1, j3"),
        ({"joints": ["j4"]}, "'j4' cannot be identified: it follows joint 'j3'", "j1, j3"),
        ({"joints": ["j1"], "base": "l1"}, "not between base and tip", "between base and tip"),
        ({"locked": {"j1": 0.0, "j3": 0.0}}, "no joint is left to identify", "unlocked"),
        ({"base": "l9"}, "the base link 'l9' does not exist", "mean 'l"),
        ({"base": "l2", "tip": "l1"}, "'l1' is not beyond the base link 'l2'", "another base"),
    ],
)  # fmt: skip
def test_errors(options: dict, wrong: str, fix: str) -> None:
    with pytest.raises(ModelError) as caught:
        reduced(MECHANISM, **options)
    assert wrong in caught.value.wrong
    assert fix in caught.value.fix


def test_mimic_of_a_fixed_joint_is_an_error() -> None:
    with pytest.raises(ModelError, match="mimics joint 'j1', which is fixed"):
        chain("fixed", "revolute", j2={"mimic": Mimic("j1")})
