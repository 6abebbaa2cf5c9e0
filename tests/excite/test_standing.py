"""Motions of a robot that stands: feet that stay, forces that push, derivatives, refusals."""

from pathlib import Path

import numpy as np
import pytest

from steelyard.base.arrays import Array, Parameters
from steelyard.base.errors import SteelyardError
from steelyard.base.motion import Motion
from steelyard.excite.design_problem_and_information import Problem
from steelyard.excite.design_problem_from_tables import build
from steelyard.excite.excite import design_excitation, design_task
from steelyard.excite.search.feasibility import each_start
from steelyard.excite.standing.forces_of_feet import (
    FeetForces,
    wrench_of_forces,
    zero_moment_margin,
)
from steelyard.excite.standing.information_on_feet import InformationOnFeet
from steelyard.excite.standing.legs_follow_base import LegLimits, OnAllJoints
from steelyard.model.laws.laws_without_friction import RigidBody
from steelyard.model.model import Model
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.inertia_and_placement import rpy_rotation
from steelyard.robot.robot import bodies_along

LEG = """
<body name="{0}_hip" pos="{1} {2} 0"><joint name="{0}_roll" axis="1 0 0" range="-1 1"/>
  <geom type="sphere" size=".03" mass=".4"/>
  <body name="{0}_thigh" pos="0 {3} 0"><joint name="{0}_pitch" axis="0 1 0" range="-2 2"/>
    <geom type="capsule" size=".015" fromto="0 0 -.03 .01 0 -.2" mass=".5"/>
    <body name="{0}_calf" pos="0 0 -.2"><joint name="{0}_knee" axis="0 1 0" range="-2.5 -.2"/>
      <geom type="capsule" size=".01" fromto="0 0 -.03 0 .01 -.18" mass=".2"/>
      <body name="{0}_foot" pos="0 0 -.2"/>
    </body>
  </body>
</body>"""
CORNERS = (
    ("a", 0.2, -0.1, -0.05),
    ("b", 0.2, 0.1, 0.05),
    ("c", -0.2, -0.1, -0.05),
    ("d", -0.2, 0.1, 0.05),
)
PONY = f"""<mujoco><compiler angle="radian"/><worldbody><body name="trunk" pos="0 0 .4"><freejoint/>
  <geom type="box" size=".2 .08 .04" pos=".01 0 .01" mass="5"/>
  {"".join(LEG.format(*corner) for corner in CORNERS)}</body></worldbody></mujoco>"""
FEET = ("a_foot", "b_foot", "c_foot", "d_foot")
BENT = "posture = {" + ", ".join(f"{x}_pitch = 0.7, {x}_knee = -1.4" for x in "abcd") + "}"


def pony(
    folder: Path,
    stance: str = BENT,
    feet: tuple[str, ...] = FEET,
    base: str = "floating",
    more: str = "",
) -> Path:
    """A robot file of a small quadruped that stands on feet that are points."""
    (folder / "pony.xml").write_text(PONY)
    path = folder / "pony.toml"
    names = ", ".join(f'"{foot}"' for foot in feet)
    path.write_text(
        f'[robot]\nmjcf = "pony.xml"\nbase = "{base}"\n[excitation.motion]\nkind = "fourier"\n'
        f"period = 5.0\nharmonics = 5\n{more}\n[excitation.stance]\nfeet = [{names}]\n{stance}\n"
    )
    return path


def problem_of(path: Path) -> Problem:
    """The design problem."""
    return build(*design_task(path).tables)


@pytest.fixture(scope="module")
def on_four(tmp_path_factory: pytest.TempPathFactory) -> Problem:
    """The pony on all feet."""
    return problem_of(pony(tmp_path_factory.mktemp("pony")))


def start_of(problem: Problem) -> Array:
    """Coefficients of a random motion that keeps all samples."""
    return next(each_start(problem.inequalities, np.random.default_rng(1), 1))


def parts(problem: Problem) -> tuple[LegLimits, FeetForces, OnAllJoints]:
    """Limits of the legs, forces, and these as a constraint of the independent joints."""
    limits, forces = (one for one in problem.constraints[:2] if isinstance(one, OnAllJoints))
    assert isinstance(limits.inner, LegLimits) and isinstance(forces.inner, FeetForces)
    return limits.inner, forces.inner, forces


def test_the_feet_stay_where_they_are(on_four: Problem) -> None:
    """The motion of all joints holds them, by kinematics that know nothing of pins."""
    _, forces, on_all = parts(on_four)
    motion = on_all.legs.motion(on_four.basis.motion(start_of(on_four)))
    q = motion.derivative(np.linspace(0.0, motion.duration, 333), 0)
    assert np.abs(q[:, 6:] - q[:1, 6:]).max() > 0.05  # the legs move
    turns, origins = bodies_along(forces.tree, q)
    for point, place in zip(forces.points, forces.places, strict=True):
        at = origins[point.body + 1] + turns[point.body + 1] @ point.position
        assert np.abs(at - place).max() < 1e-8
    assert on_all.legs.slip(motion) < 1e-8
    # what is between the polynomials' ends is a motion whose rates are its own
    h, t = 1e-5, np.array([1.234, 2.5])
    rate = (motion.derivative(t + h, 0) - motion.derivative(t - h, 0)) / (2.0 * h)
    assert np.allclose(rate, motion.derivative(t, 1), atol=1e-8)


def test_forces_carry_the_motion_as_the_floating_robot_says(
    on_four: Problem, tmp_path: Path
) -> None:
    """With the least forces at the feet no wrench is left on the base, and efforts are the same."""
    _, forces, on_all = parts(on_four)
    motion = on_all.legs.motion(on_four.basis.motion(start_of(on_four)))
    t = np.linspace(0.3, 3.7, 7)
    q, dq, ddq = (motion.derivative(t, order) for order in range(3))
    robot = load_robot(pony(tmp_path)).robot
    model = Model(robot, (RigidBody(),)).prior
    assert model is not None
    order = [forces.tree.joint_names.index(name) for name in robot.joint_names[6:]]
    axes = np.array([rpy_rotation(*angles) for angles in q[:, 3:6]])
    h = 1e-4

    def spin(at: Array) -> Array:
        ways = [
            np.array([rpy_rotation(*x) for x in motion.derivative(at + s * h, 0)[:, 3:6]])
            for s in (1.0, -1.0)
        ]
        now = np.array([rpy_rotation(*x) for x in motion.derivative(at, 0)[:, 3:6]])
        s = now.transpose(0, 2, 1) @ (ways[0] - ways[1]) / (2.0 * h)
        return np.column_stack([s[:, 2, 1], s[:, 0, 2], s[:, 1, 0]])

    proper = np.einsum("nji,nj->ni", axes, ddq[:, :3] - robot.gravity)
    whole = Motion.floating(
        t, q[:, order], dq[:, order], ddq[:, order], proper_acceleration=proper,
        angular_velocity=spin(t), angular_acceleration=(spin(t + h) - spin(t - h)) / (2.0 * h),
    )  # fmt: skip
    torque = model.torque(whole)
    names = list(forces.labels)
    loads = forces.margins(q, dq, ddq).values[:, :4] + forces.least
    force, moment = np.einsum("nij,nj->ni", axes, torque[:, :3]), torque[:, 3:6]
    about = np.einsum("nij,nj->ni", axes, moment) + np.cross(q[:, :3], force)
    least = np.hstack([force, about]) @ np.linalg.pinv(wrench_of_forces(forces.places)).T
    assert np.allclose(loads, least[:, 2::3], atol=2e-4)
    assert np.allclose(loads.sum(axis=1), force[:, 2], atol=1e-4) and len(names) == 20
    assert zero_moment_margin(forces, motion, 200) > 0.0
    columns = forces.columns(q, dq, ddq)  # of the written table
    for foot in FEET:
        pushed = np.column_stack([columns[f"force_{foot}_{axis}"] for axis in "xyz"])
        along = np.einsum("nji,nj->ni", axes, pushed)
        jacobian = model.jacobian(whole.q, foot)[:, :3]
        torque = torque - np.einsum("nij,ni->nj", jacobian, along)
    efforts = np.column_stack([columns[f"tau_{name}"] for name in robot.joint_names[6:]])
    assert np.allclose(efforts, torque[:, 6:], atol=1e-4) and np.abs(torque[:, :6]).max() < 1e-3
    # a point's weight over the sum is where the zero-moment point is: the moment there is zero
    place = loads @ forces.places / loads.sum(axis=1, keepdims=True)
    rest = about - np.cross(place, force)
    assert np.abs(rest[:, :2]).max() < 1e-3


def test_derivatives_are_those_of_differences(on_four: Problem) -> None:
    """Of every constraint by the independent joints, and of the criterion by coefficients."""
    rng, n = np.random.default_rng(0), on_four.robot.n
    state = [x * rng.normal(size=(4, n)) for x in (0.02, 0.3, 1.0)]
    h = 1e-6
    for constraint in on_four.constraints:
        found = constraint.margins(*state)
        near = found.values < 0.999 * constraint.activation_distance
        for order, by in enumerate((found.by_q, found.by_dq, found.by_ddq)):
            assert by is not None
            for k in range(n):
                ends = []
                for sign in (h, -h):
                    moved = [x.copy() for x in state]
                    moved[order][:, k] += sign
                    ends.append(constraint.margins(*moved).values)
                change = (ends[0] - ends[1]) / (2.0 * h)
                off = np.abs(by[:, :, k] - change)[near].max(initial=0.0)
                assert off < 2e-5 + 1e-5 * np.abs(change).max()
    x, way = start_of(on_four), rng.normal(size=(n, on_four.basis.count))
    ends = [on_four.objective(x + sign * 1e-5 * way, 4.0)[0] for sign in (1.0, -1.0)]
    slope = float(np.sum(on_four.objective(x, 4.0)[1] * way))
    assert np.isclose((ends[0] - ends[1]) / 2e-5, slope, rtol=1e-4)


def test_information_is_that_behind_the_projection_of_unknown_forces(on_four: Problem) -> None:
    """The projection of contacts on the floating robot's rows gives as much of any motion."""
    _, forces, on_all = parts(on_four)
    shows = on_four.cases[0].shows
    assert isinstance(shows, InformationOnFeet)
    trajectory = on_four.basis.motion(start_of(on_four))
    t = np.linspace(0.0, 5.0, 60)
    own = [trajectory.derivative(t, order).T for order in range(3)]
    gram = shows.at(*map(np.ascontiguousarray, own)).gram
    whole = on_all.legs.at(*(x.T for x in own))
    tree = Model(forces.tree, shows.model.terms).at(Parameters([], [], []))
    rows = tree.regressor(Motion(t, whole.q, whole.dq, whole.ddq))[:, :, shows.base.independent]
    total = np.zeros_like(gram)
    for k in range(len(t)):
        turns, origins = bodies_along(forces.tree, whole.q[k : k + 1])
        jacobian = []
        for point in forces.points:
            tip = origins[point.body + 1][0] + turns[point.body + 1][0] @ point.position
            columns = np.zeros((3, forces.tree.n))
            for b in forces.tree.carriers(point.body):
                body = forces.tree.bodies[b]
                axis = turns[body.parent + 1][0] @ (body.rotation @ body.axis)
                lever = (
                    axis if body.kind == "prismatic" else np.cross(axis, tip - origins[b + 1][0])
                )
                columns[:, body.coordinate] += lever
            jacobian.append(columns)
        j = np.vstack(jacobian)
        projection = np.eye(forces.tree.n) - np.linalg.pinv(j) @ j
        total += rows[k].T @ projection @ rows[k]
    assert np.allclose(gram, total, atol=1e-7 * abs(total).max())


def test_a_design_is_proven_and_written_with_all_joints(tmp_path: Path) -> None:
    """Certificate of all joints, the base in the table, the floor under the links."""
    path = pony(tmp_path)
    found = design_excitation(path, budget=12.0, processes=1, searches=1)
    designed = found.designed
    assert designed.certificate.holds, designed.certificate.failures
    assert {"forces of the feet", "clearance", "floor, planes and boxes"} <= {
        proof.name for proof in designed.certificate.proofs
    }
    names = designed.robot.joint_names
    assert names[:6] == ("base_x", "base_y", "base_z", "base_rx", "base_ry", "base_rz")
    assert {one.joint for one in designed.certificate.extremes} == set(names) and len(names) == 18
    files = found.written_to(tmp_path)
    head = (tmp_path / files["csv"]).read_text().splitlines()[0].split(",")
    assert {"time_s", "q_base_x", "q_a_knee", "ddq_d_roll"} <= set(head)
    assert any("zero-moment point" in note for note in designed.notes)
    assert any("a mass at such a point is not shown" in gap for gap in designed.certificate.gaps)
    again = design_task(path, start=tmp_path / files["trajectory"])
    assert again.start is not None and again.start.sample([0.0]).n_joints == 6


def test_a_lifted_leg_is_a_limb_of_its_own(tmp_path: Path) -> None:
    """On three feet the fourth leg moves freely, where the weight is within the triangle."""
    problem = problem_of(pony(tmp_path, BENT + "\nleast_load = 0.05", FEET[:3]))
    assert problem.robot.joint_names[6:] == ("d_roll", "d_pitch", "d_knee")
    _, forces, on_all = parts(problem)
    motion = on_all.legs.motion(problem.basis.motion(start_of(problem)))
    assert zero_moment_margin(forces, motion, 200) > 0.0 and len(forces.points) == 3


HOPPER = """<mujoco><compiler angle="radian"/><worldbody>
<body name="trunk" pos="0 0 .8"><freejoint/>
  <geom type="box" size=".1 .08 .1" mass="6"/>
  <body name="yaw"><joint name="yaw" axis="0 0 1"/><geom type="sphere" size=".02" mass=".2"/>
  <body name="roll"><joint name="roll" axis="1 0 0"/><geom type="sphere" size=".02" mass=".2"/>
  <body name="thigh" pos="0 0 -.1"><joint name="pitch" axis="0 1 0"/>
    <geom type="capsule" size=".02" fromto="0 0 -.08 0 .01 -.2" mass=".8"/>
  <body name="calf" pos="0 0 -.25"><joint name="knee" axis="0 1 0"/>
    <geom type="capsule" size=".02" fromto="0 0 -.03 .01 0 -.2" mass=".5"/>
  <body name="ankle" pos="0 0 -.25"><joint name="ankle_pitch" axis="0 1 0"/>
    <geom type="sphere" size=".02" mass=".1"/>
  <body name="foot"><joint name="ankle_roll" axis="1 0 0"/>
    <geom type="box" size=".08 .05 .01" pos="0 0 -.04" mass=".3"/>
  </body></body></body></body></body></body></body></worldbody></mujoco>"""


def test_one_sole_bears_the_whole_robot(tmp_path: Path) -> None:
    """Its corners share the weight; six joints follow six motions of the base."""
    (tmp_path / "hopper.xml").write_text(HOPPER)
    path = tmp_path / "hopper.toml"
    corners = [[x, y, -0.05] for x in (-0.08, 0.08) for y in (-0.05, 0.05)]
    path.write_text(
        f'[robot]\nmjcf = "hopper.xml"\nbase = "floating"\n[excitation.stance]\nfeet = ["foot"]\n'
        f"points = {corners}\nposture = {{pitch = -0.4, knee = 0.8, ankle_pitch = -0.4}}\n"
        "least_load = 0.1\n"
    )
    problem = problem_of(path)
    _, forces, on_all = parts(problem)
    assert problem.robot.n == 6 and len(problem.robot.passive) == 6 and len(forces.points) == 4
    motion = on_all.legs.motion(problem.basis.motion(start_of(problem)))
    q = motion.derivative(np.linspace(0.0, motion.duration, 50), 0)
    assert np.ptp(q[:, 6:], axis=0).min() > 1e-3 and on_all.legs.slip(motion) < 1e-8
    assert zero_moment_margin(forces, motion, 200) > 0.0
    assert (forces.proven(motion)[:4] > 0.0).all()  # each corner bears more than the least load


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"feet": FEET[:2]}, "along one line"),
        ({"stance": ""}, "do not determine the joints of their legs"),
        ({"base": "trunk"}, "the base of the robot is fixed"),
        ({"feet": ("a_foot", "b_foot", "c_foot", "trunk")}, "do not determine"),
        ({"more": "[excitation.limits]\njerk = 10.0"}, "limits of jerk"),
        ({"feet": ("a_fot",)}, "a_foot"),
        ({"stance": BENT + "\nleast_load = 1.0"}, "load of 'a_foot'"),
    ],
)
def test_what_cannot_stand_is_refused(tmp_path: Path, given: dict[str, str], words: str) -> None:
    """With what is wrong, where, and what to do."""
    with pytest.raises(SteelyardError) as caught:
        design_excitation(pony(tmp_path, **given), budget=2.0, processes=1)  # type: ignore[arg-type]
    assert words in str(caught.value)


def test_programs_of_controllers_are_refused(tmp_path: Path) -> None:
    """None of them balances."""
    with pytest.raises(SteelyardError, match="not written as 'ros2'"):
        design_task(pony(tmp_path), formats=["ros2"])
