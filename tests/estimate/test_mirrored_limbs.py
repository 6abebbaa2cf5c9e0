"""Limbs that mirror each other: pairs by kinematics, images of bodies, both sides compared."""

from pathlib import Path

import numpy as np
import pytest

from steelyard.base.arrays import Array, Parameters
from steelyard.base.errors import ModelError
from steelyard.base.motion import Motion
from steelyard.estimate.estimate import Estimate
from steelyard.estimate.information.base_parameters_and_regressor import base_parameters
from steelyard.estimate.prior.mirrored_limbs import (
    compared_sides,
    mirrored_links,
    symmetry_note,
    symmetry_rows,
)
from steelyard.estimate.prior.prior_constraint_kinds import knowledge_of
from steelyard.model.laws.laws_without_friction import RigidBody
from steelyard.model.model import Model
from steelyard.robot.file.robot_file import load_robot
from steelyard.robot.inertia_and_placement import INERTIAL_NAMES

# frames of the right arm are turned, and its axes point the other way
HUMANOID = """<mujoco><compiler angle="radian"/><worldbody><body name="trunk"><freejoint/>
  <geom type="box" size=".1 .2 .3" pos=".01 0 .02" mass="5"/>
  <body name="left_upper" pos="0 .2 .3"><joint name="left_shoulder" axis="1 0 0"/>
    <geom type="capsule" size=".04" fromto="0 0 0 .05 .06 -.3" mass="1.5"/>
    <body name="left_lower" pos=".05 .06 -.3"><joint name="left_elbow" axis="0 1 0"/>
      <geom type="box" size=".03 .02 .1" pos=".02 .03 -.1" mass=".8"/></body></body>
  <body name="right_upper" pos="0 -.2 .3" euler="0 0 3.141592653589793">
    <joint name="right_shoulder" axis="1 0 0"/>
    <geom type="capsule" size=".04" fromto="0 0 0 -.05 .06 -.3" mass="1.5"/>
    <body name="right_lower" pos="-.05 .06 -.3"><joint name="right_elbow" axis="0 1 0"/>
      <geom type="box" size=".03 .02 .1" pos="-.02 .03 -.1" mass=".8"/></body></body>
  <body name="head" pos="0 0 .4"><joint name="neck" axis="0 0 1"/>
    <geom type="sphere" size=".1" pos=".02 .01 .1" mass="1"/></body>
</body></worldbody></mujoco>"""


@pytest.fixture
def model(tmp_path: Path) -> Model:
    path = tmp_path / "humanoid.xml"
    path.write_text(HUMANOID)
    return Model(load_robot(path, base="floating").robot, (RigidBody(),))


def standard(model: Model) -> Array:
    assert model.prior is not None
    return np.array(model.prior.values.values)


def test_pairs_are_found_by_kinematics(model: Model) -> None:
    names = [body.name for body in model.robot.bodies]
    pairs = mirrored_links(model.robot, "xz")
    found = {(names[pair.one], names[pair.other]) for pair in pairs if pair.one <= pair.other}
    assert found == {
        ("trunk", "trunk"),
        ("head", "head"),
        ("left_upper", "right_upper"),
        ("left_lower", "right_lower"),
    }


def test_images_of_mirrored_bodies_are_the_other_bodies(model: Model) -> None:
    values = standard(model)
    for pair in mirrored_links(model.robot, "xz"):
        one, other = (model.robot.bodies[k] for k in (pair.one, pair.other))
        if one.name in ("trunk", "head"):
            continue
        np.testing.assert_allclose(pair.image @ one.inertia.ten, other.inertia.ten, atol=1e-12)
    for row in symmetry_rows(model, "xz", "humanoid.toml"):
        off = sum(a * values[model.names.index(name)] for name, a in row.coefficients.items())
        assert off == pytest.approx(0.0, abs=1e-12)


def test_mirrored_motion_of_mirrored_bodies_has_mirrored_torques(model: Model) -> None:
    """The image of any body at the other side: torques of the whole are mirrored, too."""
    rng, robot = np.random.default_rng(1), model.robot
    values = standard(model) * (1.0 + 0.2 * rng.normal(size=len(model.names)))
    image = values.copy()
    places = {name: k for k, name in enumerate(model.names)}
    for pair in mirrored_links(robot, "xz"):
        one, other = (
            [places[f"{x}.{robot.bodies[k].name}"] for x in INERTIAL_NAMES]
            for k in (pair.one, pair.other)
        )
        image[other] = pair.image @ values[one]
    q, dq, ddq = rng.normal(size=(3, 1, robot.n))
    q[:, :6] = 0.0
    # shoulders turn about mirrored axes: signs against each other follow from the pairs' axes
    order = [*range(6), 8, 9, 6, 7, 10]
    signs = np.array([1, -1, 1, -1, 1, -1, 1, -1, 1, -1, -1], dtype=float)
    flipped = [x[:, order] * signs for x in (q, dq, ddq)]
    torques = [
        model.at(Parameters(model.names, model.units, given)).torque(Motion(np.zeros(1), *motion))
        for given, motion in ((values, (q, dq, ddq)), (image, flipped))
    ]
    np.testing.assert_allclose(torques[0][:, order] * signs, torques[1], atol=1e-10)


def estimate_of(model: Model, values: Array, spread: float) -> Estimate:
    base = base_parameters(model)
    count = len(base)
    return Estimate(
        "made up",
        Parameters(base.base_names, base.base_units, base.base_values(values)),
        np.eye(count) * spread**2,
        (),
        np.ones(model.robot.n),
        np.full(model.robot.n, 100.0),
        1.0,
        1.0,
    )


def test_both_sides_are_compared(model: Model) -> None:
    base, values = base_parameters(model), standard(model)
    alike = compared_sides(base, model.robot, estimate_of(model, values, 1e-4), "xz")
    assert len(alike) > 8 and all(one.variation < 1e-9 for one in alike if abs(one.value) > 1e-9)
    heavier = values.copy()
    heavier[model.names.index("mz.right_lower")] *= 1.2
    found = estimate_of(model, heavier, 1e-4)
    odd = [x for x in compared_sides(base, model.robot, found, "xz") if x.sure]
    apart = {one.name for one in odd if abs(one.value - one.image) > one.half_width}
    assert "mz.left_lower" in apart
    (one,) = (one for one in odd if one.name == "mz.left_lower")
    assert one.variation == pytest.approx(0.2 / 2.2 * np.sqrt(2.0), rel=1e-6)
    assert "farthest apart" in symmetry_note(base, model.robot, found, "xz")


def test_limbs_that_mirror_nothing_are_refused(model: Model) -> None:
    with pytest.raises(ModelError, match="is the mirror image of another across the yz plane"):
        symmetry_rows(model, "yz", "humanoid.toml")


def test_one_line_of_the_robot_file_is_prior_knowledge(model: Model, tmp_path: Path) -> None:
    path = tmp_path / "humanoid.toml"
    given = '[robot]\nmjcf = "humanoid.xml"\nbase = "floating"\n[prior]\nsymmetry = "xz"\n'
    path.write_text(given)
    rows = knowledge_of(model, load_robot(path)).rows
    assert len(rows) == 20 and "left_upper" in rows[0].label and "humanoid.toml" in rows[0].label
    path.write_text(given.replace("xz", "yz"))
    with pytest.raises(ModelError, match="across the yz plane"):
        knowledge_of(model, load_robot(path))
    path.write_text(given[: given.index("[prior]")])
    assert knowledge_of(model, load_robot(path)).rows == ()
