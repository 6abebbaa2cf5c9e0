"""Exported models: other programs compute the same torques, and what is left out is listed."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from closed_chains import CHAINS, slider_crank
from invented import ROBOTS, mimic, tree
from law_cases import CASES, LawCase, name_of
from moving import geared
from steelyard.base.errors import ModelError
from steelyard.base.motion import Motion
from steelyard.estimate.covariance_and_band_widths import EDGES, Calibration
from steelyard.estimate.estimate import KnownScales, Unidentifiable
from steelyard.estimate.identified_model import IdentifiedModel
from steelyard.estimate.information.base_parameters_and_regressor import base_parameters
from steelyard.export.model_files.export_model_file import exported, refuse_changed
from steelyard.export.model_files.representable_content import FIT_HEADING, Format, content_of
from steelyard.model.laws.friction_over_speed import (
    Coulomb,
    Cubic,
    Quadratic,
    Root,
    Stribeck,
    Viscous,
)
from steelyard.model.laws.friction_with_memory import MaxwellSlip
from steelyard.model.laws.laws_without_friction import RigidBody, RotorInertia, Spring
from steelyard.model.laws.register import DEFAULT_TERMS, TERMS
from steelyard.model.model import Model
from steelyard.model.terms.term import ActsOnAxes, Term
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.inertia_and_placement import INERTIAL_NAMES, Inertia
from steelyard.robot.robot import Limits, Robot
from steelyard.runs.run import MotionSamples
from weighed import identified_of

LAWS = [case for case in CASES if case.law != "rigid_body"]
SUPPORTED = [case for case in LAWS if not case.left_out]
"""Laws that MJCF holds whole."""

OPEN = [case for case in LAWS if case.left_out]
"""Laws of which something is left out."""

SLIDING = {
    "dahl": lambda v: v["dahl.tip_joint"],
    "lugre": lambda v: v["lugre.tip_joint"],
    "maxwell_slip": lambda v: sum(v[f"maxwell_slip{k}.tip_joint"] for k in range(1, 5)),
    "directional_coulomb": lambda v: np.mean(
        [v[f"directional_coulomb_{e}.tip_joint"] for e in DIRECTIONS]
    ),
}
DIRECTIONS = ("forward", "backward")


def unsupported(identified: IdentifiedModel, form: Format) -> tuple[str, ...]:
    return content_of(identified, form).unsupported


def written(identified: IdentifiedModel, form: Format, folder: Path) -> Path:
    """The file of a model, read once and compared."""
    made = exported(identified, form)
    path = folder / f"exported.{'xml' if form == 'mjcf' else 'urdf'}"
    path.write_text(made.text, encoding="utf-8")
    refuse_changed(path, made)
    return path


def motion_of(robot: Robot, count: int = 30, seed: int = 3) -> Motion:
    """Random states; every joint moves."""
    rng = np.random.default_rng(seed)
    q, ddq = rng.uniform(-1.0, 1.0, (2, count, robot.n))
    dq = rng.uniform(0.5, 2.0, (count, robot.n)) * rng.choice([-1.0, 1.0], (count, robot.n))
    return Motion(np.arange(count), q, dq, ddq)


def sliding(motion: Motion, term: Term) -> Motion:
    """The states in which all coordinates of a term move: MuJoCo's friction creeps when slow."""
    if not isinstance(term, ActsOnAxes) or term.role != "brake":
        return motion
    rows = np.array([axis.row for axis in term.axes(geared())])
    keep = (np.abs(motion.dq @ rows.T) > 0.3 * np.linalg.norm(rows, axis=1)).all(axis=1)
    assert keep.sum() > 10
    return Motion(np.arange(keep.sum()), motion.q[keep], motion.dq[keep], motion.ddq[keep])


def joint_map(robot: Robot, names: list[str]) -> tuple[np.ndarray, np.ndarray]:
    """Positions of a program's joints from those of the robot: `G q + o`."""
    bodies = {body.joint: body for body in robot.bodies}
    matrix = np.zeros((len(names), robot.n_joints))
    for row, name in enumerate(names):
        matrix[row, bodies[name].coordinate] = bodies[name].ratio
    return matrix, np.array([bodies[name].offset for name in names])


def mujoco_torque(path: Path, robot: Robot, motion: Motion) -> np.ndarray:
    """Efforts of an exported MJCF by MuJoCo's inverse dynamics, its mimic ties taken out."""
    spec = mujoco.MjSpec.from_file(str(path))
    for tie in list(spec.equalities):
        spec.delete(tie)
    model = spec.compile()
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT
    data = mujoco.MjData(model)
    names = [model.joint(k).name for k in range(model.njnt)]
    matrix, offset = joint_map(robot, names)
    result = np.empty_like(motion.q)
    for k in range(len(motion)):
        data.qpos[:] = matrix @ motion.q[k] + offset
        data.qvel[:], data.qacc[:] = matrix @ motion.dq[k], matrix @ motion.ddq[k]
        mujoco.mj_inverse(model, data)
        result[k] = matrix.T @ data.qfrc_inverse
    return result


def close(one: np.ndarray, other: np.ndarray) -> None:
    assert np.abs(one - other).max() < 1e-9 * max(1.0, np.abs(other).max())


@pytest.mark.parametrize("form", ["urdf", "mjcf"])
@pytest.mark.parametrize("name", [*ROBOTS, "geared"])
def test_reading_again_gives_the_same_torque(name: str, form: Format, tmp_path: Path) -> None:
    robot = geared() if name == "geared" else ROBOTS[name](tmp_path)
    identified = identified_of(robot, [RigidBody()])
    again = load_robot(written(identified, form, tmp_path)).robot
    assert sorted(again.joint_names) == sorted(robot.joint_names)
    order = [robot.joint_names.index(name) for name in again.joint_names]
    if form == "urdf":
        again = again.changed(gravity=robot.gravity)
    motion = motion_of(robot)
    valued = Model(again, (RigidBody(),)).prior
    assert valued is not None
    moved = Motion(motion.t, *(x[:, order] for x in (motion.q, motion.dq, motion.ddq)))
    close(valued.torque(moved), identified.torque(motion)[:, order])
    for c, limits in (
        (c, robot.joints[k].limits) for c, k in zip(again.joints, order, strict=True)
    ):
        unlimited = np.inf if form == "mjcf" or c.kind == "revolute" else 1e9
        assert c.limits.lower == max(limits.lower, -unlimited)
        assert c.limits.upper == min(limits.upper, unlimited)


@pytest.mark.parametrize("name", [*ROBOTS, "geared"])
def test_pinocchio_reads_bodies_and_friction(name: str, tmp_path: Path) -> None:
    robot = geared() if name == "geared" else ROBOTS[name](tmp_path)
    identified = identified_of(robot, [RigidBody(), Viscous()])
    model = pin.buildModelFromUrdf(str(written(identified, "urdf", tmp_path)))
    model.gravity.linear = np.array(robot.gravity)
    names = list(model.names)[1:]
    matrix, offset = joint_map(robot, names)
    motion, data = motion_of(robot), model.createData()
    torque = np.empty_like(motion.q)
    for k in range(len(motion)):
        x, dx = matrix @ motion.q[k] + offset, matrix @ motion.dq[k]
        q = np.concatenate([_turned(model, i + 1, x[i]) for i in range(len(names))])
        whole = pin.rnea(model, data, q, dx, matrix @ motion.ddq[k]) + model.damping * dx
        torque[k] = matrix.T @ whole
    close(torque, identified.torque(motion))


def _turned(model: pin.Model, joint: int, x: float) -> list[float]:
    """Pinocchio's configuration of one joint; continuous ones are a cosine and a sine."""
    return [np.cos(x), np.sin(x)] if model.nqs[joint] == 2 else [x]


@pytest.mark.parametrize("name", ["single", "tree", "dh arm", "mimic", "ur10e", "panda", "geared"])
def test_mujoco_computes_all_that_is_held(name: str, tmp_path: Path) -> None:
    robot = geared() if name == "geared" else ROBOTS[name](tmp_path)
    identified = identified_of(robot, [RigidBody(), RotorInertia(), Coulomb(), Viscous(), Spring()])
    path, motion = written(identified, "mjcf", tmp_path), motion_of(robot)
    close(mujoco_torque(path, robot, motion), identified.torque(motion))


@pytest.mark.parametrize("case", SUPPORTED, ids=name_of)
def test_a_law_is_held_whole(case: LawCase, tmp_path: Path) -> None:
    robot = geared()
    term = case.on(robot)
    identified = identified_of(robot, [RigidBody(), term])
    assert all("gears" in sentence for sentence in unsupported(identified, "mjcf"))
    path, motion = written(identified, "mjcf", tmp_path), sliding(motion_of(robot), term)
    close(mujoco_torque(path, robot, motion), identified.torque(motion))


@pytest.mark.parametrize("case", OPEN, ids=name_of)
@pytest.mark.parametrize("form", ["urdf", "mjcf"])
def test_what_is_left_out_is_reported(case: LawCase, form: Format) -> None:
    robot = geared()
    export = exported(identified_of(robot, [RigidBody(), case.on(robot)], case.values), form)
    # a URDF holds nothing along motors, and says so law by law
    words = (case.left_out, f"({case.law})") if "motors" in case.fields else (case.left_out,)
    assert any(x in sentence for sentence in export.unsupported for x in words)
    head = export.text.partition("-->")[0]
    assert all(f"- {sentence}" in head for sentence in export.unsupported)


@pytest.mark.parametrize("case", SUPPORTED, ids=name_of)
def test_urdf_holds_a_law_or_lists_it(case: LawCase) -> None:
    sentences = unsupported(identified_of(geared(), [RigidBody(), case.on(geared())]), "urdf")
    more = any("gears" not in sentence and "gravity" not in sentence for sentence in sentences)
    assert more != case.in_urdf


@pytest.mark.parametrize("law", list(SLIDING))
def test_friction_in_full_sliding_is_held(law: str, tmp_path: Path) -> None:
    robot = geared()
    identified = identified_of(robot, [RigidBody(), TERMS[law]()])
    values = identified.valued.values.as_dict()
    model = mujoco.MjModel.from_xml_path(str(written(identified, "mjcf", tmp_path)))
    found = model.dof_frictionloss[model.joint("tip_joint").dofadr[0]]
    assert found == pytest.approx(SLIDING[law](values), rel=1e-12)


def test_the_curve_of_both_directions_is_held_by_its_mean() -> None:
    """A fit to Stribeck friction of two levels is that to their mean."""
    robot, found = geared(), []
    for law, levels in (
        ("directional_stribeck", {"directional_stribeck_forward": 3.0,
                                  "directional_stribeck_backward": 1.0}),
        ("stribeck", {"stribeck": 2.0}),
    ):  # fmt: skip
        values = {f"{name}.{c.name}": x for name, x in levels.items() for c in robot.coordinates}
        identified = identified_of(robot, [RigidBody(), TERMS[law]()], values)
        found.append(content_of(identified, "mjcf"))
    both, mean = found
    assert all(joint["dry"] > 0.1 for joint in both.joints)
    for mine, other in zip(both.joints, mean.joints, strict=True):
        assert mine == pytest.approx(other, rel=1e-9)
    assert any("± trunk_joint 1 Nm" in x and "left_joint 1 Nm" in x for x in both.unsupported)


def test_scales_of_efforts_are_reported() -> None:
    identified = identified_of(tree(), [RigidBody()])
    rows = identified.model.robot.joint_names
    scales = np.linspace(0.9, 1.2, len(rows))
    scaled = replace(identified, effort_scales=KnownScales(rows, scales, np.eye(len(rows))))
    for form in ("urdf", "mjcf"):
        (words,) = set(unsupported(scaled, form)) - set(unsupported(identified, form))
        assert f"logged efforts are {rows[0]} 0.90, " in words
        assert words in " ".join(exported(scaled, form).text.split())


def test_gravity_that_points_elsewhere_is_reported_of_a_urdf() -> None:
    sentences = unsupported(identified_of(tree(), [RigidBody()]), "urdf")
    assert sentences == ("gravity: set it to (1, -3, -9) m/s² in the base frame",)
    level = tree().changed(gravity=(0.0, 0.0, -9.81))
    assert unsupported(identified_of(level, [RigidBody()]), "urdf") == ()


@pytest.mark.parametrize("name", [name for name in CHAINS if name != "slider-crank"])
def test_loops_are_closed_again(name: str, tmp_path: Path) -> None:
    robot = CHAINS[name]()
    identified = identified_of(robot, [RigidBody()])
    again = load_robot(written(identified, "mjcf", tmp_path)).robot
    assert again.joint_names == robot.joint_names
    assert sorted(c.name for c in again.passive) == sorted(c.name for c in robot.passive)
    rng = np.random.default_rng(2)
    q = robot.assembly[: robot.n] + rng.uniform(-0.05, 0.05, (10, robot.n))
    dq, ddq = rng.uniform(-1.0, 1.0, (2, 10, robot.n))
    motion = Motion(np.arange(10), q, dq, ddq)
    valued = Model(again, (RigidBody(),)).prior
    assert valued is not None
    close(valued.torque(motion), identified.torque(motion))
    sentences = unsupported(identified, "urdf")
    assert any("open kinematic tree without" in sentence for sentence in sentences)


def boundless(robot: Robot) -> Robot:
    """The robot without limits; those of the invented chains are about their assembly."""
    free = [
        tuple(replace(c, limits=Limits()) for c in x) for x in (robot.coordinates, robot.passive)
    ]
    return robot.changed(coordinates=free[0], passive=free[1])


SIMULATED: dict[str, Callable[[Path], Robot]] = {
    **ROBOTS,
    "geared": lambda _: geared(),
    **{
        n: (lambda _, make=make: boundless(make()))
        for n, make in CHAINS.items()
        if n != "slider-crank"
    },
}


@pytest.mark.parametrize("form", ["urdf", "mjcf"])
@pytest.mark.parametrize("name", list(SIMULATED))
def test_mujoco_simulates_without_a_warning(name: str, form: Format, tmp_path: Path) -> None:
    identified = identified_of(SIMULATED[name](tmp_path))
    model = mujoco.MjModel.from_xml_path(str(written(identified, form, tmp_path)))
    data = mujoco.MjData(model)
    while data.time < 1.0:
        mujoco.mj_step(model, data)
    assert sum(warning.number for warning in data.warning) == 0
    assert np.isfinite(data.qpos).all() and np.isfinite(data.qvel).all()
    if form == "mjcf" and model.neq:
        mujoco.mj_fwdPosition(model, data)
        assert np.abs(data.efc_pos[: data.ne]).max() < 5e-3


@pytest.mark.slow
def test_motors_limits_and_home_are_those_of_the_robot(tmp_path: Path) -> None:
    robot = mimic(tmp_path)
    limits = Limits(0.5, np.inf, 3.0, 50.0)
    robot = robot.changed(coordinates=(replace(robot.coordinates[0], limits=limits),))
    path = written(identified_of(robot), "mjcf", tmp_path)
    model = mujoco.MjModel.from_xml_path(str(path))
    assert model.jnt_range[model.joint("shoulder").id].tolist() == [0.5, 1e9]
    assert model.actuator("shoulder").ctrlrange.tolist() == [-50.0, 50.0]
    assert model.key("home").qpos.tolist() == [0.5, -1.5 * 0.5 + 0.2]
    assert model.site("plate").bodyid == model.body("arm").id
    assert load_robot(path).robot.coordinates[0].limits.effort == 50.0
    again = load_robot(written(identified_of(robot), "urdf", tmp_path)).robot
    assert again.coordinates[0].limits == Limits(0.5, 1e9, 3.0, 50.0)


@pytest.mark.parametrize("form", ["urdf", "mjcf"])
def test_frames_between_the_joints_of_one_body_stay_frames(form: Format, tmp_path: Path) -> None:
    given = tmp_path / "leg.xml"
    given.write_text(
        '<mujoco><worldbody><body name="thigh"><joint name="x" axis="1 0 0" pos=".1 0 0"/>'
        '<joint name="y" axis="0 1 0"/><joint name="z" type="slide"/>'
        '<inertial pos=".1 .02 -.2" mass="3" diaginertia=".05 .05 .01"/>'
        "</body></worldbody></mujoco>"
    )
    robot = load_robot(given).robot
    identified = identified_of(robot, [RigidBody()])
    again = load_robot(written(identified, form, tmp_path)).robot
    assert [body.massless for body in again.bodies] == [True, True, False]
    models = [Model(one, (RigidBody(),)) for one in (again, robot)]
    assert base_parameters(models[0]).base_names == base_parameters(models[1]).base_names
    motion, prior = motion_of(robot), models[0].prior
    assert prior is not None
    close(prior.torque(motion), identified.torque(motion))
    head = exported(identified, form)
    assert list(head.mass_shares) == ["thigh"]


def test_a_link_without_mass_stays_simulable(tmp_path: Path) -> None:
    robot = tree()
    bodies = [replace(b, inertia=Inertia.zero()) if b.name == "slider" else b for b in robot.bodies]
    identified = identified_of(robot.changed(bodies=tuple(bodies)), [RigidBody()])
    path, motion = written(identified, "mjcf", tmp_path), motion_of(robot)
    close(mujoco_torque(path, robot, motion), identified.torque(motion))


@pytest.mark.parametrize(
    ("ten", "words"),
    [
        ((-1.0, *(0.0,) * 9), "the mass is negative"),
        ((1.0, 0.0, 0.0, 0.0, 0.1, 0.0, 0.1, 0.0, 0.0, 0.5), "triangle inequality"),
        ((1.0, 0.0, 0.0, 0.0, 0.1, 0.0, 0.1, 0.0, 0.0, 0.2), "lies in a plane"),
        ((1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.01, 0.0, 0.0, 0.01), "lies in a plane or a line"),
    ],
)
def test_a_link_that_cannot_exist_is_named(ten: tuple[float, ...], words: str) -> None:
    values = {f"{n}.slider": x for n, x in zip(INERTIAL_NAMES, ten, strict=True)}
    with pytest.raises(ModelError, match=f"link 'slider' is not physically consistent.*{words}"):
        exported(identified_of(tree(), [RigidBody()], values), "urdf")


def test_base_parameters_alone_are_refused() -> None:
    identified = identified_of(tree())
    poor = replace(identified, estimate=replace(identified.estimate, standard=None))
    with pytest.raises(ModelError, match="base parameters only") as error:
        exported(poor, "mjcf")
    assert "default estimator" in error.value.fix
    assert "remove method from [estimation] of the robot" in error.value.fix


def test_a_model_without_bodies_is_refused() -> None:
    with pytest.raises(ModelError, match="no rigid bodies"):
        exported(identified_of(tree(), [Viscous()]), "mjcf")


def test_a_coordinate_without_a_joint_of_its_own_is_refused() -> None:
    with pytest.raises(ModelError, match="'rod_joint' moves bodies by mimic joints alone"):
        exported(identified_of(slider_crank()), "mjcf")


def test_friction_below_zero_is_zero(tmp_path: Path) -> None:
    values = {"coulomb.tip_joint": -0.5, "viscous.tip_joint": -1e-13}
    identified = identified_of(tree(), DEFAULT_TERMS, values)
    assert fit_errors(identified, "mjcf") == {"tip_joint": (0.5, 1.0)}
    model = mujoco.MjModel.from_xml_path(str(written(identified, "mjcf", tmp_path)))
    joint = model.joint("tip_joint").dofadr[0]
    assert model.dof_frictionloss[joint] == model.dof_damping[joint] == 0.0


def fit_errors(identified: IdentifiedModel, form: Format) -> dict[str, tuple[float, float]]:
    """Per joint with fitted friction: how far it is off at most, up to which speed."""
    sentences = [s for s in unsupported(identified, form) if s.startswith(FIT_HEADING)]
    found = re.findall(r"(\w+) (\S+) Nm? \(rms \S+\) up to (\S+) ", "".join(sentences))
    return {name: (float(off), float(top)) for name, off, top in found}


def turning(robot: Robot, joint: str, speeds: np.ndarray) -> Motion:
    """One joint moves at one speed after the other, both ways."""
    dq = np.zeros((2 * len(speeds), robot.n))
    dq[:, robot.joint_names.index(joint)] = np.concatenate([speeds, -speeds])
    q = np.full_like(dq, 0.3)
    return Motion(np.arange(len(dq)), q, dq, np.zeros_like(dq))


def moved(identified: IdentifiedModel, speeds: list[float]) -> IdentifiedModel:
    """The model as from a log in which each joint moved at one speed."""
    t = np.linspace(0.0, 1.0, 11)
    q = np.outer(t, speeds)
    return replace(identified, motions=(MotionSamples("run", 0.1, t, q, np.zeros_like(q)),))


TOGETHER: dict[str, tuple[list[Term], dict[str, float]]] = {
    "a square below zero": (
        [Coulomb(), Viscous(), Quadratic(), Cubic()],
        {"coulomb": 3.0, "viscous": 6.0, "quadratic": -4.0, "cubic": 0.9},
    ),
    "a root below zero": ([Coulomb(), Viscous(), Root()], {"viscous": 4.0, "root": -0.5}),
    "breakaway alone": ([Stribeck(speed=0.7)], {"stribeck": 2.0}),
    "breakaway below zero": (
        [MaxwellSlip(), Viscous(), Stribeck(speed=0.3)],
        {"maxwell_slip1": 2.0, "maxwell_slip2": -0.5, "viscous": 1.0, "stribeck": -1.0},
    ),
}
"""Laws of which one has no place, and what friction is made of along every joint."""

TOP = 2.5


@pytest.mark.parametrize("name", list(TOGETHER))
def test_friction_is_near_as_a_whole(name: str, tmp_path: Path) -> None:
    terms, wanted = TOGETHER[name]
    robot = tree()
    values = {f"{law}.{joint}": x for law, x in wanted.items() for joint in robot.joint_names}
    identified = moved(identified_of(robot, [RigidBody(), *terms], values), [TOP] * robot.n)
    path = written(identified, "mjcf", tmp_path)
    off = fit_errors(identified, "mjcf")
    assert list(off) == list(robot.joint_names)
    for joint, (most, top) in off.items():
        assert top == pytest.approx(TOP)
        motion = turning(robot, joint, np.linspace(0.05, TOP, 20))
        plain = Model(robot, (RigidBody(),)).prior
        assert plain is not None
        column = robot.joint_names.index(joint)
        inertial = plain.torque(motion)[:, column]
        found = mujoco_torque(path, robot, motion)[:, column] - inertial
        sliding = friction_of(
            terms, identified.valued.values.as_dict(), joint, motion.dq[:, column]
        )
        assert np.abs(found - sliding).max() < 1.01 * most
        share = np.linalg.norm(found - sliding) / np.linalg.norm(sliding)
        assert share < (0.75 if name == "breakaway alone" else 0.25)


def friction_of(
    terms: list[Term], values: dict[str, float], joint: str, v: np.ndarray
) -> np.ndarray:
    """Friction in full sliding, by hand."""
    x = {law: values.get(f"{law}.{joint}", 0.0) for law in ("viscous", "quadratic", "cubic")}
    total = x["viscous"] * v + x["quadratic"] * np.abs(v) * v + x["cubic"] * v**3
    for term in terms:
        if isinstance(term, Coulomb):
            total += values[f"coulomb.{joint}"] * np.sign(v)
        if isinstance(term, Root):
            total += values[f"root.{joint}"] * np.sqrt(np.abs(v)) * np.sign(v)
        if isinstance(term, Stribeck):
            total += values[f"stribeck.{joint}"] * np.exp(-np.abs(v) / term.speed) * np.sign(v)
        if isinstance(term, MaxwellSlip):
            slips = [values[f"maxwell_slip{k}.{joint}"] for k in range(1, 5)]
            total += sum(slips) * np.sign(v)
    return total


def test_a_urdf_has_the_whole_curve_in_what_it_knows(tmp_path: Path) -> None:
    """Without a place for the square, dry and viscous friction take its share."""
    robot = tree()
    identified = moved(identified_of(robot, [RigidBody(), Viscous(), Quadratic()]), [TOP] * robot.n)
    values = identified.valued.values.as_dict()
    off = fit_errors(identified, "urdf")
    model = pin.buildModelFromUrdf(str(written(identified, "urdf", tmp_path)))
    v = np.linspace(0.05, TOP, 50)
    for joint, (most, _) in off.items():
        k = model.idx_vs[model.getJointId(joint)]
        found = model.friction[k] + model.damping[k] * v
        wanted = values[f"viscous.{joint}"] * v + values[f"quadratic.{joint}"] * v**2
        assert np.abs(found - wanted).max() < 1.01 * most
        assert most < 0.25 * wanted.max()


def test_friction_that_is_nothing_beside_the_rest_is_zero() -> None:
    robot = tree()
    values = {"viscous.tip_joint": -1e-8, "coulomb.tip_joint": 2.0, "quadratic.tip_joint": 1e-7}
    values |= {f"{law}.left_joint": 1e-11 for law in ("coulomb", "viscous", "quadratic")}
    terms = [RigidBody(), Coulomb(), Viscous(), Quadratic()]
    made = exported(identified_of(robot, terms, values), "mjcf")
    place = dict(zip(robot.joint_names, made.content.joints, strict=True))
    assert place["tip_joint"] == {"dry": 2.0}
    assert place["left_joint"] == {}
    assert fit_errors(identified_of(robot, terms, values), "mjcf") == {}


def test_speeds_of_a_fit_are_those_of_the_logs() -> None:
    robot = tree()
    found = identified_of(robot, [RigidBody(), Stribeck()])
    assert {top for _, top in fit_errors(found, "mjcf").values()} == {1.0}
    limited = robot.changed(
        coordinates=tuple(replace(c, limits=Limits(velocity=3.0)) for c in robot.coordinates)
    )
    without = identified_of(limited, [RigidBody(), Stribeck()])
    assert {top for _, top in fit_errors(without, "mjcf").values()} == {3.0}
    logged = moved(without, [1.0, 0.5, 2.0, 0.0])
    assert [top for _, top in fit_errors(logged, "mjcf").values()] == [1.0, 0.5, 2.0, 3.0]
    edges = 2.0 * np.array(EDGES) * np.ones((robot.n, 1))
    rare = replace(logged, calibration=Calibration("runs", 3, edges, np.full((robot.n, 4), 2.0)))
    tops = [top for _, top in fit_errors(rare, "mjcf").values()]
    assert tops == pytest.approx([np.sqrt(8.0)] * 4, rel=1e-2)


def test_the_head_says_where_the_numbers_come_from() -> None:
    for form in ("urdf", "mjcf"):
        head = exported(identified_of(tree()), form).text.partition("-->")[0]
        for words in ("steelyard 9.9.9", "robot arm.toml: ab12", "cd34", "a- -b@1:2", "consistent"):
            assert words in head


def learned_by(identified: IdentifiedModel, shares: dict[str, float]) -> IdentifiedModel:
    """The model with some parameters that come from the data in part only."""
    standard = identified.estimate.standard
    assert standard is not None
    learned = [
        shares.get(name, x)
        for name, x in zip(standard.parameters.names, standard.learned.tolist(), strict=True)
    ]
    standard = replace(standard, learned=np.array(learned))
    blind = (Unidentifiable("mx.slider + my.tool"),)
    return replace(
        identified, estimate=replace(identified.estimate, standard=standard, blind=blind)
    )


@pytest.mark.parametrize("form", ["urdf", "mjcf"])
def test_the_head_tells_data_from_prior(form: Format) -> None:
    shares = {"m.slider": 0.25, "m.trunk": 0.0, "mx.trunk": 0.0, "viscous.tip_joint": 0.001}
    made = exported(learned_by(identified_of(tree()), shares), form)
    assert made.mass_shares["slider"] == 0.25 and made.mass_shares["trunk"] == 0.0
    assert made.unseen == ("mx.slider + my.tool", "viscous.tip_joint")
    head = made.text.partition("-->")[0]
    assert "- slider: 25%" in head and "- trunk: 0%" in head
    unseen = head.partition("Not identifiable from the data:")[2]
    assert "- mx.slider + my.tool\n" in unseen and "- viscous.tip_joint\n" in unseen
    assert "Not identifiable from the data" not in exported(identified_of(tree()), form).text


@pytest.mark.parametrize("form", ["urdf", "mjcf"])
def test_what_is_rounding_beside_the_body_is_zero(form: Format, tmp_path: Path) -> None:
    about = np.diag([0.02, 0.03, 0.025]) + 1e-18 * (np.ones((3, 3)) - np.eye(3))
    ten = Inertia.about_com(2.0, [0.0, -7.07e-44, 0.1], about).ten
    values = {f"{n}.slider": x for n, x in zip(INERTIAL_NAMES, ten, strict=True)}
    identified = identified_of(tree(), [RigidBody()], values)
    written(identified, form, tmp_path)
    text = exported(identified, form).text.partition("-->")[2]
    assert not re.search(r"\de-(1[6-9]|[2-9]\d)", text)
    centre = re.search(r'(?:xyz|pos)="([^"]*)"[^>]*>?\s*(?:<mass value|mass)="2.0"', text)
    assert centre is not None and centre[1].split()[:2] == ["0.0", "0.0"]
    small = Inertia.about_com(1e-9, [1e-6, 2e-6, 0.0], 1e-20 * np.eye(3)).ten
    tiny = {f"{n}.slider": x for n, x in zip(INERTIAL_NAMES, small, strict=True)}
    assert "1e-06" in exported(identified_of(tree(), [RigidBody()], tiny), form).text


def test_a_file_that_reads_otherwise_is_refused(tmp_path: Path) -> None:
    made = exported(identified_of(mimic(tmp_path)), "urdf")
    path = tmp_path / "broken.urdf"
    for old, new, words in (
        ('value="2.5"', 'value="2.6"', "another mass or inertia"),
        ('multiplier="-1.5"', 'multiplier="1.5"', "has another pose or axis"),
        (
            '<parent link="arm" />\n    <child link="foll',
            '<parent link="base" />\n    <child link="foll',
            "has another parent",
        ),
    ):
        assert old in made.text
        path.write_text(made.text.replace(old, new))
        with pytest.raises(ModelError, match=words):
            refuse_changed(path, made)


@pytest.mark.parametrize("form", ["urdf", "mjcf"])
def test_a_model_whose_masses_are_up_to_one_factor_is_refused(form: Format) -> None:
    """One gain of 1 of currents stands for unknown ones."""
    model = identified_of(tree())
    gains = np.array([1.0, 0.5, 0.7, 0.2])
    signals = replace(model.signals, effort_units=("A",) * 4, gains=gains)
    with pytest.raises(ModelError, match="gain of joint 'trunk_joint' is unknown"):
        exported(replace(model, signals=signals), form)
    known = replace(signals, gains=3.0 * gains)
    assert exported(replace(model, signals=known), form).text
